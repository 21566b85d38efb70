//! Bricks, blocks and levels as indices.

use std::fmt;

use glam::{U64Vec3, UVec3};

use super::VoxelBox;

/// Voxels along a brick's edge, border not counted.
pub const BRICK_EDGE: u32 = 32;
/// Border voxels on each side of a stored brick: copies of the true neighbours.
pub const BRICK_BORDER: u32 = 1;
/// Voxels along a stored brick's edge, border counted.
pub const STORED_EDGE: u32 = BRICK_EDGE + 2 * BRICK_BORDER;
/// Voxels of a stored brick, border counted.
pub const STORED_VOXELS: usize = (STORED_EDGE * STORED_EDGE * STORED_EDGE) as usize;
/// Voxels along a bounding block's edge.
pub const BLOCK_EDGE: u32 = 4;
/// Blocks along a brick's edge.
pub const BLOCKS_PER_EDGE: u32 = BRICK_EDGE / BLOCK_EDGE;
/// Blocks in a brick: the bits of its occupancy.
pub const BLOCKS_PER_BRICK: usize = (BLOCKS_PER_EDGE * BLOCKS_PER_EDGE * BLOCKS_PER_EDGE) as usize;

/// A level of detail: 0 is the finest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lod(pub u8);

impl fmt::Display for Lod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "level {}", self.0)
    }
}

/// A brick's identity: its level and its place in that level's grid. Ordered by level, then z, y, x.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BrickId {
    /// The level.
    pub lod: Lod,
    /// Place in the level's brick grid.
    pub xyz: UVec3,
}

impl BrickId {
    /// The brick at `xyz` of `lod`.
    pub const fn new(lod: Lod, xyz: UVec3) -> Self {
        Self { lod, xyz }
    }
}

impl Ord for BrickId {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |b: &Self| (b.lod, b.xyz.z, b.xyz.y, b.xyz.x);
        key(self).cmp(&key(other))
    }
}

impl PartialOrd for BrickId {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Display for BrickId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "brick ({}, {}, {}) of {}",
            self.xyz.x, self.xyz.y, self.xyz.z, self.lod
        )
    }
}

/// The grid of bricks of one level: how many voxels it covers and how many bricks that takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickGrid {
    /// Voxels of the level, per axis.
    pub voxels: U64Vec3,
    /// Bricks of the level, per axis.
    pub bricks: UVec3,
}

impl BrickGrid {
    /// The grid for a level of `voxels`; `None` when an axis is empty or has more than 2³² bricks.
    pub fn for_voxels(voxels: U64Vec3) -> Option<Self> {
        let edge = |n: u64| {
            u32::try_from(n.div_ceil(u64::from(BRICK_EDGE)))
                .ok()
                .filter(|&b| b > 0)
        };
        let bricks = UVec3::new(edge(voxels.x)?, edge(voxels.y)?, edge(voxels.z)?);
        // The linear index must fit u64: 2⁹⁶ bricks don't, and no file describes them honestly.
        u64::from(bricks.x)
            .checked_mul(u64::from(bricks.y))?
            .checked_mul(u64::from(bricks.z))?;
        Some(Self { voxels, bricks })
    }

    /// Number of bricks.
    pub fn len(&self) -> u64 {
        u64::from(self.bricks.x) * u64::from(self.bricks.y) * u64::from(self.bricks.z)
    }

    /// Never true: a grid has at least one brick. Here because `len` is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Linear index of the brick at `xyz`, x fastest.
    pub fn index(&self, xyz: UVec3) -> u64 {
        (u64::from(xyz.z) * u64::from(self.bricks.y) + u64::from(xyz.y)) * u64::from(self.bricks.x)
            + u64::from(xyz.x)
    }

    /// The brick with linear index `index`: the inverse of [`Self::index`].
    pub fn xyz(&self, index: u64) -> UVec3 {
        let (nx, ny) = (u64::from(self.bricks.x), u64::from(self.bricks.y));
        UVec3::new(
            (index % nx) as u32,
            (index / nx % ny) as u32,
            (index / nx / ny) as u32,
        )
    }

    /// The voxels that the brick at `xyz` owns, border not counted, cut to the level.
    pub fn brick_box(&self, xyz: UVec3) -> VoxelBox {
        let min = xyz.as_u64vec3() * u64::from(BRICK_EDGE);
        VoxelBox::new(min, (min + u64::from(BRICK_EDGE)).min(self.voxels))
    }
}

/// The Morton (z-order) code of `xyz`; each coordinate must be below 2²¹.
pub fn morton(xyz: UVec3) -> u64 {
    let spread = |v: u32| {
        let mut x = u64::from(v) & 0x1f_ffff;
        x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
        x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
        x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
        x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
        (x | (x << 2)) & 0x1249_2492_4924_9249
    };
    spread(xyz.x) | (spread(xyz.y) << 1) | (spread(xyz.z) << 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grid_index_and_xyz_are_inverse() {
        let grid = BrickGrid::for_voxels(U64Vec3::new(33, 64, 100)).unwrap();
        assert_eq!(
            grid.bricks,
            UVec3::new(2, 2, 4),
            "33, 64 and 100 voxels take 2, 2 and 4 bricks"
        );
        for i in 0..grid.len() {
            assert_eq!(grid.index(grid.xyz(i)), i, "index {i}");
        }
        assert_eq!(
            grid.brick_box(UVec3::new(1, 0, 3)).size(),
            U64Vec3::new(1, 32, 4),
            "the far brick is cut"
        );
        assert!(
            BrickGrid::for_voxels(U64Vec3::new(0, 1, 1)).is_none(),
            "an empty axis has no grid"
        );
    }

    #[test]
    fn morton_interleaves_bits() {
        assert_eq!(morton(UVec3::new(1, 0, 0)), 0b001, "x is the lowest bit");
        assert_eq!(morton(UVec3::new(0, 1, 0)), 0b010, "y is the middle bit");
        assert_eq!(morton(UVec3::new(3, 1, 2)), 0b101_011, "bits interleave");
        assert_eq!(
            morton(UVec3::splat(0x1f_ffff)),
            (1 << 63) - 1,
            "21 bits per axis fill 63"
        );
    }
}
