//! The sample grid of a frame: where sample i of each ray lies.
//!
//! Invariant 1 (design.md §2): sample i lies at `t = t₀ + i·ds` from the eye (orthographic: from the eye plane), `t₀`
//! the last multiple of `ds` before the volume's bounding sphere, the same for all rays. A position is an integer voxel
//! anchor of the frame plus an f32 offset, computed from i by one multiply-add per axis.

use glam::{DAffine3, DMat3, DVec3, IVec3, Mat3, U64Vec3, Vec3};

use super::{Jitter, SceneError};
use crate::camera::{BoundingSphere, Camera, Projection};
use crate::geom::{Aabb, Lod};

/// The rendered box in continuous level-0 voxel coordinates: from the first to the last voxel centre on each axis; a
/// one-voxel axis is one voxel thick (design.md §3).
fn rendered_box(dims: U64Vec3) -> Aabb {
    let axis = |n: u64| {
        if n == 1 {
            (0.0, 1.0)
        } else {
            (0.5, n as f64 - 0.5)
        }
    };
    let (x, y, z) = (axis(dims.x), axis(dims.y), axis(dims.z));
    Aabb::new(DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1))
}

/// World from continuous voxel coordinates (voxel i's centre at i + ½).
fn world_from_voxel(world_from_index: &DAffine3) -> DAffine3 {
    *world_from_index * DAffine3::from_translation(DVec3::splat(-0.5))
}

/// Centre and radius (world mm) of the sphere around the rendered box of a volume of `dims` voxels.
pub fn volume_bounds(dims: U64Vec3, world_from_index: &DAffine3) -> BoundingSphere {
    let to_world = world_from_voxel(world_from_index);
    BoundingSphere::of_corners(
        &rendered_box(dims)
            .corners()
            .map(|c| to_world.transform_point3(c)),
    )
}

/// Which levels a frame samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LodRule {
    /// This one everywhere.
    Fixed(Lod),
    /// By distance: at sample index i, the coarsest level whose smallest spacing is at most this many times the pixel's
    /// footprint there (`--lod-error`, pixels; design.md §3).
    Error(f64),
}

/// One level of a frame's sample grid. Its sample j lies at `t₀ + j · 2^lod · ds`.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelFrame {
    /// Which.
    pub lod: Lod,
    /// The first of its samples, in steps of this level: where the finer level ends. 0 at the finest level in use.
    pub begin: u32,
    /// Where the next coarser level in use begins, in steps of this level; [`RayFrame::MAX_SAMPLES`] at the last. The
    /// segment that ends there is still of this level (design.md §3).
    pub end: u32,
    /// The rays' direction in level voxels: `level_from_world` · `world_dir`.
    pub level_dir: [Vec3; 3],
    /// Ray origin in level voxels, from the anchor: centre, per u, per v.
    pub level_origin: [Vec3; 3],
    /// The integer voxel of the level that offsets count from: the one nearest to the eye.
    pub anchor: IVec3,
    /// The rendered box in level voxels, from the anchor.
    pub box_min: Vec3,
    /// Its greatest corner.
    pub box_max: Vec3,
    /// World normal from a level-voxel gradient: the inverse transpose of the affine, columns.
    pub normal_from_gradient: Mat3,
    /// World millimetres from continuous level voxel coordinates.
    pub world_from_level: DAffine3,
    /// Distance of this level's samples, mm: 2^lod · ds.
    pub step_mm: f32,
    /// The same, exact.
    pub step_mm_exact: f64,
}

