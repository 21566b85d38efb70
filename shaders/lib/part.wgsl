// Rays cut to parts: what clip geometry leaves of them, and the layers of meshes in between. The twin is scene::part.
//
// A record of a part: where it begins, mm (the sign bit: it goes on behind the layer before), where it ends and its layer
// lies, mm, and the layer: lit colour, premultiplied, and opacity, 16 bits each; no opacity, no layer. With FACES a second
// texel: the normal of the cut face at which it begins, towards the eye; 0 where it begins at none.

// The picture has geometry.
override CUT: bool = false;
// Cut faces matter: they are capped, or have normals.
override FACES: bool = false;
override CAPPED: bool = false;
override FACE_NORMALS: bool = false;

// The part of a ray that is walked.
struct Part {
    // Which; all are done when it is `count`.
    number: u32,
    count: u32,
    // Number of the first record.
    records: u32,
    // In samples of the ray's level.
    begin: f32,
    end: f32,
    // Normal of the cut face at which it begins; 0 where it begins at none.
    face: vec3f,
    // The face was looked at.
    is_capped: bool,
    // The layers at its ends, in samples; far away where there is none.
    between: vec2f,
    layer: vec4f,
    // The next sample follows none.
    is_new: bool,
}

// The pixel's list of parts.
fn part_list(tile_pixel: vec2u, number: u32) -> Part {
    var part: Part;
    part.number = number;
    part.between = vec2f(-1e30, 1e30);
    if CUT {
        let list = textureLoad(part_lists, tile_pixel, 0);
        part.records = list.x;
        part.count = list.y;
    }
    return part;
}

fn part_record(place: u32) -> vec4u {
    return textureLoad(part_records, vec2u(place % PART_RECORDS_WIDE, place / PART_RECORDS_WIDE), 0);
}

// Is the sample in front of the layer at which the part begins kept? It is where the part began, or the first of those that it
// continues.
fn part_keeps(caster: Cast, sample: f32) -> bool {
    var number = caster.part.number;
    loop {
        if number == 0u {
            break;
        }
        number -= 1u;
        let begin = part_record((caster.part.records + number) * select(1u, 2u, FACES)).x;
        let begin_mm = bitcast<f32>(begin & 0x7fffffffu);
        // One that is but a layer begins nowhere.
        if begin_mm < 1e29 && (ray_index(caster.ray, begin_mm) <= sample || (begin >> 31u) == 0u) {
            return ray_index(caster.ray, begin_mm) <= sample;
        }
    }
    return false;
}

// Leaves of the ray's samples at its level those of the part.
fn part_cut(caster: ptr<function, Cast>) {
    if !CUT {
        return;
    }
    let part = (*caster).part;
    if part.number >= part.count {
        (*caster).ray.last = -1;
        (*caster).ray.first = 0;
        return;
    }
    let record = part_record((part.records + part.number) * select(1u, 2u, FACES));
    let begin = ray_index((*caster).ray, bitcast<f32>(record.x & 0x7fffffffu));
    let end = ray_index((*caster).ray, bitcast<f32>(record.y));
    let layer = vec4f(unpack2x16unorm(record.z), unpack2x16unorm(record.w));
    // The sample in front of a layer is taken on both sides of it; so is, with segments, the one behind it.
    let continues = MODE_SPLITS && (record.x >> 31u) != 0u;
    let has_layer = layer.a > 0.0;
    var first = ceil(begin);
    if continues && part_keeps(*caster, floor(begin)) {
        first = floor(begin);
    }
    let last = ceil(end) - select(1.0, 0.0, MODE_SEGMENTS && has_layer);
    (*caster).ray.first = max((*caster).ray.first, i32(clamp(first, -2e9, 2e9)));
    (*caster).ray.last = min((*caster).ray.last, select(i32(clamp(last, -2e9, 2e9)), -1, begin >= end));
    if FACES {
        let face = part_record((part.records + part.number) * 2u + 1u);
        (*caster).part.face = bitcast<vec3f>(face.xyz);
    }
    (*caster).part.begin = begin;
    (*caster).part.end = end;
    (*caster).part.layer = layer;
    (*caster).part.between = vec2f(select(-1e30, begin, continues), select(1e30, end, MODE_SPLITS && has_layer));
}

