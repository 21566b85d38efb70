//! Going on with a run that was killed: finding its last good checkpoint, and making the slabs again as they were then.
//!
//! Nothing of the slabs is kept on disk, since all of it can be had back: of level 0 the one or two slices behind the
//! last finished layer of bricks are read from the source again, and a coarser slab is the box filter of the level below,
//! whose finished layers are written (voxels are stored exactly) and whose other slices are in its own slab. At most three
//! layers of each level are read back.

use glam::{U64Vec3, UVec3};
use rayon::prelude::*;

use super::border::place_in_brick;
use super::checkpoint::{Parameters, State, version};
use super::downsample::{Mean, coarse_slices};
use super::encode::layer_order;
use super::error::BrickError;
use super::pipeline::downsample;
use super::plan::LevelPlan;
use super::slab::{Slab, complete_layers};
use super::stats::{Binned, Totals, own_voxels};
use crate::geom::{BRICK_EDGE, BrickGrid, BrickId, Lod, STORED_VOXELS};
use crate::store::reader::BrickReader;
use crate::store::{
    Checkpoint, Existing, Journal, StoreError, StoreWriter, Unfinished, Voxel, WrittenBricks,
};
use crate::volume::VolumeDesc;

use std::path::Path;

/// A killed run, ready to be gone on with.
pub struct Resumed<T> {
    /// How far it had come.
    pub state: State,
    /// Its statistics.
    pub totals: Totals<T>,
    /// Its files, to be written on. They stay when this is dropped, until `own_unfinished`.
    pub writer: StoreWriter,
    /// Its journal.
    pub journal: Journal,
    /// Its bricks.
    pub written: WrittenBricks,
}

/// What a run is that is to be gone on with.
pub struct Wanted<'a> {
    /// The store to be written.
    pub out: &'a Path,
    /// May it be replaced?
    pub existing: Existing,
    /// The volume.
    pub desc: &'a VolumeDesc,
    /// The levels, finest first.
    pub levels: &'a [LevelPlan],
    /// All that the store's bytes depend on.
    pub parameters: &'a Parameters,
}

