//! The full turn of cli.md, and pictures by ticks.

use super::error::BenchError;
use crate::camera::Camera;
use crate::engine::{Engine, TickBudget, TickEvent};
use crate::scene::{PictureSettings, PictureStats, volume_bounds};
use crate::store::StoreMeta;

/// A full turn about a volume: perspective 30°, up +y, azimuth about +y in equal steps from +z on, the eye at
/// [`turn_distance_mm`] from the centre.
#[derive(Clone, Debug)]
pub struct Turn {
    settings: PictureSettings,
    meta: StoreMeta,
    frames: u32,
}

impl Turn {
    /// `frames` pictures of the volume of `meta` like `settings`, but for the camera.
    pub fn new(settings: &PictureSettings, meta: &StoreMeta, frames: u32) -> Self {
        Self {
            settings: settings.clone(),
            meta: meta.clone(),
            frames,
        }
    }

    /// Picture `number`, from 0.
    pub fn frame(&self, number: u32) -> PictureSettings {
        PictureSettings {
            camera: self.camera(number),
            ..self.settings.clone()
        }
    }

    /// The camera of picture `number`.
    pub fn camera(&self, number: u32) -> Camera {
        let meta = &self.meta;
        let center = volume_bounds(meta.dims, &meta.world_from_index).center;
        Camera::turntable(number, self.frames, center, turn_distance_mm(meta))
    }
}

/// Distance of the eye from the centre, mm: 1.5 × n·√3 spacings for a cube of n voxels of one spacing, else 1.5 × the
/// diagonal of the rendered box.
pub fn turn_distance_mm(meta: &StoreMeta) -> f64 {
    let (dims, spacing) = (meta.dims, meta.spacing());
    let is_cube = dims.x == dims.y
        && dims.y == dims.z
        && (spacing.max_element() - spacing.min_element()) <= 1e-6 * spacing.max_element();
    1.5 * if is_cube {
        dims.x as f64 * 3f64.sqrt() * spacing.x
    } else {
        2.0 * volume_bounds(dims, &meta.world_from_index).radius
    }
}

/// Ticks until something happens to the picture that was set; `vol` is named in errors.
///
/// # Errors
/// The settings make no picture, a brick can't be read, or the device fails or is too small.
pub(super) fn next_event(
    engine: &mut Engine,
    vol: &str,
    budget: &TickBudget,
) -> Result<TickEvent, BenchError> {
    loop {
        let report = engine.tick(budget)?;
        match report.event {
            None => {}
            Some(TickEvent::Failed) => {
                return Err(BenchError::FailedBricks {
                    vol: vol.to_owned(),
                    bricks: report.failed_bricks,
                });
            }
            Some(event) => return Ok(event),
        }
    }
}

/// Draws a picture by ticks until it is exact, and tells its numbers.
///
/// # Errors
/// As [`next_event`].
pub(super) fn converge(
    engine: &mut Engine,
    picture: &PictureSettings,
    vol: &str,
    budget: &TickBudget,
) -> Result<PictureStats, BenchError> {
    engine.set_picture(picture.clone());
    while !engine.is_converged() {
        next_event(engine, vol, budget)?;
    }
    Ok(engine.statistics()?.unwrap_or_default())
}
