//! What the device could do at most: the samples of a picture from one dense texture, without bricks, without skipping,
//! to the end of every ray. Draws nothing that anybody sees; `bench` holds the caster against it.

use glam::{UVec2, UVec3};

use super::pipeline::ComputeParts;
use crate::gpu::layout::{FrameUniforms, MAX_LEVELS};
use crate::gpu::shader::AtlasPart;
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers, shader};
use crate::render::bindings;
use crate::render::frame::{FrameBindings, FrameInputs, padded, ray_uniforms};
use crate::render::residency::{AtlasFormat, SampleFilter, atlas_sampler, atlas_view};
use crate::volume::StoredType;

/// Pixels of a work-group: as the caster's.
const GROUP: [u32; 2] = [8, 8];
/// Samples of a dispatch at most: watchdogs never fire.
const DISPATCH_SAMPLES: u64 = 1 << 28;
/// Dispatches of a picture whose times are kept.
const TIMED_PASSES: u32 = 1024;

/// One level of a volume in one texture, for one filter.
#[derive(Debug)]
pub struct DenseLevel {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    voxels: UVec3,
    voxel_bytes: u32,
    format: AtlasFormat,
}

impl DenseLevel {
    /// A level of `voxels`, all 0, to be read by `filter`. `None` where an axis is longer than the device's textures, or
    /// the device has no such filter for the type.
    ///
    /// # Errors
    /// The device has not the memory.
    pub fn new(
        gpu: &GpuContext,
        stored: StoredType,
        filter: SampleFilter,
        voxels: UVec3,
    ) -> Result<Option<Self>, GpuError> {
        let format = AtlasFormat::new(stored, filter, &gpu.caps);
        if filter == SampleFilter::Hardware && format.kind != AtlasPart::Filtered {
            return Ok(None);
        }
        let limits = &gpu.caps.limits;
        let most = match format.dimension() {
            wgpu::TextureDimension::D3 => UVec3::splat(limits.max_texture_dimension_3d),
            _ => UVec2::splat(limits.max_texture_dimension_2d)
                .extend(limits.max_texture_array_layers),
        };
        if voxels.cmpgt(most).any() {
            return Ok(None);
        }
        let texture = gpu.checked("allocating a dense level", || {
            Ok(gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("bare.dense"),
                size: extent(voxels),
                mip_level_count: 1,
                sample_count: 1,
                dimension: format.dimension(),
                format: format.format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            }))
        })?;
        Ok(Some(Self {
            view: atlas_view(&texture),
            texture,
            voxels,
            voxel_bytes: stored.size() as u32,
            format,
        }))
    }

    /// Writes whole slices from `first_z` on: stored voxels, x fastest. Waits until they are there, so that no more than
    /// these bytes are ever staged.
    ///
    /// # Errors
    /// The device is lost or has not the memory.
    pub fn write_slices(
        &self,
        gpu: &GpuContext,
        first_z: u32,
        bytes: &[u8],
    ) -> Result<(), GpuError> {
        let row = self.voxels.x * self.voxel_bytes;
        let slices = bytes.len() as u64 / (u64::from(row) * u64::from(self.voxels.y));
        gpu.checked("uploading a dense level", || {
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &self.texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: 0,
                        z: first_z,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                bytes,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: Some(self.voxels.y),
                },
                extent(UVec3::new(self.voxels.x, self.voxels.y, slices as u32)),
            );
            gpu.queue.submit([]);
            gpu.wait()
        })
    }
}

fn extent(size: UVec3) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width: size.x,
        height: size.y,
        depth_or_array_layers: size.z,
    }
}

/// The pipeline that casts one level, and where it writes.
#[derive(Debug)]
pub struct BareCaster {
    frame: FrameBindings,
    pipeline: wgpu::ComputePipeline,
    volume: wgpu::BindGroup,
    targets: wgpu::BindGroup,
    counts: wgpu::Buffer,
    picture_size: [u32; 2],
    texture_from_level: [f32; 4],
    value_scale: f32,
    timer: PassTimer,
}

impl BareCaster {
    /// Bytes on the device for pictures of `size`.
    pub fn bytes(size: [u32; 2]) -> u64 {
        u64::from(size[0]) * u64::from(size[1]) * (16 + 4 + 4)
    }

