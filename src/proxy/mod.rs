//! The bounding mesh: the faces between blocks that can show something and blocks that can't (design.md §6).
//!
//! Plain vertices and indices, in an order that depends on the input alone; no draw calls, no camera, no decision of
//! which bricks belong to the working set. The mesh is a bound for ray intervals, never the truth: samples are placed
//! and skipped without it (design.md §2, invariants 1 and 4).
//!
//! Space: corners of 4³ blocks of one level, in whole blocks; voxel corner = 4 · block corner. Triangles are
//! counter-clockwise seen from outside in this right-handed space; where the affine to world mirrors (negative
//! determinant), they are clockwise there.

mod active;
mod faces;
mod mesh;

pub use active::{ActiveBlocks, ProxyError};
pub use mesh::{Direction, Granularity, Mesh, bounding_mesh};
