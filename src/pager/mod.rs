//! Which bricks are where: states, slots of the atlas, decoded bricks in host memory, and what to load next.
//!
//! The core ([`Pager`]) is a pure function of (state, requests, completions, budget): no clock, no thread, no file, no
//! voxels, no `wgpu`. The [`Loader`] is the one part with threads; it only decodes what it is told. [`replay`] is for
//! judging the policy of eviction on recorded traces. Keeps invariant 5 of design.md: what the current frame needs is
//! not evicted, pinned bricks never are, and the byte budgets hold.

mod cache;
mod core;
mod loader;
mod plan;
mod policy;
pub mod replay;
mod request;
mod slots;
mod state;
mod wanted;

pub use core::{Completion, Pager, PagerBudget, PagerError, PagerStatistics};
pub use loader::{Loaded, Loader, ReadHook};
pub use plan::{PageTablePatch, Plan, StepLimits, Upload};
pub use request::{FrameRequests, Priority, Request, RequestClass};
pub use slots::{AtlasShape, SlotId, SlotPool};
pub use state::{BrickState, Event, IllegalMove, transition};
pub use wanted::{ActiveBricks, LevelScan, within_reach};
