//! All formats together: what is read, that ParaView JSON gives it back, in what words the rest is refused.

mod damage;

use std::path::Path;

use super::{TransferFileError, beyond_paraview, parse_transfer_functions, to_paraview};
use crate::classify::{ColorSpace, Lighting, OpacityPoint, Preset, TransferFunction, grey_ramp};

const VP: &str = "1\n1\n0.8\n0.15\n0.3\n12\n\
                  8 -500 0 40 0.1 200 0.5 900 0.9\n\
                  6 0 0 30 0.25 120 1\n\
                  12 -500 0 0 0 40 0.7 0.3 0.2 900 1 0.95 0.9\n";

const VP_JSON: &str = r#"{
  "@schema": "https://example.org/schema/volume-property-schema-v1.0.0.json#",
  "volumeProperties": [{
    "effectiveRange": [-500.0, 900.0],
    "interpolationType": "linear",
    "components": [{
      "componentWeight": 1.0,
      "shade": true,
      "lighting": {"diffuse": 0.8, "ambient": 0.15, "specular": 0.3, "specularPower": 12.0},
      "disableGradientOpacity": false,
      "scalarOpacityUnitDistance": 1.5,
      "rgbTransferFunction": {"type": "colorTransferFunction", "points": [
        {"x": -500.0, "color": [0.0, 0.0, 0.0], "midpoint": 0.3, "sharpness": 0.0},
        {"x": 40.0, "color": [0.7, 0.3, 0.2], "midpoint": 0.5, "sharpness": 0.0},
        {"x": 900.0, "color": [1.0, 0.95, 0.9], "midpoint": 0.5, "sharpness": 0.0}]},
      "scalarOpacity": {"type": "piecewiseLinearFunction", "points": [
        {"x": -500.0, "y": 0.0, "midpoint": 0.5, "sharpness": 0.0},
        {"x": 40.0, "y": 0.1, "midpoint": 0.25, "sharpness": 0.6},
        {"x": 900.0, "y": 0.9}]},
      "gradientOpacity": {"type": "piecewiseLinearFunction", "points": [
        {"x": 0.0, "y": 0.0}, {"x": 120.0, "y": 1.0}]}
    }]
  }]
}"#;

const SCENE: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<MRML version="3DSlicer 1">
  <VolumeProperty selected="false" name="first" gradientOpacity="4 0 1 255 1" specularPower="12" specular="0.3"
    shade="1" ambient="0.15" diffuse="0.8" interpolation="1" effectiveRange="-500 900"
    scalarOpacity="8 -500 0 40 0.1 200 0.5 900 0.9"
    colorTransfer="12 -500 0 0 0 40 0.7 0.3 0.2 900 1 0.95 0.9"/>
  <VolumeProperty name="second" shade="0" interpolation="0" gradientOpacity="4 0 0.5 60 1"
    scalarOpacity="4 0 0 1 1" colorTransfer="4 0.5 1 1 1"/>
</MRML>"#;

const MAPS: &str = r#"<ColorMaps>
  <ColorMap name="rising" space="Lab" indexedLookup="false">
    <Point x="0" o="0" r="0.1" g="0.2" b="0.9"/>
    <Point x="70.5" o="0.25" r="0" g="1" b="0"/>
    <Point x="100" o="1" r="0.9" g="0.1" b="0.1"/>
    <NaN r="1" g="1" b="0"/>
  </ColorMap>
  <ColorMap name="rainbow" space="HSV"><Point x="1" o="0" r="1" g="0" b="0"/><Point x="0" o="0" r="0" g="0" b="1"/></ColorMap>
</ColorMaps>"#;

fn table() -> Vec<u8> {
    let plane = |f: fn(u8) -> u8| (0..=255).map(f);
    plane(|i| i)
        .chain(plane(|i| 255 - i))
        .chain(plane(|i| i / 2))
        .collect()
}

fn with_header() -> Vec<u8> {
    let mut bytes = b"ICOL\0\x02\x01\0\0\0\0\xff".to_vec();
    bytes.resize(32, 0);
    bytes.extend(table());
    bytes
}

