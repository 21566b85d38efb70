//! Bind group 1: what of the volume is on the GPU. Applies the pager's plans to atlas, page table and activity.

use std::collections::{BTreeSet, HashMap};

use glam::UVec3;

use crate::geom::{BrickGrid, BrickId, Lod, STORED_EDGE};
use crate::gpu::layout::{BRICK_FULL, BRICK_MIXED, TAG_CONSTANT, TAG_SHIFT, TAG_SLOT};
use crate::gpu::shader::AtlasPart;
use crate::gpu::{Caps, GpuContext, GpuError, Staging};
use crate::pager::{AtlasShape, PageTablePatch, SlotId, Upload};
use crate::volume::StoredType;

use super::activity::Activity;
use super::bindings;
use super::extremes::ExtremeCodes;
use super::feedback::FeedbackPlaces;

/// How values between voxels are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleFilter {
    /// Eight texel loads, interpolated in f32: as the CPU reference does it.
    #[default]
    Exact,
    /// The hardware's linear filter, with the hardware's coarse weights.
    Hardware,
}

/// Format, shader and scale for a voxel type on a device.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtlasFormat {
    pub(super) format: wgpu::TextureFormat,
    pub(super) kind: AtlasPart,
    /// Stored value of a texel of 1.
    pub(super) value_scale: f32,
}

impl AtlasFormat {
    pub(super) fn new(stored: StoredType, filter: SampleFilter, caps: &Caps) -> Self {
        use AtlasPart::{Filtered, Float, Uint};
        use wgpu::TextureFormat::{R8Uint, R8Unorm, R16Uint, R16Unorm, R32Float};
        let filter = filter == SampleFilter::Hardware;
        let (format, kind, value_scale) = match stored {
            StoredType::U8 if filter => (R8Unorm, Filtered, 255.0),
            StoredType::U8 => (R8Uint, Uint, 1.0),
            StoredType::U16 if filter && caps.unorm16 => (R16Unorm, Filtered, 65535.0),
            StoredType::U16 => (R16Uint, Uint, 1.0),
            StoredType::F32 if filter && caps.float32_filterable => (R32Float, Filtered, 1.0),
            StoredType::F32 => (R32Float, Float, 1.0),
        };
        Self {
            format,
            kind,
            value_scale,
        }
    }

    /// The hardware filters along z in 3D textures only; exact sampling gathers, which it can from slices only.
    pub(super) fn dimension(&self) -> wgpu::TextureDimension {
        match self.kind {
            AtlasPart::Filtered => wgpu::TextureDimension::D3,
            AtlasPart::Float | AtlasPart::Uint => wgpu::TextureDimension::D2,
        }
    }
}

/// What a residency is made for.
#[derive(Clone, Copy, Debug)]
pub struct AtlasPlan {
    /// Edges of each texture.
    pub shape: AtlasShape,
    /// Textures, 1 to [`Residency::MAX_TEXTURES`].
    pub textures: u32,
}

impl AtlasPlan {
    /// Slots of all textures.
    pub fn slot_count(&self) -> u64 {
        self.shape.slot_count() * u64::from(self.textures)
    }

    /// Bytes of all textures.
    pub fn bytes(&self, voxel_bytes: u64) -> u64 {
        self.shape.bytes(voxel_bytes) * u64::from(self.textures)
    }
}

/// Atlas, page table, activity, occupancy, and the buffer in which rays report.
#[derive(Debug)]
pub struct Residency {
    plan: AtlasPlan,
    format: AtlasFormat,
    voxel_bytes: u32,
    grids: Vec<BrickGrid>,
    /// The number of each level's first brick.
    first_bricks: Vec<u32>,
    atlases: Vec<wgpu::Texture>,
    indirection: wgpu::Texture,
    indirection_bytes: u64,
    constant_values: Vec<f32>,
    constant_places: HashMap<u32, u32>,
    constants: wgpu::Buffer,
    activity: wgpu::Buffer,
    /// The host's copy of `activity`, and which of its words changed.
    activity_words: Vec<u32>,
    activity_changed: Changed,
    occupancy: wgpu::Buffer,
    /// Codes of the bricks' greatest and least values.
    extremes: wgpu::Buffer,
    codes: ExtremeCodes,
    pub(super) feedback: wgpu::Buffer,
    places: FeedbackPlaces,
    dispatches: u32,
    sampler: wgpu::Sampler,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) group: wgpu::BindGroup,
}

