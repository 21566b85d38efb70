//! From what was typed to a voxel of the lumen: checks of seeds, and the middle of the lumen near a point.

use glam::{DVec3, I64Vec3, U64Vec3, UVec3};

use super::error::{CenterlineError, NearestLumen};
use super::lumen::Lumen;
use super::region::Region;
use crate::geom::BRICK_EDGE;

/// Most bricks that are decoded to say where the lumen is, when a seed is not in it.
const MOST_DECODED: usize = 4096;

/// How far off a seed may be on a coarse level, where voxels are means of finer ones, in voxels.
const COARSE_REACH: i64 = 3;

/// The voxel of a seed, which must be lumen.
///
/// # Errors
/// It is outside the volume or not lumen: then the nearest voxel that is; or a brick is damaged.
pub(super) fn seed_voxel(
    lumen: &mut Lumen<'_>,
    seed: &'static str,
    at: DVec3,
) -> Result<U64Vec3, CenterlineError> {
    let space = lumen.space;
    let Some(voxel) = space.voxel(at) else {
        return Err(CenterlineError::Outside {
            seed,
            at,
            voxel: space.voxel_from_world.transform_point3(at),
            dims: space.dims(),
        });
    };
    if lumen.contains(voxel)? {
        return Ok(voxel);
    }
    let (low, high) = lumen.range();
    Err(CenterlineError::NotLumen {
        seed,
        at,
        value: lumen.value(voxel)?,
        low,
        high,
        nearest: nearest_lumen(lumen, at)?,
    })
}

/// The voxel of `is_wanted` that is nearest to a point, at most [`COARSE_REACH`] voxels away.
///
/// # Errors
/// As `is_wanted`.
pub(super) fn near_voxel(
    lumen: &mut Lumen<'_>,
    at: DVec3,
    is_wanted: &mut dyn FnMut(&mut Lumen<'_>, U64Vec3) -> Result<bool, CenterlineError>,
) -> Result<Option<U64Vec3>, CenterlineError> {
    let space = lumen.space;
    let middle = space.nearest_voxel(at).as_i64vec3();
    let dims = space.dims().as_i64vec3();
    let mut best: Option<(f64, U64Vec3)> = None;
    for step in cube(COARSE_REACH) {
        let v = middle + step;
        if !(v.cmpge(I64Vec3::ZERO).all() && v.cmplt(dims).all()) {
            continue;
        }
        let v = v.as_u64vec3();
        let d = space.world(v).distance(at);
        if best.is_none_or(|(least, _)| d < least) && is_wanted(lumen, v)? {
            best = Some((d, v));
        }
    }
    Ok(best.map(|(_, v)| v))
}

fn cube(reach: i64) -> impl Iterator<Item = I64Vec3> {
    let span = -reach..=reach;
    span.clone().flat_map(move |z| {
        let (ys, xs) = (span.clone(), span.clone());
        ys.flat_map(move |y| xs.clone().map(move |x| I64Vec3::new(x, y, z)))
    })
}

/// The voxel of the lumen that is nearest to a point: shells of bricks around it, until the next can't be nearer.
fn nearest_lumen(
    lumen: &mut Lumen<'_>,
    at: DVec3,
) -> Result<Option<NearestLumen>, CenterlineError> {
    let space = lumen.space;
    let middle = (space.nearest_voxel(at) / u64::from(BRICK_EDGE)).as_i64vec3();
    let bricks = space.grid.bricks.as_i64vec3();
    let farthest = middle.max(bricks - 1 - middle).max_element();
    let mut best: Option<(f64, U64Vec3)> = None;
    let mut decoded = 0;
    for shell in 0..=farthest {
        // Every voxel of this shell is at least so many voxels away along some axis.
        let least = (shell - 1).max(0) as f64 * f64::from(BRICK_EDGE) * space.least_mm();
        if best.is_some_and(|(d, _)| d < least) || decoded > MOST_DECODED {
            break;
        }
        for xyz in shell_of(middle, shell, bricks) {
            if !lumen.may_hold(xyz) {
                continue;
            }
            decoded += 1;
            let Some(bits) = lumen.bits(xyz)? else {
                continue;
            };
            let start = xyz.as_u64vec3() * u64::from(BRICK_EDGE);
            for (i, &row) in bits.iter().enumerate() {
                let (y, z) = (
                    i as u64 % u64::from(BRICK_EDGE),
                    i as u64 / u64::from(BRICK_EDGE),
                );
                for x in (0..u64::from(BRICK_EDGE)).filter(|x| row >> x & 1 == 1) {
                    let v = start + U64Vec3::new(x, y, z);
                    let d = space.world(v).distance(at);
                    if best.is_none_or(|(least, _)| d < least) {
                        best = Some((d, v));
                    }
                }
            }
        }
    }
    let Some((distance_mm, voxel)) = best else {
        return Ok(None);
    };
    Ok(Some(NearestLumen {
        at: space.world(voxel),
        value: lumen.value(voxel)?,
        distance_mm,
    }))
}

/// The bricks whose greatest distance along an axis from `middle` is `shell`.
fn shell_of(middle: I64Vec3, shell: i64, bricks: I64Vec3) -> impl Iterator<Item = UVec3> {
    let (low, high) = (
        (middle - shell).max(I64Vec3::ZERO),
        (middle + shell).min(bricks - 1),
    );
    (low.z..=high.z).flat_map(move |z| {
        (low.y..=high.y).flat_map(move |y| {
            let is_side = (z - middle.z).abs() == shell || (y - middle.y).abs() == shell;
            (low.x..=high.x)
                .filter(move |x| is_side || (x - middle.x).abs() == shell)
                .map(move |x| I64Vec3::new(x, y, z).as_uvec3())
        })
    })
}

/// The open voxel that is most in the middle of the lumen near a point: that with the greatest distance to the wall less half
/// its distance from the point, among those whose ball up to the wall holds the point, or whose centre is within `slack_mm`
/// of it. `is_wanted` may rule out more.
pub(super) fn middle_near(
    region: &Region,
    at: DVec3,
    slack_mm: f64,
    is_wanted: &dyn Fn(usize) -> bool,
) -> Option<usize> {
    let most = region
        .distance_mm
        .iter()
        .zip(&region.is_open)
        .filter(|(d, open)| **open && d.is_finite())
        .map(|(&d, _)| f64::from(d))
        .fold(slack_mm, f64::max);
    let space = region.space;
    let center = space.nearest_voxel(at).as_i64vec3();
    let reach = (DVec3::splat(most) / space.spacing_mm).ceil().as_i64vec3();
    let mut best: Option<(f64, usize)> = None;
    for z in center.z - reach.z..=center.z + reach.z {
        for y in center.y - reach.y..=center.y + reach.y {
            for x in center.x - reach.x..=center.x + reach.x {
                let v = I64Vec3::new(x, y, z);
                if v.min_element() < 0 {
                    continue;
                }
                let Some(i) = region.index(v.as_u64vec3()) else {
                    continue;
                };
                if !region.is_open[i] {
                    continue;
                }
                let (d, away) = (
                    f64::from(region.distance_mm[i]),
                    region.world(i).distance(at),
                );
                let score = d - 0.5 * away;
                if away <= d.max(slack_mm) && best.is_none_or(|(s, _)| score > s) && is_wanted(i) {
                    best = Some((score, i));
                }
            }
        }
    }
    best.map(|(_, i)| i)
}
