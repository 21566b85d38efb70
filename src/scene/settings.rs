//! Everything a user may choose about one picture, in physical units.

use glam::{DVec3, Vec3};

use super::LodRule;
use crate::camera::Camera;
use crate::classify::TransferFunction;
use crate::geom::Lod;

/// What is computed along a ray (cli.md, "Colour").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Direct volume rendering: front-to-back compositing of classified samples.
    Dvr,
    /// First contact with the surface of one value.
    Iso,
    /// Maximum along the ray, classified once.
    Mip,
}

impl Mode {
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dvr => "dvr",
            Self::Iso => "iso",
            Self::Mip => "mip",
        }
    }
}

/// An opaque surface of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoSurface {
    /// Physical value.
    pub value: f64,
    /// Display colour, 0–1.
    pub color: Vec3,
}

impl IsoSurface {
    /// The colour of a surface when none is given: a warm near-white.
    pub const DEFAULT_COLOR: Vec3 = Vec3::new(0.92, 0.88, 0.80);
}

/// Are samples lit?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShadingModel {
    /// Colours are shown as classified.
    None,
    /// Phong's model on central-difference normals, two-sided.
    Phong,
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

/// How rays are walked; every technique gives the same picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// Bounding mesh, brick and block skipping.
    Default,
    /// Bounding box only, every sample taken.
    Basic,
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
    /// The surface of [`Mode::Iso`].
    pub iso: Option<IsoSurface>,
}

impl PictureSettings {
    /// The default of `lod_error`: no voxel that is drawn is wider than a pixel, unless level 0 has none finer.
    pub const LOD_ERROR: f64 = 1.0;

    /// A picture is whole for the first time when no voxel is wider than so many pixels, unless level 0 has none finer.
    pub const FIRST_WHOLE_PIXELS: f64 = 4.0;

    /// The same picture from coarser levels, soon there; `None` where levels are not chosen by distance, or coarse
    /// already. It may turn out to be from the same levels.
    pub fn first_whole(&self) -> Option<Self> {
        let is_finer = self.lod == LodChoice::Auto && self.lod_error < Self::FIRST_WHOLE_PIXELS;
        is_finer.then(|| Self {
            lod_error: Self::FIRST_WHOLE_PIXELS,
            ..self.clone()
        })
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
    /// How values between voxel centres come about.
    pub interpolation: Interpolation,
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
    /// From where.
    pub camera: Camera,
}
