//! The passes of a frame, in the order in which they run: bounds, raycast. And one that draws no frame: bare.

mod bare;
mod bounds;
mod raycast;

pub use bare::{BareCaster, DenseLevel};
pub(super) use bounds::{BoundsPass, BoundsTargets, MeshBuffers};
pub(super) use raycast::{CastKind, RaycastPass, RaycastTargets};
