// The atlas of 16-bit integers, for adapters without normalised 16-bit textures: interpolated by hand.

@group(1) @binding(0) var atlas: texture_3d<u32>;
@group(1) @binding(6) var atlas1: texture_3d<u32>;
@group(1) @binding(7) var atlas2: texture_3d<u32>;
@group(1) @binding(8) var atlas3: texture_3d<u32>;

// False where one texture holds all slots: software adapters would load from each.
override MANY_ATLASES: bool = false;

fn atlas_texel(texture: u32, at: vec3i) -> f32 {
    if !MANY_ATLASES {
        return f32(textureLoad(atlas, at, 0).x);
    }
    switch texture {
        case 1u: { return f32(textureLoad(atlas1, at, 0).x); }
        case 2u: { return f32(textureLoad(atlas2, at, 0).x); }
        case 3u: { return f32(textureLoad(atlas3, at, 0).x); }
        default: { return f32(textureLoad(atlas, at, 0).x); }
    }
}

fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    return sample_exact(brick, local);
}
