//! A smooth curve through points, walked by arc length.
//!
//! Centripetal Catmull-Rom (Yuksel, Schaefer, Keyser 2011, "Parameterization and applications of Catmull-Rom curves":
//! exponent ½): no cusps and no loops within a piece, however uneven the points. Before the first point and behind the last
//! lie their mirrored neighbours. Equal successive points make one; a single point is a curve of length 0.

use glam::DVec3;

/// Points nearer to each other than this are one, mm.
const SAME_POINT_MM: f64 = 1e-10;

/// Parts into which a piece is cut for its arc length: with five Gauss points in each, the error is far below 1e-9 of the
/// piece for anything short of a hairpin.
const PARTS: usize = 16;

/// Abscissae on 0…1 and weights of five-point Gauss–Legendre quadrature (Abramowitz and Stegun, 25.4.30).
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_6, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// A curve through points.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    pieces: Vec<Piece>,
    /// Arc length up to each point that was given, mm; never falls.
    lengths: Vec<f64>,
    /// The first point: all there is of a curve without pieces.
    first: DVec3,
}

/// A cubic between two points, u from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
struct Piece {
    /// Coefficients of 1, u, u², u³.
    cubic: [DVec3; 4],
    /// Arc length before it, mm.
    start: f64,
    /// Arc length from its beginning to the end of each part, mm.
    parts: [f64; PARTS],
}

/// How a curve goes on beyond its ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ends {
    /// With the mirrored neighbours.
    Mirrored,
    /// It is closed: from the last point to the first again.
    Closed,
}

impl Curve {
    /// The curve through `points`, in their order. Panics when there are none.
    pub fn through(points: &[DVec3]) -> Self {
        Self::with_ends(points, Ends::Mirrored)
    }

    /// As [`Self::through`]; a closed one comes back to its first point, which must not be given again at the end.
    pub(super) fn with_ends(points: &[DVec3], ends: Ends) -> Self {
        let first = points[0];
        let mut nodes = vec![first];
        // Per given point, the node that it became.
        let mut node_of = Vec::with_capacity(points.len());
        for &p in points {
            if p.distance(nodes[nodes.len() - 1]) > SAME_POINT_MM {
                nodes.push(p);
            }
            node_of.push(nodes.len() - 1);
        }
        let is_closed = ends == Ends::Closed && nodes.len() > 2;
        if is_closed && first.distance(nodes[nodes.len() - 1]) > SAME_POINT_MM {
            nodes.push(first);
            node_of.push(nodes.len() - 1);
        }
        let n = nodes.len();
        let at = |i: isize| -> DVec3 {
            let last = n as isize - 1;
            match i {
                i if (0..=last).contains(&i) => nodes[i as usize],
                // The last node is the first one again.
                _ if is_closed => nodes[i.rem_euclid(last) as usize],
                i if i < 0 => 2.0 * nodes[0] - nodes[1],
                _ => 2.0 * nodes[n - 1] - nodes[n - 2],
            }
        };
        let mut pieces: Vec<Piece> = Vec::with_capacity(n - 1);
        let mut start = 0.0;
        for i in 0..n as isize - 1 {
            let piece = Piece::between([at(i - 1), at(i), at(i + 1), at(i + 2)], start);
            start = piece.end();
            pieces.push(piece);
        }
        let lengths = node_of
            .into_iter()
            .map(|node| pieces.get(node).map_or(start, |p| p.start))
            .collect();
        Self {
            pieces,
            lengths,
            first,
        }
    }

    /// Length of the curve, mm.
    pub fn length_mm(&self) -> f64 {
        self.pieces.last().map_or(0.0, Piece::end)
    }

    /// Arc length from the first point to each point that was given, mm.
    pub fn lengths_mm(&self) -> &[f64] {
        &self.lengths
    }

    /// The point at arc length `s_mm` from the first; the ends hold beyond them.
    pub fn at(&self, s_mm: f64) -> DVec3 {
        self.place(s_mm)
            .map_or(self.first, |(piece, u)| piece.at(u))
    }

    /// The direction of travel at arc length `s_mm`, of length 1; 0 for a curve without length.
    pub fn tangent(&self, s_mm: f64) -> DVec3 {
        self.place(s_mm).map_or(DVec3::ZERO, |(piece, u)| {
            piece.velocity(u).normalize_or_zero()
        })
    }

    fn place(&self, s_mm: f64) -> Option<(&Piece, f64)> {
        let after = self.pieces.partition_point(|p| p.start <= s_mm);
        let piece = self.pieces.get(after.saturating_sub(1))?;
        Some((piece, piece.parameter(s_mm - piece.start)))
    }
}

impl Piece {
    /// The piece from `p[1]` to `p[2]`. Those two differ.
    fn between(p: [DVec3; 4], start: f64) -> Self {
        // Knot intervals: square roots of the distances. An outer one is 0 when the curve turns back on a mirrored or
        // repeated point; then it has no say in the tangent.
        let knot = |i: usize| p[i].distance(p[i + 1]).sqrt();
        let (before, here, after) = (knot(0), knot(1), knot(2));
        let chord = (p[2] - p[1]) / here;
        // The derivative at the middle of three points of a parabola through them, times this piece's interval.
        let tangent = |outer: DVec3, width: f64| {
            if width > 0.0 {
                let outer = outer / width;
                (outer * here + chord * width) / (width + here) * here
            } else {
                chord * here
            }
        };
        let (m1, m2) = (tangent(p[1] - p[0], before), tangent(p[3] - p[2], after));
        let span = p[2] - p[1];
        let cubic = [p[1], m1, 3.0 * span - 2.0 * m1 - m2, m1 + m2 - 2.0 * span];
        let mut piece = Self {
            cubic,
            start,
            parts: [0.0; PARTS],
        };
        let mut sum = 0.0;
        for i in 0..PARTS {
            sum += piece.length_of(i as f64 / PARTS as f64, 1.0 / PARTS as f64);
            piece.parts[i] = sum;
        }
        piece
    }

