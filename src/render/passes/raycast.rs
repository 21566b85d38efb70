//! The caster: a compute pass, one pipeline per mode and kind of atlas, built when first chosen.

use std::collections::HashMap;

use glam::UVec2;

use super::pipeline::ComputeParts;
use super::{BoundsTargets, LeapTargets};
use crate::camera::Projection;
use crate::clip::CutFaces;
use crate::gpu::layout::{PANORAMA_FISHEYE, PANORAMA_NONE, PANORAMA_SPHERE, PixelCounts, RayState};
use crate::gpu::shader::{self, AtlasPart, ModePart};
use crate::gpu::{GpuContext, GpuError};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, FrameInputs};
use crate::render::residency::Residency;
use crate::scene::{GradientFilter, Interpolation, Jitter, Mode, ShadingModel, SlabRim, SlabShape};

/// Pixels of a work-group whose rays walk by themselves.
const GROUP: [u32; 2] = [8, 8];

/// The same as values of the shaders' `override`s.
pub(super) const GROUP_CONSTANTS: [(&str, f64); 2] = group_constants(GROUP);

const fn group_constants(group: [u32; 2]) -> [(&'static str, f64); 2] {
    [
        ("GROUP_WIDTH", group[0] as f64),
        ("GROUP_HEIGHT", group[1] as f64),
    ]
}

/// Pixels in a row of the texture that lists pixels: whole work-groups.
const LIST_WIDTH: u32 = 1024;

/// What stands in a list where a work-group has no pixel: one that is in no tile.
const NO_PIXEL: u32 = u32::MAX;

/// What a pipeline is built for. Skipping is not here: with and without it must be equal to the bit (design.md §2), so it is an
/// order in the feedback buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Variant {
    mode: ModePart,
    atlas: AtlasPart,
    shaded: bool,
    refined: bool,
    nearest: bool,
    jittered: bool,
    filtered_gradients: bool,
    minimum: bool,
    /// Of mode iso.
    surfaces: u32,
    one_opaque: bool,
    /// The picture has geometry: rays are cut to parts.
    depths: bool,
    cut: bool,
    faces: CutFaces,
    orthographic: bool,
    panorama: u32,
    many_levels: bool,
    many_atlases: bool,
    draft: bool,
    leap: bool,
    /// The rays of a work-group advance together, and what that takes.
    slab: Option<(SlabShape, SlabRim)>,
}

impl Variant {
    fn new(inputs: &FrameInputs<'_>, volume: &Residency, how: CastKind) -> Self {
        let settings = inputs.settings;
        let surfaces = &inputs.classified.surfaces;
        Self {
            many_levels: inputs.rays.used_levels > 1,
            many_atlases: volume.has_many_atlases(),
            draft: how == CastKind::Draft,
            leap: how == CastKind::Draft && settings.leaps(),
            slab: how.slab(inputs).map(|shape| (shape, SlabRim::of(settings))),
            mode: match settings.mode {
                Mode::Dvr if settings.is_preintegrated() => ModePart::Preintegrated,
                Mode::Dvr | Mode::Xray => ModePart::Post,
                Mode::Gradient => ModePart::Gradient,
                Mode::Iso => ModePart::Surfaces,
                Mode::Mip | Mode::MinIp => ModePart::Extreme,
                Mode::Mean => ModePart::Mean,
            },
            atlas: volume.kind(),
            shaded: settings.shading.model == ShadingModel::Phong,
            refined: settings.refine,
            nearest: settings.interpolation == Interpolation::Nearest,
            jittered: settings.jitter == Jitter::Interleaved,
            filtered_gradients: settings.shading.gradient == GradientFilter::Filtered,
            minimum: settings.mode == Mode::MinIp,
            surfaces: surfaces.len() as u32,
            // Behind a layer a ray may meet the surface once more.
            one_opaque: settings.geometry.surfaces.is_empty()
                && matches!(surfaces[..], [s] if s.opacity >= settings.opacity_cutoff),
            depths: settings.depths && how != CastKind::Draft,
            cut: !settings.geometry.is_empty(),
            faces: settings.geometry.faces,
            orthographic: settings.camera.projection == Projection::Orthographic,
            panorama: panorama(settings.camera.projection),
        }
    }

