//! ParaView's colour presets: JSON with `Name`, `ColorSpace`, `RGBPoints` (x, r, g, b, …) and `Points` (x, opacity,
//! midpoint, sharpness, …), one object or an array of them.
//!
//! x is taken as physical value, as it stands. What is not known is skipped (`NanColor`, `Annotations`, `Creator`); what
//! would change the picture and can't be done is refused by name. Without `Points` the opacity rises from 0 to 1 over
//! the colours, ParaView's own default.

use serde_json::{Map, Value, json};

use super::error::{Place, TransferFileError, short};
use crate::classify::curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
use crate::classify::transfer::TransferFunction;

/// Rounding errors of other programs outside 0…1 up to this are cut off silently.
const UNIT_SLACK: f64 = 1e-6;

/// The presets in `value`, of the file `top`.
///
/// # Errors
/// It is no preset, its curves are not valid (x decreasing, NaN, no point, values outside 0…1), or it asks for what is not
/// built (indexed colours, logarithmic scale).
pub(super) fn parse(
    value: &Value,
    top: &Place<'_>,
) -> Result<Vec<TransferFunction>, TransferFileError> {
    let objects = match value {
        Value::Array(objects) => objects.as_slice(),
        object => std::slice::from_ref(object),
    };
    if objects.is_empty() {
        return Err(top.malformed("", "a preset", "an empty array", "export a preset"));
    }
    let numbered = objects.iter().enumerate();
    numbered
        .map(|(i, object)| preset(top.at(format!("preset {}", i + 1)), object))
        .collect()
}

/// The functions as the text of a ParaView preset file, from which [`read_transfer_functions`] gives the same curves back;
/// [`beyond_paraview`] tells what is lost.
///
/// [`read_transfer_functions`]: super::read_transfer_functions
pub fn to_paraview(functions: &[TransferFunction]) -> String {
    let objects: Vec<Value> = functions
        .iter()
        .map(|tf| {
            let colors = tf.color.points().iter();
            let opacities = tf.opacity.points().iter();
            let mut object = json!({
                "Name": tf.name,
                "ColorSpace": match tf.color.space() {
                    ColorSpace::Rgb => "RGB",
                    ColorSpace::Hsv | ColorSpace::HsvWrapped => "HSV",
                    ColorSpace::Lab => "Lab",
                    ColorSpace::Diverging => "Diverging",
                    ColorSpace::Step => "Step",
                },
                "RGBPoints": colors
                    .flat_map(|p| [p.x, p.rgb[0], p.rgb[1], p.rgb[2]])
                    .collect::<Vec<_>>(),
                "Points": opacities
                    .flat_map(|p| [p.x, p.opacity, p.midpoint, p.sharpness])
                    .collect::<Vec<_>>(),
            });
            if tf.color.space() == ColorSpace::HsvWrapped {
                object["HSVWrap"] = Value::from(1);
            }
            object
        })
        .collect();
    format!("{:#}\n", Value::from(objects))
}

/// What of the function a ParaView preset can't say, in words.
pub fn beyond_paraview(tf: &TransferFunction) -> Vec<&'static str> {
    [
        ("gradient opacity", tf.gradient_opacity.is_some()),
        ("opacity unit", tf.opacity_unit_mm.is_some()),
        ("lighting", tf.lighting.is_some()),
        ("shading", tf.shade.is_some()),
        ("interpolation", tf.nearest),
    ]
    .into_iter()
    .filter_map(|(what, is_there)| is_there.then_some(what))
    .collect()
}

