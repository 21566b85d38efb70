//! A volume that is paged: the pager's plans carried out between store, decode threads, host memory and the device.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use std::time::Duration;

use glam::DVec3;

use crate::classify::Visibility;
use crate::geom::{BLOCKS_PER_BRICK, BRICK_EDGE, BrickGrid, BrickId, Lod, STORED_VOXELS};
use crate::gpu::{GpuContext, Staging};
use crate::pager::{
    Completion, FrameRequests, Loaded, Loader, Pager, PagerBudget, Priority, Request, RequestClass,
    SlotId, SlotPool, StepLimits, Upload, scan,
};
use crate::render::{Activity, AtlasPlan, ExtremeCodes, MissedBrick, Residency};
use crate::scene::RayFrame;
use crate::store::{BrickData, Store, StoreError};

use super::super::{EngineError, EngineOptions};
use super::classification::{ClassifiedBricks, KnownRanges, SeenLevels};
use super::waits::Waits;

/// Decoded bricks on their way at once, per thread: enough work while a frame is drawn and nobody orders more.
const LOADS_PER_THREAD: usize = 16;
/// Bricks copied into the atlas at once: whole rows of every voxel type (7, 3 or 1 to a row).
const UPLOAD_GROUP: usize = 21;

/// What loading cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Traffic {
    pub(super) bricks_read: u64,
    pub(super) bricks_uploaded: u64,
    pub(super) bricks_evicted: u64,
    pub(super) bytes_read: u64,
    pub(super) bytes_decompressed: u64,
    pub(super) bytes_uploaded: u64,
}

impl Traffic {
    /// What was added since `before`.
    pub(super) fn since(self, before: Self) -> Self {
        self.with(before, |now, before| now - before)
    }

    /// Both together.
    pub(super) fn plus(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }

    fn with(self, other: Self, of: impl Fn(u64, u64) -> u64) -> Self {
        Self {
            bricks_read: of(self.bricks_read, other.bricks_read),
            bricks_uploaded: of(self.bricks_uploaded, other.bricks_uploaded),
            bricks_evicted: of(self.bricks_evicted, other.bricks_evicted),
            bytes_read: of(self.bytes_read, other.bytes_read),
            bytes_decompressed: of(self.bytes_decompressed, other.bytes_decompressed),
            bytes_uploaded: of(self.bytes_uploaded, other.bytes_uploaded),
        }
    }
}

/// Store, pager, host memory and atlas of one volume.
#[derive(Debug)]
pub(super) struct PagedVolume {
    store: Arc<Store>,
    grids: Vec<BrickGrid>,
    pub(super) residency: Residency,
    staging: Staging,
    pager: Pager,
    loader: Loader,
    /// Decoded bricks: exactly those of which the pager says so.
    ram: HashMap<BrickId, Arc<BrickData>>,
    /// Block ranges of the bricks in slots: a new classification needs them, not the voxels.
    ranges: KnownRanges,
    in_slot: Vec<Option<BrickId>>,
    /// By level, of those that are sampled.
    seen: SeenLevels,
    levels_entered: BTreeSet<Lod>,
    pinned: usize,
    completions: Vec<Completion>,
    /// Placed, and not yet copied into their slots.
    uploads: Vec<(Upload, Arc<BrickData>)>,
    failures: BTreeMap<BrickId, StoreError>,
    pub(super) traffic: Traffic,
    /// Only where the options ask for it.
    pub(super) waits: Option<Waits>,
}