impl Wanted<'_> {
    /// The run at its newest checkpoint that is whole; `None` when there is none.
    ///
    /// # Errors
    /// It was begun with other parameters, or its files are not what the journal speaks of. They are as they were then.
    pub fn find<T: Binned>(&self) -> Result<Option<Resumed<T>>, BrickError> {
        let Some(unfinished) = Unfinished::open(self.out, self.existing)? else {
            return Ok(None);
        };
        let grids: Vec<BrickGrid> = self.levels.iter().map(|l| l.grid).collect();
        let mut refused = None;
        for (slot, checkpoint) in unfinished.checkpoints()? {
            let found = self.state(&checkpoint).and_then(|found| {
                unfinished.check(&grids, &checkpoint)?;
                Ok(found)
            });
            match found {
                Ok((state, totals)) => {
                    let (writer, journal, written) =
                        unfinished.go_on(T::TYPE, &grids, (slot, &checkpoint))?;
                    return Ok(Some(Resumed {
                        state,
                        totals,
                        writer,
                        journal,
                        written,
                    }));
                }
                // The checkpoint before may still be good.
                Err(error @ BrickError::Store(StoreError::NotResumable { .. })) => {
                    refused.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        refused.map_or(Ok(None), Err)
    }

    /// What a checkpoint says, if it is one of this run and can be true.
    fn state<T: Binned>(&self, checkpoint: &Checkpoint) -> Result<(State, Totals<T>), BrickError> {
        let other = |differences: Vec<String>| BrickError::OtherRun {
            out: self.out.to_owned(),
            differences: differences.join("; "),
        };
        let impossible = || {
            BrickError::Store(StoreError::NotResumable {
                path: self.out.to_owned(),
                what: "its journal contradicts itself".into(),
            })
        };
        match State::version(&checkpoint.state) {
            Some(begun) if begun != version() => {
                return Err(other(vec![format!(
                    "the version of brickscope was {begun} and is {}",
                    version()
                )]));
            }
            _ => {}
        }
        let (state, counts) = State::decode(&checkpoint.state).ok_or_else(impossible)?;
        let differences = self.parameters.differences(&state.parameters);
        if !differences.is_empty() {
            return Err(other(differences));
        }
        if state.slices > self.desc.dims.z || checkpoint.mark.len() != self.levels.len() {
            return Err(impossible());
        }
        let mut slices = state.slices;
        for (l, (level, mark)) in self.levels.iter().zip(&checkpoint.mark).enumerate() {
            if l > 0 {
                slices = coarse_slice_count(level, self.levels[l - 1].grid.voxels.z, slices);
            }
            if mark.layers != complete_layers(level.grid.voxels.z, slices) {
                return Err(impossible());
            }
        }
        let dims = self.desc.dims;
        let bricked = dims
            .z
            .min(u64::from(checkpoint.mark[0].layers) * u64::from(BRICK_EDGE));
        let totals = Totals::restore(&state.totals, counts, dims.x * dims.y * bricked)
            .ok_or_else(impossible)?;
        Ok((state, totals))
    }
}

/// Slices of a level that are there when `slices` of the one below are, which has `depth` in all.
fn coarse_slice_count(level: &LevelPlan, depth: u64, slices: u64) -> u64 {
    if !level.halved.z {
        slices
    } else if slices == depth {
        depth.div_ceil(2)
    } else {
        slices / 2
    }
}

/// True when the bricks of the last finished layer of level 0 end with `slice`, the slice of the source that they should
/// end with. A source that was changed meanwhile without a sign is most likely found so.
///
/// # Errors
/// What is written is damaged.
pub fn source_is_the_same<T: Voxel>(
    slice: &[T],
    level: &LevelPlan,
    written: &mut WrittenBricks,
    batch: usize,
) -> Result<bool, BrickError> {
    let grid = level.grid;
    let width = grid.voxels.x as usize;
    let Some(layer) = written.layers(0).checked_sub(1) else {
        return Ok(true);
    };
    let mut is_same = true;
    let differs = |id: BrickId, voxels: &[T; STORED_VOXELS]| {
        let own = grid.brick_box(id.xyz);
        let size = own.size();
        (0..size.y).any(|y| {
            let from = place_in_brick(U64Vec3::new(0, y, size.z - 1));
            let to = (own.min.y + y) as usize * width + own.min.x as usize;
            let n = size.x as usize;
            let (stored, given) = (&voxels[from..from + n], &slice[to..to + n]);
            stored.iter().zip(given).any(|(a, &b)| !a.same_bits(b))
        })
    };
    let finished = FinishedLayer {
        written,
        grid,
        lod: Lod(0),
        layer,
        batch,
    };
    finished.each(differs, |_, differs| is_same &= !differs)?;
    Ok(is_same)
}

/// Makes the slabs above level 0 again. That of level 0 must be as it was.
///
/// # Errors
/// What is written is damaged.
pub fn rebuild_slabs<T: Mean>(
    levels: &[LevelPlan],
    slabs: &mut [Slab<T>],
    written: &mut WrittenBricks,
    batch: usize,
) -> Result<(), BrickError> {
    for (l, plan) in levels.iter().enumerate().skip(1) {
        let (fine, coarse) = slabs.split_at_mut(l);
        rebuild_slab(plan, &fine[l - 1], &mut coarse[0], (l, written), batch)?;
    }
    Ok(())
}

fn rebuild_slab<T: Mean>(
    plan: &LevelPlan,
    fine: &Slab<T>,
    coarse: &mut Slab<T>,
    (l, written): (usize, &mut WrittenBricks),
    batch: usize,
) -> Result<(), BrickError> {
    let (edge, fine_depth) = (u64::from(BRICK_EDGE), fine.dims().z);
    let factor = if plan.halved.z { 2 } else { 1 };
    let goal = coarse_slice_count(plan, fine_depth, fine.next_z());
    let layer = complete_layers(coarse.dims().z, goal);
    coarse.go_on(layer, goal);
    let first = coarse.first_z();
    if first == goal {
        return Ok(());
    }
    // Those that the finished layers of the finer level hold: these layers end at a multiple of 32, or with the level.
    let finished = written.layers(l - 1);
    let in_bricks = goal.min(
        (u64::from(finished) * edge)
            .min(fine_depth)
            .div_ceil(factor),
    );
    coarse.go_on(layer, in_bricks);
    let (halve, width) = (plan.halved, coarse.dims().x as usize);
    let finer = BrickGrid::for_voxels(fine.dims()).expect("invariant: the plan made this grid");
    let filter = |id: BrickId, voxels: &[T; STORED_VOXELS]| {
        let size = finer
            .brick_box(id.xyz)
            .size()
            .to_array()
            .map(|n| n as usize);
        let (mut own, mut filtered) = (Vec::new(), Vec::new());
        own_voxels(voxels, size, &mut own);
        coarse_slices(&own, size, halve.into(), |slice| {
            filtered.extend_from_slice(slice)
        });
        filtered
    };
    for layer in (first * factor / edge) as u32..finished {
        let finished = FinishedLayer {
            written,
            grid: finer,
            lod: Lod(l as u8 - 1),
            layer,
            batch,
        };
        finished.each(filter, |id, part| {
            let own = finer.brick_box(id.xyz);
            let shift = |v: U64Vec3| U64Vec3::select(halve, (v + 1) / 2, v);
            let (min, max) = (shift(own.min), shift(own.max));
            let row = (max.x - min.x) as usize;
            let rows = (min.z..max.z).flat_map(|z| (min.y..max.y).map(move |y| (z, y)));
            for ((z, y), from) in rows.zip(part.chunks_exact(row)) {
                if (first..in_bricks).contains(&z) {
                    let to = y as usize * width + min.x as usize;
                    coarse.slice_mut(z)[to..to + row].copy_from_slice(from);
                }
            }
        })?;
    }
    for z in in_bricks..goal {
        let last_fine = (z * factor + factor - 1).min(fine_depth - 1);
        downsample(fine, last_fine, plan, coarse);
    }
    Ok(())
}

/// A layer of bricks that is written.
struct FinishedLayer<'a> {
    written: &'a mut WrittenBricks,
    grid: BrickGrid,
    lod: Lod,
    layer: u32,
    /// Bricks that are read at once.
    batch: usize,
}

impl FinishedLayer<'_> {
    /// Reads the bricks back: `work` on every one on all threads, then `take` what came of it, one after another.
    fn each<T: Voxel, R: Send>(
        self,
        work: impl Fn(BrickId, &[T; STORED_VOXELS]) -> R + Sync,
        mut take: impl FnMut(BrickId, R),
    ) -> Result<(), BrickError> {
        for places in layer_order(&self.grid).chunks(self.batch.max(1)) {
            let bricks = places
                .iter()
                .map(|&[x, y]| BrickId::new(self.lod, UVec3::new(x, y, self.layer)))
                .map(|id| self.written.fetch(id))
                .collect::<Result<Vec<_>, _>>()?;
            let written = &*self.written;
            let buffers = || (BrickReader::new(), Box::new([T::default(); STORED_VOXELS]));
            let results = bricks
                .par_iter()
                .map_init(buffers, |(reader, voxels), brick| {
                    let reader = reader.as_mut().map_err(|error| BrickError::System {
                        doing: "prepare decompression",
                        error: error.kind().into(),
                    })?;
                    brick
                        .decode(reader, voxels)
                        .map_err(|fault| written.fault(fault))?;
                    Ok((brick.id(), work(brick.id(), voxels)))
                })
                .collect::<Result<Vec<_>, BrickError>>()?;
            for (id, result) in results {
                take(id, result);
            }
        }
        Ok(())
    }
}
