// Mode dvr with pre-integrated classification: every segment between two samples is composited, by the table of integrals
// of its level (classify::PreintegratedTable, which reads it by the same operations).

const MODE_SPLITS: bool = true;
const MODE_SEGMENTS: bool = true;

struct Mode {
    // Premultiplied colour and opacity.
    sum: vec4f,
    // The sample before the next one and its number, −2 for none.
    value: f32,
    before: i32,
    event: bool,
    ended: bool,
}

// Place of a value along a side of the table: the entry below, and what is left.
fn preintegrated_place(value: f32) -> vec2f {
    let x = clamp((value - frame.preintegrated_lo) * frame.preintegrated_scale, 0.0, frame.preintegrated_last);
    let low = min(floor(x), frame.preintegrated_last - 1.0);
    return vec2f(low, x - low);
}

// Premultiplied colour and opacity of a segment.
fn preintegrated_segment(grid: Grid, front: f32, back: f32) -> vec4f {
    let x = preintegrated_place(front);
    let y = preintegrated_place(back);
    let at = vec2i(i32(x.x), i32(y.x));
    let layer = i32(grid.level);
    let near0 = textureLoad(preintegrated, at, layer, 0);
    let near1 = textureLoad(preintegrated, at + vec2i(1, 0), layer, 0);
    let far0 = textureLoad(preintegrated, at + vec2i(0, 1), layer, 0);
    let far1 = textureLoad(preintegrated, at + vec2i(1, 1), layer, 0);
    let near = near0 + (near1 - near0) * x.y;
    let far = far0 + (far1 - far0) * x.y;
    return near + (far - near) * y.y;
}

fn mode_begin(caster: Cast, state: RayState, color: vec4f) -> Mode {
    let before = select(-2, state.next - 1, (state.flags & RAY_HAS_BEFORE) != 0u);
    return Mode(color, state.value, before, false, false);
}

fn mode_next_run(mode: ptr<function, Mode>, caster: Cast) {
    // Levels don't continue each other, nor do parts: a segment has one level (design.md §3).
    (*mode).before = select((*mode).before, -2, caster.part.is_new);
}

fn mode_take(mode: ptr<function, Mode>, caster: ptr<function, Cast>, source: Source, i: i32) {
    let value = value_at(source, i);
    var segment = vec4f(0.0);
    if (*mode).before == i - 1 {
        segment = preintegrated_segment((*caster).ray.grid, (*mode).value, value);
    }
    if SHADED {
        let is_seen = segment.a > 0.0;
        // Lit by the gradient at the segment's far end.
        let gradient = part_gradient((*caster).part, i - 1, gradient_at(caster, source, f32(i), is_seen));
        let color = segment.rgb / select(1.0, segment.a, is_seen);
        if FILTERED_GRADIENTS && (*caster).stopped {
            return;
        }
        segment = vec4f(shade_phong(color, gradient, (*caster).ray.direction) * segment.a, segment.a);
    }
    if CUT {
        let is_seen = segment.a > 0.0;
        segment *= part_opacity((*caster).part, i - 1, segment.a) / select(1.0, segment.a, is_seen);
    }
    (*mode).sum += segment * (1.0 - (*mode).sum.a);
    (*mode).value = value;
    (*mode).before = i;
    (*caster).contributing += u32(segment.a > 0.0);
    (*mode).event = (*mode).sum.a >= frame.opacity_cutoff;
    (*mode).ended = (*mode).event;
    cast_note(caster, f32(i), segment.a > 0.0, (*mode).event);
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
    let flags = select(0u, RAY_ENDED, mode.ended) | select(0u, RAY_HAS_BEFORE, mode.before == next - 1);
    return Outcome(mode.sum, flags, mode.value, 0u);
}
