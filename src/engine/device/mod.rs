//! The GPU half of the engine: device, paged volume and renderer of one store, kept from picture to picture.

mod bounds;
mod exact;
mod paged;

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{EngineError, EngineOptions, Picture, prepare};
use crate::classify::Visibility;
use crate::geom::{BrickGrid, Lod};
use crate::gpu::layout::MAX_LEVELS;
use crate::gpu::{AdapterChoice, GpuContext, GpuError};
use crate::pager::{AtlasShape, scan};
use crate::proxy::Mesh;
use crate::render::{AtlasPlan, FrameInputs, Renderer, Residency};
use crate::scene::{Classified, Mode, PictureSettings, PictureStats, RayFrame, Technique};
use crate::store::Store;

use bounds::{active_blocks, mesh};
use exact::{ExactRun, segment_bricks};
use paged::{LevelVisibility, PagedVolume, Traffic};

/// Bytes staged per burst of uploads.
const BURST_BYTES: u64 = 16 << 20;
/// Bytes used without `--gpu-memory`, at most: adapters don't say what they have. On the second kind, which draws on the
/// CPU, they are the machine's.
const DEFAULT_BYTES: [u64; 2] = [4 << 30, 2 << 30];
/// Below this, a device without memory is not asked again.
const LEAST_BYTES: u64 = 16 << 20;

/// A device and what of the store is on it.
#[derive(Debug)]
pub(super) struct GpuDevice {
    gpu: GpuContext,
    renderer: Renderer,
    store: Arc<Store>,
    options: EngineOptions,
    grids: Vec<BrickGrid>,
    volume: Option<PagedVolume>,
    /// Bound of all bytes on the device: what was asked for, or less once the device refused.
    budget_bytes: u64,
    /// What the last picture asked of the device.
    attempted_bytes: u64,
}

/// A picture's settings made ready.
#[derive(Debug)]
struct Prepared {
    settings: PictureSettings,
    rays: RayFrame,
    classified: Classified,
    levels: BTreeMap<Lod, LevelVisibility>,
    skip: bool,
}

impl Prepared {
    fn new(store: &Store, settings: &PictureSettings) -> Result<Self, EngineError> {
        let (rays, classified) = prepare(store, settings)?;
        let skip = settings.technique == Technique::Default;
        let iso = (settings.mode == Mode::Iso).then_some(classified.iso_stored);
        let levels = rays
            .used()
            .iter()
            .zip(&classified.levels)
            .map(|(level, table)| {
                let visibility = if skip {
                    table.visibility.clone()
                } else {
                    Visibility::All
                };
                (level.lod, LevelVisibility { visibility, iso })
            })
            .collect();
        for level in &rays.levels {
            store.check_level(level.lod)?;
        }
        Ok(Self {
            settings: settings.clone(),
            rays,
            classified,
            levels,
            skip,
        })
    }

