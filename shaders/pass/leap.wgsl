// Where the rays of a frame start: behind what the frame before has shown to be empty (techniques.md T2.2).
//
// In the picture of the frame before a ray of this frame is a line, a few pixels long after a small movement. Along that
// line every old pixel knows up to where its own ray was empty: this ray starts where it first lies deeper than that. So
// nothing is hidden by a hole between projected points, and what comes out from behind something nearer is not passed over.

@group(1) @binding(0) var<uniform> leap: LeapUniforms;
// Per pixel of the picture before: up to which distance from the eye of that frame its ray is empty, mm.
@group(1) @binding(1) var old_points: texture_2d<f32>;
@group(1) @binding(2) var point_sampler: sampler;
// Per pixel of the tile: distance from the eye, mm.
@group(1) @binding(3) var new_starts: texture_storage_2d<r32float, write>;

override ORTHOGRAPHIC: bool = false;

// Distance from the old eye (orthographic: eye plane) of a point in the old view.
fn leap_distance(point: vec3f) -> f32 {
    if ORTHOGRAPHIC {
        return -point.z;
    }
    return length(point);
}

// Place in the old picture, in pixels.
fn leap_place(point: vec3f) -> vec2f {
    var on_plane = point.xy / leap.half_extent;
    if !ORTHOGRAPHIC {
        on_plane /= -point.z;
    }
    return vec2f(on_plane.x + 1.0, 1.0 - on_plane.y) * 0.5 * vec2f(frame.picture_size);
}

// Up to where the rays around a place in the old picture are empty: the nearest of 4×4, so that a surface that they meet is
// not passed over between them, and what is thinner than a pixel hides from one of them but not from all.
fn leap_known(place: vec2f) -> f32 {
    let texel = 1.0 / vec2f(frame.picture_size);
    var known = 1e30;
    for (var k = 0u; k < 4u; k++) {
        let corner = vec2f(f32(k & 1u), f32(k >> 1u)) * 2.0 - 1.0;
        let points = textureGather(0, old_points, point_sampler, place + corner * texel);
        known = min(known, min(min(points.x, points.y), min(points.z, points.w)));
    }
    return known;
}

fn leap_start(pixel: vec2u) -> f32 {
    let ray = ray_for_pixel(pixel, 0u);
    let inside = ray_box(ray, 0u);
    // From an eye inside the volume on a little: the eye itself is nowhere in a picture.
    let eye = max(frame.near_mm * ray.stretch, 0.01 * frame.step_mm);
    let near = max(ray.first_mm + inside.x * ray.step_mm, eye);
    let far = ray.first_mm + inside.y * ray.step_mm;
    let plane = ray_plane(vec2f(pixel));
    let origin = leap.origin[0].xyz + leap.origin[1].xyz * plane.x + leap.origin[2].xyz * plane.y;
    let direction = (leap.direction[0].xyz + leap.direction[1].xyz * plane.x + leap.direction[2].xyz * plane.y) / ray.stretch;
    let from_point = origin + direction * near;
    let to_point = origin + direction * far;
    // What lay before the old near plane, or behind the eye, is not known.
    if near >= far || min(-from_point.z, -to_point.z) <= leap.near_mm {
        return near;
    }
    let size = vec2f(frame.picture_size);
    let from_place = leap_place(from_point);
    let to_place = leap_place(to_point);
    let along = abs(to_place - from_place);
    let pieces = clamp(ceil(max(along.x, along.y)), 1.0, leap.most_pieces);
    // Even steps along the line are uneven ones along the ray.
    var weights = vec2f(1.0);
    if !ORTHOGRAPHIC {
        weights = vec2f(-to_point.z, -from_point.z);
    }
    var start = near;
    var depth = leap_distance(from_point);
    var piece = 0.0;
    loop {
        if piece >= pieces {
            break;
        }
        let place = mix(from_place, to_place, (piece + 0.5) / pieces);
        if any(place < vec2f(0.0)) || any(place > size) {
            break;
        }
        let known = min(leap_known(place / size) + leap.forward_mm, leap.one_level_mm);
        let share = (piece + 1.0) / pieces;
        let end = mix(near * weights.x, far * weights.y, share) / mix(weights.x, weights.y, share);
        let end_depth = leap_distance(origin + direction * end);
        if end_depth > known {
            start += clamp((known - depth) / (end_depth - depth), 0.0, 1.0) * (end - start);
            break;
        }
        start = end;
        depth = end_depth;
        piece += 1.0;
    }
    // A ray that is empty to its end takes no sample.
    return min(select(start, far + 2.0 * frame.step_mm, piece >= pieces), leap.one_level_mm);
}

@compute @workgroup_size(8, 8)
fn find_starts(@builtin(global_invocation_id) id: vec3u) {
    if all(id.xy < frame.part_size) {
        textureStore(new_starts, id.xy, vec4f(leap_start(frame.tile_origin + id.xy)));
    }
}