impl PagedVolume {
    pub(super) fn new(
        gpu: &GpuContext,
        store: &Arc<Store>,
        options: &EngineOptions,
        plan: AtlasPlan,
        staging_bytes: u64,
    ) -> Result<Self, EngineError> {
        let grids: Vec<BrickGrid> = (0..store.levels())
            .map(|l| store.level(Lod(l as u8)).grid)
            .collect();
        let stored = store.meta().stored_type;
        let meta = store.meta();
        let codes = ExtremeCodes::new([meta.value_min as f32, meta.value_max as f32]);
        let residency = Residency::new(gpu, stored, options.filter, plan, grids.clone(), codes)?;
        let staging = Staging::new(gpu, Residency::staging_chunk_bytes(), staging_bytes);
        let count = plan.slot_count().min(options.max_slots.unwrap_or(u64::MAX)) as u32;
        let slots = match options.slot_order_seed {
            0 => SlotPool::new(count),
            seed => SlotPool::with_order(shuffled_slots(count, seed)),
        };
        let brick_bytes =
            (STORED_VOXELS * stored.size() + size_of::<[[f32; 2]; BLOCKS_PER_BRICK]>()) as u64;
        let max_decoding = options.decode_threads * LOADS_PER_THREAD;
        let mut pager = Pager::new(
            slots,
            PagerBudget {
                ram_bytes: options.ram_bytes,
                in_flight_bytes: max_decoding as u64 * brick_bytes,
                max_decoding,
                brick_bytes,
            },
        );
        let coarsest = Lod(store.levels() as u8 - 1);
        store.check_level(coarsest)?;
        let pins: Vec<BrickId> = store
            .bricks(coarsest)
            .filter(|&b| !store.entry(b).constant)
            .collect();
        // Of a store with few levels the coarsest may be anything: then nothing is pinned.
        let pinned = if pins.len() as u64 * 4 <= u64::from(count) {
            pager.pin(&pins)?;
            pins.len()
        } else {
            0
        };
        Ok(Self {
            store: Arc::clone(store),
            grids,
            residency,
            staging,
            pager,
            loader: match &options.read_hook {
                None => Loader::new(Arc::clone(store), options.decode_threads),
                Some(hook) => {
                    let hook = Arc::clone(&hook.0);
                    Loader::with_hook(Arc::clone(store), options.decode_threads, hook)
                }
            }
            .map_err(EngineError::Loader)?,
            ram: HashMap::new(),
            ranges: KnownRanges::new(),
            in_slot: vec![None; plan.slot_count() as usize],
            seen: SeenLevels::new(),
            levels_entered: BTreeSet::new(),
            pinned,
            completions: Vec::new(),
            uploads: Vec::new(),
            failures: BTreeMap::new(),
            traffic: Traffic::default(),
            waits: options.keep_waits.then(Waits::default),
        })
    }

    /// Slots that are not pinned.
    pub(super) fn free_capacity(&self) -> usize {
        self.pager.capacity() - self.pinned
    }

    /// Slots in use by the pager, pinned ones included.
    pub(super) fn capacity(&self) -> usize {
        self.pager.capacity()
    }

    /// Bytes of staging.
    pub(super) fn staging_bytes(&self) -> u64 {
        self.staging.bytes()
    }

    /// What is known of resident bricks, and under which classification the tables are: what
    /// [`ClassifiedBricks::new`] needs.
    pub(super) fn known(&self) -> (&KnownRanges, &SeenLevels) {
        (&self.ranges, &self.seen)
    }

    /// Makes the tables right for `levels`. `classified` was worked out from [`Self::known`] of some time ago: bricks that
    /// came since are looked at now. No voxel is uploaded.
    ///
    /// # Errors
    /// The index is damaged, or the device is lost.
    pub(super) fn classify(
        &mut self,
        gpu: &GpuContext,
        rays: &RayFrame,
        levels: &SeenLevels,
        classified: &ClassifiedBricks,
    ) -> Result<(), EngineError> {
        for level in &rays.levels {
            self.enter_level(gpu, level.lod)?;
        }
        for (lod, _) in std::mem::replace(&mut self.seen, levels.clone()) {
            if !levels.contains_key(&lod) {
                // Only stands in for finer levels: nothing of it is known to be empty.
                let bricks = self.grids[usize::from(lod.0)].len() as usize;
                let unknown = Activity::pack(&vec![Activity::Unknown; bricks]);
                self.residency.set_level_activity(lod, &unknown);
            }
        }
        for (&lod, packed) in &classified.levels {
            self.residency.set_level_activity(lod, packed);
        }
        let mut resident: Vec<(BrickId, SlotId)> = self
            .pager
            .resident()
            .filter(|(b, _)| classified.levels.contains_key(&b.lod))
            .collect();
        resident.sort_unstable_by_key(|(b, _)| *b);
        for (brick, slot) in resident {
            let Some(seen) = self.seen.get(&brick.lod) else {
                continue;
            };
            let entry = self.store.entry(brick);
            let activity = match seen.of_range([entry.min, entry.max]) {
                Activity::Unknown => match classified.resident.get(&brick) {
                    Some(&activity) => activity,
                    None => seen.of_brick([entry.min, entry.max], self.ranges.get(&brick)),
                },
                empty => empty,
            };
            self.residency
                .set_activity(gpu, brick, activity, Some(slot));
        }
        self.residency.write_activity(gpu);
        self.staging.submit(gpu)?;
        Ok(())
    }

