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
fn interval_of_pixel(pixel: vec2u, stretch: f32) -> vec2f {
    var nearest = 0.0;
    var farthest = 1.0;
    var from_near_plane = false;
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
                || interval_distance(back, stretch) <= interval_distance(front, stretch) + frame.slack_mm {
                from_near_plane = true;
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
