//! Which bricks are where: states, slots of the atlas, the cache of decoded bricks, and what to load next.
//!
//! The core ([`Pager`]) is a pure function of (state, requests, completions, budget): no clock, no thread, no file, no
//! `wgpu`. The [`Loader`] is the one part with threads; it only decodes what it is told. Keeps invariant 5 of design.md:
//! nothing that the current picture needs is evicted, and the byte budgets hold.

mod cache;
mod core;
mod loader;
mod plan;
mod request;
mod slots;
mod state;
mod wanted;

pub use cache::BrickCache;
pub use core::{Completion, Pager};
pub use loader::Loader;
pub use plan::{PageTablePatch, Plan, Upload};
pub use request::{Priority, Request};
pub use slots::{AtlasShape, SlotId, SlotPool};
pub use state::{BrickState, Event, IllegalMove, transition};
pub use wanted::{ActiveBricks, LevelScan, within_reach};
