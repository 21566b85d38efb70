// The part of a ray that the bounding mesh leaves, in samples.

override ORTHOGRAPHIC: bool = false;

// View depth of a depth-buffer value, and from it the sample index on a ray of that stretch.
fn interval_index(depth: f32, stretch: f32) -> f32 {
    if ORTHOGRAPHIC {
        return (frame.depth_bias - frame.depth_scale * depth - frame.first_mm) / frame.step_mm;
    }
    return (frame.depth_scale / depth * stretch - frame.first_mm) / frame.step_mm;
}

// The raster is only a bound: the least start and the greatest end over 3×3 pixels, moved outward by one block
// diagonal; the start is the near plane wherever the nearest back face is not behind the nearest front face (the three
// steps of techniques.md T1.6 as one rule). Depth is 0 where nothing was drawn (nearest) or 1 (farthest).
fn interval_of_pixel(pixel: vec2u, stretch: f32) -> vec2f {
    var nearest = 0.0;
    var farthest = 1.0;
    var from_near_plane = false;
    let slack_depth = frame.slack;
    for (var y = 0u; y < 3u; y++) {
        for (var x = 0u; x < 3u; x++) {
            // The depth buffers have a margin of one pixel around the tile.
            let at = vec2i(pixel + vec2u(x, y));
            let back = textureLoad(nearest_back, at, 0);
            if back == 0.0 {
                continue;
            }
            let front = textureLoad(nearest_front, at, 0);
            farthest = min(farthest, textureLoad(farthest_back, at, 0));
            nearest = max(nearest, front);
            if front == 0.0
                || interval_index(back, stretch) <= interval_index(front, stretch) + slack_depth {
                from_near_plane = true;
            }
        }
    }
    if nearest == 0.0 && !from_near_plane {
        return vec2f(1e9, -1e9);
    }
    var start = 0.0;
    if !from_near_plane {
        start = interval_index(nearest, stretch) - frame.slack;
    }
    return vec2f(start, interval_index(farthest, stretch) + frame.slack);
}
