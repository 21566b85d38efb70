//! The GPU half of the engine: device, paged volume and renderer of one store, kept from picture to picture.

mod bare;
mod bounds;
mod classification;
mod draft;
mod exact;
mod foresight;
mod live;
mod paged;
mod plan;
mod slab;
mod waits;

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::{EngineError, EngineOptions, PageReport, Picture, StandIns, TickBudget};
use crate::camera::Camera;
use crate::classify::SegmentTables;
use crate::clip::Geometry;
use crate::geom::{BrickGrid, Lod};
use crate::gpu::layout::MAX_LEVELS;
use crate::gpu::{AdapterChoice, GpuContext, GpuError};
use crate::pager::AtlasShape;
use crate::render::{AtlasPlan, Renderer, Residency};
use crate::scene::{PictureSettings, PictureStats, SlabRim, SlabShape, Technique};
use crate::store::Store;

use classification::{KnownRanges, SeenLevels};
use exact::{ExactRun, Progress, Wait, segment_bricks};
use foresight::Foresight;
use live::Live;
use paged::{PagedVolume, Traffic};
use plan::{PicturePlan, ReadyPictures};

/// Bytes staged per burst of uploads.
const BURST_BYTES: u64 = 16 << 20;
/// Bytes used without `--gpu-memory`, at most: adapters don't say what they have. On the second kind, which draws on the
/// CPU, they are the machine's.
const DEFAULT_BYTES: [u64; 2] = [4 << 30, 2 << 30];
/// Below this, a device without memory is not asked again.
const LEAST_BYTES: u64 = 16 << 20;
/// An atlas is made for so many times what the first of several pictures needs: the next ones need other bricks, and a
/// larger atlas begins empty.
const ROOM: u64 = 2;
/// Bytes of tables per slot: occupancy, stamp and its read-back.
const SLOT_BYTES: u64 = 72;

/// A device and what of the store is on it.
#[derive(Debug)]
pub(super) struct GpuDevice {
    gpu: GpuContext,
    renderer: Renderer,
    store: Arc<Store>,
    tables: SegmentTables,
    options: EngineOptions,
    grids: Vec<BrickGrid>,
    volume: Option<PagedVolume>,
    /// What loading has cost volumes that are no more.
    past_traffic: Traffic,
    live: Option<Live>,
    /// For what movement bricks were loaded: its settings, with the camera nowhere and without leaping.
    moving: Option<PictureSettings>,
    /// What the next moving pictures will probably need.
    foresight: Foresight,
    /// Bound of all bytes on the device: what was asked for, or less once the device refused.
    budget_bytes: u64,
    /// What the last picture asked of the device.
    attempted_bytes: u64,
    /// The last picture's geometry, and the most pixels that its tiles may have: less once rays crossed it too often.
    cut_by: Option<(Arc<Geometry>, u64)>,
}

impl GpuDevice {
    pub(super) fn open(
        choice: &AdapterChoice,
        store: &Arc<Store>,
        options: &EngineOptions,
    ) -> Result<Self, EngineError> {
        let levels = store.levels();
        if levels > MAX_LEVELS as usize {
            return Err(EngineError::TooManyLevels {
                levels,
                most: MAX_LEVELS,
            });
        }
        let gpu = GpuContext::open(choice, options.use_optional_features)?;
        let renderer = Renderer::new(&gpu, levels, options.pass_samples, options.leap_fault)?;
        let grids = (0..levels)
            .map(|l| store.level(Lod(l as u8)).grid)
            .collect();
        let budget_bytes = default_budget(&gpu, options);
        Ok(Self {
            gpu,
            renderer,
            store: Arc::clone(store),
            tables: SegmentTables::default(),
            options: options.clone(),
            grids,
            volume: None,
            past_traffic: Traffic::default(),
            live: None,
            moving: None,
            foresight: Foresight::default(),
            budget_bytes,
            attempted_bytes: 0,
            cut_by: None,
        })
    }

    pub(super) fn name(&self) -> String {
        format!(
            "{} ({} {})",
            self.gpu.info.name, self.gpu.info.driver, self.gpu.info.driver_info
        )
    }

