//! A checked camera with the shape of its picture: rays of pixels, and pixels of points.

use std::f64::consts::PI;

use glam::DVec3;

use super::pose::{Basis, Camera, CameraError, Projection};

/// A half line in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts (t = 0), mm: the eye, or a point of the eye plane.
    pub origin: DVec3,
    /// Its direction, of length 1, so that t is in millimetres.
    pub direction: DVec3,
}

/// A camera that has been checked, and the half extents of its image plane.
///
/// Picture coordinates u, v run from −1 (left, bottom) to +1 (right, top).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye, mm.
    pub eye: DVec3,
    /// The picture's axes.
    pub basis: Basis,
    /// How rays run.
    pub projection: Projection,
    /// Half width and half height of the image plane: at distance 1 from the eye for perspective (dimensionless), in
    /// millimetres for orthographic; half angles for panoramas, radians.
    pub half_extent: [f64; 2],
    /// Nothing nearer to the eye plane than this is seen, mm.
    pub near_mm: f64,
}

impl Camera {
    /// The view of a picture whose width is `aspect` times its height. Orthographic pictures have half height
    /// |target − eye|·tan(fov/2): the framing of the perspective one at the target.
    ///
    /// # Errors
    /// See [`Camera::basis`].
    pub fn view(&self, aspect: f64) -> Result<View, CameraError> {
        let basis = self.basis()?;
        let half_extent = match self.projection {
            Projection::Perspective => {
                let half_height = self.tan_half_fov()?;
                [half_height * aspect, half_height]
            }
            Projection::Orthographic => {
                let half_height = self.tan_half_fov()? * self.eye.distance(self.target);
                [half_height * aspect, half_height]
            }
            Projection::Fisheye => {
                let half_height = self.fov_y_degrees.to_radians() * 0.5;
                let corner = half_height * aspect.hypot(1.0);
                if corner > PI {
                    return Err(CameraError::FisheyeCorner {
                        fov: self.fov_y_degrees,
                        corner: corner.to_degrees(),
                    });
                }
                [half_height * aspect, half_height]
            }
            Projection::Equirectangular => [PI, PI * 0.5],
        };
        Ok(View {
            eye: self.eye,
            basis,
            projection: self.projection,
            half_extent,
            near_mm: self.near_mm,
        })
    }
}

impl View {
    /// The ray through `u`, `v` (−1…1, up and right positive).
    pub fn ray(&self, u: f64, v: f64) -> Ray {
        let Basis { right, up, forward } = self.basis;
        let offset = right * (u * self.half_extent[0]) + up * (v * self.half_extent[1]);
        match self.projection {
            Projection::Perspective => Ray {
                origin: self.eye,
                direction: (forward + offset).normalize(),
            },
            Projection::Orthographic => Ray {
                origin: self.eye + offset,
                direction: forward,
            },
            Projection::Fisheye | Projection::Equirectangular => {
                let angles = [u * self.half_extent[0], v * self.half_extent[1]];
                let [ahead, aside, above] = fan(self.projection, angles);
                Ray {
                    origin: self.eye,
                    direction: forward * ahead + right * aside + up * above,
                }
            }
        }
    }

    /// The ray through position (`x`, `y`) in pixels of a picture of `size`; pixel (i, j) has its centre at
    /// (i + ½, j + ½), and row 0 is the top.
    pub fn pixel_ray(&self, x: f64, y: f64, size: [u32; 2]) -> Ray {
        self.ray(
            2.0 * x / f64::from(size[0]) - 1.0,
            1.0 - 2.0 * y / f64::from(size[1]),
        )
    }

    /// Distance of `world` from the eye plane along the viewing direction, mm; negative behind the eye.
    pub fn depth(&self, world: DVec3) -> f64 {
        (world - self.eye).dot(self.basis.forward)
    }

