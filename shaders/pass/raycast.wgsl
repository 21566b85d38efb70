// What casters have in common: one invocation per ray. What a sample does to its ray is told by a file of mode/, each of which
// has the same functions; where values and gradients come from, by lib/direct.wgsl and lib/gradient.wgsl or by lib/slab.wgsl.
// The entry points are in cast_rays.wgsl and cast_slabs.wgsl. The twin is reference::{caster, modes}.
//
// A ray that meets a brick that is not there stores its state, asks for the brick, and goes on in a later dispatch: the
// picture is exact in the end, whatever fits the memory (design.md §2, invariant 2). In a DRAFT nothing waits: the nearest
// coarser resident brick stands in.

@group(2) @binding(0) var nearest_front: texture_depth_2d;
@group(2) @binding(1) var nearest_back: texture_depth_2d;
@group(2) @binding(2) var farthest_back: texture_depth_2d;
// Per pixel of the tile: premultiplied colour and opacity.
@group(2) @binding(3) var<storage, read_write> picture: array<vec4f>;
// Per pixel of the tile.
@group(2) @binding(4) var<storage, read_write> counts: array<PixelCounts>;
// Per pixel of the tile; zeros before the first dispatch.
@group(2) @binding(5) var<storage, read_write> rays: array<RayState>;
@group(2) @binding(7) var depth_sampler: sampler;
// The pixels of a dispatch that casts listed ones, row << 16 | column within the tile; 0xffffffff after the last.
@group(2) @binding(8) var pixel_list: texture_2d<u32>;
// With LEAP. Per pixel of the tile: where its ray may start, distance from the eye, mm (pass/leap.wgsl). Per pixel of the
// picture: up to which distance its ray is empty, for the next frame.
@group(2) @binding(9) var leap_starts: texture_2d<f32>;
@group(2) @binding(10) var leap_points: texture_storage_2d<r32float, write>;
// lib/feedback.wgsl.
@group(2) @binding(6) var<storage, read_write> feedback: array<atomic<u32>>;

// Phong shading.
override SHADED: bool = false;
// Rays go on behind what they have met: surfaces may be translucent.
override MANY_EVENTS: bool = false;
// Coarser bricks stand in for missing ones; rays don't wait.
override DRAFT: bool = false;
// In a DRAFT: rays start where the frame before allows it, and tell the next one.
override LEAP: bool = false;

// It is told how far rays went.
override DEPTHS: bool = false;

// The point of a ray that meets nothing: farther than anything, mm.
const LEAP_NOTHING: f32 = 1e30;

// The ray of one invocation, and what it has gathered.
struct Cast {
    // Number of the work-group in the tile or in the list of pixels, and of the pixel in the tile's buffers.
    group: u32,
    at: u32,
    // Pixel of the tile, and of the picture.
    tile_pixel: vec2u,
    pixel: vec2u,
    ray: Ray,
    part: Part,
    // Only the part of the ray that the mesh leaves? And there from active block to active block? However it is, the picture
    // is the same to the bit.
    is_bounded: bool,
    skips: bool,
    // The ray meets the volume, at this level or at a finer one.
    is_inside: bool,
    // Nothing to do: outside the picture, finished before, or waiting for a brick since a pass before.
    is_idle: bool,
    // Samples at levels that are done are in here.
    skipped: u32,
    samples: u32,
    contributing: u32,
    // With LEAP: up to which distance from the eye the ray is empty, mm.
    empty_mm: f32,
    // With LEAP: another ray or another frame may meet something here.
    is_near: bool,
    // After so many samples the ray goes on in the next dispatch.
    limit: u32,
    // A brick was missing; the ray waits for it; it has used up the dispatch's samples.
    missed: bool,
    stopped: bool,
    paused: bool,
    // A layer has ended the ray.
    ended: bool,
    // With DEPTHS: distances of what it met first in this dispatch, and of what ended it, mm; 0 where there is none.
    first_mm: f32,
    end_mm: f32,
}

// Something is met at `index`, which may end the ray.
fn cast_note(caster: ptr<function, Cast>, index: f32, is_met: bool, ends: bool) {
    if !DEPTHS {
        return;
    }
    let at_mm = (*caster).ray.first_mm + index * (*caster).ray.step_mm;
    let nearest_mm = select(min((*caster).first_mm, at_mm), at_mm, (*caster).first_mm == 0.0);
    (*caster).first_mm = select((*caster).first_mm, nearest_mm, is_met);
    (*caster).end_mm = select((*caster).end_mm, at_mm, is_met && ends);
}

fn cast_interval(caster: Cast) -> vec2f {
    var interval = vec2f(-1e30, 1e30);
    if caster.is_bounded {
        interval = interval_of_pixel(caster.tile_pixel, caster.ray.stretch);
    }
    if LEAP {
        interval.x = max(interval.x, textureLoad(leap_starts, caster.tile_pixel, 0).x);
    }
    return interval;
}

