// The part of a ray that the bounding mesh leaves, mm from the eye.

override ORTHOGRAPHIC: bool = false;

// Distance from the eye of a depth-buffer value, on a ray of that stretch.
fn interval_distance(depth: f32, stretch: f32) -> f32 {
    if ORTHOGRAPHIC {
        return frame.depth_bias - frame.depth_scale * depth;
    }
    return frame.depth_scale / depth * stretch;
}

// The raster is only a bound: the least start and the greatest end over 3×3 pixels, moved outward by one block
// diagonal; the start is the near plane wherever the nearest back face is not behind the nearest front face (the three
// steps of techniques.md T1.6 as one rule). Depth is 0 where nothing was drawn (nearest) or 1 (farthest).
//
// Nine texels by four gathers, each of the four texels around a corner: software adapters pay by the call.
fn interval_of_pixel(pixel: vec2u, stretch: f32) -> vec2f {
    var nearest = 0.0;
    var farthest = 1.0;
    var from_near_plane = false;
    // The depth buffers have a margin of one pixel around the tile.
    let texel = 1.0 / (vec2f(frame.tile_size) + 2.0);
    for (var y = 1u; y < 3u; y++) {
        for (var x = 1u; x < 3u; x++) {
            let corner = vec2f(pixel + vec2u(x, y)) * texel;
            let backs = textureGather(nearest_back, depth_sampler, corner);
            let fronts = textureGather(nearest_front, depth_sampler, corner);
            let ends = textureGather(farthest_back, depth_sampler, corner);
            for (var k = 0u; k < 4u; k++) {
                let back = backs[k];
                let front = fronts[k];
                let is_covered = back != 0.0;
                farthest = select(farthest, min(farthest, ends[k]), is_covered);
                nearest = select(nearest, max(nearest, front), is_covered);
                from_near_plane |= is_covered && (front == 0.0
                    || interval_distance(back, stretch) <= interval_distance(front, stretch) + frame.slack_mm);
            }
        }
    }
    if nearest == 0.0 && !from_near_plane {
        return vec2f(1e30, -1e30);
    }
    var start = 0.0;
    if !from_near_plane {
        start = interval_distance(nearest, stretch) - frame.slack_mm;
    }
    return vec2f(start, interval_distance(farthest, stretch) + frame.slack_mm);
}

// Where an interval begins and ends on the ray's part of the volume, in samples.
fn interval_reach(ray: Ray, interval: vec2f) -> vec2f {
    return vec2f(max(f32(ray.first), ray_index(ray, interval.x)), min(f32(ray.last), ray_index(ray, interval.y)));
}
