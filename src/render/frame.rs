//! Bind group 0: one frame, or one dispatch of it.

use std::sync::Arc;

use glam::{DAffine3, DMat4, DVec3, DVec4, Vec3};

use crate::camera::Projection;
use crate::classify::{LUT_ENTRIES, PreintegratedTable};
use crate::geom::BLOCK_EDGE;
use crate::gpu::layout::{FrameUniforms, LevelUniforms, MAX_LEVELS, MAX_SURFACES, MAX_SURFACES_4};
use crate::gpu::{GpuContext, GpuError};
use crate::scene::{Classified, LevelFrame, Mode, PictureSettings, RayFrame, SlabShape};

use super::bindings;
use super::residency::Residency;

/// Margin of the depth buffers around a tile, pixels: the caster looks at 3×3.
pub(super) const BOUNDS_MARGIN: u32 = 1;

/// What a frame is drawn from.
#[derive(Clone, Copy, Debug)]
pub struct FrameInputs<'a> {
    /// The sample grid.
    pub rays: &'a RayFrame,
    /// Tables and iso-value.
    pub classified: &'a Classified,
    /// The switches.
    pub settings: &'a PictureSettings,
    /// Mesh interval, brick and block skipping? Without, every sample of every ray is taken.
    pub skip: bool,
    /// The slabs in which the rays of a tile advance; `None` where each walks by itself. Drafts and listed pixels do so anyway.
    pub slab: Option<SlabShape>,
}

/// A tile of the picture, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Its first pixel.
    pub origin: [u32; 2],
    /// Width and height: of the buffers, which a tile at the picture's edge need not fill.
    pub size: [u32; 2],
    /// The part of it that lies inside the picture.
    pub part_size: [u32; 2],
}

/// What changes from dispatch to dispatch.
#[derive(Clone, Copy, Debug)]
pub(super) struct DispatchParams {
    pub(super) tile: Tile,
    /// Counts dispatches, from 1.
    pub(super) dispatch: u32,
}

/// Bytes of one level's table.
const LUT_BYTES: u64 = LUT_ENTRIES as u64 * 16;

/// The uniform buffer, the tables of all levels, and their bind group.
#[derive(Debug)]
pub(super) struct FrameBindings {
    uniforms: wgpu::Buffer,
    lut: wgpu::Texture,
    /// A layer per level; one texel while nothing is pre-integrated.
    preintegrated: wgpu::Texture,
    /// What its layers hold.
    integrals: Vec<Arc<PreintegratedTable>>,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) group: wgpu::BindGroup,
}

impl FrameBindings {
    /// Bindings for frames of at most `levels` levels.
    pub(super) fn new(gpu: &GpuContext, levels: usize) -> Self {
        let device = &gpu.device;
        let uniforms = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame.uniforms"),
            size: size_of::<FrameUniforms>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let lut = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("frame.lut"),
            size: wgpu::Extent3d {
                width: LUT_ENTRIES as u32,
                height: levels as u32,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let preintegrated = integrals_texture(gpu, [1, 1]);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame.layout"),
            entries: bindings::FRAME,
        });
        let group = group(gpu, &layout, &uniforms, &lut, &preintegrated);
        Self {
            uniforms,
            lut,
            preintegrated,
            integrals: Vec::new(),
            layout,
            group,
        }
    }

    /// Bytes of the bindings for `levels` levels.
    pub(super) fn bytes_for(levels: usize) -> u64 {
        size_of::<FrameUniforms>() as u64 + levels as u64 * LUT_BYTES
    }

    /// Bytes of the tables of integrals that are there now.
    pub(super) fn integrals_bytes(&self) -> u64 {
        let size = self.preintegrated.size();
        u64::from(size.width) * u64::from(size.height) * u64::from(size.depth_or_array_layers) * 16
    }

    /// Bytes of the tables of integrals that `classified` needs.
    pub(super) fn integrals_bytes_for(classified: &Classified) -> u64 {
        let [side, layers] = integrals_shape(classified).map(u64::from);
        side * side * layers * 16
    }

    /// Sends the tables.
    ///
    /// # Errors
    /// The device has not the memory.
    pub(super) fn write_tables(
        &mut self,
        gpu: &GpuContext,
        classified: &Classified,
    ) -> Result<(), GpuError> {
        let [side, layers] = integrals_shape(classified);
        let size = self.preintegrated.size();
        if [size.width, size.depth_or_array_layers] != [side, layers] {
            self.preintegrated = gpu.checked("allocating the tables of integrals", || {
                Ok(integrals_texture(gpu, [side, layers]))
            })?;
            self.group = group(
                gpu,
                &self.layout,
                &self.uniforms,
                &self.lut,
                &self.preintegrated,
            );
            self.integrals.clear();
        }
        let integrals = classified
            .levels
            .iter()
            .filter_map(|l| l.preintegrated.as_ref());
        for (layer, table) in (0..).zip(integrals) {
            // 16 MiB for 16-bit volumes: not for every frame.
            let there = self.integrals.get(layer as usize);
            if there.is_some_and(|there| Arc::ptr_eq(there, table)) {
                continue;
            }
            self.integrals.truncate(layer as usize);
            self.integrals.push(Arc::clone(table));
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &self.preintegrated,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: 0,
                        z: layer,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                bytemuck::cast_slice(table.entries()),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(side * 16),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width: side,
                    height: side,
                    depth_or_array_layers: 1,
                },
            );
        }
        for (row, level) in (0..).zip(&classified.levels) {
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &self.lut,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y: row, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                bytemuck::cast_slice(level.lut.entries()),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(LUT_BYTES as u32),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width: LUT_ENTRIES as u32,
                    height: 1,
                    depth_or_array_layers: 1,
                },
            );
        }
        Ok(())
    }

    pub(super) fn write(
        &self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &Residency,
        params: &DispatchParams,
    ) {
        self.write_uniforms(gpu, &uniforms(inputs, volume, params));
    }

    pub(super) fn write_uniforms(&self, gpu: &GpuContext, uniforms: &FrameUniforms) {
        gpu.queue
            .write_buffer(&self.uniforms, 0, bytemuck::bytes_of(uniforms));
    }
}

