//! Rays cut to parts by the geometry of a picture: a raster that lists what each ray crosses, and a pass that sorts these lists
//! (the twin of [`Geometry::spans`]). The caster binds what comes out as group 3.

use std::sync::Arc;

use super::super::pipeline::ComputeParts;
use super::super::raycast::panorama;
use super::geometry::{GeometryBuffers, Vertex};
use super::targets::{PartsShape, PartsTargets, cast_group};
use crate::camera::Projection;
use crate::clip::Geometry;
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers, shader};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, Tile};
use crate::render::tiling::LEAST_TILE_PIXELS;
use crate::scene::RayFrame;

/// The pipelines, what they work on, and what the caster binds.
#[derive(Debug)]
pub(in crate::render) struct PartsPass {
    /// Of group 3 of the caster.
    pub(in crate::render) layout: wgpu::BindGroupLayout,
    /// Bound where the picture has no geometry.
    empty: wgpu::BindGroup,
    /// Built for the first picture that has some.
    pipelines: Option<Pipelines>,
    geometry: Option<GeometryBuffers>,
    targets: Option<PartsTargets>,
    /// Bytes that crossings and records may take.
    pub(in crate::render) most_bytes: u64,
}

#[derive(Debug)]
struct Pipelines {
    projection: Projection,
    has_faces: bool,
    geometry_layout: wgpu::BindGroupLayout,
    lists_layout: wgpu::BindGroupLayout,
    raster: wgpu::RenderPipeline,
    sort: wgpu::ComputePipeline,
}

impl Pipelines {
    fn new(
        gpu: &GpuContext,
        frame: &FrameBindings,
        projection: Projection,
        has_faces: bool,
    ) -> Result<Self, GpuError> {
        let layout = |label, entries| {
            gpu.device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries,
                })
        };
        let geometry_layout = layout("parts.geometry", bindings::GEOMETRY);
        let lists_layout = layout("parts.lists", bindings::PART_LISTS);
        let is_orthographic = f64::from(u8::from(projection == Projection::Orthographic));
        let constants = [
            ("ORTHOGRAPHIC", is_orthographic),
            ("PANORAMA", f64::from(panorama(projection))),
        ];
        let module = shader::CROSSINGS.compile(gpu)?;
        let raster = gpu.checked("building the raster of crossings", || {
            let layout = gpu
                .device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some("parts.raster"),
                    bind_group_layouts: &[Some(&frame.layout), Some(&geometry_layout)],
                    immediate_size: 0,
                });
            let compilation_options = wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            };
            Ok(gpu
                .device
                .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                    label: Some("parts.raster"),
                    layout: Some(&layout),
                    vertex: wgpu::VertexState {
                        module: &module,
                        entry_point: Some("crossings_vertex"),
                        compilation_options: compilation_options.clone(),
                        buffers: &[Some(wgpu::VertexBufferLayout {
                            array_stride: size_of::<Vertex>() as u64,
                            step_mode: wgpu::VertexStepMode::Vertex,
                            attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32],
                        })],
                    },
                    primitive: wgpu::PrimitiveState::default(),
                    depth_stencil: None,
                    multisample: wgpu::MultisampleState::default(),
                    fragment: Some(wgpu::FragmentState {
                        module: &module,
                        entry_point: Some("crossings_fragment"),
                        compilation_options,
                        targets: &[Some(wgpu::ColorTargetState {
                            format: wgpu::TextureFormat::R8Unorm,
                            blend: None,
                            write_mask: wgpu::ColorWrites::empty(),
                        })],
                    }),
                    multiview_mask: None,
                    cache: None,
                }))
        })?;
        let sort = ComputeParts {
            label: "parts.sort",
            doing: "building the pass that cuts rays to parts",
            module: &shader::RAY_PARTS.compile(gpu)?,
            entry: "make_parts",
            layouts: &[&frame.layout, &geometry_layout, &lists_layout],
            constants: &[
                constants[0],
                constants[1],
                ("FACES", f64::from(u8::from(has_faces))),
            ],
            zero_workgroup_memory: true,
        }
        .build(gpu)?;
        Ok(Self {
            projection,
            has_faces,
            geometry_layout,
            lists_layout,
            raster,
            sort,
        })
    }

    fn groups(
        &self,
        gpu: &GpuContext,
        geometry: &GeometryBuffers,
        targets: &PartsTargets,
    ) -> [wgpu::BindGroup; 2] {
        let buffers = [
            &geometry.uniforms,
            &geometry.half_spaces,
            &geometry.meshes,
            &geometry.planes,
            &geometry.corners,
            &targets.heads,
            &targets.crossings,
            &targets.words,
        ];
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let geometry = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("parts.geometry"),
            layout: &self.geometry_layout,
            entries: &entries,
        });
        let lists = cast_group(gpu, &self.lists_layout, &targets.lists, &targets.records);
        [geometry, lists]
    }
}

