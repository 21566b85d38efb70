//! A classification made ready for one mode, one step and one volume: the look-up table that shaders and reference
//! read, and the test "can a range of values be seen" on that very table (invariant 4 of design.md).

use std::sync::Arc;

use glam::Vec3;
use thiserror::Error;

use super::{Extreme, IsoSurface, Mode, PictureSettings, RayFrame};
use crate::camera::CameraError;
use crate::classify::{
    LUT_ENTRIES, Lut, OpacityCorrection, PreintegratedTable, SegmentTables, Visibility, grey_ramp,
};
use crate::store::StoreMeta;
use crate::volume::StoredType;

/// Why a picture can't be made from these settings.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The camera is degenerate.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Mode iso without a value.
    #[error("mode iso needs a value; give one with --iso VALUE (physical, such as 300 for HU)")]
    NoIsoValue,
    /// More surfaces than there is room for.
    #[error(
        "{asked} iso-values (an interval has two), and at most {} fit one picture; give fewer --iso",
        IsoSurface::MOST
    )]
    #[expect(missing_docs, reason = "the message names it")]
    TooManyIsoValues { asked: usize },
    /// The step is too small for the distance.
    #[error("a step of {step_mm} mm gives {samples} samples per ray; give a larger --step")]
    #[expect(missing_docs, reason = "the message names both")]
    TooManySamples { samples: f64, step_mm: f64 },
    /// The level isn't in the store.
    #[error("level {asked} is not in the store; it has levels 0 to {last}")]
    #[expect(missing_docs, reason = "the message names both")]
    NoSuchLevel { asked: u8, last: usize },
}

/// What the renderers read of the classification.
#[derive(Clone, Debug, PartialEq)]
pub struct Classified {
    /// One per level that is sampled, finest first.
    pub levels: Vec<ClassifiedLevel>,
    /// The surfaces of mode iso by rising value; empty in other modes.
    pub surfaces: Vec<ClassifiedSurface>,
    /// Least and greatest stored value of the volume: what a maximum, or a minimum, begins with.
    pub value_range: [f32; 2],
    /// In modes mip and minip: no sample times [`Extreme::sign`] is greater ([`Extreme::bound`]).
    pub extreme_end: f32,
    /// A stored value that can't be seen: what samples may read in bricks in which nothing can be. Where every value can be
    /// seen, no brick is empty, and nobody reads it. In mode iso any value on the brick's side of the surfaces
    /// will do, and a pre-integrated segment needs the value itself.
    pub unseen: f32,
    /// In mode gradient: optical depth is scaled by min(1, this · length of the gradient (stored units per mm)), so that
    /// it is whole where the value crosses a quarter of the transfer function's range within the smallest spacing of level 0.
    pub gradient_scale: f32,
}

/// The classification of one level's samples.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassifiedLevel {
    /// Colour by stored value, and opacity: corrected for the level's step in modes dvr and xray, as an optical depth in mode
    /// gradient ([`OpacityCorrection::Depth`]), as it is in the others.
    pub lut: Lut,
    /// Colour and opacity of the level's segments, where the picture is pre-integrated.
    pub preintegrated: Option<Arc<PreintegratedTable>>,
    /// Which ranges of stored values matter to the mode.
    pub visibility: Visibility,
}

/// A surface of mode iso.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassifiedSurface {
    /// Stored value, a hair below the one asked for.
    pub value: f32,
    /// Display colour.
    pub color: Vec3,
    /// In [0, 1].
    pub opacity: f32,
}

