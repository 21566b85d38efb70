//! Curves of 3D Slicer as paths: markups files (`.mrk.json`, schema 1.0) with one `Curve` or `ClosedCurve`.
//!
//! The control points become a flight at constant speed that looks ahead; where Slicer draws the curve between them is not
//! said in the file, here it is a centripetal Catmull-Rom curve. Positions in LPS (the default) become RAS+.

use glam::DVec3;
use serde_json::{Map, Value};

use super::curve::{Curve, Ends};
use super::error::{CameraPathError, PathFileError};
use super::file::Place;
use super::flight::Flight;
use super::keys::CameraPath;
use crate::camera::fields::{found, short, vec3};

/// Keys per control point: enough that the view follows the curve between them.
const KEYS_PER_POINT: usize = 8;
/// Most keys that are put between control points.
const MOST_KEYS: usize = 4096;
/// How far ahead the camera looks, in parts of the curve's length.
const AHEAD: f64 = 0.05;

/// The flight along the curve of a markups file. The inner error is of well-formed curves along which nothing can fly.
pub(super) fn read(
    fields: &Map<String, Value>,
    at: &Place<'_>,
) -> Result<Result<CameraPath, CameraPathError>, PathFileError> {
    let markup = match fields.get("markups") {
        Some(Value::Array(list)) if list.len() == 1 => &list[0],
        Some(Value::Array(list)) => {
            let found = format!("{}", list.len());
            return Err(at.malformed("markups", "one markup in the file", found));
        }
        _ => return Err(at.malformed("markups", "a list", found(fields, "markups"))),
    };
    let Value::Object(markup) = markup else {
        return Err(at.malformed("markups[0]", "an object", short(markup)));
    };
    let ends = match markup.get("type").and_then(Value::as_str) {
        Some("Curve") => Ends::Mirrored,
        Some("ClosedCurve") => Ends::Closed,
        _ => {
            let found = found(markup, "type");
            return Err(at.malformed("markups[0].type", "\"Curve\" or \"ClosedCurve\"", found));
        }
    };
    let ras_from_file = match markup.get("coordinateSystem").map(Value::as_str) {
        None | Some(Some("LPS")) => DVec3::new(-1.0, -1.0, 1.0),
        Some(Some("RAS")) => DVec3::ONE,
        Some(_) => {
            let found = found(markup, "coordinateSystem");
            return Err(at.malformed("markups[0].coordinateSystem", "\"LPS\" or \"RAS\"", found));
        }
    };
    // The unit is its name, or code, scheme and meaning of a coding system (UCUM has the same code).
    let unit = match markup.get("coordinateUnits") {
        Some(Value::Array(code)) => code.first(),
        unit => unit,
    };
    if unit.is_some_and(|u| !matches!(u.as_str(), Some("mm" | "millimeter"))) {
        let found = found(markup, "coordinateUnits");
        return Err(at.malformed("markups[0].coordinateUnits", "\"mm\"", found));
    }
    let Some(Value::Array(list)) = markup.get("controlPoints") else {
        let found = found(markup, "controlPoints");
        return Err(at.malformed("markups[0].controlPoints", "a list of points", found));
    };
    let mut points = Vec::with_capacity(list.len());
    for (i, point) in list.iter().enumerate() {
        let place = format!("markups[0].controlPoints[{i}]");
        let Value::Object(point) = point else {
            return Err(at.malformed(place, "an object", short(point)));
        };
        // Points that were not placed have no position of use.
        let status = point.get("positionStatus").and_then(Value::as_str);
        if !matches!(status, None | Some("defined")) {
            continue;
        }
        let position = vec3(point, "position")
            .filter(|p| p.abs().max_element() <= 1e9)
            .ok_or_else(|| {
                let expected = "three finite numbers within ±1e9";
                at.malformed(
                    format!("{place}.position"),
                    expected,
                    found(point, "position"),
                )
            })?;
        points.push(position * ras_from_file);
    }
    Ok(fly(&points, ends))
}

