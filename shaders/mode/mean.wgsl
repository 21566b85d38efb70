// Mode mean: the mean of all samples, each weighted by the base steps that it stands for, is classified once.

const MODE_SPLITS: bool = false;
const MODE_SEGMENTS: bool = false;

struct Mode {
    backdrop: Backdrop,
    sum: f32,
    steps: u32,
    event: bool,
    ended: bool,
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    return Mode(Backdrop(color, vec4f(0.0), false), state.value, state.count, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let value = value_at(source, i);
    // Levels of a frame follow each other.
    let steps = 1u << (*caster).ray.grid.level;
    (*mode).sum += value * f32(steps);
    (*mode).steps += steps;
    (*caster).contributing += 1u;
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
    return 0.0;
}

fn mode_resolve(mode: ptr<function, Mode>, caster: ptr<function, Cast>, next: i32) -> i32 {
    return next;
}

fn mode_end(mode: Mode, caster: Cast, next: i32) -> Outcome {
    var color = vec4f(0.0);
    if mode.steps > 0u {
        let classified = classify_value(caster.ray.grid, mode.sum / f32(mode.steps));
        color = vec4f(classified.rgb * classified.a, classified.a);
    }
    return Outcome(part_project(caster, mode.backdrop, color), 0u, mode.sum, mode.steps);
}
