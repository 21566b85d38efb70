//! Transfer functions that come with the program: in Hounsfield units for CT, relative to a range for all else.
//!
//! Opacities are meant for an opacity unit of about a voxel. The presets for CT, MR, ultrasound and PET are Brickscope's
//! own; colour maps name their authors.

mod ct;
mod maps;
mod relative;

use super::colormaps::Stop;
use super::curve::{ColorCurve, ColorPoint, ColorSpace, CurveError, OpacityCurve, OpacityPoint};
use super::transfer::TransferFunction;

/// What x of a preset means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PresetScale {
    /// Hounsfield units.
    Hounsfield,
    /// 0 to 1 over a range of physical values: `--window`, or the volume's percentiles.
    Relative,
}

/// A built-in transfer function.
#[derive(Debug)]
pub struct Preset {
    /// Its name for `--tf`.
    pub name: &'static str,
    /// What it shows, in one line.
    pub description: &'static str,
    /// Who made it, and under what terms.
    pub licence: &'static str,
    /// What its x means.
    pub scale: PresetScale,
    space: ColorSpace,
    colors: Colors,
    /// x and opacity; `None`: a line from 0 to the top opacity that is asked for.
    opacity: Option<&'static [(f64, f64)]>,
}

#[derive(Debug)]
enum Colors {
    /// x and red, green, blue.
    Points(&'static [(f64, [f64; 3])]),
    /// A table over 0…1.
    Map(&'static [Stop]),
}

const OWN: &str = "Brickscope's own";

const BLACK: [f64; 3] = [0.0, 0.0, 0.0];
const WHITE: [f64; 3] = [1.0, 1.0, 1.0];
const BLOOD: [f64; 3] = [0.80, 0.10, 0.08];

/// A CT preset: points in HU.
const fn ct(
    name: &'static str,
    description: &'static str,
    colors: &'static [(f64, [f64; 3])],
    opacity: &'static [(f64, f64)],
) -> Preset {
    Preset {
        name,
        description,
        licence: OWN,
        scale: PresetScale::Hounsfield,
        space: ColorSpace::Rgb,
        colors: Colors::Points(colors),
        opacity: Some(opacity),
    }
}

/// A preset for what has no units: points from 0 to 1.
const fn relative(
    name: &'static str,
    description: &'static str,
    colors: &'static [(f64, [f64; 3])],
    opacity: &'static [(f64, f64)],
) -> Preset {
    Preset {
        scale: PresetScale::Relative,
        ..ct(name, description, colors, opacity)
    }
}

/// A colour map: a line of opacity over the range.
const fn map(
    name: &'static str,
    description: &'static str,
    licence: &'static str,
    space: ColorSpace,
    colors: Colors,
) -> Preset {
    Preset {
        name,
        description,
        licence,
        scale: PresetScale::Relative,
        space,
        colors,
        opacity: None,
    }
}

impl Preset {
    /// Every preset, in the order in which they are listed.
    pub const ALL: &'static [Self] = &[
        maps::GREY,
        ct::BONE,
        ct::SOFT_TISSUE,
        ct::LUNG,
        ct::ANGIO,
        ct::MUSCLE_BONE,
        ct::AIRWAYS,
        ct::BONE_CUT,
        ct::AORTA,
        ct::CARDIAC,
        ct::CORONARY,
        ct::CHEST_CONTRAST,
        ct::CHEST_VESSELS,
        ct::PULMONARY,
        ct::LIVER_VESSELS,
        ct::FAT_LAYER,
        ct::MUSCLE_LAYER,
        ct::SKIN,
        ct::AIR,
        ct::MIP,
        ct::XRAY,
        relative::HEAD,
        relative::ANGIO,
        relative::SOFT,
        relative::MIP,
        relative::T2_BRAIN,
        relative::FA_BRAIN,
        relative::FETUS,
        relative::UPTAKE,
        maps::VIRIDIS,
        maps::MAGMA,
        maps::INFERNO,
        maps::PLASMA,
        maps::TURBO,
        maps::COOL_WARM,
        maps::HOT,
        maps::BONE,
    ];

    /// The preset of this name (case does not matter).
    pub fn find(name: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|p| p.name.eq_ignore_ascii_case(name))
    }

