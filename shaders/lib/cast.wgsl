// What the passes over rays share: the host's orders, the pixel of an invocation, and which rays are not finished. A pass
// binds `feedback` and, for pixels from a list, `pixel_list`.

override GROUP_WIDTH: u32 = 8u;
override GROUP_HEIGHT: u32 = 8u;

// What the host ordered for this dispatch. Not in the uniforms: where a condition depends on uniforms alone, lavapipe puts
// their values into the code and compiles it anew (half a second) whenever the uniforms change.
fn cast_order(word: u32) -> u32 {
    return atomicLoad(&feedback[frame.orders_at + word]);
}

fn cast_index(local: vec3u) -> u32 {
    return local.y * GROUP_WIDTH + local.x;
}

// The pixel of an invocation in its work-group. Eight in a row of invocations are 4×2 pixels: a software adapter runs them
// as one, and what they do differs the less the nearer they are.
fn cast_place(local: vec3u) -> vec2u {
    let index = cast_index(local);
    let block = index >> 3u;
    let blocks_wide = GROUP_WIDTH >> 2u;
    return vec2u((block % blocks_wide) * 4u + (index & 3u), (block / blocks_wide) * 2u + ((index >> 2u) & 1u));
}

// The pixel of the tile that an invocation has: in its place in the picture, or from the list. In one pipeline, so that a
// pixel is the same to the bit either way.
fn cast_tile_pixel(group: u32, local: vec3u, is_listed: bool) -> vec2u {
    if is_listed {
        let number = group * GROUP_WIDTH * GROUP_HEIGHT + cast_index(local);
        let wide = textureDimensions(pixel_list).x;
        let pixel = textureLoad(pixel_list, vec2u(number % wide, number / wide), 0).x;
        return vec2u(pixel & 0xffffu, pixel >> 16u);
    }
    let groups_wide = (frame.tile_size.x + GROUP_WIDTH - 1u) / GROUP_WIDTH;
    return vec2u(group % groups_wide, group / groups_wide) * vec2u(GROUP_WIDTH, GROUP_HEIGHT) + cast_place(local);
}

// Outside the picture there is nothing to do.
fn cast_is_outside(tile_pixel: vec2u) -> bool {
    return any(tile_pixel >= frame.part_size);
}

// Number of a pixel in the tile's buffers; outside the picture one that is there.
fn cast_number(tile_pixel: vec2u) -> u32 {
    return min(tile_pixel.y, frame.tile_size.y - 1u) * frame.tile_size.x + min(tile_pixel.x, frame.tile_size.x - 1u);
}

// The ray of pixel number `at` of the tile, in work-group `group`, is not finished. A stopped one waits for a brick.
fn cast_pending(at: u32, group: u32, stopped: bool) {
    atomicAdd(&feedback[FEEDBACK_PENDING + group], 1u);
    if stopped {
        atomicAdd(&feedback[FEEDBACK_STOPPED], 1u);
        // The least pixel: buffers begin as zeros.
        atomicMax(&feedback[FEEDBACK_FIRST_STOPPED], 0xffffffffu - at);
    }
}
