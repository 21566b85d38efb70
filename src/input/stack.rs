//! [`Stack`]: a volume whose slices are decoded one by one, as a [`VoxelSource`].
//!
//! Knows no format: a reader gives it the description and something that decodes a slice. Several slices are decoded at once.

use glam::U64Vec3;
use rayon::prelude::*;

use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, SourceError, VolumeDesc, VoxelSource, check_read};

/// Where the slices of a [`Stack`] come from: each by itself, any number of times, several at once.
pub(super) trait Slices: Send + Sync {
    /// Fills `out` with slice `z`, whole: x fastest, in the volume's type, little-endian.
    ///
    /// # Errors
    /// The slice can't be read or decoded, or is not as it was when the source was opened.
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError>;

    /// Most bytes that reading a slice takes beside `out`.
    fn working_bytes(&self) -> u64;

    /// As [`VoxelSource::stamp`].
    fn stamp(&self) -> String;
}

/// A volume in slices.
pub(super) struct Stack {
    desc: VolumeDesc,
    slices: Box<dyn Slices>,
    notes: Vec<String>,
    tags: Vec<(String, String)>,
}

impl Stack {
    pub(super) fn new(desc: VolumeDesc, slices: Box<dyn Slices>) -> Self {
        Self {
            desc,
            slices,
            notes: Vec::new(),
            tags: Vec::new(),
        }
    }

    /// With remarks for the user, as [`VoxelSource::notes`].
    pub(super) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }

    /// With what is to be kept, as [`VoxelSource::tags`].
    pub(super) fn with_tags(self, tags: Vec<(String, String)>) -> Self {
        Self { tags, ..self }
    }

    fn slice_bytes(&self) -> usize {
        let d = self.desc.dims;
        (d.x * d.y) as usize * self.desc.voxel_type.size()
    }
}

impl VoxelSource for Stack {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::Random
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let dims = self.desc.dims;
        let size = self.desc.voxel_type.size();
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let part = voxels.size();
        let slice_bytes = self.slice_bytes();
        let out_slice_bytes = (part.x * part.y) as usize * size;
        let is_whole = part.truncate() == dims.truncate();
        let slices = &self.slices;
        out.par_chunks_exact_mut(out_slice_bytes)
            .enumerate()
            .try_for_each(|(n, out)| {
                let z = voxels.min.z + n as u64;
                if is_whole {
                    return slices.read(z, out);
                }
                let mut whole = vec![0; slice_bytes];
                slices.read(z, &mut whole)?;
                crop(&whole, dims, voxels, size, out);
                Ok(())
            })
    }

    fn held_bytes(&self) -> u64 {
        self.slices.working_bytes() * rayon::current_num_threads() as u64
    }

    fn stamp(&self) -> String {
        self.slices.stamp()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn tags(&self) -> Vec<(String, String)> {
        self.tags.clone()
    }
}

/// Copies the part of a slice that lies in `voxels`.
fn crop(slice: &[u8], dims: U64Vec3, voxels: VoxelBox, size: usize, out: &mut [u8]) {
    let row = voxels.size().x as usize * size;
    for (y, out) in (voxels.min.y..voxels.max.y).zip(out.chunks_exact_mut(row)) {
        let at = (y * dims.x + voxels.min.x) as usize * size;
        out.copy_from_slice(&slice[at..at + row]);
    }
}
