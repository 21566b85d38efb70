// A dense level in the place of the atlas, interpolated by hand as the caster does it: one brick that begins at texel 0.
fn bare_value(at: vec3f) -> f32 {
    var whole: Brick;
    return sample_exact(whole, at);
}