/// The sample grid of one frame. A pixel (px, py) has the image-plane coordinates
/// `u = (px + ox)·2/width − 1` and `v = 1 − (py + oy)·2/height`, (ox, oy) being [`Self::place_in_pixel`]. The origin of its
/// ray is `q + u·q_u + v·q_v`, its direction by the weights of [`Self::fan`].
#[derive(Clone, Debug, PartialEq)]
pub struct RayFrame {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Where in a pixel its ray passes, from its upper left corner, in pixels: (½, ½), but in super-sampled pictures.
    pub place_in_pixel: [f32; 2],
    /// Are the samples of a ray moved by [`interleaved_offset`] of its pixel?
    pub jitter: Jitter,
    /// Unnormalised ray direction in world: centre, per u, per v.
    pub world_dir: [Vec3; 3],
    /// From the finest level in use to the coarsest of the volume. The first [`Self::used_levels`] are sampled; the others
    /// stand in for what is not resident.
    pub levels: Vec<LevelFrame>,
    /// How many of `levels` are sampled, at least 1.
    pub used_levels: usize,
    /// Distance of sample 0 from the eye, mm: t₀.
    pub first_mm: f32,
    /// Distance of the near plane from the eye along the view direction, mm.
    pub near_mm: f32,
    /// Index of the last sample before the bounding sphere's far end, in base steps ds.
    pub last_index: u32,
    /// World from view (x right, y up, z towards the viewer), for the mesh raster.
    pub world_from_view: DAffine3,
    /// Half width and half height of the image plane: tangents (perspective), mm (orthographic) or radians (panoramas).
    pub half_extent: [f64; 2],
    /// How rays run.
    pub projection: Projection,
    /// Distance of base samples, mm: ds.
    pub step_mm: f32,
    /// The same, exact.
    pub step_mm_exact: f64,
    /// Distance of sample 0, mm, exact.
    pub first_mm_exact: f64,
}

/// By how much of a base step the samples of pixel (x, y) are moved away from the eye: 0 to 15 sixteenths, each once in a
/// tile of 4×4 pixels, neighbours far apart (the ordered dither of Bayer, 1973).
pub fn interleaved_offset(x: u32, y: u32) -> f32 {
    let of_two = |x: u32, y: u32| 2 * ((x ^ y) & 1) + (y & 1);
    let sixteenths = 4 * of_two(x, y) + of_two(x >> 1, y >> 1);
    sixteenths as f32 / 16.0
}

/// Sine and cosine of an angle from −π to π: from the series of those of its half, up to the 11th and 12th power (off by
/// 1e-6), so that shaders, which promise less of their own, compute the same.
fn half_turn(angle: f32) -> [f32; 2] {
    let h = angle * 0.5;
    let q = h * h;
    let sin = h
        * (1.0
            + q * (-1.0 / 6.0
                + q * (1.0 / 120.0
                    + q * (-1.0 / 5040.0 + q * (1.0 / 362_880.0 - q / 39_916_800.0)))));
    let cos = 1.0
        + q * (-0.5
            + q * (1.0 / 24.0
                + q * (-1.0 / 720.0
                    + q * (1.0 / 40_320.0 + q * (-1.0 / 3_628_800.0 + q / 479_001_600.0)))));
    [2.0 * sin * cos, 1.0 - 2.0 * sin * sin]
}

/// What a frame's grid is made of.
#[derive(Clone, Debug)]
pub struct GridParams {
    /// Voxels of level 0.
    pub dims: U64Vec3,
    /// Level-0 voxels per voxel of each level of the volume, finest first; at least one.
    pub level_scales: Vec<DVec3>,
    /// Which levels are sampled.
    pub lod: LodRule,
    /// World from voxel index of level 0.
    pub world_from_index: DAffine3,
    /// Distance of samples in units of the smallest spacing of level 0.
    pub step: f64,
    /// Are samples moved pixel by pixel?
    pub jitter: Jitter,
}

impl RayFrame {
    /// Most samples of a ray.
    pub const MAX_SAMPLES: u32 = 1 << 30;