fn as_text(header: &str, is_indexed: bool) -> String {
    let mut text = header.to_owned();
    for i in 0..256_u32 {
        if is_indexed {
            text += &format!("{i}\t");
        }
        text += &format!("{i}\t{}\t{}\n", 255 - i, i / 2);
    }
    text
}

/// A file of every format, by name.
fn every_format() -> Vec<(&'static str, Vec<u8>)> {
    let json = to_paraview(&[Preset::find("ct-bone")
        .unwrap()
        .instantiate([0.0, 1.0], 0.5)
        .unwrap()]);
    vec![
        ("bone.json", json.into_bytes()),
        ("maps.xml", MAPS.into()),
        ("my.vp.json", VP_JSON.into()),
        ("my.vp", VP.into()),
        ("presets.xml", SCENE.into()),
        ("bare.lut", table()),
        ("nih.lut", with_header()),
        ("rows.lut", as_text("", false).into_bytes()),
        (
            "table.lut",
            as_text("Index\tRed\tGreen\tBlue\n", true).into_bytes(),
        ),
    ]
}

fn parse(name: &str, bytes: &[u8]) -> Result<Vec<TransferFunction>, TransferFileError> {
    parse_transfer_functions(bytes, Path::new(name))
}

fn only(name: &str, bytes: &[u8]) -> TransferFunction {
    let mut functions = parse(name, bytes).unwrap();
    assert_eq!(functions.len(), 1, "{name}: one function");
    functions.remove(0)
}

const LIGHTING: Lighting = Lighting {
    ambient: 0.15,
    diffuse: 0.8,
    specular: 0.3,
    shininess: 12.0,
};

#[test]
fn slicers_lines() {
    let tf = only("a/My bones.vp", VP.as_bytes());
    assert_eq!(tf.name, "My bones", "named after the file");
    assert_eq!(tf.lighting, Some(LIGHTING), "lighting");
    assert_eq!((tf.shade, tf.nearest), (Some(true), false), "shade, linear");
    assert_eq!(tf.opacity_unit_mm, None, "not said");
    assert!((tf.opacity.eval(120.0) - 0.3).abs() < 1e-12, "opacity");
    assert_eq!(tf.color.eval(40.0), [0.7, 0.3, 0.2], "colour");
    let gradient = tf.gradient_opacity.unwrap();
    assert!((gradient.eval(15.0) - 0.125).abs() < 1e-12, "gradient");
    let constant = VP.replace("6 0 0 30 0.25 120 1", "4 0 1 255 1");
    let tf = only("a.vp", constant.replace('\n', "\r\n").as_bytes());
    assert_eq!(tf.gradient_opacity, None, "1 everywhere; CR LF is fine");
    let silent = VP.replacen("1\n1\n0.8\n0.15\n0.3\n12\n", "0\n\n\n\n\n\n", 1);
    let tf = only("a.vp", silent.as_bytes());
    assert_eq!(
        (tf.lighting, tf.shade, tf.nearest),
        (None, None, true),
        "empty lines say nothing"
    );
}

