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
// lib/feedback.wgsl.
@group(2) @binding(6) var<storage, read_write> feedback: array<atomic<u32>>;

override GROUP_WIDTH: u32 = 8u;
override GROUP_HEIGHT: u32 = 8u;
// Phong shading.
override SHADED: bool = false;
// Rays go on behind what they have met: surfaces may be translucent.
override MANY_EVENTS: bool = false;
// Coarser bricks stand in for missing ones; rays don't wait.
override DRAFT: bool = false;

// The ray of one invocation, and what it has gathered.
struct Cast {
    // Number of the work-group in the tile or in the list of pixels, and of the pixel in the tile's buffers.
    group: u32,
    at: u32,
    // Pixel of the tile, and of the picture.
    tile_pixel: vec2u,
    pixel: vec2u,
    ray: Ray,
    // Mesh interval, brick and block skipping? With and without, the picture is the same to the bit.
    skips: bool,
    // The ray meets the volume, at this level or at a finer one.
    is_inside: bool,
    // Nothing to do: outside the picture, or finished before.
    is_idle: bool,
    // Samples at levels that are done are in here.
    skipped: u32,
    samples: u32,
    contributing: u32,
    // After so many samples the ray goes on in the next dispatch.
    limit: u32,
    // A brick was missing; the ray waits for it; it has used up the dispatch's samples.
    missed: bool,
    stopped: bool,
    paused: bool,
}

fn cast_interval(caster: Cast) -> vec2f {
    if caster.skips {
        return interval_of_pixel(caster.tile_pixel, caster.ray.stretch);
    }
    return vec2f(-1e30, 1e30);
}

// What the host ordered for this dispatch. Not in the uniforms: where a condition depends on uniforms alone, lavapipe puts
// their values into the code and compiles it anew (half a second) whenever the uniforms change.
fn cast_order(word: u32) -> u32 {
    return atomicLoad(&feedback[frame.orders_at + word]);
}

// The pixel of an invocation in its work-group. Eight in a row of invocations are 4×2 pixels: a software adapter runs them
// as one, and what they do differs the less the nearer they are.
fn cast_place(local: vec3u) -> vec2u {
    let index = local.y * GROUP_WIDTH + local.x;
    let block = index >> 3u;
    let blocks_wide = GROUP_WIDTH >> 2u;
    return vec2u((block % blocks_wide) * 4u + (index & 3u), (block / blocks_wide) * 2u + ((index >> 2u) & 1u));
}

// The pixel of the tile that an invocation casts: in its place in the picture, or the one that the host listed for it. In one
// pipeline, so that a pixel is the same to the bit either way.
fn cast_tile_pixel(group: u32, local: vec3u) -> vec2u {
    if cast_order(FEEDBACK_PIXELS) != 0u {
        let number = group * GROUP_WIDTH * GROUP_HEIGHT + local.y * GROUP_WIDTH + local.x;
        let wide = textureDimensions(pixel_list).x;
        let pixel = textureLoad(pixel_list, vec2u(number % wide, number / wide), 0).x;
        return vec2u(pixel & 0xffffu, pixel >> 16u);
    }
    let groups_wide = (frame.tile_size.x + GROUP_WIDTH - 1u) / GROUP_WIDTH;
    return vec2u(group % groups_wide, group / groups_wide) * vec2u(GROUP_WIDTH, GROUP_HEIGHT) + cast_place(local);
}

// The ray of an invocation, at its beginning or where it stopped. The host lists the work-groups that have something to do.
fn cast_begin(
    group: vec3u,
    local: vec3u,
    state: ptr<function, RayState>,
    walk: ptr<function, Walk>,
) -> Cast {
    var caster: Cast;
    caster.group = cast_order(FEEDBACK_GROUPS + group.x);
    caster.tile_pixel = cast_tile_pixel(caster.group, local);
    caster.pixel = frame.tile_origin + caster.tile_pixel;
    caster.limit = cast_order(FEEDBACK_LIMIT);
    caster.skips = cast_order(FEEDBACK_SKIP) != 0u;
    caster.is_idle = any(caster.tile_pixel >= frame.part_size);
    caster.at = min(caster.tile_pixel.y, frame.tile_size.y - 1u) * frame.tile_size.x + min(caster.tile_pixel.x, frame.tile_size.x - 1u);
    if !DRAFT {
        *state = rays[caster.at];
        caster.is_idle |= ((*state).flags & RAY_FINISHED) != 0u;
    }
    var level = 0u;
    if MANY_LEVELS {
        level = (*state).flags & RAY_LEVEL_MASK;
    }
    caster.ray = ray_for_pixel(caster.pixel, level);
    caster.is_inside = caster.ray.first <= caster.ray.last || ((*state).flags & RAY_INSIDE) != 0u;
    if caster.is_idle {
        caster.ray.last = -1;
    }
    *walk = walk_begin(caster.ray, cast_interval(caster), (*state).next);
    return caster;
}

// The next run of samples: with skipping from the walk, without it the whole ray once; then the next coarser level.
fn cast_next_run(caster: ptr<function, Cast>, walk: ptr<function, Walk>) -> bool {
    loop {
        if cast_next_run_of_level(*caster, walk) {
            return true;
        }
        if !MANY_LEVELS || (*caster).ray.grid.level + 1u >= frame.used_levels || (*caster).is_idle {
            break;
        }
        (*caster).skipped += cast_skipped(*caster, *walk);
        (*caster).ray = ray_for_pixel((*caster).pixel, (*caster).ray.grid.level + 1u);
        (*caster).is_inside |= (*caster).ray.first <= (*caster).ray.last;
        let greatest = (*walk).greatest;
        *walk = walk_begin((*caster).ray, cast_interval(*caster), 0);
        (*walk).greatest = greatest;
    }
    return false;
}

// The next one at the ray's level.
fn cast_next_run_of_level(caster: Cast, walk: ptr<function, Walk>) -> bool {
    if caster.skips {
        return walk_next(caster.ray, walk);
    }
    let more = (*walk).next <= caster.ray.last;
    (*walk).first = (*walk).next;
    (*walk).last = caster.ray.last;
    (*walk).next = max((*walk).next, caster.ray.last + 1);
    return more;
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
    let skipped = caster.skipped + select(walk.skipped, cast_skipped(caster, walk), !is_pending && (outcome.flags & RAY_ENDED) == 0u);
    counts[caster.at].samples += caster.samples;
    counts[caster.at].skipped += skipped;
    counts[caster.at].contributing += caster.contributing;
    if DRAFT {
        if caster.missed {
            feedback_pending(caster.at, caster.group, true);
        }
        return;
    }
    var state: RayState;
    state.next = next;
    let flags = outcome.flags | caster.ray.grid.level | select(0u, RAY_INSIDE, caster.is_inside);
    state.flags = select(RAY_FINISHED, flags, is_pending);
    state.value = outcome.value;
    state.count = outcome.count;
    rays[caster.at] = state;
    if is_pending {
        feedback_pending(caster.at, caster.group, caster.stopped);
    }
}
