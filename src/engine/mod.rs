//! The one façade: open a store, choose a device, make pictures. Commands, viewer, server and bindings stand on it.
//!
//! Wiring only: it hands the pager's plans to the loader and to `render`, and the same settings to `cpu` when the device is
//! the CPU. No algorithm lives here, and nothing above it names `render`, `gpu` or `pager`.

mod active;
mod bare;
#[cfg(feature = "gpu")]
mod device;
mod host;
mod options;
mod picture;
mod tick;

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub use active::ActiveShare;
pub use bare::{BareRate, BareRates};
#[cfg(feature = "gpu")]
pub use options::LeapFault;
pub use options::{
    DeviceChoice, EngineError, EngineOptions, InstructionSet, ReadHook, ReadHookOption,
    SampleFilter,
};
pub use picture::{PageReport, Picture, StandIns};
pub use tick::{TickBudget, TickEvent, TickReport};

use crate::camera::Camera;
use crate::classify::SegmentTables;
use crate::scene::{
    Classified, GridParams, PictureSettings, RayFrame, SceneError, SlabShape, Technique,
};
use crate::store::{Store, StoreMeta};
use host::HostDevice;

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
    Cpu(Box<HostDevice>),
    #[cfg(feature = "gpu")]
    Gpu(Box<device::GpuDevice>),
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
    /// The named adapter is not there.
    pub fn with_store(store: Arc<Store>, options: EngineOptions) -> Result<Self, EngineError> {
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

    /// What would draw faster than the device that was chosen for a user who left the choice to the program.
    pub fn advice(&self) -> Option<String> {
        match &self.device {
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) if gpu.is_software() && self.options.device == DeviceChoice::Auto => {
                Some(format!(
                    "drawing on {}, a graphics adapter in software; --device cpu is faster",
                    gpu.name()
                ))
            }
            _ => None,
        }
    }

    /// The device in words, for people: the adapter's name, or the CPU.
    pub fn device_name(&self) -> String {
        match &self.device {
            Device::Cpu(cpu) => cpu.name(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.name(),
        }
    }

    /// "gpu" or "cpu".
    pub fn device_kind(&self) -> &'static str {
        match &self.device {
            Device::Cpu(_) => "cpu",
            #[cfg(feature = "gpu")]
            Device::Gpu(_) => "gpu",
        }
    }

    /// Is the processor what draws, be it as a graphics adapter in software? Its clock then tells what pictures cost.
    pub fn draws_on_processor(&self) -> bool {
        match &self.device {
            Device::Cpu(_) => true,
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.is_software(),
        }
    }

    /// Does the device walk rays by that technique? One that it has not it draws as [`Technique::Default`]: the same picture,
    /// and [`Picture::notes`] say so.
    pub fn has_technique(&self, technique: Technique) -> bool {
        match &self.device {
            Device::Cpu(_) => HostDevice::has_technique(technique),
            #[cfg(feature = "gpu")]
            Device::Gpu(_) => true,
        }
    }

    /// Does it load ahead what [`Self::predict`] names? The CPU reads what a picture needs while it draws.
    pub fn loads_ahead(&self) -> bool {
        match &self.device {
            Device::Cpu(_) => false,
            #[cfg(feature = "gpu")]
            Device::Gpu(_) => true,
        }
    }

    /// Would the settings make a picture from each of the cameras? Draws nothing, and can't foresee what the device refuses.
    ///
    /// # Errors
    /// They make none.
    pub fn check(
        &self,
        settings: &PictureSettings,
        cameras: impl IntoIterator<Item = Camera>,
    ) -> Result<(), EngineError> {
        let mut classified = false;
        for camera in cameras {
            let rays = sample_grid(&self.store, settings, &camera)?;
            if !classified {
                Classified::new(
                    settings,
                    self.store.meta(),
                    &rays,
                    &SegmentTables::default(),
                )?;
                classified = true;
            }
        }
        Ok(())
    }

    /// Sets the slabs of technique slab anew (as in [`EngineOptions`]).
    pub fn set_slab(&mut self, shape: SlabShape) {
        self.options.slab = shape;
        match &mut self.device {
            Device::Cpu(_) => (),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.set_slab(shape),
        }
    }

    /// Sets the bounds of memory anew (as in [`EngineOptions`]). What is resident is dropped, pipelines are kept.
    pub fn set_budgets(&mut self, gpu_memory_bytes: Option<u64>, ram_bytes: u64) {
        self.options.gpu_memory_bytes = gpu_memory_bytes;
        self.options.ram_bytes = ram_bytes;
        match &mut self.device {
            Device::Cpu(cpu) => cpu.set_budget(ram_bytes),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.set_budgets(gpu_memory_bytes, ram_bytes),
        }
    }

    /// Drops what is resident on the device and decoded in host memory: the next picture reads everything again.
    /// Pipelines are kept.
    pub fn forget_bricks(&mut self) {
        match &mut self.device {
            Device::Cpu(cpu) => cpu.forget(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.forget(),
        }
    }

    /// Milliseconds that bricks took from the first request to their slot: one for each that was requested and got one
    /// since the last call. Predicted bricks are not among them, nor are those of a volume that was dropped meanwhile.
    /// Empty on the CPU, and without [`EngineOptions::keep_waits`].
    pub fn take_waits_ms(&mut self) -> Vec<f64> {
        match &mut self.device {
            Device::Cpu(_) => Vec::new(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.take_waits_ms(),
        }
    }

    /// Draws one picture; returns when it is complete.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails or is too small.
    pub fn render(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        let begin = Instant::now();
        let mut picture = match &mut self.device {
            Device::Cpu(cpu) => cpu.render(settings)?,
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.render(settings)?,
        };
        let wall_ms = begin.elapsed().as_secs_f64() * 1e3;
        let stats = &mut picture.stats;
        stats.version = env!("CARGO_PKG_VERSION").into();
        stats.wall_ms = wall_ms;
        // Off-screen pictures are handed out complete or not at all.
        stats.converged = true;
        stats.converged_ms = Some(wall_ms);
        stats.first_complete_ms = Some(wall_ms);
        Ok(picture)
    }

    /// Draws one frame of a moving picture at once, from what is resident: coarser bricks stand in for missing ones, one ray
    /// per pixel, with the settings' own `step`. What is missing is asked for and shows in later frames. The first frame,
    /// and the first after anything but the camera and `leap` changed, loads what it asks for, as much as fits.
    ///
    /// With [`PictureSettings::leap`] rays start where those of the frame before first met something, less a margin, if that
    /// frame was drawn by this function or by [`Self::tick`] and differs by a small movement of the camera alone; in modes
    /// that project, and where the textures for it would take too much of the memory, they don't. On the CPU this is
    /// [`Self::render`].
    ///
    /// # Errors
    /// As [`Self::render`]; but a brick that can't be read is no error on the GPU.
    pub fn draw_moving(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        match &mut self.device {
            Device::Cpu(_) => self.render(settings),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => {
                let begin = Instant::now();
                let mut picture = gpu.draw_moving(settings)?;
                picture.stats.version = env!("CARGO_PKG_VERSION").into();
                picture.stats.wall_ms = begin.elapsed().as_secs_f64() * 1e3;
                Ok(picture)
            }
        }
    }

    /// Says from where the next moving pictures of `settings` will be taken, the next one first; takes the place of what was
    /// said before. [`Self::page`] then loads what they will probably need behind what the last frame missed: it takes no
    /// slot from what that was drawn from, and delays nothing that is needed. A camera that was named the last time costs
    /// nothing. Without cameras: nothing is predicted. On the CPU of no effect.
    ///
    /// # Errors
    /// The settings make no picture from one of the cameras.
    pub fn predict(
        &mut self,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<(), EngineError> {
        match &mut self.device {
            Device::Cpu(_) => {
                let _ = (settings, cameras);
                Ok(())
            }
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.predict(settings, cameras),
        }
    }

    /// For at most about `time`, loads what the last moving frame missed and then what is predicted; returns sooner when
    /// there is nothing more to load. On the CPU of no effect.
    ///
    /// # Errors
    /// The device is lost. A brick that can't be read is no error.
    pub fn page(&mut self, time: Duration) -> Result<PageReport, EngineError> {
        match &mut self.device {
            Device::Cpu(_) => {
                let _ = time;
                Ok(PageReport::default())
            }
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.page(time),
        }
    }
}

#[cfg(feature = "gpu")]
fn open_device(
    store: &Arc<Store>,
    options: &EngineOptions,
) -> Result<(Device, Option<String>), EngineError> {
    use crate::gpu::{AdapterChoice, GpuError};

    let host = || Device::Cpu(Box::new(HostDevice::new(store, options)));
    let choice = match &options.device {
        DeviceChoice::Cpu | DeviceChoice::Reference => return Ok((host(), None)),
        DeviceChoice::Auto => AdapterChoice::Best,
        DeviceChoice::SoftwareGpu => AdapterChoice::SoftwareFirst,
        DeviceChoice::Named(name) => AdapterChoice::Named(name.clone()),
    };
    match device::GpuDevice::open(&choice, store, options) {
        Ok(gpu) => Ok((Device::Gpu(Box::new(gpu)), None)),
        Err(EngineError::Gpu(error @ (GpuError::NoAdapter | GpuError::NoDevice { .. })))
            if options.device == DeviceChoice::Auto =>
        {
            Ok((host(), Some(error.to_string())))
        }
        Err(error) => Err(error),
    }
}

#[cfg(not(feature = "gpu"))]
fn open_device(
    store: &Arc<Store>,
    options: &EngineOptions,
) -> Result<(Device, Option<String>), EngineError> {
    let host = || Device::Cpu(Box::new(HostDevice::new(store, options)));
    match &options.device {
        DeviceChoice::Cpu | DeviceChoice::Reference => Ok((host(), None)),
        DeviceChoice::Auto => Ok((
            host(),
            Some("this build has no GPU renderer (feature `gpu`)".into()),
        )),
        DeviceChoice::Named(_) | DeviceChoice::SoftwareGpu => Err(EngineError::NoGpuBuilt),
    }
}

/// The sample grid and the classification of a picture, with what is known of tables.
fn prepare(
    store: &Store,
    known: &SegmentTables,
    settings: &PictureSettings,
) -> Result<(RayFrame, Classified), SceneError> {
    let rays = sample_grid(store, settings, &settings.camera)?;
    let classified = Classified::new(settings, store.meta(), &rays, known)?;
    Ok((rays, classified))
}

/// The sample grid of a picture from `camera`.
fn sample_grid(
    store: &Store,
    settings: &PictureSettings,
    camera: &Camera,
) -> Result<RayFrame, SceneError> {
    let meta = store.meta();
    let params = GridParams {
        dims: meta.dims,
        level_scales: meta.levels.iter().map(|l| l.scale).collect(),
        lod: settings.lod_rule(),
        world_from_index: meta.world_from_index,
        step: settings.step,
        jitter: settings.jitter,
    };
    RayFrame::new(camera, settings.size, &params)
}
