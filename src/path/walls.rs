//! A camera that stays in the lumen: how far it comes on its way before a wall, along which it then slides. For whoever moves a
//! camera by hand; nothing here knows of events or frames.

use std::sync::Arc;

use glam::{DVec3, U64Vec3};

use super::error::CenterlineError;
use super::lumen::Lumen;
use super::region::{Region, grown};
use super::space::LevelSpace;
use crate::geom::{Lod, VoxelBox};
use crate::store::Store;

/// Voxels around the camera for which the walls are known, on each side.
const REACH_VOXELS: u64 = 40;
/// Of a voxel's least edge: how far a camera goes between two looks at the walls.
const STEP_VOXELS: f64 = 0.25;
/// How often a camera that came too near is put back from the wall.
const PUSHES: u32 = 4;

/// The walls of a lumen, found where the camera is.
pub struct Walls {
    store: Arc<Store>,
    lod: Lod,
    range: (f64, f64),
    near: Option<Near>,
}

/// Those around one place.
struct Near {
    voxels: VoxelBox,
    region: Region,
}

impl Walls {
    /// Walls are where values (physical) are not from `low` to `high` on level `lod`.
    pub fn new(store: &Arc<Store>, lod: Lod, (low, high): (f64, f64)) -> Self {
        Self {
            store: Arc::clone(store),
            lod,
            range: (low, high),
            near: None,
        }
    }

    /// Distance of a point from the nearest wall, mm; 0 outside the lumen. Beyond the volume there is no wall.
    ///
    /// # Errors
    /// A brick is damaged.
    pub fn clear_mm(&mut self, at: DVec3) -> Result<f64, CenterlineError> {
        Ok(clear_mm(&self.around(at)?.region, at))
    }

    /// Where a camera comes that wants from `from` to `to` and keeps `clearance_mm` from all walls: to `to`, or as far as it
    /// gets sliding along them. One that is nearer to a wall already comes no nearer; one that is not in the lumen is not
    /// held.
    ///
    /// # Errors
    /// A brick is damaged.
    pub fn slide(
        &mut self,
        from: DVec3,
        to: DVec3,
        clearance_mm: f64,
    ) -> Result<DVec3, CenterlineError> {
        let mut at = from;
        let mut clear = self.clear_mm(from)?;
        if clear <= 0.0 {
            return Ok(to);
        }
        let space = LevelSpace::of(&self.store, self.lod);
        let steps = ((to - from).length() / (STEP_VOXELS * space.least_mm())).ceil();
        let step = (to - from) / steps.max(1.0);
        for _ in 0..steps as u64 {
            let region = &self.around(at)?.region;
            let target = clearance_mm.min(clear);
            let Some((next, next_clear)) = one_step(region, at, step, target) else {
                break;
            };
            (at, clear) = (next, next_clear);
        }
        Ok(at)
    }

    /// The walls around a place: those that are known, if they reach far enough.
    fn around(&mut self, at: DVec3) -> Result<&Near, CenterlineError> {
        let space = LevelSpace::of(&self.store, self.lod);
        let voxel = space.nearest_voxel(at);
        let box_of = |reach: u64| {
            grown(
                &space,
                VoxelBox::new(voxel, voxel + 1),
                U64Vec3::splat(reach),
            )
        };
        let near = match self.near.take() {
            Some(near) if near.voxels.contains_box(&box_of(REACH_VOXELS / 2)) => near,
            _ => {
                let voxels = box_of(REACH_VOXELS);
                let mut lumen = Lumen::new(&self.store, self.lod, self.range)?;
                Near {
                    voxels,
                    region: Region::of_lumen(&mut lumen, voxels)?,
                }
            }
        };
        Ok(self.near.insert(near))
    }
}

/// As [`Region::clear_mm`], and 0 where the point's own voxel is none of the lumen.
fn clear_mm(region: &Region, at: DVec3) -> f64 {
    let voxel = region.space.nearest_voxel(at);
    match region.index(voxel) {
        Some(index) if region.is_open[index] => region.clear_mm(at),
        _ => 0.0,
    }
}

/// Where a step leads that keeps `target` mm from the walls, and how far they are from there; `None` if nowhere.
fn one_step(region: &Region, at: DVec3, step: DVec3, target: f64) -> Option<(DVec3, f64)> {
    let straight = at + step;
    let clear = clear_mm(region, straight);
    if clear >= target {
        return Some((straight, clear));
    }
    let away = away_from_wall(region, straight)?;
    let along = step - away * away.dot(step).min(0.0);
    let mut next = at + along;
    for _ in 0..PUSHES {
        let clear = clear_mm(region, next);
        if clear >= target {
            return Some((next, clear));
        }
        // A hair more than is missing, so that rounding does not make it another push.
        next += away * ((target - clear) * 1.01 + 1e-6 * region.space.least_mm());
    }
    None
}

/// The direction in which the distance to the wall grows.
fn away_from_wall(region: &Region, at: DVec3) -> Option<DVec3> {
    let half = 0.5 * region.space.least_mm();
    let along =
        |axis: DVec3| region.distance_at(at + axis * half) - region.distance_at(at - axis * half);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).try_normalize()
}
