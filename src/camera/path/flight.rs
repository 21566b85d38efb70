//! Key frames of a flight along a curve: constant speed, looking ahead, without roll.
//!
//! The up vectors are those of a rotation-minimising frame, carried along by double reflection (Wang, Jüttler, Zheng, Liu 2008,
//! "Computation of rotation minimizing frames"): the picture never turns about its axis more than the curve makes it.

use glam::{DQuat, DVec3};

use super::curve::Curve;
use super::error::CameraPathError;
use super::keys::{CameraPath, KeyFrame, LEAST_STEP_SECONDS};
use crate::camera::pose::Projection;

/// How long a flight takes when nothing is said, seconds.
pub const FLIGHT_SECONDS: f64 = 10.0;
/// Vertical field of view of a flight when nothing is said, degrees: inside a tube walls are near on all sides.
pub const FLIGHT_FOV_Y_DEGREES: f64 = 90.0;

/// How to fly along a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// How long, seconds.
    pub seconds: f64,
    /// Vertical field of view, degrees.
    pub fov_y_degrees: f64,
}

impl Default for Flight {
    fn default() -> Self {
        Self {
            seconds: FLIGHT_SECONDS,
            fov_y_degrees: FLIGHT_FOV_Y_DEGREES,
        }
    }
}

impl Flight {
    /// The path with a key at each of `points`, at constant speed along the curve through them. `ahead_mm` says for each
    /// point how far ahead on the curve the camera looks, mm; beyond its end the curve goes straight on.
    ///
    /// # Errors
    /// All points are one, or the flight's settings can't be used.
    pub fn along(&self, points: &[DVec3], ahead_mm: &[f64]) -> Result<CameraPath, CameraPathError> {
        assert_eq!(
            points.len(),
            ahead_mm.len(),
            "invariant: a distance for each point"
        );
        if points.is_empty() {
            return Err(CameraPathError::NoCurve(0));
        }
        let curve = Curve::through(points);
        let length = curve.length_mm();
        if length == 0.0 {
            return Err(CameraPathError::NoCurve(1));
        }
        let seconds = self.seconds;
        if !(seconds > 0.0 && seconds.is_finite()) {
            return Err(CameraPathError::Duration(seconds));
        }
        let end = points[points.len() - 1];
        let onward = curve.tangent(length);
        let mut keys: Vec<KeyFrame> = Vec::with_capacity(points.len());
        let mut frame: Option<Frame> = None;
        for ((&eye, &s), &ahead) in points.iter().zip(curve.lengths_mm()).zip(ahead_mm) {
            // A point given twice is one place to be, not two; so are points that are passed in no time.
            let t = seconds * (s / length);
            if keys
                .last()
                .is_some_and(|k| t - k.t < 2.0 * LEAST_STEP_SECONDS)
            {
                continue;
            }
            let tangent = curve.tangent(s);
            let here = match frame {
                None => Frame::first(eye, tangent),
                Some(before) => before.carried_to(eye, tangent),
            };
            frame = Some(here);
            let beyond = (s + ahead - length).max(0.0);
            let mut target = if beyond > 0.0 {
                end + onward * beyond
            } else {
                curve.at(s + ahead)
            };
            if target.distance(eye) < 1e-3 * ahead {
                // The curve comes back to where it is.
                target = eye + tangent * ahead;
            }
            let forward = (target - eye).normalize();
            keys.push(KeyFrame {
                t,
                eye,
                target,
                up: DQuat::from_rotation_arc(tangent, forward) * here.up,
                fov_y_degrees: self.fov_y_degrees,
            });
        }
        CameraPath::new(keys, Projection::Perspective, 0.0)
    }
}

/// A point of the curve with its direction and the direction of up, which is across it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    at: DVec3,
    tangent: DVec3,
    up: DVec3,
}

impl Frame {
    /// Up is towards the head, and towards the front where the curve runs along the body.
    fn first(at: DVec3, tangent: DVec3) -> Self {
        let wish = if tangent.z.abs() < 0.9 {
            DVec3::Z
        } else {
            DVec3::Y
        };
        Self {
            at,
            tangent,
            up: wish.reject_from_normalized(tangent).normalize(),
        }
    }

    /// Double reflection: by the plane between the two points, then by the one that brings the tangent to its place.
    fn carried_to(self, at: DVec3, tangent: DVec3) -> Self {
        let reflect = |v: DVec3, normal: DVec3| {
            let c = normal.length_squared();
            if c > 0.0 {
                v - normal * (2.0 * v.dot(normal) / c)
            } else {
                v
            }
        };
        let step = at - self.at;
        let (up, half_way) = (reflect(self.up, step), reflect(self.tangent, step));
        let up = reflect(up, tangent - half_way)
            .reject_from_normalized(tangent)
            .try_normalize()
            .unwrap_or_else(|| Self::first(at, tangent).up);
        Self { at, tangent, up }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix(turns: f64, n: usize) -> Vec<DVec3> {
        (0..n)
            .map(|i| {
                let a = std::f64::consts::TAU * turns * i as f64 / (n - 1) as f64;
                DVec3::new(20.0 * a.cos(), 20.0 * a.sin(), 3.0 * a)
            })
            .collect()
    }

    #[test]
    fn constant_speed_and_no_roll() {
        let points = helix(3.0, 200);
        let path = Flight::default()
            .along(&points, &vec![6.0; points.len()])
            .unwrap();
        assert_eq!(path.keys().len(), 200, "a key per point");
        assert!((path.duration() - 10.0).abs() < 1e-12, "ten seconds");
        let n = 2000;
        let cameras: Vec<_> = (0..=n)
            .map(|k| path.camera_at(10.0 * f64::from(k) / f64::from(n)))
            .collect();
        let mean = path.length_mm() / f64::from(n);
        for pair in cameras.windows(2) {
            let step = pair[0].eye.distance(pair[1].eye);
            assert!((step / mean - 1.0).abs() < 1e-3, "{step} mm, mean {mean}");
            // Roll about the view: how far the right axis turns towards up.
            let (a, b) = (pair[0].basis().unwrap(), pair[1].basis().unwrap());
            let roll = a.up.dot(b.right).abs();
            assert!(roll < 2e-4, "a roll of {roll} in one of {n} steps");
        }
        for (camera, ahead) in [(&cameras[0], 6.0), (&cameras[n as usize], 6.0)] {
            let d = camera.eye.distance(camera.target);
            assert!(d > 0.9 * ahead && d <= ahead + 1e-9, "{d} mm ahead");
        }
    }

    #[test]
    fn what_is_no_curve_is_refused() {
        let flight = Flight::default();
        let no_curve = |points: &[DVec3]| flight.along(points, &vec![5.0; points.len()]);
        assert_eq!(no_curve(&[]), Err(CameraPathError::NoCurve(0)));
        assert_eq!(
            no_curve(&[DVec3::X, DVec3::X]),
            Err(CameraPathError::NoCurve(1))
        );
        let twice = [DVec3::ZERO, DVec3::X, DVec3::X, DVec3::X * 2.0];
        assert_eq!(
            no_curve(&twice).unwrap().keys().len(),
            3,
            "a point given twice is one key"
        );
        let near = [
            DVec3::ZERO,
            DVec3::X,
            DVec3::X * (1.0 + 1e-8),
            DVec3::X * 2.0,
        ];
        let near = flight.along(&near, &[5.0; 4]).unwrap();
        assert_eq!(near.keys().len(), 3, "nor is one beside it");
        let slow = Flight {
            seconds: f64::NAN,
            ..flight
        };
        assert!(slow.along(&twice, &[5.0; 4]).is_err(), "no duration");
    }
}
