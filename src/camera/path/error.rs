//! Why key frames are no path, and why a file is none.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::camera::pose::CameraError;

/// Why key frames make no path. Keys are counted from 0, as `keys[0]` in a file.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CameraPathError {
    /// There is nothing.
    #[error("keys: expected at least one key frame, found none")]
    NoKeys,
    /// Times must rise.
    #[error(
        "keys[{key}].t: expected a time at least 1e-6 s after the one before, {before} s, and within ±1e9 s, found {found}"
    )]
    Time {
        /// The key.
        key: usize,
        /// The time of the key before, seconds; minus infinity for the first.
        before: f64,
        /// Its time, seconds.
        found: f64,
    },
    /// A position from which nothing can be computed any more.
    #[error("keys[{key}].{field}: expected coordinates within ±1e9 mm, found {found}")]
    TooFar {
        /// The key.
        key: usize,
        /// `eye` or `target`.
        field: &'static str,
        /// What is there.
        found: glam::DVec3,
    },
    /// No picture can be taken with it.
    #[error("keys[{key}]: {error}")]
    Unusable {
        /// The key.
        key: usize,
        /// What is wrong with it.
        error: CameraError,
    },
    /// A path can't take no time, or for ever.
    #[error("seconds: expected more than 1e-6 and at most 1e9, found {0}")]
    Duration(f64),
    /// A curve along which nothing can fly.
    #[error("expected a curve of at least two different points, found {0}")]
    NoCurve(usize),
}

/// Why a file is no path.
#[derive(Debug, Error)]
pub enum PathFileError {
    /// The operating system refused.
    #[error("{}: cannot read the camera path: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// Not the JSON of a path.
    #[error("{}: {place}: expected {expected}, found {found}; a camera path is {{\"keys\":[{{\"t\":0, \"eye\":[x,y,z], \"target\":[x,y,z], \"up\":[x,y,z], \"fov\":30}}, …]}}, or a 3D Slicer curve (.mrk.json)", path.display())]
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
    /// Well-formed, but no path.
    #[error("{}: {error}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: CameraPathError,
    },
}
