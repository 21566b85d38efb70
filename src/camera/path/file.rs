//! Path files: `{"keys":[{"t":0, "eye":[x,y,z], "target":[x,y,z], "up":[x,y,z], "fov":30}, …], "projection":"perspective",
//! "near":0}`, or only the list; `projection` and `near` may be left out. Curves of 3D Slicer are read too: [`super::markups`].

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::error::PathFileError;
use super::keys::{CameraPath, KeyFrame};
use super::markups;
use crate::camera::fields::{found, short, vec3};
use crate::camera::pose::Projection;

/// A key frame takes some 200 bytes; more than this is some other file.
const MAX_BYTES: u64 = 8 << 20;

const FIELDS: [&str; 3] = ["keys", "projection", "near"];
const KEY_FIELDS: [&str; 5] = ["t", "eye", "target", "up", "fov"];

/// Makes [`PathFileError::Malformed`] for one file.
pub(super) struct Place<'a>(&'a Path);

impl Place<'_> {
    pub(super) fn malformed(
        &self,
        place: impl Into<String>,
        expected: &'static str,
        found: impl Into<String>,
    ) -> PathFileError {
        PathFileError::Malformed {
            path: self.0.to_owned(),
            place: place.into(),
            expected,
            found: found.into(),
        }
    }
}

impl CameraPath {
    /// Reads a path file, or a curve of 3D Slicer (`.mrk.json`): which of them is told by content.
    ///
    /// # Errors
    /// The file can't be read, is no path (naming field and key), or no flight can be made of it.
    pub fn read(path: &Path) -> Result<Self, PathFileError> {
        let mut text = Vec::new();
        File::open(path)
            .and_then(|f| f.take(MAX_BYTES + 1).read_to_end(&mut text))
            .map_err(|error| PathFileError::Io {
                path: path.to_owned(),
                error,
            })?;
        Self::from_json(&text, path)
    }

    /// The path in `text`; `path` is for messages only.
    ///
    /// # Errors
    /// As [`CameraPath::read`].
    pub fn from_json(text: &[u8], path: &Path) -> Result<Self, PathFileError> {
        let at = Place(path);
        if text.len() as u64 > MAX_BYTES {
            let found = format!("more than {MAX_BYTES} bytes");
            return Err(at.malformed("size", "a file of at most 8 MiB", found));
        }
        let value: Value = serde_json::from_slice(text).map_err(|e| {
            let place = format!("line {}, column {}", e.line(), e.column());
            at.malformed(place, "JSON", e.to_string())
        })?;
        let made = match &value {
            Value::Array(keys) => Self::new(read_keys(keys, &at)?, Projection::default(), 0.0),
            Value::Object(fields) if fields.contains_key("markups") => markups::read(fields, &at)?,
            Value::Object(fields) => {
                known(fields, &FIELDS, "", "only keys, projection and near", &at)?;
                let Some(Value::Array(keys)) = fields.get("keys") else {
                    return Err(at.malformed(
                        "keys",
                        "a list of key frames",
                        found(fields, "keys"),
                    ));
                };
                let keys = read_keys(keys, &at)?;
                let near = match fields.get("near") {
                    None => 0.0,
                    Some(v) => v
                        .as_f64()
                        .filter(|&n| n >= 0.0)
                        .ok_or_else(|| at.malformed("near", "a number of at least 0", short(v)))?,
                };
                Self::new(keys, projection(fields, &at)?, near)
            }
            _ => return Err(at.malformed("top level", "an object or a list", short(&value))),
        };
        made.map_err(|error| PathFileError::Unusable {
            path: path.to_owned(),
            error,
        })
    }

    /// The path as the text of a path file, one key a line; [`CameraPath::from_json`] gives the same numbers back.
    pub fn to_json(&self) -> String {
        let keys: Vec<String> = self
            .keys()
            .iter()
            .map(|k| {
                let key = json!({
                    "t": k.t,
                    "eye": k.eye.to_array(),
                    "target": k.target.to_array(),
                    "up": k.up.to_array(),
                    "fov": k.fov_y_degrees,
                });
                format!("    {key}")
            })
            .collect();
        let projection = match self.projection() {
            Projection::Perspective => "perspective",
            Projection::Orthographic => "orthographic",
        };
        format!(
            "{{\n  \"projection\": \"{projection}\",\n  \"near\": {},\n  \"keys\": [\n{}\n  ]\n}}\n",
            json!(self.near_mm()),
            keys.join(",\n")
        )
    }
}

/// Refuses a field that is not among `names`.
fn known(
    fields: &Map<String, Value>,
    names: &[&str],
    place: &str,
    expected: &'static str,
    at: &Place<'_>,
) -> Result<(), PathFileError> {
    match fields.keys().find(|k| !names.contains(&k.as_str())) {
        None => Ok(()),
        Some(name) => {
            let name = short(&Value::from(name.as_str()));
            Err(at.malformed(format!("{place}{name}"), expected, "another field"))
        }
    }
}

