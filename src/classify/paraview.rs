//! ParaView's colour presets: JSON with `Name`, `ColorSpace`, `RGBPoints` (x, r, g, b, …) and `Points` (x, opacity,
//! midpoint, sharpness, …), one object or an array of them.
//!
//! x is taken as physical value, as it stands. What is not known is skipped (`NanColor`, `Annotations`, `Creator`); what
//! would change the picture and can't be done is refused by name. Without `Points` the opacity rises from 0 to 1 over
//! the colours, ParaView's own default.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use thiserror::Error;

use super::curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
use super::transfer::TransferFunction;

/// Largest preset file that is read; ParaView's own collection is below 1 MiB.
const MAX_BYTES: u64 = 32 << 20;
/// Rounding errors of other programs outside 0…1 up to this are cut off silently.
const UNIT_SLACK: f64 = 1e-6;

/// Why a transfer-function file can't be used.
#[derive(Debug, Error)]
pub enum TransferFileError {
    /// The operating system refused.
    #[error("{}: cannot read the transfer function: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// Not what the format demands.
    #[error("{}: {place}: expected {expected}, found {found}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it: line and column, or object and field.
        place: String,
        /// What belongs there.
        expected: String,
        /// What is there.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A valid preset with something that is not built.
    #[error("{}: {place}: {what} is not supported; {supported}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Which object.
        place: String,
        /// What it has.
        what: String,
        /// What to do.
        supported: &'static str,
    },
}

/// Reads the presets of a ParaView JSON file; at least one.
///
/// # Errors
/// The file can't be read or is larger than 32 MiB, is not such JSON, its curves are not valid (x decreasing, NaN, no
/// point, values outside 0…1), or it asks for what is not built (indexed colours, logarithmic scale).
pub fn read_paraview(path: &Path) -> Result<Vec<TransferFunction>, TransferFileError> {
    let mut text = Vec::new();
    File::open(path)
        .and_then(|f| f.take(MAX_BYTES + 1).read_to_end(&mut text))
        .map_err(|error| TransferFileError::Io {
            path: path.to_owned(),
            error,
        })?;
    parse_paraview(&text, path)
}

/// The presets in `text`; `path` is for messages only.
///
/// # Errors
/// As [`read_paraview`].
pub fn parse_paraview(
    text: &[u8],
    path: &Path,
) -> Result<Vec<TransferFunction>, TransferFileError> {
    let top = Reader {
        path,
        place: "top level".to_owned(),
    };
    if text.len() as u64 > MAX_BYTES {
        return Err(top.malformed("", "at most 32 MiB", "more", "is this a preset file?"));
    }
    let value: Value = serde_json::from_slice(text).map_err(|e| {
        let place = format!("line {}, column {}", e.line(), e.column());
        let reader = Reader { path, place };
        reader.malformed("", "JSON", &e.to_string(), "export the preset again")
    })?;
    let objects = match value {
        Value::Array(objects) => objects,
        object => vec![object],
    };
    if objects.is_empty() {
        return Err(top.malformed("", "a preset", "an empty array", "export a preset"));
    }
    let mut functions = Vec::new();
    for (i, object) in objects.iter().enumerate() {
        let reader = Reader {
            path,
            place: format!("preset {}", i + 1),
        };
        functions.push(reader.preset(object)?);
    }
    Ok(functions)
}

/// The functions as the text of a ParaView preset file; [`parse_paraview`] gives the same back.
pub fn to_paraview(functions: &[TransferFunction]) -> String {
    let objects: Vec<Value> = functions
        .iter()
        .map(|tf| {
            let colors = tf.color.points().iter();
            let opacities = tf.opacity.points().iter();
            json!({
                "Name": tf.name,
                "ColorSpace": match tf.color.space() {
                    ColorSpace::Rgb => "RGB",
                    ColorSpace::Hsv => "HSV",
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
            })
        })
        .collect();
    format!("{:#}\n", Value::from(objects))
}

/// Reads one preset and words its errors.
struct Reader<'a> {
    path: &'a Path,
    place: String,
}

