//! The passes of a frame, in the order in which they run: bounds, raycast.

mod bounds;
mod raycast;

pub(super) use bounds::{BoundsPass, BoundsTargets, MeshBuffers};
pub(super) use raycast::{RaycastPass, RaycastTargets};