    /// Enters what the index tells of a level, whatever the classification.
    fn enter_level(&mut self, gpu: &GpuContext, lod: Lod) -> Result<(), EngineError> {
        if !self.levels_entered.insert(lod) {
            return Ok(());
        }
        self.store.check_level(lod)?;
        let constants = scan(&self.store, lod, &Visibility::All)
            .filter(|b| b.constant)
            .map(|b| (b.index, b.range[0]));
        self.residency
            .set_constants(gpu, &mut self.staging, lod, constants)?;
        let ranges = scan(&self.store, lod, &Visibility::All).map(|b| b.range);
        self.residency.set_extremes(gpu, lod, ranges);
        Ok(())
    }

    /// The bricks that were in these slots when the dispatch ran that reports them.
    pub(super) fn bricks_in(&self, slots: &[SlotId]) -> Vec<BrickId> {
        let mut bricks: Vec<BrickId> = slots
            .iter()
            .filter_map(|slot| self.in_slot[slot.0 as usize])
            .collect();
        bricks.sort_unstable();
        bricks
    }

    /// Requests for what rays missed: what stops most rays first, then coarse before fine, then near before far
    /// (design.md §7).
    pub(super) fn requests(
        &self,
        rays: &RayFrame,
        class: RequestClass,
        missed: &[MissedBrick],
    ) -> Vec<Request> {
        missed
            .iter()
            .map(|m| {
                let brick = self.residency.brick(m.number);
                self.request(rays, class, brick, m.rays)
            })
            .collect()
    }

    pub(super) fn request(
        &self,
        rays: &RayFrame,
        class: RequestClass,
        brick: BrickId,
        stopped: u32,
    ) -> Request {
        let level = rays.levels.iter().find(|l| l.lod == brick.lod);
        let middle = (brick.xyz.as_dvec3() + DVec3::splat(0.5)) * f64::from(BRICK_EDGE);
        let distance_mm = level.map_or(0.0, |l| {
            let world = l.world_from_level.transform_point3(middle);
            world.distance(rays.world_from_view.translation)
        });
        // In steps: what matters is the order.
        let distance = (distance_mm / rays.step_mm_exact).min(f64::from(u32::MAX)) as u32;
        Request {
            priority: Priority::new(class, stopped, brick.lod, distance),
            brick,
        }
    }

    /// Declares what the next dispatch needs.
    pub(super) fn begin_frame(&mut self, frame: &FrameRequests<'_>) {
        self.pager.begin_frame(frame);
        if let Some(waits) = &mut self.waits {
            let needed = |r: &&Request| r.priority.class < RequestClass::Predicted;
            let asked = frame.requests.iter().filter(needed).map(|r| r.brick);
            let all = asked.chain(frame.held.iter().copied());
            waits.wanted(all.filter(|&brick| self.pager.slot(brick).is_none()));
        }
        self.cancel_unwanted();
    }

    /// Other predicted bricks take the place of those that the last frame asked for.
    pub(super) fn predict(&mut self, requests: &[Request]) {
        self.pager.predict(requests);
        self.cancel_unwanted();
    }

    fn cancel_unwanted(&mut self) {
        let unwanted = self.pager.unwanted_orders();
        let unwanted: Vec<BrickId> = unwanted.chain(self.pager.yielding_orders()).collect();
        for brick in unwanted {
            if self.loader.cancel(brick) {
                self.completions.push(Completion::Cancelled(brick));
            }
        }
    }

    /// Everything that will get a slot in this frame has one: a dispatch may run.
    pub(super) fn is_placed(&self) -> bool {
        self.pager.is_placed()
    }

