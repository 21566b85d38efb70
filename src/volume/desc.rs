//! Size, type and place of a volume.

use glam::{DAffine3, DVec3, U64Vec3};
use serde::{Deserialize, Serialize};

use super::VoxelType;

/// physical value = `slope` · stored value + `intercept` (Hounsfield units for CT).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the formula above names both")]
pub struct Rescale {
    pub slope: f64,
    pub intercept: f64,
}

impl Rescale {
    /// Stored values are physical ones.
    pub const IDENTITY: Self = Self {
        slope: 1.0,
        intercept: 0.0,
    };

    /// The physical value of a stored one.
    pub fn physical(&self, stored: f64) -> f64 {
        self.slope * stored + self.intercept
    }

    /// The stored value (not rounded) of a physical one.
    pub fn stored(&self, physical: f64) -> f64 {
        (physical - self.intercept) / self.slope
    }
}

/// What a source says of its volume.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeDesc {
    /// Voxels per axis, x fastest; none is 0.
    pub dims: U64Vec3,
    /// Type of the voxels that `read_box` delivers.
    pub voxel_type: VoxelType,
    /// Voxel index (the centre of voxel (i, j, k) is at the integers) to world millimetres, RAS+.
    /// Finite and invertible.
    pub world_from_index: DAffine3,
    /// Physical value of a source value; slope is finite and not 0.
    pub rescale: Rescale,
    /// Unit of the physical value, such as `HU`; empty when unknown.
    pub unit: String,
    /// What to call the source in metadata: a file name, or `phantom:body:256,256,256`.
    pub name: String,
}

impl VolumeDesc {
    /// Distance of neighbouring voxel centres along each index axis, in millimetres.
    pub fn spacing(&self) -> DVec3 {
        let m = self.world_from_index.matrix3;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }

    /// Bytes of all voxels, or `None` beyond `u64`.
    pub fn byte_count(&self) -> Option<u64> {
        self.dims
            .x
            .checked_mul(self.dims.y)?
            .checked_mul(self.dims.z)?
            .checked_mul(self.voxel_type.size() as u64)
    }
}
