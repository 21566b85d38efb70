//! What a picture is, before anyone draws it: settings, the sample grid of a frame, and the classification made ready
//! for a mode and a step.
//!
//! Both renderers (`render` on the GPU, `reference` on the CPU) draw from these very values, so that they can differ in
//! nothing but arithmetic. No drawing here, no GPU, no voxels. Keeps invariant 1 of design.md: sample positions depend
//! on the ray and the step alone ([`RayFrame`]).

mod antialias;
mod classified;
mod extreme;
mod frame;
mod image;
mod part;
mod settings;
mod shade;
mod slab;
mod stats;

pub use antialias::{RaySet, add_ray, differing_pixels};
pub use classified::{Classified, ClassifiedLevel, ClassifiedSurface, SceneError, default_window};
pub use extreme::Extreme;
pub use frame::{GridParams, LevelFrame, LodRule, RayFrame, interleaved_offset, volume_bounds};
pub use image::{Image, NO_DEPTHS};
pub use part::{Contribution, PartSamples, RayPart, ray_parts};
pub use settings::{
    AntiAliasing, Background, Classification, GradientFilter, Interpolation, IsoSurface, Jitter,
    LodChoice, Mode, PictureSettings, Quality, SamplePattern, Shading, ShadingModel, Technique,
    TransferMode,
};
pub use shade::phong;
pub use slab::{SlabRim, SlabShape};
pub use stats::{CellSamples, LayerStats, PictureStats, RayCounts};