    /// The grid of `camera` for a picture of `size` pixels.
    ///
    /// # Errors
    /// The camera is degenerate, the level is not there, or rays would have more than 2³⁰ samples.
    pub fn new(camera: &Camera, size: [u32; 2], params: &GridParams) -> Result<Self, SceneError> {
        let view = camera.view(f64::from(size[0]) / f64::from(size[1]))?;
        let basis = view.basis;
        let step_mm = params.step * smallest_spacing(&params.world_from_index, DVec3::ONE);

        let bounds = volume_bounds(params.dims, &params.world_from_index);
        let to_center = bounds.center - camera.eye;
        let center_mm = match camera.projection {
            Projection::Orthographic => to_center.dot(basis.forward),
            _ => to_center.length(),
        };
        let first_index = ((center_mm - bounds.radius) / step_mm).floor().max(0.0);
        let first_mm = first_index * step_mm;
        let last_index = ((center_mm + bounds.radius) / step_mm).ceil() - first_index;
        if last_index.is_nan() || last_index.abs() >= f64::from(Self::MAX_SAMPLES) {
            return Err(SceneError::TooManySamples {
                samples: last_index,
                step_mm,
            });
        }
        let last_index = last_index.max(0.0) as u32;

        let half_extent = view.half_extent;
        let (across, upward) = (basis.right * half_extent[0], basis.up * half_extent[1]);
        let (world_dir, world_origin) = match camera.projection {
            Projection::Perspective => (
                [basis.forward, across, upward],
                [camera.eye, DVec3::ZERO, DVec3::ZERO],
            ),
            Projection::Orthographic => (
                [basis.forward, DVec3::ZERO, DVec3::ZERO],
                [camera.eye, across, upward],
            ),
            Projection::Fisheye | Projection::Equirectangular => (
                [basis.forward, basis.right, basis.up],
                [camera.eye, DVec3::ZERO, DVec3::ZERO],
            ),
        };

        let pixel = half_extent[1] * 2.0 / f64::from(size[1]);
        let footprint_mm = |index: u32| match camera.projection {
            Projection::Orthographic => pixel,
            _ => pixel * (first_mm + f64::from(index) * step_mm),
        };
        let spans = params.spans(last_index, footprint_mm)?;
        let used_levels = spans.len();
        let finest = usize::from(spans[0].lod.0);
        let levels = params
            .level_scales
            .iter()
            .enumerate()
            .skip(finest)
            .map(|(l, &scale)| {
                let span = spans.get(l - finest).copied().unwrap_or(Span {
                    lod: Lod(l as u8),
                    begin: 0,
                    end: 0,
                });
                params.level(span, scale, camera.eye, world_dir, world_origin)
            })
            .collect();
        Ok(Self {
            size,
            world_dir: world_dir.map(|d| d.as_vec3()),
            levels,
            used_levels,
            first_mm: first_mm as f32,
            near_mm: camera.near_mm as f32,
            last_index,
            world_from_view: DAffine3::from_mat3_translation(
                DMat3::from_cols(basis.right, basis.up, -basis.forward),
                camera.eye,
            ),
            half_extent,
            projection: camera.projection,
            step_mm: step_mm as f32,
            step_mm_exact: step_mm,
            first_mm_exact: first_mm,
            place_in_pixel: [0.5; 2],
            jitter: params.jitter,
        })
    }

    /// Image-plane coordinates of the ray of pixel (x, y).
    pub fn plane_of_pixel(&self, x: u32, y: u32) -> [f32; 2] {
        self.plane_at(x, y, self.place_in_pixel)
    }

    /// Those of the ray that passes pixel (x, y) at `place`, from its upper left corner, in pixels.
    pub fn plane_at(&self, x: u32, y: u32, [ox, oy]: [f32; 2]) -> [f32; 2] {
        [
            (x as f32 + ox) * (2.0 / self.size[0] as f32) - 1.0,
            1.0 - (y as f32 + oy) * (2.0 / self.size[1] as f32),
        ]
    }

