//! Brickscope: a renderer for volumes larger than GPU memory.
//!
//! ```text
//! file ─ input ─▶ VoxelSource ─ bricking ─▶ store (.bsk) ─ pager ─▶ UploadPlan ─ render::residency ─▶ 3D atlas + indirection
//!                                             ▲                                                            │
//!                 requests (brick, priority) ─┴── feedback ◀── raycast passes ◀── ray intervals ◀── bounding mesh
//!                                                                    └──▶ composite ─▶ image
//! ```
//! Data goes one way; the only way back is the list of requests. Modules import downward only: ARCHITECTURE.md has the
//! table, `tests/architecture.rs` enforces it. [`engine`] is the façade that commands and bindings stand on.

pub mod bench;
pub mod bricking;
pub mod camera;
pub mod classify;
pub mod clip;
pub mod cli;
pub mod clock;
pub mod cpu;
pub mod engine;
pub mod export;
pub mod geom;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod input;
pub mod outfile;
pub mod pager;
pub mod path;
pub mod proxy;
pub mod reference;
#[cfg(feature = "gpu")]
pub mod render;
pub mod scene;
pub mod store;
pub mod volume;