fn preset(mut place: Place<'_>, value: &Value) -> Result<TransferFunction, TransferFileError> {
    let Value::Object(fields) = value else {
        return Err(place.malformed("", "an object", &short(value), "export the preset again"));
    };
    let name = match fields.get("Name") {
        None => "",
        Some(Value::String(name)) => name.as_str(),
        Some(other) => {
            return Err(place.malformed("Name", "a text", &short(other), "put it in quotes"));
        }
    };
    if !name.is_empty() {
        place.name(name);
    }
    if is_true(fields.get("UseLogScale")) {
        return Err(place.unsupported(
            "a logarithmic scale (UseLogScale)",
            "export the preset with a linear scale",
        ));
    }
    let space = match fields.get("ColorSpace") {
        None => ColorSpace::Rgb,
        Some(value) => {
            let name = value.as_str().unwrap_or_default();
            let unsupported =
                || place.unsupported(&format!("ColorSpace {}", short(value)), SUPPORTED_SPACES);
            color_space(name).ok_or_else(unsupported)?
        }
    };
    // ParaView joins hues without a detour through red unless it is told to.
    let space = match space {
        ColorSpace::Hsv if is_true(fields.get("HSVWrap")) => ColorSpace::HsvWrapped,
        space => space,
    };
    let Some(colors) = quadruples(&place, fields, "RGBPoints", "x, red, green, blue")? else {
        return Err(if fields.contains_key("IndexedColors") {
            place.unsupported(
                "a preset with IndexedColors only (categories)",
                "give it RGBPoints: a colour for each value",
            )
        } else {
            place.malformed(
                "RGBPoints",
                "x, red, green, blue, …",
                "nothing",
                "export the colours with the preset",
            )
        });
    };
    let color = ColorCurve::new(
        colors
            .into_iter()
            .map(|[x, r, g, b]| ColorPoint {
                x,
                rgb: [r, g, b].map(near_unit),
            })
            .collect(),
        space,
    )
    .map_err(|e| place.curve("RGBPoints", e))?;
    let opacity = match quadruples(&place, fields, "Points", "x, opacity, midpoint, sharpness")? {
        Some(points) => points
            .into_iter()
            .map(|[x, opacity, midpoint, sharpness]| OpacityPoint {
                x,
                opacity: near_unit(opacity),
                midpoint: near_unit(midpoint),
                sharpness: near_unit(sharpness),
            })
            .collect(),
        None => ramp_over(&color),
    };
    let opacity = OpacityCurve::new(opacity).map_err(|e| place.curve("Points", e))?;
    Ok(TransferFunction::new(name, color, opacity))
}

/// ParaView's own default: opacity from 0 to 1 over the colours.
pub(super) fn ramp_over(color: &ColorCurve) -> Vec<OpacityPoint> {
    let points = color.points();
    let (lo, hi) = (points[0].x, points[points.len() - 1].x);
    vec![OpacityPoint::linear(lo, 0.0), OpacityPoint::linear(hi, 1.0)]
}

/// What to do about another colour space.
pub(super) const SUPPORTED_SPACES: &str = "use RGB, HSV, Lab, Diverging or Step";

/// The colour space that ParaView calls so.
pub(super) fn color_space(name: &str) -> Option<ColorSpace> {
    match name.to_ascii_lowercase().as_str() {
        "rgb" => Some(ColorSpace::Rgb),
        "hsv" => Some(ColorSpace::Hsv),
        "lab" | "cielab" => Some(ColorSpace::Lab),
        "diverging" => Some(ColorSpace::Diverging),
        "step" => Some(ColorSpace::Step),
        _ => None,
    }
}

/// Numbers in fours; `None` when the field is missing, null or empty.
fn quadruples(
    place: &Place<'_>,
    fields: &Map<String, Value>,
    field: &str,
    names: &str,
) -> Result<Option<Vec<[f64; 4]>>, TransferFileError> {
    let expected = format!("numbers in groups of four ({names})");
    let remedy = "export the preset again";
    let values = match fields.get(field) {
        None | Some(Value::Null) => return Ok(None),
        Some(Value::Array(values)) if values.is_empty() => return Ok(None),
        Some(Value::Array(values)) => values,
        Some(other) => return Err(place.malformed(field, &expected, &short(other), remedy)),
    };
    if values.len() % 4 != 0 {
        let found = format!("{} numbers", values.len());
        return Err(place.malformed(field, &expected, &found, remedy));
    }
    if values.len() / 4 > MAX_POINTS {
        return Err(place.curve(field, CurveError::TooMany(values.len() / 4)));
    }
    let number = |(i, value): (usize, &Value)| {
        value.as_f64().ok_or_else(|| {
            let field = format!("{field}, number {}", i + 1);
            place.malformed(&field, "a finite number", &short(value), remedy)
        })
    };
    let numbers = values
        .iter()
        .enumerate()
        .map(number)
        .collect::<Result<Vec<f64>, _>>()?;
    let (fours, _) = numbers.as_chunks::<4>();
    Ok(Some(fours.to_vec()))
}

/// `v`, or the end of 0…1 that it misses by a rounding error.
pub(super) fn near_unit(v: f64) -> f64 {
    if (-UNIT_SLACK..=1.0 + UNIT_SLACK).contains(&v) {
        v.clamp(0.0, 1.0)
    } else {
        v
    }
}

