//! The fast CPU renderer, `--device cpu`: packets of rays over decoded bricks, on all threads.
//!
//! The same pictures as [`crate::reference`], which stays simple and is what this is tested against; here blocks in which
//! nothing can be seen are skipped, and 8 or 16 neighbouring rays go side by side in vector registers. Bricks are decoded
//! when a ray meets them, and kept as far as the memory allowed holds them. It never imports `gpu`, and has no mesh: for
//! a packet of rays the distance to the nearest active block, a byte per block, costs less.

mod bare;
mod bricks;
mod cast;
mod composite;
mod field;
mod gradient;
mod intervals;
mod light;
mod parts;
mod picture;
mod projection;
mod rays;
mod segments;
mod simd;
mod skip;
mod span;
mod surfaces;
mod table;

pub use bare::DenseArray;
pub use picture::{CpuPicture, CpuRenderer, CpuTraffic};
pub use simd::InstructionSet;
