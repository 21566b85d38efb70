//! A picture's geometry on the device: what the passes read that cut rays to parts.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use wgpu::util::DeviceExt;

use super::targets::PartsShape;
use crate::camera::Projection;
use crate::clip::{Geometry, Side, TriangleMesh};
use crate::geom::Aabb;
use crate::gpu::layout::{
    GeometryUniforms, MESH_DRAWN, MESH_INSIDE, MESH_OUTSIDE, MeshRecord, PARTS_CLIP_MESHES,
    PARTS_PLANES, PARTS_TRIANGLES, PARTS_WORDS,
};
use crate::gpu::{GpuContext, GpuError};
use crate::render::frame::{DepthRange, Tile, clip_from_world, clip_from_world_of_cube, padded};
use crate::scene::RayFrame;

/// A picture's geometry on the device.
#[derive(Debug)]
pub(super) struct GeometryBuffers {
    pub(super) of: Arc<Geometry>,
    /// What positions count from, world mm: f32 is precise around it.
    origin: DVec3,
    pub(super) uniforms: wgpu::Buffer,
    pub(super) half_spaces: wgpu::Buffer,
    pub(super) meshes: wgpu::Buffer,
    pub(super) planes: wgpu::Buffer,
    pub(super) corners: wgpu::Buffer,
    pub(super) vertices: wgpu::Buffer,
    pub(super) triangles: u32,
    /// Triangles of the meshes that cut: the others are drawn.
    first_drawn: u32,
}

/// A corner of a triangle, for the raster.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Vertex {
    position: [f32; 3],
    mesh: u32,
}

impl GeometryBuffers {
    pub(super) fn new(gpu: &GpuContext, of: &Arc<Geometry>) -> Result<Self, GpuError> {
        let cuts = of.clip_meshes.iter().map(|c| &c.mesh);
        let drawn = of.surfaces.iter().map(|s| &s.mesh);
        let meshes: Vec<&Arc<TriangleMesh>> = cuts.chain(drawn).collect();
        let bounds = meshes.iter().map(|m| m.bounds());
        let bounds = bounds.reduce(|a, b| Aabb::new(a.min.min(b.min), a.max.max(b.max)));
        let origin = match (bounds, of.planes.first()) {
            (Some(bounds), _) => (bounds.min + bounds.max) * 0.5,
            (None, Some(plane)) => plane.normal() * -plane.offset(),
            (None, None) => DVec3::ZERO,
        };
        let local = |p: DVec3| (p - origin).as_vec3();
        let half_spaces: Vec<[f32; 4]> = of
            .planes
            .iter()
            .map(|p| p.normal().extend(p.distance(origin)).as_vec4().to_array())
            .collect();
        let record = |color: Vec3, opacity: f32, kind| MeshRecord {
            color: color.extend(opacity).to_array(),
            kind,
            ..MeshRecord::default()
        };
        let cut_records = of.clip_meshes.iter().map(|c| {
            let kind = match c.side {
                Side::Inside => MESH_INSIDE,
                Side::Outside => MESH_OUTSIDE,
            };
            record(Vec3::ZERO, 0.0, kind)
        });
        let drawn_records = of
            .surfaces
            .iter()
            .map(|s| record(s.color, s.opacity, MESH_DRAWN));
        let records: Vec<MeshRecord> = cut_records.chain(drawn_records).collect();
        let (mut planes, mut corners, mut vertices) = (Vec::new(), Vec::new(), Vec::new());
        let mut first_drawn = 0;
        for (number, mesh) in meshes.iter().enumerate() {
            for triangle in 0..mesh.triangle_count() as u32 {
                let at = mesh.corners(triangle);
                let normal = mesh.face_normal(triangle);
                let offset = -normal.dot(at[0] - origin);
                planes.push(normal.extend(offset).as_vec4().to_array());
                vertices.extend(at.map(|p| Vertex {
                    position: local(p).to_array(),
                    mesh: number as u32,
                }));
                if number >= of.clip_meshes.len() {
                    corners.extend(at.map(|p| padded(local(p))));
                    corners.extend(mesh.corner_normals()[triangle as usize].map(padded));
                } else {
                    first_drawn += 1;
                }
            }
        }
        let of_storage = (corners.len() as u64).max(planes.len() as u64) * 16;
        let of_vertices = (vertices.len() * size_of::<Vertex>()) as u64;
        let limits = &gpu.caps.limits;
        for (needed, limit, limited_by) in [
            (
                of_storage,
                limits.max_storage_buffer_binding_size,
                "the adapter's largest storage buffer",
            ),
            (
                of_vertices,
                limits.max_buffer_size,
                "the adapter's largest buffer",
            ),
        ] {
            if needed > limit {
                return Err(GpuError::TooSmall {
                    what: format!("the {} triangles of the meshes", planes.len()),
                    needed,
                    limit,
                    limited_by: limited_by.into(),
                    remedy: "give meshes of fewer triangles".into(),
                });
            }
        }
        gpu.checked("uploading the geometry", || {
            let buffer = |label, contents: &[u8], usage| {
                // Bindings have at least one element.
                let padded_contents = if contents.is_empty() {
                    &[0; 32]
                } else {
                    contents
                };
                gpu.device
                    .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                        label: Some(label),
                        contents: padded_contents,
                        usage,
                    })
            };
            let storage = wgpu::BufferUsages::STORAGE;
            Ok(Self {
                of: Arc::clone(of),
                origin,
                uniforms: buffer(
                    "parts.geometry",
                    bytemuck::bytes_of(&GeometryUniforms::default()),
                    wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                ),
                half_spaces: buffer(
                    "parts.half_spaces",
                    bytemuck::cast_slice(&half_spaces),
                    storage,
                ),
                meshes: buffer("parts.meshes", bytemuck::cast_slice(&records), storage),
                planes: buffer("parts.planes", bytemuck::cast_slice(&planes), storage),
                corners: buffer("parts.corners", bytemuck::cast_slice(&corners), storage),
                vertices: buffer(
                    "parts.vertices",
                    bytemuck::cast_slice(&vertices),
                    wgpu::BufferUsages::VERTEX,
                ),
                triangles: planes.len() as u32,
                first_drawn,
            })
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        let buffers = [
            &self.uniforms,
            &self.half_spaces,
            &self.meshes,
            &self.planes,
            &self.corners,
            &self.vertices,
        ];
        buffers.into_iter().map(wgpu::Buffer::size).sum()
    }

