// Trilinear from eight texels, as the reference computes it. Two gathers fetch them, one per slice: four texels that share
// a corner, asked for at that corner, half a texel from where others would be fetched.
fn sample_exact(brick: Brick, local: vec3f) -> f32 {
    let shifted = local - 0.5;
    let low = floor(shifted);
    let f = shifted - low;
    let corner = (low.xy + (brick.texel.xy + 1.0)) * frame.texture_from_atlas.xy;
    let layer = i32(low.z + brick.texel.z);
    // A gather yields (x, y + 1), (x + 1, y + 1), (x + 1, y), (x, y).
    let near = atlas_gather(brick.texture, corner, layer);
    let far = atlas_gather(brick.texture, corner, layer + 1);
    let x00 = near.w + (near.z - near.w) * f.x;
    let x10 = near.x + (near.y - near.x) * f.x;
    let x01 = far.w + (far.z - far.w) * f.x;
    let x11 = far.x + (far.y - far.x) * f.x;
    let y0 = x00 + (x10 - x00) * f.y;
    let y1 = x01 + (x11 - x01) * f.y;
    return y0 + (y1 - y0) * f.z;
}
