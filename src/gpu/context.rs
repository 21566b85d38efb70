//! Choosing an adapter and opening a device on it.

use wgpu::{Adapter, AdapterInfo, DeviceType, Features, Limits};

use super::GpuError;

/// Which adapter to use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AdapterChoice {
    /// A discrete GPU before an integrated one before a virtual one before the CPU's.
    Best,
    /// The CPU's (lavapipe, WARP) before any other: the same pictures on every machine, for tests.
    SoftwareFirst,
    /// The best one whose name contains this, in any case.
    Named(String),
}

/// What the device can do, of what is optional.
#[derive(Clone, Debug)]
pub struct Caps {
    /// `R16Unorm` textures.
    pub unorm16: bool,
    /// Linear filtering of `R32Float`.
    pub float32_filterable: bool,
    /// Timestamps around passes.
    pub timestamps: bool,
    /// The adapter's own limits.
    pub limits: Limits,
    /// A renderer that runs on the CPU.
    pub is_software: bool,
}

/// An open device.
#[derive(Debug)]
pub struct GpuContext {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Name, driver, type.
    pub info: AdapterInfo,
    /// What it can do.
    pub caps: Caps,
}

impl GpuContext {
    /// Opens a device on the adapter that `choice` means, with the adapter's own limits and, if `use_optional`, whatever
    /// it has of the features that are used when there.
    ///
    /// # Errors
    /// There is no adapter (at all, or of that name), or it gives no device.
    pub fn open(choice: &AdapterChoice, use_optional: bool) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let name_of = |a: &Adapter| a.get_info().name;
        let all_names: Vec<String> = adapters.iter().map(name_of).collect();
        if let AdapterChoice::Named(asked) = choice {
            let asked_lower = asked.to_lowercase();
            adapters.retain(|a| name_of(a).to_lowercase().contains(&asked_lower));
            if adapters.is_empty() {
                return Err(GpuError::NoSuchAdapter {
                    asked: asked.clone(),
                    found: all_names,
                });
            }
        }
        let rank = |a: &Adapter| {
            let kind = a.get_info().device_type;
            match (choice, kind) {
                (AdapterChoice::SoftwareFirst, DeviceType::Cpu) => 0,
                (_, DeviceType::DiscreteGpu) => 1,
                (_, DeviceType::IntegratedGpu) => 2,
                (_, DeviceType::VirtualGpu) => 3,
                (_, DeviceType::Other) => 4,
                (_, DeviceType::Cpu) => 5,
            }
        };
        let adapter = adapters
            .into_iter()
            .min_by_key(rank)
            .ok_or(GpuError::NoAdapter)?;
        Self::open_on(&adapter, use_optional)
    }

    fn open_on(adapter: &Adapter, use_optional: bool) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let wanted = Features::TEXTURE_FORMAT_16BIT_NORM
            | Features::FLOAT32_FILTERABLE
            | Features::TIMESTAMP_QUERY;
        let features = if use_optional {
            adapter.features() & wanted
        } else {
            Features::empty()
        };
        let limits = adapter.limits();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("gpu.device"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        }))
        .map_err(|e| GpuError::NoDevice {
            adapter: info.name.clone(),
            reason: e.to_string(),
        })?;
        let caps = Caps {
            unorm16: features.contains(Features::TEXTURE_FORMAT_16BIT_NORM),
            float32_filterable: features.contains(Features::FLOAT32_FILTERABLE),
            timestamps: features.contains(Features::TIMESTAMP_QUERY),
            limits,
            is_software: info.device_type == DeviceType::Cpu,
        };
        Ok(Self {
            device,
            queue,
            info,
            caps,
        })
    }

    /// Runs `work` and turns what the device says against it (validation, memory) into an error.
    ///
    /// # Errors
    /// Whatever `work` returns, or what the device reported meanwhile.
    pub fn checked<T>(
        &self,
        doing: &'static str,
        work: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let result = work();
        let memory = pollster::block_on(memory.pop());
        let validation = pollster::block_on(validation.pop());
        match (memory, validation) {
            (Some(error), _) => Err(GpuError::OutOfMemory {
                doing,
                reason: error.to_string(),
            }),
            (None, Some(error)) => Err(GpuError::Device {
                doing,
                reason: error.to_string(),
            }),
            (None, None) => result,
        }
    }

    /// Lets finished work call back, without waiting.
    ///
    /// # Errors
    /// The device is lost.
    pub fn poll(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::Poll)
            .map(|_| ())
            .map_err(|e| GpuError::Device {
                doing: "asking the GPU what is finished",
                reason: e.to_string(),
            })
    }

    /// Waits until the device has done all that was submitted.
    ///
    /// # Errors
    /// The device is lost.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map(|_| ())
            .map_err(|e| GpuError::Device {
                doing: "waiting for the GPU",
                reason: e.to_string(),
            })
    }
}