    /// Nothing is on its way, and nothing more can be loaded for this frame.
    pub(super) fn is_idle(&self) -> bool {
        self.pager.is_idle() && self.completions.is_empty()
    }

    /// The level that stands in for a missing brick, at its middle; `None` where nothing is there.
    pub(super) fn stand_in(&self, brick: BrickId) -> Option<Lod> {
        let scale = |lod: Lod| self.store.level(lod).scale;
        let edge = f64::from(BRICK_EDGE);
        let middle = (brick.xyz.as_dvec3() + 0.5) * edge * scale(brick.lod);
        (brick.lod.0 + 1..self.grids.len() as u8)
            .map(Lod)
            .find(|&lod| {
                let grid = &self.grids[usize::from(lod.0)];
                let last = (grid.bricks - 1).as_dvec3();
                let place = (middle / scale(lod) / edge).floor().min(last);
                let coarser = BrickId::new(lod, place.as_uvec3());
                self.pager.slot(coarser).is_some() || self.store.entry(coarser).constant
            })
    }

    /// Loads and places what was asked for until nothing more of it can be had.
    ///
    /// # Errors
    /// The device is lost. Bricks that can't be read are kept for [`Self::failures`].
    pub(super) fn settle(&mut self, gpu: &GpuContext) -> Result<(), EngineError> {
        loop {
            self.step(gpu, u64::MAX)?;
            if self.pager.is_placed() {
                break;
            }
            if self.completions.is_empty() {
                let Some(loaded) = self.loader.receive() else {
                    break;
                };
                self.receive(loaded);
                self.receive_ready();
            }
        }
        self.write(gpu)?;
        self.staging.submit(gpu)?;
        Ok(())
    }

    /// One step without waiting: takes what finished, places at most `upload_bytes`, orders more.
    ///
    /// # Errors
    /// The device is lost.
    pub(super) fn advance(
        &mut self,
        gpu: &GpuContext,
        upload_bytes: u64,
    ) -> Result<(), EngineError> {
        self.receive_ready();
        self.step(gpu, upload_bytes)?;
        self.write(gpu)?;
        self.staging.submit(gpu)?;
        Ok(())
    }

    /// Waits at most so long for a brick to come from disk.
    pub(super) fn wait_for_one(&mut self, time: Duration) {
        if let Some(loaded) = self.loader.receive_timeout(time) {
            self.receive(loaded);
        }
    }

    fn receive_ready(&mut self) {
        while let Some(loaded) = self.loader.try_receive() {
            self.receive(loaded);
        }
    }

    fn receive(&mut self, (brick, result): Loaded) {
        match result {
            Ok(data) => {
                self.traffic.bricks_read += 1;
                self.traffic.bytes_decompressed += data.voxels.len() as u64;
                let record = self.store.entry(brick).record;
                self.traffic.bytes_read += record.map_or(0, |r| u64::from(r.len));
                self.ram.insert(brick, Arc::new(data));
                self.completions.push(Completion::Decoded(brick));
            }
            Err(error) => {
                self.failures.insert(brick, error);
                self.completions.push(Completion::Failed(brick));
            }
        }
    }

    /// Carries out one plan of the pager.
    fn step(&mut self, gpu: &GpuContext, upload_bytes: u64) -> Result<(), EngineError> {
        let limits = StepLimits { upload_bytes };
        let plan = self.pager.step(&self.completions, limits);
        self.completions.clear();
        for patch in &plan.patches {
            if patch.slot.is_none() {
                self.left(gpu, patch.brick);
            }
        }
        // A brick that came and went again within the plan has no slot of its own any more.
        for upload in plan.upload {
            let data = self
                .ram
                .get(&upload.brick)
                .expect("invariant: a placed brick has a copy in host memory");
            self.uploads.push((upload, Arc::clone(data)));
            self.came(gpu, upload);
        }
        self.traffic.bricks_evicted += plan.evicted;
        self.residency
            .apply_patches(gpu, &mut self.staging, &plan.patches)?;
        for brick in plan.release {
            self.ram.remove(&brick);
        }
        for brick in plan.load {
            self.loader.order(brick);
        }
        if self.uploads.len() >= UPLOAD_GROUP {
            self.write(gpu)?;
        }
        Ok(())
    }

