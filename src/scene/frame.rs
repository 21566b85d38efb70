//! The sample grid of a frame: where sample i of each ray lies.
//!
//! Invariant 1 (design.md §2): sample i lies at `t = t₀ + i·ds` from the eye (orthographic: from the eye plane), `t₀`
//! the last multiple of `ds` before the volume's bounding sphere, the same for all rays. A position is an integer voxel
//! anchor of the frame plus an f32 offset, computed from i by one multiply-add per axis.

use glam::{DAffine3, DMat3, DVec3, IVec3, Mat3, U64Vec3, Vec3};

use super::SceneError;
use crate::camera::{BoundingSphere, Camera, Projection};
use crate::geom::Aabb;

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

/// The sample grid of one frame at one level. A pixel (px, py) has the image-plane coordinates
/// `u = (px + ½)·2/width − 1` and `v = 1 − (py + ½)·2/height`; a quantity of its ray is `q + u·q_u + v·q_v`.
#[derive(Clone, Debug, PartialEq)]
pub struct RayFrame {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Unnormalised ray direction in world: centre, per u, per v.
    pub world_dir: [Vec3; 3],
    /// The same direction in level voxels: `level_from_world` · `world_dir`.
    pub level_dir: [Vec3; 3],
    /// Ray origin in level voxels, from the anchor: centre, per u, per v.
    pub level_origin: [Vec3; 3],
    /// The integer voxel of the level that offsets count from: the one nearest to the eye.
    pub anchor: IVec3,
    /// The rendered box in level voxels, from the anchor.
    pub box_min: Vec3,
    /// Its greatest corner.
    pub box_max: Vec3,
    /// Distance of samples, mm.
    pub step_mm: f32,
    /// Distance of sample 0 from the eye, mm: t₀.
    pub first_mm: f32,
    /// Distance of the near plane from the eye along the view direction, mm.
    pub near_mm: f32,
    /// Index of the last sample before the bounding sphere's far end.
    pub last_index: u32,
    /// World normal from a level-voxel gradient: the inverse transpose of the affine, columns.
    pub normal_from_gradient: Mat3,
    /// World millimetres from continuous level voxel coordinates.
    pub world_from_level: DAffine3,
    /// World from view (x right, y up, z towards the viewer), for the mesh raster.
    pub world_from_view: DAffine3,
    /// Half width and half height of the image plane: tangents (perspective) or mm (orthographic).
    pub half_extent: [f64; 2],
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Distance of samples, mm, exact.
    pub step_mm_exact: f64,
    /// Distance of sample 0, mm, exact.
    pub first_mm_exact: f64,
}

/// What a frame's grid is made of.
#[derive(Clone, Copy, Debug)]
pub struct GridParams {
    /// Voxels of level 0.
    pub dims: U64Vec3,
    /// Level-0 voxels per voxel of the level drawn.
    pub level_scale: DVec3,
    /// Number of the level drawn: samples are 2^lod steps apart.
    pub lod: u8,
    /// World from voxel index of level 0.
    pub world_from_index: DAffine3,
    /// Distance of samples in units of the smallest spacing of level 0.
    pub step: f64,
}

impl RayFrame {
    /// The grid of `camera` for a picture of `size` pixels.
    ///
    /// # Errors
    /// The camera is degenerate, or rays would have more than 2³⁰ samples.
    pub fn new(camera: &Camera, size: [u32; 2], params: &GridParams) -> Result<Self, SceneError> {
        let view = camera.view(f64::from(size[0]) / f64::from(size[1]))?;
        let basis = view.basis;
        let world_from_level =
            world_from_voxel(&params.world_from_index) * DAffine3::from_scale(params.level_scale);
        let level_from_world = world_from_level.inverse();
        let columns = params.world_from_index.matrix3;
        let min_spacing = [columns.x_axis, columns.y_axis, columns.z_axis]
            .into_iter()
            .map(DVec3::length)
            .fold(f64::MAX, f64::min);
        let step_mm = params.step * min_spacing * f64::from(1_u32 << params.lod.min(31));

        let bounds = volume_bounds(params.dims, &params.world_from_index);
        let to_center = bounds.center - camera.eye;
        let center_mm = match camera.projection {
            Projection::Perspective => to_center.length(),
            Projection::Orthographic => to_center.dot(basis.forward),
        };
        let first_index = ((center_mm - bounds.radius) / step_mm).floor().max(0.0);
        let first_mm = first_index * step_mm;
        let last_index = ((center_mm + bounds.radius) / step_mm).ceil() - first_index;
        if last_index.is_nan() || last_index.abs() >= f64::from(1_u32 << 30) {
            return Err(SceneError::TooManySamples {
                samples: last_index,
                step_mm,
            });
        }

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
        };

        let eye_level = level_from_world.transform_point3(camera.eye);
        let box0 = rendered_box(params.dims);
        let box_level = Aabb::new(box0.min / params.level_scale, box0.max / params.level_scale);
        let anchor = eye_level.clamp(box_level.min, box_level.max).floor();
        let linear = level_from_world.matrix3;
        Ok(Self {
            size,
            world_dir: world_dir.map(|d| d.as_vec3()),
            level_dir: world_dir.map(|d| (linear * d).as_vec3()),
            level_origin: [
                (eye_level - anchor).as_vec3(),
                (linear * world_origin[1]).as_vec3(),
                (linear * world_origin[2]).as_vec3(),
            ],
            anchor: anchor.as_ivec3(),
            box_min: (box_level.min - anchor).as_vec3(),
            box_max: (box_level.max - anchor).as_vec3(),
            step_mm: step_mm as f32,
            first_mm: first_mm as f32,
            near_mm: camera.near_mm as f32,
            last_index: last_index.max(0.0) as u32,
            normal_from_gradient: linear.transpose().as_mat3(),
            world_from_level,
            world_from_view: DAffine3::from_mat3_translation(
                DMat3::from_cols(basis.right, basis.up, -basis.forward),
                camera.eye,
            ),
            half_extent,
            projection: camera.projection,
            step_mm_exact: step_mm,
            first_mm_exact: first_mm,
        })
    }

    /// Pixels that a 4³ block's edge covers at most, at the point of the volume nearest to the eye (infinite when the eye
    /// is inside or close).
    pub fn block_pixels(&self) -> f64 {
        let m = self.world_from_level.matrix3 * f64::from(crate::geom::BLOCK_EDGE);
        let edge_mm = [m.x_axis, m.y_axis, m.z_axis]
            .into_iter()
            .map(DVec3::length)
            .fold(0.0, f64::max);
        let pixel_mm = self.half_extent[1] * 2.0 / f64::from(self.size[1])
            * match self.projection {
                Projection::Perspective => self.first_mm_exact,
                Projection::Orthographic => 1.0,
            };
        edge_mm / pixel_mm
    }
}
