//! Half spaces, and boxes as six of them.

use glam::{DMat3, DVec3};

/// A half space: the points x with `normal · x + offset ≥ 0` are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Of length 1, into what is kept.
    normal: DVec3,
    /// Millimetres.
    offset: f64,
}

impl Plane {
    /// The half space `normal · x + offset ≥ 0`; `normal` may have any length but 0. `None` when it has none, or a number is
    /// not finite.
    pub fn new(normal: DVec3, offset: f64) -> Option<Self> {
        let length = normal.length();
        let plane = Self {
            normal: normal / length,
            offset: offset / length,
        };
        let is_finite = plane.normal.is_finite() && plane.offset.is_finite();
        (length > 0.0 && is_finite).then_some(plane)
    }

    /// Unit normal, into what is kept.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// `offset` with a normal of length 1, mm.
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// Distance of `point` from the plane, mm; negative where it is cut away.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }
}

/// A box in any orientation; its inside is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Its middle, world mm.
    pub center: DVec3,
    /// Half its edges, mm, each greater than 0.
    pub half_extent: DVec3,
    /// World from the box's own axes; orthonormal.
    pub world_from_box: DMat3,
}

impl OrientedBox {
    /// The box along the world's axes between two corners. `None` when it has no volume, or a number is not finite.
    pub fn between(low: DVec3, high: DVec3) -> Option<Self> {
        let half_extent = (high - low) * 0.5;
        (half_extent.min_element() > 0.0 && low.is_finite() && high.is_finite()).then_some(Self {
            center: low + half_extent,
            half_extent,
            world_from_box: DMat3::IDENTITY,
        })
    }

    /// The six half spaces whose intersection it is.
    pub fn planes(&self) -> [Plane; 6] {
        let axes = [
            self.world_from_box.x_axis,
            self.world_from_box.y_axis,
            self.world_from_box.z_axis,
        ];
        std::array::from_fn(|k| {
            let normal = axes[k / 2] * if k % 2 == 0 { 1.0 } else { -1.0 };
            Plane {
                normal,
                offset: self.half_extent[k / 2] - normal.dot(self.center),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_keep_their_side_whatever_the_length_of_the_normal() {
        let plane = Plane::new(DVec3::new(0.0, 0.0, -4.0), 8.0).unwrap();
        assert_eq!(plane.distance(DVec3::new(5.0, 5.0, 1.5)), 0.5);
        assert!(plane.distance(DVec3::new(0.0, 0.0, 3.0)) < 0.0);
        assert_eq!(Plane::new(DVec3::ZERO, 1.0), None);
        assert_eq!(Plane::new(DVec3::X, f64::NAN), None);
    }

    #[test]
    fn boxes_are_six_half_spaces() {
        let turned = OrientedBox {
            center: DVec3::new(1.0, 2.0, 3.0),
            half_extent: DVec3::new(4.0, 5.0, 6.0),
            world_from_box: DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(1.1),
        };
        let keeps = |local: DVec3| {
            let world = turned.center + turned.world_from_box * local;
            turned.planes().iter().all(|p| p.distance(world) >= 0.0)
        };
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut at = DVec3::ZERO;
                at[axis] = sign * (turned.half_extent[axis] - 1e-9);
                assert!(keeps(at), "{at} is inside");
                at[axis] = sign * (turned.half_extent[axis] + 1e-9);
                assert!(!keeps(at), "{at} is outside");
            }
        }
        assert_eq!(
            OrientedBox::between(DVec3::ONE, DVec3::new(2.0, 1.0, 2.0)),
            None
        );
    }
}
