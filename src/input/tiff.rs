//! TIFF and BigTIFF: one file of many pages, or one page per file.
//!
//! ImageJ stacks and OME-TIFF say in the description of the first page which page is which slice, channel and point in time;
//! without either the pages are the slices. Directories are read and checked here, by position and against the file's
//! length; strips and tiles are decompressed by the crate `tiff`, each by itself, so that several are at once.
//!
//! Voxel (i, j, k) is column i, row j, page k, whatever the orientation tag says. Values are kept as they are stored. Not
//! here: colour, bits, pyramids, sets of several OME-TIFF files; each is refused or left out by name.

mod chunks;
mod description;
mod directory;
mod imagej;
mod layout;
mod ome;
mod one_file;
mod page;
mod series;

use std::path::PathBuf;

use super::options::OpenOptions;
use super::problem::Subject;
use crate::volume::{SourceError, VoxelSource};

const SUPPORTED: &str = "supported are TIFF files of grey values: integers of 8, 16 or 32 bits, float or double, \
                         uncompressed or compressed by LZW, deflate, PackBits, zstd or JPEG";

/// True when `bytes`, the first ones of a file, are TIFF's.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// Opens one file, or several as the slices of a volume in their order. `subject` is what the user named them by.
///
/// # Errors
/// A file can't be read, is damaged, holds something that is not built, or does not go with the others or with `options`.
pub(super) fn open(
    files: &[PathBuf],
    subject: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let stack = match files {
        [file] => one_file::open(file, subject, options)?,
        files => series::open(files, subject, options)?,
    };
    Ok(Box::new(stack))
}

#[cfg(test)]
mod tests;
