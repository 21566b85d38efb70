//! Everything a user may choose about one picture, in physical units.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::LodRule;
use crate::camera::Camera;
use crate::classify::TransferFunction;
use crate::clip::Geometry;
use crate::geom::Lod;

/// What is computed along a ray (cli.md, "Colour").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Direct volume rendering: front-to-back compositing of classified samples.
    Dvr,
    /// Surfaces of one or more values, opaque or translucent.
    Iso,
    /// Maximum along the ray, classified once.
    Mip,
    /// Minimum along the ray, classified once.
    MinIp,
    /// Mean of the samples of the ray, each weighted by the length it stands for, classified once.
    Mean,
    /// As [`Self::Dvr`], with the value's place in the window as grey and as opacity per opacity unit.
    Xray,
    /// As [`Self::Dvr`], with the optical depth of a sample scaled by the strength of the gradient: surfaces of any value.
    Gradient,
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Dvr,
        Self::Iso,
        Self::Mip,
        Self::MinIp,
        Self::Mean,
        Self::Xray,
        Self::Gradient,
    ];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dvr => "dvr",
            Self::Iso => "iso",
            Self::Mip => "mip",
            Self::MinIp => "minip",
            Self::Mean => "mean",
            Self::Xray => "xray",
            Self::Gradient => "gradient",
        }
    }

    /// Are samples composited front to back, each with its opacity?
    pub const fn composites(self) -> bool {
        matches!(self, Self::Dvr | Self::Xray | Self::Gradient)
    }

    /// Is one value per ray classified?
    pub const fn projects(self) -> bool {
        matches!(self, Self::Mip | Self::MinIp | Self::Mean)
    }

    /// Does a default ramp reach opacity 1, not a half (cli.md, "Colour")?
    pub const fn classifies_whole_range(self) -> bool {
        self.projects() || matches!(self, Self::Xray)
    }
}

/// A surface of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoSurface {
    /// Physical value.
    pub value: f64,
    /// Display colour, 0–1.
    pub color: Vec3,
    /// 1 ends the ray; less lets what is behind shine through; 0 can't be seen. In [0, 1].
    pub opacity: f32,
}

impl IsoSurface {
    /// The colour of a surface when none is given: a warm near-white.
    pub const DEFAULT_COLOR: Vec3 = Vec3::new(0.92, 0.88, 0.80);

    /// Most surfaces of a picture.
    pub const MOST: usize = 8;

    /// An opaque surface of that physical value in the default colour.
    pub const fn opaque(value: f64) -> Self {
        Self {
            value,
            color: Self::DEFAULT_COLOR,
            opacity: 1.0,
        }
    }
}

/// Are samples lit?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShadingModel {
    /// Colours are shown as classified.
    None,
    /// Phong's model on central-difference normals, two-sided.
    Phong,
}

/// How the gradient at a point is found (design.md §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GradientFilter {
    /// Central differences, with taps half a voxel of the level away.
    Central,
    /// The mean of the central differences at the point and half a voxel away along each axis, both ways.
    Filtered,
}

/// The light and the material, all factors ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// Are samples lit?
    pub model: ShadingModel,
    /// Direction in which the light shines, world; `None` is a headlight that shines along each ray.
    pub light: Option<DVec3>,
    /// Share of the colour that is there without light.
    pub ambient: f32,
    /// Share of the colour under perpendicular light.
    pub diffuse: f32,
    /// Brightness of the white highlight.
    pub specular: f32,
    /// Exponent of the highlight.
    pub shininess: f32,
    /// How normals come about.
    pub gradient: GradientFilter,
}

impl Default for Shading {
    fn default() -> Self {
        Self {
            model: ShadingModel::None,
            light: None,
            ambient: 0.15,
            diffuse: 0.8,
            specular: 0.15,
            shininess: 20.0,
            gradient: GradientFilter::Central,
        }
    }
}