    /// Every name, joined by commas, for messages.
    pub fn names() -> String {
        let names: Vec<_> = Self::ALL.iter().map(|p| p.name).collect();
        names.join(", ")
    }

    /// The transfer function in physical units.
    ///
    /// A relative preset is laid over `range` (physical: the window, or the volume's percentiles); one in Hounsfield
    /// units ignores it. `grey` and the colour maps rise linearly from 0 to `ramp_top` (0.5 for DVR, 1 for `mip`,
    /// `minip`, `mean` and `xray`); the others have opacities of their own.
    ///
    /// # Errors
    /// The range of a relative preset is reversed or not finite, or `ramp_top` is not in 0…1.
    pub fn instantiate(
        &self,
        range: [f64; 2],
        ramp_top: f64,
    ) -> Result<TransferFunction, CurveError> {
        let colors = match self.colors {
            Colors::Points(points) => points
                .iter()
                .map(|&(x, rgb)| ColorPoint { x, rgb })
                .collect(),
            Colors::Map(stops) => stops
                .iter()
                .map(|&(place, hex)| ColorPoint {
                    x: f64::from(place) / 255.0,
                    rgb: [16, 8, 0].map(|shift| f64::from(hex >> shift & 0xff) / 255.0),
                })
                .collect(),
        };
        let ramp = [(0.0, 0.0), (1.0, ramp_top)];
        let opacity = self
            .opacity
            .unwrap_or(&ramp)
            .iter()
            .map(|&(x, a)| OpacityPoint::linear(x, a))
            .collect();
        let tf = TransferFunction::new(
            self.name,
            ColorCurve::new(colors, self.space)?,
            OpacityCurve::new(opacity)?,
        );
        match self.scale {
            PresetScale::Hounsfield => Ok(tf),
            PresetScale::Relative => tf.stretched(range),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::grey_ramp;

    #[test]
    fn every_preset_makes_a_function() {
        for preset in Preset::ALL {
            let range = [-500.0, 1500.0];
            let tf = preset.instantiate(range, 0.5).unwrap();
            assert_eq!(
                tf.eval(-2000.0)[3],
                0.0,
                "{}: air is invisible",
                preset.name
            );
            let [lo, hi] = tf.extent();
            if preset.scale == PresetScale::Relative {
                assert!(
                    lo >= range[0] && hi <= range[1],
                    "{}: {lo} to {hi} lies in the range",
                    preset.name
                );
            }
            assert!(
                !preset.description.is_empty() && !preset.licence.is_empty(),
                "{} says what it is",
                preset.name
            );
            assert_eq!(
                Preset::ALL.iter().filter(|p| p.name == preset.name).count(),
                1,
                "{} once",
                preset.name
            );
        }
    }

    #[test]
    fn grey_is_the_window_ramp() {
        let range = [-160.0, 240.0];
        let grey = Preset::find("GREY")
            .unwrap()
            .instantiate(range, 0.5)
            .unwrap();
        assert_eq!(
            grey,
            grey_ramp(-160.0, 240.0, 0.5).unwrap(),
            "the same function"
        );
        assert!(Preset::find("ct-nothing").is_none(), "unknown");
        assert!(
            Preset::find("grey")
                .unwrap()
                .instantiate([1.0, 0.0], 0.5)
                .is_err(),
            "reversed range"
        );
    }

    #[test]
    fn ct_bone_ignores_the_range() {
        let bone = Preset::find("ct-bone").unwrap();
        assert_eq!(
            bone.instantiate([0.0, 1.0], 0.5).unwrap(),
            bone.instantiate([5.0, 9.0], 1.0).unwrap(),
            "absolute"
        );
    }
}
