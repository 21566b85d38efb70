//! What can be seen of a brick, in the two bits that shaders read.

use crate::classify::Occupancy;
use crate::geom::BLOCKS_PER_BRICK;
use crate::gpu::layout::{BRICK_EMPTY, BRICK_EMPTY_ABOVE, BRICK_FULL, BRICK_MIXED};

/// Active blocks (of 512) from which a brick is walked as if all were: finding the few gaps costs more than the samples in
/// them. Only what is sampled in vain changes, not the picture.
const FULL_ENOUGH: u32 = 384;

/// Of every group of 2×2×2 blocks of a brick, x fastest, the code of its greatest value or of its least
/// ([`super::ExtremeCodes`]).
pub type GroupBounds = [u8; BLOCKS_PER_BRICK / 8];

/// What can be seen of a brick, under the classification in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Nothing. `above`: all of it lies above the iso-value.
    Empty {
        /// On which side of the iso-value it lies.
        above: bool,
    },
    /// Some of it, nobody knows which: every block counts as active.
    Unknown,
    /// The blocks of this occupancy.
    Blocks(Occupancy),
    /// In modes mip and minip: what a ray's extreme has already is no better in a group.
    Groups(GroupBounds),
}

impl Activity {
    /// The two bits of the shader's table.
    pub(super) fn bits(self) -> u32 {
        match self {
            Self::Empty { above: false } => BRICK_EMPTY,
            Self::Empty { above: true } => BRICK_EMPTY_ABOVE,
            Self::Unknown => BRICK_FULL,
            Self::Blocks(occupancy) if occupancy.count() >= FULL_ENOUGH => BRICK_FULL,
            Self::Blocks(_) | Self::Groups(_) => BRICK_MIXED,
        }
    }

    /// The row of the brick's slot, where it has one: what [`Self::bits`] leave open.
    pub(super) fn row(&self) -> Option<&[u8]> {
        match self {
            Self::Empty { .. } | Self::Unknown => None,
            Self::Blocks(occupancy) => Some(bytemuck::cast_slice(occupancy.words())),
            Self::Groups(bounds) => Some(bounds),
        }
    }

    /// A level's activities, 16 to a word, as [`super::Residency::set_level_activity`] takes them. None by blocks or
    /// groups: those are by slot.
    pub fn pack(activities: &[Self]) -> Vec<u32> {
        activities
            .chunks(16)
            .map(|chunk| {
                (0..).step_by(2).zip(chunk).fold(0, |word, (shift, a)| {
                    debug_assert!(a.row().is_none(), "rows lie by slot");
                    word | a.bits() << shift
                })
            })
            .collect()
    }
}
