//! What was typed about a picture, and what it means for a volume: names looked up, defaults filled in, files read.

use anyhow::bail;
use clap::ValueEnum;
use glam::DVec3;

use super::args::{self, AaArg, ByteSize, IsoSurfaces};
use super::geometry::GeometryArgs;
use super::transfer::{TransferArgs, not_drawn, title};
use crate::camera::{Camera, Projection};
use crate::classify::TransferFunction;
use crate::engine::{DeviceChoice, EngineOptions};
use crate::scene::{
    AntiAliasing, Background, Classification, GradientFilter, Interpolation, IsoSurface, Jitter,
    LodChoice, Mode, PictureSettings, Quality, SamplePattern, Shading, ShadingModel, Technique,
    TransferMode,
};
use crate::store::StoreMeta;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ModeArg {
    Dvr,
    Iso,
    Mip,
    Minip,
    Mean,
    Xray,
    Gradient,
}

impl ModeArg {
    fn mode(self) -> Mode {
        match self {
            Self::Dvr => Mode::Dvr,
            Self::Iso => Mode::Iso,
            Self::Mip => Mode::Mip,
            Self::Minip => Mode::MinIp,
            Self::Mean => Mode::Mean,
            Self::Xray => Mode::Xray,
            Self::Gradient => Mode::Gradient,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ShadingArg {
    None,
    Phong,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum InterpolationArg {
    Linear,
    Nearest,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Switch {
    On,
    Off,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ProjectionArg {
    Perspective,
    Orthographic,
    /// Angles from the middle as distances; --fov is the height's and may exceed 180
    Fisheye,
    /// All directions: columns are longitudes, rows latitudes
    Equirectangular,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TechniqueArg {
    Default,
    Basic,
    Multipass,
    Layers,
    Slab,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum JitterArg {
    None,
    Interleaved,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum GradientArg {
    /// Differences of six values around the point
    Central,
    /// The mean of those at seven points
    Filtered,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum QualityArg {
    /// Half a voxel at rest
    Balanced,
    /// One voxel at rest
    Fast,
    /// A quarter of a voxel at rest
    Fine,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TfModeArg {
    Post,
    Preintegrated,
}

/// Which device, and how much memory.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct MachineArgs {
    /// auto, cpu, or part of a graphics adapter's name
    #[arg(long, default_value = "auto", help_heading = "Machine")]
    device: String,
    /// Bound of all memory on the graphics adapter [default: what the picture may need, at most 4GiB, on a software adapter
    /// 2GiB]
    #[arg(long, value_name = "SIZE", help_heading = "Machine")]
    gpu_memory: Option<ByteSize>,
    /// Decoded bricks kept in host memory [default: 1GiB]
    #[arg(long, value_name = "SIZE", help_heading = "Machine")]
    ram: Option<ByteSize>,
}

impl MachineArgs {
    /// Device and budgets.
    pub(super) fn engine_options(&self) -> EngineOptions {
        let device = match self.device.as_str() {
            "auto" => DeviceChoice::Auto,
            "cpu" => DeviceChoice::Cpu,
            name => DeviceChoice::Named(name.to_owned()),
        };
        let default = EngineOptions::default();
        EngineOptions {
            device,
            gpu_memory_bytes: self.gpu_memory.map(|s| s.0),
            ram_bytes: self.ram.map_or(default.ram_bytes, |s| s.0),
            ..default
        }
    }
}

/// The flags of a picture but for where it is taken from, as typed.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct LookArgs {
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = args::picture_size, help_heading = "Picture")]
    size: [u32; 2],
    /// Colour behind the volume, r,g,b from 0 to 1 or #rrggbb, or transparent
    #[arg(long, value_name = "COLOR", default_value = "0,0,0", value_parser = args::background, help_heading = "Picture")]
    background: Background,
    /// What is computed along a ray
    #[arg(long, value_enum, default_value = "dvr", help_heading = "Picture")]
    mode: ModeArg,
    /// Value of a surface of mode iso, physical (HU for CT), with its colour and opacity; LOW..HIGH bounds an interval.
    /// Repeatable
    #[arg(long, value_name = "VALUE[:COLOR[:OPACITY]]", value_parser = args::iso_surfaces, help_heading = "Picture")]
    iso: Vec<IsoSurfaces>,
    /// Rays of a pixel: 1, 2, 4, 4r (rotated grid) or 8; more than 1 means --aa full unless --aa says otherwise
    #[arg(long, value_name = "N", value_parser = args::sample_pattern, help_heading = "Picture")]
    samples: Option<SamplePattern>,
    /// Which pixels get several rays: off, full (all of them), or selective[:THRESHOLD] (those that differ from a
    /// neighbour by more, 0 to 1); with 4r rays unless --samples says otherwise
    #[arg(long, value_name = "off|selective[:T]|full", value_parser = args::anti_aliasing, help_heading = "Picture")]
    aa: Option<AaArg>,

    #[command(flatten)]
    transfer: TransferArgs,
    /// Mode dvr: classify each sample, or each segment between two by integrals
    #[arg(
        long,
        value_enum,
        default_value = "post",
        help_heading = "Classification"
    )]
    tf_mode: TfModeArg,

    /// Lighting [default: phong for iso and gradient, none otherwise; dvr: as the file of --tf says]
    #[arg(long, value_enum, help_heading = "Light")]
    shading: Option<ShadingArg>,
    /// Direction in which the light shines, world [default: along each ray]
    #[arg(long, value_name = "dx,dy,dz", value_parser = args::vec3, help_heading = "Light")]
    light: Option<DVec3>,
    /// Share of the colour that needs no light [default: as the file of --tf says, else 0.15]
    #[arg(long, value_parser = args::not_negative, help_heading = "Light")]
    ambient: Option<f64>,
    /// Share of the colour under perpendicular light [default: as the file of --tf says, else 0.8]
    #[arg(long, value_parser = args::not_negative, help_heading = "Light")]
    diffuse: Option<f64>,
    /// Brightness of the highlight [default: as the file of --tf says, else 0.15, in mode gradient 0]
    #[arg(long, value_parser = args::not_negative, help_heading = "Light")]
    specular: Option<f64>,
    /// Sharpness of the highlight [default: as the file of --tf says, else 20]
    #[arg(long, value_parser = args::not_negative, help_heading = "Light")]
    shininess: Option<f64>,

    /// How normals come about
    #[arg(long, value_enum, default_value = "central", help_heading = "Light")]
    gradient: GradientArg,

    /// Distance of samples in units of the smallest spacing of level 0 [default: 0.5, or as --quality says]
    #[arg(long, value_name = "VOXELS", value_parser = args::positive, help_heading = "Sampling")]
    step: Option<f64>,
    /// Distances of samples at rest and, in a window, while the camera moves
    #[arg(
        long,
        value_enum,
        default_value = "balanced",
        help_heading = "Sampling"
    )]
    quality: QualityArg,
    /// Samples of neighbouring rays at the same distances, or offset in tiles of 4×4 pixels
    #[arg(long, value_enum, default_value = "none", help_heading = "Sampling")]
    jitter: JitterArg,
    /// Values between voxel centres
    #[arg(long, value_enum, default_value = "linear", help_heading = "Sampling")]
    interpolation: InterpolationArg,
    /// Refine iso-surfaces by bisection
    #[arg(long, value_enum, default_value = "on", help_heading = "Sampling")]
    refine: Switch,
    /// Level of detail: auto (by distance, see --lod-error) or a level's number
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = args::lod, help_heading = "Sampling")]
    lod: LodChoice,
    /// With --lod auto: how many pixels a voxel of the level may be wide
    #[arg(long, value_name = "PIXELS", default_value_t = PictureSettings::LOD_ERROR, value_parser = args::positive, help_heading = "Sampling")]
    lod_error: f64,
    /// A ray ends at this opacity
    #[arg(long, default_value = "0.99", value_parser = args::cutoff, help_heading = "Sampling")]
    opacity_cutoff: f32,

    /// How rays run [default: perspective]
    #[arg(long, value_enum, help_heading = "Camera")]
    projection: Option<ProjectionArg>,
    /// Nothing nearer than this is seen, mm
    #[arg(long, value_name = "MM", value_parser = args::not_negative, help_heading = "Camera")]
    near: Option<f64>,

    #[command(flatten)]
    geometry: GeometryArgs,

    #[command(flatten)]
    machine: MachineArgs,
    /// How rays are walked; all give the same picture
    #[arg(long, value_enum, default_value = "default", help_heading = "Machine")]
    technique: TechniqueArg,
    /// While a camera moves, start rays where those of the frame before first met something; the final picture is always
    /// drawn without
    #[arg(long, value_enum, default_value = "off", help_heading = "Machine")]
    leap: Switch,
}

impl LookArgs {
    /// Width and height in pixels.
    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The colour behind the volume.
    pub(super) fn background(&self) -> Background {
        self.background
    }

