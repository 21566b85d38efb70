//! Rays cut to parts by the geometry of a picture: a raster that lists what each ray crosses, and a pass that sorts these lists
//! (the twin of [`Geometry::spans`]). The caster binds what comes out as group 3.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use wgpu::util::DeviceExt;

use super::pipeline::ComputeParts;
use crate::camera::Projection;
use crate::clip::{Geometry, Side, TriangleMesh};
use crate::gpu::layout::{
    Crossing, GeometryUniforms, MESH_DRAWN, MESH_INSIDE, MESH_OUTSIDE, MeshRecord,
    PART_RECORDS_WIDE,
};
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers, shader};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, Tile, clip_from_world, padded};
use crate::scene::RayFrame;

/// Bytes of a texel of a record.
const TEXEL_BYTES: u64 = 16;
/// What there is room for at first, per pixel of a tile; what a picture takes more is made room for.
const CROSSINGS_AT_FIRST: u64 = 4;

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

/// A picture's geometry on the device.
#[derive(Debug)]
struct GeometryBuffers {
    of: Arc<Geometry>,
    /// What positions count from, world mm: f32 is precise around it.
    origin: DVec3,
    uniforms: wgpu::Buffer,
    half_spaces: wgpu::Buffer,
    meshes: wgpu::Buffer,
    planes: wgpu::Buffer,
    corners: wgpu::Buffer,
    vertices: wgpu::Buffer,
    triangles: u32,
    /// Triangles of the meshes that cut: the others are drawn.
    first_drawn: u32,
}

/// What a tile's rays cross, and the parts that they are cut to.
#[derive(Debug)]
struct PartsTargets {
    tile: [u32; 2],
    /// A raster needs a target; nothing is written.
    color: wgpu::TextureView,
    heads: wgpu::Buffer,
    crossings: wgpu::Buffer,
    totals: wgpu::Buffer,
    most_crossings: u64,
    most_records: u64,
    /// Of a record.
    texels: u64,
    lists: wgpu::TextureView,
    records: wgpu::TextureView,
    /// Group 3 of the caster.
    group: wgpu::BindGroup,
}

/// A corner of a triangle, for the raster.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Vertex {
    position: [f32; 3],
    mesh: u32,
}

