// Mode iso: surfaces of one or more values. Between two samples on different sides of some of them the ray meets these in
// the order of their values.

// How many there are, and whether the first one ends the ray.
override SURFACES: u32 = 1u;
override ONE_OPAQUE: bool = true;
// Bisection at a surface.
override REFINED: bool = true;

const MODE_SPLITS: bool = true;
const MODE_SEGMENTS: bool = true;

struct Mode {
    // Premultiplied colour and opacity.
    sum: vec4f,
    // The sample before the next one, −2 for none, and its zone: on the upper sides of how many surfaces it lies.
    before: i32,
    zone: u32,
    // With LEAP: its value.
    value: f32,
    // The zone from which the ray has come, where `event`: the last two samples lie in different ones.
    zone_from: u32,
    event: bool,
    ended: bool,
}

fn surface_value(k: u32) -> f32 {
    return frame.surface_values[k >> 2u][k & 3u];
}

fn surface_zone(value: f32) -> u32 {
    var zone = 0u;
    for (var k = 0u; k < SURFACES; k++) {
        zone += u32(value >= surface_value(k));
    }
    return zone;
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    let before = select(-2, state.next - 1, (state.flags & RAY_HAS_BEFORE) != 0u);
    let zone = (state.flags >> RAY_ZONE_SHIFT) & RAY_ZONE_MASK;
    return Mode(color, before, zone, 0.0, zone, false, false);
}

// A run that doesn't continue the last one starts afresh: its first sample doesn't follow `before`.
fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {
    // Levels don't continue each other, nor do parts: a segment has one level (design.md §3).
    (*mode).before = select((*mode).before, -2, caster.part.is_new);
}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let value = value_at(source, i);
    let zone = surface_zone(value);
    if LEAP {
        // A wall that is thinner than a step is met by some rays only, in each frame by others: where a step as steep as this
        // one would reach a surface, beyond it or before it, the next frame looks again.
        // So it does where the volume begins inside a body: next to it a ray may meet its surface.
        let follows = (*mode).before == i - 1;
        let reach = select(0.0, abs(value - (*mode).value), follows);
        (*caster).is_near |= !follows && zone > 0u;
        for (var k = 0u; k < SURFACES; k++) {
            let nearest = min(abs(value - surface_value(k)), abs((*mode).value - surface_value(k)));
            (*caster).is_near |= nearest <= reach;
        }
        (*mode).value = value;
    }
    (*mode).event = (*mode).before == i - 1 && zone != (*mode).zone;
    (*mode).zone_from = (*mode).zone;
    (*mode).zone = zone;
    (*mode).before = i;
}

fn mode_meet(mode: ptr<function, Mode>, layer: vec4f) -> bool {
    (*mode).sum += layer * (1.0 - (*mode).sum.a);
    return part_ends((*mode).sum, layer);
}

fn mode_caps(value: f32, opacity: f32) -> bool {
    return surface_zone(value) > 0u;
}

fn mode_bound(mode: Mode) -> f32 {
    return 0.0;
}

// Composites the surfaces between the last two samples. Behind the loops: software adapters would execute it for every
// sample. Returns the sample to go on with.
fn mode_resolve(mode: ptr<function, Mode>, caster: ptr<function, Cast>, next: i32) -> i32 {
    let hit = (*mode).event;
    let index = (*mode).before;
    let rising = (*mode).zone > (*mode).zone_from;
    let count = select((*mode).zone_from - (*mode).zone, (*mode).zone - (*mode).zone_from, rising);
    var sum = (*mode).sum;
    var met = 0u;
    var seen = 0u;
    loop {
        // The surface below zone z is number z − 1.
        let k = min(select((*mode).zone_from - 1u - met, (*mode).zone_from + met, rising), SURFACES - 1u);
        let surface = surface_refine(caster, surface_value(k), f32(index), rising, hit);
        var color = frame.surface_colors[k].rgb;
        if SHADED {
            let gradient = gradient_at(caster, surface.source, surface.index, hit && !(*caster).stopped);
            color = shade_phong(color, gradient, (*caster).ray.direction);
        }
        var shows = hit;
        if CUT {
            // On the other side of a layer it belongs to another part.
            let between = (*caster).part.between;
            shows &= surface.index >= between.x && surface.index < between.y;
        }
        sum += vec4f(color, 1.0) * ((1.0 - sum.a) * select(0.0, frame.surface_colors[k].a, shows));
        met += 1u;
        seen += u32(shows);
        cast_note(caster, surface.index, shows, sum.a >= frame.opacity_cutoff);
        if ONE_OPAQUE || !hit || met >= count || sum.a >= frame.opacity_cutoff {
            break;
        }
    }
    if hit && (*caster).stopped {
        // The last sample is taken once more when the bricks around the surfaces are there.
        (*mode).before = index - 1;
        (*mode).zone = (*mode).zone_from;
        (*mode).event = false;
        (*caster).samples -= 1u;
        return index;
    }
    (*mode).sum = sum;
    (*mode).ended = hit && sum.a >= frame.opacity_cutoff;
    (*caster).contributing += seen;
    return next;
}

fn mode_end(mode: Mode, caster: Cast, next: i32) -> Outcome {
    let flags = select(0u, RAY_ENDED, mode.ended) | (mode.zone << RAY_ZONE_SHIFT)
        | select(0u, RAY_HAS_BEFORE, mode.before == next - 1);
    return Outcome(mode.sum, flags, 0.0, 0u);
}

// A point of a surface: its place in samples, and what it is read from.
struct Hit {
    index: f32,
    source: Source,
}

// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3). Where a brick is
// missing on the way, the ray stops.
fn surface_refine(caster: ptr<function, Cast>, value: f32, index: f32, above: bool, hit: bool) -> Hit {
    var at = index;
    if REFINED {
        at = index - 0.5;
        var reach = 0.25;
        var k = 0;
        loop {
            let source = surface_probe(caster, at, hit, false);
            let beyond = (sample_value(source.brick, source_offset(source, at)) >= value) == above;
            at += select(reach, -reach, beyond);
            reach *= 0.5;
            k += 1;
            // Where no ray of a group has hit anything, once is enough.
            if k == 6 || !hit {
                break;
            }
        }
    }
    return Hit(at, surface_probe(caster, at, hit, SHADED));
}

// The source at `index`, any number between samples. With `voxels` the voxels themselves are needed (for a gradient), also
// of a brick that is empty.
fn surface_probe(caster: ptr<function, Cast>, index: f32, hit: bool, voxels: bool) -> Source {
    var brick = brick_at((*caster).ray.grid, ray_offset((*caster).ray, index));
    if voxels && brick.is_absent {
        brick.tag = TAG_ABSENT;
    }
    let source = source_of(*caster, brick, index);
    if hit && source.is_missing {
        cast_miss(caster, brick);
    } else if hit {
        feedback_touch(brick);
    }
    return source;
}