impl Classified {
    /// Prepares `settings` for a volume and the levels that `frame` samples, with the tables of segments among `known`, if they
    /// are there.
    ///
    /// # Errors
    /// Mode iso without a value, or with too many.
    pub fn new(
        settings: &PictureSettings,
        meta: &StoreMeta,
        frame: &RayFrame,
        known: &SegmentTables,
    ) -> Result<Self, SceneError> {
        let classification = &settings.classification;
        let mode = settings.mode;
        let unit_mm = classification
            .opacity_unit_mm
            .unwrap_or_else(|| meta.spacing().min_element());
        let rescale = meta.rescale;
        let value_range = [meta.value_min as f32, meta.value_max as f32];
        let line = (rescale.slope, rescale.intercept);
        let transfer = &classification.transfer;
        let window = transfer.extent();
        // Mode xray knows but the place in the window, whatever the transfer function makes of it.
        let grey = grey_ramp(window[0], window[1], 1.0).ok();
        let transfer = grey
            .as_ref()
            .filter(|_| mode == Mode::Xray)
            .unwrap_or(transfer);
        let domain = Lut::fitted_domain(transfer, line, value_range.map(f64::from));
        let surfaces = surfaces(settings, meta)?;
        let values: Vec<f32> = surfaces.iter().map(|s| s.value).collect();
        let segments = settings.is_preintegrated().then(|| {
            // One entry per value where there are so few.
            let side = match meta.stored_type {
                StoredType::U8 => 256,
                StoredType::U16 | StoredType::F32 => 1024,
            };
            let steps: Vec<f64> = frame.used().iter().map(|l| l.step_mm_exact).collect();
            known.of(
                transfer,
                line,
                value_range.map(f64::from),
                side,
                unit_mm,
                &steps,
            )
        });
        let judge = |visibility: Visibility| match meta.stored_type {
            StoredType::U8 => visibility.of_bytes(),
            StoredType::U16 | StoredType::F32 => visibility,
        };
        let level = |number: usize, step_mm: f64| {
            let correction = match mode {
                Mode::Dvr | Mode::Xray => OpacityCorrection::Step { step_mm, unit_mm },
                Mode::Gradient => OpacityCorrection::Depth { step_mm, unit_mm },
                Mode::Iso | Mode::Mip | Mode::MinIp | Mode::Mean => OpacityCorrection::None,
            };
            let lut = Lut::bake(transfer, line, domain, correction);
            let [floor, ceiling] = value_range;
            ClassifiedLevel {
                visibility: judge(match (mode, &segments) {
                    (Mode::Dvr, Some((integrals, _))) => Visibility::preintegrated(integrals),
                    (Mode::Dvr | Mode::Xray | Mode::Gradient, _) => Visibility::opacity(&lut),
                    (Mode::Mip, _) => Visibility::AboveMinimum { floor },
                    (Mode::MinIp, _) => Visibility::BelowMaximum { ceiling },
                    (Mode::Mean, _) => Visibility::All,
                    (Mode::Iso, _) => Visibility::iso(&values, value_range),
                }),
                preintegrated: segments
                    .as_ref()
                    .map(|(_, tables)| Arc::clone(&tables[number])),
                lut,
            }
        };
        let levels: Vec<ClassifiedLevel> = if mode.composites() {
            let used = frame.used().iter().enumerate();
            used.map(|(n, l)| level(n, l.step_mm_exact)).collect()
        } else {
            vec![level(0, frame.step_mm_exact); frame.used_levels]
        };
        let unseen = match mode {
            Mode::MinIp => value_range[1],
            mode if mode.composites() => transparent_value(&levels).unwrap_or(value_range[0]),
            _ => value_range[0],
        };
        let width = ((window[1] - window[0]) / rescale.slope).abs();
        let gradient_scale = 4.0 * meta.spacing().min_element() / width;
        Ok(Self {
            levels,
            surfaces,
            value_range,
            extreme_end: Extreme::of_mode(mode).bound(meta.stored_type, value_range),
            unseen,
            // A window without width: every gradient counts in full.
            gradient_scale: gradient_scale.min(f64::from(f32::MAX) * 0.5) as f32,
        })
    }

    /// On how many surfaces' upper sides `value` lies: the number of the zone between them.
    pub fn zone(&self, value: f32) -> usize {
        self.surfaces.iter().filter(|s| value >= s.value).count()
    }
}

/// The surfaces of mode iso, sorted, with stored values.
fn surfaces(
    settings: &PictureSettings,
    meta: &StoreMeta,
) -> Result<Vec<ClassifiedSurface>, SceneError> {
    if settings.mode != Mode::Iso {
        return Ok(Vec::new());
    }
    let asked = &settings.classification.iso;
    match asked.len() {
        0 => return Err(SceneError::NoIsoValue),
        n if n > IsoSurface::MOST => return Err(SceneError::TooManyIsoValues { asked: n }),
        _ => (),
    }
    // A hair below the value, so that a flat region of exactly that value is inside whatever rounding does.
    let hair = f64::from(meta.value_max as f32 - meta.value_min as f32) * 1e-6;
    let mut surfaces: Vec<ClassifiedSurface> = asked
        .iter()
        .map(|s| ClassifiedSurface {
            value: (meta.rescale.stored(s.value) - hair) as f32,
            color: s.color,
            opacity: s.opacity,
        })
        .collect();
    surfaces.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(surfaces)
}

/// A stored value that is fully transparent in every look-up table, rounding of its index included.
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
