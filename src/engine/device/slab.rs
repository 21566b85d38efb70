//! Technique slab: which slabs the device and its memory allow, and which bricks one needs at once. Pure arithmetic: the
//! caster itself is `shaders/pass/cast_slabs.wgsl`.

use std::collections::BTreeSet;

use glam::DVec3;

use super::super::EngineError;
use super::exact::{LevelRay, segment_slack, step_reach};
use super::paged::PagedVolume;
use crate::camera::Projection;
use crate::geom::{BRICK_EDGE, BrickId};
use crate::gpu::Caps;
use crate::gpu::layout::{RAY_FINISHED, RAY_LEVEL_MASK, RayState};
use crate::render::{FrameInputs, Tile};
use crate::scene::{Jitter, LevelFrame, PictureSettings, RayFrame, SlabRim, SlabShape};

/// Refuses what is no shape, what the device's work-groups don't hold, and rays that share no distances.
///
/// # Errors
/// It is one of these.
pub(super) fn check(
    shape: SlabShape,
    settings: &PictureSettings,
    caps: &Caps,
) -> Result<(), EngineError> {
    if !shape.is_sound() {
        return Err(EngineError::SlabShape { shape });
    }
    if settings.jitter != Jitter::None {
        return Err(EngineError::SlabJitter);
    }
    let limits = &caps.limits;
    let needs = [
        (
            "invocations",
            shape.rays(),
            limits.max_compute_invocations_per_workgroup,
        ),
        (
            "invocations along x",
            shape.width,
            limits.max_compute_workgroup_size_x,
        ),
        (
            "invocations along y",
            shape.height,
            limits.max_compute_workgroup_size_y,
        ),
        (
            "bytes",
            shape.shared_bytes(SlabRim::of(settings)),
            limits.max_compute_workgroup_storage_size,
        ),
    ];
    match needs.into_iter().find(|(_, needed, most)| needed > most) {
        None => Ok(()),
        Some((what, needed, most)) => Err(EngineError::SlabLimit {
            shape,
            what,
            needed,
            most,
        }),
    }
}

/// The slabs of that shape, or of fewer samples, of which one needs at most `slots` bricks at once; or how many the
/// shallowest needs.
pub(super) fn fitting(
    shape: SlabShape,
    slots: usize,
    bricks_of_depth: impl Fn(SlabShape) -> usize,
) -> Result<SlabShape, usize> {
    let mut fitting = shape;
    loop {
        let bricks = bricks_of_depth(fitting);
        if bricks <= slots {
            return Ok(fitting);
        }
        if fitting.depth == 1 {
            return Err(bricks);
        }
        fitting.depth /= 2;
    }
}

/// Slots that one slab of a picture of `settings` may need at once, at most.
pub(super) fn slab_bricks(
    rays: &RayFrame,
    settings: &PictureSettings,
    shape: SlabShape,
    bricks_of: impl Fn(&LevelFrame) -> DVec3,
) -> usize {
    let rim = SlabRim::of(settings);
    let pixel = [0, 1].map(|axis| 2.0 * rays.half_extent[axis] / f64::from(rays.size[axis]));
    let [wide, high] = shape.span(rim).map(|rays| f64::from(rays - 1));
    // Tangents or mm: what lies between the rays of opposite corners.
    let across = (pixel[0] * wide).hypot(pixel[1] * high);
    let planes = planes_before(rim) + f64::from(shape.depth - 1 + rim.sides);
    rays.used()
        .iter()
        .map(|level| {
            let far_mm = rays.reach_mm(level)[1] + f64::from(rim.sides) * level.step_mm_exact;
            let across_mm = match rays.projection {
                Projection::Orthographic => across,
                // Unit directions differ by no more than their tangents, or angles.
                _ => across * far_mm,
            };
            let steps = planes + across_mm / level.step_mm_exact;
            let reach = step_reach(level) * steps + 2.0 * segment_slack(settings);
            let bricks = (reach / f64::from(BRICK_EDGE)).ceil() + 1.0;
            let bricks = bricks.min(bricks_of(level));
            (bricks.x * bricks.y * bricks.z) as usize
        })
        .max()
        .unwrap_or(1)
}

