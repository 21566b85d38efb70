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
// Phong shading, and bisection at iso-surfaces.
override SHADED: bool = false;
override REFINED: bool = true;

// The first pixel of a work-group. Software adapters give each thread a contiguous range of groups: a stride spreads the
// costly parts of the picture over all of them (render::frame::group_stride).
fn pixel_of_group(group: vec2u, groups: vec2u) -> vec2u {
    let number = (group.y * groups.x + group.x) * frame.group_stride % (groups.x * groups.y);
    return vec2u(number % groups.x, number / groups.x) * vec2u(GROUP_WIDTH, GROUP_HEIGHT);
}

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

// The loops below nest run, brick, sample: what belongs to a run or a brick is done once for it. Software adapters execute
// both sides of every `if`, and a loop's body once more than needed unless it ends in its `break`: hence the shape
// (ARCHITECTURE.md, "Decisions"). A run is never empty.

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_dvr(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let tile_pixel = pixel_of_group(group.xy, groups.xy) + local.xy;
    if any(tile_pixel >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + tile_pixel);
    var walk = start_walk(ray, tile_pixel);
    var sum = vec4f(0.0);
    var samples = 0u;
    var terminated = false;
    var more = next_run(ray, &walk);
    while more {
        var i = walk.first;
        loop {
            var offset = ray_offset(ray, f32(i));
            let brick = brick_at(offset);
            loop {
                let classified = classify_value(sample_value(brick, offset));
                var color = classified.rgb;
                if SHADED {
                    color = shade_phong(color, sample_gradient(brick, offset), ray.direction);
                }
                sum += vec4f(color, 1.0) * ((1.0 - sum.a) * classified.a);
                samples += 1u;
                i += 1;
                offset = ray_offset(ray, f32(i));
                terminated = sum.a >= frame.opacity_cutoff;
                if terminated || i > walk.last || !brick_contains(brick, offset) {
                    break;
                }
            }
            if terminated || i > walk.last {
                break;
            }
        }
        more = !terminated && next_run(ray, &walk);
    }
    write_pixel(tile_pixel, sum, samples, walk, ray, terminated);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_mip(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let tile_pixel = pixel_of_group(group.xy, groups.xy) + local.xy;
    if any(tile_pixel >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + tile_pixel);
    var walk = start_walk(ray, tile_pixel);
    // Blocks that hold nothing above the volume's minimum are skipped: this is their maximum.
    var greatest = frame.value_floor;
    var samples = 0u;
    var more = next_run(ray, &walk);
    while more {
        var i = walk.first;
        loop {
            var offset = ray_offset(ray, f32(i));
            let brick = brick_at(offset);
            loop {
                greatest = max(greatest, sample_value(brick, offset));
                samples += 1u;
                i += 1;
                offset = ray_offset(ray, f32(i));
                if i > walk.last || !brick_contains(brick, offset) {
                    break;
                }
            }
            if i > walk.last {
                break;
            }
        }
        more = next_run(ray, &walk);
    }
    var color = vec4f(0.0);
    if ray.first <= ray.last {
        let classified = classify_value(greatest);
        color = vec4f(classified.rgb * classified.a, classified.a);
    }
    write_pixel(tile_pixel, color, samples, walk, ray, false);
}

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_iso(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let tile_pixel = pixel_of_group(group.xy, groups.xy) + local.xy;
    if any(tile_pixel >= frame.tile_size) {
        return;
    }
    let ray = ray_for_pixel(frame.tile_origin + tile_pixel);
    var walk = start_walk(ray, tile_pixel);
    var samples = 0u;
    var above_before = false;
    // The sample that `above_before` belongs to: a run that doesn't continue the last one starts afresh.
    var before = -2;
    var hit = false;
    var more = next_run(ray, &walk);
    while more {
        var i = walk.first;
        loop {
            var offset = ray_offset(ray, f32(i));
            let brick = brick_at(offset);
            loop {
                let above = sample_value(brick, offset) >= frame.iso;
                hit = before == i - 1 && above != above_before;
                above_before = above;
                before = i;
                samples += 1u;
                i += 1;
                offset = ray_offset(ray, f32(i));
                if hit || i > walk.last || !brick_contains(brick, offset) {
                    break;
                }
            }
            if hit || i > walk.last {
                break;
            }
        }
        more = !hit && next_run(ray, &walk);
    }
    // The hit lies between samples `before` − 1 and `before`.
    let offset = ray_offset(ray, refine_hit(ray, f32(before), above_before));
    var surface = frame.iso_color.rgb;
    if SHADED {
        surface = shade_phong(surface, sample_gradient(brick_at(offset), offset), ray.direction);
    }
    write_pixel(tile_pixel, select(vec4f(0.0), vec4f(surface, 1.0), hit), samples, walk, ray, hit);
}

// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3).
fn refine_hit(ray: Ray, index: f32, above: bool) -> f32 {
    if !REFINED {
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
