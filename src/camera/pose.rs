//! The camera as it is given, its checks and its orthonormal basis.

use glam::DVec3;
use thiserror::Error;

/// Vertical field of view when none is given, in degrees (`--fov`).
pub const DEFAULT_FOV_Y_DEGREES: f64 = 30.0;

/// Least sine of the angle between the viewing direction and `up`: below it the picture's roll is not determined.
const LEAST_UP_SINE: f64 = 1e-9;

/// How the picture's rays run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Projection {
    /// All rays start at the eye.
    #[default]
    Perspective,
    /// All rays are parallel and start on the eye plane; the framing at the target is that of the perspective camera.
    Orthographic,
    /// All rays start at the eye; the angle between a ray and the view's axis is proportional to the distance of its pixel from
    /// the picture's middle (equidistant fisheye). The field of view is that of the picture's height and may exceed 180°.
    Fisheye,
    /// All rays start at the eye; columns are longitudes, rows latitudes: the whole sphere, whatever the field of view.
    Equirectangular,
}

impl Projection {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Perspective,
        Self::Orthographic,
        Self::Fisheye,
        Self::Equirectangular,
    ];

    /// Its name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Perspective => "perspective",
            Self::Orthographic => "orthographic",
            Self::Fisheye => "fisheye",
            Self::Equirectangular => "equirectangular",
        }
    }

    /// Are its rays no lines of one raster? They may run in all directions.
    pub const fn is_panoramic(self) -> bool {
        matches!(self, Self::Fisheye | Self::Equirectangular)
    }

    /// The field of view must be below this, degrees.
    pub const fn most_fov_degrees(self) -> f64 {
        match self {
            Self::Perspective | Self::Orthographic => 180.0,
            Self::Fisheye | Self::Equirectangular => 360.0,
        }
    }
}

/// A camera: position, direction and opening, in world millimetres (RAS+).
///
/// Any values can be put in; [`Camera::basis`] and [`Camera::view`] say what is wrong with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye's position, mm.
    pub eye: DVec3,
    /// The point in the middle of the picture, mm.
    pub target: DVec3,
    /// The direction that points up in the picture; any length but 0, need not be orthogonal to the view.
    pub up: DVec3,
    /// Vertical field of view, degrees, above 0 and below [`Projection::most_fov_degrees`].
    pub fov_y_degrees: f64,
    /// How rays run.
    pub projection: Projection,
    /// Nothing nearer to the eye plane than this is seen, mm; at least 0.
    pub near_mm: f64,
}

/// Right-handed orthonormal axes of a picture, in world space: `right × up = −forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis {
    /// Towards the picture's right edge.
    pub right: DVec3,
    /// Towards the picture's top edge.
    pub up: DVec3,
    /// Into the picture, from eye to target.
    pub forward: DVec3,
}

/// Why a camera can't be used.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CameraError {
    /// A coordinate is NaN or infinite.
    #[error("camera {field} is {value}; expected finite numbers")]
    NotFinite {
        /// `eye`, `target`, `up`.
        field: &'static str,
        /// What is there.
        value: DVec3,
    },
    /// There is no viewing direction.
    #[error("camera eye and target are the same point {0}; move one of them")]
    EyeIsTarget(DVec3),
    /// The picture's roll is not determined.
    #[error(
        "camera up {up} is zero or parallel to the viewing direction {forward}; choose another up"
    )]
    UpParallel {
        /// The up vector.
        up: DVec3,
        /// The viewing direction, of length 1.
        forward: DVec3,
    },
    /// Field of view out of the projection's range.
    #[error("camera field of view is {fov} degrees; expected more than 0 and less than {most}")]
    Fov {
        /// What is there, degrees.
        fov: f64,
        /// It must be below this.
        most: f64,
    },
    /// A fisheye whose corners would look beyond the point behind the camera.
    #[error(
        "the corners of a fisheye picture of {fov} degrees lie {corner:.0} degrees off its middle; expected at most 180: give a \
         smaller field of view, or a less elongated picture"
    )]
    FisheyeCorner {
        /// Vertical field of view, degrees.
        fov: f64,
        /// Of a corner, degrees.
        corner: f64,
    },
    /// Near distance negative or not finite.
    #[error("camera near distance is {0} mm; expected a finite number of at least 0")]
    Near(f64),
    /// Zoom not positive or not finite.
    #[error("zoom is {0}; expected a finite number greater than 0")]
    Zoom(f64),
    /// An angle is NaN or infinite.
    #[error("{name} is {value} degrees; expected a finite number")]
    Angle {
        /// `azimuth`, `elevation`.
        name: &'static str,
        /// What was given.
        value: f64,
    },
}

