//! Bricking: one pass over a volume makes a brick store with all its levels, at bounded memory.
//!
//! ```text
//! VoxelSource ─ a few slices ─▶ convert ─▶ slab of level 0 ─ encode ─▶ StoreWriter
//!                                             │ downsample
//!                                             ▼
//!                                          slab of level 1 ─ encode ─▶ …
//! ```
//! Each level keeps a rolling slab of 34 slices (a layer of bricks and its borders). What is here: [`plan`] (levels and
//! memory), [`convert`] (source type to stored type), [`downsample`] (the box filter), [`border`] (cutting bricks out of
//! slabs), [`stats`] (histogram, range, hash), [`pipeline`], `checkpoint` and `resume` (going on with a killed run),
//! [`progress`], and [`mod@verify`], which checks a store against the same formulas. What is not: file formats (`input`, `store`) and anything of the GPU.

pub mod border;
mod checkpoint;
pub mod convert;
pub mod downsample;
mod encode;
mod error;
pub mod pipeline;
pub mod plan;
pub mod progress;
mod resume;
mod slab;
pub mod stats;
pub mod verify;

pub use convert::{FiniteRange, finite_range};
pub use error::BrickError;
pub use pipeline::{BrickOptions, BrickingReport, brick};
pub use progress::{NoProgress, Progress};
pub use verify::{VerifyReport, verify};
