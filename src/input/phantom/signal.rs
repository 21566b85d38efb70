//! Phantoms that are formulas: the Marschner–Lobb signal and a sponge. Voxel centres lie at (i + ½) · 2/n − 1 on each axis.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::U64Vec3;

use super::RowField;
use super::raster::position;
use crate::geom::VoxelBox;

/// The test signal of Marschner and Lobb (1994) over [−1, 1]³, f_M = 6 and α = 0.25, scaled to 0…1.
pub(super) struct MarschnerLobb {
    x: Vec<f64>,
    y: Vec<f64>,
    /// The part of the signal that depends on z, per slice.
    z_part: Vec<f64>,
}

const FREQUENCY: f64 = 6.0;
const ALPHA: f64 = 0.25;

/// The centres of voxels `first` to `end` of an axis of `n`.
fn centers(first: u64, end: u64, n: u64) -> Vec<f64> {
    (first..end).map(|i| position(i, n)).collect()
}

impl MarschnerLobb {
    pub(super) fn new(dims: U64Vec3, voxels: VoxelBox) -> Self {
        let VoxelBox { min, max } = voxels;
        Self {
            x: centers(min.x, max.x, dims.x),
            y: centers(min.y, max.y, dims.y),
            z_part: centers(min.z, max.z, dims.z)
                .into_iter()
                .map(|z| 1.0 - libm::sin(FRAC_PI_2 * z) + ALPHA)
                .collect(),
        }
    }
}

impl RowField for MarschnerLobb {
    /// α · ρ_r for each column.
    type Shared = Vec<f64>;

    fn shared(&self, j: usize) -> Vec<f64> {
        let y = self.y[j];
        self.x
            .iter()
            .map(|x| {
                let r = (x * x + y * y).sqrt();
                ALPHA * libm::cos(2.0 * PI * FREQUENCY * libm::cos(FRAC_PI_2 * r))
            })
            .collect()
    }

    fn row(&self, shared: &Vec<f64>, k: usize, out: &mut [f32]) {
        for (o, radial) in out.iter_mut().zip(shared) {
            *o = ((self.z_part[k] + radial) / (2.0 * (1.0 + ALPHA))) as f32;
        }
    }
}

/// One side of a gyroid: a connected solid with connected pores, at half of full scale.
pub(super) struct Sponge {
    x: Vec<[f32; 2]>,
    y: Vec<[f32; 2]>,
    z: Vec<[f32; 2]>,
}

/// Cells of the gyroid along each edge of the box.
const CELLS: f64 = 4.0;
/// The field's value at the surface: the lower, the more is solid. Below 0 the box's corners cut pieces loose.
const SURFACE: f32 = 0.2;
/// The solid's value, in fractions of full scale.
const SOLID: f32 = 0.5;

/// Sine and cosine at each voxel of an axis.
fn waves(first: u64, end: u64, n: u64) -> Vec<[f32; 2]> {
    let wave = |p: f64| {
        let phase = PI * CELLS * p;
        [libm::sin(phase) as f32, libm::cos(phase) as f32]
    };
    centers(first, end, n).into_iter().map(wave).collect()
}

impl Sponge {
    pub(super) fn new(dims: U64Vec3, voxels: VoxelBox) -> Self {
        let VoxelBox { min, max } = voxels;
        Self {
            x: waves(min.x, max.x, dims.x),
            y: waves(min.y, max.y, dims.y),
            z: waves(min.z, max.z, dims.z),
        }
    }
}

impl RowField for Sponge {
    type Shared = [f32; 2];

    fn shared(&self, j: usize) -> [f32; 2] {
        self.y[j]
    }

    fn row(&self, &[sin_y, cos_y]: &[f32; 2], k: usize, out: &mut [f32]) {
        let [sin_z, cos_z] = self.z[k];
        for (o, &[sin_x, cos_x]) in out.iter_mut().zip(&self.x) {
            let gyroid = sin_x * cos_y + sin_y * cos_z + sin_z * cos_x;
            *o = if gyroid > SURFACE { SOLID } else { 0.0 };
        }
    }
}
