// Where a brick's voxels are: the indirection word, unpacked once per brick that a ray enters.

struct Brick {
    // Offset of the brick's first voxel corner from the anchor, level voxels.
    origin: vec3f,
    // Atlas texel of that corner (the border voxel lies before it).
    texel: vec3f,
    tag: u32,
    // The value of a constant brick, stored units.
    constant: f32,
}


fn brick_word(xyz: vec3i) -> u32 {
    let last = vec3i(frame.level_bricks.xyz) - 1;
    return textureLoad(indirection, clamp(xyz, vec3i(0), last) + vec3i(frame.indirection_origin.xyz), 0).x;
}

fn brick_at(offset: vec3f) -> Brick {
    let last = vec3i(frame.level_bricks.xyz) - 1;
    let xyz = clamp((frame.anchor.xyz + vec3i(floor(offset))) >> vec3u(BRICK_SHIFT), vec3i(0), last);
    let word = brick_word(xyz);
    let payload = word & PAYLOAD_MASK;
    var brick: Brick;
    brick.origin = vec3f(xyz * i32(BRICK_EDGE) - frame.anchor.xyz);
    brick.tag = word >> TAG_SHIFT;
    brick.constant = frame.value_floor;
    if brick.tag == TAG_CONSTANT {
        brick.constant = constants[payload];
    }
    // A slot's place is packed as three 10-bit numbers.
    let slot = vec3u(payload & 1023u, (payload >> 10u) & 1023u, payload >> 20u);
    brick.texel = vec3f(slot * STORED_EDGE + BRICK_BORDER);
    return brick;
}

// Is `offset` inside the brick (its border not counted)?
fn brick_contains(brick: Brick, offset: vec3f) -> bool {
    let local = offset - brick.origin;
    return all(local >= vec3f(0.0)) && all(local < vec3f(f32(BRICK_EDGE)));
}