    /// Does it draw on the processor?
    pub(super) fn is_software(&self) -> bool {
        self.gpu.caps.is_software
    }

    /// Other bounds of memory: whatever is resident goes, pipelines stay.
    pub(super) fn set_budgets(&mut self, gpu_memory_bytes: Option<u64>, ram_bytes: u64) {
        self.options.gpu_memory_bytes = gpu_memory_bytes;
        self.options.ram_bytes = ram_bytes;
        self.budget_bytes = default_budget(&self.gpu, &self.options);
        self.forget();
    }

    /// Another shape of the slabs.
    pub(super) fn set_slab(&mut self, shape: SlabShape) {
        self.options.slab = shape;
        if let Some(live) = &mut self.live {
            live.restart();
        }
    }

    /// Drops everything that is resident on the device and decoded in host memory.
    pub(super) fn forget(&mut self) {
        self.drop_volume();
        if let Some(live) = &mut self.live {
            live.restart();
        }
    }

    /// Milliseconds from the first request of a brick to its slot, of all that got one since the last call.
    pub(super) fn take_waits_ms(&mut self) -> Vec<f64> {
        self.volume
            .as_mut()
            .and_then(|volume| volume.waits.as_mut())
            .map_or_else(Vec::new, waits::Waits::take)
    }