    /// Values of the shader's `override`s; it has those of its mode only.
    fn constants(&self) -> Vec<(&'static str, f64)> {
        let flag = |name, is_set: bool| (name, f64::from(u8::from(is_set)));
        let group = group_of(self.slab.map(|(shape, _)| shape));
        // Gradients are taken from neighbours, which may be in bricks where nothing can be seen.
        let reads_beyond = self.slab.is_some_and(|(_, rim)| rim.sides > 0);
        let mut constants = group_constants(group).to_vec();
        constants.extend([
            flag("SHADED", self.shaded),
            flag("NEAREST", self.nearest),
            flag("JITTERED", self.jittered),
            flag("FILTERED_GRADIENTS", self.filtered_gradients),
            flag("ORTHOGRAPHIC", self.orthographic),
            ("PANORAMA", f64::from(self.panorama)),
            flag("MANY_LEVELS", self.many_levels),
            flag("MANY_ATLASES", self.many_atlases),
            flag("DRAFT", self.draft),
            flag("LEAP", self.leap),
            flag("DEPTHS", self.depths),
            flag("CUT", self.cut),
            flag("FACES", self.faces.matter()),
            flag("CAPPED", self.faces.are_capped),
            flag("FACE_NORMALS", self.faces.have_normals),
            flag("EXTREME", self.mode == ModePart::Extreme),
            flag("MINIMUM", self.minimum),
            flag(
                "EXACT_ENDS",
                self.mode == ModePart::Preintegrated || self.surfaces > 1 || reads_beyond,
            ),
        ]);
        if let Some((shape, rim)) = self.slab {
            let [wide, high] = shape.span(rim);
            constants.extend([
                ("SLAB_DEPTH", f64::from(shape.depth)),
                ("SLAB_RIM", f64::from(rim.sides)),
                ("SLAB_FRONT", f64::from(rim.front)),
                ("SLAB_WIDE", f64::from(wide)),
                ("SLAB_AREA", f64::from(wide * high)),
                ("SLAB_VALUES", f64::from(shape.values(rim))),
                ("SLAB_RAYS", f64::from(shape.rays())),
            ]);
        }
        if self.mode == ModePart::Surfaces {
            constants.extend([
                ("SURFACES", f64::from(self.surfaces)),
                flag("ONE_OPAQUE", self.one_opaque),
                flag("MANY_EVENTS", !self.one_opaque),
                flag("REFINED", self.refined),
            ]);
        }
        constants
    }
}

/// `PANORAMA_*` of a projection.
pub(super) fn panorama(projection: Projection) -> u32 {
    match projection {
        Projection::Perspective | Projection::Orthographic => PANORAMA_NONE,
        Projection::Fisheye => PANORAMA_FISHEYE,
        Projection::Equirectangular => PANORAMA_SPHERE,
    }
}

/// For what rays are cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render) enum CastKind {
    /// For a picture in which nothing waits.
    Draft,
    /// For all pixels of a tile.
    Tile,
    /// For listed pixels, which have no neighbours.
    List,
}

impl CastKind {
    /// The slabs in which they advance; `None` where each walks by itself.
    pub(in crate::render) fn slab(self, inputs: &FrameInputs<'_>) -> Option<SlabShape> {
        inputs.slab.filter(|_| self == Self::Tile)
    }
}

/// Pixels of a work-group.
fn group_of(slab: Option<SlabShape>) -> [u32; 2] {
    slab.map_or(GROUP, |shape| [shape.width, shape.height])
}

/// The pipelines that were needed so far.
#[derive(Debug)]
pub(in crate::render) struct RaycastPass {
    layout: wgpu::BindGroupLayout,
    depth_sampler: wgpu::Sampler,
    pipelines: HashMap<Variant, wgpu::ComputePipeline>,
}

