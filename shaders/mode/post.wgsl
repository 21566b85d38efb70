// Modes dvr and xray: every sample is classified and composited.

const MODE_SPLITS: bool = true;
const MODE_SEGMENTS: bool = false;

struct Mode {
    // Premultiplied colour and opacity.
    sum: vec4f,
    // The ray has met what ends it.
    event: bool,
    ended: bool,
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    return Mode(color, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let classified = classify_value((*caster).ray.grid, value_at(source, i));
    var color = classified.rgb;
    if SHADED {
        let gradient = gradient_at(caster, source, f32(i), classified.a > 0.0);
        color = shade_phong(color, part_gradient((*caster).part, i, gradient), (*caster).ray.direction);
        if FILTERED_GRADIENTS && (*caster).stopped {
            return;
        }
    }
    let opacity = part_opacity((*caster).part, i, classified.a);
    (*mode).sum += vec4f(color, 1.0) * ((1.0 - (*mode).sum.a) * opacity);
    (*caster).contributing += u32(classified.a > 0.0);
    (*mode).event = (*mode).sum.a >= frame.opacity_cutoff;
    (*mode).ended = (*mode).event;
    cast_note(caster, f32(i), classified.a > 0.0, (*mode).event);
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
