//! Which decoded bricks are in host memory, and which of them goes first. The voxels themselves are the engine's to keep.

use std::collections::HashSet;

use lru::LruCache;

use crate::geom::BrickId;

/// The bricks in host memory. All are of one size, so that counting them is counting bytes.
#[derive(Debug)]
pub(super) struct RamCopies {
    /// Of bricks that have a slot: no loss, so they go first.
    of_resident: LruCache<BrickId, ()>,
    /// Of bricks that have no slot and that nobody asks for: evicted ones, and those that came too late.
    spare: LruCache<BrickId, ()>,
    /// Of bricks that this frame asked for and that have no slot yet: not dropped by age.
    waiting: HashSet<BrickId>,
}

impl RamCopies {
    pub(super) fn new() -> Self {
        Self {
            of_resident: LruCache::unbounded(),
            spare: LruCache::unbounded(),
            waiting: HashSet::new(),
        }
    }

    pub(super) fn len(&self) -> u64 {
        (self.of_resident.len() + self.spare.len() + self.waiting.len()) as u64
    }

    pub(super) fn contains(&self, brick: BrickId) -> bool {
        self.of_resident.contains(&brick)
            || self.spare.contains(&brick)
            || self.waiting.contains(&brick)
    }

    /// A brick has been decoded, or asked for while it was here.
    pub(super) fn set_waiting(&mut self, brick: BrickId) {
        self.remove(brick);
        self.waiting.insert(brick);
    }

    /// A brick without a slot is not asked for.
    pub(super) fn set_spare(&mut self, brick: BrickId) {
        self.remove(brick);
        self.spare.push(brick, ());
    }

    /// A brick got a slot; its copy stays.
    pub(super) fn set_resident(&mut self, brick: BrickId) {
        self.remove(brick);
        self.of_resident.push(brick, ());
    }

    /// A brick was sampled from its slot.
    pub(super) fn touch(&mut self, brick: BrickId) {
        self.of_resident.promote(&brick);
    }

    pub(super) fn remove(&mut self, brick: BrickId) {
        if self.of_resident.pop(&brick).is_none() && self.spare.pop(&brick).is_none() {
            self.waiting.remove(&brick);
        }
    }

    /// The oldest copy of a brick that has a slot.
    pub(super) fn pop_of_resident(&mut self) -> Option<BrickId> {
        self.of_resident.pop_lru().map(|(brick, ())| brick)
    }

    /// The oldest copy that nobody asks for.
    pub(super) fn pop_spare(&mut self) -> Option<BrickId> {
        self.spare.pop_lru().map(|(brick, ())| brick)
    }

    /// True when a copy can go that nobody asked for.
    pub(super) fn has_droppable(&self) -> bool {
        !self.of_resident.is_empty() || !self.spare.is_empty()
    }
}