fn fly(points: &[DVec3], ends: Ends) -> Result<CameraPath, CameraPathError> {
    if points.is_empty() {
        return Err(CameraPathError::NoCurve(0));
    }
    let curve = Curve::with_ends(points, ends);
    let (length, knots) = (curve.length_mm(), curve.lengths_mm());
    let parts = (MOST_KEYS / points.len()).clamp(1, KEYS_PER_POINT);
    let mut eyes = vec![points[0]];
    for pair in knots.windows(2) {
        let at = |k: usize| pair[0] + (pair[1] - pair[0]) * k as f64 / parts as f64;
        eyes.extend((1..=parts).map(|k| curve.at(at(k))));
    }
    Flight::default().along(&eyes, &vec![AHEAD * length; eyes.len()])
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn file(markup: &str) -> Result<CameraPath, PathFileError> {
        let schema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#";
        let text = format!(r#"{{"@schema":"{schema}","markups":[{{{markup}}}]}}"#);
        CameraPath::from_json(text.as_bytes(), Path::new("c.mrk.json"))
    }

    const POINTS: &str = r#""controlPoints":[
        {"id":"1","label":"C-1","position":[0,0,0],"orientation":[-1,0,0,0,-1,0,0,0,1],"selected":true,"positionStatus":"defined"},
        {"position":[10,20,30]},
        {"position":[1,1,1],"positionStatus":"undefined"},
        {"position":[40,20,30],"positionStatus":"defined"}]"#;

    #[test]
    fn a_curve_becomes_a_flight() {
        let lps = file(&format!(
            r#""type":"Curve","coordinateSystem":"LPS","coordinateUnits":"mm","locked":false,{POINTS}"#
        ))
        .unwrap();
        let last = lps.keys()[lps.keys().len() - 1].eye;
        assert!(
            last.distance(DVec3::new(-40.0, -20.0, 30.0)) < 1e-9,
            "LPS to RAS: {last}"
        );
        assert_eq!(lps.duration(), 10.0, "ten seconds");
        assert!(
            lps.keys()
                .iter()
                .any(|k| k.eye.distance(DVec3::new(-10.0, -20.0, 30.0)) < 1e-9),
            "control points are met"
        );
        let ras = file(&format!(
            r#""type":"Curve","coordinateSystem":"RAS","coordinateUnits":["mm","UCUM","millimeter"],{POINTS}"#
        ))
        .unwrap();
        let last = ras.keys()[ras.keys().len() - 1].eye;
        assert!(last.distance(DVec3::new(40.0, 20.0, 30.0)) < 1e-9, "{last}");
        let step = lps.length_mm() / 200.0;
        for k in 0..200 {
            let at = |k: i32| lps.camera_at(0.05 * f64::from(k)).eye;
            let moved = at(k).distance(at(k + 1));
            assert!((moved / step - 1.0).abs() < 0.02, "{moved} for {step} mm");
        }
    }

    #[test]
    fn a_closed_curve_comes_back() {
        let path = file(&format!(r#""type":"ClosedCurve",{POINTS}"#)).unwrap();
        let (first, last) = (path.keys()[0].eye, path.keys()[path.keys().len() - 1].eye);
        assert!(first.distance(last) < 1e-9, "{first} and {last}");
    }

    #[test]
    fn what_is_no_curve_is_refused_by_name() {
        for (markup, word) in [
            (format!(r#""type":"Fiducial",{POINTS}"#), "markups[0].type"),
            (POINTS.to_owned(), "markups[0].type"),
            (
                format!(r#""type":"Curve","coordinateUnits":"um",{POINTS}"#),
                "coordinateUnits",
            ),
            (
                format!(r#""type":"Curve","coordinateSystem":"XYZ",{POINTS}"#),
                "coordinateSystem",
            ),
            (r#""type":"Curve""#.to_owned(), "controlPoints"),
            (
                r#""type":"Curve","controlPoints":[]"#.to_owned(),
                "two different points",
            ),
            (
                r#""type":"Curve","controlPoints":[{"position":[1,2,3]}]"#.to_owned(),
                "two different points",
            ),
            (
                r#""type":"Curve","controlPoints":[{"position":[1,2,"a"]}]"#.to_owned(),
                "controlPoints[0].position",
            ),
        ] {
            let message = file(&markup).unwrap_err().to_string();
            assert!(
                message.contains("c.mrk.json") && message.contains(word),
                "{message:?} names {word:?}"
            );
        }
        let text = br#"{"markups":[{},{}]}"#;
        let two = CameraPath::from_json(text, Path::new("c.mrk.json")).unwrap_err();
        assert!(two.to_string().contains("one markup"), "{two}");
    }
}