fn projection(fields: &Map<String, Value>, at: &Place<'_>) -> Result<Projection, PathFileError> {
    match fields.get("projection").map(Value::as_str) {
        None | Some(Some("perspective")) => Ok(Projection::Perspective),
        Some(Some("orthographic")) => Ok(Projection::Orthographic),
        Some(_) => Err(at.malformed(
            "projection",
            "\"perspective\" or \"orthographic\"",
            found(fields, "projection"),
        )),
    }
}

fn read_keys(keys: &[Value], at: &Place<'_>) -> Result<Vec<KeyFrame>, PathFileError> {
    keys.iter()
        .enumerate()
        .map(|(i, key)| {
            let place = |field: &str| format!("keys[{i}].{field}");
            let Value::Object(fields) = key else {
                return Err(at.malformed(format!("keys[{i}]"), "an object", short(key)));
            };
            let expected = "only t, eye, target, up and fov";
            known(fields, &KEY_FIELDS, &place(""), expected, at)?;
            let number = |name: &str| {
                let value = fields.get(name).and_then(Value::as_f64);
                value.ok_or_else(|| {
                    at.malformed(place(name), "a finite number", found(fields, name))
                })
            };
            let vector = |name: &str| {
                vec3(fields, name).ok_or_else(|| {
                    at.malformed(place(name), "three finite numbers", found(fields, name))
                })
            };
            Ok(KeyFrame {
                t: number("t")?,
                eye: vector("eye")?,
                target: vector("target")?,
                up: vector("up")?,
                fov_y_degrees: number("fov")?,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn parse(text: &str) -> Result<CameraPath, PathFileError> {
        CameraPath::from_json(text.as_bytes(), Path::new("p.json"))
    }

    const KEY: &str = r#"{"t":0,"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1],"fov":30}"#;

    #[test]
    fn what_is_written_reads_back_to_the_bit() {
        let key = |t: f64| KeyFrame {
            t,
            eye: DVec3::new(0.1 * t, -1e-17, -77.7),
            target: DVec3::new(1.0 / 3.0, 2.0, t),
            up: DVec3::new(0.1, 0.9, 0.3),
            fov_y_degrees: 29.999_999_999_999_996,
        };
        let keys = vec![key(-0.3), key(1.0 / 7.0), key(1e3)];
        let path = CameraPath::new(keys, Projection::Orthographic, 0.25).unwrap();
        assert_eq!(parse(&path.to_json()).unwrap(), path, "the same path");
    }

    #[test]
    fn a_list_is_enough() {
        let path = parse(&format!("[{KEY}]")).unwrap();
        assert_eq!(path.projection(), Projection::Perspective, "projection");
        assert_eq!((path.near_mm(), path.duration()), (0.0, 0.0), "near, time");
        assert_eq!(path.keys()[0].eye, DVec3::Y, "the key's eye");
    }

    #[test]
    fn errors_name_file_key_and_field() {
        let second = |key: &str| format!(r#"{{"keys":[{KEY},{key}]}}"#);
        let changed =
            |from: &str, to: &str| second(&KEY.replace("\"t\":0", "\"t\":1").replace(from, to));
        for (text, word) in [
            (second("7"), "keys[1]: expected an object"),
            (changed("[0,1,0]", "[0,1]"), "keys[1].eye"),
            (changed("\"fov\":30", "\"fov\":null"), "keys[1].fov"),
            (
                changed(",\"fov\":30", ""),
                "keys[1].fov: expected a finite number, found nothing",
            ),
            (
                changed("\"fov\":30", "\"fov\":200"),
                "keys[1]: camera field of view is 200",
            ),
            (changed("\"fov\"", "\"tf\":1,\"fov\""), "keys[1].\"tf\""),
            (changed("[0,0,1]", "[0,2,0]"), "keys[1]: camera up"),
            (second(KEY), "keys[1].t"),
            (changed("[0,1,0]", "[0,1e300,0]"), "keys[1].eye"),
            (r#"{"keys":[]}"#.to_owned(), "at least one key"),
            ("{}".to_owned(), "keys: expected a list"),
            (format!(r#"{{"keys":[{KEY}],"nare":1}}"#), "\"nare\""),
            (format!(r#"{{"keys":[{KEY}],"near":-1}}"#), "near"),
            (
                format!(r#"{{"keys":[{KEY}],"projection":"x"}}"#),
                "projection",
            ),
            ("[".to_owned(), "line 1"),
            ("3".to_owned(), "top level"),
            (" ".repeat(9 << 20), "size"),
        ] {
            let message = parse(&text).unwrap_err().to_string();
            assert!(
                message.contains("p.json") && message.contains(word),
                "{message:?} names {word:?}"
            );
        }
    }

    #[test]
    fn a_path_cut_anywhere_is_refused() {
        let text = format!(r#"{{"keys":[{KEY}]}}"#);
        for end in 0..text.len() {
            assert!(parse(&text[..end]).is_err(), "cut at byte {end}");
        }
    }
}