/// Side and number of the tables of integrals; one texel where there are none.
fn integrals_shape(classified: &Classified) -> [u32; 2] {
    let table = classified
        .levels
        .first()
        .and_then(|l| l.preintegrated.as_ref());
    table.map_or([1, 1], |t| {
        [t.side() as u32, classified.levels.len() as u32]
    })
}

fn integrals_texture(gpu: &GpuContext, [side, layers]: [u32; 2]) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("frame.preintegrated"),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: layers,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn group(
    gpu: &GpuContext,
    layout: &wgpu::BindGroupLayout,
    uniforms: &wgpu::Buffer,
    lut: &wgpu::Texture,
    preintegrated: &wgpu::Texture,
) -> wgpu::BindGroup {
    let lut = lut.create_view(&wgpu::TextureViewDescriptor::default());
    let preintegrated = preintegrated.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("frame.group"),
        layout,
        entries: &[
            wgpu::BindGroupEntry {
                binding: 0,
                resource: uniforms.as_entire_binding(),
            },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(&lut),
            },
            wgpu::BindGroupEntry {
                binding: 2,
                resource: wgpu::BindingResource::TextureView(&preintegrated),
            },
        ],
    })
}

fn uniforms(
    inputs: &FrameInputs<'_>,
    volume: &Residency,
    params: &DispatchParams,
) -> FrameUniforms {
    let rays = inputs.rays;
    let tile = params.tile;
    let places = volume.feedback_places();
    let mut of_rays = ray_uniforms(inputs);
    for (level, uniforms) in rays.levels.iter().zip(&mut of_rays.levels) {
        uniforms.bricks = volume
            .level_bricks(level.lod)
            .extend(volume.first_brick(level.lod))
            .to_array();
        uniforms.indirection_origin = volume.indirection_origin(level.lod).extend(0).to_array();
    }
    FrameUniforms {
        clip_from_offset: clip_from_offset(rays, tile).as_mat4().to_cols_array_2d(),
        atlas_slots: volume.shape().slots().extend(0).to_array(),
        texture_from_atlas: padded(1.0 / volume.shape().texels.as_vec3()),
        tile_origin: tile.origin,
        tile_size: tile.size,
        part_size: tile.part_size,
        value_scale: volume.value_scale(),
        dispatch: params.dispatch,
        stamps_at: places.stamps,
        bits_at: places.bits,
        orders_at: places.orders,
        extreme_scale: volume.extreme_scale(),
        ..of_rays
    }
}

