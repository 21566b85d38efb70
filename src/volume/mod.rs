//! What a volume is: its size, its voxel type, where it lies in the world, and the trait through which voxels come in.
//!
//! No file formats here (those are in `input`), no bricks (those are in `bricking` and `store`).
//!
//! World is millimetres in RAS+ (x to the patient's right, y to anterior, z to the head), the convention of NIfTI and
//! 3D Slicer. Values in files are *stored* values; *physical* = slope · stored + intercept.

mod desc;
mod source;
mod voxel_type;

pub use desc::{Rescale, VolumeDesc};
pub use source::{ReadOrder, SourceError, VoxelSource, check_read};
pub use voxel_type::{StoredType, VoxelType};
