//! Volumes, pictures and films out: NIfTI, NRRD, raw, PNG, OpenEXR and MP4.
//!
//! Writers get voxels in z order and stream them; each file appears only when it is complete ([`crate::outfile`]).
//! No rendering here, and no choice of what is exported. [`extract`] streams a store's voxels into such a file.

mod depth;
mod exr;
mod extract;
mod nifti;
mod nrrd;
mod png;
mod raw;
mod sink;
pub mod video;
mod writer;
mod zarr;

pub use self::depth::write_depth_png;
pub use self::exr::write_exr;
pub use self::extract::{extract, extracted};
pub use self::png::write_png;
pub use self::writer::{ExportError, VolumeWriter, caveat, create};
