//! Painting shapes into rows, later ones over earlier ones. A row that meets no shape costs next to nothing.

use glam::U64Vec3;

use super::levels::Material;
use super::shapes::Shape;

/// Shapes and what they are made of.
pub(super) struct Scene {
    /// By number; number 0 is air.
    pub(super) materials: Vec<Material>,
    solids: Vec<Solid>,
}

struct Solid {
    shape: Shape,
    material: u8,
    y: [f64; 2],
    z: [f64; 2],
}

impl Scene {
    /// An empty scene.
    pub(super) fn new(materials: Vec<Material>) -> Self {
        Self {
            materials,
            solids: Vec::new(),
        }
    }

    /// Paints `shape` over all before it.
    pub(super) fn paint(&mut self, material: u8, shape: Shape) {
        let [y, z] = shape.bounds();
        self.solids.push(Solid {
            shape,
            material,
            y,
            z,
        });
    }

    /// What meets slice `z` of a volume of `dims` voxels.
    pub(super) fn slice(&self, dims: U64Vec3, z: u64) -> Slice<'_> {
        let at = position(z, dims.z);
        let solids: Vec<&Solid> = self
            .solids
            .iter()
            .filter(|s| s.z[0] <= at && at <= s.z[1])
            .collect();
        let y = solids.iter().fold([f64::MAX, f64::MIN], |y, s| {
            [y[0].min(s.y[0]), y[1].max(s.y[1])]
        });
        Slice {
            solids,
            dims,
            z: at,
            y,
        }
    }
}

/// The shapes that meet one slice.
pub(super) struct Slice<'a> {
    solids: Vec<&'a Solid>,
    dims: U64Vec3,
    z: f64,
    y: [f64; 2],
}

impl Slice<'_> {
    /// Paints row `y` from column `x` on; false, and `row` left as it is, when nothing meets it.
    pub(super) fn paint_row(&self, y: u64, x: u64, row: &mut [u8]) -> bool {
        let at = position(y, self.dims.y);
        if at < self.y[0] || at > self.y[1] {
            return false;
        }
        let mut painted = false;
        let half = self.dims.x as f64 * 0.5;
        for solid in &self.solids {
            if at < solid.y[0] || at > solid.y[1] {
                continue;
            }
            let Some([lo, hi]) = solid.shape.row(at, self.z) else {
                continue;
            };
            // Voxel i has its centre at (i + ½) / half − 1. Casts saturate: what is left of the box becomes 0.
            let first = ((lo + 1.0) * half - 0.5).ceil() as u64;
            let end = (((hi + 1.0) * half - 0.5).floor() + 1.0) as u64;
            let first = first.saturating_sub(x).min(row.len() as u64) as usize;
            let end = end.saturating_sub(x).min(row.len() as u64) as usize;
            if first < end {
                if !painted {
                    row.fill(0);
                    painted = true;
                }
                row[first..end].fill(solid.material);
            }
        }
        painted
    }
}

/// Where the centre of voxel `i` of `n` lies in −1 … 1.
pub(super) fn position(i: u64, n: u64) -> f64 {
    (i as f64 + 0.5) / (n as f64 * 0.5) - 1.0
}
