//! Transfer functions that come with the program: in Hounsfield units for CT, relative to a range for all else.
//!
//! Opacities are meant for an opacity unit of about a voxel. The CT and MR presets are Brickscope's own; colour maps
//! name their authors.

use super::colormaps::{INFERNO, MAGMA, PLASMA, Stop, TURBO, VIRIDIS};
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
const CC0: &str = "van der Walt, Smith and Firing; CC0";

const BLACK: [f64; 3] = [0.0, 0.0, 0.0];
const WHITE: [f64; 3] = [1.0, 1.0, 1.0];
const BONE: [f64; 3] = [1.0, 0.94, 0.83];
const MARROW: [f64; 3] = [0.88, 0.60, 0.45];
const MUSCLE: [f64; 3] = [0.72, 0.25, 0.20];
const FAT: [f64; 3] = [0.90, 0.78, 0.50];
const BLOOD: [f64; 3] = [0.80, 0.10, 0.08];
const LUNG: [f64; 3] = [0.75, 0.45, 0.40];

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

/// An MR preset: points from 0 to 1.
const fn mr(
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
        map(
            "grey",
            "black to white over the window or percentile range",
            OWN,
            ColorSpace::Rgb,
            Colors::Points(&[(0.0, BLACK), (1.0, WHITE)]),
        ),
        ct(
            "ct-bone",
            "CT: bone, soft tissue invisible",
            &[(150.0, MARROW), (400.0, BONE), (1500.0, WHITE)],
            &[(150.0, 0.0), (300.0, 0.15), (700.0, 0.60), (1500.0, 0.85)],
        ),
        ct(
            "ct-soft-tissue",
            "CT: skin and organs, translucent, with bone",
            &[
                (-120.0, FAT),
                (0.0, MUSCLE),
                (100.0, [0.85, 0.45, 0.35]),
                (300.0, BONE),
                (1500.0, WHITE),
            ],
            &[
                (-160.0, 0.0),
                (-60.0, 0.01),
                (20.0, 0.06),
                (80.0, 0.20),
                (300.0, 0.45),
                (1500.0, 0.80),
            ],
        ),
        ct(
            "ct-lung",
            "CT: lung tissue and its vessels; muscle and bone faint",
            &[
                (-950.0, [0.30, 0.45, 0.60]),
                (-700.0, LUNG),
                (-400.0, BLOOD),
                (100.0, MARROW),
                (1000.0, WHITE),
            ],
            &[
                (-960.0, 0.0),
                (-850.0, 0.02),
                (-600.0, 0.04),
                (-450.0, 0.20),
                (-250.0, 0.02),
                (-100.0, 0.0),
                (150.0, 0.0),
                (1000.0, 0.05),
            ],
        ),
        ct(
            "ct-angio",
            "CT with contrast: vessels red, bone pale",
            &[
                (120.0, [0.45, 0.05, 0.05]),
                (300.0, BLOOD),
                (480.0, [0.95, 0.60, 0.40]),
                (700.0, BONE),
                (1500.0, WHITE),
            ],
            &[
                (130.0, 0.0),
                (200.0, 0.08),
                (320.0, 0.45),
                (600.0, 0.65),
                (1500.0, 0.85),
            ],
        ),
        ct(
            "ct-muscle-bone",
            "CT: muscle and bone, fat removed",
            &[
                (-20.0, [0.45, 0.12, 0.10]),
                (60.0, MUSCLE),
                (160.0, MARROW),
                (350.0, BONE),
                (1500.0, WHITE),
            ],
            &[
                (-10.0, 0.0),
                (30.0, 0.05),
                (80.0, 0.25),
                (200.0, 0.30),
                (500.0, 0.65),
                (1500.0, 0.90),
            ],
        ),
        ct(
            "ct-airways",
            "CT: the surface between air and tissue: airways, gut, skin",
            &[
                (-950.0, [0.35, 0.60, 0.75]),
                (-600.0, [0.85, 0.75, 0.65]),
                (-350.0, LUNG),
            ],
            &[
                (-950.0, 0.0),
                (-750.0, 0.05),
                (-600.0, 0.25),
                (-450.0, 0.05),
                (-350.0, 0.0),
            ],
        ),
        mr(
            "mr-head",
            "MR: head with skin, translucent towards the brain",
            &[
                (0.10, [0.35, 0.20, 0.15]),
                (0.35, [0.80, 0.55, 0.45]),
                (0.60, [0.92, 0.85, 0.75]),
                (1.00, WHITE),
            ],
            &[
                (0.12, 0.0),
                (0.25, 0.03),
                (0.50, 0.15),
                (0.75, 0.45),
                (1.0, 0.70),
            ],
        ),
        mr(
            "mr-angio",
            "MR angiography: bright vessels only",
            &[
                (0.30, [0.40, 0.02, 0.02]),
                (0.60, BLOOD),
                (1.00, [1.0, 0.90, 0.75]),
            ],
            &[(0.35, 0.0), (0.50, 0.15), (0.75, 0.60), (1.0, 0.90)],
        ),
        map(
            "viridis",
            "colour map: blue, green, yellow; even lightness",
            CC0,
            ColorSpace::Rgb,
            Colors::Map(&VIRIDIS),
        ),
        map(
            "magma",
            "colour map: black, purple, pale yellow; even lightness",
            CC0,
            ColorSpace::Rgb,
            Colors::Map(&MAGMA),
        ),
        map(
            "inferno",
            "colour map: black, red, pale yellow; even lightness",
            CC0,
            ColorSpace::Rgb,
            Colors::Map(&INFERNO),
        ),
        map(
            "plasma",
            "colour map: blue, magenta, yellow; even lightness",
            CC0,
            ColorSpace::Rgb,
            Colors::Map(&PLASMA),
        ),
        map(
            "turbo",
            "colour map: a smooth rainbow",
            "Anton Mikhailov, © 2019 Google LLC; Apache-2.0",
            ColorSpace::Rgb,
            Colors::Map(&TURBO),
        ),
        map(
            "cool-warm",
            "colour map: blue, white, red, for values about a middle",
            "two end colours of Moreland's map (2009); no rights claimed",
            ColorSpace::Diverging,
            Colors::Points(&[(0.0, [0.230, 0.299, 0.754]), (1.0, [0.706, 0.016, 0.150])]),
        ),
        map(
            "hot",
            "colour map: black, red, yellow, white",
            "the usual three ramps; no rights claimed",
            ColorSpace::Rgb,
            Colors::Points(&[
                (0.0, [0.0416, 0.0, 0.0]),
                (0.365079, [1.0, 0.0, 0.0]),
                (0.746032, [1.0, 1.0, 0.0]),
                (1.0, WHITE),
            ]),
        ),
        map(
            "bone",
            "colour map: grey with a tinge of blue",
            "the usual three ramps; no rights claimed",
            ColorSpace::Rgb,
            Colors::Points(&[
                (0.0, BLACK),
                (0.365079, [0.319444, 0.319444, 0.444444]),
                (0.746032, [0.652778, 0.777778, 0.777778]),
                (1.0, WHITE),
            ]),
        ),
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
        let tf = TransferFunction {
            name: self.name.to_owned(),
            color: ColorCurve::new(colors, self.space)?,
            opacity: OpacityCurve::new(opacity)?,
        };
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