// Notes where the ray first met something, or nearly so, if it was in the segment before sample `next`, read from `level`.
fn cast_meet(caster: ptr<function, Cast>, next: i32, level: u32) {
    if LEAP && ((*caster).contributing > 0u || (*caster).is_near) && (*caster).empty_mm == LEAP_NOTHING {
        let segment = f32(next - 2) * (*caster).ray.step_mm + (*caster).ray.first_mm;
        (*caster).empty_mm = segment - frame.levels[level].leap_back_mm;
    }
}

// The ray of an invocation, at its beginning or where it stopped.
fn cast_begin(
    group: vec3u,
    local: vec3u,
    state: ptr<function, RayState>,
    walk: ptr<function, Walk>,
) -> Cast {
    var caster: Cast;
    // What a pass before has listed are whole work-groups; otherwise the host lists those that have something to do.
    let is_compacted = cast_order(FEEDBACK_COMPACTED) != 0u;
    caster.group = select(cast_order(FEEDBACK_GROUPS + group.x), group.x, is_compacted);
    caster.tile_pixel = cast_tile_pixel(caster.group, local, is_compacted || cast_order(FEEDBACK_PIXELS) != 0u);
    caster.pixel = frame.tile_origin + caster.tile_pixel;
    caster.limit = cast_order(FEEDBACK_LIMIT);
    let skip = cast_order(FEEDBACK_SKIP);
    caster.is_bounded = skip == SKIP_BLOCKS || skip == SKIP_OUTSIDE;
    caster.skips = skip == SKIP_BLOCKS || skip == SKIP_WITHOUT_MESH;
    caster.is_idle = cast_is_outside(caster.tile_pixel);
    caster.at = cast_number(caster.tile_pixel);
    caster.empty_mm = LEAP_NOTHING;
    if !DRAFT {
        *state = rays[caster.at];
        caster.is_idle |= ((*state).flags & (RAY_FINISHED | RAY_STOPPED)) != 0u;
    }
    var level = 0u;
    if MANY_LEVELS {
        level = (*state).flags & RAY_LEVEL_MASK;
    }
    caster.ray = ray_for_pixel(caster.pixel, level);
    caster.part = part_list(caster.tile_pixel, (*state).part);
    caster.part.is_capped = ((*state).flags & RAY_CAPPED) != 0u;
    part_cut(&caster);
    caster.is_inside = caster.ray.first <= caster.ray.last || ((*state).flags & RAY_INSIDE) != 0u;
    if caster.is_idle {
        caster.ray.last = -1;
    }
    *walk = walk_begin(caster.ray, cast_interval(caster), (*state).next);
    return caster;
}

// The next run of samples: with skipping from the walk, without it all of the interval once; then the next part of the ray or
// the next coarser level.
fn cast_next_run(caster: ptr<function, Cast>, walk: ptr<function, Walk>, mode: ptr<function, Mode>) -> bool {
    loop {
        if part_cap(caster, mode) {
            (*caster).ended = true;
            break;
        }
        if (*caster).stopped {
            break;
        }
        if cast_next_run_of_level(*caster, walk) {
            return true;
        }
        if (*caster).is_idle {
            break;
        }
        var level = (*caster).ray.grid.level;
        let is_last_level = !MANY_LEVELS || level + 1u >= frame.used_levels;
        if cast_part_is_done(*caster, is_last_level) {
            if (*caster).part.layer.a > 0.0 {
                (*caster).ended = mode_meet(mode, (*caster).part.layer);
                cast_note(caster, (*caster).part.end, true, (*caster).ended);
            }
            if (*caster).ended {
                break;
            }
            (*caster).part.number += 1u;
            (*caster).part.is_capped = false;
        } else if is_last_level {
            break;
        } else {
            level += 1u;
        }
        (*caster).skipped += cast_skipped(*caster, *walk);
        (*caster).ray = ray_for_pixel((*caster).pixel, level);
        part_cut(caster);
        (*caster).part.is_new = true;
        (*caster).is_inside |= (*caster).ray.first <= (*caster).ray.last;
        let greatest = (*walk).greatest;
        *walk = walk_begin((*caster).ray, cast_interval(*caster), 0);
        (*walk).greatest = greatest;
    }
    return false;
}

// The sample that a ray goes on with which has come to another part or level and found no run there: it may have stopped at a cut
// face, and nothing of what it had is of this part.
fn cast_moved_on(caster: ptr<function, Cast>, mode: ptr<function, Mode>, more: bool, next: i32) -> i32 {
    if more || !(*caster).part.is_new {
        return next;
    }
    mode_next_run(mode, *caster);
    return 0;
}

// Does the part of the ray end at its level, behind all samples that were taken?
fn cast_part_is_done(caster: Cast, is_last_level: bool) -> bool {
    if !CUT || caster.part.number >= caster.part.count {
        return false;
    }
    let behind = frame.levels[caster.ray.grid.level].last + select(1, 0, MODE_SEGMENTS);
    return is_last_level || caster.part.end <= f32(behind);
}

