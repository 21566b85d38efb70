//! A classification made ready for one mode, one step and one volume: the look-up table that shaders and reference
//! read, and the test "can a range of values be seen" on that very table (invariant 4 of design.md).

use thiserror::Error;

use super::{Mode, PictureSettings, RayFrame};
use crate::camera::CameraError;
use crate::classify::{LUT_ENTRIES, Lut, OpacityCorrection, Visibility};
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
#[derive(Clone, Debug, PartialEq)]
pub struct Classified {
    /// One per level that is sampled, finest first.
    pub levels: Vec<ClassifiedLevel>,
    /// The iso-value in stored units; 0 in other modes.
    pub iso_stored: f32,
    /// The least stored value of the volume: what a maximum begins with.
    pub value_floor: f32,
    /// Stored values that can't be seen, below and above the iso-value (in other modes the same): what samples may read
    /// in bricks in which nothing can be seen.
    pub unseen: [f32; 2],
}

/// The classification of one level's samples.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassifiedLevel {
    /// Colour and opacity by stored value; opacity corrected for the level's step in mode dvr only.
    pub lut: Lut,
    /// Which ranges of stored values matter to the mode.
    pub visibility: Visibility,
}

impl Classified {
    /// Prepares `settings` for a volume and the levels that `frame` samples.
    ///
    /// # Errors
    /// Mode iso without a value.
    pub fn new(
        settings: &PictureSettings,
        meta: &StoreMeta,
        frame: &RayFrame,
    ) -> Result<Self, SceneError> {
        let classification = &settings.classification;
        let unit_mm = classification
            .opacity_unit_mm
            .unwrap_or_else(|| meta.spacing().min_element());
        let rescale = meta.rescale;
        let data = [meta.value_min as f32, meta.value_max as f32];
        let line = (rescale.slope, rescale.intercept);
        let domain = Lut::fitted_domain(&classification.transfer, line, data.map(f64::from));
        let iso_stored = match settings.mode {
            Mode::Dvr | Mode::Mip => 0.0,
            Mode::Iso => {
                let iso = classification.iso.ok_or(SceneError::NoIsoValue)?;
                // A hair below the value, so that a flat region of exactly that value is inside whatever rounding does.
                (rescale.stored(iso.value) - f64::from(data[1] - data[0]) * 1e-6) as f32
            }
        };
        let bake = |correction| Lut::bake(&classification.transfer, line, domain, correction);
        let level = |lut: Lut| ClassifiedLevel {
            visibility: match settings.mode {
                Mode::Dvr => Visibility::opacity(&lut),
                Mode::Mip => Visibility::AboveMinimum {
                    floor: meta.value_min as f32,
                },
                Mode::Iso => Visibility::iso(&[iso_stored], data),
            },
            lut,
        };
        let levels: Vec<ClassifiedLevel> = match settings.mode {
            Mode::Dvr => frame
                .used()
                .iter()
                .map(|l| {
                    let step_mm = l.step_mm_exact;
                    level(bake(OpacityCorrection::Step { step_mm, unit_mm }))
                })
                .collect(),
            Mode::Iso | Mode::Mip => vec![level(bake(OpacityCorrection::None)); frame.used_levels],
        };
        let unseen = match settings.mode {
            // Where every value can be seen, no brick is empty, and nobody reads it.
            Mode::Dvr => [transparent_value(&levels).unwrap_or(data[0]); 2],
            Mode::Mip => [data[0]; 2],
            Mode::Iso => [f32::MIN, f32::MAX],
        };
        Ok(Self {
            levels,
            iso_stored,
            value_floor: data[0],
            unseen,
        })
    }
}

/// A stored value that is fully transparent in every table, rounding of its index included.
fn transparent_value(levels: &[ClassifiedLevel]) -> Option<f32> {
    let is_clear = |i: usize| levels.iter().all(|l| l.lut.entries()[i][3] == 0.0);
    let last = LUT_ENTRIES - 1;
    // Values beyond the domain read the end entries exactly; inside, both neighbours must be clear.
    let [lo, scale] = levels.first()?.lut.index_lo_scale();
    if is_clear(0) {
        return Some(lo);
    }
    (1..last)
        .find(|&i| is_clear(i - 1) && is_clear(i) && is_clear(i + 1))
        .map(|i| lo + i as f32 / scale)
        .or_else(|| {
            (is_clear(last) && is_clear(last - 1)).then(|| lo + (last as f32 + 1.0) / scale)
        })
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
