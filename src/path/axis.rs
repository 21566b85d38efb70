//! From voxels in the middle to the ridge of the distance field, finer than a voxel.
//!
//! The ridge is where the ball that fits into the lumen is greatest among all whose centres lie in the plane across the way:
//! what "centre-line" means for maximum inscribed spheres.

use glam::DVec3;

use super::region::Region;
use super::smooth::smoothed;

/// Points per smallest spacing along the way.
const POINTS_PER_VOXEL: f64 = 2.0;
/// Times that the way is smoothed and its points moved onto the ridge.
const ROUNDS: usize = 3;

/// A point of a centre-line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPoint {
    /// Where, world mm.
    pub position: DVec3,
    /// Radius of the inscribed sphere, mm: to half a voxel before the nearest centre of a voxel outside.
    pub radius_mm: f64,
    /// Radius of a ball that certainly meets no voxel outside, mm.
    pub clear_mm: f64,
}

impl AxisPoint {
    fn of(region: &Region, position: DVec3) -> Self {
        Self {
            position,
            radius_mm: region.distance_at(position) - 0.5 * region.space.least_mm(),
            clear_mm: region.clear_mm(position),
        }
    }
}

/// A way of voxels, moved onto the ridge, evenly spaced.
pub(super) fn centred(region: &Region, way: &[usize]) -> Vec<AxisPoint> {
    let least = region.space.least_mm();
    let step = least / POINTS_PER_VOXEL;
    let mut line: Vec<DVec3> = way.iter().map(|&i| region.world(i)).collect();
    for _ in 0..ROUNDS {
        line = evenly(&line, step);
        let tangents = tangents(&softened(region, &line, step));
        for (p, t) in line.iter_mut().zip(tangents) {
            *p = on_ridge(region, *p, t);
        }
        line = softened(region, &line, step);
    }
    line = evenly(&line, step);
    line.into_iter().map(|p| AxisPoint::of(region, p)).collect()
}

/// Smoothed a little: over half the distance to the wall, without coming out of the inner half of what is clear.
fn softened(region: &Region, line: &[DVec3], step: f64) -> Vec<DVec3> {
    let least = region.space.least_mm();
    let lengths: Vec<f64> = line
        .iter()
        .map(|&p| (0.5 * region.distance_at(p)).max(1.5 * least))
        .collect();
    let bounds: Vec<f64> = line.iter().map(|&p| 0.5 * region.clear_mm(p)).collect();
    smoothed(line, step, &lengths, &bounds)
}

/// Directions along a line, of length 1.
fn tangents(line: &[DVec3]) -> Vec<DVec3> {
    let last = line.len() - 1;
    (0..=last)
        .map(|i| {
            let (a, b) = (i.saturating_sub(2), (i + 2).min(last));
            (line[b] - line[a]).normalize_or(DVec3::Z)
        })
        .collect()
}

/// The point of greatest distance to the wall in the plane across `tangent`, found uphill from `from` and within the ball
/// around it.
fn on_ridge(region: &Region, from: DVec3, tangent: DVec3) -> DVec3 {
    let least = region.space.least_mm();
    let (u, v) = tangent.any_orthonormal_pair();
    let mut best = (region.distance_at(from), from);
    let bound = 0.5 * best.0;
    let mut step = (0.25 * best.0).max(0.5 * least);
    while step > 0.05 * least {
        let mut next = best;
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
            let p = best.1 + (u * cos + v * sin) * step;
            let d = region.distance_at(p);
            if d > next.0 + 1e-6 * least && p.distance(from) <= bound {
                next = (d, p);
            }
        }
        if next.1 == best.1 {
            step *= 0.5;
        }
        best = next;
    }
    best.1
}

/// Points on a broken line, `step` apart (a little less, so that they end with it).
pub(super) fn evenly(line: &[DVec3], step: f64) -> Vec<DVec3> {
    let at: Vec<(DVec3, f64, f64)> = line.iter().map(|&p| (p, 0.0, 0.0)).collect();
    walk(&at, step).into_iter().map(|(p, ..)| p).collect()
}

/// As [`evenly`], for axis points; radii between them are mixed, what is clear is the less of both.
pub(super) fn evenly_spaced(line: &[AxisPoint], step: f64) -> Vec<AxisPoint> {
    let at: Vec<(DVec3, f64, f64)> = line
        .iter()
        .map(|p| (p.position, p.radius_mm, p.clear_mm))
        .collect();
    walk(&at, step)
        .into_iter()
        .map(|(position, radius_mm, clear_mm)| AxisPoint {
            position,
            radius_mm,
            clear_mm,
        })
        .collect()
}

fn walk(line: &[(DVec3, f64, f64)], step: f64) -> Vec<(DVec3, f64, f64)> {
    let length: f64 = line.windows(2).map(|p| p[0].0.distance(p[1].0)).sum();
    let count = (length / step).ceil().max(1.0);
    let step = length / count;
    let mut out = vec![line[0]];
    let mut before = 0.0;
    for pair in line.windows(2) {
        let ((a, ra, ca), (b, rb, cb)) = (pair[0], pair[1]);
        let piece = a.distance(b);
        while (out.len() as f64) < count && out.len() as f64 * step <= before + piece {
            let t = (out.len() as f64 * step - before) / piece;
            out.push((a.lerp(b, t), ra + (rb - ra) * t, ca.min(cb)));
        }
        before += piece;
    }
    if length > 0.0 {
        out.push(line[line.len() - 1]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_points_on_a_broken_line() {
        let line = [
            DVec3::ZERO,
            DVec3::X * 3.0,
            DVec3::X * 3.0,
            DVec3::new(3.0, 4.1, 0.0),
        ];
        let points = evenly(&line, 0.5);
        assert_eq!(points.len(), 16, "⌈7.1 / 0.5⌉ steps");
        for pair in points.windows(2) {
            let d = pair[0].distance(pair[1]);
            // One step goes around the corner.
            assert!((0.3..0.474).contains(&d), "a step of {d}");
        }
        assert_eq!((points[0], points[15]), (line[0], line[3]), "both ends");
        assert_eq!(evenly(&line[..1], 0.5), [DVec3::ZERO], "a point stays one");
    }
}
