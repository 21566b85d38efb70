//! A transfer function: a named pair of curves, colour and opacity, over the physical value.

use super::curve::{ColorCurve, ColorPoint, ColorSpace, CurveError, OpacityCurve, OpacityPoint};

/// Colour and opacity over the physical value, and what a file may say besides.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// What to call it; may be empty.
    pub name: String,
    /// Colour: display values, no gamma.
    pub color: ColorCurve,
    /// Opacity per opacity unit of length.
    pub opacity: OpacityCurve,
    /// What the opacity is multiplied by, over the magnitude of the gradient: physical units per mean spacing of the voxels,
    /// as VTK and 3D Slicer take it (the change per mm times the mean of the three spacings). `None`: 1 everywhere.
    pub gradient_opacity: Option<OpacityCurve>,
    /// Length for which the opacity holds, mm, above 0.
    pub opacity_unit_mm: Option<f64>,
    /// How the material answers light.
    pub lighting: Option<Lighting>,
    /// Are samples lit?
    pub shade: Option<bool>,
    /// Is it meant for the values of the nearest voxels, not for values between them?
    pub nearest: bool,
    /// Does x run from 0 to 1 over a range that is chosen with the picture? See [`TransferFunction::placed`].
    pub relative: bool,
}

/// How a material answers light: Phong's factors, all at least 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Share of the colour that is there without light.
    pub ambient: f64,
    /// Share of the colour under perpendicular light.
    pub diffuse: f64,
    /// Brightness of the highlight.
    pub specular: f64,
    /// Exponent of the highlight.
    pub shininess: f64,
}

impl TransferFunction {
    /// Two curves and nothing besides.
    pub fn new(name: impl Into<String>, color: ColorCurve, opacity: OpacityCurve) -> Self {
        Self {
            name: name.into(),
            color,
            opacity,
            gradient_opacity: None,
            opacity_unit_mm: None,
            lighting: None,
            shade: None,
            nearest: false,
            relative: false,
        }
    }

    /// Red, green, blue and opacity (not premultiplied) at `x`, physical.
    pub fn eval(&self, x: f64) -> [f64; 4] {
        let [r, g, b] = self.color.eval(x);
        [r, g, b, self.opacity.eval(x)]
    }

    /// Least and greatest x of all control points: outside, both curves are constant.
    pub fn extent(&self) -> [f64; 2] {
        let (c, o) = (self.color.points(), self.opacity.points());
        [c[0].x.min(o[0].x), c[c.len() - 1].x.max(o[o.len() - 1].x)]
    }

    /// The same function with x = 0…1 laid over `range` (which may be of length 0: a step).
    ///
    /// # Errors
    /// The range is reversed or not finite.
    pub fn stretched(&self, [lo, hi]: [f64; 2]) -> Result<Self, CurveError> {
        let place = |x: f64| lo + x * (hi - lo);
        Ok(Self {
            color: ColorCurve::new(
                self.color
                    .points()
                    .iter()
                    .map(|p| ColorPoint {
                        x: place(p.x),
                        ..*p
                    })
                    .collect(),
                self.color.space(),
            )?,
            opacity: OpacityCurve::new(
                self.opacity
                    .points()
                    .iter()
                    .map(|p| OpacityPoint {
                        x: place(p.x),
                        ..*p
                    })
                    .collect(),
            )?,
            ..self.clone()
        })
    }

    /// The function in physical units. A relative one is laid over `range`, and its opacity, a line from 0 to 1, ends at
    /// `ramp_top`, as that of the relative presets without an opacity of their own; any other stays as it is.
    ///
    /// # Errors
    /// The function is relative and the range is reversed or not finite, or `ramp_top` is not in 0…1.
    pub fn placed(self, range: [f64; 2], ramp_top: f64) -> Result<Self, CurveError> {
        if !self.relative {
            return Ok(self);
        }
        let points = self.opacity.points().iter();
        let opacity = OpacityCurve::new(
            points
                .map(|p| OpacityPoint {
                    opacity: p.opacity * ramp_top,
                    ..*p
                })
                .collect(),
        )?;
        Self {
            opacity,
            relative: false,
            ..self
        }
        .stretched(range)
    }
}

/// Black to white from `lo` to `hi` (physical), opacity 0 to `top_opacity`: the function used without `--tf`, and that
/// of `--window`. `top_opacity` is 0.5 for DVR, 1 for `mip`, `minip`, `mean` and `xray` (cli.md, "Colour").
///
/// # Errors
/// `lo > hi`, not finite, or `top_opacity` outside 0…1.
pub fn grey_ramp(lo: f64, hi: f64, top_opacity: f64) -> Result<TransferFunction, CurveError> {
    Ok(TransferFunction::new(
        "grey",
        ColorCurve::new(
            vec![
                ColorPoint {
                    x: lo,
                    rgb: [0.0; 3],
                },
                ColorPoint {
                    x: hi,
                    rgb: [1.0; 3],
                },
            ],
            ColorSpace::Rgb,
        )?,
        OpacityCurve::new(vec![
            OpacityPoint::linear(lo, 0.0),
            OpacityPoint::linear(hi, top_opacity),
        ])?,
    ))
}

/// The range of `--window CENTER,WIDTH`: from centre − width/2 to centre + width/2, physical. `None` unless both are
/// finite and the width is more than 0.
pub fn window_range(center: f64, width: f64) -> Option<[f64; 2]> {
    let range = [center - width * 0.5, center + width * 0.5];
    (width > 0.0 && range.iter().all(|x| x.is_finite())).then_some(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_a_grey_ramp() {
        let [lo, hi] = window_range(40.0, 400.0).unwrap();
        assert_eq!([lo, hi], [-160.0, 240.0], "soft-tissue window");
        let tf = grey_ramp(lo, hi, 0.5).unwrap();
        for (x, rgba) in [
            (-500.0, [0.0, 0.0, 0.0, 0.0]),
            (40.0, [0.5, 0.5, 0.5, 0.25]),
            (500.0, [1.0, 1.0, 1.0, 0.5]),
        ] {
            assert_eq!(tf.eval(x), rgba, "at {x}");
        }
        assert!(window_range(0.0, 0.0).is_none(), "no width");
        assert!(window_range(f64::NAN, 1.0).is_none(), "NaN");
        assert!(grey_ramp(1.0, 0.0, 0.5).is_err(), "reversed");
    }

    #[test]
    fn stretching_moves_the_points_only() {
        let unit = grey_ramp(0.0, 1.0, 1.0).unwrap();
        let tf = unit.stretched([-100.0, 300.0]).unwrap();
        assert_eq!(tf.extent(), [-100.0, 300.0], "extent");
        assert_eq!(tf.eval(100.0), unit.eval(0.5), "middle");
    }

    #[test]
    fn only_relative_functions_are_placed() {
        let grey = grey_ramp(0.0, 1.0, 1.0).unwrap();
        let range = [-100.0, 300.0];
        assert_eq!(
            grey.clone().placed(range, 0.5).unwrap(),
            grey,
            "physical: as it is"
        );
        let relative = TransferFunction {
            relative: true,
            ..grey
        };
        assert_eq!(
            relative.clone().placed(range, 0.5).unwrap(),
            grey_ramp(-100.0, 300.0, 0.5).unwrap(),
            "relative: over the range, up to the top"
        );
        assert!(relative.placed([1.0, 0.0], 0.5).is_err(), "reversed");
    }
}