    fn came(&mut self, gpu: &GpuContext, upload: Upload) {
        let Upload { brick, slot } = upload;
        self.in_slot[slot.0 as usize] = Some(brick);
        let Some((_, data)) = self.uploads.last() else {
            return;
        };
        let ranges = Arc::new(
            data.block_ranges
                .as_slice()
                .try_into()
                .expect("invariant: a decoded brick has a range per block"),
        );
        self.ranges.insert(brick, ranges);
        if let Some(seen) = self.seen.get(&brick.lod) {
            let entry = self.store.entry(brick);
            let activity = seen.of_brick([entry.min, entry.max], self.ranges.get(&brick));
            self.residency
                .set_activity(gpu, brick, activity, Some(slot));
        }
    }

    fn left(&mut self, gpu: &GpuContext, brick: BrickId) {
        self.ranges.remove(&brick);
        if let Some(seen) = self.seen.get(&brick.lod) {
            let entry = self.store.entry(brick);
            let activity = seen.of_range([entry.min, entry.max]);
            self.residency.set_activity(gpu, brick, activity, None);
        }
    }

    /// Copies what waits into its slots, and sends the tables.
    fn write(&mut self, gpu: &GpuContext) -> Result<(), EngineError> {
        let voxels: Vec<(Upload, &[u8])> = self
            .uploads
            .iter()
            .map(|(u, data)| (*u, data.voxels.as_slice()))
            .collect();
        self.traffic.bytes_uploaded += self.residency.upload(gpu, &mut self.staging, &voxels)?;
        self.traffic.bricks_uploaded += voxels.len() as u64;
        for (upload, _) in self.uploads.drain(..) {
            if let Some(waits) = &mut self.waits {
                waits.resident(upload.brick);
            }
        }
        self.residency.write_activity(gpu);
        Ok(())
    }

    /// Free slots: placing into them evicts nobody.
    pub(super) fn unused_slots(&self) -> usize {
        self.pager.capacity() - self.pager.resident().count()
    }

    /// Why the first of `bricks` that could not be read could not. The reason is told once.
    pub(super) fn take_failure(&mut self, bricks: &BTreeSet<BrickId>) -> Option<EngineError> {
        let failed = self.pager.failed().filter(|b| bricks.contains(b)).min()?;
        Some(match self.failures.remove(&failed) {
            Some(error) => error.into(),
            None => EngineError::FailedBrick { brick: failed },
        })
    }

    /// Bricks that could not be read.
    pub(super) fn failed_count(&self) -> u64 {
        self.pager.failed().count() as u64
    }

    /// Asks for failed bricks again when they are needed.
    pub(super) fn retry_failed(&mut self) {
        self.failures.clear();
        self.pager.retry_failed();
    }

    /// The bricks with voxels that lie within `slack` of the box around two positions of a level, all in level voxels.
    pub(super) fn bricks_of_segment(
        &self,
        lod: Lod,
        [from, to]: [DVec3; 2],
        slack: f64,
    ) -> Vec<BrickId> {
        let grid = &self.grids[usize::from(lod.0)];
        let last = (grid.bricks - 1).as_dvec3();
        let place = |p: DVec3| {
            (p / f64::from(BRICK_EDGE))
                .floor()
                .clamp(DVec3::ZERO, last)
                .as_uvec3()
        };
        let low = place(from.min(to) - slack);
        let high = place(from.max(to) + slack);
        let mut bricks = Vec::new();
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let brick = BrickId::new(lod, glam::UVec3::new(x, y, z));
                    if !self.store.entry(brick).constant {
                        bricks.push(brick);
                    }
                }
            }
        }
        bricks
    }
}

/// Slots in an order that depends on `seed` alone.
fn shuffled_slots(count: u32, seed: u64) -> Vec<SlotId> {
    let mut slots: Vec<SlotId> = (0..count).map(SlotId).collect();
    slots.sort_by_key(|slot| xxhash_rust::xxh3::xxh3_64_with_seed(&slot.0.to_le_bytes(), seed));
    slots
}
