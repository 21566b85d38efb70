//! Leaping: where the rays of a frame start, from where those of the frame before were empty (techniques.md T2.2). The frame
//! before leaves a point per pixel; a pass turns them into starts for the rays of this frame's camera.

use glam::{DMat3, DVec3};

use super::pipeline::ComputeParts;
use crate::camera::Projection;
use crate::gpu::layout::LeapUniforms;
use crate::gpu::{GpuContext, GpuError, PassTimer, shader};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, FrameInputs, Tile, leap_back_mm, padded};
use crate::scene::{PictureSettings, RayFrame};

/// Longer lines in the picture before, in pixels, are not followed: nothing is won where nearly all has moved.
const MOST_PIXELS: f32 = 64.0;

/// Pixels of a work-group along either axis.
const GROUP_EDGE: u32 = 8;

/// What leaping does wrong on purpose, for tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeapFault {
    /// Points are the samples that first met something: neither the ones before, nor moved back.
    NotMovedBack,
    /// Of the line in the picture before, only the pixels around its middle are looked at.
    OnePixel,
    /// Points of another picture are used.
    KeepsPoints,
}

/// What must be as it was when points were written.
#[derive(Clone, Debug, PartialEq)]
struct Origin {
    /// The camera is nowhere.
    settings: PictureSettings,
    /// Bricks that came and bricks that went since the volume was opened: another stand-in may show something nearer.
    bricks: [u64; 2],
}

/// The pipelines, by projection.
#[derive(Debug)]
pub(in crate::render) struct LeapPass {
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    pipelines: [wgpu::ComputePipeline; 2],
}

/// Points and starts.
#[derive(Debug)]
pub(in crate::render) struct LeapTargets {
    /// Of the frame that is drawn, and of the one before.
    points: wgpu::Texture,
    old_points: wgpu::Texture,
    /// Per pixel of the tile.
    pub(in crate::render) starts: wgpu::TextureView,
    uniforms: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// Of what `points` are.
    written: Option<(Origin, RayFrame)>,
}

impl LeapTargets {
    /// Bytes for a picture of `size` pixels in tiles of `tile`.
    pub(in crate::render) fn bytes(size: [u32; 2], tile: [u32; 2]) -> u64 {
        let pixels = |of: [u32; 2]| u64::from(of[0]) * u64::from(of[1]);
        8 * pixels(size) + 4 * pixels(tile) + size_of::<LeapUniforms>() as u64
    }

    /// Width and height of the picture.
    pub(in crate::render) fn size(&self) -> [u32; 2] {
        [self.points.width(), self.points.height()]
    }

    /// What the caster writes.
    pub(in crate::render) fn points(&self) -> wgpu::TextureView {
        self.points
            .create_view(&wgpu::TextureViewDescriptor::default())
    }

    /// Begins a frame: true if its rays may start where the frame before allows it; otherwise they start at the volume.
    pub(in crate::render) fn begin(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        bricks: [u64; 2],
        fault: Option<LeapFault>,
    ) -> bool {
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("leap.begin"),
            });
        let origin = Origin {
            settings: inputs.settings.without_place(),
            bricks,
        };
        let old = self.written.take().filter(|(old, rays)| {
            (*old == origin || fault == Some(LeapFault::KeepsPoints))
                && rays.levels[0].lod == inputs.rays.levels[0].lod
                && line_pixels(rays, inputs.rays) <= f64::from(MOST_PIXELS)
        });
        if let Some((_, rays)) = &old {
            encoder.copy_texture_to_texture(
                self.points.as_image_copy(),
                self.old_points.as_image_copy(),
                self.points.size(),
            );
            let mut uniforms = leap_uniforms(rays, inputs.rays);
            match fault {
                Some(LeapFault::NotMovedBack) => {
                    let moved_mm = leap_back_mm(inputs.rays, 0) + inputs.rays.step_mm_exact;
                    uniforms.forward_mm = moved_mm as f32;
                }
                Some(LeapFault::OnePixel) => uniforms.most_pieces = 1.0,
                Some(LeapFault::KeepsPoints) | None => (),
            }
            gpu.queue
                .write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        } else {
            // All starts 0.
            encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("leap.clear"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &self.starts,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
        }
        gpu.queue.submit([encoder.finish()]);
        old.is_some()
    }

    /// The frame is drawn: the next one may use its points.
    pub(in crate::render) fn end(&mut self, inputs: &FrameInputs<'_>, bricks: [u64; 2]) {
        let origin = Origin {
            settings: inputs.settings.without_place(),
            bricks,
        };
        self.written = Some((origin, inputs.rays.clone()));
    }
}

