//! A camera that orbits a made-up volume of bricks: which bricks each ray meets, front to back.

use std::collections::BTreeSet;

use brickscope::geom::{BrickId, Lod};
use glam::{DVec3, IVec3};

/// What is orbited, and how.
#[derive(Clone, Copy, Debug)]
pub struct Orbit {
    /// Bricks along an edge of the volume.
    pub edge: i32,
    /// Views in a full turn.
    pub views: u32,
    /// Rays along an edge of the picture.
    pub rays: u32,
    /// Opacity per brick length: how deep rays go.
    pub opacity: f64,
    /// The far half is drawn from the next coarser level.
    pub has_levels: bool,
}

/// A hash of `x` in which every bit depends on every bit.
pub fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    x = (x ^ (x >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    x ^ (x >> 33)
}

impl Orbit {
    /// Seven of ten bricks of an ellipsoid are visible.
    fn is_visible(&self, at: IVec3) -> bool {
        let centre = (f64::from(self.edge) - 1.0) / 2.0;
        let from_centre = (at.as_dvec3() - centre) * DVec3::new(1.0, 0.8, 1.0);
        let number = at.x + self.edge * (at.y + self.edge * at.z);
        from_centre.length() <= f64::from(self.edge) * 0.48
            && mix(number.unsigned_abs().into()) % 10 < 7
    }

    /// The rays of view `view` that meet anything: the bricks of each, front to back. The camera is that of
    /// `bench render`: perspective of 30°, 1.5 diagonals away, about +y.
    pub fn view(&self, view: u32) -> Vec<Vec<BrickId>> {
        const STEP: f64 = 0.1;
        let edge = f64::from(self.edge);
        let angle = f64::from(view) / f64::from(self.views) * std::f64::consts::TAU;
        let (sin, cos) = angle.sin_cos();
        let distance = 1.5 * edge * 3_f64.sqrt();
        let (back, right) = (DVec3::new(sin, 0.0, cos), DVec3::new(cos, 0.0, -sin));
        let eye = DVec3::splat(edge / 2.0) + back * distance;
        let scale = 15_f64.to_radians().tan();
        let at_pixel = |i: u32| ((f64::from(i) + 0.5) / f64::from(self.rays) * 2.0 - 1.0) * scale;
        let mut rays = Vec::new();
        for (row, column) in (0..self.rays).flat_map(|r| (0..self.rays).map(move |c| (r, c))) {
            let direction = right * at_pixel(column) + DVec3::Y * at_pixel(row) - back;
            let mut ray: Vec<BrickId> = Vec::new();
            let (mut t, mut light) = (distance - edge, 1.0);
            while t < distance + edge && light > 0.02 {
                let at = (eye + direction * t).floor().as_ivec3();
                let is_far = t > distance;
                t += STEP;
                let is_inside = at.min_element() >= 0 && at.max_element() < self.edge;
                if !is_inside || !self.is_visible(at) {
                    continue;
                }
                light *= 1.0 - (self.opacity * STEP).min(1.0);
                let brick = if self.has_levels && is_far {
                    BrickId::new(Lod(1), (at / 2).as_uvec3())
                } else {
                    BrickId::new(Lod(0), at.as_uvec3())
                };
                if !ray.contains(&brick) {
                    ray.push(brick);
                }
            }
            if !ray.is_empty() {
                rays.push(ray);
            }
        }
        rays
    }

    /// A trace of one turn in passes from front to back: each pass of a view takes every ray `depth` bricks further.
    pub fn trace(&self, depth: usize) -> Vec<Vec<BrickId>> {
        let mut trace = Vec::new();
        for view in 0..self.views {
            let rays = self.view(view);
            let longest = rays.iter().map(Vec::len).max().unwrap_or(0);
            for first in (0..longest).step_by(depth) {
                let pass: BTreeSet<BrickId> = rays
                    .iter()
                    .flat_map(|ray| ray.iter().skip(first).take(depth).copied())
                    .collect();
                trace.push(pass.into_iter().collect());
            }
        }
        trace
    }

    /// Bricks of the largest view, and of all views together.
    pub fn working_sets(&self) -> (usize, usize) {
        let views: Vec<BTreeSet<BrickId>> = (0..self.views)
            .map(|v| self.view(v).into_iter().flatten().collect())
            .collect();
        let largest = views.iter().map(BTreeSet::len).max().unwrap_or(0);
        let union: BTreeSet<BrickId> = views.into_iter().flatten().collect();
        (largest, union.len())
    }
}
