//! Orientations over time: a C1 curve of unit quaternions through those of the key frames.
//!
//! Between two keys q is the cumulative cubic Bézier curve of Kim, Kim and Shin 1995 ("A general construction scheme for unit
//! quaternion curves with simple high order derivatives"): q₀·exp(w₁B₁)·exp(w₂B₂)·exp(w₃B₃). At the keys it has the angular
//! velocities that Shoemake's squad (1987) has for equal intervals, and their generalisation for others. Unlike squad
//! it does not slerp between its inner points, so it has no direction in which it breaks down, also when the camera turns by
//! 180° from key to key.

use glam::{DMat3, DQuat, DVec3};

use crate::camera::pose::Basis;

/// Orientations at rising times.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Turn {
    keys: Vec<DQuat>,
    /// Per interval, w₁, w₂, w₃: halves of rotation vectors in the camera's axes.
    steps: Vec<[DVec3; 3]>,
}

impl Turn {
    /// Through the orientations of `bases` at `times`: as many of each, at least one, the times rising.
    pub(super) fn new(times: &[f64], bases: &[Basis]) -> Self {
        let mut keys: Vec<DQuat> = Vec::with_capacity(bases.len());
        for basis in bases {
            let q = DQuat::from_mat3(&DMat3::from_cols(basis.right, basis.up, -basis.forward))
                .normalize();
            // q and −q are one orientation: the shorter way from the key before.
            let is_far = keys.last().is_some_and(|&before| before.dot(q) < 0.0);
            keys.push(if is_far { -q } else { q });
        }
        let widths: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).collect();
        let ways: Vec<DVec3> = keys
            .windows(2)
            .map(|q| log(q[0].conjugate() * q[1]))
            .collect();
        let velocities: Vec<DVec3> = (0..keys.len())
            .map(|i| velocity(&widths, &ways, i))
            .collect();
        let steps = ways
            .iter()
            .enumerate()
            .map(|(i, _)| {
                let first = velocities[i] * (widths[i] / 3.0);
                let last = velocities[i + 1] * (widths[i] / 3.0);
                let middle = exp(-first) * keys[i].conjugate() * keys[i + 1] * exp(-last);
                // Of the two quaternions of the same rotation the one with the shorter way.
                let middle = if middle.w < 0.0 { -middle } else { middle };
                [first, log(middle), last]
            })
            .collect();
        Self { keys, steps }
    }

    /// The orientation in interval `i` at fraction `u` of it, as the picture's axes.
    pub(super) fn at(&self, i: usize, u: f64) -> Basis {
        let q = match self.steps.get(i) {
            None => self.keys[i],
            Some([first, middle, last]) => {
                // Cumulative Bernstein polynomials of degree 3.
                let v = 1.0 - u;
                self.keys[i]
                    * exp(*first * (1.0 - v * v * v))
                    * exp(*middle * (u * u * (3.0 - 2.0 * u)))
                    * exp(*last * (u * u * u))
            }
        };
        let axes = DMat3::from_quat(q.normalize());
        Basis {
            right: axes.x_axis,
            up: axes.y_axis,
            forward: -axes.z_axis,
        }
    }
}

/// Half the angular velocity at key `i`: that of a parabola through the keys on both sides, nothing at the ends of a rest,
/// and never more than three times the mean on either side, so that the camera does not overshoot.
fn velocity(widths: &[f64], ways: &[DVec3], i: usize) -> DVec3 {
    let mean = |k: usize| ways[k] / widths[k];
    match (i.checked_sub(1), ways.get(i)) {
        (None, None) => DVec3::ZERO,
        // A path begins and ends with the mean of its first and last interval.
        (None, Some(_)) => mean(0),
        (Some(before), None) => mean(before),
        (Some(before), Some(_)) => {
            let (a, b) = (mean(before), mean(i));
            let v = (a * widths[i] + b * widths[before]) / (widths[before] + widths[i]);
            v.clamp_length_max(3.0 * a.length().min(b.length()))
        }
    }
}

/// Half the rotation vector of a unit quaternion.
fn log(q: DQuat) -> DVec3 {
    let axis = q.xyz();
    let sin = axis.length();
    if sin < 1e-150 {
        return DVec3::ZERO;
    }
    axis * (sin.atan2(q.w) / sin)
}

/// The unit quaternion of twice a rotation vector: the inverse of [`log`].
fn exp(half: DVec3) -> DQuat {
    let angle = half.length();
    let (sin, cos) = angle.sin_cos();
    let scale = if angle < 1e-150 { 1.0 } else { sin / angle };
    let v = half * scale;
    DQuat::from_xyzw(v.x, v.y, v.z, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_and_exp_are_inverse() {
        for v in [
            DVec3::ZERO,
            DVec3::new(1e-12, 0.0, 0.0),
            DVec3::new(0.3, -1.0, 0.2),
            DVec3::new(0.0, 3.0, 0.0),
        ] {
            let back = log(exp(v));
            assert!(back.distance(v) < 1e-14, "{v} came back as {back}");
        }
    }

    #[test]
    fn an_even_turn_stays_even() {
        // 30° about an axis per second, at uneven times.
        let times = [0.0, 1.0, 1.5, 4.0];
        let axis = DVec3::new(1.0, 2.0, -1.0).normalize();
        let at = |t: f64| DQuat::from_axis_angle(axis, (30.0 * t).to_radians());
        let basis = |q: DQuat| Basis {
            right: q * DVec3::X,
            up: q * DVec3::Y,
            forward: q * DVec3::NEG_Z,
        };
        let turn = Turn::new(&times, &times.map(|t| basis(at(t))));
        for (i, t) in times.windows(2).enumerate() {
            for u in [0.0, 0.3, 0.7, 1.0] {
                let expected = basis(at(t[0] + u * (t[1] - t[0])));
                let found = turn.at(i, u);
                assert!(
                    found.forward.distance(expected.forward) < 1e-12
                        && found.up.distance(expected.up) < 1e-12,
                    "interval {i} at {u}: {found:?}, expected {expected:?}"
                );
            }
        }
    }
}