impl LeapPass {
    pub(in crate::render) fn new(
        gpu: &GpuContext,
        frame: &FrameBindings,
    ) -> Result<Self, GpuError> {
        let module = shader::LEAP.compile(gpu)?;
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("leap.layout"),
                entries: bindings::LEAP,
            });
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("leap.sampler"),
            ..Default::default()
        });
        let pipeline = |orthographic: f64| {
            ComputeParts {
                label: "leap.pipeline",
                doing: "building the pass that finds starts",
                module: &module,
                entry: "find_starts",
                layouts: &[&frame.layout, &layout],
                constants: &[("ORTHOGRAPHIC", orthographic)],
                zero_workgroup_memory: true,
            }
            .build(gpu)
        };
        let pipelines = [pipeline(0.0)?, pipeline(1.0)?];
        Ok(Self {
            layout,
            sampler,
            pipelines,
        })
    }

    /// Textures for pictures of `size` pixels in tiles of `tile`.
    pub(in crate::render) fn targets(
        &self,
        gpu: &GpuContext,
        size: [u32; 2],
        tile: [u32; 2],
    ) -> LeapTargets {
        let texture = |label, size: [u32; 2], usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R32Float,
                usage,
                view_formats: &[],
            })
        };
        let written = wgpu::TextureUsages::STORAGE_BINDING;
        let read = wgpu::TextureUsages::TEXTURE_BINDING;
        let points = texture("leap.points", size, written | wgpu::TextureUsages::COPY_SRC);
        let old_points = texture(
            "leap.old_points",
            size,
            read | wgpu::TextureUsages::COPY_DST,
        );
        let starts = texture(
            "leap.starts",
            tile,
            written | read | wgpu::TextureUsages::RENDER_ATTACHMENT,
        )
        .create_view(&wgpu::TextureViewDescriptor::default());
        let uniforms = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("leap.uniforms"),
            size: size_of::<LeapUniforms>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let old_view = old_points.create_view(&wgpu::TextureViewDescriptor::default());
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("leap.group"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: uniforms.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&old_view),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::TextureView(&starts),
                },
            ],
        });
        LeapTargets {
            points,
            old_points,
            starts,
            uniforms,
            group,
            written: None,
        }
    }

    /// Finds the starts of a tile, whose uniforms have been written.
    pub(in crate::render) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindings,
        targets: &LeapTargets,
        (projection, tile): (Projection, &Tile),
        timer: &mut PassTimer,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("leap"),
            timestamp_writes: timer.compute("leap"),
        });
        let is_orthographic = projection == Projection::Orthographic;
        pass.set_pipeline(&self.pipelines[usize::from(is_orthographic)]);
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, &targets.group, &[]);
        let [wide, high] = tile.part_size.map(|s| s.div_ceil(GROUP_EDGE));
        pass.dispatch_workgroups(wide, high, 1);
    }
}

/// The rays of `new` in the view of `old`.
fn leap_uniforms(old: &RayFrame, new: &RayFrame) -> LeapUniforms {
    let old_from_world = old.world_from_view.inverse();
    let [half_width, half_height] = new.half_extent;
    let turned: DMat3 = old_from_world.matrix3 * new.world_from_view.matrix3;
    let eye = old_from_world.transform_point3(new.world_from_view.translation);
    let across = [turned.x_axis * half_width, turned.y_axis * half_height];
    let forward = -turned.z_axis;
    let (origin, direction) = match new.projection {
        Projection::Perspective | Projection::Fisheye | Projection::Equirectangular => (
            [eye, DVec3::ZERO, DVec3::ZERO],
            [forward, across[0], across[1]],
        ),
        Projection::Orthographic => (
            [eye, across[0], across[1]],
            [forward, DVec3::ZERO, DVec3::ZERO],
        ),
    };
    LeapUniforms {
        origin: origin.map(|v| padded(v.as_vec3())),
        direction: direction.map(|v| padded(v.as_vec3())),
        half_extent: old.half_extent.map(|h| h as f32),
        near_mm: old.near_mm,
        most_pieces: MOST_PIXELS,
        one_level_mm: one_level_mm(old).min(one_level_mm(new)) as f32,
        ..LeapUniforms::default()
    }
}

/// Up to which distance from the eye only the finest level is sampled, mm. Beyond it a place may be of another level in the
/// next frame, which shows what this one does not.
fn one_level_mm(rays: &RayFrame) -> f64 {
    match rays.used().get(1) {
        Some(next) => rays.reach_mm(next)[0],
        None => f64::from(f32::MAX),
    }
}

/// How long, in pixels, the part of a ray of `new` inside the volume's bounding sphere is in the picture of `old`, at most.
/// Infinite where the eye is inside.
fn line_pixels(old: &RayFrame, new: &RayFrame) -> f64 {
    let near_mm = new.first_mm_exact.max(f64::from(new.near_mm));
    let far_mm = new.first_mm_exact + f64::from(new.last_index) * new.step_mm_exact;
    let [half_width, half_height] = old.half_extent;
    let pixels_per_unit = f64::from(old.size[1]) / (2.0 * half_height);
    match new.projection {
        // Panoramas don't leap.
        Projection::Perspective | Projection::Fisheye | Projection::Equirectangular => {
            let moved_mm =
                (new.world_from_view.translation).distance(old.world_from_view.translation);
            if moved_mm == 0.0 {
                return 0.0;
            }
            // Seen from the old eye, a point at distance r of the new one is turned by no more than moved / r; pixels are
            // densest at the corners of the picture.
            let corner = 1.0 + half_width * half_width + half_height * half_height;
            moved_mm * (1.0 / near_mm - 1.0 / far_mm) * pixels_per_unit * corner
        }
        Projection::Orthographic => {
            let [a, b] = [old, new].map(|r| r.world_from_view.matrix3.z_axis);
            a.cross(b).length() * (far_mm - near_mm) * pixels_per_unit
        }
    }
}
