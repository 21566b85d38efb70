//! Where along the rays something may be seen: a bound per cell of 4×4 pixels, from the boxes of active blocks.
//!
//! What the bounding mesh is on the GPU (techniques.md T1), as few boxes are cheaper to project than a mesh to raster:
//! rays of a cell in which no box lies are not walked at all, the others from the first box to the last.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::simd::GatherBytes;
use crate::camera::Projection;
use crate::geom::{BLOCK_EDGE, BLOCKS_PER_BRICK, BLOCKS_PER_EDGE, BRICK_EDGE};
use crate::scene::{Jitter, LevelFrame, RayFrame};

/// Pixels along the edge of a cell.
pub(super) const CELL: u32 = 4;
/// Voxels by which boxes are larger than what they bound: far more than rounding.
const MARGIN: f64 = 0.05;
/// Bytes of the cells of all threads, at most, unless those of one are more.
const PARTS_BYTES: usize = 64 << 20;
/// With so many active blocks a brick is bounded as a whole.
const MANY_BLOCKS: usize = 256;

/// A brick in which something can be seen: its first voxel, and its blocks' bytes ([`super::skip`]) where they are known.
pub(super) struct ActiveBrick {
    pub(super) first_voxel: DVec3,
    pub(super) blocks: Option<Arc<GatherBytes>>,
}

/// First and last sample of a level that rays of a cell may have to take.
pub(super) type Interval = [i32; 2];

const NONE: Interval = [i32::MAX, i32::MIN];

/// The intervals of a level, by cell.
#[derive(Debug)]
pub(super) struct Intervals {
    across: u32,
    cells: Vec<Interval>,
}

impl Intervals {
    /// No bounds.
    pub(super) fn everywhere(frame: &RayFrame) -> Self {
        let mut all = Self::nowhere(frame);
        all.cells.fill([0, i32::MAX]);
        all
    }

    fn nowhere(frame: &RayFrame) -> Self {
        let [across, down] = frame.size.map(|n| n.div_ceil(CELL));
        Self {
            across,
            cells: vec![NONE; across as usize * down as usize],
        }
    }

    /// The bounds of what may be seen in `bricks` of `level`.
    pub(super) fn new(frame: &RayFrame, level: &LevelFrame, bricks: &[ActiveBrick]) -> Self {
        if frame.projection.is_panoramic() {
            // Boxes all around have no place in the picture's cells.
            return Self::everywhere(frame);
        }
        let projector = Projector::new(frame, level);
        let mut sum = Self::nowhere(frame);
        let parts =
            (PARTS_BYTES / size_of_val(&sum.cells[..])).clamp(1, rayon::current_num_threads());
        let parts: Vec<(Self, Interval)> = bricks
            .par_chunks(bricks.len().div_ceil(parts).max(1))
            .map(|bricks| {
                let mut part = (Self::nowhere(frame), NONE);
                for brick in bricks {
                    projector.add_brick(brick, &mut part.0, &mut part.1);
                }
                part
            })
            .collect();
        for (part, everywhere) in parts {
            for (cell, other) in sum.cells.iter_mut().zip(part.cells) {
                widen(cell, other);
                widen(cell, everywhere);
            }
        }
        sum
    }

    /// What bounds the cells of all `pixels`.
    #[inline]
    pub(super) fn around(&self, pixels: &[[u32; 2]]) -> Interval {
        let mut around = NONE;
        for [x, y] in pixels {
            widen(
                &mut around,
                self.cells[(y / CELL * self.across + x / CELL) as usize],
            );
        }
        around
    }
}

fn widen(interval: &mut Interval, other: Interval) {
    interval[0] = interval[0].min(other[0]);
    interval[1] = interval[1].max(other[1]);
}

/// Half the size of a box, seen: along right, up and depth, and half its diagonal, mm.
#[derive(Clone, Copy)]
struct Extent {
    half: DVec3,
    radius: f64,
}

/// From boxes of a level to cells and samples.
struct Projector<'a> {
    frame: &'a RayFrame,
    level: &'a LevelFrame,
    /// x right, y up, z away.
    view_from_level: DAffine3,
    block: Extent,
    brick: Extent,
    cells_down: u32,
}