#[test]
fn slicers_json() {
    let tf = only("My.VP.json", VP_JSON.as_bytes());
    assert_eq!(tf.name, "My", "named after the file");
    assert_eq!(tf.lighting, Some(LIGHTING), "lighting");
    assert_eq!(tf.opacity_unit_mm, Some(1.5), "unit distance");
    assert_eq!(tf.shade, Some(true), "shade");
    let curve = |x| tf.opacity.eval(x);
    assert!((curve(40.0 + 0.25 * 860.0) - 0.5).abs() < 1e-12, "midpoint");
    assert!(tf.gradient_opacity.is_some(), "gradient opacity");
    let off = VP_JSON.replace(r#"Opacity": false"#, r#"Opacity": true"#);
    let tf = only("a.vp.json", off.as_bytes());
    assert_eq!(tf.gradient_opacity, None, "switched off");
    // Two components, of a volume of two channels.
    let start = VP_JSON.find("{\n      \"componentWeight").unwrap();
    let end = VP_JSON.rfind("}]\n  }]").unwrap() + 1;
    let component = &VP_JSON[start..end];
    let two = VP_JSON.replace(component, &format!("{component}, {component}"));
    let names: Vec<String> = parse("a.vp.json", two.as_bytes())
        .unwrap()
        .into_iter()
        .map(|f| f.name)
        .collect();
    assert_eq!(names, ["a, component 1", "a, component 2"], "both");
}

#[test]
fn colours_follow_midpoint_and_sharpness() {
    for (midpoint, sharpness) in [
        (0.5, 0.0),
        (0.3, 0.0),
        (0.3, 0.4),
        (0.8, 0.92),
        (0.5, 0.05),
        (0.2, 1.0),
    ] {
        let text = VP_JSON.replace(
            r#""color": [0.0, 0.0, 0.0], "midpoint": 0.3, "sharpness": 0.0"#,
            &format!(
                r#""color": [0.0, 0.0, 0.0], "midpoint": {midpoint}, "sharpness": {sharpness}"#
            ),
        );
        let tf = only("a.vp.json", text.as_bytes());
        // The same joint, as an opacity.
        let wanted = crate::classify::OpacityCurve::new(vec![
            OpacityPoint {
                x: -500.0,
                opacity: 0.0,
                midpoint,
                sharpness,
            },
            OpacityPoint::linear(40.0, 0.7),
        ])
        .unwrap();
        let mut x = -499.5;
        while x < 40.0 {
            let (got, wanted) = (tf.color.eval(x)[0], wanted.eval(x));
            assert!(
                (got - wanted).abs() < 1.0 / 2048.0,
                "midpoint {midpoint}, sharpness {sharpness}, at {x}: {got} for {wanted}"
            );
            x += 1.0;
        }
        let points = tf.color.points().len();
        assert!(points < 100, "{points} points for sharpness {sharpness}");
        if (midpoint, sharpness) == (0.5, 0.0) {
            assert_eq!(points, 3, "no knot on a line");
        }
    }
}

#[test]
fn slicers_presets() {
    let functions = parse("presets.xml", SCENE.as_bytes()).unwrap();
    let [first, second] = functions.as_slice() else {
        panic!("two functions: {functions:?}");
    };
    assert_eq!((&*first.name, &*second.name), ("first", "second"), "names");
    assert_eq!(first.gradient_opacity, None, "1 everywhere");
    assert_eq!(first.lighting, Some(LIGHTING), "lighting");
    assert_eq!(first.shade, Some(true), "lit");
    assert_eq!(
        (second.shade, second.nearest),
        (Some(false), true),
        "second"
    );
    assert_eq!(second.lighting, None, "nothing said of light");
    assert!(second.gradient_opacity.is_some(), "gradient opacity");
    let vp = only("first.vp", VP.as_bytes());
    assert_eq!(
        (&first.color, &first.opacity),
        (&vp.color, &vp.opacity),
        "the curves of the same lines"
    );
}

#[test]
fn paraviews_xml() {
    let functions = parse("maps.xml", MAPS.as_bytes()).unwrap();
    let [rising, rainbow] = functions.as_slice() else {
        panic!("two functions: {functions:?}");
    };
    assert_eq!(
        (&*rising.name, &*rainbow.name),
        ("rising", "rainbow"),
        "names"
    );
    assert_eq!(rising.color.space(), ColorSpace::Lab, "space");
    assert_eq!(rising.opacity.eval(70.5), 0.25, "opacity");
    assert_eq!(
        rainbow.color.eval(0.5),
        [0.0, 1.0, 0.0],
        "sorted; not wrapped"
    );
    assert_eq!(rainbow.opacity.eval(0.5), 0.5, "a constant o is no opacity");
    let alone = r#"<ColorMap space="Wrapped"><Point x="0" r="1" g="0" b="0"/><Point x="2" r="0" g="0" b="1"/></ColorMap>"#;
    let tf = only("old.xml", alone.as_bytes());
    let [r, g, b] = tf.color.eval(1.0);
    assert!(r > 0.999 && g < 0.001 && b > 0.999, "alone; hues wrap");
    assert_eq!(tf.opacity.eval(1.0), 0.5, "no o: a ramp");
}

#[test]
fn imagejs_tables_are_one() {
    let bare = only("fire.lut", &table());
    assert!(bare.relative && bare.name == "fire", "relative, named");
    assert_eq!(bare.extent(), [0.0, 1.0], "0 to 1");
    let unit = |v: f64| v / 255.0;
    assert_eq!(
        bare.eval(unit(51.0)),
        [unit(51.0), unit(204.0), unit(25.0), unit(51.0)],
        "a place, and the ramp"
    );
    for other in [
        with_header(),
        as_text("", false).into_bytes(),
        as_text("Index\tRed\tGreen\tBlue\n", true).into_bytes(),
        as_text("r,g,b\n", false).replace('\t', ",").into_bytes(),
    ] {
        assert_eq!(only("fire.lut", &other), bare, "the same in another shape");
    }
    // Two colours: the second has the upper half.
    let mut few = with_header()[..32].to_vec();
    few[6..8].copy_from_slice(&[0, 2]);
    few.extend([0, 255, 0, 255, 0, 255]);
    let tf = only("few.lut", &few);
    assert_eq!(tf.color.eval(unit(64.0))[0], 0.5, "between");
    assert_eq!(tf.color.eval(unit(200.0))[0], 1.0, "the last holds");
    // Bytes that could all be a text.
    assert!(only("at.lut", &[b'@'; 768]).relative, "a grey one");
}

#[test]
fn every_format_comes_back_from_paraview_json() {
    for (name, bytes) in every_format() {
        let functions = parse(name, &bytes).unwrap();
        let back = parse("back.json", to_paraview(&functions).as_bytes()).unwrap();
        assert_eq!(functions.len(), back.len(), "{name}: as many");
        for (tf, back) in functions.iter().zip(&back) {
            assert_eq!(tf.name, back.name, "{name}");
            assert_eq!(tf.opacity, back.opacity, "{name}: midpoints and all");
            let [lo, hi] = tf.extent();
            for i in -10..=110 {
                let x = lo + (hi - lo) * f64::from(i) / 100.0;
                for (a, b) in tf.eval(x).into_iter().zip(back.eval(x)) {
                    assert!((a - b).abs() <= 1e-12, "{name} at {x}: {a} and {b}");
                }
            }
        }
    }
    let tf = only("my.vp.json", VP_JSON.as_bytes());
    assert_eq!(
        beyond_paraview(&tf),
        ["gradient opacity", "opacity unit", "lighting", "shading"],
        "what is lost is known"
    );
    let grey = grey_ramp(0.0, 1.0, 0.5).unwrap();
    assert!(beyond_paraview(&grey).is_empty(), "nothing");
}

#[test]
fn errors_name_file_place_and_cause() {
    let scene = |from: &str, to: &str| SCENE.replacen(from, to, 1);
    let json = |from: &str, to: &str| VP_JSON.replacen(from, to, 1);
    let vp = |from: &str, to: &str| VP.replacen(from, to, 1);
    let maps = |from: &str, to: &str| MAPS.replacen(from, to, 1);
    for (text, words) in [
        (String::new(), ["nothing", "ParaView"]),
        ("hello".into(), ["\"hello\"", "3D Slicer"]),
        ("<a><b/></a>".into(), ["<a> without", "ColorMap"]),
        ("<a>".into(), ["line 1", "XML"]),
        ("<!DOCTYPE a><ColorMap/>".into(), ["XML", "DTD"]),
        (
            "<ColorMap/>".into(),
            ["line 1, ColorMap", "no control point"],
        ),
        (maps("false", "true"), ["\"rising\"", "categories"]),
        (maps("Lab", "Cube"), ["\"Cube\"", "Diverging"]),
        (maps(" r=\"0.1\"", ""), ["point 1, r", "nothing"]),
        (maps("70.5", "x"), ["point 2, x", "\"x\""]),
        (maps(" o=\"0.25\"", ""), ["\"rising\"", "at every point"]),
        (
            maps("o=\"0.25\"", "o=\"2\""),
            ["\"rising\"", "opacity is 2"],
        ),
        (
            scene("8 -500", "9 -500"),
            ["\"first\", scalarOpacity", "multiple of 2"],
        ),
        (scene("8 -500", "10 -500"), ["10 numbers", "found 8"]),
        (scene("8 -500", "6 -500"), ["6 numbers", "more"]),
        (
            scene("8 -500", "99999999999999 -500"),
            ["multiple of 2", "scalar"],
        ),
        (
            scene("8 -500", "400000000 -500"),
            ["at most 65536", "scalar"],
        ),
        (scene("0.95 0.9", "0.95 x"), ["number 12", "\"x\""]),
        (scene("40 0.1", "-900 0.1"), ["less than", "scalarOpacity"]),
        (scene("shade=\"1\"", "shade=\"yes\""), ["shade", "1 or 0"]),
        (
            scene("ambient=\"0.15\"", "ambient=\"-1\""),
            ["ambient", "-1"],
        ),
        (
            scene("colorTransfer", "colors"),
            ["colorTransfer", "nothing"],
        ),
        (vp("12\n", ""), ["9 lines", "found 8"]),
        (format!("{VP}7\n"), ["9 lines", "more"]),
        (vp("0.3\n", "x\n"), ["line 5, specular", "\"x\""]),
        (vp("8 -500", "7 -500"), ["line 7", "multiple"]),
        (vp("1\n1\n", "1\n2\n"), ["line 2, shade", "1 or 0"]),
        (json("schema-v1.0.0", "schema-v2.0.0"), ["v2", "v1"]),
        (
            json("\"x\": -500.0, \"y\"", "\"y\""),
            ["scalarOpacity, point 1, x", "nothing"],
        ),
        (
            json("[0.7, 0.3, 0.2]", "[0.7, 0.3]"),
            ["rgbTransferFunction, point 2, color", "[0.7,0.3]"],
        ),
        (
            json("\"sharpness\": 0.6", "\"sharpness\": 6"),
            ["point 2, sharpness", "found 6"],
        ),
        (
            json("Distance\": 1.5", "Distance\": 0"),
            ["UnitDistance", "above 0"],
        ),
        (
            json("\"shade\": true", "\"shade\": 1"),
            ["component 1, shade", "true or false"],
        ),
        (
            json("\"components\"", "\"parts\""),
            ["components", "nothing"],
        ),
        (
            json("\"scalarOpacity\":", "\"opacity\":"),
            ["scalarOpacity", "nothing"],
        ),
        (
            as_text("", true).replacen("7\t", "3\t", 1),
            ["line 8", "rises"],
        ),
        (
            as_text("", false).replacen("250\t", "256\t", 1),
            ["line 6", "256"],
        ),
        ("a b c\n1 2\n".into(), ["first row", "2 columns"]),
        (as_text("", false) + "1 1 1\n", ["line 257", "more"]),
        ("a b c\n".into(), ["first row", "0 columns"]),
        ("1 2 3\n".into(), ["256 rows", "found 1 rows"]),
    ] {
        match parse("tf.xyz", text.as_bytes()) {
            Err(e) => {
                let message = e.to_string();
                assert!(
                    message.starts_with("tf.xyz: ") && words.iter().all(|w| message.contains(w)),
                    "{message:?} has {words:?}"
                );
                println!("{message}");
            }
            Ok(_) => panic!("accepted, though {words:?}: {text}"),
        }
    }
    let mut short = with_header();
    short.pop();
    let mut none = with_header();
    none[6] = 0;
    for (bytes, words) in [
        (short, ["768 bytes", "767"]),
        (none, ["byte 6", "2 to 256"]),
        (b"ICOL".to_vec(), ["32 bytes", "4 bytes"]),
        (vec![0; 100], ["no text", "100 bytes"]),
    ] {
        let message = parse("tf.lut", &bytes).unwrap_err().to_string();
        assert!(
            words.iter().all(|w| message.contains(w)),
            "{message:?} has {words:?}"
        );
    }
}