impl PartsPass {
    pub(in crate::render) fn new(gpu: &GpuContext) -> Self {
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("parts.layout"),
                entries: bindings::PARTS,
            });
        let none = gpu
            .device
            .create_texture(&wgpu::TextureDescriptor {
                label: Some("parts.none"),
                size: wgpu::Extent3d::default(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R32Uint,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })
            .create_view(&wgpu::TextureViewDescriptor::default());
        Self {
            empty: cast_group(gpu, &layout, &none, &none),
            layout,
            pipelines: None,
            geometry: None,
            targets: None,
            most_bytes: 0,
        }
    }

    /// Bytes that a picture needs in tiles of `tile` pixels: of its geometry, and at least of what rays are cut to.
    pub(in crate::render) fn bytes_for(
        geometry: &Geometry,
        rays: &RayFrame,
        tile: [u32; 2],
    ) -> [u64; 2] {
        if geometry.is_empty() {
            return [0; 2];
        }
        let shape = PartsShape::first(geometry, rays, tile);
        [GeometryBuffers::bytes_of(geometry), shape.bytes()]
    }

    /// Bytes of lists and parts for each pixel of a tile, at least.
    pub(in crate::render) fn bytes_per_pixel(geometry: &Geometry) -> u64 {
        match geometry.is_empty() {
            true => 0,
            false => PartsShape::bytes_per_pixel(geometry),
        }
    }

    pub(in crate::render) fn bytes(&self) -> u64 {
        self.geometry.as_ref().map_or(0, GeometryBuffers::bytes)
            + self.targets.as_ref().map_or(0, |t| t.shape.bytes())
    }

    /// Builds what a picture with this geometry in tiles of `tile` pixels needs; drops what one without doesn't.
    ///
    /// # Errors
    /// The device refuses a pipeline, or has not the memory.
    pub(in crate::render) fn prepare(
        &mut self,
        gpu: &GpuContext,
        frame: &FrameBindings,
        geometry: &Arc<Geometry>,
        rays: &RayFrame,
        tile: [u32; 2],
    ) -> Result<(), GpuError> {
        let projection = rays.projection;
        if geometry.is_empty() {
            (self.geometry, self.targets) = (None, None);
            return Ok(());
        }
        let has_faces = geometry.faces.matter();
        let kind = |p: &Pipelines| (p.projection, p.has_faces);
        if self.pipelines.as_ref().map(kind) != Some((projection, has_faces)) {
            self.pipelines = Some(Pipelines::new(gpu, frame, projection, has_faces)?);
        }
        if self.geometry.as_ref().is_none_or(|g| g.of != *geometry) {
            self.geometry = None;
            self.geometry = Some(GeometryBuffers::new(gpu, geometry)?);
        }
        let shape = PartsShape::first(geometry, rays, tile);
        let most = self.most_bytes;
        let fits = |t: &PartsTargets| t.shape.is_like(&shape) && t.shape.bytes() <= most;
        if !self.targets.as_ref().is_some_and(fits) {
            self.make_targets(gpu, shape)?;
        }
        Ok(())
    }

    fn make_targets(&mut self, gpu: &GpuContext, shape: PartsShape) -> Result<(), GpuError> {
        self.targets = None;
        self.targets = Some(gpu.checked("allocating the lists of crossings", || {
            Ok(PartsTargets::new(gpu, &self.layout, shape))
        })?);
        Ok(())
    }

    /// Drops what is on the device for the last picture's geometry.
    pub(in crate::render) fn drop_targets(&mut self) {
        (self.geometry, self.targets) = (None, None);
    }

    /// What the caster binds as group 3.
    pub(in crate::render) fn group(&self) -> &wgpu::BindGroup {
        self.targets.as_ref().map_or(&self.empty, |t| &t.group)
    }

    /// Cuts the rays of a tile, whose uniforms were written. Waits, where there are meshes, for their number of crossings.
    ///
    /// # Errors
    /// The device is lost, or what rays cross takes more memory than it may.
    pub(in crate::render) fn cut(
        &mut self,
        gpu: &GpuContext,
        frame: &FrameBindings,
        rays: &RayFrame,
        tile: &Tile,
        timer: &mut PassTimer,
    ) -> Result<(), GpuError> {
        loop {
            let (Some(pipelines), Some(geometry), Some(targets)) =
                (&self.pipelines, &self.geometry, &self.targets)
            else {
                return Ok(());
            };
            let uniforms = geometry.uniforms(rays, tile, &targets.shape);
            gpu.queue
                .write_buffer(&geometry.uniforms, 0, bytemuck::bytes_of(&uniforms));
            gpu.queue
                .write_buffer(&targets.words, 0, bytemuck::bytes_of(&geometry.words()));
            let groups = pipelines.groups(gpu, geometry, targets);
            let mut encoder = gpu
                .device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                    label: Some("parts"),
                });
            record(
                &mut encoder,
                frame,
                pipelines,
                geometry,
                targets,
                &groups,
                tile,
                timer,
            );
            gpu.queue.submit([encoder.finish()]);
            if geometry.triangles == 0 {
                return Ok(());
            }
            let [totals] = read_buffers(gpu, [(&targets.words, 0, 8)])?;
            let [crossings, records] = [&totals[..4], &totals[4..]]
                .map(|word| u64::from(bytemuck::pod_read_unaligned::<u32>(word)));
            let shape = targets.shape;
            if crossings <= shape.crossings && records <= shape.records {
                return Ok(());
            }
            // Some more, so that the next tile needn't wait twice.
            let room = |n: u64| n + n / 4;
            let larger = shape.with_room(room(crossings).max(shape.crossings), room(records));
            let most_rows = u64::from(gpu.caps.limits.max_texture_dimension_2d);
            let most_crossing_bytes = gpu.caps.limits.max_storage_buffer_binding_size;
            if larger.bytes() > self.most_bytes
                || larger.rows() > most_rows
                || larger.crossing_bytes() > most_crossing_bytes
            {
                let limit = self.most_bytes.min(most_crossing_bytes);
                // Of a panorama the lists are those of all around, however small its tiles.
                if shape.cube_edge == 0 && shape.pixels() > LEAST_TILE_PIXELS {
                    return Err(GpuError::TooManyCrossings {
                        crossings,
                        pixels: shape.pixels(),
                        needed: larger.bytes(),
                        limit,
                    });
                }
                return Err(GpuError::TooSmall {
                    what: format!("the list of the {crossings} crossings of rays and meshes"),
                    needed: larger.bytes(),
                    limit,
                    limited_by: "the share of --gpu-memory for them, or a buffer of the adapter"
                        .into(),
                    remedy: "give more --gpu-memory, or meshes of fewer layers".into(),
                });
            }
            self.make_targets(gpu, larger)?;
        }
    }
}

