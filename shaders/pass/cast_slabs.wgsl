// The rays of a work-group advance together through slabs (techniques.md T5): all values of a slab are sampled into workgroup
// memory, then every ray takes its samples from there. A slab begins at the first sample that any of the rays has to take,
// so that nothing is sampled where all of them skip. Where a brick is missing, the whole group stops at the slab's beginning.

// Which samples of the slab each ray takes: a bit for each.
var<workgroup> slab_samples: array<u32, SLAB_RAYS>;
// The least level and, of the rays at that level, the least sample that is to be taken.
var<workgroup> slab_least_level: atomic<u32>;
var<workgroup> slab_least: atomic<i32>;
// A brick was missing.
var<workgroup> slab_missed: atomic<u32>;

const SLAB_NONE: i32 = 0x7fffffff;

// What the group does next.
struct SlabOrder {
    level: u32,
    first: i32,
    // Nothing more in this dispatch: bricks are missing, or the rays have taken as many samples as they may.
    missed: bool,
    paused: bool,
}

var<workgroup> slab_order: SlabOrder;
var<workgroup> slab_is_there: bool;

// The samples of the slab that the ray takes, which are to be found in its runs from sample `next` on. `walk` comes to the
// run that goes on behind the slab; `done`: there is none at this level.
fn slab_take(caster: Cast, walk: ptr<function, Walk>, first: i32, next: i32, done: ptr<function, bool>) -> u32 {
    var taken = 0u;
    let last = first + i32(SLAB_DEPTH) - 1;
    var at = next;
    while at <= last {
        let low = u32(at - first);
        let high = u32(min((*walk).last, last) - first);
        taken |= ((2u << high) - 1u) & ~((1u << low) - 1u);
        if (*walk).last > last {
            break;
        }
        if !cast_next_run_of_level(caster, walk) {
            *done = true;
            break;
        }
        at = (*walk).first;
    }
    return taken;
}

// The planes of which the ray at `place` among the group's is sampled, a bit for each: its own samples, and what gradients at
// those of its neighbours need.
fn slab_planes(place: vec2i) -> u32 {
    let rim = i32(SLAB_RIM);
    var planes = 0u;
    for (var y = -rim; y <= rim; y++) {
        let width = rim - abs(y);
        for (var x = -width; x <= width; x++) {
            let other = place + vec2i(x, y);
            if all(other >= vec2i(0)) && all(other < vec2i(i32(GROUP_WIDTH), i32(GROUP_HEIGHT))) {
                var of_other = slab_samples[u32(other.y) * GROUP_WIDTH + u32(other.x)] << SLAB_FRONT;
                if SLAB_FRONT > SLAB_RIM {
                    of_other |= of_other >> 1u;
                }
                for (var reach = width - abs(x); reach > 0; reach--) {
                    of_other |= (of_other << 1u) | (of_other >> 1u);
                }
                planes |= of_other;
            }
        }
    }
    return planes;
}

