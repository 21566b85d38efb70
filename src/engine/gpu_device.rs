//! The GPU half of the engine: pager, loader, residency and renderer of one store, kept from picture to picture.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;

use super::{EngineError, EngineOptions, Picture, chosen_level, prepare};
use crate::classify::{Occupancy, Visibility};
use crate::geom::{BLOCKS_PER_BRICK, BrickGrid, BrickId, Lod};
use crate::gpu::{AdapterChoice, GpuContext, GpuError, Staging};
use crate::pager::{
    ActiveBricks, AtlasShape, BrickCache, BrickState, Completion, LevelScan, Loader, Pager,
    Priority, Request, SlotId, SlotPool, Upload, within_reach,
};
use crate::proxy::{ActiveBlocks, Granularity, Mesh, bounding_mesh};
use crate::render::{FrameInputs, LevelState, Renderer, Residency};
use crate::scene::{LodChoice, PictureSettings, PictureStats, RayFrame, Technique};
use crate::store::{BrickData, Store};

/// Decoded bricks on their way at once, per thread.
const LOADS_PER_THREAD: usize = 4;
/// Bytes staged per burst of uploads.
const BURST_BYTES: u64 = 16 << 20;
/// Without `--gpu-memory`, as much as a picture needs is asked for: adapters don't say what they have.
const UNBOUNDED_BYTES: u64 = 1 << 40;
/// Below this, a device without memory is not asked again.
const LEAST_BYTES: u64 = 16 << 20;
/// Bricks copied into the atlas at once: whole rows of every voxel type (7, 3 or 1 to a row).
const UPLOAD_GROUP: usize = 21;
/// Blocks that project below this many pixels are not worth a face (design.md §6).
const LEAST_BLOCK_PIXELS: f64 = 2.0;

/// A device and what of the store is on it.
#[derive(Debug)]
pub(super) struct GpuDevice {
    gpu: GpuContext,
    renderer: Renderer,
    options: EngineOptions,
    cache: BrickCache,
    loader: Loader,
    grids: Vec<BrickGrid>,
    resident: Option<Resident>,
    /// Bound of all bytes on the device: what was asked for, or less once the device refused.
    budget_bytes: u64,
    /// What the last picture asked of the device.
    attempted_bytes: u64,
}

/// Atlas and pager, which live and die together.
#[derive(Debug)]
struct Resident {
    volume: Residency,
    pager: Pager,
    staging: Staging,
}

/// What one picture needs of a level.
#[derive(Debug)]
struct Needed {
    lod: Lod,
    scan: LevelScan,
    active: ActiveBricks,
    /// Bricks that must be resident.
    bricks: Vec<BrickId>,
    bricks_visible: u64,
}

/// What loading cost.
#[derive(Debug, Default)]
struct Traffic {
    bricks_read: u64,
    bricks_uploaded: u64,
    bricks_evicted: u64,
    bytes_read: u64,
    bytes_decompressed: u64,
    bytes_uploaded: u64,
}

impl GpuDevice {
    pub(super) fn open(
        choice: &AdapterChoice,
        store: &Arc<Store>,
        options: &EngineOptions,
    ) -> Result<Self, EngineError> {
        let gpu = GpuContext::open(choice, options.use_optional_features)?;
        let renderer = Renderer::new(&gpu)?;
        let grids = (0..store.levels())
            .map(|l| store.level(Lod(l as u8)).grid)
            .collect();
        Ok(Self {
            gpu,
            renderer,
            options: options.clone(),
            cache: BrickCache::new(options.ram_bytes),
            loader: Loader::new(Arc::clone(store), options.decode_threads)
                .map_err(EngineError::Loader)?,
            grids,
            resident: None,
            budget_bytes: options.gpu_memory_bytes.unwrap_or(UNBOUNDED_BYTES),
            attempted_bytes: 0,
        })
    }

    pub(super) fn name(&self) -> String {
        format!(
            "{} ({} {})",
            self.gpu.info.name, self.gpu.info.driver, self.gpu.info.driver_info
        )
    }

