//! [`VolumeWriter`]: what all volume formats have in common, and which file name means which.

use std::io;
use std::path::{Path, PathBuf};

use glam::{DAffine3, U64Vec3};
use thiserror::Error;

use super::{nifti, nrrd, raw, zarr};
use crate::geom::VoxelBox;
use crate::outfile::{Existing, OutFileError};
use crate::store::StoreError;
use crate::volume::{Rescale, VolumeDesc};

/// Why a volume or a picture can't be written.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The file can't be made or given its name.
    #[error(transparent)]
    File(#[from] OutFileError),
    /// The store can't be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A level that the store does not have.
    #[error("{}: there is no level {asked}; the levels are 0 to {last}", store.display())]
    NoSuchLevel {
        /// The store.
        store: PathBuf,
        /// What was asked for.
        asked: u8,
        /// The coarsest level.
        last: usize,
    },
    /// A box that holds nothing or reaches beyond its level.
    #[error(
        "{}: the box from {} to {} is empty or not inside level {lod}, which is {dims} voxels; the first corner is the \
         first voxel inside, the second the first one outside",
        store.display(), asked.min, asked.max
    )]
    BoxOutside {
        /// The store.
        store: PathBuf,
        /// What was asked for.
        asked: VoxelBox,
        /// Of which level.
        lod: u8,
        /// Voxels of that level.
        dims: U64Vec3,
    },
    /// Writing failed.
    #[error("{}: cannot write: {error}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// The name says no format that is built.
    #[error("{}: unknown format of a volume; supported are .nii.gz, .nrrd, .zarr and .raw", .0.display())]
    UnknownFormat(PathBuf),
    /// The format has no room for something.
    #[error("{}: {what}; write .nrrd or .raw instead", path.display())]
    DoesNotFit {
        /// The file.
        path: PathBuf,
        /// What has no room.
        what: String,
    },
    /// The bytes given are not the volume's or picture's.
    #[error("{}: expected {expected} bytes, got {found}; nothing was written", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// What the size of the volume or picture asks for.
        expected: u64,
        /// What was given.
        found: u64,
    },
}

/// A volume being written. Dropping it unfinished leaves no file behind.
pub trait VolumeWriter {
    /// Appends voxels: whole ones, in the volume's type, little-endian, x fastest, z rising.
    ///
    /// # Errors
    /// The disk is full, or `bytes_le` ends inside a voxel.
    fn write(&mut self, bytes_le: &[u8]) -> io::Result<()>;

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// More or fewer voxels came than the volume has, or the file can't be completed.
    fn finish(self: Box<Self>) -> Result<(), ExportError>;
}

/// A format, by the end of the file's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Nifti,
    Nrrd,
    Raw,
    Zarr,
}

impl Format {
    pub(super) fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        [
            (".nii.gz", Self::Nifti),
            (".nrrd", Self::Nrrd),
            (".raw", Self::Raw),
            (".zarr", Self::Zarr),
        ]
        .into_iter()
        .find_map(|(end, format)| name.ends_with(end).then_some(format))
    }
}

/// What a file of that name does not keep of a volume as it is; `None` when it keeps everything but the unit.
pub fn caveat(path: &Path, desc: &VolumeDesc) -> Option<&'static str> {
    let rescaled = desc.rescale != Rescale::IDENTITY;
    match Format::of(path)? {
        Format::Nifti => nifti::is_rounded(desc).then_some(
            "NIfTI-1 keeps affine and rescale as f32, so they are rounded; .nrrd keeps them exactly",
        ),
        Format::Nrrd => rescaled.then_some(
            "NRRD has no slope and intercept, so physical values are written, as double; .nii.gz keeps both apart",
        ),
        Format::Zarr => (!zarr::is_upright(&desc.world_from_index)).then_some(
            "OME-Zarr keeps spacing and position, but no turned axes; brickscope finds the whole affine in an attribute of its own",
        ),
        Format::Raw => {
            let plain = DAffine3::from_scale(desc.spacing());
            (rescaled || desc.world_from_index != plain).then_some(
                "a .raw file keeps neither affine nor rescale; .nii.gz and .nrrd keep the place",
            )
        }
    }
}

/// Starts writing the volume that `desc` describes to `path`; the name (`.nii.gz`, `.nrrd` or `.raw`) says the format.
///
/// NIfTI keeps voxels, type, rescale and affine (the latter two as f32 up to 32767 voxels per axis). NRRD has no rescale: where there is one, physical values are written as
/// double. Raw keeps voxels and type only.
///
/// # Errors
/// The name says no format that is built, or the file can't be made.
pub fn create(
    path: &Path,
    desc: &VolumeDesc,
    existing: Existing,
) -> Result<Box<dyn VolumeWriter>, ExportError> {
    match Format::of(path) {
        Some(Format::Nifti) => Ok(Box::new(nifti::create(path, desc, existing)?)),
        Some(Format::Nrrd) => Ok(Box::new(nrrd::create(path, desc, existing)?)),
        Some(Format::Raw) => Ok(Box::new(raw::create(path, desc, existing)?)),
        Some(Format::Zarr) | None => Err(ExportError::UnknownFormat(path.to_owned())),
    }
}

#[cfg(test)]
mod tests;