/// Bytes of a brick's codes: for its greatest value, and for its least.
const EXTREMES_BYTES: u64 = 2;

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

/// Numbers of bricks that all levels take. Each level begins with a word of the activity.
fn brick_count(grids: &[BrickGrid]) -> u64 {
    grids.iter().map(|g| g.len().next_multiple_of(16)).sum()
}

impl Residency {
    /// Most textures of an atlas: their bindings are fixed (design.md §5).
    pub const MAX_TEXTURES: u32 = 4;

    /// Most bricks of a volume, all levels together: tables are flat (design.md §5).
    pub const MAX_BRICKS: u64 = 100_000_000;

    /// Texels along an axis of an atlas texture, at most.
    pub fn max_atlas_edge(caps: &Caps) -> u32 {
        // Slots' places are packed in nine bits.
        const MAX_SLOTS: u32 = 511;
        caps.limits
            .max_texture_dimension_3d
            .min(caps.limits.max_texture_array_layers)
            .min(MAX_SLOTS * STORED_EDGE)
    }

    /// Values of constant bricks that a residency begins with room for.
    const CONSTANTS: usize = 1 << 12;

    /// Bytes on the GPU beside the atlas, for stores of these levels and an atlas of `slots` slots.
    pub fn table_bytes(grids: &[BrickGrid], slots: u64) -> u64 {
        let s = indirection_size(grids);
        let bricks = brick_count(grids);
        let places = FeedbackPlaces::new(
            u32::try_from(slots).unwrap_or(u32::MAX / 2),
            u32::try_from(bricks).unwrap_or(u32::MAX / 2),
        );
        u64::from(s.x) * u64::from(s.y) * u64::from(s.z) * 4
            + bricks.div_ceil(16) * 4
            + bricks * EXTREMES_BYTES
            + Self::CONSTANTS as u64 * 4
            + slots * 64
            + places.bytes()
            + places.report_bytes()
    }

