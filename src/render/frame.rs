//! Bind group 0: one frame, or one tile of it.

use glam::{DAffine3, DMat4, DVec3, DVec4, Vec3};

use crate::camera::Projection;
use crate::geom::BLOCK_EDGE;
use crate::gpu::GpuContext;
use crate::gpu::layout::{FLAG_SKIP, FrameUniforms};
use crate::scene::{Classified, PictureSettings, RayFrame};

use super::bindings;
use super::residency::Residency;

/// Margin of the depth buffers around a tile, pixels: the caster looks at 3×3.
pub(super) const BOUNDS_MARGIN: u32 = 1;

/// What a frame is drawn from.
#[derive(Clone, Copy, Debug)]
pub struct FrameInputs<'a> {
    /// The sample grid.
    pub rays: &'a RayFrame,
    /// Table and iso-value.
    pub classified: &'a Classified,
    /// The switches.
    pub settings: &'a PictureSettings,
    /// The volume's least stored value.
    pub value_floor: f32,
    /// Mesh interval, brick and block skipping? Without, every brick of the level must be resident.
    pub skip: bool,
}

/// A tile of the picture, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    pub(super) origin: [u32; 2],
    pub(super) size: [u32; 2],
}

/// The uniform buffer, the table, and their bind group.
#[derive(Debug)]
pub(super) struct FrameBindings {
    uniforms: wgpu::Buffer,
    lut: wgpu::Buffer,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) group: wgpu::BindGroup,
}

impl FrameBindings {
    pub(super) fn new(gpu: &GpuContext, lut_entries: usize) -> Self {
        let device = &gpu.device;
        let buffer = |label, size: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let uniforms = buffer(
            "frame.uniforms",
            size_of::<FrameUniforms>(),
            wgpu::BufferUsages::UNIFORM,
        );
        let lut = buffer("frame.lut", lut_entries * 16, wgpu::BufferUsages::STORAGE);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame.layout"),
            entries: bindings::FRAME,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame.group"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: uniforms.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: lut.as_entire_binding(),
                },
            ],
        });
        Self {
            uniforms,
            lut,
            layout,
            group,
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        self.uniforms.size() + self.lut.size()
    }

    pub(super) fn write_lut(&self, gpu: &GpuContext, classified: &Classified) {
        gpu.queue
            .write_buffer(&self.lut, 0, bytemuck::cast_slice(classified.lut.entries()));
    }

    pub(super) fn write(
        &self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &Residency,
        tile: Tile,
        groups: u32,
    ) {
        let stride = if gpu.caps.is_software {
            spreading_stride(groups)
        } else {
            1
        };
        gpu.queue.write_buffer(
            &self.uniforms,
            0,
            bytemuck::bytes_of(&uniforms(inputs, volume, tile, stride)),
        );
    }
}

/// A stride through `count` work-groups that meets each once and spreads neighbours far apart: near the golden section of
/// `count`, and coprime with it. At most 2¹⁴ groups make a tile, so that number times stride fits 32 bits.
fn spreading_stride(count: u32) -> u32 {
    let coprime = |a: u32| {
        let (mut a, mut b) = (a, count);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a == 1
    };
    let golden = (f64::from(count) * 0.618) as u32;
    (golden.max(1)..count).find(|&s| coprime(s)).unwrap_or(1)
}

fn uniforms(
    inputs: &FrameInputs<'_>,
    volume: &Residency,
    tile: Tile,
    group_stride: u32,
) -> FrameUniforms {
    let FrameInputs {
        rays,
        classified,
        settings,
        value_floor,
        skip,
    } = *inputs;
    let depth = DepthRange::new(rays);
    let [lut_lo, lut_scale] = classified.lut.index_lo_scale();
    let shading = &settings.shading;
    let light = shading.light.map(|d| (-d).normalize_or_zero().as_vec3());
    let iso_color = settings.classification.iso.map_or(Vec3::ONE, |s| s.color);
    FrameUniforms {
        world_dir: rays.world_dir.map(padded),
        level_dir: rays.level_dir.map(padded),
        level_origin: rays.level_origin.map(padded),
        box_min: padded(rays.box_min),
        box_max: padded(rays.box_max),
        normal_from_gradient: rays
            .normal_from_gradient
            .to_cols_array_2d()
            .map(|c| padded(Vec3::from_array(c))),
        to_light: light.map_or([0.0, 0.0, 0.0, 1.0], padded),
        material: [
            shading.ambient,
            shading.diffuse,
            shading.specular,
            shading.shininess,
        ],
        iso_color: padded(iso_color),
        clip_from_offset: clip_from_offset(rays, depth, tile)
            .as_mat4()
            .to_cols_array_2d(),
        anchor: rays.anchor.extend(0).to_array(),
        level_bricks: volume.level_bricks().extend(0).to_array(),
        indirection_origin: volume.indirection_origin().extend(0).to_array(),
        atlas_slots: volume.shape().slots().extend(0).to_array(),
        texture_from_atlas: padded(1.0 / volume.shape().texels.as_vec3()),
        picture_size: rays.size,
        tile_origin: tile.origin,
        tile_size: tile.size,
        last_index: rays.last_index,
        flags: if skip { FLAG_SKIP } else { 0 },
        step_mm: rays.step_mm,
        first_mm: rays.first_mm,
        near_mm: rays.near_mm,
        opacity_cutoff: settings.opacity_cutoff,
        depth_scale: depth.scale as f32,
        depth_bias: depth.bias as f32,
        slack: (block_diagonal_mm(rays) / rays.step_mm_exact) as f32,
        iso: classified.iso_stored,
        lut_lo,
        lut_scale,
        lut_last: (classified.lut.entries().len() - 1) as f32,
        value_scale: volume.value_scale(),
        value_floor,
        group_stride,
        pad1: 0.0,
        pad2: 0.0,
    }
}