    /// Draws a picture, with less memory than allowed if the device has not so much.
    pub(super) fn render(
        &mut self,
        store: &Store,
        settings: &PictureSettings,
    ) -> Result<Picture, EngineError> {
        let mut notes = Vec::new();
        loop {
            match self.render_within(store, settings, self.budget_bytes) {
                Err(EngineError::Gpu(GpuError::OutOfMemory { doing, .. }))
                    if self.attempted_bytes / 2 >= LEAST_BYTES =>
                {
                    self.resident = None;
                    self.budget_bytes = self.attempted_bytes / 2;
                    notes.push(format!(
                        "{doing}: the adapter gave no {} bytes; going on with at most {}",
                        self.attempted_bytes, self.budget_bytes
                    ));
                }
                Ok(mut picture) => {
                    notes.append(&mut picture.notes);
                    picture.notes = notes;
                    return Ok(picture);
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn render_within(
        &mut self,
        store: &Store,
        settings: &PictureSettings,
        budget: u64,
    ) -> Result<Picture, EngineError> {
        let mut traffic = Traffic::default();
        let mut notes = Vec::new();
        let voxel_bytes = store.meta().stored_type.size() as u64;
        let tile = Renderer::tile_size(settings.size, budget / 4);
        let (atlas_budget, max_edge) = self.atlas_budget(budget, tile, voxel_bytes)?;

        let first = chosen_level(store, settings.lod)?;
        let mut lod = first;
        let (rays, classified, needed, shape) = loop {
            let (rays, classified) = prepare(store, lod, settings)?;
            let needed = self.needed(
                store,
                lod,
                &rays,
                &classified.visibility,
                settings.technique,
                &mut traffic,
            )?;
            let slots = needed.bricks.len() as u64;
            let shape = AtlasShape::for_slots(slots.max(1), voxel_bytes, atlas_budget, max_edge)
                .ok_or(EngineError::GpuMemory {
                    given: budget,
                    least: budget - atlas_budget + AtlasShape::least_bytes(voxel_bytes),
                })?;
            if shape.slot_count() >= slots {
                break (rays, classified, needed, shape);
            }
            let coarser = Lod(lod.0 + 1);
            if settings.lod != LodChoice::Auto || usize::from(coarser.0) >= store.levels() {
                return Err(EngineError::Atlas {
                    lod: lod.0,
                    needed: slots,
                    slots: shape.slot_count(),
                    budget,
                });
            }
            notes.push(format!(
                "{lod} needs {slots} bricks in GPU memory, but {} fit into {} bytes: drawing {coarser}",
                shape.slot_count(),
                atlas_budget
            ));
            lod = coarser;
        };
        self.attempted_bytes = self.other_bytes(budget, tile) + shape.bytes(voxel_bytes);

        self.make_resident(store, &needed, shape, &mut traffic)?;
        let skip = settings.technique == Technique::Default;
        let mesh = if skip {
            self.mesh(&needed, &rays)?
        } else {
            Mesh::default()
        };
        let Some(resident) = &mut self.resident else {
            unreachable!("invariant: make_resident made it")
        };
        let Resident {
            volume,
            pager,
            staging,
        } = resident;
        let level = LevelState {
            lod,
            scan: &needed.scan,
            active: &needed.active,
        };
        volume.write_tables(&self.gpu, staging, &level, |brick| pager.slot(brick))?;
        let inputs = FrameInputs {
            rays: &rays,
            classified: &classified,
            settings,
            value_floor: store.meta().value_min as f32,
            skip,
        };
        let drawn = self
            .renderer
            .draw(&self.gpu, &inputs, volume, &mesh, tile)?;
        let stats = PictureStats {
            device: "gpu".into(),
            adapter: Some(self.gpu.info.name.clone()),
            driver: Some(format!(
                "{} {}",
                self.gpu.info.driver, self.gpu.info.driver_info
            )),
            passes_ms: drawn.passes_ms,
            samples: drawn.counts.samples,
            samples_skipped: drawn.counts.skipped,
            bricks_visible: Some(needed.bricks_visible),
            bricks_requested: Some(needed.bricks.len() as u64),
            bricks_read: Some(traffic.bricks_read),
            bricks_uploaded: Some(traffic.bricks_uploaded),
            bricks_evicted: Some(traffic.bricks_evicted),
            bytes_read: Some(traffic.bytes_read),
            bytes_decompressed: Some(traffic.bytes_decompressed),
            bytes_uploaded: Some(traffic.bytes_uploaded),
            atlas_slots: Some(volume.shape().slot_count()),
            atlas_bytes: Some(volume.atlas_bytes()),
            gpu_bytes: Some(volume.gpu_bytes() + staging.bytes() + drawn.frame_bytes),
            mesh_triangles: Some(mesh.triangle_count() as u64),
            lod: lod.0,
            ..PictureStats::default()
        };
        Ok(Picture {
            image: drawn.image,
            stats,
            notes,
        })
    }

    /// Bytes of everything but the atlas and its occupancy.
    fn other_bytes(&self, budget: u64, tile: [u32; 2]) -> u64 {
        Residency::table_bytes(&self.grids, 0)
            + Renderer::tile_bytes(tile)
            + burst_bytes(budget)
            + mesh_bytes(budget)
            // Look-up table and uniforms.
            + (1 << 17)
    }

    /// Bytes left for the atlas once everything else has its share, and the greatest edge of a 3D texture.
    fn atlas_budget(
        &self,
        budget: u64,
        tile: [u32; 2],
        voxel_bytes: u64,
    ) -> Result<(u64, u32), EngineError> {
        let others = self.other_bytes(budget, tile);
        let limits = &self.gpu.caps.limits;
        // Slots are packed in ten bits per axis.
        let max_edge = limits
            .max_texture_dimension_3d
            .min(1023 * crate::geom::STORED_EDGE);
        match budget.checked_sub(others) {
            // Occupancy takes 64 bytes per slot, less than a 512th of any brick.
            Some(rest) => Ok((rest - rest / 512, max_edge)),
            None => Err(EngineError::GpuMemory {
                given: budget,
                least: others + AtlasShape::least_bytes(voxel_bytes),
            }),
        }
    }

    /// The visible bricks of a level and those next to them. Reads the block ranges of every brick whose range in the
    /// index may be visible.
    fn needed(
        &mut self,
        store: &Store,
        lod: Lod,
        rays: &RayFrame,
        visibility: &Visibility,
        technique: Technique,
        traffic: &mut Traffic,
    ) -> Result<Needed, EngineError> {
        let grid = store.level(lod).grid;
        let everything = Visibility::All;
        let visibility = if technique == Technique::Basic {
            &everything
        } else {
            visibility
        };
        let scan = LevelScan::new(store, lod, visibility);
        let mut active = ActiveBricks::default();
        active.constant.extend(
            scan.constant
                .iter()
                .filter(|(_, (_, visible))| *visible)
                .map(|(&index, _)| index),
        );
        if technique == Technique::Basic {
            active.mixed.extend(
                scan.candidates
                    .iter()
                    .map(|b| (grid.index(b.xyz), Occupancy::FULL)),
            );
        } else {
            let mixed = &mut active.mixed;
            self.for_each_decoded(store, &scan.candidates, traffic, |brick, data| {
                let occupancy = Occupancy::from_ranges(ranges_of(data), visibility);
                if !occupancy.is_empty() {
                    mixed.insert(grid.index(brick.xyz), occupancy);
                }
            })?;
        }
        let occupancies = active.occupancies();
        let mut bricks = Vec::new();
        for index in within_reach(&occupancies, &grid, step_in_level_voxels(rays)) {
            let brick = BrickId::new(lod, grid.xyz(index));
            if !scan.constant.contains_key(&index) {
                bricks.push(brick);
            }
        }
        let bricks_visible = occupancies.len() as u64;
        Ok(Needed {
            lod,
            scan,
            active,
            bricks,
            bricks_visible,
        })
    }

    /// Calls `visit` with every brick of `bricks` decoded, from the cache or by the loader, in any order.
    fn for_each_decoded(
        &mut self,
        store: &Store,
        bricks: &[BrickId],
        traffic: &mut Traffic,
        mut visit: impl FnMut(BrickId, &BrickData),
    ) -> Result<(), EngineError> {
        // After a picture that failed on the device, its loads may still be on their way: they are nobody's.
        self.drain_loader();
        let mut orders = Vec::new();
        for &brick in bricks {
            match self.cache.get(brick) {
                Some(data) => visit(brick, &data),
                None => orders.push(brick),
            }
        }
        let most = self.options.decode_threads * LOADS_PER_THREAD;
        let mut orders = orders.into_iter();
        loop {
            while self.loader.in_flight() < most {
                let Some(brick) = orders.next() else { break };
                self.loader.order(brick);
            }
            let Some((brick, result)) = self.loader.receive() else {
                return Ok(());
            };
            match result {
                Ok(data) => {
                    count_load(store, brick, &data, traffic);
                    visit(brick, &data);
                    self.cache.put(brick, Arc::new(data));
                }
                Err(error) => {
                    self.drain_loader();
                    return Err(error.into());
                }
            }
        }
    }

    /// Waits for what is under way, so that the next picture doesn't meet it.
    fn drain_loader(&mut self) {
        while self.loader.receive().is_some() {}
    }

    /// Brings the needed bricks into an atlas of at least `shape`.
    fn make_resident(
        &mut self,
        store: &Store,
        needed: &Needed,
        shape: AtlasShape,
        traffic: &mut Traffic,
    ) -> Result<(), EngineError> {
        let slots = needed.bricks.len() as u64;
        let mut resident = match self.resident.take() {
            Some(kept) if kept.volume.shape().slot_count() >= slots => kept,
            old => {
                // The old atlas goes before the new one comes: both together may not fit.
                drop(old);
                let stored = store.meta().stored_type;
                let volume = Residency::new(
                    &self.gpu,
                    stored,
                    self.options.filter,
                    shape,
                    self.grids.clone(),
                )?;
                let count = shape.slot_count() as u32;
                let slots = match self.options.slot_order_seed {
                    0 => SlotPool::new(count),
                    seed => SlotPool::with_order(shuffled_slots(count, seed)),
                };
                let staging = Staging::new(
                    &self.gpu,
                    Residency::staging_chunk_bytes(),
                    burst_bytes(self.budget_bytes),
                );
                Resident {
                    volume,
                    pager: Pager::new(slots),
                    staging,
                }
            }
        };
        let Resident {
            volume,
            pager,
            staging,
        } = &mut resident;
        let requests: Vec<Request> = needed
            .bricks
            .iter()
            .map(|&brick| Request {
                priority: Priority::default(),
                brick,
            })
            .collect();
        pager.request(&requests);

        let most = self.options.decode_threads * LOADS_PER_THREAD;
        let mut decoded: BTreeMap<BrickId, Arc<BrickData>> = BTreeMap::new();
        let mut completions: Vec<Completion> = Vec::new();
        let mut uploads: Vec<(Upload, Arc<BrickData>)> = Vec::new();
        let mut failure = None;
        while !pager.is_idle() {
            let plan = pager.step(&completions, most);
            completions.clear();
            for brick in plan.load {
                match self.cache.get(brick) {
                    Some(data) => {
                        decoded.insert(brick, data);
                        completions.push(Completion::Decoded(brick));
                    }
                    None => self.loader.order(brick),
                }
            }
            uploads.extend(
                plan.upload
                    .iter()
                    .filter_map(|u| decoded.remove(&u.brick).map(|data| (*u, data))),
            );
            if uploads.len() >= UPLOAD_GROUP {
                traffic.upload(&self.gpu, volume, staging, &mut uploads)?;
            }
            traffic.bricks_evicted += plan.evicted;
            volume.apply_patches(&plan.patches);
            if completions.is_empty()
                && let Some((brick, result)) = self.loader.receive()
            {
                match result {
                    Ok(data) => {
                        count_load(store, brick, &data, traffic);
                        let data = Arc::new(data);
                        self.cache.put(brick, Arc::clone(&data));
                        decoded.insert(brick, data);
                        completions.push(Completion::Decoded(brick));
                    }
                    Err(error) => {
                        completions.push(Completion::Failed(brick));
                        failure.get_or_insert(error);
                    }
                }
            }
        }
        traffic.upload(&self.gpu, volume, staging, &mut uploads)?;
        staging.flush(&self.gpu)?;
        debug_assert!(
            failure.is_some()
                || needed
                    .bricks
                    .iter()
                    .all(|&b| matches!(pager.state(b), BrickState::Resident(_))),
            "an idle pager has placed whatever fits"
        );
        self.resident = Some(resident);
        match failure {
            Some(error) => Err(error.into()),
            None => Ok(()),
        }
    }

    /// The bounding mesh at the granularity that the picture is worth.
    fn mesh(&self, needed: &Needed, rays: &RayFrame) -> Result<Mesh, EngineError> {
        let grid = self.grids[usize::from(needed.lod.0)];
        let occupancies = needed.active.occupancies();
        let blocks =
            ActiveBlocks::new(grid, occupancies.into_iter().map(|(i, o)| (grid.xyz(i), o)))?;
        if rays.block_pixels() >= LEAST_BLOCK_PIXELS {
            let fine = bounding_mesh(&blocks, Granularity::Blocks)?;
            let bytes =
                size_of_val(fine.vertices.as_slice()) + size_of_val(fine.indices.as_slice());
            if bytes as u64 <= mesh_bytes(self.budget_bytes) {
                return Ok(fine);
            }
        }
        Ok(bounding_mesh(&blocks, Granularity::Bricks)?)
    }
}

impl Traffic {
    /// Copies the waiting bricks into their slots.
    fn upload(
        &mut self,
        gpu: &GpuContext,
        volume: &Residency,
        staging: &mut Staging,
        waiting: &mut Vec<(Upload, Arc<BrickData>)>,
    ) -> Result<(), GpuError> {
        let voxels: Vec<(Upload, &[u8])> = waiting
            .iter()
            .map(|(u, data)| (*u, data.voxels.as_slice()))
            .collect();
        self.bytes_uploaded += volume.upload(gpu, staging, &voxels)?;
        self.bricks_uploaded += waiting.len() as u64;
        waiting.clear();
        Ok(())
    }
}

/// The share of the budget for staging.
fn burst_bytes(budget: u64) -> u64 {
    BURST_BYTES.min((budget / 8).max(Residency::staging_chunk_bytes()))
}

/// The share of the budget for the bounding mesh: a finer one is made of bricks.
fn mesh_bytes(budget: u64) -> u64 {
    (budget / 16).clamp(1 << 20, 256 << 20)
}

fn count_load(store: &Store, brick: BrickId, data: &BrickData, traffic: &mut Traffic) {
    traffic.bricks_read += 1;
    traffic.bytes_decompressed += data.voxels.len() as u64;
    traffic.bytes_read += store.entry(brick).record.map_or(0, |r| u64::from(r.len));
}

/// The longest reach of a step along each level axis, in level voxels.
fn step_in_level_voxels(rays: &RayFrame) -> DVec3 {
    let level_from_world = rays.world_from_level.matrix3.inverse().transpose();
    // A row's length is the most that a step of 1 mm in any direction moves along that axis.
    DVec3::new(
        level_from_world.x_axis.length(),
        level_from_world.y_axis.length(),
        level_from_world.z_axis.length(),
    ) * rays.step_mm_exact
}

/// Slots in an order that depends on `seed` alone.
fn shuffled_slots(count: u32, seed: u64) -> Vec<SlotId> {
    let mut slots: Vec<SlotId> = (0..count).map(SlotId).collect();
    slots.sort_by_key(|slot| xxhash_rust::xxh3::xxh3_64_with_seed(&slot.0.to_le_bytes(), seed));
    slots
}

/// A brick's block ranges as the array they are.
fn ranges_of(data: &BrickData) -> &[[f32; 2]; BLOCKS_PER_BRICK] {
    data.block_ranges
        .as_slice()
        .try_into()
        .expect("invariant: a decoded brick has a range per block")
}
