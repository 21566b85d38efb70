// Modes mip and minip: the greatest sample, or the least, is classified once. A minimum is the maximum of the negated
// values: these are what is compared here with MINIMUM.

const MODE_SPLITS: bool = false;
const MODE_SEGMENTS: bool = false;

struct Mode {
    backdrop: Backdrop,
    greatest: f32,
    event: bool,
    ended: bool,
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    // Blocks that can't be better than the volume's own bound are skipped: that is their extreme.
    let least = select(frame.value_floor, -frame.value_ceiling, MINIMUM);
    let greatest = max(least, select(least, state.value, (state.flags & RAY_INSIDE) != 0u));
    return Mode(Backdrop(color, vec4f(0.0), false), greatest, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let stored = value_at(source, i);
    let value = select(stored, -stored, MINIMUM);
    (*caster).contributing += u32(value > (*mode).greatest);
    (*mode).greatest = max((*mode).greatest, value);
}

fn mode_meet(mode: ptr<function, Mode>, layer: vec4f) -> bool {
    (*mode).backdrop = part_backdrop((*mode).backdrop, layer);
    return (*mode).backdrop.ended;
}

// A projection has no surfaces.
fn mode_caps(value: f32, opacity: f32) -> bool {
    return false;
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
    return Outcome(part_project(caster, mode.backdrop, color), 0u, mode.greatest, 0u);
}
