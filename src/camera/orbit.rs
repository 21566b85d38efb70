//! Cameras about a volume: the orbit of `render` and the turntable of `bench render` (cli.md).

use glam::DVec3;

use super::pose::{Camera, CameraError, DEFAULT_FOV_Y_DEGREES, Projection, check_fov};
use crate::geom::Aabb;

/// The least |cos elevation| for which +z still fixes the picture's roll; nearer to a pole its limit is used.
const POLE_COSINE: f64 = 1e-6;

/// A sphere in world space around what is to be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Its centre, mm.
    pub center: DVec3,
    /// Its radius, mm.
    pub radius: f64,
}

impl BoundingSphere {
    /// The sphere through the corners of a box, in the space of the box.
    pub fn of_box(aabb: &Aabb) -> Self {
        Self::of_corners(&aabb.corners())
    }

    /// The sphere around the middle of eight corners of a parallelepiped (a box under an affine map), through the
    /// corner that is farthest from it.
    pub fn of_corners(corners: &[DVec3; 8]) -> Self {
        let center = corners.iter().sum::<DVec3>() / 8.0;
        let radius = corners
            .iter()
            .map(|c| c.distance(center))
            .fold(0.0, f64::max);
        Self { center, radius }
    }
}

impl Camera {
    /// The camera of `--orbit AZIMUTH,ELEVATION,ZOOM`: eye = centre + r·(−sin az·cos el, cos az·cos el, sin el) with
    /// r = R / sin(fov/2) / zoom, looking at the centre, up +z; perspective, near 0. Angles in degrees.
    ///
    /// 0,0 is the anterior view, with the patient's right on the left of the picture; 90,0 the patient's left side. At
    /// elevation ±90 the up vector is the limit from smaller elevations.
    ///
    /// # Errors
    /// An angle is not finite, zoom is not positive, or `fov_y_degrees` is not between 0 and 360.
    pub fn orbit(
        bounds: &BoundingSphere,
        azimuth_degrees: f64,
        elevation_degrees: f64,
        zoom: f64,
        fov_y_degrees: f64,
    ) -> Result<Self, CameraError> {
        for (name, value) in [
            ("azimuth", azimuth_degrees),
            ("elevation", elevation_degrees),
        ] {
            if !value.is_finite() {
                return Err(CameraError::Angle { name, value });
            }
        }
        if !(zoom.is_finite() && zoom > 0.0) {
            return Err(CameraError::Zoom(zoom));
        }
        // How rays run may be said later ([`Camera::basis`] checks both together): those of a fisheye look backwards, too.
        let fov = check_fov(fov_y_degrees, Projection::Fisheye.most_fov_degrees())?;
        let (sin_az, cos_az) = azimuth_degrees.to_radians().sin_cos();
        let (sin_el, cos_el) = elevation_degrees.to_radians().sin_cos();
        let (direction, up) = if cos_el.abs() < POLE_COSINE {
            // d(direction)/d(elevation): where +z tends in the picture as the pole is approached.
            let sign = sin_el.signum();
            (
                DVec3::new(0.0, 0.0, sign),
                DVec3::new(sin_az * sign, -cos_az * sign, 0.0),
            )
        } else {
            (
                DVec3::new(-sin_az * cos_el, cos_az * cos_el, sin_el),
                DVec3::Z,
            )
        };
        // Beyond 180 degrees no distance is too small for the sphere to be in view.
        let half = (fov * 0.5).min(std::f64::consts::FRAC_PI_2);
        let distance = bounds.radius / half.sin() / zoom;
        Ok(Self {
            eye: bounds.center + direction * distance,
            target: bounds.center,
            up,
            fov_y_degrees,
            projection: Projection::Perspective,
            near_mm: 0.0,
        })
    }

