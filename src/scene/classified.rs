//! A classification made ready for one mode, one step and one volume: the look-up table that shaders and reference
//! read, and the test "can a range of values be seen" on that very table (invariant 4 of design.md).

use thiserror::Error;

use super::{Mode, PictureSettings};
use crate::camera::CameraError;
use crate::classify::{Lut, OpacityCorrection, Visibility};
use crate::store::StoreMeta;

/// Why a picture can't be made from these settings.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The camera is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Mode iso without a value.
    #[error("mode iso needs a value; give one with --iso VALUE (physical, such as 300 for HU)")]
    NoIsoValue,
    /// The step is too small for the distance.
    #[error("a step of {step_mm} mm gives {samples} samples per ray; give a larger --step")]
    #[expect(missing_docs, reason = "the message names both")]
    TooManySamples { samples: f64, step_mm: f64 },
    /// The level isn't in the store.
    #[error("level {asked} is not in the store; it has levels 0 to {last}")]
    #[expect(missing_docs, reason = "the message names both")]
    NoSuchLevel { asked: u8, last: usize },
}

/// What both renderers read of the classification.
#[derive(Clone, Debug)]
pub struct Classified {
    /// Colour and opacity by stored value; opacity corrected for the step in mode dvr only.
    pub lut: Lut,
    /// Which ranges of stored values matter to the mode.
    pub visibility: Visibility,
    /// The iso-value in stored units; 0 in other modes.
    pub iso_stored: f32,
}

impl Classified {
    /// Prepares `settings` for a volume, samples being `step_mm` apart.
    ///
    /// # Errors
    /// Mode iso without a value.
    pub fn new(
        settings: &PictureSettings,
        meta: &StoreMeta,
        step_mm: f64,
    ) -> Result<Self, SceneError> {
        let classification = &settings.classification;
        let spacing = meta.spacing();
        let unit_mm = classification
            .opacity_unit_mm
            .unwrap_or_else(|| spacing.min_element());
        let correction = match settings.mode {
            Mode::Dvr => OpacityCorrection::Step { step_mm, unit_mm },
            Mode::Iso | Mode::Mip => OpacityCorrection::None,
        };
        let rescale = meta.rescale;
        let data = [meta.value_min as f32, meta.value_max as f32];
        let line = (rescale.slope, rescale.intercept);
        let domain = Lut::fitted_domain(&classification.transfer, line, data.map(f64::from));
        let lut = Lut::bake(&classification.transfer, line, domain, correction);
        let (visibility, iso_stored) = match settings.mode {
            Mode::Dvr => (Visibility::opacity(&lut), 0.0),
            Mode::Mip => (
                Visibility::AboveMinimum {
                    floor: meta.value_min as f32,
                },
                0.0,
            ),
            Mode::Iso => {
                let iso = classification.iso.ok_or(SceneError::NoIsoValue)?;
                // A hair below the value, so that a flat region of exactly that value is inside whatever rounding does.
                let stored =
                    (rescale.stored(iso.value) - f64::from(data[1] - data[0]) * 1e-6) as f32;
                (Visibility::iso(&[stored], data), stored)
            }
        };
        Ok(Self {
            lut,
            visibility,
            iso_stored,
        })
    }
}

/// The window of the default grey ramp, physical: the 1st to the 99.9th percentile of the voxels above the minimum. Where
/// both are one value (a mask), it begins at the minimum, so that the value shows.
pub fn default_window(meta: &StoreMeta) -> [f64; 2] {
    let percentiles = &meta.percentiles;
    let low = if percentiles.p1_above_min < percentiles.p99_9_above_min {
        percentiles.p1_above_min
    } else {
        meta.value_min
    };
    let ends = [low, percentiles.p99_9_above_min].map(|stored| meta.rescale.physical(stored));
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}
