//! Levels of a volume, and the memory that bricking it takes: pure arithmetic, nothing allocated.

use glam::{BVec3, DVec3, U64Vec3};

use super::error::BrickError;
use super::stats;
use crate::geom::{BRICK_EDGE, BrickGrid, STORED_EDGE, STORED_VOXELS};
use crate::store::codec;
use crate::store::header::MAX_LEVELS;
use crate::store::writer;
use crate::volume::{StoredType, VoxelType};

/// What a process of this program takes without any volume: code, stacks, pools, the allocator's slack.
const BASE_BYTES: u64 = 20 << 20;
/// Least `--memory`.
const FLOOR_BYTES: u64 = 128 << 20;
/// zstd's context for inputs of a brick's size at levels up to 3 (measured: 1.3 MiB), and at higher ones.
const ZSTD_BYTES: [u64; 2] = [2 << 20, 8 << 20];
/// A chunk of source slices larger than this brings nothing.
const CHUNK_BYTES: u64 = 8 << 20;
/// Chunks in being at once: one being read, one being converted.
pub const CHUNKS: u64 = 2;
/// Bricks encoded at once by each worker: enough to even out the cost of empty and full ones.
const BATCH_PER_WORKER: usize = 16;
/// Batches in being at once: one being encoded, one being written.
const BATCHES: u64 = 2;

/// A level of detail to be made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelPlan {
    /// Its voxels and bricks.
    pub grid: BrickGrid,
    /// Voxels of level 0 per voxel, along each axis.
    pub scale: DVec3,
    /// Axes along which the level below was halved; none for level 0.
    pub halved: BVec3,
}

/// The levels of a volume, finest first.
///
/// Each level halves the axes whose spacing is less than twice the smallest at that level, so that thick slices are
/// kept until the slices' own voxels are as coarse. Axes of one voxel don't count: they can't be halved. When all axes
/// that would be halved are one brick already, all axes are. It ends at a level of one brick, or after `limit` levels.
///
/// # Errors
/// The volume is beyond the grid, or needs more than 32 levels.
pub fn levels(
    name: &str,
    dims: U64Vec3,
    spacing: DVec3,
    limit: Option<u32>,
) -> Result<Vec<LevelPlan>, BrickError> {
    let too_large = |what: String, remedy| BrickError::TooLarge {
        name: name.to_owned(),
        dims,
        what,
        remedy,
    };
    let grid_of = |dims: U64Vec3| {
        BrickGrid::for_voxels(dims).ok_or_else(|| {
            too_large(
                "a grid of more than 2³² bricks along an axis, or of none".into(),
                "brick a part of the volume",
            )
        })
    };
    let limit = limit.map_or(usize::MAX, |n| n.max(1) as usize);
    let brick = u64::from(BRICK_EDGE);
    let mut levels = vec![LevelPlan {
        grid: grid_of(dims)?,
        scale: DVec3::ONE,
        halved: BVec3::FALSE,
    }];
    let mut level = levels[0];
    while level.grid.len() > 1 && levels.len() < limit {
        let halved = halved_axes(level.grid.voxels, spacing * level.scale, brick);
        let (mut dims, mut scale) = (level.grid.voxels, level.scale);
        for axis in 0..3 {
            if halved.test(axis) {
                dims[axis] = dims[axis].div_ceil(2);
                scale[axis] *= 2.0;
            }
        }
        if levels.len() == MAX_LEVELS {
            return Err(too_large(
                format!("more than {MAX_LEVELS} levels"),
                "give --levels 32",
            ));
        }
        level = LevelPlan {
            grid: grid_of(dims)?,
            scale,
            halved,
        };
        levels.push(level);
    }
    Ok(levels)
}

fn halved_axes(dims: U64Vec3, spacing: DVec3, brick: u64) -> BVec3 {
    let long = dims.cmpgt(U64Vec3::ONE);
    let smallest = (0..3)
        .filter(|&a| long.test(a))
        .map(|a| spacing[a])
        .fold(f64::INFINITY, f64::min);
    let fine = BVec3::from_array([0, 1, 2].map(|a| long.test(a) && spacing[a] < 2.0 * smallest));
    if (0..3).any(|a| fine.test(a) && dims[a] > brick) {
        fine
    } else {
        long
    }
}

