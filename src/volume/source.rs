//! The trait through which voxels come in, and what can go wrong on the way.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::VolumeDesc;
use crate::geom::VoxelBox;

/// The order in which a source can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadOrder {
    /// Any box, any number of times.
    Random,
    /// Whole slices only (full x and y), each once, z rising without gaps: compressed streams.
    ForwardZ,
}

/// A volume that can be read box by box, at bounded memory.
pub trait VoxelSource: Send {
    /// Size, type and place of the volume.
    fn desc(&self) -> &VolumeDesc;

    /// In which order [`Self::read_box`] may be called.
    fn order(&self) -> ReadOrder;

    /// Fills `out` with the voxels of `voxels`, x fastest, in the source's type, little-endian.
    ///
    /// `out` must hold exactly `voxels.voxel_count() · voxel_type.size()` bytes, and `voxels` must lie inside the volume
    /// (and follow [`Self::order`]); breaking that is a bug of the caller and may panic.
    ///
    /// # Errors
    /// The source ends early, can't be read, or its compressed stream is damaged.
    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError>;

    /// What tells the source as it is from a later state with the same description, in words: length and time of the last
    /// change of a file. Empty when there is nothing to tell, as for computed voxels.
    fn stamp(&self) -> String {
        String::new()
    }

    /// Bytes that the source holds at most while slices are read in their order, beside a small buffer and what it is given
    /// to fill: decoded chunks, a slice in another form.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// What a user should know of how the input was understood, in whole sentences: what was chosen, changed or left out.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// What the input says beside size, place and values and that was asked to be kept: names and values.
    fn tags(&self) -> Vec<(String, String)> {
        Vec::new()
    }
}

/// Panics where a call of [`VoxelSource::read_box`] breaks its contract.
pub fn check_read(desc: &VolumeDesc, voxels: VoxelBox, out: &[u8]) {
    assert!(
        VoxelBox::whole(desc.dims).contains_box(&voxels),
        "the box must lie inside the volume"
    );
    let bytes = voxels
        .voxel_count()
        .and_then(|n| n.checked_mul(desc.voxel_type.size() as u64));
    assert_eq!(
        bytes,
        Some(out.len() as u64),
        "out must hold the box exactly"
    );
}

/// Why an input can't be read.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The operating system refused.
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried: `open`, `read at byte 352`.
        doing: String,
        /// What the system said.
        error: io::Error,
    },
    /// The bytes are not what the format demands.
    #[error("{}: {place}: expected {expected}, found {found}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it: a header field, a line, a byte offset.
        place: String,
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
        /// What the user can do.
        remedy: String,
    },
    /// A valid file of a kind that is not built.
    #[error("{}: {what} is not supported; {supported}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it holds: `RGB voxels (datatype 128)`.
        what: String,
        /// What is supported instead, or what to do.
        supported: String,
    },
}