    fn inputs(&self, store: &Store) -> FrameInputs<'_> {
        FrameInputs {
            rays: &self.rays,
            classified: &self.classified,
            settings: &self.settings,
            value_floor: store.meta().value_min as f32,
            skip: self.skip,
        }
    }
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
        let renderer = Renderer::new(&gpu, levels)?;
        let grids = (0..levels)
            .map(|l| store.level(Lod(l as u8)).grid)
            .collect();
        let budget_bytes = options
            .gpu_memory_bytes
            .unwrap_or(DEFAULT_BYTES[usize::from(gpu.caps.is_software)]);
        Ok(Self {
            gpu,
            renderer,
            store: Arc::clone(store),
            options: options.clone(),
            grids,
            volume: None,
            budget_bytes,
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
    pub(super) fn render(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        let prepared = Prepared::new(&self.store, settings)?;
        let mut notes = Vec::new();
        loop {
            match self.render_within(&prepared) {
                Err(error) => notes.push(self.with_less(error)?),
                Ok(mut picture) => {
                    notes.append(&mut picture.notes);
                    picture.notes = notes;
                    return Ok(picture);
                }
            }
        }
    }

    /// Where the device has not the memory: half of it, and a note that says so. Other errors stay errors.
    fn with_less(&mut self, error: EngineError) -> Result<String, EngineError> {
        match error {
            EngineError::Gpu(GpuError::OutOfMemory { doing, .. })
                if self.attempted_bytes / 2 >= LEAST_BYTES =>
            {
                self.volume = None;
                self.budget_bytes = self.attempted_bytes / 2;
                Ok(format!(
                    "{doing}: the adapter gave no {} bytes; going on with at most {}",
                    self.attempted_bytes, self.budget_bytes
                ))
            }
            other => Err(other),
        }
    }

    fn render_within(&mut self, prepared: &Prepared) -> Result<Picture, EngineError> {
        let tile = Renderer::tile_size(prepared.settings.size, self.budget_bytes / 4);
        let visible = self.make_ready(prepared, tile)?;
        let inputs = prepared.inputs(&self.store);
        let volume = self
            .volume
            .as_mut()
            .expect("invariant: the picture was made ready");
        volume.retry_failed();
        let mesh = bounding_mesh(&self.store, volume, prepared, self.budget_bytes)?;
        self.renderer.set_mesh(&self.gpu, &mesh)?;
        self.renderer
            .begin_picture(&self.gpu, &inputs, &volume.residency, tile, false)?;
        let mut run = ExactRun::new(&self.gpu, prepared.settings.size, tile);
        while !run.advance(&self.gpu, &mut self.renderer, volume, &inputs)? {}
        let traffic = std::mem::take(&mut volume.traffic);
        let mut stats = self.stats(&traffic)?;
        stats.samples = run.counts.samples;
        stats.samples_skipped = run.counts.skipped;
        stats.bricks_visible = Some(visible);
        stats.bricks_requested = Some(run.requested.len() as u64);
        stats.bricks_touched = Some(run.touched.len() as u64);
        stats.mesh_triangles = Some(mesh.triangle_count() as u64);
        stats.lod = prepared.rays.levels[0].lod.0;
        Ok(Picture {
            image: run.image,
            stats,
            notes: Vec::new(),
        })
    }

    /// Atlas and tables for a picture: makes them if there are none, or none large enough. Returns how many bricks may be
    /// visible.
    fn make_ready(&mut self, prepared: &Prepared, tile: [u32; 2]) -> Result<u64, EngineError> {
        let voxel_bytes = self.store.meta().stored_type.size() as u64;
        let (mut visible, mut wanted) = (0, 0);
        for (&lod, level) in &prepared.levels {
            for brick in scan(&self.store, lod, &level.visibility) {
                visible += u64::from(brick.visible);
                wanted += u64::from(brick.visible && !brick.constant);
            }
        }
        let coarsest = self.grids.last().map_or(0, BrickGrid::len);
        let least = segment_bricks(&prepared.rays, |level| {
            self.grids[usize::from(level.lod.0)].bricks.as_dvec3()
        });
        // Room for the pinned level, and for what one ray needs at once.
        let wanted = (wanted + coarsest).max(least as u64 + coarsest);
        let plan = self.atlas_plan(wanted, tile, voxel_bytes)?;
        let keeps = self
            .volume
            .as_ref()
            .is_some_and(|v| v.residency.plan().slot_count() >= plan.slot_count());
        if !keeps {
            // The old atlas goes before the new one comes: both together may not fit.
            self.volume = None;
            self.attempted_bytes =
                self.other_bytes(tile) + plan.bytes(voxel_bytes) + plan.slot_count() * 72;
            self.volume = Some(PagedVolume::new(
                &self.gpu,
                &self.store,
                &self.options,
                plan,
                burst_bytes(self.budget_bytes),
            )?);
        }
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: it was just made")
        };
        if volume.free_capacity() < least {
            return Err(EngineError::Atlas {
                needed: (least + volume.capacity() - volume.free_capacity()) as u64,
                slots: volume.capacity() as u64,
                budget: self.budget_bytes,
            });
        }
        volume.classify(&self.gpu, &prepared.rays, &prepared.levels)?;
        Ok(visible)
    }

    /// The atlas for `wanted` bricks, or as many as the budget holds.
    fn atlas_plan(
        &self,
        wanted: u64,
        tile: [u32; 2],
        voxel_bytes: u64,
    ) -> Result<AtlasPlan, EngineError> {
        let others = self.other_bytes(tile);
        let too_little = || EngineError::GpuMemory {
            given: self.budget_bytes,
            least: others + AtlasShape::least_bytes(voxel_bytes),
        };
        let rest = self
            .budget_bytes
            .checked_sub(others)
            .ok_or_else(too_little)?;
        // A slot's tables take 72 bytes, less than a 512th of any brick.
        let rest = rest - rest / 512;
        let max_edge = self
            .gpu
            .caps
            .limits
            .max_texture_dimension_3d
            .min(self.options.max_atlas_edge)
            .min(Residency::MAX_AXIS_SLOTS * crate::geom::STORED_EDGE);
        let shape = AtlasShape::for_slots(wanted, voxel_bytes, rest, max_edge)
            .ok_or_else(too_little)?;
        let most = (rest / shape.bytes(voxel_bytes)).min(u64::from(Residency::MAX_TEXTURES));
        // One texture is faster to read; more only where an axis is at its limit.
        let textures = wanted.div_ceil(shape.slot_count()).clamp(1, most.max(1));
        Ok(AtlasPlan {
            shape,
            textures: textures as u32,
        })
    }

    /// Bytes of everything but the atlas and what its slots need in tables.
    fn other_bytes(&self, tile: [u32; 2]) -> u64 {
        Residency::table_bytes(&self.grids, 0)
            + Renderer::tile_bytes(tile)
            + burst_bytes(self.budget_bytes)
            + mesh_bytes(self.budget_bytes)
            + Renderer::frame_bytes(self.grids.len())
    }

    /// What is known after a picture, but of its rays.
    fn stats(&mut self, traffic: &Traffic) -> Result<PictureStats, EngineError> {
        let passes_ms = self.renderer.take_passes_ms(&self.gpu)?;
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

/// The mesh of what may be visible, blocks where they are known.
fn bounding_mesh(
    store: &Store,
    volume: &PagedVolume,
    prepared: &Prepared,
    budget_bytes: u64,
) -> Result<Mesh, EngineError> {
    if !prepared.skip {
        return Ok(Mesh::default());
    }
    let blocks = active_blocks(store, &prepared.rays, &prepared.levels, |seen, brick| {
        volume.occupancy(seen, brick)
    })?;
    Ok(mesh(&blocks, &prepared.rays, mesh_bytes(budget_bytes))?)
}

/// The share of the budget for staging.
fn burst_bytes(budget: u64) -> u64 {
    BURST_BYTES.min((budget / 8).max(Residency::staging_chunk_bytes()))
}

/// The share of the budget for the bounding mesh: a finer one is made of bricks.
fn mesh_bytes(budget: u64) -> u64 {
    (budget / 16).clamp(1 << 20, 256 << 20)
}