/// What a tile is cast into, and from which depths.
#[derive(Debug)]
pub(in crate::render) struct RaycastTargets {
    /// Per pixel, premultiplied RGBA in f32.
    pub(in crate::render) picture: wgpu::Buffer,
    /// Per pixel, what its ray did.
    pub(in crate::render) counts: wgpu::Buffer,
    /// Per pixel, where its ray stands.
    rays: wgpu::Buffer,
    /// The pixels that the host lists where not all are cast.
    list: wgpu::Texture,
    /// Bound where nothing leaps: no starts, no points.
    no_leap: [wgpu::TextureView; 2],
}

impl RaycastTargets {
    /// Bytes per pixel: picture and counts with their read-back copies, the ray's state, and a place in the list.
    pub(in crate::render) const BYTES_PER_PIXEL: u64 =
        (16 + size_of::<PixelCounts>() as u64) * 2 + size_of::<RayState>() as u64 + 4;

    /// Per pixel, where its ray stands.
    pub(in crate::render) fn rays(&self) -> &wgpu::Buffer {
        &self.rays
    }

    pub(super) fn list_view(&self) -> wgpu::TextureView {
        self.list
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    /// A texture that lists at most `pixels` pixels, filled up to whole work-groups.
    pub(super) fn list_texture(
        gpu: &GpuContext,
        label: &str,
        pixels: u64,
        written: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: LIST_WIDTH,
                height: pixels.div_ceil(u64::from(LIST_WIDTH)) as u32,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Uint,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | written,
            view_formats: &[],
        })
    }

    /// Sends the pixels that are cast, each row << 16 | column within the tile, and no more than it has.
    pub(in crate::render) fn write_list(&self, gpu: &GpuContext, pixels: &[u32]) {
        let count = pixels.len() as u32;
        let mut rows = pixels.to_vec();
        rows.resize(count.next_multiple_of(LIST_WIDTH) as usize, NO_PIXEL);
        gpu.queue.write_texture(
            self.list.as_image_copy(),
            bytemuck::cast_slice(&rows),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(LIST_WIDTH * 4),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width: LIST_WIDTH,
                height: count.div_ceil(LIST_WIDTH),
                depth_or_array_layers: 1,
            },
        );
    }

    /// Every ray at its beginning.
    pub(in crate::render) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        for buffer in [&self.picture, &self.counts, &self.rays] {
            encoder.clear_buffer(buffer, 0, None);
        }
    }
}

