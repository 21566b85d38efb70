// The atlas of integer voxels, interpolated by hand: exact. As integers, since a normalised texel times its range is off by
// a rounding. A texture array, whose layers can be gathered from.

@group(1) @binding(0) var atlas: texture_2d_array<u32>;
@group(1) @binding(1) var atlas_sampler: sampler;
@group(1) @binding(6) var atlas1: texture_2d_array<u32>;
@group(1) @binding(7) var atlas2: texture_2d_array<u32>;
@group(1) @binding(8) var atlas3: texture_2d_array<u32>;

// False where one texture holds all slots: software adapters would load from each.
override MANY_ATLASES: bool = false;

fn atlas_gather(texture: u32, at: vec2f, layer: i32) -> vec4f {
    if !MANY_ATLASES {
        return vec4f(textureGather(0, atlas, atlas_sampler, at, layer));
    }
    switch texture {
        case 1u: { return vec4f(textureGather(0, atlas1, atlas_sampler, at, layer)); }
        case 2u: { return vec4f(textureGather(0, atlas2, atlas_sampler, at, layer)); }
        case 3u: { return vec4f(textureGather(0, atlas3, atlas_sampler, at, layer)); }
        default: { return vec4f(textureGather(0, atlas, atlas_sampler, at, layer)); }
    }
}

fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    return sample_exact(brick, local);
}
