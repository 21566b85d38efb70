//! Gradients for the lanes: central differences, or their mean over seven points (design.md §3).

use super::field::{Field, Place, VoxelKind};
use super::rays::{Vec3, axes};
use super::simd::Lanes;
use crate::scene::{GradientFilter, LevelFrame};

/// The gradient at `offset`, where `lanes` are in the bricks of `place`, in world units.
#[inline(always)]
pub(super) fn world_gradient<L: Lanes, K: VoxelKind>(
    l: L,
    filter: GradientFilter,
    field: &mut Field<'_, '_, L>,
    level: &LevelFrame,
    place: &Place<L>,
    offset: Vec3<L>,
    lanes: L::M,
) -> Vec3<L> {
    let g = match filter {
        GradientFilter::Central => central::<L, K>(l, field, place, offset),
        GradientFilter::Filtered => filtered::<L, K>(l, field, place, offset, lanes),
    };
    let columns = level.normal_from_gradient.to_cols_array_2d();
    axes!(n => {
        l.f(columns[0][n]) * g[0] + l.f(columns[1][n]) * g[1] + l.f(columns[2][n]) * g[2]
    })
}

/// Taps at ±½ voxel of the level, per level voxel: as far as a brick's border allows.
#[inline(always)]
fn central<L: Lanes, K: VoxelKind>(
    l: L,
    field: &Field<'_, '_, L>,
    place: &Place<L>,
    at: Vec3<L>,
) -> Vec3<L> {
    let half = l.f(0.5);
    let mut gradient = at;
    // A loop, so that there is less code to compile.
    for n in 0..3 {
        let (mut after, mut before) = (at, at);
        after[n] = at[n] + half;
        before[n] = at[n] - half;
        gradient[n] = field.value::<K>(l, place, after) - field.value::<K>(l, place, before);
    }
    gradient
}

/// The mean at the point and half a voxel away along each axis.
#[inline(always)]
fn filtered<L: Lanes, K: VoxelKind>(
    l: L,
    field: &mut Field<'_, '_, L>,
    place: &Place<L>,
    at: Vec3<L>,
    lanes: L::M,
) -> Vec3<L> {
    let half = l.f(0.5);
    let mut sum = central::<L, K>(l, field, place, at);
    // Loops whose ends the compiler doesn't know: unrolled, 36 interpolations in each of 27 casters took minutes to compile.
    for point_of in 0..std::hint::black_box(6) {
        let axis = point_of / 2;
        let mut point = at;
        point[axis] = at[axis] + if point_of % 2 == 0 { half } else { l.f(-0.5) };
        for n in 0..std::hint::black_box(3) {
            let mut values = [point[n]; 2];
            for (side, value) in [half, l.f(-0.5)].into_iter().zip(&mut values) {
                let mut tap = point;
                tap[n] = point[n] + side;
                *value = field.value_beside::<K>(l, place, tap, lanes);
            }
            sum[n] = sum[n] + (values[0] - values[1]);
        }
    }
    let points = l.f(7.0);
    axes!(n => sum[n] / points)
}