/// What is known without volume and tile: sample grid, classification, light. The rest is 0.
pub(super) fn ray_uniforms(inputs: &FrameInputs<'_>) -> FrameUniforms {
    let FrameInputs {
        rays,
        classified,
        settings,
        ..
    } = *inputs;
    let depth = DepthRange::new(rays);
    let table = &classified.levels[0].lut;
    let [lut_lo, lut_scale] = table.index_lo_scale();
    let shading = &settings.shading;
    let light = shading.light.map(|d| (-d).normalize_or_zero().as_vec3());
    let mut surface_colors = [[0.0; 4]; MAX_SURFACES as usize];
    let mut surface_values = [[0.0; 4]; MAX_SURFACES_4 as usize];
    for (k, surface) in classified.surfaces.iter().enumerate() {
        surface_colors[k] = surface.color.extend(surface.opacity).to_array();
        surface_values[k / 4][k % 4] = surface.value;
    }
    let integrals = classified.levels[0].preintegrated.as_deref();
    let [preintegrated_lo, preintegrated_scale] =
        integrals.map_or([0.0; 2], PreintegratedTable::index_lo_scale);
    // Both sides of the one iso-value; with several an empty brick is not judged by its side.
    let [empty_below, empty_above] = if settings.mode == Mode::Iso {
        [f32::MIN, f32::MAX]
    } else {
        [classified.unseen; 2]
    };
    let mesh_level = rays.coarsest_used();
    let mut levels = [LevelUniforms::default(); MAX_LEVELS as usize];
    for (number, uniforms) in (0..rays.levels.len()).zip(&mut levels) {
        *uniforms = level_uniforms(&rays.levels[number], settings.is_by_segment());
        uniforms.leap_back_mm = leap_back_mm(rays, number) as f32;
    }
    FrameUniforms {
        world_dir: rays.world_dir.map(padded),
        to_light: light.map_or([0.0, 0.0, 0.0, 1.0], padded),
        material: [
            shading.ambient,
            shading.diffuse,
            shading.specular,
            shading.shininess,
        ],
        surface_colors,
        surface_values,
        mesh_anchor: mesh_level.anchor.extend(0).to_array(),
        picture_size: rays.size,
        place_in_pixel: rays.place_in_pixel,
        last_index: rays.last_index,
        first_mm: rays.first_mm,
        step_mm: rays.step_mm,
        near_mm: rays.near_mm,
        half_angles: rays.half_extent.map(|h| h as f32),
        opacity_cutoff: settings.opacity_cutoff,
        depth_scale: depth.scale as f32,
        depth_bias: depth.bias as f32,
        slack_mm: block_diagonal_mm(mesh_level) as f32,
        lut_lo,
        lut_scale,
        lut_last: (table.entries().len() - 1) as f32,
        value_floor: classified.value_range[0],
        value_ceiling: classified.value_range[1],
        extreme_end: classified.extreme_end,
        gradient_scale: classified.gradient_scale,
        preintegrated_lo,
        preintegrated_scale,
        preintegrated_last: integrals.map_or(1.0, |t| (t.side() - 1) as f32),
        empty_below,
        empty_above,
        used_levels: rays.used_levels as u32,
        finest_lod: u32::from(rays.levels[0].lod.0),
        levels,
        ..FrameUniforms::default()
    }
}

/// A level, but for its bricks.
fn level_uniforms(level: &LevelFrame, is_by_segment: bool) -> LevelUniforms {
    // A segment that ends at a switch is sampled at both ends by the finer level.
    let last = level.end as i32 - i32::from(!is_by_segment);
    LevelUniforms {
        level_dir: level.level_dir.map(padded),
        level_origin: level.level_origin.map(padded),
        box_min: padded(level.box_min),
        box_max: padded(level.box_max),
        normal_from_gradient: level
            .normal_from_gradient
            .to_cols_array_2d()
            .map(|c| padded(Vec3::from_array(c))),
        anchor: level.anchor.extend(0).to_array(),
        begin: level.begin as i32,
        last,
        step_mm: level.step_mm,
        ..LevelUniforms::default()
    }
}

