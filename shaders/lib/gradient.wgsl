// Gradients at a sample, in world units.

// Half a voxel outside a brick its border voxels have their own value; only beyond the volume, where the edge voxel repeats, does
// a filtered gradient reach further.
fn gradient_tap(brick: Brick, offset: vec3f) -> vec3f {
    if !FILTERED_GRADIENTS {
        return offset;
    }
    return clamp(offset, brick.origin - 0.5, brick.origin + (f32(BRICK_EDGE) + 0.5));
}

// Central differences at ±½ voxel of the level (design.md §3), in level voxels; zero where nobody wants it. One axis after
// the other in a loop: a software adapter leaves it after the first when no ray of eight wants a gradient.
fn gradient_central(brick: Brick, offset: vec3f, wanted: bool) -> vec3f {
    var differences = vec3f(0.0);
    var axis = 0u;
    loop {
        let half = select(vec3f(0.0), vec3f(0.5), vec3u(axis) == vec3u(0u, 1u, 2u));
        let difference = sample_value(brick, gradient_tap(brick, offset + half))
            - sample_value(brick, gradient_tap(brick, offset - half));
        differences += 2.0 * half * difference;
        axis += 1u;
        if axis == 3u || !wanted {
            break;
        }
    }
    return differences;
}

// Those at the point, and half a voxel away along each axis, both ways. A point beyond the brick's faces is read from the
// brick that it lies in: with its own border that one has all six values. Where that brick is missing, it is asked for
// and the ray stops; in a draft the point moves to the face.
fn gradient_filtered(caster: ptr<function, Cast>, source: Source, offset: vec3f, wanted: bool) -> vec3f {
    var sum = gradient_central(source.brick, offset, wanted);
    var k = 0u;
    loop {
        let half = select(vec3f(0.0), vec3f(0.5), vec3u(k >> 1u) == vec3u(0u, 1u, 2u));
        var point = offset + select(-half, half, (k & 1u) == 0u);
        var brick = source.brick;
        if wanted && !brick_contains(brick, point) {
            var neighbour = brick_at(grid_of(brick.level), point);
            if neighbour.is_absent {
                neighbour.tag = TAG_ABSENT;
            }
            if neighbour.tag != TAG_ABSENT {
                brick = neighbour;
                feedback_touch(neighbour);
            } else {
                cast_miss(caster, neighbour);
                if DRAFT {
                    point = clamp(point, brick.origin, brick.origin + f32(BRICK_EDGE));
                }
            }
        }
        sum += gradient_central(brick, point, wanted);
        k += 1u;
        if k == 6u || !wanted {
            break;
        }
    }
    return sum / 7.0;
}

// At sample `index` of the ray; zero where it is not wanted.
fn gradient_at(caster: ptr<function, Cast>, source: Source, index: f32, wanted: bool) -> vec3f {
    let offset = source_offset(source, index);
    var differences: vec3f;
    if FILTERED_GRADIENTS {
        differences = gradient_filtered(caster, source, offset, wanted);
    } else {
        differences = gradient_central(source.brick, offset, wanted);
    }
    return ray_world_gradient(differences, source.brick.level);
}
