// A dense level in the place of the atlas, read through the hardware's linear filter. Not snapped as in atlas_filtered.wgsl:
// that is a cost of bricks.
fn bare_value(at: vec3f) -> f32 {
    return textureSampleLevel(atlas, atlas_sampler, at * frame.texture_from_atlas.xyz, 0.0).x;
}
