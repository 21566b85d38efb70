//! Solid shapes in the box from −1 to 1 on each axis, and where a row (fixed y and z) cuts them.
//!
//! Every shape meets a row in one interval at most; anything else is a union of several.

use glam::{DMat3, DVec3};

/// A solid whose rows are intervals.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    Ellipsoid(Ellipsoid),
    Capsule(Capsule),
    Profile(&'static Profile),
}

impl Shape {
    /// An ellipsoid with half axes `radii` along the columns of `axes` (a rotation).
    pub(super) fn ellipsoid(center: DVec3, radii: DVec3, axes: DMat3) -> Self {
        let unit_from_box = DMat3::from_diagonal(radii.recip()) * axes.transpose();
        // The extent along a box axis is the length of that row of (axes · radii).
        let rows = (axes * DMat3::from_diagonal(radii)).transpose();
        let half = DVec3::new(
            rows.x_axis.length(),
            rows.y_axis.length(),
            rows.z_axis.length(),
        );
        Self::Ellipsoid(Ellipsoid {
            center,
            unit_from_box,
            half,
        })
    }

    /// All points within `radius` of the segment from `a` to `b`.
    pub(super) fn capsule(a: DVec3, b: DVec3, radius: f64) -> Self {
        Self::Capsule(Capsule { a, b, radius })
    }

    /// Least and greatest y and z, in that order: what lets rows be skipped.
    pub(super) fn bounds(&self) -> [[f64; 2]; 2] {
        match self {
            Self::Ellipsoid(e) => {
                let (lo, hi) = (e.center - e.half, e.center + e.half);
                [[lo.y, hi.y], [lo.z, hi.z]]
            }
            Self::Capsule(c) => {
                let (lo, hi) = (c.a.min(c.b) - c.radius, c.a.max(c.b) + c.radius);
                [[lo.y, hi.y], [lo.z, hi.z]]
            }
            Self::Profile(p) => {
                let z = [p.keys[0].z, p.keys[p.keys.len() - 1].z];
                let lo = p.keys.iter().map(|k| k.cy - k.b).fold(f64::MAX, f64::min);
                let hi = p.keys.iter().map(|k| k.cy + k.b).fold(f64::MIN, f64::max);
                [[lo, hi], z]
            }
        }
    }

    /// The x interval in which the row at `y`, `z` lies inside.
    pub(super) fn row(&self, y: f64, z: f64) -> Option<[f64; 2]> {
        match self {
            Self::Ellipsoid(e) => e.row(y, z),
            Self::Capsule(c) => c.row(y, z),
            Self::Profile(p) => p.row(y, z),
        }
    }
}

/// An ellipsoid: the unit ball, seen through a matrix.
#[derive(Clone, Debug)]
pub(super) struct Ellipsoid {
    center: DVec3,
    unit_from_box: DMat3,
    half: DVec3,
}

impl Ellipsoid {
    fn row(&self, y: f64, z: f64) -> Option<[f64; 2]> {
        let m = self.unit_from_box;
        let base = m.y_axis * (y - self.center.y) + m.z_axis * (z - self.center.z);
        let [lo, hi] = roots(
            m.x_axis.length_squared(),
            m.x_axis.dot(base),
            base.length_squared() - 1.0,
        )?;
        Some([self.center.x + lo, self.center.x + hi])
    }
}

/// The interval in which a·x² + 2·b·x + c ≤ 0, for a > 0.
fn roots(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let d = b * b - a * c;
    if d < 0.0 {
        return None;
    }
    let r = d.sqrt();
    Some([(-b - r) / a, (-b + r) / a])
}

/// A cylinder with round ends.
#[derive(Clone, Debug)]
pub(super) struct Capsule {
    a: DVec3,
    b: DVec3,
    radius: f64,
}

impl Capsule {
    fn row(&self, y: f64, z: f64) -> Option<[f64; 2]> {
        let mut hull: Option<[f64; 2]> = None;
        let mut add = |lo: f64, hi: f64| {
            hull = Some(hull.map_or([lo, hi], |[l, h]| [l.min(lo), h.max(hi)]));
        };
        let r2 = self.radius * self.radius;
        for end in [self.a, self.b] {
            let (dy, dz) = (y - end.y, z - end.z);
            let d = r2 - dy * dy - dz * dz;
            if d >= 0.0 {
                let r = d.sqrt();
                add(end.x - r, end.x + r);
            }
        }
        // The cylinder between the ends, cut to where the foot on the axis lies between them.
        let axis = self.b - self.a;
        let l2 = axis.length_squared();
        let from = DVec3::new(-self.a.x, y - self.a.y, z - self.a.z);
        let along = from.dot(axis);
        // (x e + from)² − ((x e + from)·axis)² / l2 ≤ r², multiplied by l2.
        let side = roots(
            l2 - axis.x * axis.x,
            from.x * l2 - along * axis.x,
            from.length_squared() * l2 - along * along - r2 * l2,
        );
        if l2 - axis.x * axis.x > 1e-12 * l2
            && let Some([mut lo, mut hi]) = side
        {
            if axis.x == 0.0 {
                if along < 0.0 || along > l2 {
                    return hull;
                }
            } else {
                let (p, q) = (-along / axis.x, (l2 - along) / axis.x);
                lo = lo.max(p.min(q));
                hi = hi.min(p.max(q));
            }
            if lo <= hi {
                add(lo, hi);
            }
        } else if l2 - axis.x * axis.x <= 1e-12 * l2 && l2 > 0.0 {
            // Parallel to the row: both ends' spans are there, and what is between them.
            return hull;
        }
        hull
    }
}

/// A trunk along z: a rounded cross-section that changes from key to key.
#[derive(Debug)]
pub(super) struct Profile {
    /// By rising z; the solid ends at the first and the last.
    pub(super) keys: &'static [Key],
}

/// A cross-section of a [`Profile`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Key {
    pub(super) z: f64,
    /// Centre.
    pub(super) cx: f64,
    pub(super) cy: f64,
    /// Half widths along x and y.
    pub(super) a: f64,
    pub(super) b: f64,
}

/// A [`Key`] from `[z, cx, cy, a, b]`.
pub(super) const fn key([z, cx, cy, a, b]: [f64; 5]) -> Key {
    Key { z, cx, cy, a, b }
}

impl Profile {
    /// The cross-section at `z`, joined smoothly between keys.
    pub(super) fn at(&self, z: f64) -> Option<Key> {
        let after = self.keys.iter().position(|k| k.z >= z)?;
        let k1 = self.keys[after];
        let k0 = self.keys[after.saturating_sub(1)];
        if after == 0 {
            return (k1.z == z).then_some(k1);
        }
        let t = (z - k0.z) / (k1.z - k0.z);
        let s = t * t * (3.0 - 2.0 * t);
        let mix = |a: f64, b: f64| a + (b - a) * s;
        Some(Key {
            z,
            cx: mix(k0.cx, k1.cx),
            cy: mix(k0.cy, k1.cy),
            a: mix(k0.a, k1.a),
            b: mix(k0.b, k1.b),
        })
    }

    fn row(&self, y: f64, z: f64) -> Option<[f64; 2]> {
        let k = self.at(z)?;
        let t = (y - k.cy) / k.b;
        let t2 = t * t;
        if t2 > 1.0 {
            return None;
        }
        // Half way between an ellipse and its squarer cousin of fourth order: the section of a trunk.
        let half = k.a * 0.5 * ((1.0 - t2).sqrt() + (1.0 - t2 * t2).sqrt().sqrt());
        Some([k.cx - half, k.cx + half])
    }
}
