//! Axis-aligned boxes: of whole voxels (`VoxelBox`) and of continuous positions (`Aabb`).

use glam::{DVec3, U64Vec3};

/// A box of whole voxels, `min` inclusive, `max` exclusive, x fastest. Empty when any `max ≤ min`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct VoxelBox {
    /// First voxel inside, per axis.
    pub min: U64Vec3,
    /// First voxel outside, per axis.
    pub max: U64Vec3,
}

impl VoxelBox {
    /// The box from `min` (inclusive) to `max` (exclusive).
    pub const fn new(min: U64Vec3, max: U64Vec3) -> Self {
        Self { min, max }
    }

    /// The whole of a volume of `dims` voxels.
    pub const fn whole(dims: U64Vec3) -> Self {
        Self::new(U64Vec3::ZERO, dims)
    }

    /// Voxels per axis; 0 where the box is empty.
    pub fn size(&self) -> U64Vec3 {
        U64Vec3::new(
            self.max.x.saturating_sub(self.min.x),
            self.max.y.saturating_sub(self.min.y),
            self.max.z.saturating_sub(self.min.z),
        )
    }

    /// Number of voxels, or `None` beyond `u64`.
    pub fn voxel_count(&self) -> Option<u64> {
        let size = self.size();
        size.x.checked_mul(size.y)?.checked_mul(size.z)
    }

    /// The part that both boxes share (possibly empty).
    pub fn intersection(&self, other: &Self) -> Self {
        Self::new(self.min.max(other.min), self.max.min(other.max))
    }

    /// True when no voxel is inside.
    pub fn is_empty(&self) -> bool {
        self.size().min_element() == 0
    }

    /// True when every voxel of `other` is inside `self`.
    pub fn contains_box(&self, other: &Self) -> bool {
        other.is_empty() || (self.min.cmple(other.min).all() && self.max.cmpge(other.max).all())
    }
}

/// An axis-aligned box of continuous positions, in whatever space its user names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Least corner.
    pub min: DVec3,
    /// Greatest corner.
    pub max: DVec3,
}

impl Aabb {
    /// The box from `min` to `max`.
    pub const fn new(min: DVec3, max: DVec3) -> Self {
        Self { min, max }
    }

    /// Its eight corners, x fastest.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            DVec3::new(
                if i & 1 == 0 { self.min.x } else { self.max.x },
                if i & 2 == 0 { self.min.y } else { self.max.y },
                if i & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }

    /// Its middle.
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }
}
