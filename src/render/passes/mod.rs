//! The passes of a frame, in the order in which they run: bounds, leap, raycast. And one that draws no frame: bare.

mod bare;
mod bounds;
mod leap;
mod raycast;

pub use bare::{BareCaster, DenseLevel};
pub(super) use bounds::{BoundsPass, BoundsTargets, MeshBuffers};
pub use leap::LeapFault;
pub(super) use leap::{LeapPass, LeapTargets};
pub(super) use raycast::{RaycastPass, RaycastTargets};
