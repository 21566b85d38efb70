// Values between voxel centres, in stored units. `offset` counts from the anchor of the brick's level in its voxels and lies inside
// `brick` or at most half a voxel outside (gradient taps): its border voxels are the true neighbours.

// The value of the containing voxel instead of interpolation.
override NEAREST: bool = false;
// Gradients are the mean of the central differences at seven points instead of those at one (design.md §3).
override FILTERED_GRADIENTS: bool = false;

fn sample_value(brick: Brick, offset: vec3f) -> f32 {
    if brick.tag != TAG_SLOT {
        return brick.constant;
    }
    var local = offset - brick.origin;
    if NEAREST {
        local = floor(local) + 0.5;
    }
    return atlas_value(brick, local) * frame.value_scale;
}
