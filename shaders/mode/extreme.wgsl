// Modes mip and minip: the greatest sample, or the least, is classified once. A minimum is the maximum of the negated
// values: these are what is compared here with MINIMUM.

const MODE_SPLITS: bool = false;
const MODE_SEGMENTS: bool = false;

struct Mode {
    // Layers in front of the projection, and what ended the ray: premultiplied colour and opacity.
    front: vec4f,
    back: vec4f,
    greatest: f32,
    event: bool,
    ended: bool,
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    // Blocks that can't be better than the volume's own bound are skipped: that is their extreme.
    let least = select(frame.value_floor, -frame.value_ceiling, MINIMUM);
    let greatest = max(least, select(least, state.value, (state.flags & RAY_INSIDE) != 0u));
    return Mode(color, vec4f(0.0), greatest, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let stored = value_at(source, i);
    let value = select(stored, -stored, MINIMUM);
    (*caster).contributing += u32(value > (*mode).greatest);
    (*mode).greatest = max((*mode).greatest, value);
}

// Translucent layers are in front of the projection, wherever they lie; an opaque one is behind it.
fn mode_meet(mode: ptr<function, Mode>, layer: vec4f) -> bool {
    if layer.a >= 1.0 {
        (*mode).back = layer;
        return true;
    }
    (*mode).front += layer * (1.0 - (*mode).front.a);
    return part_ends((*mode).front, layer);
}

fn mode_bound(mode: Mode) -> f32 {
    return mode.greatest;
}

fn mode_resolve(mode: ptr<function, Mode>, caster: ptr<function, Cast>, next: i32) -> i32 {
    return next;
}

fn mode_end(mode: Mode, caster: Cast, next: i32) -> Outcome {
    var color = vec4f(0.0);
    if caster.is_inside {
        let classified = classify_value(caster.ray.grid, select(mode.greatest, -mode.greatest, MINIMUM));
        color = vec4f(classified.rgb * classified.a, classified.a);
    }
    return Outcome(part_project(caster, mode.front, color, mode.back), 0u, mode.greatest, 0u);
}