fn is_true(value: Option<&Value>) -> bool {
    match value {
        Some(Value::Bool(b)) => *b,
        Some(Value::Number(n)) => n.as_f64() != Some(0.0),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::{Preset, parse_transfer_functions};
    use std::path::Path;

    fn parse(text: &str) -> Result<Vec<TransferFunction>, TransferFileError> {
        parse_transfer_functions(text.as_bytes(), Path::new("tf.json"))
    }

    #[test]
    fn a_preset_as_paraview_writes_it() {
        let tf = parse(
            r#"[{"Name": "bones", "ColorSpace": "RGB", "Creator": "x", "NanColor": [1, 0, 0],
                "RGBPoints": [-1000, 0, 0, 0, 1000, 1.0000000001, 1, 0.5],
                "Points": [-1000, 0, 0.5, 0, 200, 0, 0.25, 0, 1000, 0.9, 0.5, 0]}]"#,
        )
        .unwrap()
        .remove(0);
        assert_eq!(tf.name, "bones", "name");
        assert_eq!(tf.eval(0.0), [0.5, 0.5, 0.25, 0.0], "colour in the middle");
        assert!((tf.eval(400.0)[3] - 0.45).abs() < 1e-12, "midpoint 0.25");
    }

    #[test]
    fn colours_alone_get_a_ramp() {
        let tf = parse(r#"{"RGBPoints": [0,0,0,0, 10,1,1,1]}"#)
            .unwrap()
            .remove(0);
        assert_eq!(tf.eval(5.0), [0.5; 4], "ParaView's default opacity");
    }

    #[test]
    fn hues_go_round_only_when_told_to() {
        let middle = |wrap: &str| {
            let text = format!(r#"{{"ColorSpace": "HSV"{wrap}, "RGBPoints": [0,0,0,1, 1,1,0,0]}}"#);
            let tf = parse(&text).unwrap().remove(0);
            assert_eq!(
                parse(&to_paraview(std::slice::from_ref(&tf))).unwrap()[0],
                tf,
                "reads back"
            );
            tf.color.eval(0.5)
        };
        let bytes = |wrap: &str| middle(wrap).map(|c| (255.0 * c).round());
        assert_eq!(bytes(""), [0.0, 255.0, 0.0], "a rainbow");
        assert_eq!(bytes(r#", "HSVWrap": 1"#), [255.0, 0.0, 255.0], "magenta");
    }

    #[test]
    fn every_preset_reads_back_as_written() {
        let functions: Vec<_> = Preset::ALL
            .iter()
            .map(|p| p.instantiate([-100.1, 300.7], 0.5).unwrap())
            .collect();
        assert_eq!(
            parse(&to_paraview(&functions)).unwrap(),
            functions,
            "the same"
        );
    }

    #[test]
    fn errors_name_file_place_and_cause() {
        let indexed =
            r#"[{"RGBPoints": [0,0,0,0, 1,1,1,1]}, {"Name": "cat", "IndexedColors": [1,0,0]}]"#;
        for (text, words) in [
            ("[", ["line 1", "JSON"]),
            ("[]", ["top level", "empty"]),
            ("[3]", ["preset 1", "object"]),
            (indexed, ["preset 2 \"cat\"", "IndexedColors"]),
            (r#"{"Name": "n"}"#, ["RGBPoints", "nothing"]),
            (r#"{"RGBPoints": [0,0,0]}"#, ["RGBPoints", "3 numbers"]),
            (r#"{"RGBPoints": [0,0,0,null]}"#, ["number 4", "null"]),
            (
                r#"{"RGBPoints": [0,0,0,0, -1,0,0,0]}"#,
                ["RGBPoints", "less than"],
            ),
            (r#"{"RGBPoints": [0,0,255,0]}"#, ["green", "255"]),
            (
                r#"{"RGBPoints": [0,0,0,0], "Points": [0,2,0.5,0]}"#,
                ["Points", "opacity"],
            ),
            (
                r#"{"RGBPoints": [0,0,0,0], "ColorSpace": "Lab/CIEDE2000"}"#,
                ["CIEDE2000", "Lab"],
            ),
            (
                r#"{"RGBPoints": [0,0,0,0], "UseLogScale": 1}"#,
                ["logarithmic", "linear"],
            ),
            (r#"{"RGBPoints": [NaN,0,0,0]}"#, ["line 1", "JSON"]),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(
                message.starts_with("tf.json: ") && words.iter().all(|w| message.contains(w)),
                "{text}: {message:?} has {words:?}"
            );
        }
    }
}
