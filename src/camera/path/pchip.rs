//! Monotone piecewise cubic interpolation of one number over time: PCHIP (Fritsch and Butland 1984, "A method for
//! constructing local monotone piecewise cubic interpolants"; end slopes as in Moler, Numerical Computing, §3.6).
//!
//! C1, never beyond the values on either side, exactly linear through values on a line, and standing still between equal
//! values.

/// Values over rising times.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pchip {
    values: Vec<f64>,
    /// Per time, the derivative there.
    slopes: Vec<f64>,
}

impl Pchip {
    /// Through `values` at `times`: as many of each, at least one, the times rising.
    pub(super) fn new(times: &[f64], values: Vec<f64>) -> Self {
        let n = values.len();
        if n == 1 {
            return Self {
                values,
                slopes: vec![0.0],
            };
        }
        let widths: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).collect();
        let secants: Vec<f64> = values
            .windows(2)
            .zip(&widths)
            .map(|(v, h)| (v[1] - v[0]) / h)
            .collect();
        let slopes = (0..n)
            .map(|i| match i {
                _ if n == 2 => secants[0],
                0 => end_slope(widths[0], widths[1], secants[0], secants[1]),
                i if i == n - 1 => {
                    end_slope(widths[n - 2], widths[n - 3], secants[n - 2], secants[n - 3])
                }
                _ => {
                    let (before, after) = (secants[i - 1], secants[i]);
                    if before * after > 0.0 {
                        // The weighted harmonic mean.
                        let (w1, w2) = (
                            2.0 * widths[i] + widths[i - 1],
                            widths[i] + 2.0 * widths[i - 1],
                        );
                        (w1 + w2) / (w1 / before + w2 / after)
                    } else {
                        0.0
                    }
                }
            })
            .collect();
        Self { values, slopes }
    }

    /// The value in interval `i` of `width`, at fraction `u` of it.
    pub(super) fn at(&self, i: usize, width: f64, u: f64) -> f64 {
        let Some(&v1) = self.values.get(i + 1) else {
            return self.values[i];
        };
        let v0 = self.values[i];
        let (m0, m1) = (self.slopes[i] * width, self.slopes[i + 1] * width);
        let span = v1 - v0;
        // As a step from the nearer end, so that both ends are met to the bit.
        if u < 0.5 {
            v0 + u * (m0 + u * ((3.0 * span - 2.0 * m0 - m1) + u * (m0 + m1 - 2.0 * span)))
        } else {
            let w = 1.0 - u;
            v1 - w * (m1 + w * ((3.0 * span - 2.0 * m1 - m0) + w * (m0 + m1 - 2.0 * span)))
        }
    }
}

/// The slope at an end: of the parabola through three points, unless that would overshoot.
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if slope * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && slope.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        slope
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_line_stays_a_line() {
        let times = [0.0, 1.0, 1.5, 7.0];
        let p = Pchip::new(&times, times.iter().map(|t| 2.0 - 3.0 * t).collect());
        for (i, t) in times.windows(2).enumerate() {
            for u in [0.0, 0.2, 0.5, 0.9, 1.0] {
                let expected = 2.0 - 3.0 * (t[0] + u * (t[1] - t[0]));
                let found = p.at(i, t[1] - t[0], u);
                assert!((found - expected).abs() < 1e-12, "{found} for {expected}");
            }
        }
    }

    proptest! {
        #[test]
        fn never_beyond_the_values(
            steps in prop::collection::vec((0.01f64..10.0, -5.0f64..5.0), 1..8),
        ) {
            let mut times = vec![0.0];
            let mut values = vec![1.0];
            for (h, d) in steps {
                times.push(times[times.len() - 1] + h);
                values.push(values[values.len() - 1] + d);
            }
            let p = Pchip::new(&times, values.clone());
            for (i, t) in times.windows(2).enumerate() {
                let (a, b) = (values[i], values[i + 1]);
                prop_assert_eq!(p.at(i, t[1] - t[0], 0.0), a);
                prop_assert_eq!(p.at(i, t[1] - t[0], 1.0), b);
                for k in 0..=50 {
                    let v = p.at(i, t[1] - t[0], f64::from(k) / 50.0);
                    prop_assert!(
                        v >= a.min(b) - 1e-9 && v <= a.max(b) + 1e-9,
                        "{} between {} and {}", v, a, b
                    );
                }
            }
        }
    }
}
