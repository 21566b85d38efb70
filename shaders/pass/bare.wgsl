// What the device could do at most: every sample of every ray inside the volume is fetched from one dense texture, classified
// and composited. No bricks, no skipping, no early end.

// Per pixel of the picture: premultiplied colour and opacity.
@group(2) @binding(0) var<storage, read_write> picture: array<vec4f>;
// Per pixel of the picture: samples taken.
@group(2) @binding(1) var<storage, read_write> counts: array<u32>;

override GROUP_WIDTH: u32 = 8u;
override GROUP_HEIGHT: u32 = 8u;
// Number of the level among frame.levels.
override LEVEL: u32 = 0u;

@compute @workgroup_size(GROUP_WIDTH, GROUP_HEIGHT)
fn cast_bare(@builtin(global_invocation_id) id: vec3u) {
    let is_inside = all(id.xy < frame.part_size);
    let pixel = frame.tile_origin + id.xy;
    let ray = ray_for_pixel(pixel, LEVEL);
    let last = select(-1, ray.last, is_inside);
    let base = ray.base + vec3f(ray.grid.anchor);
    var sum = vec4f(0.0);
    var i = ray.first;
    // Ends in its `break`, as the loops of the caster.
    if i <= last {
        loop {
            let value = bare_value(base + f32(i) * ray.step) * frame.value_scale;
            let classified = classify_value(ray.grid, value);
            sum += vec4f(classified.rgb, 1.0) * ((1.0 - sum.a) * classified.a);
            i += 1;
            if i > last {
                break;
            }
        }
    }
    if is_inside {
        let at = pixel.y * frame.picture_size.x + pixel.x;
        picture[at] = sum;
        counts[at] = u32(max(i - ray.first, 0));
    }
}
