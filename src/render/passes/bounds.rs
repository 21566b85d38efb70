//! The bounding mesh, rasterised to three depth buffers: nearest front, nearest back, farthest back faces.

use crate::gpu::{GpuContext, GpuError, PassTimer, shader};
use crate::proxy::Mesh;
use crate::render::frame::FrameBindings;

/// The three draws: which faces, and which of them wins.
#[derive(Clone, Copy, Debug)]
struct Draw {
    name: &'static str,
    cull: wgpu::Face,
    /// Depth is reversed: greater is nearer.
    compare: wgpu::CompareFunction,
    clear: f32,
}

const DRAWS: [Draw; 3] = [
    Draw {
        name: "bounds.nearest_front",
        cull: wgpu::Face::Back,
        compare: wgpu::CompareFunction::Greater,
        clear: 0.0,
    },
    Draw {
        name: "bounds.nearest_back",
        cull: wgpu::Face::Front,
        compare: wgpu::CompareFunction::Greater,
        clear: 0.0,
    },
    Draw {
        name: "bounds.farthest_back",
        cull: wgpu::Face::Front,
        compare: wgpu::CompareFunction::Less,
        clear: 1.0,
    },
];

/// The pipelines, for affines that keep and that mirror the orientation of faces.
#[derive(Debug)]
pub(in crate::render) struct BoundsPass {
    pipelines: [[wgpu::RenderPipeline; 3]; 2],
}

/// The mesh on the device.
#[derive(Debug)]
pub(in crate::render) struct MeshBuffers {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    index_count: u32,
}

impl MeshBuffers {
    pub(in crate::render) fn new(gpu: &GpuContext, mesh: &Mesh) -> Result<Self, GpuError> {
        use wgpu::util::DeviceExt;
        gpu.checked("uploading the bounding mesh", || {
            let buffer = |label, contents, usage| {
                gpu.device
                    .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                        label: Some(label),
                        contents,
                        usage,
                    })
            };
            Ok(Self {
                vertices: buffer(
                    "bounds.vertices",
                    bytemuck::cast_slice(&mesh.vertices),
                    wgpu::BufferUsages::VERTEX,
                ),
                indices: buffer(
                    "bounds.indices",
                    bytemuck::cast_slice(&mesh.indices),
                    wgpu::BufferUsages::INDEX,
                ),
                index_count: mesh.indices.len() as u32,
            })
        })
    }

    pub(in crate::render) fn bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size()
    }
}

/// The depth buffers of a tile and its margin, in the order of `pass/raycast.wgsl`.
#[derive(Debug)]
pub(in crate::render) struct BoundsTargets {
    pub(in crate::render) views: [wgpu::TextureView; 3],
}

impl BoundsTargets {
    pub(in crate::render) fn new(gpu: &GpuContext, size: [u32; 2]) -> Self {
        let views = DRAWS.map(|draw| {
            gpu.device
                .create_texture(&wgpu::TextureDescriptor {
                    label: Some(draw.name),
                    size: wgpu::Extent3d {
                        width: size[0],
                        height: size[1],
                        depth_or_array_layers: 1,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: wgpu::TextureFormat::Depth32Float,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                        | wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                })
                .create_view(&wgpu::TextureViewDescriptor::default())
        });
        Self { views }
    }
}

impl BoundsPass {
    pub(in crate::render) fn new(
        gpu: &GpuContext,
        frame: &FrameBindings,
    ) -> Result<Self, GpuError> {
        let module = shader::BOUNDS.compile(gpu)?;
        gpu.checked("building the mesh raster", || {
            let layout = gpu
                .device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some("bounds.pipeline"),
                    bind_group_layouts: &[Some(&frame.layout)],
                    immediate_size: 0,
                });
            let pipeline = |draw: Draw, front_face| {
                gpu.device
                    .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                        label: Some(draw.name),
                        layout: Some(&layout),
                        vertex: wgpu::VertexState {
                            module: &module,
                            entry_point: Some("bounds_vertex"),
                            compilation_options: wgpu::PipelineCompilationOptions::default(),
                            buffers: &[Some(wgpu::VertexBufferLayout {
                                array_stride: size_of::<[u16; 4]>() as u64,
                                step_mode: wgpu::VertexStepMode::Vertex,
                                attributes: &wgpu::vertex_attr_array![0 => Uint16x4],
                            })],
                        },
                        primitive: wgpu::PrimitiveState {
                            cull_mode: Some(draw.cull),
                            front_face,
                            ..Default::default()
                        },
                        depth_stencil: Some(wgpu::DepthStencilState {
                            format: wgpu::TextureFormat::Depth32Float,
                            depth_write_enabled: Some(true),
                            depth_compare: Some(draw.compare),
                            stencil: wgpu::StencilState::default(),
                            bias: wgpu::DepthBiasState::default(),
                        }),
                        multisample: wgpu::MultisampleState::default(),
                        fragment: None,
                        multiview_mask: None,
                        cache: None,
                    })
            };
            Ok(Self {
                pipelines: [wgpu::FrontFace::Ccw, wgpu::FrontFace::Cw]
                    .map(|face| DRAWS.map(|d| pipeline(d, face))),
            })
        })
    }

    /// Draws the mesh three times. `mirrored`: the affine turns counter-clockwise faces clockwise.
    pub(in crate::render) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindings,
        mesh: &MeshBuffers,
        targets: &BoundsTargets,
        mirrored: bool,
        timer: &mut PassTimer,
    ) {
        for ((draw, view), pipeline) in DRAWS
            .iter()
            .zip(&targets.views)
            .zip(&self.pipelines[usize::from(mirrored)])
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some(draw.name),
                color_attachments: &[],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(draw.clear),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                timestamp_writes: timer.render(draw.name),
                occlusion_query_set: None,
                multiview_mask: None,
            });
            if mesh.index_count > 0 {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &frame.group, &[]);
                pass.set_vertex_buffer(0, mesh.vertices.slice(..));
                pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..mesh.index_count, 0, 0..1);
            }
        }
    }
}