impl Reader<'_> {
    fn preset(mut self, value: &Value) -> Result<TransferFunction, TransferFileError> {
        let Value::Object(fields) = value else {
            return Err(self.malformed("", "an object", &short(value), "export the preset again"));
        };
        let name = match fields.get("Name") {
            None => "",
            Some(Value::String(name)) => name.as_str(),
            Some(other) => {
                return Err(self.malformed("Name", "a text", &short(other), "put it in quotes"));
            }
        };
        if !name.is_empty() {
            self.place = format!("{} {}", self.place, short(&Value::from(name)));
        }
        if is_true(fields.get("UseLogScale")) {
            return Err(self.unsupported(
                "a logarithmic scale (UseLogScale)",
                "export the preset with a linear scale",
            ));
        }
        let space = self.color_space(fields)?;
        let Some(colors) = self.quadruples(fields, "RGBPoints", "x, red, green, blue")? else {
            return Err(if fields.contains_key("IndexedColors") {
                self.unsupported(
                    "a preset with IndexedColors only (categories)",
                    "give it RGBPoints: a colour for each value",
                )
            } else {
                self.malformed(
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
        .map_err(|e| self.curve("RGBPoints", e))?;
        let opacity = match self.quadruples(fields, "Points", "x, opacity, midpoint, sharpness")? {
            Some(points) => points
                .into_iter()
                .map(|[x, opacity, midpoint, sharpness]| OpacityPoint {
                    x,
                    opacity: near_unit(opacity),
                    midpoint: near_unit(midpoint),
                    sharpness: near_unit(sharpness),
                })
                .collect(),
            None => {
                let points = color.points();
                let (lo, hi) = (points[0].x, points[points.len() - 1].x);
                vec![OpacityPoint::linear(lo, 0.0), OpacityPoint::linear(hi, 1.0)]
            }
        };
        let opacity = OpacityCurve::new(opacity).map_err(|e| self.curve("Points", e))?;
        Ok(TransferFunction {
            name: name.to_owned(),
            color,
            opacity,
        })
    }

    fn color_space(&self, fields: &Map<String, Value>) -> Result<ColorSpace, TransferFileError> {
        let Some(value) = fields.get("ColorSpace") else {
            return Ok(ColorSpace::Rgb);
        };
        let name = value.as_str().unwrap_or_default();
        match name.to_ascii_lowercase().as_str() {
            "rgb" => Ok(ColorSpace::Rgb),
            "hsv" => Ok(ColorSpace::Hsv),
            "lab" | "cielab" => Ok(ColorSpace::Lab),
            "diverging" => Ok(ColorSpace::Diverging),
            "step" => Ok(ColorSpace::Step),
            _ => Err(self.unsupported(
                &format!("ColorSpace {}", short(value)),
                "use RGB, HSV, Lab, Diverging or Step",
            )),
        }
    }

    /// Numbers in fours; `None` when the field is missing, null or empty.
    fn quadruples(
        &self,
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
            Some(other) => return Err(self.malformed(field, &expected, &short(other), remedy)),
        };
        if values.len() % 4 != 0 {
            let found = format!("{} numbers", values.len());
            return Err(self.malformed(field, &expected, &found, remedy));
        }
        if values.len() / 4 > MAX_POINTS {
            return Err(self.curve(field, CurveError::TooMany(values.len() / 4)));
        }
        let number = |(i, value): (usize, &Value)| {
            value.as_f64().ok_or_else(|| {
                let place = format!("{field}, number {}", i + 1);
                self.malformed(&place, "a finite number", &short(value), remedy)
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

    fn curve(&self, field: &str, error: CurveError) -> TransferFileError {
        self.malformed(field, "a curve", &error.to_string(), "correct the points")
    }

    fn malformed(
        &self,
        field: &str,
        expected: &str,
        found: &str,
        remedy: &'static str,
    ) -> TransferFileError {
        let separator = if field.is_empty() { "" } else { ", " };
        TransferFileError::Malformed {
            path: self.path.to_owned(),
            place: format!("{}{separator}{field}", self.place),
            expected: expected.to_owned(),
            found: found.to_owned(),
            remedy,
        }
    }

    fn unsupported(&self, what: &str, supported: &'static str) -> TransferFileError {
        TransferFileError::Unsupported {
            path: self.path.to_owned(),
            place: self.place.clone(),
            what: what.to_owned(),
            supported,
        }
    }
}

fn near_unit(v: f64) -> f64 {
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

/// The start of a JSON value, for messages.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::Preset;

    fn parse(text: &str) -> Result<Vec<TransferFunction>, TransferFileError> {
        parse_paraview(text.as_bytes(), Path::new("tf.json"))
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

    #[test]
    fn damaged_files_never_panic() {
        let good = to_paraview(&[Preset::find("ct-bone")
            .unwrap()
            .instantiate([0.0, 1.0], 0.5)
            .unwrap()]);
        for end in 0..good.len() {
            let _ = parse(&good[..end]);
        }
        for at in 0..good.len() {
            let mut bytes = good.clone().into_bytes();
            for byte in [b'-', b'[', b'9', 0xff] {
                bytes[at] = byte;
                let _ = parse_paraview(&bytes, Path::new("tf.json"));
            }
        }
    }
}
