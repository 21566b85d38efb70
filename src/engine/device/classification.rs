//! What can be seen of the bricks under a classification, worked out from the index and from the block ranges of resident
//! bricks. Pure, so that a thread beside the renderer can do it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::classify::{Occupancy, Visibility};
use crate::geom::{BLOCKS_PER_BRICK, BrickId, Lod};
use crate::pager::scan;
use crate::render::{Activity, ExtremeCodes};
use crate::store::Store;

/// What can be seen of a level: the test, and the iso-value that tells the two sides of what can't.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LevelVisibility {
    pub(super) visibility: Visibility,
    pub(super) iso: Option<f32>,
    /// Of the volume's values.
    pub(super) codes: ExtremeCodes,
}

impl LevelVisibility {
    /// What the index alone tells of a brick with values in `range`.
    pub(super) fn of_range(&self, range: [f32; 2]) -> Activity {
        if self.visibility.is_visible(range[0], range[1]) {
            Activity::Unknown
        } else {
            Activity::Empty {
                above: self.iso.is_some_and(|iso| range[0] > iso),
            }
        }
    }

    /// What is known of a brick: by its blocks where their ranges are known, else by the index.
    pub(super) fn of_brick(&self, range: [f32; 2], blocks: Option<&BlockRanges>) -> Activity {
        match (self.of_range(range), blocks) {
            (Activity::Unknown, Some(ranges)) => self.of_blocks(ranges),
            (activity, _) => activity,
        }
    }

    /// What the blocks of a brick tell that may be visible.
    fn of_blocks(&self, ranges: &[[f32; 2]; BLOCKS_PER_BRICK]) -> Activity {
        match self.visibility {
            Visibility::AboveMinimum { .. } => {
                Activity::Groups(self.codes.of_groups(ranges, false))
            }
            Visibility::BelowMaximum { .. } => Activity::Groups(self.codes.of_groups(ranges, true)),
            _ => Activity::Blocks(Occupancy::from_ranges(ranges, &self.visibility)),
        }
    }
}

/// Ranges of a brick's blocks.
pub(super) type BlockRanges = Arc<[[f32; 2]; BLOCKS_PER_BRICK]>;

/// Block ranges of the bricks in slots.
pub(super) type KnownRanges = HashMap<BrickId, BlockRanges>;

/// Levels that are sampled, and what can be seen of each.
pub(super) type SeenLevels = BTreeMap<Lod, LevelVisibility>;

/// The tables of the levels that a new classification changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ClassifiedBricks {
    /// Per level, two bits per brick as the index alone tells them ([`Activity::pack`]).
    pub(super) levels: BTreeMap<Lod, Vec<u32>>,
    /// Blocks of resident bricks of these levels that may be visible.
    pub(super) resident: HashMap<BrickId, Activity>,
    /// Bricks of all sampled levels that may be visible, and those of them with voxels.
    pub(super) visible: u64,
    pub(super) visible_with_voxels: u64,
}

impl ClassifiedBricks {
    /// Classifies the levels of `wanted` that are not already so in `current`: one scan of their index, one of the blocks
    /// of their resident bricks.
    pub(super) fn new(
        store: &Store,
        wanted: &SeenLevels,
        current: &SeenLevels,
        known: &KnownRanges,
    ) -> Self {
        let mut classified = Self::default();
        for (&lod, seen) in wanted {
            let changed = current.get(&lod) != Some(seen);
            let mut activities = Vec::new();
            for brick in scan(store, lod, &seen.visibility) {
                classified.visible += u64::from(brick.visible);
                classified.visible_with_voxels += u64::from(brick.visible && !brick.constant);
                if changed {
                    activities.push(seen.of_range(brick.range));
                }
            }
            if changed {
                classified.levels.insert(lod, Activity::pack(&activities));
            }
        }
        for (&brick, ranges) in known {
            if classified.levels.contains_key(&brick.lod)
                && let Some(seen) = wanted.get(&brick.lod)
            {
                classified.resident.insert(brick, seen.of_blocks(ranges));
            }
        }
        classified
    }
}
