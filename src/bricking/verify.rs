//! Checks a whole store: everything that `store::verify` checks, and against the formulas that made it: borders against
//! the neighbours, each level against the box filter of the one below, statistics and hash against the voxels.
//!
//! Works in tiles of 4³ bricks on all threads of rayon's pool; a thread takes about 20 MiB (u8, u16) or 40 MiB (f32),
//! whatever the volume's size. Nothing is taken from the store that is not checked, and no formula is written twice: the
//! pipeline and this use the same ones.

use std::sync::{Mutex, PoisonError};

use glam::{U64Vec3, UVec3};
use rayon::prelude::*;

use super::border::{self, Window};
use super::downsample::{Mean, coarse_slices};
use super::error::BrickError;
use super::progress::Progress;
use super::stats::{Binned, Tally, Totals, own_voxels};
use crate::geom::{BRICK_BORDER, BRICK_EDGE, BrickGrid, BrickId, Lod, STORED_VOXELS, VoxelBox};
use crate::store::error::{Fault, Part};
use crate::store::verify::{BrickChecker, layout};
use crate::store::{Store, Voxel};
use crate::volume::StoredType;

/// Bricks along a tile's edge.
const TILE: u32 = 4;

/// What a check found.
#[derive(Clone, Debug, PartialEq)]
pub struct VerifyReport {
    /// Bricks checked, of all levels.
    pub bricks: u64,
    /// What is wrong, by place in the file; at most as many as were asked for.
    pub faults: Vec<Fault>,
    /// How many things are wrong.
    pub fault_count: u64,
}

/// Checks all of `store`, keeping at most `limit` faults. When an index is damaged, that is all that is told.
///
/// # Errors
/// The system has no memory. Faults of the store are not errors but the result.
pub fn verify(
    store: &Store,
    limit: usize,
    progress: &dyn Progress,
) -> Result<VerifyReport, BrickError> {
    match store.stored_type() {
        StoredType::U8 => run::<u8>(store, limit, progress),
        StoredType::U16 => run::<u16>(store, limit, progress),
        StoredType::F32 => run::<f32>(store, limit, progress),
    }
}

fn run<T: Mean + Binned>(
    store: &Store,
    limit: usize,
    progress: &dyn Progress,
) -> Result<VerifyReport, BrickError> {
    let bricks: u64 = levels(store).map(|lod| store.level(lod).grid.len()).sum();
    let brick_bytes = (STORED_VOXELS * store.stored_type().size()) as u64;
    let faults = Faults::new(limit);
    for fault in levels(store).filter_map(|lod| store.index_fault(lod)) {
        faults.add(fault.clone());
    }
    if !faults.is_empty() {
        // Nothing can be said of bricks whose entries are not what was written.
        return Ok(faults.report(bricks));
    }
    progress.begin("verifying", bricks * brick_bytes);
    for fault in layout(store, limit) {
        faults.add(fault);
    }
    let pool = Pool::<T>::default();
    let totals = Totals::new();
    for lod in levels(store) {
        let tiles = tiles_of(&store.level(lod).grid);
        (0..tiles.len()).into_par_iter().try_for_each(|i| {
            pool.with(|scratch| {
                let tile = Tile::new(store, lod, tiles.xyz(i));
                let checked = tile.check(scratch, &totals, &faults);
                progress.advance(checked * brick_bytes);
            })
        })?;
    }
    for lod in levels(store).skip(1) {
        let grid = store.level(lod).grid;
        (0..grid.len()).into_par_iter().try_for_each(|i| {
            pool.with(|scratch| {
                check_level(store, BrickId::new(lod, grid.xyz(i)), scratch, &faults)
            })
        })?;
    }
    progress.end();
    pool.give_tallies(&totals);
    // With bricks missing the statistics can only differ.
    if faults.is_empty() {
        check_statistics(store, totals, &faults);
    }
    Ok(faults.report(bricks))
}

fn levels(store: &Store) -> impl Iterator<Item = Lod> {
    (0..store.levels()).map(|l| Lod(l as u8))
}

/// The grid of tiles: a grid whose "voxels" are as many as make one brick per tile.
fn tiles_of(grid: &BrickGrid) -> BrickGrid {
    let tiles = UVec3::from_array(grid.bricks.to_array().map(|n| n.div_ceil(TILE)));
    BrickGrid {
        voxels: tiles.as_u64vec3() * u64::from(BRICK_EDGE),
        bricks: tiles,
    }
}

