//! Which bricks a picture needs: those with an active block, and those within one step of one (invariant 4).

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, IVec3};

use crate::classify::{Occupancy, Visibility};
use crate::geom::{BLOCK_EDGE, BRICK_EDGE, BrickGrid, BrickId, Lod};
use crate::store::Store;

/// What the index of a level tells under one classification, before any record is read.
#[derive(Clone, Debug, Default)]
pub struct LevelScan {
    /// Bricks with voxels whose range may be visible: their block ranges decide.
    pub candidates: Vec<BrickId>,
    /// Number of bricks with voxels.
    pub with_voxels: u64,
    /// Every brick of one value, by linear index: the value (stored units), and whether it is visible.
    pub constant: BTreeMap<u64, (f32, bool)>,
}

impl LevelScan {
    /// Looks at every entry of the level's index.
    pub fn new(store: &Store, lod: Lod, visibility: &Visibility) -> Self {
        let grid = store.level(lod).grid;
        let mut scan = Self::default();
        for index in 0..grid.len() {
            let id = BrickId::new(lod, grid.xyz(index));
            let entry = store.entry(id);
            let visible = visibility.is_visible(entry.min, entry.max);
            if entry.constant {
                scan.constant.insert(index, (entry.min, visible));
            } else {
                scan.with_voxels += 1;
                if visible {
                    scan.candidates.push(id);
                }
            }
        }
        scan
    }
}

/// The visible bricks of a level under one classification, by linear index.
#[derive(Clone, Debug, Default)]
pub struct ActiveBricks {
    /// Bricks with voxels of which some block is active.
    pub mixed: BTreeMap<u64, Occupancy>,
    /// Visible bricks of one value: all blocks active, no voxels.
    pub constant: BTreeSet<u64>,
}

impl ActiveBricks {
    /// Occupancy of every visible brick, in order of linear index.
    pub fn occupancies(&self) -> BTreeMap<u64, Occupancy> {
        let mut all = self.mixed.clone();
        all.extend(self.constant.iter().map(|&i| (i, Occupancy::FULL)));
        all
    }
}

/// The bricks that are active or lie within `reach` level voxels (per axis) of an active block of another: samples next
/// to a run are taken there.
pub fn within_reach(
    active: &BTreeMap<u64, Occupancy>,
    grid: &BrickGrid,
    reach: DVec3,
) -> BTreeSet<u64> {
    let mut wanted = BTreeSet::new();
    let last = (grid.bricks - 1).as_ivec3();
    for (&index, occupancy) in active {
        let Some((first, end)) = occupancy.bounds() else {
            continue;
        };
        let corner = (grid.xyz(index) * BRICK_EDGE).as_dvec3();
        let low = corner + (first * BLOCK_EDGE).as_dvec3() - reach;
        let high = corner + (end * BLOCK_EDGE).as_dvec3() + reach;
        let to_brick = |p: DVec3| {
            (p / f64::from(BRICK_EDGE))
                .floor()
                .as_ivec3()
                .clamp(IVec3::ZERO, last)
        };
        let (low, high) = (to_brick(low), to_brick(high));
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    wanted.insert(grid.index(IVec3::new(x, y, z).as_uvec3()));
                }
            }
        }
    }
    wanted
}

#[cfg(test)]
mod tests {
    use glam::{U64Vec3, UVec3};

    use super::*;

    #[test]
    fn neighbours_count_only_within_reach() {
        let grid = BrickGrid::for_voxels(U64Vec3::splat(96)).unwrap();
        let mut one_block = Occupancy::EMPTY;
        one_block.set(7, 4, 4, true);
        let active = BTreeMap::from([(grid.index(UVec3::splat(1)), one_block)]);
        let wanted = |reach| -> Vec<[u32; 3]> {
            within_reach(&active, &grid, DVec3::splat(reach))
                .into_iter()
                .map(|i| grid.xyz(i).to_array())
                .collect()
        };
        assert_eq!(
            wanted(0.5),
            [[1, 1, 1], [2, 1, 1]],
            "the block touches the brick to the right"
        );
        assert_eq!(
            wanted(40.0).len(),
            27,
            "a step of more than a brick reaches all around"
        );
    }
}
