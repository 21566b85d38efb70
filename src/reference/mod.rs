//! The reference renderer: the twin of the GPU and CPU casters, written for clarity. It is the oracle of the tests.
//!
//! It never imports `gpu`, has no bounding mesh and no skipping, and reads the *interior* of bricks only: every tap
//! goes to the brick that owns the voxel. So whatever borders, block ranges, occupancy, mesh and atlas do on the GPU,
//! this renderer can't share their mistakes.

mod caster;
mod field;
mod modes;

pub use caster::{ReferencePicture, render};
pub use field::VoxelField;
