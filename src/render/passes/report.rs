//! Which rays are not finished, told once after the several passes of a submission.

use super::pipeline::ComputeParts;
use super::raycast::{GROUP_CONSTANTS, RaycastTargets};
use crate::gpu::{GpuContext, GpuError, shader};
use crate::render::bindings;
use crate::render::frame::FrameBindings;

/// The pipeline, and what all passes bind that look at rays and sample nothing.
#[derive(Debug)]
pub(in crate::render) struct ReportPass {
    pub(super) layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl ReportPass {
    pub(in crate::render) fn new(
        gpu: &GpuContext,
        frame: &FrameBindings,
    ) -> Result<Self, GpuError> {
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("report.layout"),
                entries: bindings::RAYS,
            });
        let pipeline = ComputeParts {
            label: "report.pipeline",
            doing: "building the report of rays",
            module: &shader::REPORT.compile(gpu)?,
            entry: "report_rays",
            layouts: &[&frame.layout, &layout],
            constants: &GROUP_CONSTANTS,
            zero_workgroup_memory: true,
        }
        .build(gpu)?;
        Ok(Self { layout, pipeline })
    }

    /// Group 1 of the passes that look at rays, with a list of pixels.
    pub(super) fn group(
        &self,
        gpu: &GpuContext,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
        list: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("report.group"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: targets.rays().as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: feedback.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(list),
                },
            ],
        })
    }

    /// The same with the host's list.
    pub(in crate::render) fn host_group(
        &self,
        gpu: &GpuContext,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        self.group(gpu, targets, feedback, &targets.list_view())
    }

    /// Tells of the rays of `groups` work-groups, which the feedback buffer lists.
    pub(in crate::render) fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        frame: &FrameBindings,
        host_group: &wgpu::BindGroup,
        groups: u32,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &frame.group, &[]);
        pass.set_bind_group(1, host_group, &[]);
        pass.dispatch_workgroups(groups, 1, 1);
    }
}
