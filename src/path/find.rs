//! The centre-line of a lumen between two points, in the order in which it is worked out.

use std::collections::HashSet;

use glam::{DVec3, U64Vec3};

use super::axis::{AxisPoint, centred, evenly_spaced};
use super::error::CenterlineError;
use super::fill::{BYTES_PER_BRICK, Component};
use super::finer::{Way, finer};
use super::leak;
use super::lumen::Lumen;
use super::region::{Region, grown, working_bytes};
use super::seeds::{middle_near, near_voxel, seed_voxel};
use super::shortest::{Cost, search};
use super::smooth::smoothed;
use super::space::LevelSpace;
use crate::camera::{CameraPath, CameraPathError, Curve, Flight};
use crate::geom::{BRICK_EDGE, Lod, VoxelBox};
use crate::store::Store;

/// The smoothed line stays within this share of what is clear around the ridge.
const INNER: f64 = 0.5;
/// Smoothing, in radii of the lumen; less and less until the line is inside all along.
const SMOOTHING: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.0];
/// Most points of a centre-line.
const MOST_POINTS: f64 = 4000.0;
/// The camera looks ahead by so many radii, and at least so many voxels.
const AHEAD_RADII: f64 = 2.0;
const AHEAD_VOXELS: f64 = 5.0;

/// Where to fly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Destination {
    /// To a point of the lumen, world mm.
    At(DVec3),
    /// To the point of the lumen that is farthest away, along the lumen.
    Farthest,
}

/// What centre-line is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CenterlineRequest {
    /// A point of the lumen, world mm (RAS+).
    pub from: DVec3,
    /// Where to.
    pub to: Destination,
    /// Least physical value of the lumen.
    pub low: f64,
    /// Greatest physical value of the lumen.
    pub high: f64,
    /// Bound of the working memory, bytes.
    pub memory_bytes: u64,
}

/// The way through a lumen.
#[derive(Clone, Debug, PartialEq)]
pub struct Centerline {
    /// Its points, at constant arc length.
    pub points: Vec<AxisPoint>,
    /// The level whose voxels it was found in last.
    pub lod: Lod,
    /// The level that it was found on first: the finest on which the whole lumen fits the memory.
    pub first_lod: Lod,
    /// Voxels of the connected lumen, on that level.
    pub lumen_voxels: u64,
    /// The share of the way that lies in voxels of the lumen (of [`Self::lod`]) or specks of at most 64 voxels that the lumen
    /// encloses, looked up at every quarter voxel.
    pub inside_share: f64,
    /// Least spacing of the voxels of [`Self::lod`], mm.
    pub voxel_mm: f64,
}

impl Centerline {
    /// Its length, mm.
    pub fn length_mm(&self) -> f64 {
        Curve::through(&self.positions()).length_mm()
    }

    /// Its points' positions, mm.
    pub fn positions(&self) -> Vec<DVec3> {
        self.points.iter().map(|p| p.position).collect()
    }

    /// A flight along it at constant speed, looking ahead by two radii of the lumen and at least five voxels.
    ///
    /// # Errors
    /// The flight's settings can't be used.
    pub fn flight(&self, flight: &Flight) -> Result<CameraPath, CameraPathError> {
        let ahead: Vec<f64> = self
            .points
            .iter()
            .map(|p| (AHEAD_RADII * p.radius_mm).max(AHEAD_VOXELS * self.voxel_mm))
            .collect();
        flight.along(&self.positions(), &ahead)
    }
}

/// Finds the centre-line.
///
/// # Errors
/// See [`CenterlineError`].
pub fn centerline(
    store: &Store,
    request: &CenterlineRequest,
) -> Result<Centerline, CenterlineError> {
    found(store, request).map_err(|mut error| {
        // Worked out only where it is to be told: it reads all of the index.
        if let Some(bytes) = error.enough_bytes_mut()
            && let Ok(enough) = enough_bytes(store, request)
        {
            *bytes = enough;
        }
        error
    })
}