impl Camera {
    /// Half the field of view's tangent: half the picture's height at distance 1.
    ///
    /// # Errors
    /// The field of view is not between 0 and 180 degrees.
    pub fn tan_half_fov(&self) -> Result<f64, CameraError> {
        check_fov(self.fov_y_degrees, 180.0).map(|fov| (fov * 0.5).tan())
    }

    /// The orthonormal axes of the picture.
    ///
    /// # Errors
    /// Eye and target coincide, `up` is parallel to the view, the field of view is not between 0 and 180 degrees, the
    /// near distance is negative, or something is not finite.
    pub fn basis(&self) -> Result<Basis, CameraError> {
        for (field, value) in [("eye", self.eye), ("target", self.target), ("up", self.up)] {
            if !value.is_finite() {
                return Err(CameraError::NotFinite { field, value });
            }
        }
        check_fov(self.fov_y_degrees, self.projection.most_fov_degrees())?;
        if !(self.near_mm.is_finite() && self.near_mm >= 0.0) {
            return Err(CameraError::Near(self.near_mm));
        }
        let forward = (self.target - self.eye)
            .try_normalize()
            .ok_or(CameraError::EyeIsTarget(self.eye))?;
        let parallel = CameraError::UpParallel {
            up: self.up,
            forward,
        };
        let Some(up) = self.up.try_normalize() else {
            return Err(parallel);
        };
        let right = forward.cross(up);
        if right.length() < LEAST_UP_SINE {
            return Err(parallel);
        }
        let right = right.normalize();
        Ok(Basis {
            right,
            up: right.cross(forward),
            forward,
        })
    }
}

/// `degrees` in radians, if it is a field of view.
pub(super) fn check_fov(degrees: f64, most: f64) -> Result<f64, CameraError> {
    // NaN fails both comparisons.
    if degrees > 0.0 && degrees < most {
        Ok(degrees.to_radians())
    } else {
        Err(CameraError::Fov { fov: degrees, most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Camera = Camera {
        eye: DVec3::new(1.0, 2.0, 3.0),
        target: DVec3::new(-4.0, 0.5, 9.0),
        up: DVec3::Z,
        fov_y_degrees: 30.0,
        projection: Projection::Perspective,
        near_mm: 0.0,
    };

    #[test]
    fn basis_is_right_handed_and_orthonormal() {
        let b = GOOD.basis().unwrap();
        for (name, d) in [
            ("right·up", b.right.dot(b.up)),
            ("right·forward", b.right.dot(b.forward)),
            ("up·forward", b.up.dot(b.forward)),
            ("|right|−1", b.right.length() - 1.0),
            ("|up|−1", b.up.length() - 1.0),
            ("|forward|−1", b.forward.length() - 1.0),
        ] {
            assert!(d.abs() < 1e-14, "{name} is {d}");
        }
        assert!(
            (b.right.cross(b.up) + b.forward).length() < 1e-14,
            "right × up points out of the picture"
        );
        assert!(b.up.dot(DVec3::Z) > 0.0, "up is on the side of +z");
    }

    #[test]
    fn unusable_cameras_are_refused_by_name() {
        let with = |f: &dyn Fn(&mut Camera)| {
            let mut c = GOOD;
            f(&mut c);
            c.basis()
        };
        assert!(
            matches!(
                with(&|c| c.target = c.eye),
                Err(CameraError::EyeIsTarget(_))
            ),
            "eye = target"
        );
        assert!(
            matches!(
                with(&|c| c.up = (c.eye - c.target) * 7.0),
                Err(CameraError::UpParallel { .. })
            ),
            "up along the view"
        );
        assert!(
            matches!(
                with(&|c| c.up = DVec3::ZERO),
                Err(CameraError::UpParallel { .. })
            ),
            "no up"
        );
        for fov in [0.0, -1.0, 180.0, f64::NAN, f64::INFINITY] {
            assert!(
                matches!(
                    with(&|c| c.fov_y_degrees = fov),
                    Err(CameraError::Fov { .. })
                ),
                "fov {fov}"
            );
        }
        assert!(
            matches!(with(&|c| c.near_mm = -1.0), Err(CameraError::Near(_))),
            "near −1"
        );
        assert!(
            matches!(
                with(&|c| c.eye.x = f64::NAN),
                Err(CameraError::NotFinite { field: "eye", .. })
            ),
            "NaN"
        );
    }
}
