// The atlas, read by eight texel loads and interpolated by hand: exact, for every float or normalised format.

@group(1) @binding(0) var atlas: texture_3d<f32>;

fn atlas_texel(at: vec3i) -> f32 {
    return textureLoad(atlas, at, 0).x;
}

fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    return sample_exact(brick, local);
}
