//! Which blocks of a level are active: occupancies of its bricks, by place.

use glam::UVec3;
use thiserror::Error;

use crate::classify::Occupancy;
use crate::geom::{BLOCK_EDGE, BLOCKS_PER_EDGE, BrickGrid};

/// Why there is no mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ProxyError {
    /// Corners are 16-bit.
    #[error(
        "a level of {bricks} bricks is too large for a bounding mesh: at most {} bricks (262112 voxels) on an axis",
        ActiveBlocks::MAX_BRICKS
    )]
    TooLarge {
        /// Bricks per axis.
        bricks: UVec3,
    },
    /// A brick that the level doesn't have.
    #[error("brick {xyz} is outside the level's {bricks} bricks")]
    OutsideGrid {
        /// The brick.
        xyz: UVec3,
        /// Bricks per axis.
        bricks: UVec3,
    },
    /// More vertices than 32-bit indices can name.
    #[error("the bounding mesh would have {quads} quads; at most 2^30 can be indexed")]
    TooManyQuads {
        /// Number of quads.
        quads: usize,
    },
}

/// The bricks of one level that have active blocks; all others are empty. Never holds a block outside the level.
#[derive(Clone, Debug, PartialEq)]
pub struct ActiveBlocks {
    grid: BrickGrid,
    /// By linear index of the grid, rising; none empty.
    bricks: Vec<(u64, Occupancy)>,
}

impl ActiveBlocks {
    /// Most bricks on an axis: their block corners, 0 to 65528, fit 16 bits.
    pub const MAX_BRICKS: u32 = 8191;

    /// The active blocks of a level, from its bricks in any order. Blocks without a voxel of the level are taken out;
    /// a brick given twice has the blocks of both.
    ///
    /// # Errors
    /// The level has more than [`Self::MAX_BRICKS`] on an axis, or a brick lies outside it.
    pub fn new(
        grid: BrickGrid,
        bricks: impl IntoIterator<Item = (UVec3, Occupancy)>,
    ) -> Result<Self, ProxyError> {
        if grid.bricks.max_element() > Self::MAX_BRICKS {
            return Err(ProxyError::TooLarge {
                bricks: grid.bricks,
            });
        }
        let mut sorted = Vec::new();
        for (xyz, occupancy) in bricks {
            if xyz.cmpge(grid.bricks).any() {
                return Err(ProxyError::OutsideGrid {
                    xyz,
                    bricks: grid.bricks,
                });
            }
            let occupancy = occupancy.intersection(&blocks_of(&grid, xyz));
            if !occupancy.is_empty() {
                sorted.push((grid.index(xyz), occupancy));
            }
        }
        sorted.sort_unstable_by_key(|&(index, _)| index);
        sorted.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 = first.1.union(&later.1);
            }
            same
        });
        Ok(Self {
            grid,
            bricks: sorted,
        })
    }

    /// The same with every brick that has an active block active as a whole.
    #[must_use]
    pub fn whole_bricks(&self) -> Self {
        Self {
            grid: self.grid,
            bricks: self
                .bricks
                .iter()
                .map(|&(index, _)| (index, blocks_of(&self.grid, self.grid.xyz(index))))
                .collect(),
        }
    }

    /// The level.
    pub fn grid(&self) -> &BrickGrid {
        &self.grid
    }

    /// Bricks with active blocks, by z, then y, then x.
    pub fn iter(&self) -> impl Iterator<Item = (UVec3, Occupancy)> {
        self.bricks.iter().map(|&(i, o)| (self.grid.xyz(i), o))
    }

    /// The occupancy of a brick; empty outside the level.
    pub fn get(&self, xyz: UVec3) -> Occupancy {
        if xyz.cmpge(self.grid.bricks).any() {
            return Occupancy::EMPTY;
        }
        let index = self.grid.index(xyz);
        self.bricks
            .binary_search_by_key(&index, |&(i, _)| i)
            .map_or(Occupancy::EMPTY, |at| self.bricks[at].1)
    }

    /// Number of bricks with active blocks.
    pub fn len(&self) -> usize {
        self.bricks.len()
    }

    /// True when no block is active.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// The bricks as stored, for work in parallel.
    pub(super) fn entries(&self) -> &[(u64, Occupancy)] {
        &self.bricks
    }
}

/// The blocks of a brick that have a voxel of the level.
fn blocks_of(grid: &BrickGrid, xyz: UVec3) -> Occupancy {
    let size = grid.brick_box(xyz).size();
    let blocks = [size.x, size.y, size.z].map(|n| {
        n.div_ceil(u64::from(BLOCK_EDGE))
            .min(u64::from(BLOCKS_PER_EDGE)) as u32
    });
    Occupancy::corner(blocks[0], blocks[1], blocks[2])
}

#[cfg(test)]
mod tests {
    use glam::U64Vec3;

    use super::*;

    #[test]
    fn bricks_are_sorted_cut_and_found() {
        let grid = BrickGrid::for_voxels(U64Vec3::new(70, 32, 5)).unwrap();
        let (a, b) = (UVec3::new(2, 0, 0), UVec3::ZERO);
        let active = ActiveBlocks::new(grid, [(a, Occupancy::FULL), (b, Occupancy::FULL)]).unwrap();
        let order: Vec<_> = active.iter().map(|(xyz, _)| xyz).collect();
        assert_eq!(order, [b, a], "sorted");
        assert_eq!(active.get(a).count(), 2 * 8 * 2, "6 × 32 × 5 voxels");
        assert!(active.get(UVec3::new(1, 0, 0)).is_empty(), "not given");
        assert!(active.get(UVec3::new(3, 0, 0)).is_empty(), "outside");
        assert!(
            ActiveBlocks::new(grid, [(UVec3::Y, Occupancy::FULL)]).is_err(),
            "a brick outside is refused"
        );
    }

    #[test]
    fn too_large_a_level_is_refused() {
        let grid = BrickGrid::for_voxels(U64Vec3::new(262_113, 1, 1)).unwrap();
        let error = ActiveBlocks::new(grid, []).unwrap_err();
        assert!(
            error.to_string().contains("8191"),
            "the message has the limit: {error}"
        );
    }
}
