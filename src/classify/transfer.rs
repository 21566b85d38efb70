//! A transfer function: a named pair of curves, colour and opacity, over the physical value.

use super::curve::{ColorCurve, ColorPoint, ColorSpace, CurveError, OpacityCurve, OpacityPoint};

/// Colour and opacity over the physical value.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// What to call it; may be empty.
    pub name: String,
    /// Colour: display values, no gamma.
    pub color: ColorCurve,
    /// Opacity per opacity unit of length.
    pub opacity: OpacityCurve,
}

impl TransferFunction {
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
            name: self.name.clone(),
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
        })
    }
}

/// Black to white from `lo` to `hi` (physical), opacity 0 to `top_opacity`: the function used without `--tf`, and that
/// of `--window`. `top_opacity` is 0.5 for DVR, 1 for `mip`, `minip`, `mean` and `xray` (cli.md, "Colour").
///
/// # Errors
/// `lo > hi`, not finite, or `top_opacity` outside 0…1.
pub fn grey_ramp(lo: f64, hi: f64, top_opacity: f64) -> Result<TransferFunction, CurveError> {
    Ok(TransferFunction {
        name: "grey".to_owned(),
        color: ColorCurve::new(
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
        opacity: OpacityCurve::new(vec![
            OpacityPoint::linear(lo, 0.0),
            OpacityPoint::linear(hi, top_opacity),
        ])?,
    })
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
}
