//! Volumes in: one file per format, each only turning a header into a [`VoxelSource`](crate::volume::VoxelSource).
//!
//! [`open`] finds the format by content. A format reader parses and checks its header, then hands the place of the voxels
//! to [`VoxelFile`], which reads them box by box with positional reads (never a map, since resident memory is budgeted)
//! or slice by slice from a compressed stream. Formats of many small files or objects (OME-Zarr, N5, precomputed), in
//! folders or behind URLs, share `chunked` instead. [`phantom`] computes its voxels.
//!
//! Not here: bricks, levels, caches, and any change of values; voxels come out in the file's own type, little-endian.
//! Files are untrusted: every header field is checked before it is used, nothing is allocated by a header's word.

mod affine;
mod analyze;
mod choice;
mod chunked;
mod contents;
mod detect;
mod dicom;
mod files;
mod jpeg;
mod metaimage;
mod mgh;
mod mrc;
mod n5;
mod nifti;
mod nrrd;
mod options;
mod pair;
pub mod phantom;
mod picture;
mod precomputed;
mod problem;
mod pyramid;
mod raw;
mod spacing;
mod stack;
mod stamp;
mod stream;
mod text_header;
mod tiff;
mod voxel_file;
mod vti;
mod zarr;

pub use detect::{open, open_files};
pub use options::OpenOptions;
pub use pyramid::{levels, open_level};
pub use raw::{Endian, RawParams};
pub use voxel_file::VoxelFile;

/// Cases of each test that damages bytes; a thousand here, as many as `BRICKSCOPE_MUTATIONS` says (at build time) elsewhere.
#[cfg(test)]
const MUTATIONS: u32 = match option_env!("BRICKSCOPE_MUTATIONS") {
    None => 1000,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(cases) => cases,
        Err(_) => panic!("BRICKSCOPE_MUTATIONS: expected a number"),
    },
};
