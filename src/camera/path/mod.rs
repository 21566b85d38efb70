//! Camera paths: key frames `{t, eye, target, up, fov}` and the camera at any time between them.
//!
//! ```text
//! file ─ file / markups ─▶ KeyFrame… ─ keys ─▶ CameraPath ─ camera_at(t) ─▶ Camera
//!        points of a curve ─ flight ─▶ KeyFrame…              curve: where, by arc length; pchip: how far by then;
//!                                                             turn: orientation
//! ```
//! What is interpolated: the eye on a centripetal Catmull-Rom curve, the way along it by a monotone function of time, the
//! picture's axes as unit quaternions, the distance of the target and the field of view monotonically. Position and
//! orientation have continuous velocities, and every key frame is met. Not here: volumes (`path/` finds centre-lines) and
//! pictures.

mod curve;
mod error;
mod file;
mod flight;
mod keys;
mod markups;
mod pchip;
mod turn;

pub use curve::Curve;
pub use error::{CameraPathError, PathFileError};
pub use flight::{FLIGHT_FOV_Y_DEGREES, FLIGHT_SECONDS, Flight};
pub use keys::{CameraPath, KeyFrame};
