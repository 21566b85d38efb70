//! A box of voxels with a flag and a distance to the wall for each: what the way is looked for in.

use glam::{DVec3, U64Vec3, UVec3};

use super::distance::distances_mm;
use super::error::CenterlineError;
use super::fill::Component;
use super::lumen::{Lumen, row_of};
use super::space::LevelSpace;
use super::specks::open_specks;
use crate::geom::{BRICK_EDGE, VoxelBox};

/// Bytes per voxel of the box: two flags, two distances, cost and parent of the search, and a row that is being read.
const BYTES_PER_VOXEL: u64 = 15;
/// Bytes per voxel of the lumen: the queue of the search.
const BYTES_PER_LUMEN_VOXEL: u64 = 16;

/// Bytes that a region of `box_voxels` takes while a way is looked for, `lumen_voxels` of them open; saturating, and the
/// maximum where indices do not fit.
pub(super) fn working_bytes(box_voxels: u64, lumen_voxels: u64) -> u64 {
    if box_voxels > u64::from(u32::MAX) {
        return u64::MAX;
    }
    box_voxels
        .saturating_mul(BYTES_PER_VOXEL)
        .saturating_add(lumen_voxels.saturating_mul(BYTES_PER_LUMEN_VOXEL))
}

/// A box of voxels of a level.
pub(super) struct Region {
    pub(super) space: LevelSpace,
    voxels: VoxelBox,
    pub(super) size: [usize; 3],
    /// Where the way may lead.
    pub(super) is_open: Vec<bool>,
    /// Voxels of the level that are open though their values are not those of the lumen.
    pub(super) specks: Vec<U64Vec3>,
    /// From each voxel's centre to the nearest centre of a voxel that is not lumen, mm.
    pub(super) distance_mm: Vec<f32>,
}

/// `voxels` and `by` more on each side, inside the level.
pub(super) fn grown(space: &LevelSpace, voxels: VoxelBox, by: U64Vec3) -> VoxelBox {
    VoxelBox::new(
        voxels.min.saturating_sub(by),
        (voxels.max + by).min(space.dims()),
    )
}

impl Region {
    /// The box of a component, which is what is open in it.
    pub(super) fn of_component(space: LevelSpace, component: &Component) -> Self {
        let voxels = grown(&space, component.bounds(), U64Vec3::ONE);
        let mut is_open = flags(&voxels);
        for voxel in component.voxels() {
            is_open[place(&voxels, voxel)] = true;
        }
        Self::new(space, voxels, is_open)
    }

    /// All lumen of a box.
    ///
    /// # Errors
    /// A brick is damaged.
    pub(super) fn of_lumen(
        lumen: &mut Lumen<'_>,
        voxels: VoxelBox,
    ) -> Result<Self, CenterlineError> {
        let mut is_open = flags(&voxels);
        let edge = u64::from(BRICK_EDGE);
        let (first, last) = (voxels.min / edge, (voxels.max - 1) / edge);
        for bz in first.z..=last.z {
            for by in first.y..=last.y {
                for bx in first.x..=last.x {
                    let brick = U64Vec3::new(bx, by, bz);
                    let Some(bits) = lumen.bits(brick.as_uvec3())? else {
                        continue;
                    };
                    let start = brick * edge;
                    let part = VoxelBox::new(start, start + edge).intersection(&voxels);
                    for z in part.min.z..part.max.z {
                        for y in part.min.y..part.max.y {
                            let inside = UVec3::new(0, (y - start.y) as u32, (z - start.z) as u32);
                            let row = bits[row_of(inside)];
                            for x in part.min.x..part.max.x {
                                let at = place(&voxels, U64Vec3::new(x, y, z));
                                is_open[at] = row >> (x - start.x) & 1 == 1;
                            }
                        }
                    }
                }
            }
        }
        Ok(Self::new(lumen.space, voxels, is_open))
    }

    pub(super) fn new(space: LevelSpace, voxels: VoxelBox, mut is_open: Vec<bool>) -> Self {
        let size = voxels.size().to_array().map(|n| n as usize);
        let specks = open_specks(&mut is_open, size);
        let distance_mm = distances_mm(&is_open, size, space.spacing_mm);
        let mut region = Self {
            space,
            voxels,
            size,
            is_open,
            specks: Vec::new(),
            distance_mm,
        };
        region.specks = specks.into_iter().map(|i| region.voxel(i)).collect();
        region
    }

