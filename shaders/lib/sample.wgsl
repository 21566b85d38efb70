// Values between voxel centres, in stored units. `offset` counts from the anchor of the brick's level in its voxels and lies inside
// `brick` or at most half a voxel outside (gradient taps): its border voxels are the true neighbours.

// The value of the containing voxel instead of interpolation.
override NEAREST: bool = false;

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

// Central differences at ±½ voxel of the level (design.md §3), in world units.
fn sample_gradient(brick: Brick, offset: vec3f) -> vec3f {
    let x = sample_value(brick, offset + vec3f(0.5, 0.0, 0.0)) - sample_value(brick, offset - vec3f(0.5, 0.0, 0.0));
    let y = sample_value(brick, offset + vec3f(0.0, 0.5, 0.0)) - sample_value(brick, offset - vec3f(0.0, 0.5, 0.0));
    let z = sample_value(brick, offset + vec3f(0.0, 0.0, 0.5)) - sample_value(brick, offset - vec3f(0.0, 0.0, 0.5));
    return frame.levels[brick.level].normal_from_gradient[0].xyz * x
        + frame.levels[brick.level].normal_from_gradient[1].xyz * y
        + frame.levels[brick.level].normal_from_gradient[2].xyz * z;
}