    /// An empty atlas for voxels of `stored` type. All bricks are absent and of unknown activity.
    ///
    /// # Errors
    /// The device has not the memory, or the volume has more bricks than tables or textures can hold.
    pub fn new(
        gpu: &GpuContext,
        stored: StoredType,
        filter: SampleFilter,
        plan: AtlasPlan,
        grids: Vec<BrickGrid>,
        codes: ExtremeCodes,
    ) -> Result<Self, GpuError> {
        let size = indirection_size(&grids);
        let bricks = brick_count(&grids);
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
        if bricks > Self::MAX_BRICKS {
            return Err(GpuError::TooSmall {
                what: format!("a volume of {bricks} bricks"),
                needed: bricks,
                limit: Self::MAX_BRICKS,
                limited_by: "the number of bricks that flat tables are meant for".into(),
                remedy: "render with --device cpu".into(),
            });
        }
        let format = AtlasFormat::new(stored, filter, &gpu.caps);
        let places = FeedbackPlaces::new(plan.slot_count() as u32, bricks as u32);
        let first_bricks = grids
            .iter()
            .scan(0, |next, g| {
                let first = *next;
                *next += g.len().next_multiple_of(16) as u32;
                Some(first)
            })
            .collect();
        gpu.checked("allocating the atlas", || {
            let device = &gpu.device;
            let texture = |label, size: UVec3, dimension, format| {
                device.create_texture(&wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d {
                        width: size.x,
                        height: size.y,
                        depth_or_array_layers: size.z,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension,
                    format,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                    view_formats: &[],
                })
            };
            let atlases: Vec<wgpu::Texture> = (0..Self::MAX_TEXTURES)
                .map(|i| {
                    let texels = if i < plan.textures {
                        plan.shape.texels
                    } else {
                        UVec3::ONE
                    };
                    texture("residency.atlas", texels, format.dimension(), format.format)
                })
                .collect();
            let indirection = texture(
                "residency.indirection",
                size,
                wgpu::TextureDimension::D3,
                wgpu::TextureFormat::R32Uint,
            );
            let activity_words = vec![0xaaaa_aaaa; bricks.div_ceil(16) as usize];
            const {
                assert!(BRICK_FULL == 2, "every pair of bits of 0xaaaaaaaa");
            }
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            let constants = buffer(
                gpu,
                "residency.constants",
                Self::CONSTANTS as u64 * 4,
                usage,
            );
            let activity = buffer(
                gpu,
                "residency.activity",
                activity_words.len() as u64 * 4,
                usage,
            );
            let extremes = buffer(gpu, "residency.extremes", bricks * EXTREMES_BYTES, usage);
            let occupancy = buffer(gpu, "residency.occupancy", plan.slot_count() * 64, usage);
            let feedback = buffer(
                gpu,
                "residency.feedback",
                places.bytes(),
                usage | wgpu::BufferUsages::COPY_SRC,
            );
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("residency.layout"),
                entries: bindings::volume_of(format.kind),
            });
            let sampler = atlas_sampler(gpu, format.kind);
            let tables = [&constants, &activity, &occupancy, &extremes];
            let group = bind(gpu, &layout, &atlases, &sampler, &indirection, tables);
            Ok(Self {
                plan,
                format,
                voxel_bytes: stored.size() as u32,
                first_bricks,
                grids,
                atlases,
                indirection,
                indirection_bytes: u64::from(size.x) * u64::from(size.y) * u64::from(size.z) * 4,
                constant_values: Vec::new(),
                constant_places: HashMap::new(),
                constants,
                activity,
                activity_words,
                activity_changed: Changed::All,
                occupancy,
                extremes,
                codes,
                feedback,
                places,
                dispatches: 0,
                sampler,
                layout,
                group,
            })
        })
    }

    /// What the atlas consists of.
    pub fn plan(&self) -> AtlasPlan {
        self.plan
    }

    /// Bytes of the atlas textures.
    pub fn atlas_bytes(&self) -> u64 {
        self.plan.bytes(u64::from(self.voxel_bytes))
    }

    /// Bytes of atlas, tables, feedback and its read-back.
    pub fn gpu_bytes(&self) -> u64 {
        self.atlas_bytes()
            + self.indirection_bytes
            + self.constants.size()
            + self.activity.size()
            + self.occupancy.size()
            + self.extremes.size()
            + self.feedback.size()
            + self.places.report_bytes()
    }

    /// The brick of that number (see [`super::MissedBrick`]).
    pub fn brick(&self, number: u32) -> BrickId {
        let level = self.first_bricks.partition_point(|&first| first <= number) - 1;
        let index = u64::from(number - self.first_bricks[level]);
        BrickId::new(Lod(level as u8), self.grids[level].xyz(index))
    }

    pub(super) fn shape(&self) -> AtlasShape {
        self.plan.shape
    }

    pub(super) fn has_many_atlases(&self) -> bool {
        self.plan.textures > 1
    }

    pub(super) fn kind(&self) -> AtlasPart {
        self.format.kind
    }

    pub(super) fn value_scale(&self) -> f32 {
        self.format.value_scale
    }

    pub(super) fn extreme_scale(&self) -> f32 {
        self.codes.scale()
    }

    pub(super) fn level_bricks(&self, lod: Lod) -> UVec3 {
        self.grids[usize::from(lod.0)].bricks
    }

    pub(super) fn first_brick(&self, lod: Lod) -> u32 {
        self.first_bricks[usize::from(lod.0)]
    }

    pub(super) fn feedback_places(&self) -> FeedbackPlaces {
        self.places
    }

    /// The number of the next dispatch, from 1.
    pub(super) fn next_dispatch(&mut self) -> u32 {
        self.dispatches += 1;
        self.dispatches
    }

    pub(super) fn indirection_origin(&self, lod: Lod) -> UVec3 {
        let x = self.grids[..usize::from(lod.0)]
            .iter()
            .map(|g| g.bricks.x)
            .sum();
        UVec3::new(x, 0, 0)
    }

    /// Texture and place of a slot there.
    fn slot_place(&self, slot: SlotId) -> (u32, UVec3) {
        let per_texture = self.plan.shape.slot_count() as u32;
        let place = self.plan.shape.slot_place(SlotId(slot.0 % per_texture));
        (slot.0 / per_texture, place)
    }

    /// The packed place of a slot, as `shaders/lib/brick.wgsl` unpacks it.
    fn slot_word(&self, slot: SlotId) -> u32 {
        let (texture, place) = self.slot_place(slot);
        TAG_SLOT << TAG_SHIFT | texture << 27 | place.z << 18 | place.y << 9 | place.x
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
                    let (texture, place) = self.slot_place(upload.slot);
                    let at = place * STORED_EDGE;
                    encoder.copy_buffer_to_texture(
                        wgpu::TexelCopyBufferInfo {
                            buffer,
                            layout: wgpu::TexelCopyBufferLayout {
                                offset: offset + (i * row_bytes) as u64,
                                bytes_per_row: Some(ROW_PITCH as u32),
                                rows_per_image: Some(STORED_EDGE),
                            },
                        },
                        texel_place(&self.atlases[texture as usize], at),
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

    /// Changes the page table: a few texels per brick that came or went.
    ///
    /// # Errors
    /// The device is lost.
    pub fn apply_patches(
        &mut self,
        gpu: &GpuContext,
        staging: &mut Staging,
        patches: &[PageTablePatch],
    ) -> Result<(), GpuError> {
        // A brick that went and came again within one step is written once: copies to one texel have no order here.
        let words: HashMap<BrickId, u32> = patches
            .iter()
            .map(|p| (p.brick, p.slot.map_or(0, |slot| self.slot_word(slot))))
            .collect();
        let mut words: Vec<(BrickId, u32)> = words.into_iter().collect();
        words.sort_unstable_by_key(|(brick, _)| *brick);
        for (brick, word) in words {
            let at = self.indirection_origin(brick.lod) + brick.xyz;
            self.write_words(gpu, staging, at, &[word])?;
        }
        Ok(())
    }

    /// Enters the constant bricks of a level, by linear index, none of which may have a slot yet; values are stored ones.
    ///
    /// # Errors
    /// The device is lost or has not the memory.
    pub fn set_constants(
        &mut self,
        gpu: &GpuContext,
        staging: &mut Staging,
        lod: Lod,
        constants: impl Iterator<Item = (u64, f32)>,
    ) -> Result<(), GpuError> {
        let grid = self.grids[usize::from(lod.0)];
        let before = self.constant_values.len();
        let mut words = vec![0; grid.len() as usize];
        for (index, value) in constants {
            let values = &mut self.constant_values;
            let place = *self
                .constant_places
                .entry(value.to_bits())
                .or_insert_with(|| {
                    values.push(value);
                    values.len() as u32 - 1
                });
            words[index as usize] = TAG_CONSTANT << TAG_SHIFT | place;
        }
        let origin = self.indirection_origin(lod);
        for (row, words) in (0..).zip(words.chunks_exact(grid.bricks.x as usize)) {
            if words.iter().any(|&w| w != 0) {
                let at = origin + UVec3::new(0, row % grid.bricks.y, row / grid.bricks.y);
                self.write_words(gpu, staging, at, words)?;
            }
        }
        if self.constant_values.len() > before {
            self.write_constants(gpu)?;
        }
        Ok(())
    }

    /// Sends the values of constant bricks, into a larger buffer when they no longer fit.
    fn write_constants(&mut self, gpu: &GpuContext) -> Result<(), GpuError> {
        let bytes = self.constant_values.len() as u64 * 4;
        if bytes > self.constants.size() {
            self.constants = gpu.checked("enlarging a table", || {
                let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
                Ok(buffer(
                    gpu,
                    "residency.constants",
                    bytes.next_power_of_two(),
                    usage,
                ))
            })?;
            self.group = bind(
                gpu,
                &self.layout,
                &self.atlases,
                &self.sampler,
                &self.indirection,
                [
                    &self.constants,
                    &self.activity,
                    &self.occupancy,
                    &self.extremes,
                ],
            );
        }
        let values = bytemuck::cast_slice(&self.constant_values);
        gpu.queue.write_buffer(&self.constants, 0, values);
        Ok(())
    }

    /// Writes a row of page-table words.
    fn write_words(
        &self,
        gpu: &GpuContext,
        staging: &mut Staging,
        at: UVec3,
        words: &[u32],
    ) -> Result<(), GpuError> {
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
                    texel_place(&self.indirection, at),
                    wgpu::Extent3d {
                        width: words.len() as u32,
                        height: 1,
                        depth_or_array_layers: 1,
                    },
                );
            },
        )
    }

    /// Enters the least and greatest values of a level's bricks, in the order of its index.
    pub fn set_extremes(&self, gpu: &GpuContext, lod: Lod, ranges: impl Iterator<Item = [f32; 2]>) {
        let mut codes: Vec<u8> = ranges.flat_map(|r| self.codes.of(r)).collect();
        codes.resize(codes.len().next_multiple_of(4), 0);
        let first = self.first_bricks[usize::from(lod.0)];
        gpu.queue
            .write_buffer(&self.extremes, u64::from(first) * 2, &codes);
    }

    /// What the index tells of all bricks of a level ([`Activity::pack`]); resident ones have to be set again.
    /// [`Self::write_activity`] sends it.
    pub fn set_level_activity(&mut self, lod: Lod, packed: &[u32]) {
        let first = self.first_bricks[usize::from(lod.0)] / 16;
        for (word, &packed) in (first..).zip(packed) {
            let old = &mut self.activity_words[word as usize];
            if *old != packed {
                *old = packed;
                self.activity_changed.insert(word);
            }
        }
    }

    /// What can be seen of a brick; `slot` is where it lies, if it does. [`Self::write_activity`] sends it.
    pub fn set_activity(
        &mut self,
        gpu: &GpuContext,
        brick: BrickId,
        activity: Activity,
        slot: Option<SlotId>,
    ) {
        let level = usize::from(brick.lod.0);
        let number = self.first_bricks[level] + self.grids[level].index(brick.xyz) as u32;
        let bits = activity.bits();
        debug_assert!(
            bits != BRICK_MIXED || slot.is_some(),
            "occupancies lie by slot"
        );
        let (word, shift) = (number / 16, number % 16 * 2);
        let old = self.activity_words[word as usize];
        let new = old & !(3 << shift) | bits << shift;
        if new != old {
            self.activity_words[word as usize] = new;
            self.activity_changed.insert(word);
        }
        if let (BRICK_MIXED, Some(row), Some(slot)) = (bits, activity.row(), slot) {
            gpu.queue
                .write_buffer(&self.occupancy, u64::from(slot.0) * 64, row);
        }
    }

    /// Sends the changed part of the activity.
    pub fn write_activity(&mut self, gpu: &GpuContext) {
        let changed = std::mem::take(&mut self.activity_changed);
        for (first, last) in changed.ranges(self.activity_words.len() as u32) {
            let words = &self.activity_words[first as usize..=last as usize];
            gpu.queue.write_buffer(
                &self.activity,
                u64::from(first) * 4,
                bytemuck::cast_slice(words),
            );
        }
    }
}

