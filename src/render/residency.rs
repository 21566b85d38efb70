//! Bind group 1: what of the volume is on the GPU. Applies the pager's plans to atlas and page table.

use std::collections::HashMap;

use glam::UVec3;

use crate::geom::{BrickGrid, BrickId, Lod, STORED_EDGE};
use crate::gpu::layout::{BRICK_EMPTY, BRICK_FULL, BRICK_MIXED, TAG_CONSTANT, TAG_SHIFT, TAG_SLOT};
use crate::gpu::{Caps, GpuContext, GpuError, Staging};
use crate::pager::{ActiveBricks, AtlasShape, LevelScan, PageTablePatch, SlotId, Upload};
use crate::volume::StoredType;

use super::bindings;

/// How values between voxels are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleFilter {
    /// Eight texel loads, interpolated in f32: as the CPU reference does it.
    #[default]
    Exact,
    /// The hardware's linear filter, with the hardware's coarse weights.
    Hardware,
}

/// Which shader reads the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum AtlasKind {
    Filtered,
    Float,
    Uint,
}

/// Format, shader and scale for a voxel type on a device.
#[derive(Clone, Copy, Debug)]
struct AtlasFormat {
    format: wgpu::TextureFormat,
    kind: AtlasKind,
    /// Stored value of a texel of 1.
    value_scale: f32,
}

impl AtlasFormat {
    fn new(stored: StoredType, filter: SampleFilter, caps: &Caps) -> Self {
        let (format, filterable, value_scale) = match stored {
            StoredType::U8 => (wgpu::TextureFormat::R8Unorm, true, 255.0),
            StoredType::U16 if caps.unorm16 => (wgpu::TextureFormat::R16Unorm, true, 65535.0),
            StoredType::U16 => {
                return Self {
                    format: wgpu::TextureFormat::R16Uint,
                    kind: AtlasKind::Uint,
                    value_scale: 1.0,
                };
            }
            StoredType::F32 => (wgpu::TextureFormat::R32Float, caps.float32_filterable, 1.0),
        };
        let kind = if filter == SampleFilter::Hardware && filterable {
            AtlasKind::Filtered
        } else {
            AtlasKind::Float
        };
        Self {
            format,
            kind,
            value_scale,
        }
    }
}

/// The words of the page table that the level in use needs.
#[derive(Clone, Copy, Debug)]
pub struct LevelState<'a> {
    /// The level drawn.
    pub lod: Lod,
    /// Its constant bricks.
    pub scan: &'a LevelScan,
    /// What of it is active.
    pub active: &'a ActiveBricks,
}

/// Atlas, page table, occupancy.
#[derive(Debug)]
pub struct Residency {
    shape: AtlasShape,
    format: AtlasFormat,
    voxel_bytes: u32,
    grids: Vec<BrickGrid>,
    lod: Lod,
    atlas: wgpu::Texture,
    indirection: wgpu::Texture,
    indirection_size: UVec3,
    /// The host's copy of the indirection texture.
    words: Vec<u32>,
    constants: wgpu::Buffer,
    activity: wgpu::Buffer,
    occupancy: wgpu::Buffer,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) group: wgpu::BindGroup,
}

/// Texels of the indirection texture: levels side by side along x.
fn indirection_size(grids: &[BrickGrid]) -> UVec3 {
    grids.iter().fold(UVec3::ZERO, |size, g| {
        UVec3::new(
            size.x + g.bricks.x,
            size.y.max(g.bricks.y),
            size.z.max(g.bricks.z),
        )
    })
}

impl Residency {
    /// Bytes on the GPU beside the atlas, for stores of these levels and an atlas of `slots` slots.
    pub fn table_bytes(grids: &[BrickGrid], slots: u64) -> u64 {
        let s = indirection_size(grids);
        let bricks = grids.iter().map(BrickGrid::len).max().unwrap_or(0);
        u64::from(s.x) * u64::from(s.y) * u64::from(s.z) * 4 + bricks / 4 + bricks * 4 + slots * 64
    }