impl GeometryBuffers {
    fn new(gpu: &GpuContext, of: &Arc<Geometry>) -> Result<Self, GpuError> {
        let cuts = of.clip_meshes.iter().map(|c| &c.mesh);
        let drawn = of.surfaces.iter().map(|s| &s.mesh);
        let meshes: Vec<&Arc<TriangleMesh>> = cuts.chain(drawn).collect();
        let bounds = meshes.iter().map(|m| m.bounds());
        let bounds =
            bounds.reduce(|a, b| crate::geom::Aabb::new(a.min.min(b.min), a.max.max(b.max)));
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
        let most = gpu.caps.limits.max_storage_buffer_binding_size as u64;
        let needed = (corners.len() as u64).max(planes.len() as u64) * 16;
        if needed > most {
            return Err(GpuError::TooSmall {
                what: format!("the {} triangles of the meshes", planes.len()),
                needed,
                limit: most,
                limited_by: "the adapter's largest storage buffer".into(),
                remedy: "give meshes of fewer triangles".into(),
            });
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

    fn bytes(&self) -> u64 {
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

    fn uniforms(&self, rays: &RayFrame, tile: &Tile, targets: &PartsTargets) -> GeometryUniforms {
        let view = rays.world_from_view;
        let eye = view.translation - self.origin;
        let across = view.matrix3.x_axis * rays.half_extent[0];
        let upward = view.matrix3.y_axis * rays.half_extent[1];
        let origin = match rays.projection {
            Projection::Perspective => [eye, DVec3::ZERO, DVec3::ZERO],
            Projection::Orthographic => [eye, across, upward],
        };
        let world_from_mesh = DAffine3::from_translation(self.origin);
        GeometryUniforms {
            origin: origin.map(|v| padded(v.as_vec3())),
            clip_from_mesh: (clip_from_world(rays, *tile, 0) * world_from_mesh)
                .as_mat4()
                .to_cols_array_2d(),
            planes: self.of.planes.len() as u32,
            clip_meshes: self.of.clip_meshes.len() as u32,
            first_drawn: self.first_drawn,
            most_crossings: targets.most_crossings as u32,
            most_records: targets.most_records as u32,
            triangles: self.triangles,
            ..GeometryUniforms::default()
        }
    }
}

impl PartsTargets {
    /// Bytes per pixel of a tile beside crossings and records.
    const BYTES_PER_PIXEL: u64 = 1 + 4 + 8;

    /// Bytes for so many crossings, and the records of so many texels that they may become.
    fn bytes_for(pixels: u64, crossings: u64, texels: u64) -> u64 {
        crossings * size_of::<Crossing>() as u64
            + Self::records_for(pixels, crossings) * texels * TEXEL_BYTES
    }

    fn records_for(pixels: u64, crossings: u64) -> u64 {
        (pixels + 2 * crossings).next_multiple_of(u64::from(PART_RECORDS_WIDE))
    }

    fn new(
        gpu: &GpuContext,
        layout: &wgpu::BindGroupLayout,
        tile: [u32; 2],
        crossings: u64,
        texels: u64,
    ) -> Self {
        let pixels = u64::from(tile[0]) * u64::from(tile[1]);
        let records = Self::records_for(pixels, crossings);
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
        let lists = texture("parts.lists", tile, wgpu::TextureFormat::Rg32Uint, written);
        let rows = (records * texels / u64::from(PART_RECORDS_WIDE)) as u32;
        let records_view = texture(
            "parts.records",
            [PART_RECORDS_WIDE, rows],
            wgpu::TextureFormat::Rgba32Uint,
            written,
        );
        Self {
            tile,
            color: texture(
                "parts.nothing",
                tile,
                wgpu::TextureFormat::R8Unorm,
                wgpu::TextureUsages::RENDER_ATTACHMENT,
            ),
            heads: buffer("parts.heads", pixels * 4),
            crossings: buffer(
                "parts.crossings",
                crossings.max(1) * size_of::<Crossing>() as u64,
            ),
            totals: buffer("parts.totals", 8),
            most_crossings: crossings,
            most_records: records,
            texels,
            group: cast_group(gpu, layout, &lists, &records_view),
            lists,
            records: records_view,
        }
    }

    fn bytes(&self) -> u64 {
        let pixels = u64::from(self.tile[0]) * u64::from(self.tile[1]);
        pixels * Self::BYTES_PER_PIXEL + self.crossings.size() + self.most_records * self.texels * TEXEL_BYTES
    }
}

fn cast_group(
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
        let constants = [("ORTHOGRAPHIC", is_orthographic)];
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
            constants: &[constants[0], ("FACES", f64::from(u8::from(has_faces)))],
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
            &targets.totals,
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

    /// Bytes that a tile of `tile` pixels takes at least.
    pub(in crate::render) fn least_bytes(geometry: &Geometry, tile: [u32; 2]) -> u64 {
        if geometry.is_empty() {
            return 0;
        }
        let pixels = u64::from(tile[0]) * u64::from(tile[1]);
        let crossings = crossings_at_first(geometry, pixels);
        pixels * PartsTargets::BYTES_PER_PIXEL
            + PartsTargets::bytes_for(pixels, crossings, texels_of(geometry))
    }

    /// Bytes of a geometry itself on the device, about.
    pub(in crate::render) fn geometry_bytes(geometry: &Geometry) -> u64 {
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

    pub(in crate::render) fn bytes(&self) -> u64 {
        self.geometry.as_ref().map_or(0, GeometryBuffers::bytes)
            + self.targets.as_ref().map_or(0, PartsTargets::bytes)
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
        projection: Projection,
        tile: [u32; 2],
    ) -> Result<(), GpuError> {
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
        let texels = texels_of(geometry);
        let shape = |t: &PartsTargets| (t.tile, t.texels);
        if self.targets.as_ref().map(shape) != Some((tile, texels)) {
            let pixels = u64::from(tile[0]) * u64::from(tile[1]);
            self.make_targets(gpu, tile, crossings_at_first(geometry, pixels), texels)?;
        }
        Ok(())
    }

    fn make_targets(
        &mut self,
        gpu: &GpuContext,
        tile: [u32; 2],
        crossings: u64,
        texels: u64,
    ) -> Result<(), GpuError> {
        self.targets = None;
        self.targets = Some(gpu.checked("allocating the lists of crossings", || {
            Ok(PartsTargets::new(gpu, &self.layout, tile, crossings, texels))
        })?);
        Ok(())
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
            let uniforms = geometry.uniforms(rays, tile, targets);
            gpu.queue
                .write_buffer(&geometry.uniforms, 0, bytemuck::bytes_of(&uniforms));
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
            let [totals] = read_buffers(gpu, [(&targets.totals, 0, 8)])?;
            let crossings = u64::from(bytemuck::pod_read_unaligned::<u32>(&totals[..4]));
            if crossings <= targets.most_crossings {
                return Ok(());
            }
            let tile_size = targets.tile;
            let pixels = u64::from(tile_size[0]) * u64::from(tile_size[1]);
            // Some more, so that the next tile needn't wait twice.
            let room = crossings + crossings / 4;
            let texels = targets.texels;
            let needed = PartsTargets::bytes_for(pixels, room, texels);
            let most = self.most_bytes.min(
                u64::from(gpu.caps.limits.max_texture_dimension_2d)
                    * u64::from(PART_RECORDS_WIDE)
                    * TEXEL_BYTES,
            );
            if needed > most {
                return Err(GpuError::TooSmall {
                    what: format!("the list of what {pixels} rays cross of the meshes"),
                    needed,
                    limit: most,
                    limited_by: "the share of --gpu-memory for them".into(),
                    remedy: "give more --gpu-memory, or meshes of fewer layers".into(),
                });
            }
            self.make_targets(gpu, tile_size, room, texels)?;
        }
    }
}

/// Texels of a record (`shaders/lib/part.wgsl`).
fn texels_of(geometry: &Geometry) -> u64 {
    if geometry.faces.matter() { 2 } else { 1 }
}

/// Room for crossings before any were counted.
fn crossings_at_first(geometry: &Geometry, pixels: u64) -> u64 {
    if geometry.clip_meshes.is_empty() && geometry.surfaces.is_empty() {
        0
    } else {
        pixels * CROSSINGS_AT_FIRST
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
    encoder.clear_buffer(&targets.totals, 0, None);
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
        pass.draw(0..geometry.triangles * 3, 0..1);
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
