// Technique layers, before its passes: how many samples the rays have still to take, and the most of them in each cell of
// 16×16 pixels (techniques.md T3.3). Samples are taken at the same places as ever; layer n holds the n-th sample of each ray.

@group(1) @binding(0) var<storage, read_write> rays: array<RayState>;
@group(1) @binding(1) var<storage, read_write> feedback: array<atomic<u32>>;
@group(1) @binding(2) var pixel_list: texture_2d<u32>;
@group(2) @binding(0) var nearest_front: texture_depth_2d;
@group(2) @binding(1) var nearest_back: texture_depth_2d;
@group(2) @binding(2) var farthest_back: texture_depth_2d;
@group(2) @binding(3) var depth_sampler: sampler;
// Per cell of the tile, row by row; zeros before.
@group(2) @binding(4) var<storage, read_write> cells: array<atomic<u32>>;

// Samples of the ray from `next` of that level on, by the intervals of its levels.
fn layers_left(tile_pixel: vec2u, first_level: u32, next: i32) -> u32 {
    var left = 0u;
    var level = first_level;
    var from_sample = next;
    loop {
        let ray = ray_for_pixel(frame.tile_origin + tile_pixel, level);
        var interval = vec2f(-1e30, 1e30);
        if cast_order(FEEDBACK_SKIP) == SKIP_OUTSIDE {
            interval = interval_of_pixel(tile_pixel, ray.stretch);
        }
        let reach = interval_reach(ray, interval);
        if reach.x <= reach.y {
            // As walk_all has them: from the sample before the interval's begin to the one after its end.
            let first = max(max(ray.first, from_sample), i32(floor(reach.x)));
            left += u32(max(min(i32(ceil(reach.y)), ray.last) + 1 - first, 0));
        }
        level += 1u;
        from_sample = 0;
        if !MANY_LEVELS || level >= frame.used_levels {
            break;
        }
    }
    return left;
}

// For the unfinished rays of the host's work-groups. Those that waited try again.
@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn measure_layers(
    @builtin(workgroup_id) id: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    let group = cast_order(FEEDBACK_GROUPS + id.x);
    let tile_pixel = cast_tile_pixel(group, local, cast_order(FEEDBACK_PIXELS) != 0u);
    let at = cast_number(tile_pixel);
    let state = rays[at];
    if cast_is_outside(tile_pixel) || (state.flags & RAY_FINISHED) != 0u {
        return;
    }
    if (state.flags & RAY_STOPPED) != 0u {
        rays[at].flags = state.flags & ~RAY_STOPPED;
    }
    var level = 0u;
    if MANY_LEVELS {
        level = state.flags & RAY_LEVEL_MASK;
    }
    let cell = tile_pixel / CELL_EDGE;
    let cells_wide = (frame.tile_size.x + CELL_EDGE - 1u) / CELL_EDGE;
    atomicMax(&cells[cell.y * cells_wide + cell.x], layers_left(tile_pixel, level, state.next));
}
