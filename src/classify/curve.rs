//! Control points and what lies between them: exactly VTK's `vtkColorTransferFunction` and `vtkPiecewiseFunction`.
//!
//! Before the first and after the last point the end value holds. Points may share an x (a step): at that x the first
//! of them holds, after it the last.

use thiserror::Error;

use super::color::{mix, mix_diverging, mix_hsv, mix_hsv_wrapped, mix_lab};

/// More control points than this in one curve are refused: no one draws them, and files are untrusted.
pub const MAX_POINTS: usize = 65_536;

/// How colours between control points are found (ParaView's `ColorSpace`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum ColorSpace {
    /// Red, green and blue, linearly.
    #[default]
    Rgb,
    /// Hue (never through red), saturation and value, linearly.
    Hsv,
    /// The same with hue by the shorter way round (ParaView's `HSVWrap`).
    HsvWrapped,
    /// CIE L*a*b*, linearly.
    Lab,
    /// Moreland's diverging maps: through white between distinct saturated colours.
    Diverging,
    /// Not at all: the colour of the next point holds.
    Step,
}

/// A control point of a [`ColorCurve`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorPoint {
    /// Where, in physical units.
    pub x: f64,
    /// Display values, 0 to 1.
    pub rgb: [f64; 3],
}

/// A control point of an [`OpacityCurve`]; midpoint and sharpness shape the way to the next point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpacityPoint {
    /// Where, in physical units.
    pub x: f64,
    /// Opacity per opacity unit of length, 0 to 1.
    pub opacity: f64,
    /// Where between this point and the next the mean of both is reached, 0 to 1; 0.5 is the middle.
    pub midpoint: f64,
    /// From 0 (a line) to 1 (a step at the midpoint).
    pub sharpness: f64,
}

impl OpacityPoint {
    /// A point that is joined to the next by a line.
    pub const fn linear(x: f64, opacity: f64) -> Self {
        Self {
            x,
            opacity,
            midpoint: 0.5,
            sharpness: 0.0,
        }
    }
}

/// Why points don't make a curve.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum CurveError {
    /// No point at all.
    #[error("no control point; at least one is needed")]
    Empty,
    /// More than [`MAX_POINTS`].
    #[error("{0} control points; at most {MAX_POINTS} are read")]
    TooMany(usize),
    /// NaN, infinity, or outside 0…1.
    #[error("point {index}: {what} is {value}; expected {expected}")]
    Value {
        /// Which point, from 0.
        index: usize,
        /// `x`, `red`, `opacity`, …
        what: &'static str,
        /// What is there.
        value: f64,
        /// What belongs there.
        expected: &'static str,
    },
    /// A point lies before the one before it.
    #[error(
        "point {index}: x = {x} is less than the x = {previous} before it; sort the points by x"
    )]
    Decreasing {
        /// Which point, from 0.
        index: usize,
        /// Its x.
        x: f64,
        /// The x of the point before.
        previous: f64,
    },
}

/// Colour over physical value.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorCurve {
    points: Vec<ColorPoint>,
    space: ColorSpace,
}

/// Opacity over physical value.
#[derive(Clone, Debug, PartialEq)]
pub struct OpacityCurve {
    points: Vec<OpacityPoint>,
}

impl ColorCurve {
    /// The curve through `points`, joined in `space`.
    ///
    /// # Errors
    /// There is no point or more than [`MAX_POINTS`], x decreases, or a value is not finite or a colour not in 0…1.
    pub fn new(points: Vec<ColorPoint>, space: ColorSpace) -> Result<Self, CurveError> {
        check_xs(points.iter().map(|p| p.x))?;
        for (index, p) in points.iter().enumerate() {
            for (what, value) in ["red", "green", "blue"].into_iter().zip(p.rgb) {
                check_unit(index, what, value)?;
            }
        }
        Ok(Self { points, space })
    }

    /// The control points, x not decreasing; at least one.
    pub fn points(&self) -> &[ColorPoint] {
        &self.points
    }

    /// How they are joined.
    pub fn space(&self) -> ColorSpace {
        self.space
    }

    /// The colour at `x` (physical), 0 to 1.
    pub fn eval(&self, x: f64) -> [f64; 3] {
        let (a, b) = match locate(&self.points, |p| p.x, x) {
            Place::End(p) => return p.rgb,
            Place::Between(a, b) => (a, b),
        };
        let t = (x - a.x) / (b.x - a.x);
        match self.space {
            ColorSpace::Rgb => mix(a.rgb, b.rgb, t),
            ColorSpace::Hsv => mix_hsv(a.rgb, b.rgb, t),
            ColorSpace::HsvWrapped => mix_hsv_wrapped(a.rgb, b.rgb, t),
            ColorSpace::Lab => mix_lab(a.rgb, b.rgb, t),
            ColorSpace::Diverging => mix_diverging(a.rgb, b.rgb, t),
            ColorSpace::Step => b.rgb,
        }
    }
}