    /// Frame `frame` of `frames` of the full turn of `bench render`: perspective 30°, up +y, azimuth about +y in equal
    /// steps starting at +z, `distance` millimetres from `center`.
    pub fn turntable(frame: u32, frames: u32, center: DVec3, distance: f64) -> Self {
        let angle = std::f64::consts::TAU * f64::from(frame) / f64::from(frames.max(1));
        let (sin, cos) = angle.sin_cos();
        Self {
            eye: center + DVec3::new(sin, 0.0, cos) * distance,
            target: center,
            up: DVec3::Y,
            fov_y_degrees: DEFAULT_FOV_Y_DEGREES,
            projection: Projection::Perspective,
            near_mm: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPHERE: BoundingSphere = BoundingSphere {
        center: DVec3::new(10.0, -20.0, 30.0),
        radius: 50.0,
    };

    fn orbit(az: f64, el: f64) -> Camera {
        Camera::orbit(&SPHERE, az, el, 1.0, 30.0).unwrap()
    }

    #[test]
    fn anterior_view_has_the_patients_right_on_the_left() {
        let camera = orbit(0.0, 0.0);
        let r = 50.0 / 15.0_f64.to_radians().sin();
        assert!(
            (camera.eye - SPHERE.center - DVec3::new(0.0, r, 0.0)).length() < 1e-9,
            "the eye is anterior, at R / sin(fov/2): {}",
            camera.eye
        );
        let view = camera.view(1.5).unwrap();
        let [x, y] = view.project(SPHERE.center + DVec3::X).unwrap();
        assert!(x < 0.0 && y.abs() < 1e-12, "+x is left of the middle: {x}");
        let [x, y] = view.project(SPHERE.center + DVec3::Z).unwrap();
        assert!(y > 0.0 && x.abs() < 1e-12, "+z is above the middle: {y}");
        let side = orbit(90.0, 0.0).eye - SPHERE.center;
        assert!(
            side.x < 0.0 && side.y.abs() < 1e-9,
            "90,0 looks at the patient's left side: {side}"
        );
    }

    #[test]
    fn the_sphere_fills_the_height_and_zoom_divides_the_distance() {
        let near = Camera::orbit(&SPHERE, 33.0, 12.0, 4.0, 40.0).unwrap();
        let far = Camera::orbit(&SPHERE, 33.0, 12.0, 1.0, 40.0).unwrap();
        let (dn, df) = (near.eye.distance(near.target), far.eye.distance(far.target));
        assert!((df / dn - 4.0).abs() < 1e-12, "zoom 4 is a quarter as far");
        assert!(
            (df * 20.0_f64.to_radians().sin() - 50.0).abs() < 1e-9,
            "the sphere touches the cone of view"
        );
    }

    #[test]
    fn poles_are_the_limit_of_their_neighbours() {
        for el in [90.0_f64, -90.0] {
            for az in [0.0, 37.0, 180.0, -111.0] {
                let at = orbit(az, el).basis().unwrap();
                let beside = orbit(az, el - el.signum() * 1e-3).basis().unwrap();
                for (a, b) in [
                    (at.right, beside.right),
                    (at.up, beside.up),
                    (at.forward, beside.forward),
                ] {
                    assert!(a.distance(b) < 1e-4, "at {az},{el}: {a} tends to {b}");
                }
            }
        }
    }

    #[test]
    fn bad_orbits_are_refused() {
        let go = |az, el, zoom, fov| Camera::orbit(&SPHERE, az, el, zoom, fov).is_err();
        assert!(go(f64::NAN, 0.0, 1.0, 30.0), "NaN azimuth");
        assert!(go(0.0, f64::INFINITY, 1.0, 30.0), "infinite elevation");
        assert!(go(0.0, 0.0, 0.0, 30.0), "zoom 0");
        assert!(go(0.0, 0.0, 1.0, 360.0), "fov 360");
        let wide = Camera::orbit(&SPHERE, 0.0, 0.0, 1.0, 220.0).unwrap();
        assert!(wide.basis().is_err(), "too wide for perspective");
        let fisheye = Camera {
            projection: Projection::Fisheye,
            ..wide
        };
        assert!(fisheye.basis().is_ok(), "not for a fisheye");
        assert_eq!(fisheye.eye, SPHERE.center + DVec3::Y * 50.0);
    }

    #[test]
    fn the_turntable_starts_at_z_and_turns_about_y() {
        let at = |frame| Camera::turntable(frame, 36, DVec3::ONE, 100.0);
        assert!(
            at(0).eye.distance(DVec3::new(1.0, 1.0, 101.0)) < 1e-9,
            "frame 0 is at +z"
        );
        assert!(
            at(9).eye.distance(DVec3::new(101.0, 1.0, 1.0)) < 1e-9,
            "a quarter turn is at +x"
        );
        assert!(at(7).basis().is_ok(), "every frame has a basis");
    }
}
