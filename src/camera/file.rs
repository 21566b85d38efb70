//! One camera as a JSON file: `{"eye":[x,y,z], "target":[x,y,z], "up":[x,y,z], "fov":30, "projection":"perspective",
//! "near":0}`; `projection` and `near` may be left out.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use thiserror::Error;

use super::fields::{found, short, vec3};
use super::pose::{Camera, CameraError, Projection};

/// A camera file is a few hundred bytes; more than this is some other file.
const MAX_BYTES: u64 = 1 << 20;

const FIELDS: [&str; 6] = ["eye", "target", "up", "fov", "projection", "near"];

/// Why a camera file can't be used.
#[derive(Debug, Error)]
pub enum CameraFileError {
    /// The operating system refused.
    #[error("{}: cannot read the camera: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// Not the JSON of a camera.
    #[error("{}: {place}: expected {expected}, found {found}; a camera is {{\"eye\":[x,y,z], \"target\":[x,y,z], \"up\":[x,y,z], \"fov\":30}}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The field, or the line and column.
        place: String,
        /// What belongs there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// Well-formed, but no picture can be taken with it.
    #[error("{}: {error}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: CameraError,
    },
}

impl Camera {
    /// Reads a camera file and checks that it can be used.
    ///
    /// # Errors
    /// The file can't be read, is not a camera (naming the field), or no picture can be taken with it.
    pub fn read(path: &Path) -> Result<Self, CameraFileError> {
        let io = |error| CameraFileError::Io {
            path: path.to_owned(),
            error,
        };
        let mut text = Vec::new();
        File::open(path)
            .and_then(|f| f.take(MAX_BYTES + 1).read_to_end(&mut text))
            .map_err(io)?;
        Self::from_json(&text, path)
    }

    /// The camera in `text`; `path` is for messages only.
    ///
    /// # Errors
    /// As [`Camera::read`].
    pub fn from_json(text: &[u8], path: &Path) -> Result<Self, CameraFileError> {
        let malformed = |place: &str, expected, found: String| CameraFileError::Malformed {
            path: path.to_owned(),
            place: place.to_owned(),
            expected,
            found,
        };
        if text.len() as u64 > MAX_BYTES {
            let found = format!("more than {MAX_BYTES} bytes");
            return Err(malformed("size", "a file of at most 1 MiB", found));
        }
        let value: Value = serde_json::from_slice(text).map_err(|e| {
            let place = format!("line {}, column {}", e.line(), e.column());
            malformed(&place, "JSON", e.to_string())
        })?;
        let Value::Object(fields) = value else {
            return Err(malformed("top level", "an object", short(&value)));
        };
        if let Some(name) = fields.keys().find(|k| !FIELDS.contains(&k.as_str())) {
            return Err(malformed(
                &short(&Value::from(name.as_str())),
                "only eye, target, up, fov, projection and near",
                "another field".to_owned(),
            ));
        }
        let vector = |name: &str| {
            vec3(&fields, name)
                .ok_or_else(|| malformed(name, "three finite numbers", found(&fields, name)))
        };
        let number = |name: &str| {
            fields
                .get(name)
                .and_then(Value::as_f64)
                .ok_or_else(|| malformed(name, "a finite number", found(&fields, name)))
        };
        let projection = match fields.get("projection").map(Value::as_str) {
            None | Some(Some("perspective")) => Projection::Perspective,
            Some(Some("orthographic")) => Projection::Orthographic,
            Some(_) => {
                return Err(malformed(
                    "projection",
                    "\"perspective\" or \"orthographic\"",
                    found(&fields, "projection"),
                ));
            }
        };
        let camera = Self {
            eye: vector("eye")?,
            target: vector("target")?,
            up: vector("up")?,
            fov_y_degrees: number("fov")?,
            projection,
            near_mm: if fields.contains_key("near") {
                number("near")?
            } else {
                0.0
            },
        };
        match camera.basis() {
            Ok(_) => Ok(camera),
            Err(error) => Err(CameraFileError::Unusable {
                path: path.to_owned(),
                error,
            }),
        }
    }

    /// The camera as the text of a camera file; [`Camera::from_json`] gives the same numbers back.
    pub fn to_json(&self) -> String {
        let value = json!({
            "eye": self.eye.to_array(),
            "target": self.target.to_array(),
            "up": self.up.to_array(),
            "fov": self.fov_y_degrees,
            "projection": match self.projection {
                Projection::Perspective => "perspective",
                Projection::Orthographic => "orthographic",
            },
            "near": self.near_mm,
        });
        format!("{value:#}\n")
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn parse(text: &str) -> Result<Camera, CameraFileError> {
        Camera::from_json(text.as_bytes(), Path::new("c.json"))
    }

    #[test]
    fn what_is_written_reads_back_to_the_bit() {
        let camera = Camera {
            eye: DVec3::new(0.1, -1e-17, -77.7),
            target: DVec3::new(1.0 / 3.0, 2.0, 3.0),
            up: DVec3::Y,
            fov_y_degrees: 29.999_999_999_999_996,
            projection: Projection::Orthographic,
            near_mm: 0.25,
        };
        assert_eq!(parse(&camera.to_json()).unwrap(), camera, "same numbers");
    }

    #[test]
    fn optional_fields_have_defaults() {
        let c = parse(r#"{"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1],"fov":30}"#).unwrap();
        assert_eq!(c.projection, Projection::Perspective, "projection");
        assert_eq!(c.near_mm, 0.0, "near");
    }

    #[test]
    fn errors_name_file_and_field() {
        for (text, word) in [
            (
                r#"{"eye":[0,1],"target":[0,0,0],"up":[0,0,1],"fov":30}"#,
                "eye",
            ),
            (r#"{"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1]}"#, "fov"),
            (
                r#"{"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1],"fov":30,"projection":"x"}"#,
                "projection",
            ),
            (
                r#"{"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1],"fov":30,"near":null}"#,
                "near",
            ),
            (
                r#"{"eye":[0,1,0],"target":[0,0,0],"up":[0,0,1],"fov":30,"ner":1}"#,
                "ner",
            ),
            (
                r#"{"eye":[0,1,0],"target":[0,1,0],"up":[0,0,1],"fov":30}"#,
                "same point",
            ),
            ("[", "line 1"),
            ("3", "top level"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(
                message.contains("c.json") && message.contains(word),
                "{text}: {message:?} names {word}"
            );
        }
    }
}