impl OpacityCurve {
    /// The curve through `points`.
    ///
    /// # Errors
    /// There is no point or more than [`MAX_POINTS`], x decreases, or a value is not finite or, other than x, not in
    /// 0…1.
    pub fn new(points: Vec<OpacityPoint>) -> Result<Self, CurveError> {
        check_xs(points.iter().map(|p| p.x))?;
        for (index, p) in points.iter().enumerate() {
            check_unit(index, "opacity", p.opacity)?;
            check_unit(index, "midpoint", p.midpoint)?;
            check_unit(index, "sharpness", p.sharpness)?;
        }
        Ok(Self { points })
    }

    /// The control points, x not decreasing; at least one.
    pub fn points(&self) -> &[OpacityPoint] {
        &self.points
    }

    /// The opacity at `x` (physical), 0 to 1, per opacity unit.
    pub fn eval(&self, x: f64) -> f64 {
        match locate(&self.points, |p| p.x, x) {
            Place::End(p) => p.opacity,
            Place::Between(a, b) => shaped(
                (x - a.x) / (b.x - a.x),
                [a.opacity, b.opacity],
                a.midpoint,
                a.sharpness,
            ),
        }
    }
}

/// VTK's joint between two values: a line for sharpness below 0.01, a step above 0.99 (as its documentation has it),
/// between them a Hermite curve whose tangents shrink and whose argument is squeezed as sharpness grows. The mean of
/// both values is reached at `midpoint`.
fn shaped(t: f64, [a, b]: [f64; 2], midpoint: f64, sharpness: f64) -> f64 {
    let midpoint = midpoint.clamp(1e-5, 1.0 - 1e-5);
    let s = if t < midpoint {
        0.5 * t / midpoint
    } else {
        0.5 + 0.5 * (t - midpoint) / (1.0 - midpoint)
    };
    if sharpness > 0.99 {
        return if s < 0.5 { a } else { b };
    }
    if sharpness < 0.01 {
        return (1.0 - s) * a + s * b;
    }
    let power = 1.0 + 10.0 * sharpness;
    let s = if s < 0.5 {
        0.5 * (2.0 * s).powf(power)
    } else {
        1.0 - 0.5 * (2.0 * (1.0 - s)).powf(power)
    };
    let (s2, s3) = (s * s, s * s * s);
    let tangent = (1.0 - sharpness) * (b - a);
    let value = (2.0 * s3 - 3.0 * s2 + 1.0) * a
        + (3.0 * s2 - 2.0 * s3) * b
        + (2.0 * s3 - 3.0 * s2 + s) * tangent;
    value.clamp(a.min(b), a.max(b))
}

enum Place<'a, P> {
    /// Before the first point, at or after the last, or on the first of several.
    End(&'a P),
    /// After the first, not after the second; their x differ.
    Between(&'a P, &'a P),
}

/// Where `x` lies among `points` (not empty, x not decreasing). NaN is before all.
fn locate<P>(points: &[P], at: impl Fn(&P) -> f64, x: f64) -> Place<'_, P> {
    // Of several points at the last x the last one holds, there and beyond: a step at the end of the data is seen.
    if let Some(last) = points.last().filter(|p| x >= at(p)) {
        return Place::End(last);
    }
    // The first point that is not before x.
    let next = points.partition_point(|p| at(p) < x);
    match (next.checked_sub(1), points.get(next)) {
        (None, _) => Place::End(&points[0]),
        (Some(last), None) => Place::End(&points[last]),
        (Some(previous), Some(next)) => Place::Between(&points[previous], next),
    }
}

fn check_xs(xs: impl ExactSizeIterator<Item = f64>) -> Result<(), CurveError> {
    match xs.len() {
        0 => return Err(CurveError::Empty),
        n if n > MAX_POINTS => return Err(CurveError::TooMany(n)),
        _ => {}
    }
    let mut previous = f64::NEG_INFINITY;
    for (index, x) in xs.enumerate() {
        if !x.is_finite() {
            return Err(CurveError::Value {
                index,
                what: "x",
                value: x,
                expected: "a finite number",
            });
        }
        if x < previous {
            return Err(CurveError::Decreasing { index, x, previous });
        }
        previous = x;
    }
    Ok(())
}