/// Samples before the first that is shaded: those of gradients, and the beginning of its segment.
fn planes_before(rim: SlabRim) -> f64 {
    f64::from(rim.front.max(1))
}

/// The pixels of a work-group's part of the tile: its first one and, in pixels, its end.
fn group_of_pixel(tile: &Tile, shape: SlabShape, pixel: u32) -> [[u32; 2]; 2] {
    let group = [shape.width, shape.height];
    let first = [pixel % tile.size[0], pixel / tile.size[0]];
    let origin = [0, 1].map(|axis| first[axis] / group[axis] * group[axis]);
    [
        origin,
        [0, 1].map(|axis| (origin[axis] + group[axis]).min(tile.part_size[axis])),
    ]
}

/// The pixels of the tile's buffers from the first to the last of a work-group.
pub(super) fn pixels_of_group(tile: &Tile, shape: SlabShape, pixel: u32) -> std::ops::Range<u32> {
    let [origin, end] = group_of_pixel(tile, shape, pixel);
    let number = |x: u32, y: u32| y * tile.size[0] + x;
    number(origin[0], origin[1])..number(end[0] - 1, end[1] - 1) + 1
}

/// The bricks that the next slab of a stopped work-group, that of `pixel`, may need. `states` are of [`pixels_of_group`].
pub(super) fn bricks(
    inputs: &FrameInputs<'_>,
    shape: SlabShape,
    (tile, pixel): (&Tile, u32),
    states: &[RayState],
    volume: &PagedVolume,
) -> Vec<BrickId> {
    let rays = inputs.rays;
    let rim = SlabRim::of(inputs.settings);
    let [origin, end] = group_of_pixel(tile, shape, pixel);
    let stride = tile.size[0] as usize;
    let wide = (end[0] - origin[0]) as usize;
    let unfinished = states
        .chunks(stride)
        .flat_map(|row| &row[..wide])
        .filter(|s| s.flags & RAY_FINISHED == 0);
    let Some((level, first)) = unfinished.map(|s| (s.flags & RAY_LEVEL_MASK, s.next)).min() else {
        return Vec::new();
    };
    let level = &rays.levels[level as usize];
    let slack = segment_slack(inputs.settings);
    let begin = f64::from(first) - planes_before(rim);
    let segments = planes_before(rim) as u32 + shape.depth - 1 + rim.sides;
    let beside = i64::from(rim.sides);
    let corner = |axis: usize| i64::from(tile.origin[axis] + origin[axis]) - beside;
    let [span_x, span_y] = shape.span(rim).map(i64::from);
    let mut bricks = BTreeSet::new();
    for y in corner(1)..corner(1) + span_y {
        for x in corner(0)..corner(0) + span_x {
            let ray = LevelRay::new(rays, level, [x as f64, y as f64]);
            for segment in 0..segments {
                let at = begin + f64::from(segment);
                bricks.extend(volume.bricks_of_segment(
                    level.lod,
                    [ray.place(at), ray.place(at + 1.0)],
                    slack,
                ));
            }
        }
    }
    bricks.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_are_as_deep_as_the_memory_holds() {
        let shape = SlabShape {
            width: 8,
            height: 8,
            depth: 20,
        };
        let bricks_of = |s: SlabShape| 10 + s.depth as usize;
        let fits = |slots| fitting(shape, slots, bricks_of).map(|s| s.depth);
        assert_eq!(fits(30), Ok(20));
        assert_eq!(fits(29), Ok(10), "half");
        assert_eq!(fits(11), Ok(1));
        assert_eq!(fits(10), Err(11), "what the shallowest needs");
    }

    #[test]
    fn a_work_group_ends_with_the_picture() {
        let tile = Tile {
            origin: [100, 200],
            size: [64, 64],
            part_size: [50, 20],
        };
        let shape = SlabShape {
            width: 16,
            height: 8,
            depth: 4,
        };
        let pixel = 17 * 64 + 49;
        assert_eq!(group_of_pixel(&tile, shape, pixel), [[48, 16], [50, 20]]);
        let pixels = pixels_of_group(&tile, shape, pixel);
        assert_eq!(pixels, 16 * 64 + 48..19 * 64 + 50);
    }
}