    /// The same of any pixel, also one outside the picture.
    pub fn plane_of(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| {
            (pixel[axis] + f64::from(self.place_in_pixel[axis])) * 2.0 / f64::from(self.size[axis])
        });
        [x - 1.0, 1.0 - y]
    }

    /// Weights of the direction's three vectors for the ray through a point of the image plane: 1, u, v; in panoramas ahead,
    /// to the right, up.
    pub fn fan(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let [half_width, half_height] = self.half_extent.map(|h| h as f32);
        match self.projection {
            Projection::Perspective | Projection::Orthographic => [1.0, u, v],
            Projection::Equirectangular => {
                let (longitude, latitude) = (half_turn(u * half_width), half_turn(v * half_height));
                [
                    latitude[1] * longitude[1],
                    latitude[1] * longitude[0],
                    latitude[0],
                ]
            }
            Projection::Fisheye => {
                let (x, y) = (u * half_width, v * half_height);
                let angle = (x * x + y * y).sqrt();
                let [sin, cos] = half_turn(angle);
                let scale = if angle > 1e-6 { sin / angle } else { 1.0 };
                [cos, x * scale, y * scale]
            }
        }
    }

    /// Distance of sample 0 of the ray of pixel (x, y), mm.
    pub fn first_mm_of_pixel(&self, x: u32, y: u32) -> f32 {
        match self.jitter {
            Jitter::None => self.first_mm,
            Jitter::Interleaved => self.first_mm + interleaved_offset(x, y) * self.step_mm,
        }
    }

    /// The levels that are sampled, finest first.
    pub fn used(&self) -> &[LevelFrame] {
        &self.levels[..self.used_levels]
    }

    /// The coarsest level that is sampled.
    pub fn coarsest_used(&self) -> &LevelFrame {
        &self.levels[self.used_levels - 1]
    }

    /// Distances from the eye (mm along a ray; orthographic: from the eye plane) between which `level` is sampled, one
    /// step of it added at both ends.
    pub fn reach_mm(&self, level: &LevelFrame) -> [f64; 2] {
        let at = |index: u32| self.first_mm_exact + f64::from(index) * level.step_mm_exact;
        let last = self.first_mm_exact + f64::from(self.last_index) * self.step_mm_exact;
        [
            at(level.begin) - level.step_mm_exact,
            at(level.end).min(last) + level.step_mm_exact,
        ]
    }

    /// Pixels that the edge of a 4³ block of the coarsest level in use covers at most, at the point of the volume nearest
    /// to the eye (infinite when the eye is inside or close).
    pub fn block_pixels(&self) -> f64 {
        let level = self.coarsest_used();
        let m = level.world_from_level.matrix3 * f64::from(crate::geom::BLOCK_EDGE);
        let edge_mm = [m.x_axis, m.y_axis, m.z_axis]
            .into_iter()
            .map(DVec3::length)
            .fold(0.0, f64::max);
        let pixel_mm = self.half_extent[1] * 2.0 / f64::from(self.size[1])
            * match self.projection {
                Projection::Orthographic => 1.0,
                _ => self.first_mm_exact,
            };
        edge_mm / pixel_mm
    }
}

/// The samples of one level, in its own steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    lod: Lod,
    begin: u32,
    end: u32,
}

/// The smallest spacing of a level whose voxels are `scale` voxels of level 0, mm.
fn smallest_spacing(world_from_index: &DAffine3, scale: DVec3) -> f64 {
    let m = world_from_index.matrix3;
    [
        m.x_axis.length() * scale.x,
        m.y_axis.length() * scale.y,
        m.z_axis.length() * scale.z,
    ]
    .into_iter()
    .fold(f64::MAX, f64::min)
}

impl GridParams {
    /// Which level is sampled where: consecutive levels, finest first. A switch to level l + 1 happens at a multiple of
    /// 2^(l + 1) base steps, a function of the sample index alone (design.md §3).
    fn spans(
        &self,
        last_index: u32,
        footprint_mm: impl Fn(u32) -> f64,
    ) -> Result<Vec<Span>, SceneError> {
        let last = self.level_scales.len() - 1;
        let pixels = match self.lod {
            LodRule::Fixed(lod) if usize::from(lod.0) <= last => {
                return Ok(vec![Span {
                    lod,
                    begin: 0,
                    end: RayFrame::MAX_SAMPLES,
                }]);
            }
            LodRule::Fixed(lod) => return Err(SceneError::NoSuchLevel { asked: lod.0, last }),
            LodRule::Error(pixels) => pixels,
        };
        let fits = |l: usize, index: u32| {
            let spacing = smallest_spacing(&self.world_from_index, self.level_scales[l]);
            spacing <= footprint_mm(index) * pixels
        };
        let finest = (1..=last).take_while(|&l| fits(l, 0)).last().unwrap_or(0);
        let mut spans = vec![Span {
            lod: Lod(finest as u8),
            begin: 0,
            end: RayFrame::MAX_SAMPLES,
        }];
        let mut index = 0;
        for l in finest + 1..=last {
            // The footprint grows with the index: the first multiple of 2^l that fits, by bisection.
            let (mut low, mut high) = (index >> l, (last_index >> l) + 1);
            while low < high {
                let middle = low + (high - low) / 2;
                if fits(l, middle << l) {
                    high = middle;
                } else {
                    low = middle + 1;
                }
            }
            index = low << l;
            if index > last_index {
                break;
            }
            if let Some(finer) = spans.last_mut() {
                finer.end = index >> finer.lod.0;
            }
            spans.push(Span {
                lod: Lod(l as u8),
                begin: low,
                end: RayFrame::MAX_SAMPLES,
            });
        }
        Ok(spans)
    }