/// How the memory is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryPlan {
    /// Threads that encode.
    pub workers: usize,
    /// Slices of the source that are read at once.
    pub chunk_slices: u64,
    /// Bricks that are encoded at once.
    pub batch: usize,
    /// Bytes that all this takes, the process itself included.
    pub total_bytes: u64,
}

/// What a memory plan is made for.
#[derive(Clone, Copy, Debug)]
pub struct Needs<'a> {
    /// The source's name, for errors.
    pub name: &'a str,
    /// Type of the source's voxels.
    pub source_type: VoxelType,
    /// Type of the stored voxels.
    pub stored_type: StoredType,
    /// The levels, finest first.
    pub levels: &'a [LevelPlan],
    /// Threads that there are.
    pub threads: usize,
    /// zstd's level.
    pub zstd_level: i32,
    /// Bytes that the source holds.
    pub source_bytes: u64,
}

impl Needs<'_> {
    /// Divides `budget_bytes`: slabs are a must; then at least one worker and one slice at a time, then more workers,
    /// then larger chunks.
    ///
    /// # Errors
    /// The must does not fit; the error names the smallest size that works.
    pub fn plan(&self, budget_bytes: u64) -> Result<MemoryPlan, BrickError> {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        let given_mib = budget_bytes >> 20;
        if budget_bytes < FLOOR_BYTES {
            return Err(BrickError::MemoryFloor { given_mib });
        }
        let least = self.with(1, 1, 1);
        if least.total_bytes > budget_bytes {
            return Err(BrickError::Memory {
                name: self.name.to_owned(),
                dims: self.dims(),
                needed_mib: mib(least.total_bytes),
                given_mib,
            });
        }
        let fits = |plan: &MemoryPlan| plan.total_bytes <= budget_bytes;
        let mut best = least;
        for workers in 1..=self.threads.max(1) {
            let plan = self.with(workers, 1, workers * BATCH_PER_WORKER);
            if fits(&plan) {
                best = plan;
            }
        }
        let most = (CHUNK_BYTES / self.source_slice_bytes().max(1)).clamp(1, self.dims().z.max(1));
        let fitting = (1..=most)
            .rev()
            .map(|slices| self.with(best.workers, slices, best.batch))
            .find(fits);
        Ok(fitting.unwrap_or(best))
    }

    fn with(&self, workers: usize, chunk_slices: u64, batch: usize) -> MemoryPlan {
        let record = codec::max_record_len(self.stored_type) as u64;
        let parts = [
            BASE_BYTES,
            self.source_bytes,
            self.slab_bytes(),
            mul(&[CHUNKS, chunk_slices, self.source_slice_bytes()]),
            mul(&[workers as u64, self.worker_bytes()]),
            mul(&[BATCHES, batch as u64, record]),
            stats::total_bytes(self.stored_type),
            stats::saved_bytes(self.stored_type),
            writer::memory_bytes(&self.levels.iter().map(|l| l.grid).collect::<Vec<_>>()),
            // The order of a layer's bricks, per level.
            self.levels.iter().fold(0, |sum: u64, l| {
                let per_layer = mul(&[8, l.grid.bricks.x.into(), l.grid.bricks.y.into()]);
                sum.saturating_add(per_layer)
            }),
        ];
        MemoryPlan {
            workers,
            chunk_slices,
            batch,
            total_bytes: parts.iter().fold(0, |a, &b| a.saturating_add(b)),
        }
    }

    fn dims(&self) -> U64Vec3 {
        self.levels[0].grid.voxels
    }

    fn source_slice_bytes(&self) -> u64 {
        let dims = self.dims();
        mul(&[dims.x, dims.y, self.source_type.size() as u64])
    }

    /// The rolling slabs of all levels.
    fn slab_bytes(&self) -> u64 {
        self.levels
            .iter()
            .map(|l| {
                let v = l.grid.voxels;
                let slices = v.z.min(STORED_EDGE.into());
                mul(&[v.x, v.y, slices, self.stored_type.size() as u64])
            })
            .fold(0, u64::saturating_add)
    }

    /// A worker's zstd context, brick, record buffers and histogram.
    fn worker_bytes(&self) -> u64 {
        let voxels = (STORED_VOXELS * self.stored_type.size()) as u64;
        let codec =
            codec::max_record_len(self.stored_type) + 2 * codec::plain_len(self.stored_type);
        ZSTD_BYTES[usize::from(self.zstd_level > 3)]
            + 2 * voxels
            + codec as u64
            + stats::worker_bytes(self.stored_type)
    }
}