impl RaycastPass {
    pub(in crate::render) fn new(gpu: &GpuContext) -> Self {
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("raycast.layout"),
                entries: bindings::RAYCAST,
            });
        let depth_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("raycast.depth_sampler"),
            ..Default::default()
        });
        Self {
            layout,
            depth_sampler,
            pipelines: HashMap::new(),
        }
    }

    pub(in crate::render) fn targets(gpu: &GpuContext, pixels: u64) -> RaycastTargets {
        let buffer = |label, size| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let picture = buffer("raycast.picture", pixels * 16);
        let counts = buffer("raycast.counts", pixels * size_of::<PixelCounts>() as u64);
        let rays = buffer("raycast.rays", pixels * size_of::<RayState>() as u64);
        let list = RaycastTargets::list_texture(
            gpu,
            "raycast.pixel_list",
            pixels,
            wgpu::TextureUsages::COPY_DST,
        );
        let no_leap = ["raycast.no_starts", "raycast.no_points"].map(|label| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d::default(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R32Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        });
        RaycastTargets {
            picture,
            counts,
            rays,
            list,
            no_leap,
        }
    }

    /// Group 2 with the host's list of pixels.
    pub(in crate::render) fn host_group(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        self.group(gpu, bounds, targets, feedback, &targets.list_view())
    }

    /// Group 2 of drafts whose rays start where `leap` says, and leave points there.
    pub(in crate::render) fn leap_group(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
        leap: &LeapTargets,
    ) -> wgpu::BindGroup {
        let views = [&leap.starts, &leap.points()];
        self.group_with(gpu, bounds, targets, feedback, &targets.list_view(), views)
    }

    /// Group 2 with a list of pixels.
    pub(super) fn group(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
        list: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        let [starts, points] = &targets.no_leap;
        self.group_with(gpu, bounds, targets, feedback, list, [starts, points])
    }

    fn group_with(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
        list: &wgpu::TextureView,
        [starts, points]: [&wgpu::TextureView; 2],
    ) -> wgpu::BindGroup {
        let view = |i: usize| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: wgpu::BindingResource::TextureView(&bounds.views[i]),
        };
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raycast.group"),
            layout: &self.layout,
            entries: &[
                view(0),
                view(1),
                view(2),
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: targets.picture.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: targets.counts.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: targets.rays.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 6,
                    resource: feedback.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 7,
                    resource: wgpu::BindingResource::Sampler(&self.depth_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 8,
                    resource: wgpu::BindingResource::TextureView(list),
                },
                wgpu::BindGroupEntry {
                    binding: 9,
                    resource: wgpu::BindingResource::TextureView(starts),
                },
                wgpu::BindGroupEntry {
                    binding: 10,
                    resource: wgpu::BindingResource::TextureView(points),
                },
            ],
        })
    }

    /// Builds the pipeline for these settings, if it isn't there yet.
    pub(in crate::render) fn prepare(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        volume: &Residency,
        parts: &wgpu::BindGroupLayout,
        how: CastKind,
    ) -> Result<(), GpuError> {
        let variant = Variant::new(inputs, volume, how);
        if self.pipelines.contains_key(&variant) {
            return Ok(());
        }
        let (casters, entry) = match variant.slab {
            None => (shader::RAYCASTERS, "cast_rays"),
            Some(_) => (shader::SLABCASTERS, "cast_slabs"),
        };
        let source = shader::caster(casters, variant.mode, variant.atlas);
        let module = source.compile(gpu)?;
        let pipeline = ComputeParts {
            label: "raycast.pipeline",
            doing: "building the raycaster",
            module: &module,
            entry,
            layouts: &[&frame.layout, &volume.layout, &self.layout, parts],
            constants: &variant.constants(),
            // Whatever is read there was written before.
            zero_workgroup_memory: false,
        }
        .build(gpu)?;
        self.pipelines.insert(variant, pipeline);
        Ok(())
    }

    /// Work-groups along x and y that a tile of `size` pixels takes.
    pub(in crate::render) fn group_count(size: [u32; 2], slab: Option<SlabShape>) -> UVec2 {
        let group = group_of(slab);
        UVec2::new(size[0].div_ceil(group[0]), size[1].div_ceil(group[1]))
    }

    /// First pixel of a work-group of a tile of `size` pixels.
    pub(in crate::render) fn group_pixel(size: [u32; 2], group: u32) -> [u32; 2] {
        let wide = Self::group_count(size, None).x;
        [group % wide * GROUP[0], group / wide * GROUP[1]]
    }

    /// Work-groups of a list of `pixels` pixels.
    pub(in crate::render) fn list_groups(pixels: u32) -> u32 {
        pixels.div_ceil(GROUP[0] * GROUP[1])
    }

    /// Makes `pass` ready to cast, with these as groups 2 and 3. The pipeline must have been prepared.
    pub(in crate::render) fn bind(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        volume: &Residency,
        [group, parts]: [&wgpu::BindGroup; 2],
        how: CastKind,
    ) {
        let pipeline = self
            .pipelines
            .get(&Variant::new(inputs, volume, how))
            .expect("invariant: prepared before recorded");
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, &volume.group, &[]);
        pass.set_bind_group(2, group, &[]);
        pass.set_bind_group(3, parts, &[]);
    }
}