fn check_unit(index: usize, what: &'static str, value: f64) -> Result<(), CurveError> {
    if (0.0..=1.0).contains(&value) {
        Ok(())
    } else {
        Err(CurveError::Value {
            index,
            what,
            value,
            expected: "a number from 0 to 1",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opacity(points: &[(f64, f64, f64, f64)]) -> OpacityCurve {
        let point = |&(x, opacity, midpoint, sharpness): &(f64, f64, f64, f64)| OpacityPoint {
            x,
            opacity,
            midpoint,
            sharpness,
        };
        OpacityCurve::new(points.iter().map(point).collect()).unwrap()
    }

    #[test]
    fn lines_and_held_ends() {
        let c = opacity(&[(-10.0, 0.2, 0.5, 0.0), (10.0, 0.6, 0.5, 0.0)]);
        for (x, a) in [
            (-99.0, 0.2),
            (-10.0, 0.2),
            (0.0, 0.4),
            (10.0, 0.6),
            (99.0, 0.6),
        ] {
            assert!((c.eval(x) - a).abs() < 1e-15, "at {x}: {}", c.eval(x));
        }
    }

    #[test]
    fn midpoint_is_where_the_mean_is_reached() {
        for sharpness in [0.0, 0.2, 0.5, 0.9] {
            let c = opacity(&[(0.0, 0.1, 0.3, sharpness), (1.0, 0.9, 0.5, 0.0)]);
            assert!(
                (c.eval(0.3) - 0.5).abs() < 1e-12,
                "sharpness {sharpness}: {}",
                c.eval(0.3)
            );
        }
        let step = opacity(&[(0.0, 0.1, 0.3, 1.0), (1.0, 0.9, 0.5, 0.0)]);
        assert_eq!((step.eval(0.29), step.eval(0.3)), (0.1, 0.9), "a step");
    }

    #[test]
    fn hermite_value_by_hand() {
        // t = 0.25, midpoint 0.5, sharpness 0.5: s = 0.5·0.5⁶ = 1/128; h2 + 0.5·(h3 + h4).
        let c = opacity(&[(0.0, 0.0, 0.5, 0.5), (1.0, 1.0, 0.5, 0.0)]);
        let s = 1.0 / 128.0_f64;
        let expected = 3.0 * s * s - 2.0 * s.powi(3)
            + 0.5 * ((s.powi(3) - 2.0 * s * s + s) + (s.powi(3) - s * s));
        assert!((c.eval(0.25) - expected).abs() < 1e-15, "{expected}");
    }

    #[test]
    fn points_at_one_x_make_a_step() {
        let c = opacity(&[
            (0.0, 0.0, 0.5, 0.0),
            (1.0, 0.2, 0.5, 0.0),
            (1.0, 0.8, 0.5, 0.0),
            (2.0, 1.0, 0.5, 0.0),
        ]);
        assert_eq!(c.eval(1.0), 0.2, "on it: the first");
        assert!(
            (c.eval(1.0 + 1e-9) - 0.8).abs() < 1e-6,
            "after it: the last"
        );
    }

    #[test]
    fn step_colours_are_the_next_points() {
        let point = |x: f64, g: f64| ColorPoint {
            x,
            rgb: [0.0, g, 0.0],
        };
        let c = ColorCurve::new(vec![point(0.0, 0.1), point(1.0, 0.7)], ColorSpace::Step).unwrap();
        assert_eq!(
            [c.eval(0.0)[1], c.eval(0.01)[1], c.eval(1.0)[1]],
            [0.1, 0.7, 0.7],
            "as VTK's step space"
        );
    }

    #[test]
    fn bad_points_are_refused() {
        let at = |x: f64| OpacityPoint::linear(x, 0.5);
        assert_eq!(OpacityCurve::new(vec![]), Err(CurveError::Empty), "none");
        assert!(
            matches!(
                OpacityCurve::new(vec![at(1.0), at(0.0)]),
                Err(CurveError::Decreasing { index: 1, .. })
            ),
            "decreasing"
        );
        assert!(OpacityCurve::new(vec![at(f64::NAN)]).is_err(), "NaN");
        assert!(
            OpacityCurve::new(vec![OpacityPoint::linear(0.0, 1.5)]).is_err(),
            "opacity 1.5"
        );
        assert!(
            matches!(
                OpacityCurve::new(vec![at(0.0); MAX_POINTS + 1]),
                Err(CurveError::TooMany(_))
            ),
            "too many"
        );
    }
}
