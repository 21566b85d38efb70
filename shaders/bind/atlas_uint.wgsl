// The atlas of 16-bit integers, for adapters without normalised 16-bit textures: interpolated by hand.

@group(1) @binding(0) var atlas: texture_3d<u32>;

fn atlas_texel(at: vec3i) -> f32 {
    return f32(textureLoad(atlas, at, 0).x);
}

fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    return sample_exact(brick, local);
}
