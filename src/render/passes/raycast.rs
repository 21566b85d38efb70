//! The caster: a compute pass, one pipeline per mode and kind of atlas, built when first chosen.

use std::collections::HashMap;

use super::BoundsTargets;
use crate::gpu::{GpuContext, GpuError, shader};
use crate::render::bindings;
use crate::render::frame::FrameBindings;
use crate::render::residency::{AtlasKind, Residency};
use crate::scene::Mode;

/// Pixels of a work-group.
const GROUP: [u32; 2] = [8, 8];

/// The pipelines that were needed so far.
#[derive(Debug)]
pub(in crate::render) struct RaycastPass {
    layout: wgpu::BindGroupLayout,
    pipelines: HashMap<(Mode, AtlasKind), wgpu::ComputePipeline>,
}

/// What a tile is cast into, and from which depths.
#[derive(Debug)]
pub(in crate::render) struct RaycastTargets {
    /// Per pixel, premultiplied RGBA in f32.
    pub(in crate::render) picture: wgpu::Buffer,
    /// Per pixel, samples taken and skipped.
    pub(in crate::render) counts: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl RaycastPass {
    pub(in crate::render) fn new(gpu: &GpuContext) -> Self {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("raycast.layout"),
            entries: bindings::RAYCAST,
        });
        Self { layout, pipelines: HashMap::new() }
    }

    pub(in crate::render) fn targets(
        &self,
        gpu: &GpuContext,
        bounds: &BoundsTargets,
        pixels: u64,
    ) -> RaycastTargets {
        let buffer = |label, size| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let picture = buffer("raycast.picture", pixels * 16);
        let counts = buffer("raycast.counts", pixels * 8);
        let view = |i: usize| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: wgpu::BindingResource::TextureView(&bounds.views[i]),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raycast.group"),
            layout: &self.layout,
            entries: &[
                view(0),
                view(1),
                view(2),
                wgpu::BindGroupEntry { binding: 3, resource: picture.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 4, resource: counts.as_entire_binding() },
            ],
        });
        RaycastTargets { picture, counts, group }
    }

    /// Builds the pipeline of `mode` for this atlas, if it isn't there yet.
    pub(in crate::render) fn prepare(
        &mut self,
        gpu: &GpuContext,
        mode: Mode,
        frame: &FrameBindings,
        volume: &Residency,
    ) -> Result<(), GpuError> {
        let key = (mode, volume.kind());
        if self.pipelines.contains_key(&key) {
            return Ok(());
        }
        let source = match volume.kind() {
            AtlasKind::Filtered => shader::RAYCAST_FILTERED,
            AtlasKind::Float => shader::RAYCAST_FLOAT,
            AtlasKind::Uint => shader::RAYCAST_UINT,
        };
        let module = source.compile(gpu)?;
        let entry_point = match mode {
            Mode::Dvr => "cast_dvr",
            Mode::Iso => "cast_iso",
            Mode::Mip => "cast_mip",
        };
        let pipeline = gpu.checked("building the raycaster", || {
            let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("raycast.pipeline"),
                bind_group_layouts: &[Some(&frame.layout), Some(&volume.layout), Some(&self.layout)],
                immediate_size: 0,
            });
            Ok(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("raycast.pipeline"),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("GROUP_WIDTH", f64::from(GROUP[0])), ("GROUP_HEIGHT", f64::from(GROUP[1]))],
                    ..Default::default()
                },
                cache: None,
            }))
        })?;
        self.pipelines.insert(key, pipeline);
        Ok(())
    }

    /// Casts a tile of `size` pixels. The pipeline must have been prepared.
    pub(in crate::render) fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        mode: Mode,
        frame: &FrameBindings,
        volume: &Residency,
        targets: &RaycastTargets,
        size: [u32; 2],
    ) {
        let pipeline = self.pipelines.get(&(mode, volume.kind())).expect("invariant: prepared before recorded");
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, &volume.group, &[]);
        pass.set_bind_group(2, &targets.group, &[]);
        pass.dispatch_workgroups(size[0].div_ceil(GROUP[0]), size[1].div_ceil(GROUP[1]), 1);
    }
}
