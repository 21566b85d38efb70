//! The voxels of a level in the world.

use glam::{DAffine3, DMat3, DVec3, I64Vec3, U64Vec3};

use crate::geom::{BrickGrid, Lod};
use crate::store::Store;

/// Where the voxels of a level are.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelSpace {
    pub(super) lod: Lod,
    pub(super) grid: BrickGrid,
    /// Voxel index of the level (centres at the integers) to world millimetres.
    pub(super) world_from_voxel: DAffine3,
    pub(super) voxel_from_world: DAffine3,
    /// Distance of neighbouring centres along each axis, mm.
    pub(super) spacing_mm: DVec3,
}

impl LevelSpace {
    pub(super) fn of(store: &Store, lod: Lod) -> Self {
        let level = store.level(lod);
        let world = store.meta().world_from_index;
        // The centre of voxel i of the level is at scale · (i + ½) − ½ in indices of level 0.
        let world_from_voxel = DAffine3 {
            matrix3: world.matrix3 * DMat3::from_diagonal(level.scale),
            translation: world.transform_point3(level.scale * 0.5 - 0.5),
        };
        let m = world_from_voxel.matrix3;
        Self {
            lod,
            grid: level.grid,
            world_from_voxel,
            voxel_from_world: world_from_voxel.inverse(),
            spacing_mm: DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length()),
        }
    }

    /// Voxels along each axis.
    pub(super) fn dims(&self) -> U64Vec3 {
        self.grid.voxels
    }

    /// The centre of a voxel, mm.
    pub(super) fn world(&self, voxel: U64Vec3) -> DVec3 {
        self.world_from_voxel.transform_point3(voxel.as_dvec3())
    }

    /// The voxel that holds a point; `None` outside the volume.
    pub(super) fn voxel(&self, world: DVec3) -> Option<U64Vec3> {
        let v = (self.voxel_from_world.transform_point3(world) + 0.5).floor();
        let dims = self.dims().as_dvec3();
        (v.cmpge(DVec3::ZERO).all() && v.cmplt(dims).all()).then(|| v.as_u64vec3())
    }

    /// The voxel nearest to a point.
    pub(super) fn nearest_voxel(&self, world: DVec3) -> U64Vec3 {
        let v = self.voxel_from_world.transform_point3(world).round();
        v.clamp(DVec3::ZERO, self.dims().as_dvec3() - 1.0)
            .as_u64vec3()
    }

    /// Length of a step of whole voxels, mm.
    pub(super) fn step_mm(&self, step: I64Vec3) -> f64 {
        self.world_from_voxel
            .transform_vector3(step.as_dvec3())
            .length()
    }

    /// Least spacing, mm.
    pub(super) fn least_mm(&self) -> f64 {
        self.spacing_mm.min_element()
    }

    /// Half a voxel's diagonal, mm: no point of a voxel is farther from its centre.
    pub(super) fn half_diagonal_mm(&self) -> f64 {
        0.5 * self.spacing_mm.length()
    }
}
