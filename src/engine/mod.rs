//! The one façade: open a store, choose a device, make pictures. Commands, viewer, server and bindings stand on it.
//!
//! Wiring only: it hands the pager's plans to the loader and to `render`, and the same settings to `reference` when the
//! device is the CPU. No algorithm lives here, and nothing above it names `render`, `gpu` or `pager`.

#[cfg(feature = "gpu")]
mod gpu_device;
mod options;
mod picture;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

pub use options::{DeviceChoice, EngineError, EngineOptions, SampleFilter};
pub use picture::Picture;

use crate::geom::Lod;
use crate::reference;
use crate::scene::{
    Classified, GridParams, LodChoice, PictureSettings, PictureStats, RayFrame, SceneError,
};
use crate::store::{Store, StoreMeta};

/// A store and the device that draws it.
#[derive(Debug)]
pub struct Engine {
    store: Arc<Store>,
    options: EngineOptions,
    device: Device,
    /// Why the CPU draws although nobody asked for it.
    fallback: Option<String>,
}

#[derive(Debug)]
enum Device {
    Cpu,
    #[cfg(feature = "gpu")]
    Gpu(Box<gpu_device::GpuDevice>),
}

impl Engine {
    /// Opens the store at `path` and the device that `options` ask for. With [`DeviceChoice::Auto`] and no adapter the
    /// CPU draws, and [`Self::fallback`] says so.
    ///
    /// # Errors
    /// The store is refused, or the named adapter is not there.
    pub fn open(path: &Path, options: EngineOptions) -> Result<Self, EngineError> {
        let store = Arc::new(Store::open(path)?);
        Self::with_store(store, options)
    }

    /// As [`Self::open`], for a store that is already open.
    ///
    /// # Errors
    /// An index of the store is damaged, or the named adapter is not there.
    pub fn with_store(store: Arc<Store>, options: EngineOptions) -> Result<Self, EngineError> {
        store.check_all_levels()?;
        let (device, fallback) = open_device(&store, &options)?;
        Ok(Self {
            store,
            options,
            device,
            fallback,
        })
    }

    /// What the store says of its volume.
    pub fn meta(&self) -> &StoreMeta {
        self.store.meta()
    }

    /// Why the CPU draws although nobody asked for it; `None` otherwise.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// The device in words, for people: the adapter's name, or the CPU.
    pub fn device_name(&self) -> String {
        match &self.device {
            Device::Cpu => "CPU (reference renderer)".into(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.name(),
        }
    }

    /// Draws one picture; returns when it is complete.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails or is too small.
    pub fn render(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        let begin = Instant::now();
        let mut picture = match &mut self.device {
            Device::Cpu => render_on_cpu(&self.store, &self.options, settings)?,
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.render(&self.store, settings)?,
        };
        let wall_ms = begin.elapsed().as_secs_f64() * 1e3;
        let stats = &mut picture.stats;
        stats.version = env!("CARGO_PKG_VERSION").into();
        stats.wall_ms = wall_ms;
        // Off-screen pictures are handed out complete or not at all.
        stats.converged = true;
        stats.converged_ms = Some(wall_ms);
        stats.first_complete_ms = Some(wall_ms);
        stats.rays = u64::from(settings.size[0]) * u64::from(settings.size[1]);
        Ok(picture)
    }
}

#[cfg(feature = "gpu")]
fn open_device(
    store: &Arc<Store>,
    options: &EngineOptions,
) -> Result<(Device, Option<String>), EngineError> {
    use crate::gpu::{AdapterChoice, GpuError};

    let choice = match &options.device {
        DeviceChoice::Cpu => return Ok((Device::Cpu, None)),
        DeviceChoice::Auto => AdapterChoice::Best,
        DeviceChoice::SoftwareGpu => AdapterChoice::SoftwareFirst,
        DeviceChoice::Named(name) => AdapterChoice::Named(name.clone()),
    };
    match gpu_device::GpuDevice::open(&choice, store, options) {
        Ok(gpu) => Ok((Device::Gpu(Box::new(gpu)), None)),
        Err(EngineError::Gpu(error @ (GpuError::NoAdapter | GpuError::NoDevice { .. })))
            if options.device == DeviceChoice::Auto =>
        {
            Ok((Device::Cpu, Some(error.to_string())))
        }
        Err(error) => Err(error),
    }
}

#[cfg(not(feature = "gpu"))]
fn open_device(
    _store: &Arc<Store>,
    options: &EngineOptions,
) -> Result<(Device, Option<String>), EngineError> {
    match &options.device {
        DeviceChoice::Cpu => Ok((Device::Cpu, None)),
        DeviceChoice::Auto => Ok((
            Device::Cpu,
            Some("this build has no GPU renderer (feature `gpu`)".into()),
        )),
        DeviceChoice::Named(_) | DeviceChoice::SoftwareGpu => Err(EngineError::NoGpuBuilt),
    }
}

/// The level to draw when it is not the memory that decides.
fn chosen_level(store: &Store, choice: LodChoice) -> Result<Lod, SceneError> {
    match choice {
        LodChoice::Auto => Ok(Lod(0)),
        LodChoice::Fixed(lod) if usize::from(lod.0) < store.levels() => Ok(lod),
        LodChoice::Fixed(lod) => Err(SceneError::NoSuchLevel {
            asked: lod.0,
            last: store.levels() - 1,
        }),
    }
}

/// The sample grid and the classification of a picture drawn at `lod`.
fn prepare(
    store: &Store,
    lod: Lod,
    settings: &PictureSettings,
) -> Result<(RayFrame, Classified), SceneError> {
    let meta = store.meta();
    let params = GridParams {
        dims: meta.dims,
        level_scale: store.level(lod).scale,
        lod: lod.0,
        world_from_index: meta.world_from_index,
        step: settings.step,
    };
    let rays = RayFrame::new(&settings.camera, settings.size, &params)?;
    let classified = Classified::new(settings, meta, rays.step_mm_exact)?;
    Ok((rays, classified))
}

fn render_on_cpu(
    store: &Store,
    options: &EngineOptions,
    settings: &PictureSettings,
) -> Result<Picture, EngineError> {
    let lod = chosen_level(store, settings.lod)?;
    let (rays, classified) = prepare(store, lod, settings)?;
    let field = reference::VoxelField::new(store, lod, options.ram_bytes);
    let drawn = reference::render(&field, &rays, &classified, settings)?;
    let stats = PictureStats {
        device: "cpu".into(),
        samples: drawn.counts.samples,
        samples_skipped: drawn.counts.skipped,
        bricks_read: Some(drawn.bricks_read),
        lod: lod.0,
        ..PictureStats::default()
    };
    Ok(Picture {
        image: drawn.image,
        stats,
        notes: Vec::new(),
    })
}
