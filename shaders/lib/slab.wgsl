// A slab in workgroup memory: samples of a group's rays at the same distances from the eye, and of a rim of rays and distances
// around them, from which gradients are taken (techniques.md T5).
//
// Positions outside the volume's box have the value at the nearest point of the box: its edge voxels are repeated there, as
// in the bricks' borders (design.md §3), so that gradients at the faces are those of lib/gradient.wgsl.

// Samples of a ray that a slab shades.
override SLAB_DEPTH: u32 = 16u;
// How many rays and samples away a gradient reaches: 0 without one, 1, or 2 for filtered ones.
override SLAB_RIM: u32 = 0u;
// Samples in front of the slab: one more than the rim where gradients are taken between samples.
override SLAB_FRONT: u32 = 0u;
// Rays with their rim, along x and in all, and the values of all of them.
override SLAB_WIDE: u32 = 8u;
override SLAB_AREA: u32 = 64u;
override SLAB_VALUES: u32 = 1024u;
override SLAB_RAYS: u32 = 64u;

// Plane by plane, row by row. Plane SLAB_FRONT is the slab's first sample.
var<workgroup> slab_values: array<f32, SLAB_VALUES>;

// The slab's first sample; the place of this invocation's ray in a plane.
var<private> slab_first: i32;
var<private> slab_place: u32;
// From the ray on the left to the ray on the right of this one, and from the one above to the one below: level voxels at
// sample 0, and what a sample adds.
var<private> slab_across: array<vec3f, 2>;
var<private> slab_down: array<vec3f, 2>;

// The ray of an invocation has its neighbours in the planes of the slab that begins with sample `first`.
fn slab_begin(caster: Cast, first: i32) {
    slab_first = first;
    if SLAB_RIM == 0u {
        return;
    }
    let pixel = vec2f(caster.pixel);
    let level = caster.ray.grid.level;
    let left = ray_through(pixel - vec2f(1.0, 0.0), 0.0, level);
    let right = ray_through(pixel + vec2f(1.0, 0.0), 0.0, level);
    let above = ray_through(pixel - vec2f(0.0, 1.0), 0.0, level);
    let below = ray_through(pixel + vec2f(0.0, 1.0), 0.0, level);
    slab_across = array(right.base - left.base, right.step - left.step);
    slab_down = array(below.base - above.base, below.step - above.step);
}

// Where the value of sample `index` of this invocation's ray is.
fn slab_at(index: i32) -> u32 {
    return u32(index - slab_first + i32(SLAB_FRONT)) * SLAB_AREA + slab_place;
}

fn value_at(source: Source, index: i32) -> f32 {
    return slab_values[slab_at(index)];
}

// Differences of the values on both sides of a place: across, down, along the ray.
fn slab_differences(at: u32) -> vec3f {
    return vec3f(
        slab_values[at + 1u] - slab_values[at - 1u],
        slab_values[at + SLAB_WIDE] - slab_values[at - SLAB_WIDE],
        slab_values[at + SLAB_AREA] - slab_values[at - SLAB_AREA],
    );
}

// The gradient in level voxels at a sample of this invocation's ray: what explains the differences of values by those of
// the positions. Rays diverge, and voxels need not be cubes: these are no right angles.
fn slab_gradient(ray: Ray, index: i32) -> vec3f {
    let at = slab_at(index);
    var differences = slab_differences(at);
    if FILTERED_GRADIENTS {
        // The mean of those at the sample and at its six neighbours.
        differences += slab_differences(at - 1u) + slab_differences(at + 1u)
            + slab_differences(at - SLAB_WIDE) + slab_differences(at + SLAB_WIDE)
            + slab_differences(at - SLAB_AREA) + slab_differences(at + SLAB_AREA);
        differences /= 7.0;
    }
    let across = slab_across[0] + f32(index) * slab_across[1];
    let down = slab_down[0] + f32(index) * slab_down[1];
    let along = 2.0 * ray.step;
    let of_across = cross(down, along);
    let of_down = cross(along, across);
    let of_along = cross(across, down);
    let volume = dot(across, of_across);
    // At the eye itself all rays meet, and no direction is known.
    let inverse = select(0.0, 1.0 / volume, abs(volume) > 1e-20);
    return (of_across * differences.x + of_down * differences.y + of_along * differences.z) * inverse;
}

// At `index` of this invocation's ray, in world units; zero where it is not wanted. Between two samples it is between their
// gradients.
fn gradient_at(caster: ptr<function, Cast>, source: Source, index: f32, wanted: bool) -> vec3f {
    if !wanted {
        return vec3f(0.0);
    }
    let high = ceil(index);
    var gradient = slab_gradient((*caster).ray, i32(high));
    if SLAB_FRONT > SLAB_RIM {
        gradient += (slab_gradient((*caster).ray, i32(high) - 1) - gradient) * (high - index);
    }
    return ray_world_gradient(gradient, (*caster).ray.grid.level);
}
