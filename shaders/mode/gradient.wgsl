// Mode gradient: as dvr, with the optical depth of a sample scaled by the strength of the gradient.

const MODE_SPLITS: bool = true;
const MODE_SEGMENTS: bool = false;

struct Mode {
    // Premultiplied colour and opacity.
    sum: vec4f,
    event: bool,
    ended: bool,
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    return Mode(color, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    // Its opacity is an optical depth.
    let classified = classify_value((*caster).ray.grid, value_at(source, i));
    let gradient = gradient_at(caster, source, f32(i), classified.a > 0.0);
    if FILTERED_GRADIENTS && (*caster).stopped {
        return;
    }
    let strength = min(sqrt(dot(gradient, gradient)) * frame.gradient_scale, 1.0);
    var depth = classified.a * strength;
    if CUT {
        depth *= part_share((*caster).part, i);
    }
    let opacity = 1.0 - exp(-depth);
    var color = classified.rgb;
    if SHADED {
        color = shade_phong(color, part_gradient((*caster).part, i, gradient), (*caster).ray.direction);
    }
    (*mode).sum += vec4f(color, 1.0) * ((1.0 - (*mode).sum.a) * opacity);
    (*caster).contributing += u32(opacity > 0.0);
    (*mode).event = (*mode).sum.a >= frame.opacity_cutoff;
    (*mode).ended = (*mode).event;
    cast_note(caster, f32(i), opacity > 0.0, (*mode).event);
}

fn mode_meet(mode: ptr<function, Mode>, layer: vec4f) -> bool {
    (*mode).sum += layer * (1.0 - (*mode).sum.a);
    return part_ends((*mode).sum, layer);
}

fn mode_caps(value: f32, opacity: f32) -> bool {
    return opacity > 0.0;
}

fn mode_bound(mode: Mode) -> f32 {
    return 0.0;
}

fn mode_resolve(mode: ptr<function, Mode>, caster: ptr<function, Cast>, next: i32) -> i32 {
    return next;
}

fn mode_end(mode: Mode, caster: Cast, next: i32) -> Outcome {
    return Outcome(mode.sum, select(0u, RAY_ENDED, mode.ended), 0.0, 0u);
}
