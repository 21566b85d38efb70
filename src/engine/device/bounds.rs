//! Which blocks may be visible, as the bounding mesh has them: all levels that are sampled, in blocks of the coarsest of
//! them (one mesh has no overlapping parts, on which the rule of nearest faces stands).

use std::collections::BTreeMap;

use glam::{DVec3, UVec3};

use crate::camera::Projection;
use crate::classify::Occupancy;
use crate::geom::{BLOCKS_PER_EDGE, BRICK_EDGE, BrickGrid, BrickId};
use crate::pager::scan;
use crate::proxy::{ActiveBlocks, Granularity, Mesh, ProxyError, bounding_mesh};
use crate::scene::{LevelFrame, RayFrame};
use crate::store::Store;

use super::classification::{KnownRanges, SeenLevels};

/// Blocks that project below this many pixels are not worth a face (design.md §6).
const LEAST_BLOCK_PIXELS: f64 = 2.0;

/// The blocks that may be visible, where they can be sampled: all of a brick's whose block ranges are not known.
pub(super) fn active_blocks(
    store: &Store,
    rays: &RayFrame,
    levels: &SeenLevels,
    known: &KnownRanges,
) -> Result<ActiveBlocks, ProxyError> {
    let target = rays.coarsest_used();
    let target_grid = store.level(target.lod).grid;
    let target_scale = store.level(target.lod).scale;
    let mut bricks: BTreeMap<u64, Occupancy> = BTreeMap::new();
    for level in rays.used() {
        let Some(seen) = levels.get(&level.lod) else {
            continue;
        };
        let shell = Shell::new(rays, level);
        let ratio = store.level(level.lod).scale / target_scale;
        for brick in scan(store, level.lod, &seen.visibility) {
            if !brick.visible || !shell.holds(brick.id) {
                continue;
            }
            let blocks = match known.get(&brick.id) {
                Some(ranges) => Occupancy::from_ranges(ranges, &seen.visibility),
                None => Occupancy::FULL,
            };
            if ratio == DVec3::ONE {
                let entry = bricks.entry(brick.index).or_insert(Occupancy::EMPTY);
                *entry = entry.union(&blocks);
            } else {
                project(&mut bricks, &target_grid, brick.id.xyz, &blocks, ratio);
            }
        }
    }
    ActiveBlocks::new(
        target_grid,
        bricks.into_iter().map(|(i, o)| (target_grid.xyz(i), o)),
    )
}

/// The mesh at the granularity that the picture is worth, of at most `budget_bytes` where bricks are coarse enough.
pub(super) fn mesh(
    blocks: &ActiveBlocks,
    rays: &RayFrame,
    budget_bytes: u64,
) -> Result<Mesh, ProxyError> {
    if rays.block_pixels() >= LEAST_BLOCK_PIXELS {
        let fine = bounding_mesh(blocks, Granularity::Blocks)?;
        let bytes = size_of_val(fine.vertices.as_slice()) + size_of_val(fine.indices.as_slice());
        if bytes as u64 <= budget_bytes {
            return Ok(fine);
        }
    }
    bounding_mesh(blocks, Granularity::Bricks)
}

/// Where a level is sampled: between two distances from the eye.
struct Shell<'a> {
    rays: &'a RayFrame,
    level: &'a LevelFrame,
    reach_mm: [f64; 2],
    half_diagonal_mm: f64,
}

impl<'a> Shell<'a> {
    fn new(rays: &'a RayFrame, level: &'a LevelFrame) -> Self {
        let m = level.world_from_level.matrix3 * f64::from(BRICK_EDGE);
        Self {
            rays,
            level,
            reach_mm: rays.reach_mm(level),
            // Never less than that of the sheared brick.
            half_diagonal_mm: (m.x_axis.length() + m.y_axis.length() + m.z_axis.length()) / 2.0,
        }
    }

    /// False only if no sample of the level lies in the brick.
    fn holds(&self, brick: BrickId) -> bool {
        let middle = (brick.xyz.as_dvec3() + 0.5) * f64::from(BRICK_EDGE);
        let world = self.level.world_from_level.transform_point3(middle);
        let view = self.rays.world_from_view;
        let from_eye = world - view.translation;
        let distance = match self.rays.projection {
            Projection::Orthographic => -from_eye.dot(view.matrix3.z_axis),
            _ => from_eye.length(),
        };
        distance + self.half_diagonal_mm >= self.reach_mm[0]
            && distance - self.half_diagonal_mm <= self.reach_mm[1]
    }
}

/// Marks the blocks of a coarser level that cover `blocks` of the brick at `xyz`. `ratio`: coarse voxels per voxel, powers
/// of two.
fn project(
    bricks: &mut BTreeMap<u64, Occupancy>,
    grid: &BrickGrid,
    xyz: UVec3,
    blocks: &Occupancy,
    ratio: DVec3,
) {
    let first = (xyz * BLOCKS_PER_EDGE).as_dvec3();
    let mut mark = |low: DVec3, high: DVec3| {
        let low = (low * ratio).floor().as_uvec3();
        let end = (high * ratio)
            .ceil()
            .as_uvec3()
            .min(grid.bricks * BLOCKS_PER_EDGE);
        for z in low.z..end.z {
            for y in low.y..end.y {
                for x in low.x..end.x {
                    let block = UVec3::new(x, y, z);
                    let inside = block % BLOCKS_PER_EDGE;
                    bricks
                        .entry(grid.index(block / BLOCKS_PER_EDGE))
                        .or_insert(Occupancy::EMPTY)
                        .set(inside.x, inside.y, inside.z, true);
                }
            }
        }
    };
    if blocks.is_full() {
        mark(first, first + f64::from(BLOCKS_PER_EDGE));
        return;
    }
    for z in 0..BLOCKS_PER_EDGE {
        for y in 0..BLOCKS_PER_EDGE {
            for x in 0..BLOCKS_PER_EDGE {
                if blocks.get(x, y, z) {
                    let block = first + UVec3::new(x, y, z).as_dvec3();
                    mark(block, block + 1.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::U64Vec3;

    use super::*;

    #[test]
    fn finer_blocks_are_covered_by_coarser_ones() {
        let grid = BrickGrid::for_voxels(U64Vec3::new(50, 64, 64)).unwrap();
        let mut bricks = BTreeMap::new();
        let mut blocks = Occupancy::EMPTY;
        blocks.set(7, 0, 3, true);
        // Brick (1, 0, 2): its block (15, 0, 19) of the finer level is half a block of the coarser one on x and y only.
        let ratio = DVec3::new(0.5, 0.5, 1.0);
        project(&mut bricks, &grid, UVec3::new(1, 0, 1), &blocks, ratio);
        let mut expected = Occupancy::EMPTY;
        expected.set(7, 0, 3, true);
        assert_eq!(
            bricks,
            BTreeMap::from([(grid.index(UVec3::new(0, 0, 1)), expected)]),
            "block (7, 0, 11)"
        );
        bricks.clear();
        project(
            &mut bricks,
            &grid,
            UVec3::new(1, 0, 0),
            &Occupancy::FULL,
            ratio,
        );
        let count: u32 = bricks.values().map(Occupancy::count).sum();
        assert_eq!(count, 4 * 4 * 8, "a brick is a quarter of a coarser one");
    }
}
