//! The graphics device and what every pass needs of it: context, shaders, shared structs, staging, read-back, timing.
//!
//! Knows nothing of volumes, bricks or rays; those are `render`'s. Only `gpu`, `render`, `engine` and `viewer` may name
//! `wgpu` (tests/architecture.rs).

mod context;
mod error;
pub mod layout;
mod readback;
pub mod shader;
mod staging;
mod timing;

pub use context::{AdapterChoice, Caps, GpuContext};
pub use error::GpuError;
pub use readback::read_buffers;
pub use staging::Staging;
pub use timing::PassTimer;
