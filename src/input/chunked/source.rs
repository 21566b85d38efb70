//! [`Chunked`]: an array in chunks as a [`VoxelSource`].
//!
//! Chunks are decoded several at once, each once when slices are read in their order: those that hold the last slices stay.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use rayon::ThreadPool;
use rayon::prelude::*;

use super::array::bytes_of;
use super::{Array, Axes, Chunks, most_packed_bytes};
use crate::geom::VoxelBox;
use crate::input::affine;
use crate::input::problem::Subject;
use crate::input::voxel_file::voxel_bytes;
use crate::volume::{ReadOrder, Rescale, SourceError, VolumeDesc, VoxelSource, check_read};

/// Layers of thin chunks are decoded together up to this size, so that all threads have work.
const GROUP_BYTES: u64 = 32 << 20;

/// Chunks fetched at once over a network: most of the time goes by in waiting.
const REMOTE_FETCHES: usize = 16;

/// What a chunk costs beside its voxels.
const CELL_BYTES: u64 = 96;

/// What a format has found out about a volume.
pub(in crate::input) struct Found {
    pub(in crate::input) array: Array,
    pub(in crate::input) axes: Axes,
    /// Distance of voxel centres along x, y, z in millimetres.
    pub(in crate::input) spacing: DVec3,
    /// Where the first voxel's centre lies, in millimetres.
    pub(in crate::input) origin: DVec3,
    /// The whole affine, where more than spacing and origin is known.
    pub(in crate::input) world_from_index: Option<DAffine3>,
    /// Unit of physical values; empty where nothing is said.
    pub(in crate::input) unit: String,
    pub(in crate::input) name: String,
    pub(in crate::input) notes: Vec<String>,
    /// Whether chunks come over a network.
    pub(in crate::input) is_remote: bool,
}

/// A volume in an array of chunks.
pub(in crate::input) struct Chunked {
    desc: VolumeDesc,
    array: Array,
    axes: Axes,
    /// Voxels of a chunk.
    chunk: U64Vec3,
    chunks: Box<dyn Chunks>,
    /// Decoded chunks of the layers that were read last; `None` for one that is not stored.
    cells: HashMap<U64Vec3, Option<Vec<u8>>>,
    fetchers: Option<ThreadPool>,
    notes: Vec<String>,
}

impl Found {
    /// The volume's size.
    pub(in crate::input) fn dims(&self) -> U64Vec3 {
        along(&self.axes, &self.array.shape)
    }

    /// The volume, its chunks read through `chunks`.
    ///
    /// # Errors
    /// The volume has no sound place in the world, or more voxels than can be counted.
    pub(in crate::input) fn open(
        self,
        subject: &Subject<'_>,
        chunks: Box<dyn Chunks>,
    ) -> Result<Box<dyn VoxelSource>, SourceError> {
        let affine =
            DAffine3::from_mat3_translation(DMat3::from_diagonal(self.spacing), self.origin);
        let affine = self.world_from_index.unwrap_or(affine);
        let desc = VolumeDesc {
            dims: self.dims(),
            voxel_type: self.array.voxel_type,
            world_from_index: affine::checked(subject, "the spacing and the origin", affine)?,
            rescale: Rescale::IDENTITY,
            unit: self.unit.clone(),
            name: self.name,
        };
        voxel_bytes(subject, &desc)?;
        let fetchers = self.is_remote.then(|| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(REMOTE_FETCHES)
                .thread_name(|n| format!("fetch-{n}"))
                .build()
        });
        Ok(Box::new(Chunked {
            // A chunk may be larger than the volume, a layer of chunks never is.
            chunk: along(&self.axes, &self.array.chunk).min(desc.dims),
            desc,
            array: self.array,
            axes: self.axes,
            chunks,
            cells: HashMap::new(),
            // Without threads of their own the chunks are fetched by those that decode.
            fetchers: fetchers.and_then(Result::ok),
            notes: self.notes,
        }))
    }
}

/// Sizes along x, y and z; 1 along z for a picture.
fn along(axes: &Axes, sizes: &[u64]) -> U64Vec3 {
    U64Vec3::from_array(axes.xyz.map(|axis| axis.map_or(1, |a| sizes[a])))
}

impl Chunked {
    /// Bytes of a layer: chunks side by side over the whole x and y, one chunk high.
    fn layer_bytes(&self) -> u64 {
        let d = self.desc.dims;
        d.x * d.y * self.chunk.z * self.desc.voxel_type.size() as u64
    }

    /// Layers that are decoded and held together.
    fn group_layers(&self) -> u64 {
        (GROUP_BYTES / self.layer_bytes().max(1)).max(1)
    }

    /// The voxels of chunk `cell` that lie in the volume.
    fn cell_box(&self, cell: U64Vec3) -> VoxelBox {
        let min = cell * self.chunk;
        VoxelBox::new(min, min.saturating_add(self.chunk).min(self.desc.dims))
    }

    /// The voxels of chunk `cell`, or `None` where none are stored.
    fn decode(&self, cell: U64Vec3) -> Result<Option<Vec<u8>>, SourceError> {
        let mut index = vec![0; self.array.shape.len()];
        for (axis, at) in self.axes.xyz.iter().zip(cell.to_array()) {
            if let Some(axis) = axis {
                index[*axis] = at;
            }
        }
        for &(axis, at) in &self.axes.fixed {
            index[axis] = at / self.array.chunk[axis];
        }
        let block = self.chunks.read(&index)?;
        let size = self.cell_box(cell).size();
        Ok(block.map(|block| {
            debug_assert_eq!(
                bytes_of(&block.extent, self.array.voxel_type),
                Some(block.bytes.len() as u64),
                "a block is as long as its extent says"
            );
            self.array.voxels(&self.axes, block, size)
        }))
    }

