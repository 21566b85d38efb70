// The caster: one invocation per ray, one entry point per mode. The twin of each is reference::caster.

@group(2) @binding(0) var nearest_front: texture_depth_2d;
@group(2) @binding(1) var nearest_back: texture_depth_2d;
@group(2) @binding(2) var farthest_back: texture_depth_2d;
// Per pixel of the tile: premultiplied colour and opacity.
@group(2) @binding(3) var<storage, read_write> picture: array<vec4f>;
// Per pixel of the tile: samples taken, samples skipped.
@group(2) @binding(4) var<storage, read_write> counts: array<vec2u>;

override GROUP_WIDTH: u32 = 8u;
override GROUP_HEIGHT: u32 = 8u;

fn start_walk(ray: Ray, tile_pixel: vec2u) -> Walk {
    if frame_has(FLAG_SKIP) {
        return walk_begin(ray, interval_of_pixel(tile_pixel, ray.stretch));
    }
    return walk_begin(ray, vec2f(-1e9, 1e9));
}

// The next run of samples: with skipping from the walk, without it the whole ray once.
fn next_run(ray: Ray, walk: ptr<function, Walk>) -> bool {
    if frame_has(FLAG_SKIP) {
        return walk_next(ray, walk);
    }
    let more = (*walk).next <= ray.last;
    (*walk).next = ray.last + 1;
    return more;
}

fn write_pixel(tile_pixel: vec2u, color: vec4f, samples: u32, walk: Walk, ray: Ray, terminated: bool) {
    let at = tile_pixel.y * frame.tile_size.x + tile_pixel.x;
    picture[at] = color;
    // What lies behind the last run was skipped, unless the ray ended before it got there.
    let rest = select(u32(max(ray.last + 1 - walk.next, 0)), 0u, terminated);
    counts[at] = vec2u(samples, walk.skipped + rest);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_dvr(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + id.xy);
    var walk = start_walk(ray, id.xy);
    var brick = brick_none();
    var sum = vec4f(0.0);
    var samples = 0u;
    var terminated = false;
    while !terminated && next_run(ray, &walk) {
        for (var i = walk.first; i <= walk.last; i++) {
            let offset = ray_offset(ray, f32(i));
            if !brick_contains(brick, offset) {
                brick = brick_at(offset);
            }
            samples += 1u;
            let classified = classify_value(sample_value(brick, offset));
            if classified.a > 0.0 {
                var color = classified.rgb;
                if frame_has(FLAG_PHONG) {
                    color = shade_phong(color, sample_gradient(brick, offset), ray.direction);
                }
                let weight = (1.0 - sum.a) * classified.a;
                sum += vec4f(color, 1.0) * weight;
                if sum.a >= frame.opacity_cutoff {
                    terminated = true;
                    break;
                }
            }
        }
    }
    write_pixel(id.xy, sum, samples, walk, ray, terminated);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_mip(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + id.xy);
    var walk = start_walk(ray, id.xy);
    var brick = brick_none();
    // Blocks that hold nothing above the volume's minimum are skipped: this is their maximum.
    var greatest = frame.value_floor;
    var samples = 0u;
    while next_run(ray, &walk) {
        for (var i = walk.first; i <= walk.last; i++) {
            let offset = ray_offset(ray, f32(i));
            if !brick_contains(brick, offset) {
                brick = brick_at(offset);
            }
            samples += 1u;
            greatest = max(greatest, sample_value(brick, offset));
        }
    }
    var color = vec4f(0.0);
    if ray.first <= ray.last {
        let classified = classify_value(greatest);
        color = vec4f(classified.rgb * classified.a, classified.a);
    }
    write_pixel(id.xy, color, samples, walk, ray, false);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_iso(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + id.xy);
    var walk = start_walk(ray, id.xy);
    var brick = brick_none();
    var samples = 0u;
    var above_before = false;
    // The sample that `above_before` belongs to: a run that doesn't continue the last one starts afresh.
    var before = -2;
    var hit = -1.0;
    while hit < 0.0 && next_run(ray, &walk) {
        for (var i = walk.first; i <= walk.last; i++) {
            let offset = ray_offset(ray, f32(i));
            if !brick_contains(brick, offset) {
                brick = brick_at(offset);
            }
            samples += 1u;
            let above = sample_value(brick, offset) >= frame.iso;
            if before == i - 1 && above != above_before {
                hit = refine_hit(ray, f32(i), above);
                break;
            }
            above_before = above;
            before = i;
        }
    }
    var color = vec4f(0.0);
    if hit >= 0.0 {
        let offset = ray_offset(ray, hit);
        brick = brick_at(offset);
        var surface = frame.iso_color.rgb;
        if frame_has(FLAG_PHONG) {
            surface = shade_phong(surface, sample_gradient(brick, offset), ray.direction);
        }
        color = vec4f(surface, 1.0);
    }
    write_pixel(id.xy, color, samples, walk, ray, hit >= 0.0);
}

// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3).
fn refine_hit(ray: Ray, index: f32, above: bool) -> f32 {
    if !frame_has(FLAG_REFINE) {
        return index;
    }
    var at = index - 0.5;
    var reach = 0.25;
    for (var k = 0; k < 6; k++) {
        let offset = ray_offset(ray, at);
        let beyond = (sample_value(brick_at(offset), offset) >= frame.iso) == above;
        at += select(reach, -reach, beyond);
        reach *= 0.5;
    }
    return at;
}
