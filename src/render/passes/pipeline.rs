//! Compute pipelines, from what differs between them.

use crate::gpu::{GpuContext, GpuError};

/// What a compute pipeline is made of.
pub(super) struct ComputeParts<'a> {
    pub(super) label: &'static str,
    /// For the message when the device refuses it.
    pub(super) doing: &'static str,
    pub(super) module: &'a wgpu::ShaderModule,
    pub(super) entry: &'static str,
    /// Of the bind groups, in order.
    pub(super) layouts: &'a [&'a wgpu::BindGroupLayout],
    /// Values of the shader's `override`s.
    pub(super) constants: &'a [(&'a str, f64)],
    /// Does workgroup memory begin as zeros?
    pub(super) zero_workgroup_memory: bool,
}

impl ComputeParts<'_> {
    /// # Errors
    /// The device refuses the pipeline.
    pub(super) fn build(&self, gpu: &GpuContext) -> Result<wgpu::ComputePipeline, GpuError> {
        gpu.checked(self.doing, || {
            let layouts: Vec<_> = self.layouts.iter().map(|&layout| Some(layout)).collect();
            let layout = gpu
                .device
                .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(self.label),
                    bind_group_layouts: &layouts,
                    immediate_size: 0,
                });
            Ok(gpu
                .device
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(self.label),
                    layout: Some(&layout),
                    module: self.module,
                    entry_point: Some(self.entry),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: self.constants,
                        zero_initialize_workgroup_memory: self.zero_workgroup_memory,
                    },
                    cache: None,
                }))
        })
    }
}
