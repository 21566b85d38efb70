//! Where the picture is taken from: an eye, a target, a projection, all in world millimetres (RAS+); and paths along which
//! it flies.
//!
//! Pure geometry in f64: no input events, no volume, no GPU. A [`Camera`] is what is typed or read; [`Camera::view`]
//! checks it and yields the orthonormal [`View`] from which rays are made. Nothing here depends on samples or bricks,
//! so sample positions stay a function of ray and step alone (design.md §2, invariant 1). A [`CameraPath`] is key frames and
//! the smooth flight through them.

mod fields;
mod file;
mod orbit;
mod path;
mod pose;
mod view;

pub use file::CameraFileError;
pub use orbit::BoundingSphere;
pub use path::{
    CameraPath, CameraPathError, Curve, FLIGHT_FOV_Y_DEGREES, FLIGHT_SECONDS, Flight, KeyFrame,
    PathFileError,
};
pub use pose::{Basis, Camera, CameraError, DEFAULT_FOV_Y_DEGREES, Projection};
pub use view::{Ray, View};
