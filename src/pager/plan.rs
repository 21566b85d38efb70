//! What the pager decided in one step.

use crate::geom::BrickId;

use super::SlotId;

/// A decoded brick that goes into a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Upload {
    /// Which brick.
    pub brick: BrickId,
    /// Where to.
    pub slot: SlotId,
}

/// A change of the page table: the brick is now in a slot, or no longer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageTablePatch {
    /// Which brick.
    pub brick: BrickId,
    /// Its slot; `None`: absent.
    pub slot: Option<SlotId>,
}

/// Bounds of one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepLimits {
    /// Host bytes of the bricks that the step uploads ([`super::PagerBudget::brick_bytes`] each). One brick may always
    /// be uploaded: less would never come to an end.
    pub upload_bytes: u64,
}

impl StepLimits {
    /// No bounds.
    pub const NONE: Self = Self {
        upload_bytes: u64::MAX,
    };
}

/// The work of one step, to be done in the order of the fields.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Bricks to copy into slots; their voxels are in host memory.
    pub upload: Vec<Upload>,
    /// Changes of the page table, evictions before what replaces them.
    pub patches: Vec<PageTablePatch>,
    /// Copies in host memory to drop, those of bricks uploaded by this plan among them.
    pub release: Vec<BrickId>,
    /// Bricks to order from the loader, the most wanted first. Their memory is what was released.
    pub load: Vec<BrickId>,
    /// Bricks that lost their slot.
    pub evicted: u64,
}
