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

/// The work of one step, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Bricks to hand to the loader.
    pub load: Vec<BrickId>,
    /// Bricks to copy into slots.
    pub upload: Vec<Upload>,
    /// Changes of the page table, evictions before what replaces them.
    pub patches: Vec<PageTablePatch>,
    /// Bricks that lost their slot.
    pub evicted: u64,
}