fn padded(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

/// The longest diagonal of a 4³ block, mm.
pub(super) fn block_diagonal_mm(rays: &RayFrame) -> f64 {
    let m = rays.world_from_level.matrix3 * f64::from(BLOCK_EDGE);
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .into_iter()
        .map(|(a, b)| (m.x_axis + m.y_axis * a + m.z_axis * b).length())
        .fold(0.0, f64::max)
}

/// Reversed depth: view depth = scale / d (perspective, no far plane) or bias − scale · d (orthographic).
#[derive(Clone, Copy, Debug)]
struct DepthRange {
    scale: f64,
    bias: f64,
}

impl DepthRange {
    fn new(rays: &RayFrame) -> Self {
        let near = f64::from(rays.near_mm);
        match rays.projection {
            // Reversed f32 depth is equally precise at any near plane above 0; far below a voxel will do.
            Projection::Perspective => Self {
                scale: near.max(rays.step_mm_exact * 1e-3),
                bias: 0.0,
            },
            Projection::Orthographic => {
                let far = rays.first_mm_exact
                    + f64::from(rays.last_index + 1) * rays.step_mm_exact
                    + block_diagonal_mm(rays);
                Self {
                    scale: far - near,
                    bias: far,
                }
            }
        }
    }
}

/// Clip space (cropped to the tile and its margin) from a level-voxel offset from the anchor.
fn clip_from_offset(rays: &RayFrame, depth: DepthRange, tile: Tile) -> DMat4 {
    let anchor = rays.anchor.as_dvec3();
    let world_from_offset = rays.world_from_level * DAffine3::from_translation(anchor);
    let view_from_offset = DMat4::from(rays.world_from_view.inverse() * world_from_offset);
    let [half_width, half_height] = rays.half_extent;
    // View space looks along −z.
    let clip_from_view = match rays.projection {
        Projection::Perspective => DMat4::from_cols(
            DVec4::new(1.0 / half_width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 1.0 / half_height, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, -1.0),
            DVec4::new(0.0, 0.0, depth.scale, 0.0),
        ),
        Projection::Orthographic => DMat4::from_cols(
            DVec4::new(1.0 / half_width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 1.0 / half_height, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 1.0 / depth.scale, 0.0),
            DVec4::new(0.0, 0.0, depth.bias / depth.scale, 1.0),
        ),
    };
    let [width, height] = rays.size.map(f64::from);
    let margin = f64::from(BOUNDS_MARGIN);
    let [x0, y0] = tile.origin.map(|o| f64::from(o) - margin);
    let [w, h] = tile.size.map(|s| f64::from(s) + 2.0 * margin);
    let crop = DMat4::from_translation(DVec3::new(
        (width - 2.0 * x0) / w - 1.0,
        1.0 - (height - 2.0 * y0) / h,
        0.0,
    )) * DMat4::from_scale(DVec3::new(width / w, height / h, 1.0));
    crop * clip_from_view * view_from_offset
}

#[cfg(test)]
mod tests {
    use super::spreading_stride;

    #[test]
    fn every_group_is_met_once() {
        for count in [1, 2, 3, 7, 8, 64, 1000, 4096, 128 * 96, 1 << 14] {
            let stride = spreading_stride(count);
            let met: std::collections::BTreeSet<u32> =
                (0..count).map(|w| w * stride % count).collect();
            assert_eq!(
                met.len() as u32,
                count,
                "{count} groups with stride {stride}"
            );
        }
    }
}
