//! Key frames, and the camera between them.

use glam::DVec3;

use super::curve::Curve;
use super::error::CameraPathError;
use super::pchip::Pchip;
use super::turn::Turn;
use crate::camera::pose::{Camera, Projection};

/// Farthest coordinate and time: beyond them differences lose their meaning in f64.
const FARTHEST: f64 = 1e9;
/// Least time between two keys, seconds.
pub(super) const LEAST_STEP_SECONDS: f64 = 1e-6;

/// A camera and when it is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyFrame {
    /// When, seconds.
    pub t: f64,
    /// The eye's position, mm.
    pub eye: DVec3,
    /// The point in the middle of the picture, mm.
    pub target: DVec3,
    /// The direction that points up in the picture; any length but 0, need not be orthogonal to the view.
    pub up: DVec3,
    /// Vertical field of view, degrees, between 0 and 180 (exclusive).
    pub fov_y_degrees: f64,
}

/// A flight through key frames. Made ready when it is made: [`CameraPath::camera_at`] is cheap.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keys: Vec<KeyFrame>,
    projection: Projection,
    near_mm: f64,
    times: Vec<f64>,
    curve: Curve,
    /// Arc length over time, mm.
    way: Pchip,
    turn: Turn,
    /// Distance of the target from the eye over time, mm.
    distance: Pchip,
    fov: Pchip,
}

impl CameraPath {
    /// The path through `keys`. Pictures are taken with `projection`; nothing nearer to the eye plane than `near_mm` is seen.
    ///
    /// # Errors
    /// There are no keys, their times don't rise, or no picture can be taken with one of them.
    pub fn new(
        keys: Vec<KeyFrame>,
        projection: Projection,
        near_mm: f64,
    ) -> Result<Self, CameraPathError> {
        if keys.is_empty() {
            return Err(CameraPathError::NoKeys);
        }
        let mut before = f64::NEG_INFINITY;
        let mut bases = Vec::with_capacity(keys.len());
        for (key, k) in keys.iter().enumerate() {
            // NaN fails the comparisons.
            if !(k.t - before >= LEAST_STEP_SECONDS && k.t.abs() <= FARTHEST) {
                return Err(CameraPathError::Time {
                    key,
                    before,
                    found: k.t,
                });
            }
            before = k.t;
            for (field, found) in [("eye", k.eye), ("target", k.target)] {
                if found.abs().max_element() > FARTHEST {
                    return Err(CameraPathError::TooFar { key, field, found });
                }
            }
            let basis = k
                .camera(projection, near_mm)
                .basis()
                .map_err(|error| CameraPathError::Unusable { key, error })?;
            bases.push(basis);
        }
        let times: Vec<f64> = keys.iter().map(|k| k.t).collect();
        let eyes: Vec<DVec3> = keys.iter().map(|k| k.eye).collect();
        let curve = Curve::through(&eyes);
        let way = Pchip::new(&times, curve.lengths_mm().to_vec());
        let of =
            |value: &dyn Fn(&KeyFrame) -> f64| Pchip::new(&times, keys.iter().map(value).collect());
        Ok(Self {
            projection,
            near_mm,
            way,
            turn: Turn::new(&times, &bases),
            distance: of(&|k| k.eye.distance(k.target)),
            fov: of(&|k| k.fov_y_degrees),
            curve,
            times,
            keys,
        })
    }

    /// The key frames.
    pub fn keys(&self) -> &[KeyFrame] {
        &self.keys
    }

    /// Perspective or orthographic, all the way.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Nothing nearer to the eye plane than this is seen, mm.
    pub fn near_mm(&self) -> f64 {
        self.near_mm
    }

    /// The time of the first key, seconds.
    pub fn start(&self) -> f64 {
        self.times[0]
    }

    /// Time from the first key to the last, seconds; 0 for a single key.
    pub fn duration(&self) -> f64 {
        self.times[self.times.len() - 1] - self.times[0]
    }

    /// Length of the eye's way, mm.
    pub fn length_mm(&self) -> f64 {
        self.curve.length_mm()
    }

    /// The same path from time 0 to `seconds`, faster or slower. A path of one key stays as it is, at time 0.
    ///
    /// # Errors
    /// `seconds` is no duration, or so short that keys would coincide.
    pub fn with_duration(&self, seconds: f64) -> Result<Self, CameraPathError> {
        if !(seconds > LEAST_STEP_SECONDS && seconds <= FARTHEST) {
            return Err(CameraPathError::Duration(seconds));
        }
        let (start, duration) = (self.start(), self.duration());
        let scale = if duration > 0.0 {
            seconds / duration
        } else {
            1.0
        };
        let keys = self.keys.iter().map(|k| KeyFrame {
            t: (k.t - start) * scale,
            ..*k
        });
        Self::new(keys.collect(), self.projection, self.near_mm)
    }

    /// The camera at time `t`, in seconds on the clock of the keys; before the first and after the last key it stands.
    pub fn camera_at(&self, t: f64) -> Camera {
        let last = self.times.len() - 1;
        let i = self
            .times
            .partition_point(|&key| key <= t)
            .saturating_sub(1)
            .min(last.saturating_sub(1));
        let width = self.times.get(i + 1).map_or(0.0, |end| end - self.times[i]);
        let u = if width > 0.0 {
            ((t - self.times[i]) / width).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let eye = self.curve.at(self.way.at(i, width, u));
        let axes = self.turn.at(i, u);
        Camera {
            eye,
            target: eye + axes.forward * self.distance.at(i, width, u),
            up: axes.up,
            fov_y_degrees: self.fov.at(i, width, u),
            projection: self.projection,
            near_mm: self.near_mm,
        }
    }
}

impl KeyFrame {
    fn camera(&self, projection: Projection, near_mm: f64) -> Camera {
        Camera {
            eye: self.eye,
            target: self.target,
            up: self.up,
            fov_y_degrees: self.fov_y_degrees,
            projection,
            near_mm,
        }
    }
}

#[cfg(test)]
mod tests;
