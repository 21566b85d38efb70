// From active block to active block along a ray: a DDA over bricks and, inside mixed bricks, over 4³ blocks
// (design.md §6). Yields runs of samples; the segments between runs pass inactive blocks only (invariant 4).
//
// A block's range covers half a voxel beyond its faces (6³ voxels), so that rounding in the DDA, far below half a voxel,
// can only skip what another block's range has shown to be invisible.

struct Walk {
    // Searched up to here, and to be searched up to there, in samples.
    at: f32,
    end: f32,
    // The 4³ block at `at`, in blocks of the level.
    block: vec3i,
    // One block forward along the ray, per axis: ±1.
    forward: vec3i,
    // Where the ray leaves block (or brick) b on an axis, in samples: b · scale + shift.
    block_scale: vec3f,
    block_shift: vec3f,
    brick_scale: vec3f,
    brick_shift: vec3f,
    // With EXTREME: the ray's greatest value so far (of the negated ones with MINIMUM).
    greatest: f32,
    // The current run of samples, both inclusive.
    first: i32,
    last: i32,
    // No sample before this one remains to be taken.
    next: i32,
    skipped: u32,
}

fn walk_block_at(ray: Ray, at: f32) -> vec3i {
    return (ray.grid.anchor + vec3i(floor(ray_offset(ray, at)))) >> vec3u(BLOCK_SHIFT);
}

// `interval`: the part of the ray that the bounding mesh leaves, mm from the eye. A ray that goes on has taken its samples
// before `next`: the segment that ends there is walked once more, with what is known of its blocks by now, so that the
// sample is taken if it is needed.
fn walk_begin(ray: Ray, interval: vec2f, next: i32) -> Walk {
    var walk: Walk;
    let reach = interval_reach(ray, interval);
    walk.at = max(reach.x, f32(next - 1));
    walk.end = reach.y;
    walk.next = max(ray.first, next);
    walk.first = walk.next;
    walk.last = ray.last;
    let last = (ray.grid.last + 1) * i32(BLOCKS_PER_EDGE) - 1;
    walk.block = clamp(walk_block_at(ray, walk.at), vec3i(0), last);
    walk.forward = select(vec3i(-1), vec3i(1), ray.step > vec3f(0.0));
    // The far face of b is at (b + 1 or b) · edge − anchor.
    let face = vec3f(max(walk.forward, vec3i(0)));
    let origin = vec3f(ray.grid.anchor) + ray.base;
    walk.block_scale = f32(BLOCK_EDGE) * ray.inverse_step;
    walk.block_shift = (face * f32(BLOCK_EDGE) - origin) * ray.inverse_step;
    walk.brick_scale = f32(BRICK_EDGE) * ray.inverse_step;
    walk.brick_shift = (face * f32(BRICK_EDGE) - origin) * ray.inverse_step;
    return walk;
}

// The axis of the least of three, exactly one: the first of equals.
fn walk_axis(t: vec3f, least: f32) -> vec3<bool> {
    let x = t.x == least;
    let y = !x && t.y == least;
    return vec3<bool>(x, y, !(x || y));
}

// Crosses brick `brick` as a whole.
fn walk_cross_brick(ray: Ray, walk: ptr<function, Walk>, brick: vec3i) {
    let t = vec3f(brick) * (*walk).brick_scale + (*walk).brick_shift;
    let at = min(min(t.x, t.y), t.z);
    let low = brick * i32(BLOCKS_PER_EDGE);
    let high = low + i32(BLOCKS_PER_EDGE) - 1;
    // On the axes that stay, the block is where the ray is; on the axis that leaves, the neighbour's first block.
    let inside = clamp(walk_block_at(ray, at), low, high);
    let beyond = select(low - 1, high + 1, (*walk).forward > vec3i(0));
    (*walk).block = select(inside, beyond, walk_axis(t, at));
    (*walk).at = max((*walk).at, at);
}

// BRICK_* bits of a brick for this ray.
fn walk_activity(ray: Ray, walk: Walk, brick: vec3i) -> u32 {
    let activity = brick_activity_of(ray.grid, brick);
    if EXTREME && brick_extreme(ray.grid, brick) <= walk.greatest {
        return BRICK_EMPTY;
    }
    return activity;
}