    /// Closes what is farther than `reach_mm` from every one of `points`.
    pub(super) fn keep_near(&mut self, points: &[DVec3], reach_mm: f64) {
        let mut is_away = vec![true; self.is_open.len()];
        for &p in points {
            let voxel = self.space.nearest_voxel(p);
            if let Some(at) = self.index(voxel) {
                is_away[at] = false;
            }
        }
        let away = distances_mm(&is_away, self.size, self.space.spacing_mm);
        for (open, d) in self.is_open.iter_mut().zip(away) {
            *open &= f64::from(d) <= reach_mm;
        }
    }

    /// The place of a voxel of the level; `None` outside the box.
    pub(super) fn index(&self, voxel: U64Vec3) -> Option<usize> {
        let one = VoxelBox::new(voxel, voxel + 1);
        self.voxels
            .contains_box(&one)
            .then(|| place(&self.voxels, voxel))
    }

    /// The voxel of the box at place `index`: x, y, z from the box's corner.
    pub(super) fn xyz(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [index % nx, index / nx % ny, index / nx / ny]
    }

    /// The voxel of the level at place `index`.
    pub(super) fn voxel(&self, index: usize) -> U64Vec3 {
        self.voxels.min + U64Vec3::from_array(self.xyz(index).map(|v| v as u64))
    }

    /// The centre of the voxel at place `index`, mm.
    pub(super) fn world(&self, index: usize) -> DVec3 {
        self.space.world(self.voxel(index))
    }

    /// Distance to the wall at any point, trilinear between voxel centres, mm; outside the box that of its border.
    pub(super) fn distance_at(&self, world: DVec3) -> f64 {
        let p = self.in_box(world);
        let base = p.floor();
        let f = p - base;
        let n = self.size;
        let at = |dx: usize, dy: usize, dz: usize| {
            let x = (base.x as usize + dx).min(n[0] - 1);
            let y = (base.y as usize + dy).min(n[1] - 1);
            let z = (base.z as usize + dz).min(n[2] - 1);
            f64::from(self.distance_mm[(z * n[1] + y) * n[0] + x])
        };
        let mix = |a: f64, b: f64, t: f64| if t > 0.0 { a + (b - a) * t } else { a };
        let row = |dy, dz| mix(at(0, dy, dz), at(1, dy, dz), f.x);
        let slice = |dz| mix(row(0, dz), row(1, dz), f.y);
        mix(slice(0), slice(1), f.z)
    }

    /// Radius of a ball around a point of the lumen that meets no voxel outside the lumen, mm: exact near the wall, at most
    /// half a voxel's diagonal too small elsewhere.
    pub(super) fn clear_mm(&self, world: DVec3) -> f64 {
        let spacing = self.space.spacing_mm;
        let d = self.distance_at(world);
        let far = d - self.space.half_diagonal_mm();
        if d > 3.0 * spacing.max_element() {
            return far;
        }
        let p = self.in_box(world);
        let reach = (DVec3::splat(d + self.space.half_diagonal_mm()) / spacing).ceil() + 1.0;
        let (low, high) = ((p - reach).max(DVec3::ZERO), p + reach);
        let span =
            |axis: usize| low[axis] as usize..=(high[axis] as usize).min(self.size[axis] - 1);
        let mut least = f64::INFINITY;
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    if self.distance_mm[(z * self.size[1] + y) * self.size[0] + x] > 0.0 {
                        continue;
                    }
                    let from = (p - DVec3::new(x as f64, y as f64, z as f64)).abs();
                    let gap = (from - 0.5).max(DVec3::ZERO) * spacing;
                    least = least.min(gap.length());
                }
            }
        }
        least
    }

    /// Continuous index from the box's corner, clamped to the box.
    fn in_box(&self, world: DVec3) -> DVec3 {
        let p = self.space.voxel_from_world.transform_point3(world) - self.voxels.min.as_dvec3();
        let last = DVec3::from_array(self.size.map(|n| n as f64 - 1.0));
        p.clamp(DVec3::ZERO, last)
    }
}

fn flags(voxels: &VoxelBox) -> Vec<bool> {
    let n = voxels
        .voxel_count()
        .expect("invariant: the box was found to fit memory");
    vec![false; n as usize]
}

fn place(voxels: &VoxelBox, voxel: U64Vec3) -> usize {
    let (at, size) = (voxel - voxels.min, voxels.size());
    ((at.z * size.y + at.y) * size.x + at.x) as usize
}
