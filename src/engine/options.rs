//! What an engine is opened with, and what can go wrong.

use std::num::NonZeroU32;

use thiserror::Error;

pub use crate::cpu::InstructionSet;
pub use crate::pager::ReadHook;
use crate::scene::{SceneError, SlabShape};
use crate::store::StoreError;

#[cfg(feature = "gpu")]
pub use crate::render::{LeapFault, SampleFilter};

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
    /// The CPU renderer.
    Cpu,
    /// The simple and slow CPU renderer that the others are tested against.
    Reference,
    /// The software adapter before any other: the same pictures on every machine, for tests.
    SoftwareGpu,
    /// The graphics adapter whose name contains this.
    Named(String),
}

/// A [`ReadHook`] as an option.
#[derive(Clone)]
pub struct ReadHookOption(pub ReadHook);

impl std::fmt::Debug for ReadHookOption {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a hook")
    }
}

/// Device and budgets.
#[derive(Clone, Debug)]
pub struct EngineOptions {
    /// Which device draws.
    pub device: DeviceChoice,
    /// Bound of all bytes on the GPU; `None`: what the picture may need, at most 4 GiB, on a software adapter 2.
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
    /// Atlas slots in use at most, for tests; `None`: as many as the memory holds.
    pub max_slots: Option<u64>,
    /// Edge of an atlas texture at most, texels, for tests; more than the adapter's is the adapter's.
    pub max_atlas_edge: u32,
    /// Samples of a ray in a pass of techniques multipass and layers; `None`: their own.
    pub pass_samples: Option<NonZeroU32>,
    /// The vector instructions of the CPU renderer, for tests; `None`: the best that the processor has.
    pub instructions: Option<InstructionSet>,
    /// The slabs of technique slab on the GPU: work-groups, and samples at once. Where the GPU memory is small, fewer samples.
    pub slab: SlabShape,
    /// Keep how long each brick waits for its slot, for measurements ([`super::Engine::take_waits_ms`])?
    pub keep_waits: bool,
    /// What leaping does wrong, for tests.
    #[cfg(feature = "gpu")]
    pub leap_fault: Option<LeapFault>,
    /// Called before each brick is read, for tests: may wait, and may fail in the brick's place.
    pub read_hook: Option<ReadHookOption>,
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
            max_slots: None,
            max_atlas_edge: u32::MAX,
            pass_samples: None,
            instructions: None,
            slab: SlabShape::default(),
            keep_waits: false,
            #[cfg(feature = "gpu")]
            leap_fault: None,
            read_hook: None,
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
    #[error(transparent)]
    Pager(#[from] crate::pager::PagerError),
    #[error(
        "the store has {levels} levels, but at most {most} can be drawn on a GPU; render with --device cpu, or brick with fewer --levels"
    )]
    TooManyLevels { levels: usize, most: u32 },
    #[error(
        "level {lod} of the store has {bricks} bricks, but at most {most} can be drawn on the CPU; draw a coarser one with --lod"
    )]
    TooManyBricks { lod: u8, bricks: u64, most: u64 },
    #[error(
        "slabs of {shape} rays and samples are of no shape that can be drawn: a multiple of 4 and one of 2 rays, at least 8 of each, and 1 to {} samples",
        SlabShape::MOST_SAMPLES
    )]
    SlabShape { shape: SlabShape },
    #[error(
        "technique slab takes gradients from neighbouring rays, whose samples must lie at the same distances; draw it without jitter"
    )]
    SlabJitter,
    #[error(
        "slabs of {shape} rays and samples need {needed} {what} of a work-group, but the device has {most}; take smaller ones"
    )]
    SlabLimit {
        shape: SlabShape,
        what: &'static str,
        needed: u32,
        most: u32,
    },
    #[error("a worker thread ended without a result; its panic message says why")]
    Worker,
    #[error("{brick} could not be read; the reason was given before")]
    FailedBrick { brick: crate::geom::BrickId },
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
        "rays of this step need up to {needed} bricks in GPU memory at once (the coarsest level's included), but {slots} fit into --gpu-memory of {budget} bytes; give more memory, or a smaller --size or --step"
    )]
    Atlas {
        needed: u64,
        slots: u64,
        budget: u64,
    },
}