// Finds the next run; false when there is none. The caller takes samples walk.first ..= walk.last.
fn walk_next(ray: Ray, walk: ptr<function, Walk>) -> bool {
    let bricks = ray.grid.last + 1;
    // No sample is better than the volume's best. No condition of its own: at a draft's beginning it would depend on uniforms
    // alone, and lavapipe would compile the shader anew for every frame.
    let end = select((*walk).end, -1e30, EXTREME & ((*walk).greatest >= frame.extreme_end));
    loop {
        if (*walk).at > end {
            return false;
        }
        let brick = (*walk).block >> vec3u(BLOCKS_SHIFT);
        if any(brick < vec3i(0)) || any(brick >= bricks) {
            return false;
        }
        let activity = walk_activity(ray, *walk, brick);
        if activity == BRICK_EMPTY || activity == BRICK_EMPTY_ABOVE {
            walk_cross_brick(ray, walk, brick);
            continue;
        }
        let entry = (*walk).at;
        if activity == BRICK_FULL {
            // Neighbouring full bricks are one run; but what one of them yields may rule out the next.
            var full = brick;
            loop {
                walk_cross_brick(ray, walk, full);
                full = (*walk).block >> vec3u(BLOCKS_SHIFT);
                if EXTREME || (*walk).at > (*walk).end || any(full < vec3i(0)) || any(full >= bricks)
                    || brick_activity_of(ray.grid, clamp(full, vec3i(0), bricks - 1)) != BRICK_FULL {
                    break;
                }
            }
            if walk_take(ray, walk, entry) {
                return true;
            }
            continue;
        }
        // A mixed brick has a slot; by the slot's number lies which blocks are active: a bit for each, or with EXTREME a bound
        // for each group of eight.
        let row = brick_slot_number(brick_word(ray.grid, brick));
        var started = -1.0;
        // The word of occupancy in hand.
        var held = 16u;
        var bits = 0u;
        loop {
            let in_brick = (*walk).block & vec3i(i32(BLOCKS_PER_EDGE) - 1);
            var bit: u32;
            if EXTREME {
                let group = in_brick >> vec3u(1u);
                bit = 8u * u32(group.x + i32(BLOCKS_PER_EDGE / 2u) * (group.y + i32(BLOCKS_PER_EDGE / 2u) * group.z));
            } else {
                bit = u32(in_brick.x + i32(BLOCKS_PER_EDGE) * (in_brick.y + i32(BLOCKS_PER_EDGE) * in_brick.z));
            }
            if (bit >> 5u) != held {
                held = bit >> 5u;
                bits = occupancy[row * 16u + held];
            }
            var is_active = ((bits >> (bit & 31u)) & 1u) != 0u;
            if EXTREME {
                is_active = brick_bound((bits >> (bit & 31u)) & 255u) > (*walk).greatest;
            }
            if is_active {
                if started < 0.0 {
                    started = (*walk).at;
                }
            } else if started >= 0.0 {
                break;
            }
            let t = vec3f((*walk).block) * (*walk).block_scale + (*walk).block_shift;
            let at = min(min(t.x, t.y), t.z);
            (*walk).block += select(vec3i(0), (*walk).forward, walk_axis(t, at));
            (*walk).at = max((*walk).at, at);
            if any(((*walk).block >> vec3u(BLOCKS_SHIFT)) != brick) || (*walk).at > (*walk).end {
                break;
            }
        }
        if started >= 0.0 && walk_take(ray, walk, started) {
            return true;
        }
    }
    return false;
}

// Makes all that is left the current run, once; false when there is nothing.
fn walk_all(ray: Ray, walk: ptr<function, Walk>) -> bool {
    let entry = (*walk).at;
    if entry > (*walk).end {
        return false;
    }
    (*walk).at = (*walk).end;
    let is_run = walk_take(ray, walk, entry);
    (*walk).at = 1e30;
    return is_run;
}

// Makes [entry, walk.at] the current run: from sample ⌊entry⌋ to ⌈at⌉ (invariant 4), none taken twice. False when all
// of them have been.
fn walk_take(ray: Ray, walk: ptr<function, Walk>, entry: f32) -> bool {
    let first = max((*walk).next, i32(floor(entry)));
    (*walk).skipped += u32(first - (*walk).next);
    (*walk).first = first;
    (*walk).last = min(i32(ceil((*walk).at)), ray.last);
    (*walk).next = max(first, (*walk).last + 1);
    return first <= (*walk).last;
}