impl Shading {
    /// The default of a mode: surfaces are lit, those of mode gradient without a highlight (techniques.md T3).
    pub fn of_mode(mode: Mode) -> Self {
        let default = Self::default();
        match mode {
            Mode::Iso => Self {
                model: ShadingModel::Phong,
                ..default
            },
            Mode::Gradient => Self {
                model: ShadingModel::Phong,
                specular: 0.0,
                ..default
            },
            Mode::Dvr | Mode::Mip | Mode::MinIp | Mode::Mean | Mode::Xray => default,
        }
    }
}

/// How values between voxel centres come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Trilinear.
    Linear,
    /// The value of the voxel that contains the position.
    Nearest,
}

/// Which level is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LodChoice {
    /// By distance, as [`PictureSettings::lod_error`] asks.
    Auto,
    /// This one.
    Fixed(Lod),
}

/// Where the samples of neighbouring rays lie (techniques.md T1.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Jitter {
    /// At the same distances.
    None,
    /// Offset by a part of a step that repeats over 4×4 pixels: wood-grain becomes fine noise.
    Interleaved,
}

/// How rays are walked; every technique gives the same picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Technique {
    /// Bounding mesh, brick and block skipping.
    Default,
    /// Bounding box only, every sample taken.
    Basic,
    /// A few samples a pass, finished rays dropped between passes (techniques.md T4).
    Multipass,
    /// All rays layer by layer, over a quadtree of the picture whose leaves know how many layers they have (T3).
    Layers,
    /// A work-group's rays slab by slab through shared memory, from which gradients are taken (T5).
    Slab,
}

impl Technique {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Default,
        Self::Basic,
        Self::Multipass,
        Self::Layers,
        Self::Slab,
    ];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Basic => "basic",
            Self::Multipass => "multipass",
            Self::Layers => "layers",
            Self::Slab => "slab",
        }
    }
}

/// How a segment between two samples gets its colour in mode dvr.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransferMode {
    /// From the sample at its far end, by the transfer function.
    Post,
    /// From the values at both ends, by a table of integrals (techniques.md T2.1).
    Preintegrated,
}

/// Distances of samples in a mode, at rest and while the camera moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Half a voxel at rest.
    Balanced,
    /// One voxel at rest.
    Fast,
    /// A quarter of a voxel at rest.
    Fine,
}

impl Quality {
    /// Distance of samples at rest and while the camera moves, in units of the smallest spacing of level 0. Refined
    /// surfaces bear four to five voxels while the camera moves (techniques.md T1.3); colours that are composited don't.
    pub const fn steps(self, mode: Mode) -> [f64; 2] {
        let is_refined = matches!(mode, Mode::Iso);
        match self {
            Self::Balanced => [0.5, if is_refined { 4.0 } else { 2.0 }],
            Self::Fast => [1.0, if is_refined { 5.0 } else { 3.0 }],
            Self::Fine => [0.25, if is_refined { 2.0 } else { 1.0 }],
        }
    }
}

/// Rays of a pixel that is super-sampled (techniques.md T2.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SamplePattern {
    /// One, through the pixel's centre.
    One,
    /// Two, on a diagonal.
    Two,
    /// Four, on a regular grid.
    Four,
    /// Four, on a rotated grid.
    FourRotated,
    /// Eight, no two in one row or column of eighths.
    Eight,
    /// Sixteen, on a regular grid: what the others are measured against.
    Sixteen,
}

