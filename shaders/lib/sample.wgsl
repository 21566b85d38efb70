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

// Central differences at ±½ voxel of the level (design.md §3), in world units; zero where nobody wants it. One axis after
// the other in a loop: a software adapter leaves it after the first when no ray of eight wants a gradient.
fn sample_gradient(brick: Brick, offset: vec3f, wanted: bool) -> vec3f {
    var differences = vec3f(0.0);
    var axis = 0u;
    loop {
        let half = select(vec3f(0.0), vec3f(0.5), vec3u(axis) == vec3u(0u, 1u, 2u));
        let difference = sample_value(brick, offset + half) - sample_value(brick, offset - half);
        differences += 2.0 * half * difference;
        axis += 1u;
        if axis == 3u || !wanted {
            break;
        }
    }
    return frame.levels[brick.level].normal_from_gradient[0].xyz * differences.x
        + frame.levels[brick.level].normal_from_gradient[1].xyz * differences.y
        + frame.levels[brick.level].normal_from_gradient[2].xyz * differences.z;
}