fn mul(factors: &[u64]) -> u64 {
    factors.iter().fold(1, |a, &b| a.saturating_mul(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(dims: [u64; 3], spacing: [f64; 3]) -> Vec<[u64; 3]> {
        levels("t", dims.into(), spacing.into(), None)
            .unwrap()
            .iter()
            .map(|l| l.grid.voxels.to_array())
            .collect()
    }

    #[test]
    fn isotropic_volumes_halve_all_axes() {
        assert_eq!(
            shape([100, 65, 33], [1.0; 3]),
            [[100, 65, 33], [50, 33, 17], [25, 17, 9]]
        );
        assert_eq!(
            shape([32, 1, 1], [1.0; 3]),
            [[32, 1, 1]],
            "one brick has one level"
        );
    }

    #[test]
    fn thick_slices_are_kept() {
        assert_eq!(
            shape([512, 512, 20], [1.0, 1.0, 5.0]),
            [
                [512, 512, 20],
                [256, 256, 20],
                [128, 128, 20],
                [64, 64, 10],
                [32, 32, 5]
            ],
            "z is halved once x and y are at 4 mm: 5 < 2 · 4"
        );
        assert_eq!(
            shape([20, 20, 100], [1.0, 1.0, 10.0]),
            [[20, 20, 100], [10, 10, 50], [5, 5, 25]],
            "x and y are one brick already: all axes are halved"
        );
        assert_eq!(
            shape([128, 128, 1], [1.0, 1.0, 0.001]),
            [[128, 128, 1], [64, 64, 1], [32, 32, 1]],
            "an axis of one voxel does not count"
        );
    }

    #[test]
    fn limits() {
        let dims = U64Vec3::new(4096, 4096, 4096);
        assert_eq!(
            levels("t", dims, DVec3::ONE, Some(3)).unwrap().len(),
            3,
            "--levels 3"
        );
        assert!(
            levels("t", U64Vec3::new(1, 0, 1), DVec3::ONE, None).is_err(),
            "an empty axis"
        );
        let huge = U64Vec3::splat(u64::MAX);
        assert!(
            levels("t", huge, DVec3::ONE, None).is_err(),
            "beyond the grid"
        );
    }

    #[test]
    fn memory_is_divided_or_refused_with_the_size_that_works() {
        let plan = |edge: u64, budget_mib: u64, threads| {
            let levels = levels("t", U64Vec3::splat(edge), DVec3::ONE, None).unwrap();
            let needs = Needs {
                name: "t",
                source_type: VoxelType::U16,
                stored_type: StoredType::U16,
                levels: &levels,
                threads,
                zstd_level: 1,
                source_bytes: 0,
            };
            needs.plan(budget_mib << 20)
        };
        let small = plan(512, 128, 2).unwrap();
        assert_eq!(small.workers, 2, "512³ needs little");
        assert!(small.total_bytes <= 128 << 20, "inside the budget");
        let many = plan(512, 128, 64).unwrap();
        assert!(
            (2..64).contains(&many.workers),
            "64 threads don't fit, {} do",
            many.workers
        );
        assert!(
            matches!(plan(64, 127, 1), Err(BrickError::MemoryFloor { .. })),
            "from 128 MiB"
        );
        let Err(BrickError::Memory { needed_mib, .. }) = plan(4096, 512, 2) else {
            panic!("4096² × 34 u16 is 1088 MiB")
        };
        assert!(
            plan(4096, needed_mib, 2).is_ok() && plan(4096, needed_mib - 1, 2).is_err(),
            "{needed_mib} MiB is the smallest size that works"
        );
    }
}