impl SamplePattern {
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::One => "1",
            Self::Two => "2",
            Self::Four => "4",
            Self::FourRotated => "4r",
            Self::Eight => "8",
            Self::Sixteen => "16",
        }
    }

    /// Where in the pixel its rays pass, from its upper left corner, in pixels.
    pub fn places(self) -> Vec<[f32; 2]> {
        let of = |sixteenths: &[[f32; 2]]| sixteenths.iter().map(|p| p.map(|n| n / 16.0)).collect();
        match self {
            Self::One => of(&[[8.0, 8.0]]),
            Self::Two => of(&[[4.0, 4.0], [12.0, 12.0]]),
            Self::Four => of(&[[4.0, 4.0], [12.0, 4.0], [4.0, 12.0], [12.0, 12.0]]),
            Self::FourRotated => of(&[[6.0, 2.0], [14.0, 6.0], [2.0, 10.0], [10.0, 14.0]]),
            Self::Eight => of(&[
                [9.0, 1.0],
                [3.0, 3.0],
                [13.0, 5.0],
                [7.0, 7.0],
                [1.0, 9.0],
                [11.0, 11.0],
                [5.0, 13.0],
                [15.0, 15.0],
            ]),
            Self::Sixteen => (0..16_u8)
                .map(|i| [i % 4, i / 4].map(|n| (f32::from(n) + 0.5) / 4.0))
                .collect(),
        }
    }
}

/// Which pixels get several rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AntiAliasing {
    /// None.
    Off,
    /// All.
    Full(SamplePattern),
    /// Those that differ from one of their four neighbours by more than `threshold` (0–1, the largest difference of a
    /// channel of the premultiplied colour, opacity included).
    Selective {
        /// The rays of such a pixel.
        pattern: SamplePattern,
        /// From 0 to 1.
        threshold: f32,
    },
}

impl AntiAliasing {
    /// The threshold when none is given. On a surface in a CT of an engine, where 4 rays per pixel cost 2.2 times as much, the
    /// error is 7 % above theirs.
    pub const THRESHOLD: f32 = 0.15;
}

/// What is behind the volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// A display colour, 0–1.
    Color(Vec3),
    /// Nothing: the picture keeps its opacity as alpha.
    Transparent,
}

/// From values to colour and opacity.
#[derive(Clone, Debug, PartialEq)]
pub struct Classification {
    /// Colour and opacity by physical value.
    pub transfer: TransferFunction,
    /// Length for which the opacity holds, mm; `None`: the smallest spacing of level 0.
    pub opacity_unit_mm: Option<f64>,
    /// The surfaces of [`Mode::Iso`], in any order, at most [`IsoSurface::MOST`].
    pub iso: Vec<IsoSurface>,
    /// How a segment gets its colour in mode dvr.
    pub transfer_mode: TransferMode,
}

impl PictureSettings {
    /// A picture with everything as it is unless a user chooses otherwise; lit in modes iso and gradient.
    pub fn new(mode: Mode, transfer: TransferFunction, camera: Camera) -> Self {
        Self {
            size: [1024, 768],
            background: Background::Color(Vec3::ZERO),
            mode,
            classification: Classification {
                transfer,
                opacity_unit_mm: None,
                iso: Vec::new(),
                transfer_mode: TransferMode::Post,
            },
            shading: Shading::of_mode(mode),
            step: Quality::Balanced.steps(mode)[0],
            moving_step: Quality::Balanced.steps(mode)[1],
            interpolation: Interpolation::Linear,
            jitter: Jitter::None,
            refine: true,
            lod: LodChoice::Auto,
            lod_error: Self::LOD_ERROR,
            opacity_cutoff: 0.99,
            technique: Technique::Default,
            leap: false,
            anti_aliasing: AntiAliasing::Off,
            depths: false,
            geometry: Arc::default(),
            camera,
        }
    }

    /// The default of `lod_error`: no voxel that is drawn is wider than a pixel, unless level 0 has none finer.
    pub const LOD_ERROR: f64 = 1.0;

    /// A picture is whole for the first time when no voxel is wider than so many pixels, unless level 0 has none finer
    /// ([`Self::first_whole`]).
    pub const FIRST_WHOLE_PIXELS: f64 = 4.0;

    /// The same picture from coarser levels, with the step and the rays of a moving camera, soon there; `None` where all of
    /// that is so already. It may turn out to be from the same levels.
    pub fn first_whole(&self) -> Option<Self> {
        let coarse = Self {
            lod_error: match self.lod {
                LodChoice::Auto => self.lod_error.max(Self::FIRST_WHOLE_PIXELS),
                LodChoice::Fixed(_) => self.lod_error,
            },
            step: self.step.max(self.moving_step),
            anti_aliasing: AntiAliasing::Off,
            ..self.clone()
        };
        (coarse != *self).then_some(coarse)
    }

