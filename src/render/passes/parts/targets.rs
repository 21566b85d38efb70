//! What a tile's rays cross of the meshes, and the parts that they are cut to, on the device.

use crate::clip::Geometry;
use crate::gpu::GpuContext;
use crate::gpu::layout::{Crossing, PART_RECORDS_WIDE, PARTS_WORDS};
use crate::scene::RayFrame;

/// Bytes of a texel of a record.
const TEXEL_BYTES: u64 = 16;
/// What there is room for at first, per pixel; what a picture takes more is made room for.
const CROSSINGS_AT_FIRST: u64 = 2;
/// Most pixels along an edge of the cube.
const MOST_CUBE_EDGE: u32 = 1024;

/// How large they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PartsShape {
    /// Pixels of a tile.
    pub(super) tile: [u32; 2],
    /// Panoramas with meshes: pixels along an edge of the cube around the eye; else 0.
    pub(super) cube_edge: u32,
    /// Of a record (`shaders/lib/part.wgsl`).
    texels: u64,
    /// For how many crossings there is room.
    pub(super) crossings: u64,
    /// For how many records there is room.
    pub(super) records: u64,
}

impl PartsShape {
    /// That of a picture, before anything is counted.
    pub(super) fn first(geometry: &Geometry, rays: &RayFrame, tile: [u32; 2]) -> Self {
        let cube_edge = if geometry.has_meshes() && rays.projection.is_panoramic() {
            // Twice as fine as the picture in its middle, where a face has two units of its width for each radian.
            let pixels_per_radian = f64::from(rays.size[1]) / (2.0 * rays.half_extent[1]);
            ((4.0 * pixels_per_radian).ceil() as u32)
                .next_multiple_of(64)
                .clamp(64, MOST_CUBE_EDGE)
        } else {
            0
        };
        Self::first_of(geometry, tile, cube_edge)
    }

    fn first_of(geometry: &Geometry, tile: [u32; 2], cube_edge: u32) -> Self {
        let mut shape = Self {
            tile,
            cube_edge,
            texels: if geometry.faces.matter() { 2 } else { 1 },
            crossings: 0,
            records: 0,
        };
        if geometry.has_meshes() {
            shape.crossings = shape.pixels() * CROSSINGS_AT_FIRST;
        }
        shape.with_room(shape.crossings, 0)
    }

    /// With room for so many crossings, and at least so many records.
    pub(super) fn with_room(self, crossings: u64, records: u64) -> Self {
        // A crossing makes two records at most (but where several rays look at one list).
        let records = records.max(self.pixels() + 2 * crossings);
        Self {
            crossings,
            records: records.next_multiple_of(u64::from(PART_RECORDS_WIDE)),
            ..self
        }
    }

    /// Bytes for each pixel of a tile, before anything is counted.
    pub(super) fn bytes_per_pixel(geometry: &Geometry) -> u64 {
        let tile = [64; 2];
        let shape = Self::first_of(geometry, tile, 0);
        shape.bytes().div_ceil(shape.pixels())
    }

    pub(super) fn pixels(&self) -> u64 {
        u64::from(self.tile[0]) * u64::from(self.tile[1])
    }

    /// Is it one of the same picture?
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let of = |s: &Self| (s.tile, s.cube_edge, s.texels, s.crossings > 0);
        of(self) == of(other)
    }

    /// Lists of crossings: one per pixel.
    pub(super) fn lists(&self) -> u64 {
        match u64::from(self.cube_edge) {
            0 => self.pixels(),
            edge => 6 * edge * edge,
        }
    }

    /// Width and height of the raster.
    pub(super) fn raster_size(&self) -> [u32; 2] {
        match self.cube_edge {
            0 => self.tile,
            edge => [edge, edge],
        }
    }

    /// Draws of the meshes: the tile, or the faces of the cube.
    pub(super) fn draws(&self) -> u32 {
        if self.cube_edge == 0 { 1 } else { 6 }
    }

    /// Rows of records that a texture would have.
    pub(super) fn rows(&self) -> u64 {
        self.records * self.texels / u64::from(PART_RECORDS_WIDE)
    }

    /// Of the largest buffer.
    pub(super) fn crossing_bytes(&self) -> u64 {
        self.crossings * size_of::<Crossing>() as u64
    }

    /// On the device.
    pub(super) fn bytes(&self) -> u64 {
        let [width, height] = self.raster_size().map(u64::from);
        width * height
            + self.lists() * 4
            + self.pixels() * 8
            + self.crossing_bytes()
            + self.records * self.texels * TEXEL_BYTES
    }
}

/// What a tile's rays cross, and the parts that they are cut to.
#[derive(Debug)]
pub(super) struct PartsTargets {
    pub(super) shape: PartsShape,
    /// A raster needs a target; nothing is written.
    pub(super) color: wgpu::TextureView,
    pub(super) heads: wgpu::Buffer,
    pub(super) crossings: wgpu::Buffer,
    pub(super) words: wgpu::Buffer,
    pub(super) lists: wgpu::TextureView,
    pub(super) records: wgpu::TextureView,
    /// Group 3 of the caster.
    pub(super) group: wgpu::BindGroup,
}

impl PartsTargets {
    pub(super) fn new(gpu: &GpuContext, layout: &wgpu::BindGroupLayout, shape: PartsShape) -> Self {
        let texture = |label, [width, height]: [u32; 2], format, usage| {
            gpu.device
                .create_texture(&wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d {
                        width,
                        height,
                        depth_or_array_layers: 1,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage,
                    view_formats: &[],
                })
                .create_view(&wgpu::TextureViewDescriptor::default())
        };
        let buffer = |label, size| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let written = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING;
        let lists = texture(
            "parts.lists",
            shape.tile,
            wgpu::TextureFormat::Rg32Uint,
            written,
        );
        let rows = shape.rows() as u32;
        let records_view = texture(
            "parts.records",
            [PART_RECORDS_WIDE, rows],
            wgpu::TextureFormat::Rgba32Uint,
            written,
        );
        Self {
            color: texture(
                "parts.nothing",
                shape.raster_size(),
                wgpu::TextureFormat::R8Unorm,
                wgpu::TextureUsages::RENDER_ATTACHMENT,
            ),
            heads: buffer("parts.heads", shape.lists() * 4),
            crossings: buffer(
                "parts.crossings",
                shape.crossing_bytes().max(size_of::<Crossing>() as u64),
            ),
            words: buffer("parts.words", u64::from(PARTS_WORDS) * 4),
            group: cast_group(gpu, layout, &lists, &records_view),
            lists,
            records: records_view,
            shape,
        }
    }
}

/// Lists and records as a group of two.
pub(super) fn cast_group(
    gpu: &GpuContext,
    layout: &wgpu::BindGroupLayout,
    lists: &wgpu::TextureView,
    records: &wgpu::TextureView,
) -> wgpu::BindGroup {
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("parts.group"),
        layout,
        entries: &[
            wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(lists),
            },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(records),
            },
        ],
    })
}