    /// Decodes what of `cells` is not there yet and drops the layers that are not among them.
    fn hold(&mut self, cells: VoxelBox) -> Result<(), SourceError> {
        self.cells
            .retain(|cell, _| (cells.min.z..cells.max.z).contains(&cell.z));
        let mut wanted = Vec::new();
        for z in cells.min.z..cells.max.z {
            for y in cells.min.y..cells.max.y {
                for x in cells.min.x..cells.max.x {
                    let cell = U64Vec3::new(x, y, z);
                    if !self.cells.contains_key(&cell) {
                        wanted.push(cell);
                    }
                }
            }
        }
        let decode = || -> Result<Vec<_>, SourceError> {
            let one = |cell| Ok((cell, self.decode(cell)?));
            wanted.into_par_iter().map(one).collect()
        };
        let decoded = match &self.fetchers {
            Some(pool) => pool.install(decode)?,
            None => decode()?,
        };
        self.cells.extend(decoded);
        Ok(())
    }

    /// Copies `voxels` out of the held chunks; `out` is the box's.
    fn copy(&self, voxels: VoxelBox, out: &mut [u8]) {
        let size = voxels.size();
        let element = self.desc.voxel_type.size();
        let slice_bytes = (size.x * size.y) as usize * element;
        out.par_chunks_exact_mut(slice_bytes)
            .enumerate()
            .for_each(|(n, out)| {
                let z = voxels.min.z + n as u64;
                let slice = VoxelBox::new(
                    U64Vec3::new(voxels.min.x, voxels.min.y, z),
                    U64Vec3::new(voxels.max.x, voxels.max.y, z + 1),
                );
                let cells = self.cells_of(slice);
                for y in cells.min.y..cells.max.y {
                    for x in cells.min.x..cells.max.x {
                        self.copy_cell(U64Vec3::new(x, y, cells.min.z), slice, out);
                    }
                }
            });
    }

    /// Copies what chunk `cell` has of `slice`.
    fn copy_cell(&self, cell: U64Vec3, slice: VoxelBox, out: &mut [u8]) {
        let element = self.desc.voxel_type.size();
        let whole = self.cell_box(cell);
        let part = whole.intersection(&slice);
        let row_bytes = part.size().x as usize * element;
        let held = self
            .cells
            .get(&cell)
            .expect("invariant: every chunk of the box was decoded before");
        for y in part.min.y..part.max.y {
            let to = (y - slice.min.y) * slice.size().x + (part.min.x - slice.min.x);
            let out = &mut out[to as usize * element..][..row_bytes];
            match held {
                Some(bytes) => {
                    let at = part.min - whole.min;
                    let from = (at.z * whole.size().y + (y - whole.min.y)) * whole.size().x + at.x;
                    out.copy_from_slice(&bytes[from as usize * element..][..row_bytes]);
                }
                None => out
                    .chunks_exact_mut(element)
                    .for_each(|v| v.copy_from_slice(self.array.fill())),
            }
        }
    }

    /// The chunks that a box of voxels touches.
    fn cells_of(&self, voxels: VoxelBox) -> VoxelBox {
        let last = (voxels.max - U64Vec3::ONE) / self.chunk;
        VoxelBox::new(voxels.min / self.chunk, last + U64Vec3::ONE)
    }
}

impl VoxelSource for Chunked {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::Random
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let slice_bytes = out.len() / voxels.size().z as usize;
        let cells = self.cells_of(voxels);
        let mut rest = out;
        let mut layer = cells.min.z;
        while layer < cells.max.z {
            let end = cells.max.z.min(layer + self.group_layers());
            let mut group = cells;
            (group.min.z, group.max.z) = (layer, end);
            self.hold(group)?;
            let mut part = voxels;
            part.min.z = part.min.z.max(layer * self.chunk.z);
            part.max.z = part.max.z.min(end.saturating_mul(self.chunk.z));
            let (now, later) = rest.split_at_mut(part.size().z as usize * slice_bytes);
            self.copy(part, now);
            rest = later;
            layer = end;
        }
        Ok(())
    }

    fn held_bytes(&self) -> u64 {
        let layers = self
            .group_layers()
            .min(self.desc.dims.z.div_ceil(self.chunk.z));
        let dims = self.desc.dims;
        let cells = dims.x.div_ceil(self.chunk.x) * dims.y.div_ceil(self.chunk.y);
        let per_layer = cells.saturating_mul(CELL_BYTES);
        let decoded = self.array.chunk_bytes();
        let threads = match &self.fetchers {
            Some(pool) => pool.current_num_threads(),
            None => rayon::current_num_threads(),
        } as u64;
        self.layer_bytes()
            .saturating_add(per_layer)
            .saturating_mul(layers)
            .saturating_add(
                threads.saturating_mul(decoded.saturating_add(most_packed_bytes(decoded))),
            )
            .saturating_add(self.chunks.held_bytes())
    }

    fn stamp(&self) -> String {
        self.chunks.stamp()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}

#[cfg(test)]
mod tests;