// How much of the segment behind sample `i` lies between the layers, 0 to 1.
fn part_share(part: Part, i: i32) -> f32 {
    return min(f32(i) + 1.0, part.between.y) - max(f32(i), part.between.x);
}

// The opacity of a part of a segment whose opacity is `opacity`.
fn part_opacity(part: Part, i: i32, opacity: f32) -> f32 {
    if !CUT {
        return opacity;
    }
    let share = part_share(part, i);
    return select(opacity, 1.0 - pow(max(1.0 - opacity, 1e-30), share), share < 1.0);
}

// With a layer behind what is there nothing more can change the ray.
fn part_ends(sum: vec4f, layer: vec4f) -> bool {
    return layer.a >= 1.0 || sum.a >= frame.opacity_cutoff;
}

// Layers around a projection, premultiplied: translucent ones are in front of it, wherever they lie, an opaque one behind it.
struct Backdrop {
    front: vec4f,
    back: vec4f,
    // Nothing more can change the ray.
    ended: bool,
}

fn part_backdrop(before: Backdrop, layer: vec4f) -> Backdrop {
    if layer.a >= 1.0 {
        return Backdrop(before.front, layer, true);
    }
    let front = before.front + layer * (1.0 - before.front.a);
    return Backdrop(front, before.back, front.a >= frame.opacity_cutoff);
}

// What a ray of a mode that projects shows; of one that goes on only the layers so far.
fn part_project(caster: Cast, backdrop: Backdrop, projected: vec4f) -> vec4f {
    if !CUT {
        return projected;
    }
    let behind = projected + backdrop.back * (1.0 - projected.a);
    let all = backdrop.front + behind * (1.0 - backdrop.front.a);
    return select(all, backdrop.front, caster.stopped || caster.paused);
}

// The gradient that sample `i` is lit by: the normal of the cut face where the segment behind sample `segment` lies at one.
fn part_gradient(part: Part, segment: i32, gradient: vec3f) -> vec3f {
    if FACE_NORMALS && any(part.face != vec3f(0.0)) && f32(segment) < part.begin + 1.0 {
        return part.face;
    }
    return gradient;
}

// Shows the data at the cut face where the part begins, if it does so at this level. True when that ends the ray; where a brick
// is missing, the ray stops.
fn part_cap(caster: ptr<function, Cast>, mode: ptr<function, Mode>) -> bool {
    let part = (*caster).part;
    if !CAPPED || part.is_capped || (*caster).is_idle || part.number >= part.count {
        return false;
    }
    let level = (*caster).ray.grid.level;
    let offset = ray_offset((*caster).ray, part.begin);
    let is_inside = all(offset >= frame.levels[level].box_min.xyz) && all(offset <= frame.levels[level].box_max.xyz);
    let is_last = !MANY_LEVELS || level + 1u >= frame.used_levels;
    let behind = f32(frame.levels[level].last + select(1, 0, MODE_SEGMENTS));
    let is_of_level = part.begin >= f32(frame.levels[level].begin) && (is_last || part.begin < behind);
    if !is_inside || !is_of_level || part.begin >= part.end || all(part.face == vec3f(0.0)) {
        return false;
    }
    var brick = brick_at((*caster).ray.grid, offset);
    // The side of an iso-value is not enough.
    if MODE_SEGMENTS && brick.is_absent {
        brick.tag = TAG_ABSENT;
    }
    let source = cast_enter(caster, brick, part.begin);
    if (*caster).stopped {
        return false;
    }
    (*caster).part.is_capped = true;
    let value = sample_value(source.brick, source_offset(source, part.begin));
    let classified = classify_value((*caster).ray.grid, value);
    if !mode_caps(value, classified.a) {
        return false;
    }
    var color = classified.rgb;
    if SHADED {
        color = shade_phong(color, part.face, (*caster).ray.direction);
    }
    (*caster).contributing += 1u;
    let ends = mode_meet(mode, vec4f(color, 1.0));
    cast_note(caster, part.begin, true, ends);
    return ends;
}