/// Which words of a table must be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Changed {
    All,
    Some(BTreeSet<u32>),
}

impl Default for Changed {
    fn default() -> Self {
        Self::Some(BTreeSet::new())
    }
}

impl Changed {
    /// From here on all of them are sent.
    const MOST: usize = 4096;

    fn insert(&mut self, word: u32) {
        if let Self::Some(words) = self {
            words.insert(word);
            if words.len() > Self::MOST {
                *self = Self::All;
            }
        }
    }

    /// The words as (first, last) of a table of `len`, those that lie close together as one.
    fn ranges(self, len: u32) -> Vec<(u32, u32)> {
        let words = match self {
            Self::All => return vec![(0, len - 1)],
            Self::Some(words) => words,
        };
        let mut ranges: Vec<(u32, u32)> = Vec::new();
        for word in words {
            match ranges.last_mut() {
                Some((_, last)) if word - *last <= 64 => *last = word,
                _ => ranges.push((word, word)),
            }
        }
        ranges
    }
}

fn buffer(gpu: &GpuContext, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.next_multiple_of(4).max(16),
        usage,
        mapped_at_creation: false,
    })
}

fn texel_place(texture: &wgpu::Texture, at: UVec3) -> wgpu::TexelCopyTextureInfo<'_> {
    wgpu::TexelCopyTextureInfo {
        texture,
        mip_level: 0,
        origin: wgpu::Origin3d {
            x: at.x,
            y: at.y,
            z: at.z,
        },
        aspect: wgpu::TextureAspect::All,
    }
}