/// Bytes with which all that may be lumen on level 0 surely fits.
fn enough_bytes(store: &Store, request: &CenterlineRequest) -> Result<u64, CenterlineError> {
    let lumen = Lumen::new(store, Lod(0), (request.low, request.high))?;
    let grid = lumen.space.grid;
    let mut bounds = VoxelBox::new(U64Vec3::MAX, U64Vec3::ZERO);
    let mut bricks = 0u64;
    for index in 0..grid.len() {
        let xyz = grid.xyz(index);
        if lumen.may_hold(xyz) {
            let own = grid.brick_box(xyz);
            bounds = VoxelBox::new(bounds.min.min(own.min), bounds.max.max(own.max));
            bricks += 1;
        }
    }
    let around = grown(&lumen.space, bounds, U64Vec3::ONE)
        .voxel_count()
        .unwrap_or(u64::MAX);
    let most = bricks.saturating_mul(u64::from(BRICK_EDGE).pow(3));
    // Bricks beside the lumen are looked at, too.
    let table = grid.len().saturating_mul(BYTES_PER_BRICK);
    Ok(working_bytes(around, most.min(around)).saturating_add(table))
}

fn found(store: &Store, request: &CenterlineRequest) -> Result<Centerline, CenterlineError> {
    let (low, high) = (request.low, request.high);
    // NaN fails the comparison.
    if !(low <= high && low.is_finite() && high.is_finite()) {
        return Err(CenterlineError::Range { low, high });
    }
    let mut finest = Lumen::new(store, Lod(0), (low, high))?;
    seed_voxel(&mut finest, "--from", request.from)?;
    if let Destination::At(to) = request.to {
        seed_voxel(&mut finest, "--to", to)?;
    }
    drop(finest);
    let whole = whole(store, request)?;
    let first_lod = whole.space.lod;
    let lumen_voxels = whole.lumen_voxels;
    let (mut lod, mut space) = (first_lod, whole.space);
    let mut found = way(whole, request)?;
    while lod > Lod(0) {
        let mut lumen = Lumen::new(store, Lod(lod.0 - 1), (low, high))?;
        let Some(better) = finer(&mut lumen, &space, &found.line, request.memory_bytes)? else {
            break;
        };
        (lod, space, found) = (lumen.space.lod, lumen.space, better);
    }
    let mut lumen = Lumen::new(store, lod, (low, high))?;
    let (points, inside_share) = finished(&mut lumen, &found)?;
    Ok(Centerline {
        points,
        lod,
        first_lod,
        lumen_voxels,
        inside_share,
        voxel_mm: space.least_mm(),
    })
}

/// The connected lumen with its distances.
struct Whole {
    space: LevelSpace,
    region: Region,
    lumen_voxels: u64,
    start: U64Vec3,
    end: Option<U64Vec3>,
}

/// Fills the lumen on the finest level on which it fits the memory, and checks what came of it.
fn whole(store: &Store, request: &CenterlineRequest) -> Result<Whole, CenterlineError> {
    let memory = request.memory_bytes;
    let mut is_too_big = |bounds: &VoxelBox, bricks: u64| {
        let voxels = bounds.voxel_count().unwrap_or(u64::MAX);
        working_bytes(voxels, 0).saturating_add(bricks * BYTES_PER_BRICK) > memory
    };
    for level in 0..store.levels() {
        let lod = Lod(level as u8);
        let mut lumen = Lumen::new(store, lod, (request.low, request.high))?;
        let space = lumen.space;
        let lost = |seed, at| CenterlineError::Lost {
            seed,
            at,
            level: lod.0,
            enough_bytes: 0,
        };
        // On level 0 the seeds' own voxels were checked.
        let start = match level {
            0 => space.voxel(request.from),
            _ => near_voxel(&mut lumen, request.from, &mut |l, v| l.contains(v))?,
        };
        let start = start.ok_or_else(|| lost("--from", request.from))?;
        let Some(component) = Component::fill(&mut lumen, start, &mut is_too_big)? else {
            continue;
        };
        let lumen_voxels = component.count();
        let bounds = component.bounds();
        let voxels = bounds.voxel_count().unwrap_or(u64::MAX);
        if working_bytes(voxels, lumen_voxels) > memory {
            continue;
        }
        leak::check(&component, space.dims())?;
        let end = match request.to {
            Destination::Farthest => None,
            Destination::At(to) => {
                let near = match level {
                    0 => space.voxel(to).filter(|&v| component.contains(v)),
                    _ => near_voxel(&mut lumen, to, &mut |_, v| Ok(component.contains(v)))?,
                };
                match near {
                    Some(v) => Some(v),
                    None => {
                        return Err(not_connected(&mut lumen, &component, to, &mut is_too_big)?);
                    }
                }
            }
        };
        return Ok(Whole {
            space,
            region: Region::of_component(space, &component),
            lumen_voxels,
            start,
            end,
        });
    }
    Err(CenterlineError::Memory {
        found_bytes: memory,
        enough_bytes: 0,
    })
}