// The next one at the ray's level.
fn cast_next_run_of_level(caster: Cast, walk: ptr<function, Walk>) -> bool {
    if caster.skips {
        return walk_next(caster.ray, walk);
    }
    return walk_all(caster.ray, walk);
}

// Samples of the level that skipping has saved, when the level has been left behind.
fn cast_skipped(caster: Cast, walk: Walk) -> u32 {
    return walk.skipped + u32(max(caster.ray.last + 1 - walk.next, 0));
}

// What samples are read from: the brick that a position lies in, or in a draft the one that stands in for it, and the ray
// in the voxels of that brick's level.
struct Source {
    brick: Brick,
    base: vec3f,
    step: vec3f,
    // The voxels are needed, and neither there nor stood in for.
    is_missing: bool,
}

// The source at sample `index` of the ray's level, inside `brick`.
fn source_of(caster: Cast, brick: Brick, index: f32) -> Source {
    var source: Source;
    source.brick = brick;
    source.base = caster.ray.base;
    source.step = caster.ray.step;
    source.is_missing = brick.tag == TAG_ABSENT;
    if DRAFT {
        let all_levels = cast_order(FEEDBACK_LEVELS);
        var level = caster.ray.grid.level + 1u;
        while source.brick.tag == TAG_ABSENT && level < all_levels {
            let coarser = ray_for_pixel(caster.pixel, level);
            source.base = coarser.base;
            source.step = coarser.step * (caster.ray.step_mm / frame.levels[level].step_mm);
            source.brick = brick_at(grid_of(level), source.base + index * source.step);
            level += 1u;
        }
        feedback_touch(source.brick);
    }
    return source;
}

// Where sample `index` lies in the voxels of the source's level.
fn source_offset(source: Source, index: f32) -> vec3f {
    return source.base + index * source.step;
}

// Enters the brick that holds sample `index`: it is marked as used, or asked for when it is missing. Without it the ray
// stops, but in a draft.
fn cast_enter(caster: ptr<function, Cast>, brick: Brick, index: f32) -> Source {
    let source = source_of(*caster, brick, index);
    if source.is_missing {
        cast_miss(caster, brick);
    } else {
        feedback_touch(brick);
    }
    return source;
}

// The ray needs a brick of its level that is not there.
fn cast_miss(caster: ptr<function, Cast>, brick: Brick) {
    feedback_request((*caster).ray.grid, brick);
    (*caster).missed = true;
    (*caster).stopped = !DRAFT;
}

// What a mode has come to: the picture's colour, RAY_* bits, and what it carries on where the ray is not finished.
struct Outcome {
    color: vec4f,
    flags: u32,
    value: f32,
    count: u32,
}

// Stores it. `next`: the sample that the ray goes on with, where it is not finished.
fn cast_end(caster: Cast, walk: Walk, outcome: Outcome, next: i32) {
    if caster.is_idle {
        return;
    }
    picture[caster.at] = outcome.color;
    let is_pending = caster.stopped || caster.paused;
    // A level that is left behind for good was skipped where no samples were taken.
    let has_ended = caster.ended || (outcome.flags & RAY_ENDED) != 0u;
    let skipped = caster.skipped + select(walk.skipped, cast_skipped(caster, walk), !is_pending && !has_ended);
    counts[caster.at].samples += caster.samples;
    counts[caster.at].skipped += skipped;
    counts[caster.at].contributing += caster.contributing;
    if DEPTHS {
        let known_mm = counts[caster.at].first_mm;
        let is_nearer = caster.first_mm != 0.0 && (known_mm == 0.0 || caster.first_mm < known_mm);
        counts[caster.at].first_mm = select(known_mm, caster.first_mm, is_nearer);
        counts[caster.at].end_mm = caster.end_mm;
    }
    if LEAP {
        textureStore(leap_points, caster.pixel, vec4f(caster.empty_mm));
    }
    if DRAFT {
        if caster.missed {
            cast_pending(caster.at, caster.group, true);
        }
        return;
    }
    var state: RayState;
    state.next = next;
    // Where passes follow in the same submission, the last of them tells what is not finished.
    let is_quiet = cast_order(FEEDBACK_QUIET) != 0u;
    let flags = outcome.flags | caster.ray.grid.level | select(0u, RAY_INSIDE, caster.is_inside)
        | select(0u, RAY_CAPPED, caster.part.is_capped)
        | select(0u, RAY_STOPPED, is_quiet && caster.stopped);
    state.flags = select(RAY_FINISHED, flags, is_pending);
    state.value = outcome.value;
    state.count = outcome.count;
    state.part = caster.part.number;
    rays[caster.at] = state;
    if is_pending && !is_quiet {
        cast_pending(caster.at, caster.group, caster.stopped);
    }
}
