// Trilinear from eight texel loads, as the reference computes it.
fn sample_exact(brick: Brick, local: vec3f) -> f32 {
    let shifted = local - 0.5;
    let low = floor(shifted);
    let f = shifted - low;
    let at = vec3i(brick.texel) + vec3i(low);
    let a00 = atlas_texel(brick.texture, at);
    let b00 = atlas_texel(brick.texture, at + vec3i(1, 0, 0));
    let a10 = atlas_texel(brick.texture, at + vec3i(0, 1, 0));
    let b10 = atlas_texel(brick.texture, at + vec3i(1, 1, 0));
    let a01 = atlas_texel(brick.texture, at + vec3i(0, 0, 1));
    let b01 = atlas_texel(brick.texture, at + vec3i(1, 0, 1));
    let a11 = atlas_texel(brick.texture, at + vec3i(0, 1, 1));
    let b11 = atlas_texel(brick.texture, at + vec3i(1, 1, 1));
    let x00 = a00 + (b00 - a00) * f.x;
    let x10 = a10 + (b10 - a10) * f.x;
    let x01 = a01 + (b01 - a01) * f.x;
    let x11 = a11 + (b11 - a11) * f.x;
    let y0 = x00 + (x10 - x00) * f.y;
    let y1 = x01 + (x11 - x01) * f.y;
    return y0 + (y1 - y0) * f.z;
}