fn not_connected(
    lumen: &mut Lumen<'_>,
    component: &Component,
    to: DVec3,
    is_too_big: &mut dyn FnMut(&VoxelBox, u64) -> bool,
) -> Result<CenterlineError, CenterlineError> {
    let space = lumen.space;
    let other = match near_voxel(lumen, to, &mut |l, v| l.contains(v))? {
        Some(v) => Component::fill(lumen, v, is_too_big)?.map(|c| c.count()),
        None => Some(0),
    };
    let (gap_mm, nearest) = component
        .voxels()
        .map(|v| (space.world(v).distance(to), v))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .expect("invariant: a component has its seed");
    Ok(CenterlineError::NotConnected {
        from_voxels: component.count(),
        to_voxels: other,
        level: space.lod.0,
        nearest: space.world(nearest),
        gap_mm,
        enough_bytes: (space.lod > Lod(0)).then_some(0),
    })
}

/// The way through the whole lumen, on the ridge.
fn way(whole: Whole, request: &CenterlineRequest) -> Result<Way, CenterlineError> {
    let region = &whole.region;
    let place = |v: U64Vec3| {
        region
            .index(v)
            .expect("invariant: seeds are in the component")
    };
    let seed = place(whole.start);
    if !region.distance_mm[seed].is_finite() {
        return Err(CenterlineError::NoWall {
            level: whole.space.lod.0,
            at: request.from,
            low: request.low,
            high: request.high,
        });
    }
    let middle = |at: usize| middle_near(region, region.world(at), 0.0, &|_| true).unwrap_or(at);
    let start = middle(seed);
    let end = match whole.end {
        Some(v) => middle(place(v)),
        None => middle(search(region, start, None, Cost::Length).last),
    };
    if start == end {
        return Err(CenterlineError::NoWay(region.world(start)));
    }
    let reached = search(region, start, Some(end), Cost::Middle);
    Ok(Way {
        line: centred(region, &reached.way_to(end)),
        specks: whole.region.specks.into_iter().collect(),
    })
}

/// The line smoothed as much as it can be with every point of it inside, at constant arc length; and the share that is
/// inside.
fn finished(lumen: &mut Lumen<'_>, way: &Way) -> Result<(Vec<AxisPoint>, f64), CenterlineError> {
    let least = lumen.space.least_mm();
    let line = evenly_spaced(&way.line, 0.5 * least);
    let positions: Vec<DVec3> = line.iter().map(|p| p.position).collect();
    let step = positions[0].distance(positions[positions.len().min(2) - 1]);
    let mut best: Option<(Vec<AxisPoint>, f64)> = None;
    for strength in SMOOTHING {
        let lengths: Vec<f64> = line
            .iter()
            .map(|p| strength * p.radius_mm.max(2.0 * least))
            .collect();
        let bounds: Vec<f64> = line.iter().map(|p| INNER * p.clear_mm.max(0.0)).collect();
        let smooth: Vec<AxisPoint> = smoothed(&positions, step, &lengths, &bounds)
            .into_iter()
            .zip(&line)
            .map(|(position, p)| AxisPoint { position, ..*p })
            .collect();
        let mean = line.iter().map(|p| p.radius_mm).sum::<f64>() / line.len() as f64;
        let length = step * line.len() as f64;
        let apart = (0.25 * mean).max(least * if strength > 0.0 { 1.0 } else { 0.25 });
        let points = evenly_spaced(&smooth, apart.max(length / MOST_POINTS));
        let share = inside_share(lumen, &way.specks, &points)?;
        if best.as_ref().is_none_or(|(_, s)| share > *s) {
            best = Some((points, share));
        }
        if share == 1.0 {
            break;
        }
    }
    Ok(best.expect("invariant: there was a round"))
}

/// The share of the curve through `points` that lies in voxels of the lumen or specks in it, at every quarter voxel.
fn inside_share(
    lumen: &mut Lumen<'_>,
    specks: &HashSet<U64Vec3>,
    points: &[AxisPoint],
) -> Result<f64, CenterlineError> {
    let positions: Vec<DVec3> = points.iter().map(|p| p.position).collect();
    let curve = Curve::through(&positions);
    let length = curve.length_mm();
    let steps = (length / (0.25 * lumen.space.least_mm())).ceil() as u64;
    let mut inside = 0u64;
    for k in 0..=steps {
        let p = curve.at(length * k as f64 / steps.max(1) as f64);
        if let Some(voxel) = lumen.space.voxel(p) {
            inside += u64::from(lumen.contains(voxel)? || specks.contains(&voxel));
        }
    }
    Ok(inside as f64 / (steps + 1) as f64)
}
