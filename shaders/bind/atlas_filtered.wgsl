// The atlas, read through the hardware's linear filter: fast, with the hardware's coarse weights.

@group(1) @binding(0) var atlas: texture_3d<f32>;
@group(1) @binding(1) var atlas_sampler: sampler;
@group(1) @binding(6) var atlas1: texture_3d<f32>;
@group(1) @binding(7) var atlas2: texture_3d<f32>;
@group(1) @binding(8) var atlas3: texture_3d<f32>;

// False where one texture holds all slots: software adapters would load from each.
override MANY_ATLASES: bool = false;

// Rounded down to 1/4096 voxel, slot + local is exact in f32, and the atlas edges are powers of two: the same brick gives
// the same value in every slot (design.md §5).
fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    let snapped = floor(local * 4096.0) * (1.0 / 4096.0);
    let at = (brick.texel + snapped) * frame.texture_from_atlas.xyz;
    if !MANY_ATLASES {
        return textureSampleLevel(atlas, atlas_sampler, at, 0.0).x;
    }
    switch brick.texture {
        case 1u: { return textureSampleLevel(atlas1, atlas_sampler, at, 0.0).x; }
        case 2u: { return textureSampleLevel(atlas2, atlas_sampler, at, 0.0).x; }
        case 3u: { return textureSampleLevel(atlas3, atlas_sampler, at, 0.0).x; }
        default: { return textureSampleLevel(atlas, atlas_sampler, at, 0.0).x; }
    }
}
