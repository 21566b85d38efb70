//! The slots of the atlas: how many fit, and who is in which.

use std::collections::BTreeMap;

use glam::UVec3;

use super::policy::{EvictionOrder, Tier};
use crate::geom::{BrickId, STORED_EDGE};

/// A slot by its linear number in the atlas, x fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SlotId(pub u32);

/// Size of an atlas texture. Its edges are powers of two, so that the same brick is filtered alike in every slot
/// (design.md §5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasShape {
    /// Texels per axis.
    pub texels: UVec3,
}

impl AtlasShape {
    /// The smallest atlas with at least `slots` slots whose edges are at most `max_edge` texels; if there is none, or it
    /// takes more than `budget_bytes`, the one with the most slots that doesn't. `None` when not even one slot fits.
    pub fn for_slots(
        slots: u64,
        voxel_bytes: u64,
        budget_bytes: u64,
        max_edge: u32,
    ) -> Option<Self> {
        let edges: Vec<u32> = (6..=14)
            .map(|shift| 1 << shift)
            .filter(|&e| e <= max_edge)
            .collect();
        let mut shapes = Vec::new();
        for &x in &edges {
            for &y in edges.iter().filter(|&&y| y <= x) {
                for &z in edges.iter().filter(|&&z| z <= y) {
                    let shape = Self {
                        texels: UVec3::new(x, y, z),
                    };
                    if shape.slot_count() > 0 && shape.bytes(voxel_bytes) <= budget_bytes {
                        shapes.push(shape);
                    }
                }
            }
        }
        let enough = shapes
            .iter()
            .filter(|s| s.slot_count() >= slots)
            .min_by_key(|s| (s.bytes(voxel_bytes), s.texels.x));
        enough
            .or_else(|| shapes.iter().max_by_key(|s| s.slot_count()))
            .copied()
    }

    /// Slots per axis.
    pub fn slots(&self) -> UVec3 {
        self.texels / STORED_EDGE
    }

    /// Number of slots.
    pub fn slot_count(&self) -> u64 {
        let s = self.slots();
        u64::from(s.x) * u64::from(s.y) * u64::from(s.z)
    }

    /// Bytes of the texture.
    pub fn bytes(&self, voxel_bytes: u64) -> u64 {
        u64::from(self.texels.x) * u64::from(self.texels.y) * u64::from(self.texels.z) * voxel_bytes
    }

    /// Place of a slot in the grid of slots.
    pub fn slot_place(&self, slot: SlotId) -> UVec3 {
        let s = self.slots();
        UVec3::new(slot.0 % s.x, slot.0 / s.x % s.y, slot.0 / s.x / s.y)
    }

    /// Bytes of the smallest atlas, of one slot.
    pub fn least_bytes(voxel_bytes: u64) -> u64 {
        u64::from(STORED_EDGE.next_power_of_two()).pow(3) * voxel_bytes
    }
}

/// Who is in which slot, and who leaves next (see `policy`).
#[derive(Debug)]
pub struct SlotPool {
    capacity: usize,
    free: Vec<SlotId>,
    resident: BTreeMap<BrickId, SlotId>,
    pub(super) order: EvictionOrder,
}

/// A slot that was given out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) slot: SlotId,
    /// Who had to leave.
    pub(super) evicted: Option<BrickId>,
}

impl SlotPool {
    /// `count` free slots; the lowest is given first.
    pub fn new(count: u32) -> Self {
        Self::with_order((0..count).map(SlotId).collect())
    }

    /// All slots, in the order in which they are given out: for tests of the atlas' indifference to it.
    pub fn with_order(order: Vec<SlotId>) -> Self {
        Self {
            capacity: order.len(),
            order: EvictionOrder::new(order.len()),
            free: order.into_iter().rev().collect(),
            resident: BTreeMap::new(),
        }
    }

    /// Slots, free or not.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// The bricks with a slot, in the order of their ids.
    pub fn resident(&self) -> impl Iterator<Item = (BrickId, SlotId)> + '_ {
        self.resident.iter().map(|(&brick, &slot)| (brick, slot))
    }

    /// Slots that are free or can be made so by evicting bricks of tier `most` at most.
    pub(super) fn available(&self, most: Tier) -> usize {
        self.free.len() + self.order.evictable(most)
    }

    /// A slot for `brick`, protected until the next pass: a free one, else that of the brick that leaves first, if its
    /// tier is `most` at most.
    pub(super) fn place(&mut self, brick: BrickId, most: Tier) -> Option<Placed> {
        let placed = match self.free.pop() {
            Some(slot) => Placed {
                slot,
                evicted: None,
            },
            None => {
                let old = self.order.evict(most)?;
                let slot = self
                    .resident
                    .remove(&old)
                    .expect("invariant: what can leave has a slot");
                Placed {
                    slot,
                    evicted: Some(old),
                }
            }
        };
        self.resident.insert(brick, placed.slot);
        self.order.insert(brick);
        Some(placed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_powers_of_two_and_as_small_as_they_can_be() {
        let shape = AtlasShape::for_slots(3000, 1, u64::MAX, 2048).unwrap();
        assert_eq!(shape.texels, UVec3::splat(512), "15³ = 3375 slots");
        assert_eq!(
            AtlasShape::for_slots(1, 2, u64::MAX, 2048)
                .unwrap()
                .slot_count(),
            1,
            "one slot is enough"
        );
        let tight = AtlasShape::for_slots(3000, 2, 16 << 20, 2048).unwrap();
        assert!(
            tight.bytes(2) <= 16 << 20 && tight.slot_count() >= 98,
            "{tight:?} keeps the budget"
        );
        assert!(
            AtlasShape::for_slots(1, 1, 1000, 2048).is_none(),
            "not even one slot fits 1000 bytes"
        );
        let mut seen = std::collections::BTreeSet::new();
        for i in 0..shape.slot_count() as u32 {
            assert!(
                seen.insert(shape.slot_place(SlotId(i)).to_array()),
                "slot {i} has a place of its own"
            );
        }
    }
}