    /// How far the last corner of the meshes lies along the viewing direction, and a little.
    fn far_mm(&self, rays: &RayFrame) -> f64 {
        let view = rays.world_from_view;
        let clips = self.of.clip_meshes.iter().map(|c| &c.mesh);
        let meshes = clips.chain(self.of.surfaces.iter().map(|s| &s.mesh));
        let corners = meshes.flat_map(|mesh| mesh.bounds().corners());
        let depths = corners.map(|corner| -(corner - view.translation).dot(view.matrix3.z_axis));
        let far = depths.fold(f64::NEG_INFINITY, f64::max);
        far + far.abs() * 1e-3
    }

    /// What the host orders, and nothing counted yet (`PARTS_*`).
    pub(super) fn words(&self) -> [u32; PARTS_WORDS as usize] {
        let mut words = [0; PARTS_WORDS as usize];
        words[PARTS_PLANES as usize] = self.of.planes.len() as u32;
        words[PARTS_CLIP_MESHES as usize] = self.of.clip_meshes.len() as u32;
        words[PARTS_TRIANGLES as usize] = self.triangles;
        words
    }

    pub(super) fn uniforms(
        &self,
        rays: &RayFrame,
        tile: &Tile,
        shape: &PartsShape,
    ) -> GeometryUniforms {
        let view = rays.world_from_view;
        let eye = view.translation - self.origin;
        let across = view.matrix3.x_axis * rays.half_extent[0];
        let upward = view.matrix3.y_axis * rays.half_extent[1];
        let origin = match rays.projection {
            Projection::Orthographic => [eye, across, upward],
            _ => [eye, DVec3::ZERO, DVec3::ZERO],
        };
        let world_from_mesh = DAffine3::from_translation(self.origin);
        let depth = DepthRange::reaching(rays, self.far_mm(rays));
        let clip_from_world = if rays.projection.is_panoramic() {
            clip_from_world_of_cube(rays)
        } else {
            [clip_from_world(rays, depth, *tile, 0); 6]
        };
        GeometryUniforms {
            origin: origin.map(|v| padded(v.as_vec3())),
            clip_from_mesh: clip_from_world
                .map(|clip| (clip * world_from_mesh).as_mat4().to_cols_array_2d()),
            cube_edge: shape.cube_edge,
            depth_scale: depth.scale as f32,
            depth_bias: depth.bias as f32,
            pad0: 0,
            pad1: 0,
            first_drawn: self.first_drawn,
            most_crossings: shape.crossings as u32,
            most_records: shape.records as u32,
        }
    }

    /// Bytes of a geometry on the device, about.
    pub(super) fn bytes_of(geometry: &Geometry) -> u64 {
        let cut: usize = geometry
            .clip_meshes
            .iter()
            .map(|c| c.mesh.triangle_count())
            .sum();
        let drawn: usize = geometry
            .surfaces
            .iter()
            .map(|s| s.mesh.triangle_count())
            .sum();
        (cut + drawn) as u64 * (16 + 3 * size_of::<Vertex>() as u64) + drawn as u64 * 96
    }
}
