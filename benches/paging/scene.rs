//! What is drawn: a few pictures that fit every volume.

use std::fmt;

use brickscope::camera::Camera;
use brickscope::classify::{
    ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction, grey_ramp,
};
use brickscope::scene::{IsoSurface, Mode, PictureSettings, default_window, volume_bounds};
use brickscope::store::StoreMeta;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What is made of the values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) enum Look {
    /// An opaque surface of the value `--iso`.
    Iso,
    /// The default grey ramp.
    Dvr,
    /// The maximum.
    Mip,
    /// Nothing below `from` (in units of `--iso`), soon dense above, in a colour.
    Dense { from: f64, color: [f64; 3] },
    /// A surface at this part of `--iso`.
    IsoAt { part: f64 },
}

impl Look {
    /// The modes.
    pub(crate) const MODES: [Self; 3] = [Self::Iso, Self::Dvr, Self::Mip];
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Iso | Self::IsoAt { .. } => "iso",
            Self::Dvr | Self::Dense { .. } => "dvr",
            Self::Mip => "mip",
        })
    }
}

/// A picture of any volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct View {
    pub(crate) look: Look,
    /// Pixels along each edge.
    pub(crate) size: u32,
    /// In units of the smallest spacing.
    pub(crate) step: f64,
    /// Physical; `None`: the middle of the default window.
    pub(crate) iso: Option<f64>,
    pub(crate) azimuth: f64,
    pub(crate) elevation: f64,
    pub(crate) zoom: f64,
}

impl View {
    /// The settings for the volume of `meta`.
    pub(crate) fn settings(&self, meta: &StoreMeta) -> anyhow::Result<PictureSettings> {
        let [low, high] = default_window(meta);
        let iso = self.iso.unwrap_or(0.5 * (low + high));
        let (mode, transfer) = match self.look {
            Look::Iso | Look::IsoAt { .. } => (Mode::Iso, grey_ramp(low, high, 0.5)?),
            Look::Dvr => (Mode::Dvr, grey_ramp(low, high, 0.5)?),
            Look::Mip => (Mode::Mip, grey_ramp(low, high, 1.0)?),
            Look::Dense { from, color } => (Mode::Dvr, dense(from * iso, 0.1 * iso.abs(), color)?),
        };
        let value = match self.look {
            Look::IsoAt { part } => part * iso,
            _ => iso,
        };
        let bounds = volume_bounds(meta.dims, &meta.world_from_index);
        let camera = Camera::orbit(&bounds, self.azimuth, self.elevation, self.zoom, 30.0)?;
        let mut settings = PictureSettings::new(mode, transfer, camera);
        settings.size = [self.size; 2];
        settings.classification.iso.push(IsoSurface::opaque(value));
        settings.step = self.step;
        Ok(settings)
    }
}

/// Opacity 0 below `from`, a half from `from + width` on.
fn dense(from: f64, width: f64, color: [f64; 3]) -> anyhow::Result<TransferFunction> {
    let dark = (DVec3::from(color) * 0.3).to_array();
    let point = |x, rgb| ColorPoint { x, rgb };
    Ok(TransferFunction::new(
        "dense",
        ColorCurve::new(
            vec![point(from, dark), point(from + 3.0 * width, color)],
            ColorSpace::Rgb,
        )?,
        OpacityCurve::new(vec![
            OpacityPoint::linear(from, 0.0),
            OpacityPoint::linear(from + width, 0.5),
        ])?,
    ))
}