    fn level(
        &self,
        span: Span,
        scale: DVec3,
        eye: DVec3,
        world_dir: [DVec3; 3],
        world_origin: [DVec3; 3],
    ) -> LevelFrame {
        let world_from_level =
            world_from_voxel(&self.world_from_index) * DAffine3::from_scale(scale);
        let level_from_world = world_from_level.inverse();
        let eye_level = level_from_world.transform_point3(eye);
        let box0 = rendered_box(self.dims);
        let (box_min, box_max) = (box0.min / scale, box0.max / scale);
        let anchor = eye_level.clamp(box_min, box_max).floor();
        let linear = level_from_world.matrix3;
        let step_mm = self.step
            * smallest_spacing(&self.world_from_index, DVec3::ONE)
            * f64::from(1_u32 << span.lod.0.min(31));
        LevelFrame {
            lod: span.lod,
            begin: span.begin,
            end: span.end,
            level_dir: world_dir.map(|d| (linear * d).as_vec3()),
            level_origin: [
                (eye_level - anchor).as_vec3(),
                (linear * world_origin[1]).as_vec3(),
                (linear * world_origin[2]).as_vec3(),
            ],
            anchor: anchor.as_ivec3(),
            box_min: (box_min - anchor).as_vec3(),
            box_max: (box_max - anchor).as_vec3(),
            normal_from_gradient: linear.transpose().as_mat3(),
            world_from_level,
            step_mm: step_mm as f32,
            step_mm_exact: step_mm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_are_those_of_the_library() {
        for n in -1000..=1000 {
            let angle = std::f32::consts::PI * (n as f32 / 1000.0);
            let [sin, cos] = half_turn(angle);
            let (s, c) = f64::from(angle).sin_cos();
            let off = (f64::from(sin) - s).abs().max((f64::from(cos) - c).abs());
            assert!(off < 1e-6, "{angle}: off by {off}");
        }
    }

    fn params(lod: LodRule) -> GridParams {
        GridParams {
            dims: U64Vec3::splat(1024),
            level_scales: (0..6).map(|l| DVec3::splat(f64::from(1 << l))).collect(),
            lod,
            world_from_index: DAffine3::IDENTITY,
            step: 0.5,
            jitter: Jitter::None,
        }
    }

    #[test]
    fn offsets_of_a_tile_are_all_different() {
        let mut met: Vec<u32> = (0..16)
            .map(|i| (interleaved_offset(i % 4, i / 4) * 16.0) as u32)
            .collect();
        met.sort_unstable();
        assert_eq!(met, (0..16).collect::<Vec<u32>>(), "each once");
        assert_eq!(
            interleaved_offset(5, 6),
            interleaved_offset(1, 2),
            "repeats after four pixels"
        );
    }

    #[test]
    fn levels_switch_by_distance_at_multiples() {
        // A pixel covers (index / 1000) mm.
        let spans = params(LodRule::Error(1.0))
            .spans(20_000, |i| f64::from(i) / 1000.0)
            .unwrap();
        let base: Vec<(u8, u32)> = spans
            .iter()
            .map(|s| (s.lod.0, s.begin << s.lod.0))
            .collect();
        assert_eq!(
            base,
            [(0, 0), (1, 2000), (2, 4000), (3, 8000), (4, 16000)],
            "voxels of 2, 4, 8, 16 mm"
        );
        for pair in spans.windows(2) {
            assert_eq!(
                pair[0].end << pair[0].lod.0,
                pair[1].begin << pair[1].lod.0,
                "no gap, no overlap"
            );
        }
        let odd = params(LodRule::Error(1.0))
            .spans(20_000, |i| f64::from(i + 3) / 1000.0)
            .unwrap();
        assert_eq!(
            odd[2].begin << 2,
            4000,
            "3997 rounded up to a multiple of 4"
        );
        let coarse = params(LodRule::Error(4.0))
            .spans(20_000, |i| f64::from(i) / 1000.0)
            .unwrap();
        assert_eq!(
            coarse[1].begin << 1,
            500,
            "four times the error: four times as near"
        );
    }

    #[test]
    fn far_away_the_finest_level_is_coarse() {
        let spans = params(LodRule::Error(1.0)).spans(100, |_| 9.0).unwrap();
        assert_eq!(spans.len(), 1, "one level");
        assert_eq!(spans[0].lod, Lod(3), "voxels of 8 mm under pixels of 9");
        assert!(
            params(LodRule::Fixed(Lod(6))).spans(100, |_| 1.0).is_err(),
            "there are levels 0 to 5"
        );
    }
}
