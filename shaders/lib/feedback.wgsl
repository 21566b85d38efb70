// The only way back: which bricks rays miss and which slots they used (design.md §5). One buffer of words; the places are
// FEEDBACK_* and, where they depend on the volume, in the frame's uniforms.

// A sample was taken in the brick: its slot was used in this dispatch.
fn feedback_touch(brick: Brick) {
    if brick.tag == TAG_SLOT {
        atomicStore(&feedback[frame.stamps_at + brick.slot], frame.dispatch);
    }
}

// A ray misses the brick of that level. The first one puts it on the list; all are counted, by a hash of the brick's number.
fn feedback_request(grid: Grid, brick: Brick) {
    let number = brick_number(grid, brick.xyz);
    atomicAdd(&feedback[FEEDBACK_RAYS + ((number * 2654435769u) >> (32u - FEEDBACK_RAYS_BITS))], 1u);
    let bit = 1u << (number & 31u);
    let before = atomicOr(&feedback[frame.bits_at + (number >> 5u)], bit);
    if (before & bit) == 0u {
        let place = atomicAdd(&feedback[FEEDBACK_LISTED], 1u);
        if place < FEEDBACK_LIST_MAX {
            atomicStore(&feedback[FEEDBACK_LIST + place], number);
        }
    }
}