    /// The caster of `dense`, which is number `level` among the levels of the frames to come.
    ///
    /// # Errors
    /// The device refuses the shader or has not the memory.
    pub fn new(
        gpu: &GpuContext,
        dense: &DenseLevel,
        level: usize,
        size: [u32; 2],
    ) -> Result<Self, GpuError> {
        let format = dense.format;
        let entries = bindings::volume_of(format.kind);
        let source = match format.kind {
            AtlasPart::Filtered => shader::BARE_FILTERED,
            AtlasPart::Float => shader::BARE_FLOAT,
            AtlasPart::Uint => shader::BARE_UINT,
        };
        let module = source.compile(gpu)?;
        let frame = FrameBindings::new(gpu, MAX_LEVELS as usize);
        gpu.checked("allocating what the bare caster needs", || {
            let device = &gpu.device;
            let layout = |label, entries| {
                device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries,
                })
            };
            let volume_layout = layout("bare.volume", entries);
            let targets_layout = layout("bare.targets", bindings::BARE);
            let pixels = u64::from(size[0]) * u64::from(size[1]);
            let picture = storage(gpu, "bare.picture", pixels * 16);
            let counts = storage(gpu, "bare.counts", pixels * 4);
            let targets = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("bare.targets"),
                layout: &targets_layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: picture.as_entire_binding(),
                    },
                    wgpu::BindGroupEntry {
                        binding: 1,
                        resource: counts.as_entire_binding(),
                    },
                ],
            });
            let pipeline = ComputeParts {
                label: "bare.pipeline",
                doing: "building the bare caster",
                module: &module,
                entry: "cast_bare",
                layouts: &[&frame.layout, &volume_layout, &targets_layout],
                constants: &[
                    ("GROUP_WIDTH", f64::from(GROUP[0])),
                    ("GROUP_HEIGHT", f64::from(GROUP[1])),
                    ("LEVEL", level as f64),
                ],
                zero_workgroup_memory: true,
            }
            .build(gpu)?;
            Ok(Self {
                volume: volume_group(gpu, &volume_layout, dense),
                texture_from_level: padded(1.0 / dense.voxels.as_vec3()),
                value_scale: format.value_scale,
                timer: PassTimer::new(gpu, TIMED_PASSES),
                picture_size: size,
                frame,
                pipeline,
                targets,
                counts,
            })
        })
    }

    /// Casts the picture of `inputs`, and waits until it is there.
    ///
    /// # Errors
    /// The device is lost.
    pub fn cast(&mut self, gpu: &GpuContext, inputs: &FrameInputs<'_>) -> Result<(), GpuError> {
        let [width, height] = self.picture_size;
        self.frame.write_tables(gpu, inputs.classified)?;
        let row_samples = u64::from(width) * (u64::from(inputs.rays.last_index) + 1);
        let rows = (DISPATCH_SAMPLES / row_samples).clamp(u64::from(GROUP[1]), u64::from(height));
        // Whole work-groups.
        let rows = (rows as u32).next_multiple_of(GROUP[1]).min(height);
        for first_row in (0..height).step_by(rows as usize) {
            let part_size = [width, rows.min(height - first_row)];
            let uniforms = FrameUniforms {
                texture_from_atlas: self.texture_from_level,
                value_scale: self.value_scale,
                tile_origin: [0, first_row],
                tile_size: part_size,
                part_size,
                ..ray_uniforms(inputs)
            };
            self.frame.write_uniforms(gpu, &uniforms);
            let mut encoder = gpu
                .device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                    label: Some("bare.cast"),
                });
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("bare.cast"),
                    timestamp_writes: self.timer.compute("bare"),
                });
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, &self.frame.group, &[]);
                pass.set_bind_group(1, &self.volume, &[]);
                pass.set_bind_group(2, &self.targets, &[]);
                pass.dispatch_workgroups(
                    part_size[0].div_ceil(GROUP[0]),
                    part_size[1].div_ceil(GROUP[1]),
                    1,
                );
            }
            gpu.queue.submit([encoder.finish()]);
        }
        gpu.wait()
    }

    /// Samples of the last picture.
    ///
    /// # Errors
    /// The device is lost.
    pub fn samples(&self, gpu: &GpuContext) -> Result<u64, GpuError> {
        let [bytes] = read_buffers(gpu, [(&self.counts, 0, self.counts.size())])?;
        let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(counts.into_iter().map(u64::from).sum())
    }

    /// Milliseconds of the casts since the last call, by the device's timestamps; `None` without.
    ///
    /// # Errors
    /// The device is lost.
    pub fn take_gpu_ms(&mut self, gpu: &GpuContext) -> Result<Option<f64>, GpuError> {
        Ok(self.timer.read(gpu)?.map(|passes| passes.values().sum()))
    }
}

fn storage(gpu: &GpuContext, label: &str, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}

/// Group 1 with the dense level as the only atlas texture; the bare caster reads no table, but they are in the layout.
fn volume_group(
    gpu: &GpuContext,
    layout: &wgpu::BindGroupLayout,
    dense: &DenseLevel,
) -> wgpu::BindGroup {
    let unused_texture = |format, dimension| {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("bare.unused"),
            size: extent(UVec3::ONE),
            mip_level_count: 1,
            sample_count: 1,
            dimension,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        atlas_view(&texture)
    };
    let other_atlas = unused_texture(dense.format.format, dense.format.dimension());
    let page_table = unused_texture(wgpu::TextureFormat::R32Uint, wgpu::TextureDimension::D3);
    let table = storage(gpu, "bare.unused", 16);
    let sampler = atlas_sampler(gpu, dense.format.kind);
    let texture = |binding, view| wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::TextureView(view),
    };
    let buffer = |binding| wgpu::BindGroupEntry {
        binding,
        resource: table.as_entire_binding(),
    };
    let entries = [
        texture(0, &dense.view),
        wgpu::BindGroupEntry {
            binding: 1,
            resource: wgpu::BindingResource::Sampler(&sampler),
        },
        texture(2, &page_table),
        buffer(3),
        buffer(4),
        buffer(5),
        texture(6, &other_atlas),
        texture(7, &other_atlas),
        texture(8, &other_atlas),
        buffer(9),
    ];
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("bare.volume"),
        layout,
        entries: &entries,
    })
}
