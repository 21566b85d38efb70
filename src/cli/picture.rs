//! The flags of one picture: how it looks, and where it is taken from.

use std::path::PathBuf;

use glam::DVec3;

use super::args;
use super::config::{LookArgs, ModeArg};
use crate::camera::{Camera, DEFAULT_FOV_Y_DEGREES, Projection};
use crate::engine::EngineOptions;
use crate::scene::{Background, PictureSettings, volume_bounds};
use crate::store::StoreMeta;

/// The flags that choose a camera, as typed.
#[derive(Clone, Debug, clap::Args)]
struct CameraArgs {
    /// Position of the camera, world mm (RAS+)
    #[arg(long, value_name = "x,y,z", value_parser = args::vec3, conflicts_with_all = ["orbit", "camera"], help_heading = "Camera")]
    eye: Option<DVec3>,
    /// What the camera looks at, world mm [default: the volume's centre]
    #[arg(long, value_name = "x,y,z", value_parser = args::vec3, requires = "eye", help_heading = "Camera")]
    target: Option<DVec3>,
    /// What is up in the picture [default: 0,0,1]
    #[arg(long, value_name = "x,y,z", value_parser = args::vec3, requires = "eye", help_heading = "Camera")]
    up: Option<DVec3>,
    /// Vertical field of view, degrees [default: 30]
    #[arg(long, value_name = "DEGREES", value_parser = args::positive, conflicts_with = "camera", help_heading = "Camera")]
    fov: Option<f64>,
    /// Camera on a sphere about the volume: 0,0 is the anterior view, 90,0 the patient's left [default: 0,0,1]
    #[arg(long, value_name = "AZ,EL[,ZOOM]", value_parser = args::orbit, conflicts_with = "camera", help_heading = "Camera")]
    orbit: Option<[f64; 3]>,
    /// Camera from a file
    #[arg(long, value_name = "FILE.json", help_heading = "Camera")]
    camera: Option<PathBuf>,
}

impl CameraArgs {
    /// A flag that was given.
    fn flag(&self) -> Option<&'static str> {
        [
            ("--eye", self.eye.is_some()),
            ("--fov", self.fov.is_some()),
            ("--orbit", self.orbit.is_some()),
            ("--camera", self.camera.is_some()),
        ]
        .into_iter()
        .find_map(|(flag, is_given)| is_given.then_some(flag))
    }

    /// The camera that is meant, for the volume of `meta`.
    fn camera(&self, meta: &StoreMeta) -> anyhow::Result<Camera> {
        let bounds = volume_bounds(meta.dims, &meta.world_from_index);
        let fov = self.fov.unwrap_or(DEFAULT_FOV_Y_DEGREES);
        let camera = if let Some(path) = &self.camera {
            Camera::read(path)?
        } else if let Some(eye) = self.eye {
            let target = self.target.unwrap_or(bounds.center);
            // Looking straight up or down, +z can't be up: anterior is.
            let vertical = (target - eye).normalize_or_zero().z.abs() > 1.0 - 1e-9;
            let up = self
                .up
                .unwrap_or(if vertical { DVec3::Y } else { DVec3::Z });
            Camera {
                eye,
                target,
                up,
                fov_y_degrees: fov,
                projection: Projection::Perspective,
                near_mm: 0.0,
            }
        } else {
            let [azimuth, elevation, zoom] = self.orbit.unwrap_or([0.0, 0.0, 1.0]);
            Camera::orbit(&bounds, azimuth, elevation, zoom, fov)?
        };
        Ok(camera)
    }
}

/// The flags of a picture, as typed.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct PictureArgs {
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    camera: CameraArgs,
}

impl PictureArgs {
    /// The colour behind the volume.
    pub(super) fn background(&self) -> Background {
        self.look.background()
    }

    /// A flag that was given and that chooses a camera.
    pub(super) fn camera_flag(&self) -> Option<&'static str> {
        self.camera.flag().or(self.look.ray_flag())
    }

    /// The pictures of all these modes, sizes and steps; an empty list is the one that was typed.
    pub(super) fn variants(
        &self,
        modes: &[ModeArg],
        sizes: &[[u32; 2]],
        steps: &[f64],
    ) -> Vec<Self> {
        let looks = self.look.variants(modes, sizes, steps).into_iter();
        let with = |look| Self {
            look,
            camera: self.camera.clone(),
        };
        looks.map(with).collect()
    }

    /// Device and budgets.
    pub(super) fn engine_options(&self) -> EngineOptions {
        self.look.engine_options()
    }

    /// The picture that is meant, for the volume of `meta`. Remarks for the user go into `notes`.
    ///
    /// # Errors
    /// A file can't be read, a name is unknown, or the flags contradict each other.
    pub(super) fn settings(
        &self,
        meta: &StoreMeta,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<PictureSettings> {
        let camera = self.camera.camera(meta)?;
        self.look.settings(meta, camera, notes)
    }
}