/// Faults found by all threads.
struct Faults {
    limit: usize,
    found: Mutex<(Vec<Fault>, u64)>,
}

impl Faults {
    fn new(limit: usize) -> Self {
        Self {
            limit,
            found: Mutex::new((Vec::new(), 0)),
        }
    }

    fn add(&self, fault: Fault) {
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        found.1 += 1;
        if found.0.len() < self.limit {
            found.0.push(fault);
        }
    }

    fn is_empty(&self) -> bool {
        let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        found.1 == 0
    }

    fn report(self, bricks: u64) -> VerifyReport {
        let found = self.found.into_inner();
        let (mut faults, fault_count) = found.unwrap_or_else(PoisonError::into_inner);
        faults.sort_by_key(|f| f.offset);
        VerifyReport {
            bricks,
            faults,
            fault_count,
        }
    }
}

/// Buffers of a thread.
struct Scratch<T> {
    checker: BrickChecker<T>,
    tally: Tally<T>,
    /// The tile's own bricks; `None` where damaged.
    own: Vec<Option<Box<[T; STORED_VOXELS]>>>,
    spare: Vec<Box<[T; STORED_VOXELS]>>,
    window: Vec<T>,
    rows: Vec<T>,
}

impl<T: Binned> Scratch<T> {
    fn new() -> std::io::Result<Self> {
        Ok(Self {
            checker: BrickChecker::new()?,
            tally: Tally::new(),
            own: Vec::new(),
            spare: Vec::new(),
            window: Vec::new(),
            rows: Vec::new(),
        })
    }

    fn brick(&mut self) -> Box<[T; STORED_VOXELS]> {
        self.spare
            .pop()
            .unwrap_or_else(|| Box::new([T::default(); STORED_VOXELS]))
    }
}