/// All of a texture, as shaders read it.
pub(super) fn atlas_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(match texture.dimension() {
            wgpu::TextureDimension::D3 => wgpu::TextureViewDimension::D3,
            // Also those of a single slice.
            _ => wgpu::TextureViewDimension::D2Array,
        }),
        ..Default::default()
    })
}

/// The sampler of an atlas: gathers take none that filters.
pub(super) fn atlas_sampler(gpu: &GpuContext, kind: AtlasPart) -> wgpu::Sampler {
    let filter = match kind {
        AtlasPart::Filtered => wgpu::FilterMode::Linear,
        AtlasPart::Float | AtlasPart::Uint => wgpu::FilterMode::Nearest,
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("residency.sampler"),
        mag_filter: filter,
        min_filter: filter,
        ..Default::default()
    })
}

/// The bind group; `tables` are constants, activity, occupancy, extremes.
fn bind(
    gpu: &GpuContext,
    layout: &wgpu::BindGroupLayout,
    atlases: &[wgpu::Texture],
    sampler: &wgpu::Sampler,
    indirection: &wgpu::Texture,
    tables: [&wgpu::Buffer; 4],
) -> wgpu::BindGroup {
    let views: Vec<wgpu::TextureView> = atlases.iter().map(atlas_view).collect();
    let indirection = atlas_view(indirection);
    let mut entries = vec![
        wgpu::BindGroupEntry {
            binding: 1,
            resource: wgpu::BindingResource::Sampler(sampler),
        },
        wgpu::BindGroupEntry {
            binding: 2,
            resource: wgpu::BindingResource::TextureView(&indirection),
        },
    ];
    for (view, binding) in views.iter().zip([0, 6, 7, 8]) {
        entries.push(wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        });
    }
    for (table, binding) in tables.iter().zip([3, 4, 5, 9]) {
        entries.push(wgpu::BindGroupEntry {
            binding,
            resource: table.as_entire_binding(),
        });
    }
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("residency.group"),
        layout,
        entries: &entries,
    })
}

/// Rows of texture copies are padded to this by the API.
const ROW_PITCH: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;