    /// Where `world` lands in the picture as u, v; `None` for a perspective view when it is not in front of the eye, and at
    /// the eye itself.
    pub fn project(&self, world: DVec3) -> Option<[f64; 2]> {
        let offset = world - self.eye;
        let along = [self.basis.forward, self.basis.right, self.basis.up].map(|a| offset.dot(a));
        let angles = |[x, y]: [f64; 2]| {
            let is_somewhere = offset != DVec3::ZERO;
            is_somewhere.then_some([x / self.half_extent[0], y / self.half_extent[1]])
        };
        let scale = match self.projection {
            Projection::Perspective => self.depth(world),
            Projection::Orthographic => 1.0,
            Projection::Fisheye => {
                let off_axis = along[1].hypot(along[2]);
                let angle = off_axis.atan2(along[0]);
                let scale = if off_axis > 0.0 {
                    angle / off_axis
                } else {
                    0.0
                };
                return angles([along[1] * scale, along[2] * scale]);
            }
            Projection::Equirectangular => {
                let level = along[0].hypot(along[1]);
                return angles([along[1].atan2(along[0]), along[2].atan2(level)]);
            }
        };
        (scale > 0.0).then(|| {
            [
                offset.dot(self.basis.right) / (scale * self.half_extent[0]),
                offset.dot(self.basis.up) / (scale * self.half_extent[1]),
            ]
        })
    }
}

/// Of the unit direction of a panorama's ray: ahead, to the right, up. `angles`: of its pixel from the picture's middle, radians.
pub fn fan(projection: Projection, [x, y]: [f64; 2]) -> [f64; 3] {
    if projection == Projection::Equirectangular {
        let ((sin_x, cos_x), (sin_y, cos_y)) = (x.sin_cos(), y.sin_cos());
        return [cos_y * cos_x, cos_y * sin_x, sin_y];
    }
    let angle = x.hypot(y);
    let scale = if angle > 0.0 {
        angle.sin() / angle
    } else {
        1.0
    };
    [angle.cos(), x * scale, y * scale]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera {
            eye: DVec3::new(3.0, -40.0, 5.0),
            target: DVec3::new(0.0, 0.0, 7.0),
            up: DVec3::Z,
            fov_y_degrees: 30.0,
            projection,
            near_mm: 0.0,
        }
    }

    #[test]
    fn rays_go_through_the_points_that_project_to_them() {
        for projection in Projection::ALL {
            let view = camera(projection).view(4.0 / 3.0).unwrap();
            for (x, y) in [(0.5, 0.5), (400.0, 300.0), (799.5, 100.25)] {
                let ray = view.pixel_ray(x, y, [800, 600]);
                let [u, v] = view.project(ray.origin + ray.direction * 17.0).unwrap();
                let back = [(u + 1.0) * 400.0, (1.0 - v) * 300.0];
                assert!(
                    (back[0] - x).abs() < 1e-9 && (back[1] - y).abs() < 1e-9,
                    "{projection:?}: ({x}, {y}) came back as {back:?}"
                );
            }
        }
    }

    #[test]
    fn both_projections_frame_the_target_alike() {
        let perspective = camera(Projection::Perspective).view(1.0).unwrap();
        let parallel = camera(Projection::Orthographic).view(1.0).unwrap();
        let at_target = DVec3::new(0.0, 0.0, 7.0) + perspective.basis.right * 4.0;
        let (a, b) = (
            perspective.project(at_target).unwrap(),
            parallel.project(at_target).unwrap(),
        );
        assert!((a[0] - b[0]).abs() < 1e-12, "{a:?} and {b:?} agree");
        assert!(
            perspective.project(DVec3::new(3.0, -50.0, 5.0)).is_none(),
            "behind the eye"
        );
    }

    #[test]
    fn row_zero_is_the_top() {
        let view = camera(Projection::Perspective).view(1.0).unwrap();
        let top = view.pixel_ray(50.0, 0.5, [100, 100]).direction;
        let bottom = view.pixel_ray(50.0, 99.5, [100, 100]).direction;
        assert!(top.z > bottom.z, "row 0 looks higher");
    }
}
