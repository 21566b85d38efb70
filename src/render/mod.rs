//! The GPU renderer: what is resident, the passes of a frame, and pictures tile by tile.
//!
//! No windows, no command line, no disk: bricks come decoded, in an upload plan. Sampling, classification and light are
//! in `shaders/`; this module gives them their data. Keeps invariants 1 and 4 of design.md together with `scene` and
//! `pager`: what must be equal to the bit is switched by the host's orders in one pipeline.

mod activity;
pub mod bindings;
mod extremes;
mod feedback;
mod frame;
mod passes;
mod quadtree;
mod renderer;
mod residency;
mod several;
mod spread;
mod tiling;

pub use activity::{Activity, GroupBounds};
pub use extremes::ExtremeCodes;
pub use feedback::{Feedback, MissedBrick, PendingFeedback};
pub use frame::{FrameInputs, Tile};
pub use passes::{BareCaster, DenseLevel, LeapFault};
pub use renderer::{Cast, Renderer};
pub use residency::{AtlasPlan, Residency, SampleFilter};
pub use tiling::{PixelList, TILE_EDGE};