impl<'a> Projector<'a> {
    fn new(frame: &'a RayFrame, level: &'a LevelFrame) -> Self {
        let away = DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
        let view_from_level = away * frame.world_from_view.inverse() * level.world_from_level;
        let extent = |edge: u32| {
            let half = f64::from(edge) / 2.0 + MARGIN;
            let m = view_from_level.matrix3;
            let radius = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]
                .map(|[y, z]| (m * (DVec3::new(1.0, y, z) * half)).length());
            Extent {
                half: (m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs()) * half,
                radius: radius.into_iter().fold(0.0, f64::max),
            }
        };
        Self {
            block: extent(BLOCK_EDGE),
            brick: extent(BRICK_EDGE),
            cells_down: frame.size[1].div_ceil(CELL),
            frame,
            level,
            view_from_level,
        }
    }

    fn add_brick(&self, brick: &ActiveBrick, to: &mut Intervals, everywhere: &mut Interval) {
        let first = brick.first_voxel;
        let blocks = brick.blocks.as_ref().map(|b| b.bytes());
        let active = |b: &&[u8]| b[..BLOCKS_PER_BRICK].iter().filter(|&&b| b == 0).count();
        let Some(blocks) = blocks.filter(|b| active(b) < MANY_BLOCKS) else {
            let center = first + f64::from(BRICK_EDGE) / 2.0;
            self.add(center, self.brick, to, everywhere);
            return;
        };
        let edge = BLOCKS_PER_EDGE as usize;
        for (n, _) in blocks[..BLOCKS_PER_BRICK]
            .iter()
            .enumerate()
            .filter(|&(_, &b)| b == 0)
        {
            let block = DVec3::new(
                (n % edge) as f64,
                (n / edge % edge) as f64,
                (n / edge / edge) as f64,
            );
            let center = first + (block + 0.5) * f64::from(BLOCK_EDGE);
            self.add(center, self.block, to, everywhere);
        }
    }

    /// Adds the box around `center` (level voxels).
    #[inline]
    fn add(&self, center: DVec3, extent: Extent, to: &mut Intervals, everywhere: &mut Interval) {
        let center = self.view_from_level.transform_point3(center);
        let Extent { half, radius } = extent;
        let (nearest, farthest) = (center.z - half.z, center.z + half.z);
        if farthest <= 0.0 {
            return;
        }
        let ([t0, t1], [near, far]) = match self.frame.projection {
            Projection::Perspective => {
                let distance = center.length();
                ([distance - radius, distance + radius], [nearest, farthest])
            }
            Projection::Orthographic => ([nearest, farthest], [1.0, 1.0]),
            Projection::Fisheye | Projection::Equirectangular => {
                unreachable!("invariant: panoramas have no bounds")
            }
        };
        let index = |t: f64| (t - self.frame.first_mm_exact) / self.level.step_mm_exact;
        // `as` saturates. One sample more on each side: a segment has two ends. Jitter moves samples away by up to one.
        let moved = i32::from(self.frame.jitter != Jitter::None);
        let interval = [
            index(t0).floor() as i32 - 1 - moved,
            (index(t1).ceil() as i32).saturating_add(1),
        ];
        // A box across the eye's plane may be anywhere in the picture.
        if near <= half.z * 1e-3 {
            widen(everywhere, interval);
            return;
        }
        let [width, height] = self.frame.size.map(f64::from);
        let [half_width, half_height] = self.frame.half_extent;
        let bounds = |at: f64, reach: f64, half_plane: f64| {
            let (low, high) = (at - reach, at + reach);
            let low = low / if low < 0.0 { near } else { far };
            let high = high / if high > 0.0 { near } else { far };
            [low / half_plane, high / half_plane]
        };
        let [left, right] = bounds(center.x, half.x, half_width).map(|u| (u + 1.0) / 2.0 * width);
        let [top, bottom] =
            bounds(-center.y, half.y, half_height).map(|v| (v + 1.0) / 2.0 * height);
        let cell = |p: f64| (p / f64::from(CELL)).floor();
        let (x1, y1) = (cell(right), cell(bottom));
        if x1 < 0.0 || y1 < 0.0 {
            return;
        }
        let (x0, y0) = (cell(left).max(0.0) as u32, cell(top).max(0.0) as u32);
        let x1 = (x1 as u32).min(to.across - 1);
        let y1 = (y1 as u32).min(self.cells_down - 1);
        for y in y0..=y1 {
            let row = (y * to.across) as usize;
            // Empty when the box is right of the picture.
            for cell in to.cells[row..row + to.across as usize]
                .iter_mut()
                .take(x1 as usize + 1)
                .skip(x0 as usize)
            {
                widen(cell, interval);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::U64Vec3;

    use super::*;
    use crate::camera::Camera;
    use crate::geom::Lod;
    use crate::scene::{GridParams, LodRule};

    /// Every sample of every ray that lies in an active block is inside its cell's interval.
    #[test]
    fn no_active_sample_is_left_out() {
        let dims = U64Vec3::new(90, 70, 60);
        let world_from_index = DAffine3::from_scale_rotation_translation(
            DVec3::new(1.0, 0.7, 1.9),
            glam::DQuat::from_rotation_z(0.3),
            DVec3::new(5.0, -40.0, 3.0),
        );
        let still = GridParams {
            jitter: Jitter::None,
            dims,
            level_scales: vec![DVec3::ONE],
            lod: LodRule::Fixed(Lod(0)),
            world_from_index,
            step: 0.5,
        };
        let blocks: [u8; BLOCKS_PER_BRICK] =
            std::array::from_fn(|n| if n % 17 == 3 { 0 } else { 1 });
        let brick_at = DVec3::new(32.0, 32.0, 0.0);
        let middle = world_from_index.transform_point3(dims.as_dvec3() / 2.0);
        let mut taken = 0;
        for (n, projection, jitter) in [
            (0, Projection::Perspective, Jitter::Interleaved),
            (1, Projection::Orthographic, Jitter::Interleaved),
            (2, Projection::Perspective, Jitter::None),
        ] {
            let params = GridParams {
                jitter,
                ..still.clone()
            };
            // From outside, and from inside, close to the blocks.
            let eye = middle + DVec3::new(30.0, -150.0, 40.0) * [1.0, 1.0, 0.02][n];
            let camera = Camera {
                eye,
                target: middle,
                up: DVec3::Z,
                fov_y_degrees: 50.0,
                projection,
                near_mm: 0.0,
            };
            let frame = RayFrame::new(&camera, [61, 47], &params).unwrap();
            let level = &frame.levels[0];
            let bricks = [ActiveBrick {
                first_voxel: brick_at,
                blocks: Some(Arc::new(GatherBytes::new(&blocks, BLOCKS_PER_BRICK))),
            }];
            let intervals = Intervals::new(&frame, level, &bricks);
            for y in 0..47 {
                for x in 0..61 {
                    let u = (f64::from(x) + 0.5) * 2.0 / 61.0 - 1.0;
                    let v = 1.0 - (f64::from(y) + 0.5) * 2.0 / 47.0;
                    let at = |q: &[glam::Vec3; 3]| {
                        (q[0].as_dvec3() + q[1].as_dvec3() * u) + q[2].as_dvec3() * v
                    };
                    let length = at(&frame.world_dir).length();
                    for i in 0..frame.last_index as i32 {
                        let first_mm = f64::from(frame.first_mm_of_pixel(x, y));
                        let t = first_mm + f64::from(i) * level.step_mm_exact;
                        let p = at(&level.level_origin)
                            + level.anchor.as_dvec3()
                            + at(&level.level_dir) * (t / length);
                        let block = ((p - brick_at) / 4.0).floor();
                        let is_inside =
                            block.cmpge(DVec3::ZERO).all() && block.cmplt(DVec3::splat(8.0)).all();
                        let number = block.dot(DVec3::new(1.0, 8.0, 64.0));
                        if is_inside && blocks[number as usize] == 0 {
                            let [first, last] = intervals.around(&[[x, y]]);
                            assert!(
                                (first..=last).contains(&i),
                                "{projection:?}: sample {i} of ({x}, {y}) is not in {first}..={last}"
                            );
                            taken += 1;
                        }
                    }
                }
            }
        }
        assert!(taken > 1000, "only {taken} samples to look at");
    }
}