#[expect(
    clippy::too_many_arguments,
    reason = "the parts of one pass, borrowed one by one"
)]
fn record(
    encoder: &mut wgpu::CommandEncoder,
    frame: &FrameBindings,
    pipelines: &Pipelines,
    geometry: &GeometryBuffers,
    targets: &PartsTargets,
    [of_geometry, of_lists]: &[wgpu::BindGroup; 2],
    tile: &Tile,
    timer: &mut PassTimer,
) {
    if geometry.triangles > 0 {
        encoder.clear_buffer(&targets.heads, 0, None);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("parts.crossings"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &targets.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Discard,
                },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: timer.render("parts.crossings"),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&pipelines.raster);
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, of_geometry, &[]);
        pass.set_vertex_buffer(0, geometry.vertices.slice(..));
        for face in 0..targets.shape.draws() {
            pass.draw(0..geometry.triangles * 3, face..face + 1);
        }
    }
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some("parts"),
        timestamp_writes: timer.compute("parts"),
    });
    pass.set_pipeline(&pipelines.sort);
    pass.set_bind_group(0, &frame.group, &[]);
    pass.set_bind_group(1, of_geometry, &[]);
    pass.set_bind_group(2, of_lists, &[]);
    let [x, y] = tile.part_size.map(|n| n.div_ceil(8));
    pass.dispatch_workgroups(x, y, 1);
}
