// Where a brick's voxels are: the indirection word, unpacked once per brick that a ray enters.

// Only what is better than the ray's extreme is walked; MINIMUM: the extreme is the least value, not the greatest.
override EXTREME: bool = false;
override MINIMUM: bool = false;
// Samples in empty bricks, at the ends of runs, need their values: the side of one iso-value isn't enough.
override EXACT_ENDS: bool = false;

struct Brick {
    // Place in the grid of the ray's level, and that level.
    xyz: vec3i,
    level: u32,
    // Offset of the brick's first voxel corner from the level's anchor, level voxels.
    origin: vec3f,
    // Which atlas texture, its texel of that corner (the border voxel lies before it), and the slot's number.
    texture: u32,
    texel: vec3f,
    slot: u32,
    // TAG_ABSENT only where voxels are needed and missing.
    tag: u32,
    // Not in the atlas and not constant, needed or not.
    is_absent: bool,
    // The value of a constant brick, stored units.
    constant: f32,
}

// Number of a brick among those of all levels.
fn brick_number(grid: Grid, xyz: vec3i) -> u32 {
    let bricks = vec3u(grid.last + 1);
    return grid.first_number + (u32(xyz.z) * bricks.y + u32(xyz.y)) * bricks.x + u32(xyz.x);
}

// BRICK_* bits of a brick that lies inside its level.
fn brick_activity_of(grid: Grid, xyz: vec3i) -> u32 {
    let number = brick_number(grid, xyz);
    return (brick_activity[number >> 4u] >> ((number & 15u) * 2u)) & 3u;
}

// The bound of the samples in the brick.
fn brick_extreme(grid: Grid, xyz: vec3i) -> f32 {
    let number = brick_number(grid, xyz);
    let codes = (brick_extremes[number >> 1u] >> ((number & 1u) * 16u)) & 0xffffu;
    return brick_bound(select(codes & 255u, codes >> 8u, MINIMUM));
}

// The value that a code stands for: no sample is greater; with MINIMUM, none of the negated samples. The last one stands for
// anything.
fn brick_bound(code: u32) -> f32 {
    let least = select(frame.value_floor, -frame.value_ceiling, MINIMUM);
    return select(least + f32(code) * frame.extreme_scale, 3e38, code == 255u);
}

fn brick_word(grid: Grid, xyz: vec3i) -> u32 {
    return textureLoad(indirection, clamp(xyz, vec3i(0), grid.last) + grid.indirection_origin, 0).x;
}

// A slot's place is packed as texture (2 bits) and z, y, x (9 bits each).
fn brick_slot_place(word: u32) -> vec3u {
    return vec3u(word & 511u, (word >> 9u) & 511u, (word >> 18u) & 511u);
}

fn brick_slot_number(word: u32) -> u32 {
    let place = brick_slot_place(word);
    let texture = (word & PAYLOAD_MASK) >> 27u;
    return ((texture * frame.atlas_slots.z + place.z) * frame.atlas_slots.y + place.y) * frame.atlas_slots.x + place.x;
}

// The brick of the level that holds `offset`.
fn brick_at(grid: Grid, offset: vec3f) -> Brick {
    let xyz = clamp((grid.anchor + vec3i(floor(offset))) >> vec3u(BRICK_SHIFT), vec3i(0), grid.last);
    let word = brick_word(grid, xyz);
    var brick: Brick;
    brick.xyz = xyz;
    brick.level = grid.level;
    brick.origin = vec3f(xyz * i32(BRICK_EDGE) - grid.anchor);
    brick.tag = word >> TAG_SHIFT;
    brick.is_absent = brick.tag == TAG_ABSENT;
    brick.constant = frame.value_floor;
    if brick.tag == TAG_CONSTANT {
        brick.constant = constants[word & PAYLOAD_MASK];
    }
    if brick.is_absent && !EXACT_ENDS {
        // Nothing in an empty brick can be seen, so that only the side of the iso-value matters: no voxels are needed.
        let activity = brick_activity_of(grid, xyz);
        if activity == BRICK_EMPTY || activity == BRICK_EMPTY_ABOVE {
            brick.tag = TAG_CONSTANT;
            brick.constant = select(frame.empty_below, frame.empty_above, activity == BRICK_EMPTY_ABOVE);
        }
    }
    brick.texture = (word & PAYLOAD_MASK) >> 27u;
    brick.texel = vec3f(brick_slot_place(word) * STORED_EDGE + BRICK_BORDER);
    brick.slot = brick_slot_number(word);
    return brick;
}

// Is `offset` inside the brick (its border not counted)?
fn brick_contains(brick: Brick, offset: vec3f) -> bool {
    let local = offset - brick.origin;
    return all(local >= vec3f(0.0)) && all(local < vec3f(f32(BRICK_EDGE)));
}
