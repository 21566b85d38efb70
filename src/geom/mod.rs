//! Index maths of the brick grid: boxes of voxels, brick identities, levels, Morton order, walks along lines.
//!
//! Pure values: no I/O, no allocation policy, no units other than voxels. Everything above agrees on the constants
//! here; the shaders get them generated from these (`gpu::shader`), never typed twice.
//!
//! Continuous voxel coordinates: voxel `i` spans `[i, i + 1)` and its centre is `i + ½`; so brick = ⌊x / 32⌋ and
//! block = ⌊x / 4⌋ (design.md §3).

mod boxes;
mod brick;
mod walk;

pub use boxes::{Aabb, VoxelBox};
pub use brick::{
    BLOCK_EDGE, BLOCKS_PER_BRICK, BLOCKS_PER_EDGE, BRICK_BORDER, BRICK_EDGE, BrickGrid, BrickId,
    Lod, STORED_EDGE, STORED_VOXELS, morton,
};
pub use walk::CellWalk;
