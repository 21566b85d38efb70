//! Technique multipass: a few samples a pass, and between two passes a list of the rays that go on (techniques.md T4.1).
//! Which rays these are only the device knows: lists and sizes of dispatches stay there.

use super::pipeline::ComputeParts;
use super::raycast::{GROUP_CONSTANTS, RaycastPass, RaycastTargets};
use super::{BoundsTargets, ReportPass};
use crate::gpu::{GpuContext, GpuError, shader};
use crate::render::bindings;
use crate::render::frame::FrameBindings;

/// The pipelines.
#[derive(Debug)]
pub(in crate::render) struct CompactPass {
    list_layout: wgpu::BindGroupLayout,
    groups_layout: wgpu::BindGroupLayout,
    begin: wgpu::ComputePipeline,
    rays: wgpu::ComputePipeline,
    end: wgpu::ComputePipeline,
}

/// The lists of a tile.
#[derive(Debug)]
pub(in crate::render) struct CompactTargets {
    /// A pass reads one and writes the other.
    lists: [LiveList; 2],
    /// Work-groups of the list that was made last, for indirect dispatches.
    groups: wgpu::Buffer,
    groups_group: wgpu::BindGroup,
}

#[derive(Debug)]
struct LiveList {
    /// To write it.
    written: wgpu::BindGroup,
    /// To make the next one from it.
    read: wgpu::BindGroup,
    /// To cast its rays.
    cast: wgpu::BindGroup,
}

impl CompactTargets {
    /// Bytes per pixel of a tile: a place in either list.
    pub(in crate::render) const BYTES_PER_PIXEL: u64 = 8;

    pub(in crate::render) fn new(
        gpu: &GpuContext,
        (pass, report, raycast): (&CompactPass, &ReportPass, &RaycastPass),
        bounds: &BoundsTargets,
        targets: &RaycastTargets,
        feedback: &wgpu::Buffer,
        pixels: u64,
    ) -> Self {
        let list = || {
            let texture = RaycastTargets::list_texture(
                gpu,
                "compact.live_list",
                pixels,
                wgpu::TextureUsages::STORAGE_BINDING,
            );
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            LiveList {
                written: gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("compact.live_list"),
                    layout: &pass.list_layout,
                    entries: &[wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::TextureView(&view),
                    }],
                }),
                read: report.group(gpu, targets, feedback, &view),
                cast: raycast.group(gpu, bounds, targets, feedback, &view),
            }
        };
        let groups = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("compact.live_groups"),
            size: 12,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT,
            mapped_at_creation: false,
        });
        Self {
            lists: [list(), list()],
            groups_group: gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("compact.live_groups"),
                layout: &pass.groups_layout,
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: groups.as_entire_binding(),
                }],
            }),
            groups,
        }
    }
}

impl CompactPass {
    pub(in crate::render) fn new(
        gpu: &GpuContext,
        frame: &FrameBindings,
        report: &ReportPass,
    ) -> Result<Self, GpuError> {
        let layout = |label, entries| {
            gpu.device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries,
                })
        };
        let list_layout = layout("compact.list_layout", bindings::LIVE_LIST);
        let groups_layout = layout("compact.groups_layout", bindings::LIVE_GROUPS);
        let module = shader::COMPACT.compile(gpu)?;
        let pipeline = |entry, layouts: &[&wgpu::BindGroupLayout]| {
            ComputeParts {
                label: "compact.pipeline",
                doing: "building the compaction of rays",
                module: &module,
                entry,
                layouts,
                constants: &GROUP_CONSTANTS,
                zero_workgroup_memory: true,
            }
            .build(gpu)
        };
        // The buffer of an indirect dispatch can't be bound to be written in that dispatch: only the last one binds it.
        let listing = [&frame.layout, &report.layout, &list_layout];
        let ending = [&frame.layout, &report.layout, &list_layout, &groups_layout];
        Ok(Self {
            begin: pipeline("compact_begin", &listing)?,
            rays: pipeline("compact_rays", &listing)?,
            end: pipeline("compact_end", &ending)?,
            list_layout,
            groups_layout,
        })
    }

    /// `rounds` times: lists the rays that go on, and has them cast. The first list is made from the rays of `groups`
    /// work-groups, which the feedback buffer lists. `bind` binds the caster with a group 2.
    pub(in crate::render) fn record<'p>(
        &self,
        pass: &mut wgpu::ComputePass<'p>,
        frame: &FrameBindings,
        host_group: &wgpu::BindGroup,
        targets: &CompactTargets,
        (groups, rounds): (u32, u32),
        bind: impl Fn(&mut wgpu::ComputePass<'p>, &wgpu::BindGroup),
    ) {
        for round in 0..rounds {
            let [from, to] = [round + 1, round].map(|r| &targets.lists[r as usize % 2]);
            let is_first = round == 0;
            pass.set_pipeline(if is_first { &self.begin } else { &self.rays });
            pass.set_bind_group(0, &frame.group, &[]);
            pass.set_bind_group(1, if is_first { host_group } else { &from.read }, &[]);
            pass.set_bind_group(2, &to.written, &[]);
            if is_first {
                pass.dispatch_workgroups(groups, 1, 1);
            } else {
                pass.dispatch_workgroups_indirect(&targets.groups, 0);
            }
            pass.set_pipeline(&self.end);
            pass.set_bind_group(3, &targets.groups_group, &[]);
            pass.dispatch_workgroups(1, 1, 1);
            bind(pass, &to.cast);
            pass.dispatch_workgroups_indirect(&targets.groups, 0);
        }
    }
}