    /// See [`super::Engine::predict`].
    pub(super) fn predict(
        &mut self,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<(), EngineError> {
        let Self {
            store,
            tables,
            foresight,
            volume,
            ..
        } = self;
        foresight.look(store, tables, settings, cameras)?;
        if let Some(volume) = volume {
            volume.predict(&foresight.requests(volume.capacity()));
        }
        Ok(())
    }

    /// See [`super::Engine::page`].
    pub(super) fn page(&mut self, time: Duration) -> Result<PageReport, EngineError> {
        let begin = Instant::now();
        let Some(volume) = &mut self.volume else {
            return Ok(PageReport::default());
        };
        let before = volume.traffic;
        loop {
            volume.advance(&self.gpu, TickBudget::default().upload_bytes)?;
            let left = time.saturating_sub(begin.elapsed());
            if left.is_zero() || volume.is_idle() {
                break;
            }
            volume.wait_for_one(left);
        }
        let traffic = volume.traffic.since(before);
        Ok(PageReport {
            bricks_read: traffic.bricks_read,
            bricks_uploaded: traffic.bricks_uploaded,
        })
    }

    /// Draws a picture, with less memory than allowed if the device has not so much.
    pub(super) fn render(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        let settings = PictureSettings {
            leap: false,
            ..settings.clone()
        };
        let plan = PicturePlan::new(&self.store, &self.tables, &settings)?;
        self.with_what_memory_there_is(|device| device.render_within(&plan))
    }

    /// Draws, again with less memory where the device has not what is allowed; says so in the picture's notes.
    fn with_what_memory_there_is(
        &mut self,
        mut draw: impl FnMut(&mut Self) -> Result<Picture, EngineError>,
    ) -> Result<Picture, EngineError> {
        if let Some(live) = &mut self.live {
            // Tables and atlas are about to change under it.
            live.restart();
        }
        let mut notes = Vec::new();
        loop {
            match draw(self) {
                Err(error) => notes.push(self.with_less(error)?),
                Ok(mut picture) => {
                    notes.append(&mut picture.notes);
                    picture.notes = notes;
                    return Ok(picture);
                }
            }
        }
    }

    /// Where the device has not the memory: half of it, or of the pixels of a tile, and a note that says so. Other errors stay
    /// errors.
    fn with_less(&mut self, error: EngineError) -> Result<String, EngineError> {
        match error {
            EngineError::Gpu(GpuError::OutOfMemory { doing, .. })
                if self.attempted_bytes / 2 >= LEAST_BYTES =>
            {
                self.drop_volume();
                self.budget_bytes = self.attempted_bytes / 2;
                Ok(format!(
                    "{doing}: the adapter gave no {} bytes; going on with at most {}",
                    self.attempted_bytes, self.budget_bytes
                ))
            }
            EngineError::Gpu(GpuError::TooManyCrossings { pixels, .. }) => {
                if let Some((_, most_pixels)) = &mut self.cut_by {
                    *most_pixels = pixels / 2;
                }
                Ok(format!("{error}; drawing smaller tiles, more slowly"))
            }
            other => Err(other),
        }
    }

    fn render_within(&mut self, plan: &PicturePlan) -> Result<Picture, EngineError> {
        let before = self.traffic();
        let ready = self.work_out(vec![plan.clone()])?;
        let tile = self.tile(&plan.settings);
        let ready = self.make_ready(ready, 1)?;
        let (plan, mesh) = &ready.pictures[0];
        let inputs = plan.inputs();
        let Self {
            gpu,
            renderer,
            volume: Some(volume),
            ..
        } = self
        else {
            unreachable!("invariant: the picture was made ready")
        };
        volume.retry_failed();
        renderer.set_mesh(gpu, mesh)?;
        renderer.begin_picture(gpu, &inputs, &volume.residency, tile, false)?;
        let mut run = ExactRun::new(gpu, &inputs, tile, None);
        while run.advance(gpu, renderer, volume, &inputs, Wait::Block)? != Progress::Complete {}
        let mut stats = self.stats(before)?;
        run.report(&mut stats);
        stats.bricks_visible = Some(ready.bricks.visible);
        stats.mesh_triangles = Some(mesh.triangle_count() as u64);
        stats.lod = plan.rays.levels[0].lod.0;
        Ok(Picture {
            image: run.image,
            stats,
            touched: run.touched.into_iter().collect(),
            stand_ins: StandIns::default(),
            notes: Vec::new(),
        })
    }

    /// The tiles of a picture.
    fn tile(&self, settings: &PictureSettings) -> [u32; 2] {
        let most_pixels = match &self.cut_by {
            Some((geometry, pixels)) if Arc::ptr_eq(geometry, &settings.geometry) => *pixels,
            _ => u64::MAX,
        };
        Renderer::tile_size(settings, self.budget_bytes / 4, most_pixels)
    }

    /// What the pictures need, worked out here and now.
    fn work_out(&self, plans: Vec<PicturePlan>) -> Result<ReadyPictures, EngineError> {
        let nothing = (KnownRanges::new(), SeenLevels::new());
        let known = match &self.volume {
            Some(volume) => volume.known(),
            None => (&nothing.0, &nothing.1),
        };
        ReadyPictures::new(&self.store, plans, known, mesh_bytes(self.budget_bytes))
    }

    /// Atlas and tables for pictures: makes them if there are none, or none large enough; then for `room` times what they
    /// need, if the budget holds that.
    fn make_ready(
        &mut self,
        mut ready: ReadyPictures,
        room: u64,
    ) -> Result<ReadyPictures, EngineError> {
        let voxel_bytes = self.store.meta().stored_type.size() as u64;
        let plan = ready.final_plan();
        let (tile, technique) = (self.tile(&plan.settings), plan.settings.technique);
        let leaping = plan.settings.leaps().then_some(plan.settings.size);
        // What earlier pictures leapt with stays.
        let leaping = leaping.or(self.renderer.leap_size());
        let leap_bytes = leaping.map_or(0, |size| Renderer::leap_bytes(size, tile));
        let coarsest = self.grids.last().map_or(0, BrickGrid::len);
        let least = ready
            .pictures
            .iter()
            .map(|(plan, _)| {
                segment_bricks(&plan.rays, &plan.settings, |level| {
                    self.grids[usize::from(level.lod.0)].bricks.as_dvec3()
                })
            })
            .max()
            .unwrap_or(1);
        let mut together = least;
        for plan in ready.slab_plans() {
            slab::check(self.options.slab, &plan.settings, &self.gpu.caps)?;
            together = together.max(self.slab_bricks(plan, self.options.slab));
        }
        // Room for the pinned level, and for what one ray or slab needs at once.
        // Neighbours of visible bricks come, too, where rays read beyond these.
        let reads_beyond = |plan: &PicturePlan| {
            let settings = &plan.settings;
            settings.reads_beyond_visible()
                || (settings.technique == Technique::Slab && SlabRim::of(settings).sides > 0)
        };
        let visible = match ready.pictures.iter().any(|(plan, _)| reads_beyond(plan)) {
            true => ready.bricks.visible_with_voxels * ROOM,
            false => ready.bricks.visible_with_voxels,
        };
        let wanted = (visible + coarsest).max(together as u64 + coarsest);
        let pictures = ready.pictures.iter();
        let integrals = pictures.map(|(plan, _)| Renderer::integrals_bytes(&plan.classified));
        let others = self.other_bytes(tile, technique)
            + integrals.max().unwrap_or(0)
            + leap_bytes
            + self.reserve_for_geometry(ready.final_plan(), tile);
        let mut plan = self.atlas_plan(wanted, others, voxel_bytes)?;
        let keeps = self.volume.as_ref().is_some_and(|v| {
            let there = v.residency.plan();
            let bytes = there.bytes(voxel_bytes) + there.slot_count() * SLOT_BYTES;
            there.slot_count() >= plan.slot_count() && others + bytes <= self.budget_bytes
        });
        if !keeps {
            plan = self.atlas_plan(wanted * room, others, voxel_bytes)?;
            // The old atlas goes before the new one comes: both together may not fit.
            self.drop_volume();
            self.attempted_bytes =
                others + plan.bytes(voxel_bytes) + plan.slot_count() * SLOT_BYTES;
            self.volume = Some(PagedVolume::new(
                &self.gpu,
                &self.store,
                &self.options,
                plan,
                burst_bytes(self.budget_bytes),
            )?);
            // What was known was of the old one.
            let plans = ready.pictures.into_iter().map(|(plan, _)| plan).collect();
            ready = self.work_out(plans)?;
        }
        let Some(volume) = &self.volume else {
            unreachable!("invariant: it was just made")
        };
        let [slots, free] = [volume.capacity(), volume.free_capacity()];
        let too_few = |bricks: usize| EngineError::Atlas {
            needed: (bricks + slots - free) as u64,
            slots: slots as u64,
            budget: self.budget_bytes,
        };
        if free < least {
            return Err(too_few(least));
        }
        for plan in ready.slab_plans_mut() {
            let bricks_of = |shape| self.slab_bricks(plan, shape);
            let shape = slab::fitting(self.options.slab, free, bricks_of).map_err(too_few)?;
            plan.slab = Some(shape);
        }
        let rays = &ready.final_plan().rays;
        if let Some(volume) = &mut self.volume {
            volume.classify(&self.gpu, rays, &ready.levels, &ready.bricks)?;
        }
        Ok(ready)
    }

    /// Bytes of a picture's geometry, and what rays may be cut to.
    fn reserve_for_geometry(&mut self, plan: &PicturePlan, tile: [u32; 2]) -> u64 {
        let geometry = &plan.settings.geometry;
        if geometry.is_empty() {
            self.renderer.set_most_parts_bytes(None);
            return 0;
        }
        if !matches!(&self.cut_by, Some((g, _)) if Arc::ptr_eq(g, geometry)) {
            self.cut_by = Some((Arc::clone(geometry), u64::MAX));
        }
        let [itself, least] = Renderer::geometry_bytes(geometry, &plan.rays, tile);
        let most = if geometry.has_meshes() {
            (2 * least).max(self.budget_bytes / 8)
        } else {
            least
        };
        self.renderer.set_most_parts_bytes(Some(most));
        itself + most
    }

    /// Slots that a slab of a picture may need at once.
    fn slab_bricks(&self, plan: &PicturePlan, shape: SlabShape) -> usize {
        slab::slab_bricks(&plan.rays, &plan.settings, shape, |level| {
            self.grids[usize::from(level.lod.0)].bricks.as_dvec3()
        })
    }

    /// The atlas for `wanted` bricks, or as many as the budget holds beside `others` bytes.
    fn atlas_plan(
        &self,
        wanted: u64,
        others: u64,
        voxel_bytes: u64,
    ) -> Result<AtlasPlan, EngineError> {
        let too_little = || EngineError::GpuMemory {
            given: self.budget_bytes,
            least: others + AtlasShape::least_bytes(voxel_bytes),
        };
        let rest = self
            .budget_bytes
            .checked_sub(others)
            .ok_or_else(too_little)?;
        // A slot's tables take less than a 512th of any brick.
        let rest = rest - rest / 512;
        let max_edge = Residency::max_atlas_edge(&self.gpu.caps).min(self.options.max_atlas_edge);
        let shape =
            AtlasShape::for_slots(wanted, voxel_bytes, rest, max_edge).ok_or_else(too_little)?;
        let most = (rest / shape.bytes(voxel_bytes)).min(u64::from(Residency::MAX_TEXTURES));
        // One texture is faster to read; more only where an axis is at its limit.
        let textures = wanted.div_ceil(shape.slot_count()).clamp(1, most.max(1));
        Ok(AtlasPlan {
            shape,
            textures: textures as u32,
        })
    }

    /// Bytes of everything but the atlas and what its slots need in tables.
    fn other_bytes(&self, tile: [u32; 2], technique: Technique) -> u64 {
        Residency::table_bytes(&self.grids, 0)
            + Renderer::tile_bytes(tile, technique)
            + burst_bytes(self.budget_bytes)
            + mesh_bytes(self.budget_bytes)
            + Renderer::frame_bytes(self.grids.len())
    }

    fn drop_volume(&mut self) {
        self.past_traffic = self.traffic();
        self.volume = None;
        self.renderer.drop_targets();
        self.moving = None;
    }

    /// What loading has cost so far.
    fn traffic(&self) -> Traffic {
        match &self.volume {
            Some(volume) => self.past_traffic.plus(volume.traffic),
            None => self.past_traffic,
        }
    }

    /// What is known of a picture that was begun at `before`, but of its rays.
    fn stats(&mut self, before: Traffic) -> Result<PictureStats, EngineError> {
        let passes_ms = self.renderer.take_passes_ms(&self.gpu)?;
        let traffic = self.traffic().since(before);
        let volume = self.volume.as_ref();
        let on_device = volume.map(|v| v.residency.gpu_bytes() + v.staging_bytes());
        Ok(PictureStats {
            device: "gpu".into(),
            adapter: Some(self.gpu.info.name.clone()),
            driver: Some(format!(
                "{} {}",
                self.gpu.info.driver, self.gpu.info.driver_info
            )),
            passes_ms,
            layers: self.renderer.take_layer_stats(),
            bricks_read: Some(traffic.bricks_read),
            bricks_uploaded: Some(traffic.bricks_uploaded),
            bricks_evicted: Some(traffic.bricks_evicted),
            bytes_read: Some(traffic.bytes_read),
            bytes_decompressed: Some(traffic.bytes_decompressed),
            bytes_uploaded: Some(traffic.bytes_uploaded),
            atlas_slots: volume.map(|v| v.capacity() as u64),
            atlas_bytes: volume.map(|v| v.residency.atlas_bytes()),
            gpu_bytes: on_device.map(|bytes| bytes + self.renderer.bytes()),
            ..PictureStats::default()
        })
    }
}

/// What was asked for, or as much as is used by default.
fn default_budget(gpu: &GpuContext, options: &EngineOptions) -> u64 {
    options
        .gpu_memory_bytes
        .unwrap_or(DEFAULT_BYTES[usize::from(gpu.caps.is_software)])
}

/// The share of the budget for staging.
fn burst_bytes(budget: u64) -> u64 {
    BURST_BYTES.min((budget / 8).max(Residency::staging_chunk_bytes()))
}

/// The share of the budget for the bounding mesh: a finer one is made of bricks.
fn mesh_bytes(budget: u64) -> u64 {
    (budget / 16).clamp(1 << 20, 256 << 20)
}
