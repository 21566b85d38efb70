//! A line made smooth, no point of it moved farther than it may.
//!
//! The line p that minimises Σ|pᵢ − cᵢ|² + ∫ℓ⁴|p″|²: a smoothing spline on even points (Reinsch 1967). What is shorter than
//! 2πℓ vanishes, bends of a radius above 2ℓ stay where they are. ℓ is given point by point, and made less where the line
//! would leave its bounds.

use glam::DVec3;

/// Smaller and smaller, where a point left its bounds.
const SOFTENED: f64 = 0.7;
/// After so many times ℓ is under a hundredth there.
const MOST_ROUNDS: usize = 14;
/// Points on each side of one that left its bounds whose ℓ is made less, too.
const BESIDE: usize = 4;

/// `points`, evenly spaced by `step_mm`, smoothed over `lengths_mm` (ℓ); point i is moved by at most `bounds_mm[i]`.
pub(super) fn smoothed(
    points: &[DVec3],
    step_mm: f64,
    lengths_mm: &[f64],
    bounds_mm: &[f64],
) -> Vec<DVec3> {
    let n = points.len();
    if n < 3 {
        return points.to_vec();
    }
    let mut weights: Vec<f64> = lengths_mm.iter().map(|l| (l / step_mm).powi(4)).collect();
    for _ in 0..MOST_ROUNDS {
        let line = solve(points, &weights);
        let mut is_out = vec![false; n];
        let mut count = 0;
        for i in 0..n {
            if line[i].distance(points[i]) > bounds_mm[i] {
                count += 1;
                is_out[i.saturating_sub(BESIDE)..(i + BESIDE + 1).min(n)].fill(true);
            }
        }
        if count == 0 {
            return line;
        }
        for (w, out) in weights.iter_mut().zip(&is_out) {
            *w *= if *out { SOFTENED.powi(4) } else { 1.0 };
        }
    }
    // What is still out is where the lumen is hardly wider than a voxel: put back, point by point.
    solve(points, &weights)
        .into_iter()
        .zip(points.iter().zip(bounds_mm))
        .map(|(p, (&c, &bound))| c + (p - c).clamp_length_max(bound))
        .collect()
}

/// Solves (1 + Σ wᵢ dᵢdᵢᵀ) p = c, where dᵢ are second differences: five diagonals, symmetric, positive definite.
fn solve(points: &[DVec3], weights: &[f64]) -> Vec<DVec3> {
    let n = points.len();
    let (mut main, mut first, mut second) = (vec![1.0; n], vec![0.0; n], vec![0.0; n]);
    for i in 1..n - 1 {
        let w = weights[i];
        main[i - 1] += w;
        main[i] += 4.0 * w;
        main[i + 1] += w;
        first[i - 1] -= 2.0 * w;
        first[i] -= 2.0 * w;
        second[i - 1] += w;
    }
    // L·D·Lᵀ in place: `main` becomes D, the others the diagonals of L below it.
    let mut line = points.to_vec();
    for i in 0..n {
        let d = main[i];
        let (a, b) = (first[i], second[i]);
        if i + 1 < n {
            let l = a / d;
            main[i + 1] -= l * a;
            if i + 2 < n {
                first[i + 1] -= l * b;
            }
            let here = line[i];
            line[i + 1] -= here * l;
            first[i] = l;
        }
        if i + 2 < n {
            let l = b / d;
            main[i + 2] -= l * b;
            let here = line[i];
            line[i + 2] -= here * l;
            second[i] = l;
        }
    }
    for i in (0..n).rev() {
        let mut p = line[i] / main[i];
        if i + 1 < n {
            p -= line[i + 1] * first[i];
        }
        if i + 2 < n {
            p -= line[i + 2] * second[i];
        }
        line[i] = p;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy(n: usize) -> Vec<DVec3> {
        (0..n)
            .map(|i| {
                DVec3::new(
                    i as f64,
                    if i % 2 == 0 { 0.5 } else { -0.5 },
                    0.01 * (i * i) as f64,
                )
            })
            .collect()
    }

    #[test]
    fn solves_what_it_says() {
        let points = wavy(9);
        let weights: Vec<f64> = (0..9).map(|i| 0.3 * i as f64).collect();
        let p = solve(&points, &weights);
        let bend = |i: usize| p[i - 1] - 2.0 * p[i] + p[i + 1];
        for i in 0..9 {
            // The gradient of the sum of squares.
            let mut g = p[i] - points[i];
            for (k, weight) in weights.iter().enumerate().take(8).skip(1) {
                let factor = match i.abs_diff(k) {
                    0 => -2.0,
                    1 => 1.0,
                    _ => 0.0,
                };
                g += bend(k) * (weight * factor);
            }
            assert!(g.length() < 1e-10, "point {i}: a gradient of {g}");
        }
    }

    #[test]
    fn jitter_goes_and_bends_stay() {
        let points = wavy(60);
        let line = smoothed(&points, 1.0, &[3.0; 60], &[2.0; 60]);
        for (i, (p, c)) in line.iter().zip(&points).enumerate().skip(8).take(44) {
            assert!(p.y.abs() < 0.02, "jitter of {} at {i}", p.y);
            assert!(
                (p.z - c.z).abs() < 0.05,
                "the bend at {i}: {} for {}",
                p.z,
                c.z
            );
        }
    }

    #[test]
    fn no_point_leaves_its_bounds() {
        let points = wavy(60);
        let bounds: Vec<f64> = (0..60).map(|i| if i < 30 { 0.05 } else { 1.0 }).collect();
        let line = smoothed(&points, 1.0, &[20.0; 60], &bounds);
        for (i, (p, c)) in line.iter().zip(&points).enumerate() {
            assert!(p.distance(*c) <= bounds[i] + 1e-12, "point {i}");
        }
        assert!(line[50].y.abs() < 0.1, "where it may, it is smooth");
        assert_eq!(
            smoothed(&points[..2], 1.0, &[1.0; 2], &[1.0; 2]),
            points[..2]
        );
    }
}
