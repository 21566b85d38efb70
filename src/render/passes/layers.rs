//! Technique layers, before its passes: the most samples that rays have still to take, per cell of 16×16 pixels
//! (techniques.md T3.3).

use std::collections::HashMap;

use super::pipeline::ComputeParts;
use super::raycast::{GROUP_CONSTANTS, panorama};
use super::{BoundsTargets, ReportPass};
use crate::camera::Projection;
use crate::gpu::layout::CELL_EDGE;
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers, shader};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, FrameInputs};
use crate::scene::Jitter;

/// What a pipeline is built for: rays as the caster has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Variant {
    jittered: bool,
    orthographic: bool,
    panorama: u32,
    many_levels: bool,
}

impl Variant {
    fn new(inputs: &FrameInputs<'_>) -> Self {
        Self {
            jittered: inputs.settings.jitter == Jitter::Interleaved,
            orthographic: inputs.settings.camera.projection == Projection::Orthographic,
            panorama: panorama(inputs.settings.camera.projection),
            many_levels: inputs.rays.used_levels > 1,
        }
    }
}

/// The pipelines that were needed so far.
#[derive(Debug)]
pub(in crate::render) struct LayersPass {
    layout: wgpu::BindGroupLayout,
    depth_sampler: wgpu::Sampler,
    module: wgpu::ShaderModule,
    pipelines: HashMap<Variant, wgpu::ComputePipeline>,
}

/// The counts of a tile's cells.
#[derive(Debug)]
pub(in crate::render) struct LayersTargets {
    cells: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl LayersTargets {
    /// Bytes per pixel of a tile, at most: a number per cell, and its copy.
    pub(in crate::render) const BYTES_PER_PIXEL: u64 = 1;

    /// Cells along both axes of a tile of `size` pixels.
    pub(in crate::render) fn cells(size: [u32; 2]) -> [u32; 2] {
        size.map(|s| s.div_ceil(CELL_EDGE))
    }
}

impl LayersPass {
    pub(in crate::render) fn new(gpu: &GpuContext) -> Result<Self, GpuError> {
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("layers.layout"),
                entries: bindings::LAYERS,
            });
        let depth_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("layers.depth_sampler"),
            ..Default::default()
        });
        Ok(Self {
            layout,
            depth_sampler,
            module: shader::LAYERS.compile(gpu)?,
            pipelines: HashMap::new(),
        })
    }

    /// Builds the pipeline for these settings, if it isn't there yet.
    pub(in crate::render) fn prepare(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        report: &ReportPass,
    ) -> Result<(), GpuError> {
        let variant = Variant::new(inputs);
        if self.pipelines.contains_key(&variant) {
            return Ok(());
        }
        let flag = |name, is_set: bool| (name, f64::from(u8::from(is_set)));
        let mut constants = GROUP_CONSTANTS.to_vec();
        constants.extend([
            flag("JITTERED", variant.jittered),
            flag("ORTHOGRAPHIC", variant.orthographic),
            ("PANORAMA", f64::from(variant.panorama)),
            flag("MANY_LEVELS", variant.many_levels),
        ]);
        let pipeline = ComputeParts {
            label: "layers.pipeline",
            doing: "building the count of layers",
            module: &self.module,
            entry: "measure_layers",
            layouts: &[&frame.layout, &report.layout, &self.layout],
            constants: &constants,
            zero_workgroup_memory: true,
        }
        .build(gpu)?;
        self.pipelines.insert(variant, pipeline);
        Ok(())
    }

    pub(in crate::render) fn targets(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        tile: [u32; 2],
    ) -> LayersTargets {
        let [wide, high] = LayersTargets::cells(tile).map(u64::from);
        let cells = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("layers.cells"),
            size: wide * high * 4,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let view = |i: usize| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: wgpu::BindingResource::TextureView(&bounds.views[i]),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("layers.group"),
            layout: &self.layout,
            entries: &[
                view(0),
                view(1),
                view(2),
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::Sampler(&self.depth_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: cells.as_entire_binding(),
                },
            ],
        });
        LayersTargets { cells, group }
    }

    /// The counts of the tile's cells, row by row: the most samples that an unfinished ray of `groups` work-groups, which the
    /// feedback buffer lists, has still to take. Waits for them. The pipeline must have been prepared.
    ///
    /// # Errors
    /// The device is lost.
    pub(in crate::render) fn measure(
        &self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        (host_group, targets): (&wgpu::BindGroup, &LayersTargets),
        groups: u32,
        timer: &mut PassTimer,
    ) -> Result<Vec<u32>, GpuError> {
        let pipeline = self
            .pipelines
            .get(&Variant::new(inputs))
            .expect("invariant: prepared before recorded");
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("layers.measure"),
            });
        encoder.clear_buffer(&targets.cells, 0, None);
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("layers.measure"),
                timestamp_writes: timer.compute("layers"),
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &frame.group, &[]);
            pass.set_bind_group(1, host_group, &[]);
            pass.set_bind_group(2, &targets.group, &[]);
            pass.dispatch_workgroups(groups, 1, 1);
        }
        gpu.queue.submit([encoder.finish()]);
        let [bytes] = read_buffers(gpu, [(&targets.cells, 0, targets.cells.size())])?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}