    /// Arc length up to its end, mm.
    fn end(&self) -> f64 {
        self.start + self.parts[PARTS - 1]
    }

    fn at(&self, u: f64) -> DVec3 {
        let [a, b, c, d] = self.cubic;
        a + u * (b + u * (c + u * d))
    }

    fn velocity(&self, u: f64) -> DVec3 {
        let [_, b, c, d] = self.cubic;
        b + u * (2.0 * c + 3.0 * u * d)
    }

    /// Arc length from `u` to `u + width`, mm.
    fn length_of(&self, u: f64, width: f64) -> f64 {
        let sum: f64 = GAUSS
            .iter()
            .map(|&(x, w)| w * self.velocity(u + width * x).length())
            .sum();
        sum * width
    }

    /// The parameter at arc length `s` from the piece's beginning.
    fn parameter(&self, s: f64) -> f64 {
        let total = self.parts[PARTS - 1];
        if s <= 0.0 {
            return 0.0;
        }
        if s >= total {
            return 1.0;
        }
        let part = self.parts.partition_point(|&end| end < s).min(PARTS - 1);
        let before = part.checked_sub(1).map_or(0.0, |i| self.parts[i]);
        let (low, width) = (part as f64 / PARTS as f64, 1.0 / PARTS as f64);
        let wanted = s - before;
        let length = self.parts[part] - before;
        // Newton, kept inside a shrinking bracket.
        let (mut least, mut most) = (0.0, width);
        let mut x = if length > 0.0 {
            width * wanted / length
        } else {
            0.0
        };
        for _ in 0..50 {
            let miss = self.length_of(low, x) - wanted;
            if miss > 0.0 {
                most = x;
            } else {
                least = x;
            }
            let speed = self.velocity(low + x).length();
            let next = x - miss / speed;
            let next = if next > least && next < most {
                next
            } else {
                0.5 * (least + most)
            };
            if (next - x).abs() <= 1e-15 {
                break;
            }
            x = next;
        }
        low + x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_length_of_a_circle() {
        let n = 64;
        let points: Vec<DVec3> = (0..n)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
                DVec3::new(10.0 * cos, 10.0 * sin, 0.0)
            })
            .collect();
        let closed = Curve::with_ends(&points, Ends::Closed);
        let around = std::f64::consts::TAU * 10.0;
        assert!(
            (closed.length_mm() - around).abs() < 1e-4 * around,
            "{} is near {around}",
            closed.length_mm()
        );
        let (first, last) = (closed.tangent(0.0), closed.tangent(closed.length_mm()));
        assert!(
            first.distance(last) < 1e-12,
            "a closed curve has no corner where it closes: {first}, {last}"
        );
        for k in 0..=100 {
            let s = closed.length_mm() * f64::from(k) / 100.0;
            let off = (closed.at(s).length() - 10.0).abs();
            assert!(off < 1e-3, "{off} mm off the circle at {s} mm");
        }
    }

    #[test]
    fn steps_of_equal_arc_length_are_equal() {
        // Very uneven points with a sharp turn.
        let points = [
            DVec3::ZERO,
            DVec3::new(0.01, 0.0, 0.0),
            DVec3::new(50.0, 1.0, 0.0),
            DVec3::new(50.0, 1.1, 3.0),
            DVec3::new(0.0, 2.0, 3.0),
        ];
        let curve = Curve::through(&points);
        let fine = 20_000;
        let step = curve.length_mm() / f64::from(fine);
        for k in 0..fine {
            let s = step * f64::from(k);
            let chord = curve.at(s).distance(curve.at(s + step));
            assert!(
                chord <= step * (1.0 + 1e-6),
                "a chord is no longer than its arc: {chord} > {step} at {s}"
            );
        }
        for (p, &s) in points.iter().zip(curve.lengths_mm()) {
            assert!(curve.at(s).distance(*p) < 1e-11, "{p} is met at {s}");
        }
    }

    #[test]
    fn repeated_points_and_single_ones() {
        let p = DVec3::new(1.0, 2.0, 3.0);
        let one = Curve::through(&[p]);
        assert_eq!((one.length_mm(), one.at(7.0)), (0.0, p), "one point");
        let same = Curve::through(&[p, p, p]);
        assert_eq!(same.lengths_mm(), [0.0, 0.0, 0.0], "no way between them");
        let back = Curve::through(&[p, p + DVec3::X, p + DVec3::X, p]);
        let l = back.lengths_mm();
        assert_eq!(l[1], l[2], "standing still");
        assert!((back.length_mm() - 2.0).abs() < 1e-9, "there and back");
        assert!(back.at(1.5).is_finite(), "a curve that turns back");
    }
}
