// The atlas, read through the hardware's linear filter: fast, with the hardware's coarse weights.

@group(1) @binding(0) var atlas: texture_3d<f32>;
@group(1) @binding(1) var atlas_sampler: sampler;

// Rounded down to 1/4096 voxel, slot + local is exact in f32, and the atlas edges are powers of two: the same brick gives
// the same value in every slot (design.md §5).
fn atlas_value(brick: Brick, local: vec3f) -> f32 {
    let snapped = floor(local * 4096.0) * (1.0 / 4096.0);
    return textureSampleLevel(atlas, atlas_sampler, (brick.texel + snapped) * frame.texture_from_atlas.xyz, 0.0).x;
}