    /// An empty atlas of `shape` for voxels of `stored` type.
    ///
    /// # Errors
    /// The device has not the memory, or the page table is larger than its textures can be.
    pub fn new(
        gpu: &GpuContext,
        stored: StoredType,
        filter: SampleFilter,
        shape: AtlasShape,
        grids: Vec<BrickGrid>,
    ) -> Result<Self, GpuError> {
        let size = indirection_size(&grids);
        let max_edge = gpu.caps.limits.max_texture_dimension_3d;
        if size.max_element() > max_edge {
            return Err(GpuError::TooSmall {
                what: format!("a page table of {}×{}×{} bricks", size.x, size.y, size.z),
                needed: u64::from(size.max_element()),
                limit: u64::from(max_edge),
                limited_by: "the edge of the adapter's 3D textures".into(),
                remedy: "render with --device cpu".into(),
            });
        }
        let format = AtlasFormat::new(stored, filter, &gpu.caps);
        gpu.checked("allocating the atlas", || {
            let device = &gpu.device;
            let texture = |label, size: UVec3, format| {
                device.create_texture(&wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d {
                        width: size.x,
                        height: size.y,
                        depth_or_array_layers: size.z,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D3,
                    format,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                    view_formats: &[],
                })
            };
            let atlas = texture("residency.atlas", shape.texels, format.format);
            let indirection = texture("residency.indirection", size, wgpu::TextureFormat::R32Uint);
            let buffer = |label, bytes: u64| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    size: bytes.next_multiple_of(4).max(16),
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            let bricks = grids.iter().map(BrickGrid::len).max().unwrap_or(0);
            let constants = buffer("residency.constants", bricks * 4);
            let activity = buffer("residency.activity", bricks.div_ceil(16) * 4);
            let occupancy = buffer("residency.occupancy", shape.slot_count() * 64);
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("residency.layout"),
                entries: match format.kind {
                    AtlasKind::Filtered => bindings::VOLUME_FILTERED,
                    AtlasKind::Float => bindings::VOLUME_FLOAT,
                    AtlasKind::Uint => bindings::VOLUME_UINT,
                },
            });
            let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("residency.sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            });
            let views = [&atlas, &indirection]
                .map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
            let mut entries = vec![
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&views[0]),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(&views[1]),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: constants.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: activity.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: occupancy.as_entire_binding(),
                },
            ];
            if format.kind == AtlasKind::Filtered {
                entries.push(wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&sampler),
                });
            }
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("residency.group"),
                layout: &layout,
                entries: &entries,
            });
            Ok(Self {
                shape,
                format,
                voxel_bytes: stored.size() as u32,
                words: vec![0; size.element_product() as usize],
                grids,
                lod: Lod(0),
                atlas,
                indirection,
                indirection_size: size,
                constants,
                activity,
                occupancy,
                layout,
                group,
            })
        })
    }

    /// The atlas' shape.
    pub fn shape(&self) -> AtlasShape {
        self.shape
    }

    /// Bytes of the atlas texture.
    pub fn atlas_bytes(&self) -> u64 {
        self.shape.bytes(u64::from(self.voxel_bytes))
    }

    /// Bytes of atlas, page table and occupancy.
    pub fn gpu_bytes(&self) -> u64 {
        self.atlas_bytes()
            + self.words.len() as u64 * 4
            + self.constants.size()
            + self.activity.size()
            + self.occupancy.size()
    }

    pub(super) fn kind(&self) -> AtlasKind {
        self.format.kind
    }

    pub(super) fn value_scale(&self) -> f32 {
        self.format.value_scale
    }

    pub(super) fn level_bricks(&self) -> UVec3 {
        self.grids[usize::from(self.lod.0)].bricks
    }

    pub(super) fn indirection_origin(&self) -> UVec3 {
        self.origin_of(self.lod)
    }

    fn origin_of(&self, lod: Lod) -> UVec3 {
        UVec3::new(
            self.grids[..usize::from(lod.0)]
                .iter()
                .map(|g| g.bricks.x)
                .sum(),
            0,
            0,
        )
    }

    fn word_mut(&mut self, brick: BrickId) -> &mut u32 {
        let at = self.origin_of(brick.lod) + brick.xyz;
        let size = self.indirection_size;
        &mut self.words[((at.z * size.y + at.y) * size.x + at.x) as usize]
    }

    /// The packed place of a slot, as `shaders/lib/brick.wgsl` unpacks it.
    fn slot_word(&self, slot: SlotId) -> u32 {
        let place = self.shape.slot_place(slot);
        TAG_SLOT << TAG_SHIFT | place.z << 20 | place.y << 10 | place.x
    }

    /// Changes the host's copy of the page table; [`Self::write_tables`] sends it.
    pub fn apply_patches(&mut self, patches: &[PageTablePatch]) {
        for patch in patches {
            let word = patch.slot.map_or(0, |slot| self.slot_word(slot));
            *self.word_mut(patch.brick) = word;
        }
    }

    /// Copies decoded bricks into their slots, side by side in rows of 256 bytes: 7 (u8), 3 (u16) or 1 (f32) to a row
    /// (design.md §5). Returns the bytes staged.
    ///
    /// # Errors
    /// The device is lost.
    pub fn upload(
        &self,
        gpu: &GpuContext,
        staging: &mut Staging,
        bricks: &[(Upload, &[u8])],
    ) -> Result<u64, GpuError> {
        let row_bytes = (STORED_EDGE * self.voxel_bytes) as usize;
        let per_row = (ROW_PITCH / row_bytes).max(1);
        let rows = (STORED_EDGE * STORED_EDGE) as usize;
        let mut staged = vec![0_u8; ROW_PITCH * rows];
        let mut total = 0;
        for group in bricks.chunks(per_row) {
            for (i, (_, voxels)) in group.iter().enumerate() {
                for (target, row) in staged
                    .chunks_exact_mut(ROW_PITCH)
                    .zip(voxels.chunks_exact(row_bytes))
                {
                    target[i * row_bytes..(i + 1) * row_bytes].copy_from_slice(row);
                }
            }
            total += staged.len() as u64;
            staging.stage(gpu, &staged, |encoder, buffer, offset| {
                for (i, (upload, _)) in group.iter().enumerate() {
                    let at = self.shape.slot_place(upload.slot) * STORED_EDGE;
                    encoder.copy_buffer_to_texture(
                        wgpu::TexelCopyBufferInfo {
                            buffer,
                            layout: wgpu::TexelCopyBufferLayout {
                                offset: offset + (i * row_bytes) as u64,
                                bytes_per_row: Some(ROW_PITCH as u32),
                                rows_per_image: Some(STORED_EDGE),
                            },
                        },
                        wgpu::TexelCopyTextureInfo {
                            texture: &self.atlas,
                            mip_level: 0,
                            origin: wgpu::Origin3d {
                                x: at.x,
                                y: at.y,
                                z: at.z,
                            },
                            aspect: wgpu::TextureAspect::All,
                        },
                        wgpu::Extent3d {
                            width: STORED_EDGE,
                            height: STORED_EDGE,
                            depth_or_array_layers: STORED_EDGE,
                        },
                    );
                }
            })?;
        }
        Ok(total)
    }

    /// Bytes of staging for one group of bricks.
    pub const fn staging_chunk_bytes() -> u64 {
        ROW_PITCH as u64 * (STORED_EDGE * STORED_EDGE) as u64
    }

    /// Makes `level` the one that is drawn: constant bricks, activity, occupancy; sends the page table.
    ///
    /// # Errors
    /// The device is lost.
    pub fn write_tables(
        &mut self,
        gpu: &GpuContext,
        staging: &mut Staging,
        level: &LevelState<'_>,
        slot_of: impl Fn(BrickId) -> Option<SlotId>,
    ) -> Result<(), GpuError> {
        self.lod = level.lod;
        let grid = self.grids[usize::from(level.lod.0)];

        let mut values: Vec<f32> = Vec::new();
        let mut place_of: HashMap<u32, u32> = HashMap::new();
        for (&index, &(value, _)) in &level.scan.constant {
            let place = *place_of.entry(value.to_bits()).or_insert_with(|| {
                values.push(value);
                values.len() as u32 - 1
            });
            *self.word_mut(BrickId::new(level.lod, grid.xyz(index))) =
                TAG_CONSTANT << TAG_SHIFT | place;
        }
        gpu.queue
            .write_buffer(&self.constants, 0, bytemuck::cast_slice(&values));

        let mut activity = vec![0_u32; grid.len().div_ceil(16) as usize];
        let mut set =
            |index: u64, state: u32| activity[(index / 16) as usize] |= state << (index % 16 * 2);
        const { assert!(BRICK_EMPTY == 0, "what is not set is empty") };
        let mut occupancy = vec![0_u32; self.shape.slot_count() as usize * 16];
        for &index in &level.active.constant {
            set(index, BRICK_FULL);
        }
        for (&index, bits) in &level.active.mixed {
            if bits.count() >= FULL_ENOUGH {
                set(index, BRICK_FULL);
            } else if let Some(slot) = slot_of(BrickId::new(level.lod, grid.xyz(index))) {
                set(index, BRICK_MIXED);
                occupancy[slot.0 as usize * 16..][..16].copy_from_slice(bits.words());
            }
        }
        gpu.queue
            .write_buffer(&self.activity, 0, bytemuck::cast_slice(&activity));
        gpu.queue
            .write_buffer(&self.occupancy, 0, bytemuck::cast_slice(&occupancy));

        let size = self.indirection_size;
        for (row, words) in self.words.chunks_exact(size.x as usize).enumerate() {
            let (y, z) = (row as u32 % size.y, row as u32 / size.y);
            staging.stage(
                gpu,
                bytemuck::cast_slice(words),
                |encoder, buffer, offset| {
                    encoder.copy_buffer_to_texture(
                        wgpu::TexelCopyBufferInfo {
                            buffer,
                            layout: wgpu::TexelCopyBufferLayout {
                                offset,
                                bytes_per_row: None,
                                rows_per_image: None,
                            },
                        },
                        wgpu::TexelCopyTextureInfo {
                            texture: &self.indirection,
                            mip_level: 0,
                            origin: wgpu::Origin3d { x: 0, y, z },
                            aspect: wgpu::TextureAspect::All,
                        },
                        wgpu::Extent3d {
                            width: size.x,
                            height: 1,
                            depth_or_array_layers: 1,
                        },
                    );
                },
            )?;
        }
        staging.flush(gpu)
    }
}

/// Active blocks (of 512) from which a brick is walked as if all were: finding the few gaps costs more than the samples in
/// them. Only what is sampled in vain changes, not the picture.
const FULL_ENOUGH: u32 = 384;

/// Rows of texture copies are padded to this by the API.
const ROW_PITCH: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;