/// Lends each thread a scratch.
struct Pool<T>(Mutex<Vec<Scratch<T>>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T: Binned> Pool<T> {
    fn with(&self, work: impl FnOnce(&mut Scratch<T>)) -> Result<(), BrickError> {
        let lent = self.lock().pop();
        let mut scratch = match lent {
            Some(scratch) => scratch,
            None => Scratch::new().map_err(|error| BrickError::System {
                doing: "prepare decompression",
                error,
            })?,
        };
        work(&mut scratch);
        self.lock().push(scratch);
        Ok(())
    }

    fn give_tallies(&self, totals: &Totals<T>) {
        for scratch in self.lock().iter_mut() {
            scratch.tally.give(totals);
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Scratch<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// 4³ bricks and the ones around them.
struct Tile<'a> {
    store: &'a Store,
    lod: Lod,
    grid: BrickGrid,
    /// The tile's own bricks: `first` inclusive, `end` exclusive.
    first: UVec3,
    end: UVec3,
}

impl<'a> Tile<'a> {
    fn new(store: &'a Store, lod: Lod, tile: UVec3) -> Self {
        let grid = store.level(lod).grid;
        let first = tile * TILE;
        Self {
            store,
            lod,
            grid,
            first,
            end: (first + TILE).min(grid.bricks),
        }
    }

    /// Reads the tile's bricks and their neighbours, and checks each brick by itself and its border; returns how many.
    fn check<T: Binned>(
        &self,
        scratch: &mut Scratch<T>,
        totals: &Totals<T>,
        faults: &Faults,
    ) -> u64 {
        let held = self.held();
        let mut window = std::mem::take(&mut scratch.window);
        let count = held.voxel_count().expect("invariant: a tile is small");
        window.resize(count as usize, T::default());
        let mut damaged = Vec::new();
        let around = self.first.saturating_sub(UVec3::ONE);
        for xyz in boxed(around, (self.end + 1).min(self.grid.bricks)) {
            let id = BrickId::new(self.lod, xyz);
            let is_own = xyz.cmpge(self.first).all() && xyz.cmplt(self.end).all();
            let mut voxels = scratch.brick();
            let read = if is_own {
                scratch.checker.check(self.store, id, &mut voxels)
            } else {
                scratch.checker.read(self.store, id, &mut voxels)
            };
            match read {
                Ok(()) => {
                    self.place(&voxels, xyz, &held, &mut window);
                    if is_own {
                        self.count(&voxels, xyz, scratch, totals);
                        scratch.own.push(Some(voxels));
                    } else {
                        scratch.spare.push(voxels);
                    }
                }
                Err(fault) => {
                    damaged.push(xyz);
                    scratch.spare.push(voxels);
                    if is_own {
                        // Of the others their own tile tells.
                        faults.add(fault);
                        scratch.own.push(None);
                    }
                }
            }
        }
        let whole = Window {
            level: self.grid.voxels,
            held,
            voxels: &window,
        };
        self.check_borders(&whole, &damaged, scratch, faults);
        scratch.window = window;
        let size = (self.end - self.first).as_u64vec3();
        size.x * size.y * size.z
    }

    /// The tile's voxels and those around them.
    fn held(&self) -> VoxelBox {
        let (edge, border) = (u64::from(BRICK_EDGE), u64::from(BRICK_BORDER));
        VoxelBox::new(
            (self.first.as_u64vec3() * edge).saturating_sub(U64Vec3::splat(border)),
            (self.end.as_u64vec3() * edge + border).min(self.grid.voxels),
        )
    }

    /// Copies what a brick owns of the window to its place.
    fn place<T: Voxel>(
        &self,
        brick: &[T; STORED_VOXELS],
        xyz: UVec3,
        held: &VoxelBox,
        window: &mut [T],
    ) {
        let part = self.grid.brick_box(xyz).intersection(held);
        let start = xyz.as_u64vec3() * u64::from(BRICK_EDGE);
        let size = held.size();
        let len = part.size().x as usize;
        for z in part.min.z..part.max.z {
            for y in part.min.y..part.max.y {
                let from = border::place_in_brick(U64Vec3::new(part.min.x, y, z) - start);
                let to = U64Vec3::new(part.min.x, y, z) - held.min;
                let to = ((to.z * size.y + to.y) * size.x + to.x) as usize;
                window[to..to + len].copy_from_slice(&brick[from..from + len]);
            }
        }
    }

    fn count<T: Binned>(
        &self,
        voxels: &[T; STORED_VOXELS],
        xyz: UVec3,
        scratch: &mut Scratch<T>,
        totals: &Totals<T>,
    ) {
        if self.lod == Lod(0) {
            let size = self.grid.brick_box(xyz).size().to_array();
            let size = size.map(|n| n as usize);
            scratch
                .tally
                .add(self.grid.index(xyz), size, voxels, totals);
        }
    }

    /// Compares each brick with what would be cut out of the window.
    fn check_borders<T: Binned>(
        &self,
        window: &Window<'_, T>,
        damaged: &[UVec3],
        scratch: &mut Scratch<T>,
        faults: &Faults,
    ) {
        let mut expected = scratch.brick();
        let own = std::mem::take(&mut scratch.own);
        for (xyz, brick) in boxed(self.first, self.end).zip(own) {
            let Some(brick) = brick else { continue };
            let beside_damage = damaged
                .iter()
                .any(|d| d.as_i64vec3().chebyshev_distance(xyz.as_i64vec3()) <= 1);
            if !beside_damage {
                border::cut(window, xyz, &mut expected);
                let differs = (0..STORED_VOXELS).find(|&i| !brick[i].same_bits(expected[i]));
                if let Some(i) = differs {
                    let place = [i % 34, i / 34 % 34, i / (34 * 34)];
                    faults.add(Fault::new(
                        Part::Brick(BrickId::new(self.lod, xyz)),
                        record_offset(self.store, BrickId::new(self.lod, xyz)),
                        format!(
                            "border voxel {place:?} of 34³ to be {}, as its neighbour has it",
                            expected[i]
                        ),
                        brick[i].to_string(),
                    ));
                }
            }
            scratch.spare.push(brick);
        }
        scratch.spare.push(expected);
    }
}

/// Places from `first` (inclusive) to `end` (exclusive), x fastest.
fn boxed(first: UVec3, end: UVec3) -> impl Iterator<Item = UVec3> {
    (first.z..end.z).flat_map(move |z| {
        (first.y..end.y).flat_map(move |y| (first.x..end.x).map(move |x| UVec3::new(x, y, z)))
    })
}

/// Where a brick's record is; for a Constant one the end of the header, where records begin.
fn record_offset(store: &Store, id: BrickId) -> u64 {
    store
        .entry(id)
        .record
        .map_or(crate::store::header::HEADER_LEN as u64, |r| r.offset)
}

/// Compares a brick of a coarse level with the box filter of the level below.
fn check_level<T: Mean + Binned>(
    store: &Store,
    id: BrickId,
    scratch: &mut Scratch<T>,
    faults: &Faults,
) {
    let finer = Lod(id.lod.0 - 1);
    let (coarse, fine) = (store.level(id.lod), store.level(finer));
    let halved = (coarse.scale / fine.scale).cmpgt(glam::DVec3::ONE);
    let factor = U64Vec3::select(
        glam::BVec3::new(halved.x, halved.y, halved.z),
        U64Vec3::splat(2),
        U64Vec3::ONE,
    );
    let own = coarse.grid.brick_box(id.xyz);
    let from = VoxelBox::new(own.min * factor, (own.max * factor).min(fine.grid.voxels));
    let size = from.size();
    let mut window = std::mem::take(&mut scratch.window);
    let count = from.voxel_count().expect("invariant: 64³ at most");
    window.resize(count as usize, T::default());
    let tile = Tile {
        store,
        lod: finer,
        grid: fine.grid,
        first: UVec3::ZERO,
        end: UVec3::ZERO,
    };
    let mut brick = scratch.brick();
    let first = (from.min / u64::from(BRICK_EDGE)).as_uvec3();
    let last = ((from.max - 1) / u64::from(BRICK_EDGE)).as_uvec3();
    let mut is_whole = true;
    for xyz in boxed(first, last + 1) {
        match scratch
            .checker
            .read(store, BrickId::new(finer, xyz), &mut brick)
        {
            Ok(()) => tile.place(&brick, xyz, &from, &mut window),
            // Told already, as is damage of the coarse brick itself.
            Err(_) => is_whole = false,
        }
    }
    is_whole &= scratch.checker.read(store, id, &mut brick).is_ok();
    if is_whole {
        let own_size = own.size().to_array().map(|n| n as usize);
        own_voxels(&brick, own_size, &mut scratch.rows);
        if let Some((at, expected)) = first_difference(&window, size, factor, &scratch.rows) {
            let place = U64Vec3::new(
                (at % own_size[0]) as u64,
                (at / own_size[0] % own_size[1]) as u64,
                (at / own_size[0] / own_size[1]) as u64,
            );
            faults.add(Fault::new(
                Part::Brick(id),
                record_offset(store, id),
                format!("voxel {place} to be {expected}, the mean of the voxels of {finer}"),
                scratch.rows[at].to_string(),
            ));
        }
    }
    scratch.spare.push(brick);
    scratch.window = window;
}

/// The first voxel of `coarse` that is not the box filter of `fine` (of `size` voxels): its place, and what it should be.
fn first_difference<T: Mean>(
    fine: &[T],
    size: U64Vec3,
    factor: U64Vec3,
    coarse: &[T],
) -> Option<(usize, T)> {
    let halve = factor.to_array().map(|f| f == 2);
    let (mut at, mut different) = (0, None);
    coarse_slices(fine, size.to_array().map(|n| n as usize), halve, |slice| {
        if different.is_none() {
            different = slice
                .iter()
                .zip(&coarse[at..])
                .position(|(expected, &found)| !expected.same_bits(found))
                .map(|i| (at + i, slice[i]));
        }
        at += slice.len();
    });
    different
}

fn check_statistics<T: Binned>(store: &Store, totals: Totals<T>, faults: &Faults) {
    let (meta, summary) = (store.meta(), totals.summary());
    let offset = store.header().metadata_offset;
    let differ = |what: &str, expected: String, found: String| {
        if expected != found {
            let expected = format!("{what} {expected}, as the voxels have it");
            faults.add(Fault::new(Part::Metadata, offset, expected, found));
        }
    };
    differ(
        "source hash",
        format!("{:016x}", summary.hash),
        format!("{:016x}", meta.source_hash),
    );
    differ(
        "value range",
        format!("{} to {}", summary.min, summary.max),
        format!("{} to {}", meta.value_min, meta.value_max),
    );
    differ(
        "percentiles",
        format!("{:?}", summary.percentiles),
        format!("{:?}", meta.percentiles),
    );
    if summary.histogram != meta.histogram {
        differ(
            "a histogram of the voxels",
            String::new(),
            "another one".into(),
        );
    }
}