pub(super) fn padded(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

/// By how much the point where the level of that number first shows something is moved back for the next frame: the samples
/// that a voxel's diagonal takes (techniques.md T2.2).
pub(super) fn leap_back_mm(rays: &RayFrame, number: usize) -> f64 {
    let diagonal_mm = block_diagonal_mm(&rays.levels[number]) / f64::from(BLOCK_EDGE);
    let step_mm = rays.levels[number].step_mm_exact;
    (diagonal_mm / step_mm).ceil() * step_mm
}

/// The longest diagonal of a 4³ block, mm.
fn block_diagonal_mm(level: &LevelFrame) -> f64 {
    let m = level.world_from_level.matrix3 * f64::from(BLOCK_EDGE);
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .into_iter()
        .map(|(a, b)| (m.x_axis + m.y_axis * a + m.z_axis * b).length())
        .fold(0.0, f64::max)
}

/// Reversed depth: view depth = scale / d (perspective, no far plane) or bias − scale · d (orthographic).
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthRange {
    pub(super) scale: f64,
    pub(super) bias: f64,
}

impl DepthRange {
    /// One that reaches at least `far_mm` along the viewing direction.
    pub(super) fn reaching(rays: &RayFrame, far_mm: f64) -> Self {
        let of_volume = Self::new(rays);
        match rays.projection {
            Projection::Orthographic if far_mm > of_volume.bias => Self {
                scale: far_mm - f64::from(rays.near_mm),
                bias: far_mm,
            },
            // The others have no far plane.
            _ => of_volume,
        }
    }

    /// One for the volume.
    fn new(rays: &RayFrame) -> Self {
        let near = f64::from(rays.near_mm);
        match rays.projection {
            // Reversed f32 depth is equally precise at any near plane above 0; far below a voxel will do. (Panoramas: of the
            // faces of a cube.)
            Projection::Perspective | Projection::Fisheye | Projection::Equirectangular => Self {
                scale: near.max(rays.step_mm_exact * 1e-3),
                bias: 0.0,
            },
            Projection::Orthographic => {
                let far = rays.first_mm_exact
                    + f64::from(rays.last_index + 1) * rays.step_mm_exact
                    + block_diagonal_mm(rays.coarsest_used());
                Self {
                    scale: far - near,
                    bias: far,
                }
            }
        }
    }
}

/// Clip space (cropped to the tile and its margin) from an offset from the anchor in voxels of the mesh's level. Pixel centres
/// of the raster are where rays pass through pixels: 3×3 of them bound a ray as well at any place in its pixel.
fn clip_from_offset(rays: &RayFrame, tile: Tile) -> DMat4 {
    let level = rays.coarsest_used();
    let anchor = level.anchor.as_dvec3();
    let world_from_offset = level.world_from_level * DAffine3::from_translation(anchor);
    clip_from_world(rays, DepthRange::new(rays), tile, BOUNDS_MARGIN)
        * DMat4::from(world_from_offset)
}

/// Clip space of the six faces of a cube around the eye, along the world's axes: +x, −x, +y, …
pub(super) fn clip_from_world_of_cube(rays: &RayFrame) -> [DMat4; 6] {
    let depth = DepthRange::new(rays);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    std::array::from_fn(|face| {
        let axis = face / 2;
        let side = if face % 2 == 0 { 1.0 } else { -1.0 };
        let right = axes[(axis + 1) % 3] * -side;
        let up = axes[(axis + 2) % 3];
        let world_from_view = DAffine3::from_mat3_translation(
            glam::DMat3::from_cols(right, up, axes[axis] * -side),
            rays.world_from_view.translation,
        );
        clip_from_view(Projection::Perspective, [1.0, 1.0], depth)
            * DMat4::from(world_from_view.inverse())
    })
}

/// Clip space, cropped to the tile and a margin of so many pixels around it.
pub(super) fn clip_from_world(
    rays: &RayFrame,
    depth: DepthRange,
    tile: Tile,
    margin: u32,
) -> DMat4 {
    let view_from_world = DMat4::from(rays.world_from_view.inverse());
    let clip_from_view = clip_from_view(rays.projection, rays.half_extent, depth);
    let [width, height] = rays.size.map(f64::from);
    let margin = f64::from(margin);
    let [x0, y0] = [0, 1].map(|axis| {
        let moved = f64::from(rays.place_in_pixel[axis]) - 0.5;
        f64::from(tile.origin[axis]) - margin + moved
    });
    let [w, h] = tile.size.map(|s| f64::from(s) + 2.0 * margin);
    let crop = DMat4::from_translation(DVec3::new(
        (width - 2.0 * x0) / w - 1.0,
        1.0 - (height - 2.0 * y0) / h,
        0.0,
    )) * DMat4::from_scale(DVec3::new(width / w, height / h, 1.0));
    crop * clip_from_view * view_from_world
}

/// Clip space from the view, of the whole picture; reversed depth.
fn clip_from_view(
    projection: Projection,
    [half_width, half_height]: [f64; 2],
    depth: DepthRange,
) -> DMat4 {
    // View space looks along −z.
    match projection {
        Projection::Perspective | Projection::Fisheye | Projection::Equirectangular => {
            DMat4::from_cols(
                DVec4::new(1.0 / half_width, 0.0, 0.0, 0.0),
                DVec4::new(0.0, 1.0 / half_height, 0.0, 0.0),
                DVec4::new(0.0, 0.0, 0.0, -1.0),
                DVec4::new(0.0, 0.0, depth.scale, 0.0),
            )
        }
        Projection::Orthographic => DMat4::from_cols(
            DVec4::new(1.0 / half_width, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 1.0 / half_height, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 1.0 / depth.scale, 0.0),
            DVec4::new(0.0, 0.0, depth.bias / depth.scale, 1.0),
        ),
    }
}