    /// A flag that was given and that says how rays run.
    pub(super) fn ray_flag(&self) -> Option<&'static str> {
        let projection = self.projection.map(|_| "--projection");
        projection.or(self.near.map(|_| "--near"))
    }

    /// The pictures of all these modes, sizes and steps; an empty list is the one that was typed.
    pub(super) fn variants(
        &self,
        modes: &[ModeArg],
        sizes: &[[u32; 2]],
        steps: &[f64],
    ) -> Vec<Self> {
        fn or<T: Copy>(list: &[T], typed: T) -> Vec<T> {
            if list.is_empty() {
                vec![typed]
            } else {
                list.to_vec()
            }
        }
        let (modes, sizes, steps) = (
            or(modes, self.mode),
            or(sizes, self.size),
            or(
                &steps.iter().copied().map(Some).collect::<Vec<_>>(),
                self.step,
            ),
        );
        let mut variants = Vec::new();
        for &mode in &modes {
            for &size in &sizes {
                variants.extend(steps.iter().map(|&step| Self {
                    mode,
                    size,
                    step,
                    ..self.clone()
                }));
            }
        }
        variants
    }

    /// Device and budgets.
    pub(super) fn engine_options(&self) -> EngineOptions {
        self.machine.engine_options()
    }

    /// The picture that is meant, for the volume of `meta`, taken by `camera`, of which `--projection` and `--near` say more
    /// where they were given. Remarks for the user go into `notes`.
    ///
    /// # Errors
    /// A file can't be read, a name is unknown, or the flags contradict each other or the camera.
    pub(super) fn settings(
        &self,
        meta: &StoreMeta,
        camera: Camera,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<PictureSettings> {
        let mode = self.mode.mode();
        let iso: Vec<IsoSurface> = self.iso.iter().flat_map(|i| i.0.clone()).collect();
        if self.technique == TechniqueArg::Slab && self.jitter == JitterArg::Interleaved {
            bail!(
                "--technique slab takes gradients from neighbouring rays, whose samples must lie at the same distances; \
                 leave --jitter out, or take another technique"
            );
        }
        let quality = match self.quality {
            QualityArg::Balanced => Quality::Balanced,
            QualityArg::Fast => Quality::Fast,
            QualityArg::Fine => Quality::Fine,
        };
        let [step, moving_step] = quality.steps(mode);
        if self.tf_mode == TfModeArg::Preintegrated && mode != Mode::Dvr {
            notes.push(format!(
                "--tf-mode preintegrated is of mode dvr; mode {} is drawn without",
                mode.name()
            ));
        }
        if self.aa == Some(AaArg::Off) && self.samples.is_some_and(|s| s != SamplePattern::One) {
            notes.push("--aa off: one ray of a pixel, whatever --samples says".into());
        }
        let transfer = self.transfer.function(mode, meta, notes)?;
        notes.extend(not_drawn(&transfer));
        if transfer.nearest && self.interpolation == InterpolationArg::Linear {
            notes.push(format!(
                "{} is meant for --interpolation nearest",
                title(&transfer)
            ));
        }
        let shading = self.shading(mode, &transfer)?;
        Ok(PictureSettings {
            size: self.size,
            background: self.background,
            mode,
            classification: Classification {
                opacity_unit_mm: self.transfer.opacity_unit_mm(&transfer),
                transfer,
                iso,
                transfer_mode: match self.tf_mode {
                    TfModeArg::Post => TransferMode::Post,
                    TfModeArg::Preintegrated => TransferMode::Preintegrated,
                },
            },
            shading,
            step: self.step.unwrap_or(step),
            moving_step,
            jitter: match self.jitter {
                JitterArg::None => Jitter::None,
                JitterArg::Interleaved => Jitter::Interleaved,
            },
            leap: self.leap == Switch::On,
            anti_aliasing: self.anti_aliasing()?,
            interpolation: match self.interpolation {
                InterpolationArg::Linear => Interpolation::Linear,
                InterpolationArg::Nearest => Interpolation::Nearest,
            },
            refine: self.refine == Switch::On,
            lod: self.lod,
            lod_error: self.lod_error,
            opacity_cutoff: self.opacity_cutoff,
            technique: match self.technique {
                TechniqueArg::Default => Technique::Default,
                TechniqueArg::Basic => Technique::Basic,
                TechniqueArg::Multipass => Technique::Multipass,
                TechniqueArg::Layers => Technique::Layers,
                TechniqueArg::Slab => Technique::Slab,
            },
            depths: false,
            geometry: self.geometry.geometry()?,
            camera: self.aimed(camera)?,
        })
    }

    /// What was typed, or else what the transfer function says, or else the mode's default.
    fn shading(&self, mode: Mode, transfer: &TransferFunction) -> anyhow::Result<Shading> {
        let mut default = Shading::of_mode(mode);
        if let Some(lighting) = transfer.lighting {
            default.ambient = lighting.ambient as f32;
            default.diffuse = lighting.diffuse as f32;
            default.specular = lighting.specular as f32;
            default.shininess = lighting.shininess as f32;
        }
        // A surface without light has no shape: in modes iso and gradient it takes a flag to go without.
        let model = match (self.shading, transfer.shade) {
            (Some(ShadingArg::None), _) => ShadingModel::None,
            (Some(ShadingArg::Phong), _) => ShadingModel::Phong,
            (None, Some(true)) if mode == Mode::Dvr => ShadingModel::Phong,
            (None, Some(false)) if mode == Mode::Dvr => ShadingModel::None,
            (None, _) => default.model,
        };
        if self.light.is_some_and(|d| d == DVec3::ZERO) {
            bail!("--light 0,0,0 has no direction");
        }
        let or = |given: Option<f64>, default: f32| given.map_or(default, |v| v as f32);
        Ok(Shading {
            model,
            light: self.light,
            ambient: or(self.ambient, default.ambient),
            diffuse: or(self.diffuse, default.diffuse),
            specular: or(self.specular, default.specular),
            shininess: or(self.shininess, default.shininess),
            gradient: match self.gradient {
                GradientArg::Central => GradientFilter::Central,
                GradientArg::Filtered => GradientFilter::Filtered,
            },
        })
    }

    /// `--samples` alone means all pixels, `--aa` alone the rotated grid.
    fn anti_aliasing(&self) -> anyhow::Result<AntiAliasing> {
        let pattern = self.samples.unwrap_or(match self.aa {
            None => SamplePattern::One,
            Some(_) => SamplePattern::FourRotated,
        });
        Ok(match self.aa {
            Some(AaArg::Off) => AntiAliasing::Off,
            Some(AaArg::Selective(_)) if pattern == SamplePattern::One => bail!(
                "--aa selective casts several rays through some pixels, and --samples 1 allows one; give 2, 4, 4r or 8"
            ),
            _ if pattern == SamplePattern::One => AntiAliasing::Off,
            Some(AaArg::Selective(threshold)) => AntiAliasing::Selective { pattern, threshold },
            Some(AaArg::Full) | None => AntiAliasing::Full(pattern),
        })
    }

    /// `camera` with the projection and the near plane that were typed.
    ///
    /// # Errors
    /// No picture can be taken with it.
    pub(super) fn aimed(&self, mut camera: Camera) -> anyhow::Result<Camera> {
        if let Some(projection) = self.projection {
            camera.projection = match projection {
                ProjectionArg::Perspective => Projection::Perspective,
                ProjectionArg::Orthographic => Projection::Orthographic,
                ProjectionArg::Fisheye => Projection::Fisheye,
                ProjectionArg::Equirectangular => Projection::Equirectangular,
            };
        }
        if let Some(near) = self.near {
            camera.near_mm = near;
        }
        camera.basis()?;
        Ok(camera)
    }
}