    /// Does a contribution belong to the segment between two samples, so that both of its ends are sampled at one level?
    pub fn is_by_segment(&self) -> bool {
        self.mode == Mode::Iso || self.is_preintegrated()
    }

    /// Do rays also read voxels of bricks in which nothing can be seen, beside those in which something can? What
    /// technique slab reads is for its rays to tell ([`super::SlabRim`]).
    pub fn reads_beyond_visible(&self) -> bool {
        let is_lit = self.shading.model == ShadingModel::Phong || self.mode == Mode::Gradient;
        let filters = is_lit && self.shading.gradient == GradientFilter::Filtered;
        let surfaces = self.mode == Mode::Iso
            && (self.classification.iso.len() > 1 || self.geometry.faces.are_capped);
        self.is_preintegrated() || surfaces || (filters && !self.mode.projects())
    }

    /// Is the table of integrals used?
    pub fn is_preintegrated(&self) -> bool {
        self.mode == Mode::Dvr && self.classification.transfer_mode == TransferMode::Preintegrated
    }

    /// The same with the camera nowhere: what the frames of one movement have in common.
    pub fn without_place(&self) -> Self {
        Self {
            camera: Camera {
                eye: DVec3::ZERO,
                target: DVec3::ZERO,
                up: DVec3::ZERO,
                ..self.camera
            },
            ..self.clone()
        }
    }

    /// Do frames that are not final leap? Not in modes that project: what is less than the extreme contributes to their
    /// pictures, too. Nor with geometry, which may lie in what is empty, nor in panoramas.
    pub fn leaps(&self) -> bool {
        let is_one_raster = !self.camera.projection.is_panoramic();
        self.leap && !self.mode.projects() && self.geometry.is_empty() && is_one_raster
    }

    /// Which levels are sampled.
    pub fn lod_rule(&self) -> LodRule {
        match self.lod {
            LodChoice::Auto => LodRule::Error(self.lod_error),
            LodChoice::Fixed(lod) => LodRule::Fixed(lod),
        }
    }
}

/// One picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureSettings {
    /// Width and height in pixels, each at least 1.
    pub size: [u32; 2],
    /// What is behind the volume.
    pub background: Background,
    /// What is computed along a ray.
    pub mode: Mode,
    /// From values to colour and opacity.
    pub classification: Classification,
    /// The light and the material.
    pub shading: Shading,
    /// Distance of samples in units of the smallest spacing of level 0, > 0.
    pub step: f64,
    /// The same while the camera moves; a smaller one than `step` is not used.
    pub moving_step: f64,
    /// How values between voxel centres come about.
    pub interpolation: Interpolation,
    /// Where the samples of neighbouring rays lie.
    pub jitter: Jitter,
    /// Six bisection steps at an iso-surface?
    pub refine: bool,
    /// Which level is drawn.
    pub lod: LodChoice,
    /// Under [`LodChoice::Auto`]: how many pixels the voxels of the level may be wide, > 0.
    pub lod_error: f64,
    /// A ray ends when its opacity reaches this, in (0, 1].
    pub opacity_cutoff: f32,
    /// How rays are walked.
    pub technique: Technique,
    /// In frames that are not final, do rays start where those of the frame before first met something
    /// (techniques.md T2.2)? The final picture is always cast without.
    pub leap: bool,
    /// Which pixels get several rays.
    pub anti_aliasing: AntiAliasing,
    /// Are depths told ([`super::Image::depths`])? Of whole pictures, not of drafts.
    pub depths: bool,
    /// What cuts the volume, and what is drawn with it.
    pub geometry: Arc<Geometry>,
    /// From where.
    pub camera: Camera,
}