// Samples the values of a slab. Every invocation takes the rays whose number among those of group and rim is `index` and so
// many further. `pixel`: the group's first one.
fn slab_fill(caster: ptr<function, Cast>, pixel: vec2i, order: SlabOrder, index: u32) {
    let grid = grid_of(order.level);
    let low = frame.levels[order.level].box_min.xyz;
    let high = frame.levels[order.level].box_max.xyz;
    for (var number = index; number < SLAB_AREA; number += GROUP_WIDTH * GROUP_HEIGHT) {
        let place = vec2i(i32(number % SLAB_WIDE), i32(number / SLAB_WIDE)) - i32(SLAB_RIM);
        let ray = ray_through(vec2f(pixel + place), 0.0, order.level);
        var planes = slab_planes(place);
        var plane = firstTrailingBit(planes);
        while planes != 0u {
            var offset = clamp(ray_offset(ray, f32(order.first + i32(plane) - i32(SLAB_FRONT))), low, high);
            let brick = brick_at(grid, offset);
            if brick.tag == TAG_ABSENT {
                feedback_request(grid, brick);
                atomicStore(&slab_missed, 1u);
            } else {
                feedback_touch(brick);
            }
            loop {
                slab_values[plane * SLAB_AREA + number] = sample_value(brick, offset);
                planes &= planes - 1u;
                plane = firstTrailingBit(planes);
                offset = clamp(ray_offset(ray, f32(order.first + i32(plane) - i32(SLAB_FRONT))), low, high);
                if planes == 0u || !brick_contains(brick, offset) {
                    break;
                }
            }
        }
    }
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_slabs(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    var state: RayState;
    var walk: Walk;
    var caster = cast_begin(group, local, &state, &walk);
    var mode = mode_begin(caster, state, picture[caster.at]);
    walk.greatest = mode_bound(mode);
    let index = cast_index(local);
    let place = cast_place(local);
    let pixel = vec2i(caster.pixel) - vec2i(place);
    slab_place = (place.y + SLAB_RIM) * SLAB_WIDE + place.x + SLAB_RIM;
    var i = state.next;
    // The ray has samples left; the current run is used up.
    var more = true;
    var done = true;
    var slabs = 0u;
    if index == 0u {
        atomicStore(&slab_least_level, MAX_LEVELS);
        atomicStore(&slab_least, SLAB_NONE);
        atomicStore(&slab_missed, 0u);
    }
    workgroupBarrier();
    var order: SlabOrder;
    loop {
        if more && done {
            more = cast_next_run(&caster, &walk, &mode);
            done = false;
            i = select(select(i, 0, caster.part.is_new), walk.first, more);
            // Before anything can break off: what is stored must know that the level is another one.
            mode_next_run(&mode, caster);
            caster.part.is_new = false;
        }
        if MANY_LEVELS {
            if more {
                atomicMin(&slab_least_level, caster.ray.grid.level);
            }
            workgroupBarrier();
        }
        if more && (!MANY_LEVELS || caster.ray.grid.level == atomicLoad(&slab_least_level)) {
            atomicMin(&slab_least, i);
        }
        workgroupBarrier();
        if index == 0u {
            slab_order.level = select(0u, atomicLoad(&slab_least_level), MANY_LEVELS);
            slab_order.first = atomicLoad(&slab_least);
            slab_order.missed = atomicLoad(&slab_missed) != 0u;
            slab_order.paused = slabs * SLAB_DEPTH >= caster.limit;
        }
        order = workgroupUniformLoad(&slab_order);
        if order.first == SLAB_NONE || order.missed || order.paused {
            break;
        }
        // Everyone has read what the next slab begins with.
        if index == 0u {
            atomicStore(&slab_least_level, MAX_LEVELS);
            atomicStore(&slab_least, SLAB_NONE);
        }
        let skipped = walk.skipped;
        let takes_part = more && caster.ray.grid.level == order.level;
        var taken = 0u;
        if takes_part {
            taken = slab_take(caster, &walk, order.first, i, &done);
        }
        slab_samples[place.y * GROUP_WIDTH + place.x] = taken;
        workgroupBarrier();
        slab_fill(&caster, pixel, order, index);
        workgroupBarrier();
        if index == 0u {
            slab_is_there = atomicLoad(&slab_missed) == 0u;
        }
        if !workgroupUniformLoad(&slab_is_there) {
            walk.skipped = skipped;
            order.missed = true;
            break;
        }
        slab_begin(caster, order.first);
        if takes_part {
            var source: Source;
            loop {
                while taken != 0u {
                    i = order.first + i32(firstTrailingBit(taken));
                    taken &= taken - 1u;
                    mode_take(&mode, &caster, source, i);
                    caster.samples += 1u;
                    i += 1;
                    if mode.event {
                        break;
                    }
                }
                i = mode_resolve(&mode, &caster, i);
                if !MANY_EVENTS || !mode.event || mode.ended || caster.stopped {
                    break;
                }
                mode.event = false;
            }
            more = !mode.event;
        }
        walk.greatest = mode_bound(mode);
        if caster.stopped {
            // On its way to a surface: the group waits, too.
            atomicStore(&slab_missed, 1u);
            done = false;
        } else if takes_part && !done {
            i = max(order.first + i32(SLAB_DEPTH), walk.first);
        }
        slabs += 1u;
    }
    caster.stopped = caster.stopped || (more && order.missed);
    caster.paused = more && !caster.stopped;
    cast_end(caster, walk, mode_end(mode, caster, i), i);
}
