//! A way found on a coarse level, found again on the next finer one: in a tube around it, piece by piece.
//!
//! Each piece is a box that fits the memory; it reaches so far beyond the way that distances to the wall are right along it. The
//! next piece begins at the voxel where the last one ended.

use std::collections::HashSet;

use glam::{DVec3, U64Vec3};

use super::axis::{AxisPoint, centred};
use super::error::CenterlineError;
use super::lumen::Lumen;
use super::region::{Region, grown, working_bytes};
use super::seeds::middle_near;
use super::shortest::{Cost, search};
use super::space::LevelSpace;
use crate::geom::VoxelBox;

/// A way on the ridge.
pub(super) struct Way {
    /// Its points, close together.
    pub(super) line: Vec<AxisPoint>,
    /// Voxels around it that are open though their values are not those of the lumen.
    pub(super) specks: HashSet<U64Vec3>,
}

/// The way along `coarse` (of `coarse_space`) through `lumen`, the next finer level; `None` when even a short piece of it
/// takes more than `memory_bytes`.
///
/// # Errors
/// The coarse way is not open there, or a brick is damaged.
pub(super) fn finer(
    lumen: &mut Lumen<'_>,
    coarse_space: &LevelSpace,
    coarse: &[AxisPoint],
    memory_bytes: u64,
) -> Result<Option<Way>, CenterlineError> {
    let space = lumen.space;
    let slack = 2.0 * coarse_space.spacing_mm.max_element();
    let Some(pieces) = pieces(&space, coarse, slack, memory_bytes) else {
        return Ok(None);
    };
    let (mut line, mut specks): (Vec<AxisPoint>, _) = (Vec::new(), HashSet::new());
    let mut begin: Option<U64Vec3> = None;
    for (first, last, voxels) in pieces {
        let piece = &coarse[first..=last];
        let closed = |near: DVec3| CenterlineError::Closed {
            coarse: coarse_space.lod.0,
            level: space.lod.0,
            near,
            enough_bytes: 0,
        };
        let points: Vec<DVec3> = piece.iter().map(|p| p.position).collect();
        let most = piece.iter().map(|p| p.radius_mm).fold(0.0, f64::max);
        let mut region = Region::of_lumen(lumen, voxels)?;
        region.keep_near(&points, 1.5 * most + slack);
        let start = match begin {
            Some(voxel) => region.index(voxel),
            None => middle_near(&region, points[0], slack, &|_| true),
        };
        let start = start.ok_or_else(|| closed(points[0]))?;
        let reached = search(&region, start, None, Cost::Middle);
        let to = points[points.len() - 1];
        let end = middle_near(&region, to, slack, &|i| reached.has(i)).ok_or_else(|| closed(to))?;
        let part = centred(&region, &reached.way_to(end));
        // Where two pieces meet there is one point.
        line.extend(&part[usize::from(!line.is_empty())..]);
        begin = Some(region.voxel(end));
        specks.extend(region.specks);
    }
    Ok(Some(Way { line, specks }))
}

/// Pieces of the way, as places of their first and last points, with their boxes; each as long as its box fits.
fn pieces(
    space: &LevelSpace,
    coarse: &[AxisPoint],
    slack_mm: f64,
    memory_bytes: u64,
) -> Option<Vec<(usize, usize, VoxelBox)>> {
    let mut pieces = Vec::new();
    let mut first = 0;
    while first + 1 < coarse.len() || pieces.is_empty() {
        let mut reach = Reach::of(space, &coarse[first]);
        let (mut last, mut fitting) = (first, None);
        for (i, point) in coarse.iter().enumerate().skip(first) {
            reach.add(space, point);
            let voxels = reach.voxels(space, slack_mm);
            let count = voxels.voxel_count()?;
            if working_bytes(count, count) > memory_bytes {
                break;
            }
            (last, fitting) = (i, Some(voxels));
        }
        // A piece must be longer than wide, or the way within it is anything.
        let length = coarse[first].position.distance(coarse[last].position);
        let is_end = last + 1 == coarse.len();
        if !is_end && length < 2.0 * coarse[first].radius_mm + slack_mm {
            return None;
        }
        pieces.push((first, last, fitting?));
        first = last;
        if is_end {
            break;
        }
    }
    Some(pieces)
}

/// Where points lie, in continuous indices of a level, and the greatest radius among them.
struct Reach {
    low: DVec3,
    high: DVec3,
    most_mm: f64,
}

impl Reach {
    fn of(space: &LevelSpace, point: &AxisPoint) -> Self {
        let at = space.voxel_from_world.transform_point3(point.position);
        Self {
            low: at,
            high: at,
            most_mm: point.radius_mm,
        }
    }

    fn add(&mut self, space: &LevelSpace, point: &AxisPoint) {
        let at = space.voxel_from_world.transform_point3(point.position);
        self.low = self.low.min(at);
        self.high = self.high.max(at);
        self.most_mm = self.most_mm.max(point.radius_mm);
    }

    /// The box around them from which no wall that matters is missing: those of the tube and what is nearest to it.
    fn voxels(&self, space: &LevelSpace, slack_mm: f64) -> VoxelBox {
        let margin = (DVec3::splat(3.0 * self.most_mm + 2.0 * slack_mm) / space.spacing_mm).ceil();
        let last = space.dims() - 1;
        let at = |v: DVec3| v.max(DVec3::ZERO).as_u64vec3().min(last);
        let around = VoxelBox::new(at(self.low.floor()), at(self.high.ceil()) + 1);
        grown(space, around, margin.as_u64vec3())
    }
}
