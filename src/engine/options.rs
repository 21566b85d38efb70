//! What an engine is opened with, and what can go wrong.

use thiserror::Error;

use crate::scene::SceneError;
use crate::store::StoreError;

#[cfg(feature = "gpu")]
pub use crate::render::SampleFilter;

/// How values between voxels are read on the GPU. (Without the GPU renderer: of no effect.)
#[cfg(not(feature = "gpu"))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleFilter {
    /// Interpolated in f32.
    #[default]
    Exact,
    /// The hardware's filter.
    Hardware,
}

/// Which device draws.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The best graphics adapter; the CPU where there is none.
    #[default]
    Auto,
    /// The CPU reference renderer.
    Cpu,
    /// The software adapter before any other: the same pictures on every machine, for tests.
    SoftwareGpu,
    /// The graphics adapter whose name contains this.
    Named(String),
}

/// Device and budgets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EngineOptions {
    /// Which device draws.
    pub device: DeviceChoice,
    /// Bound of all bytes on the GPU; `None`: what the adapter can give.
    pub gpu_memory_bytes: Option<u64>,
    /// Bytes of decoded bricks kept in host memory.
    pub ram_bytes: u64,
    /// Threads that decode bricks.
    pub decode_threads: usize,
    /// How values between voxels are read on the GPU.
    pub filter: SampleFilter,
    /// Use the features that an adapter has but need not have? `false` draws as on one without them, for tests.
    pub use_optional_features: bool,
    /// The order in which atlas slots are given out, for tests: 0 is rising, others are shuffled.
    pub slot_order_seed: u64,
}

impl Default for EngineOptions {
    fn default() -> Self {
        Self {
            device: DeviceChoice::Auto,
            gpu_memory_bytes: None,
            ram_bytes: 1 << 30,
            decode_threads: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            filter: SampleFilter::default(),
            use_optional_features: true,
            slot_order_seed: 0,
        }
    }
}

/// Why there is no picture.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum EngineError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
    #[error("the bounding mesh: {0}")]
    Mesh(#[from] crate::proxy::ProxyError),
    #[error("cannot start the decoders: {0}")]
    Loader(std::io::Error),
    #[error("this build has no GPU renderer (feature `gpu`); use --device cpu")]
    NoGpuBuilt,
    #[error(
        "--gpu-memory of {given} bytes is too little: this volume and picture need at least {least} bytes; give more, or a smaller --size"
    )]
    GpuMemory { given: u64, least: u64 },
    #[error(
        "level {lod} needs {needed} bricks in GPU memory, but {slots} fit into --gpu-memory of {budget} bytes; give more memory or a coarser --lod"
    )]
    Atlas {
        lod: u8,
        needed: u64,
        slots: u64,
        budget: u64,
    },
}
