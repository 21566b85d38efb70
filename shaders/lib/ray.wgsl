// Rays on the frame's sample grid (design.md §2, invariant 1). The twin is reference::caster::Ray.

// Samples are moved by a part of a step that depends on the pixel (techniques.md T1.4).
override JITTERED: bool = false;

// PANORAMA_*: how rays run in all directions, if they do.
override PANORAMA: u32 = 0u;

// False where only one level is sampled: its number is then a constant.
override MANY_LEVELS: bool = true;

// What of a level is needed for every brick, loaded once: where rays are at different levels, each load from the uniforms
// is one per ray.
struct Grid {
    // Number of the level among frame.levels.
    level: u32,
    anchor: vec3i,
    // The last brick along each axis, and the number of the first among the bricks of all levels.
    last: vec3i,
    first_number: u32,
    indirection_origin: vec3i,
}

fn grid_of(level: u32) -> Grid {
    var grid: Grid;
    grid.level = level;
    grid.anchor = frame.levels[level].anchor.xyz;
    grid.last = vec3i(frame.levels[level].bricks.xyz) - 1;
    grid.first_number = frame.levels[level].bricks.w;
    grid.indirection_origin = vec3i(frame.levels[level].indirection_origin.xyz);
    return grid;
}

struct Ray {
    grid: Grid,
    step_mm: f32,
    // Distance of sample 0 from the eye.
    first_mm: f32,
    // Unit direction, world.
    direction: vec3f,
    // Length of the unnormalised direction: view depth · length = distance (perspective).
    stretch: f32,
    // Level-voxel offset (from the level's anchor) of sample 0, and from a sample to the next.
    base: vec3f,
    step: vec3f,
    inverse_step: vec3f,
    // First and last sample inside the volume and the level's part of the ray; empty when first > last.
    first: i32,
    last: i32,
}

fn ray_axis(step: f32) -> f32 {
    // No axis may stand still: the slab test divides by it.
    return select(step, 1e-20, abs(step) < 1e-20);
}

// By how much of a base step the samples of a pixel are moved (scene::interleaved_offset).
fn ray_jitter(pixel: vec2u) -> f32 {
    if !JITTERED {
        return 0.0;
    }
    let fine = pixel & vec2u(1u);
    let coarse = (pixel >> vec2u(1u)) & vec2u(1u);
    let sixteenths = 4u * (2u * (fine.x ^ fine.y) + fine.y) + 2u * (coarse.x ^ coarse.y) + coarse.y;
    return f32(sixteenths) / 16.0;
}

// The part of the pixel's ray that is sampled at `level`.
fn ray_for_pixel(pixel: vec2u, level: u32) -> Ray {
    return ray_through(vec2f(pixel), ray_jitter(pixel), level);
}

// Where on the image plane the ray of a pixel passes: u, v.
fn ray_plane(pixel: vec2f) -> vec2f {
    let u = (pixel.x + frame.place_in_pixel.x) * (2.0 / f32(frame.picture_size.x)) - 1.0;
    let v = 1.0 - (pixel.y + frame.place_in_pixel.y) * (2.0 / f32(frame.picture_size.y));
    return vec2f(u, v);
}

// Sine and cosine of an angle from -π to π, as scene::frame has them.
fn ray_half_turn(angle: f32) -> vec2f {
    let h = angle * 0.5;
    let q = h * h;
    let s = h * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q * (1.0 / 362880.0 - q / 39916800.0)))));
    return vec2f(2.0 * s * ray_half_cosine(q), 1.0 - 2.0 * s * s);
}

// Cosine of an angle by its square.
fn ray_half_cosine(q: f32) -> f32 {
    return 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0
        + q * (1.0 / 40320.0 + q * (-1.0 / 3628800.0 + q / 479001600.0)))));
}

// Weights of the direction's three vectors for the ray through a point of the image plane (scene::RayFrame::fan).
fn ray_fan(plane: vec2f) -> vec3f {
    if PANORAMA == PANORAMA_SPHERE {
        let longitude = ray_half_turn(plane.x * frame.half_angles.x);
        let latitude = ray_half_turn(plane.y * frame.half_angles.y);
        return vec3f(latitude.y * longitude.y, latitude.y * longitude.x, latitude.x);
    }
    if PANORAMA == PANORAMA_FISHEYE {
        let at = plane * frame.half_angles;
        let angle = sqrt(dot(at, at));
        let turn = ray_half_turn(angle);
        let scale = select(1.0, turn.x / angle, angle > 1e-6);
        return vec3f(turn.y, at * scale);
    }
    return vec3f(1.0, plane);
}

// Direction of a ray in the world, not normalised.
fn ray_world(plane: vec2f) -> vec3f {
    let fan = ray_fan(plane);
    return frame.world_dir[0].xyz * fan.x + frame.world_dir[1].xyz * fan.y + frame.world_dir[2].xyz * fan.z;
}

// Where a ray enters and leaves the rendered box, in samples; the first is the greater where it misses.
fn ray_box(ray: Ray, level: u32) -> vec2f {
    let to_min = (frame.levels[level].box_min.xyz - ray.base) / ray.step;
    let to_max = (frame.levels[level].box_max.xyz - ray.base) / ray.step;
    let near3 = min(to_min, to_max);
    let far3 = max(to_min, to_max);
    return vec2f(max(max(near3.x, near3.y), near3.z), min(min(far3.x, far3.y), far3.z));
}

// The same for any pixel, also one outside the picture; its samples are moved by `jitter` base steps.
fn ray_through(pixel: vec2f, jitter: f32, level: u32) -> Ray {
    let plane = ray_plane(pixel);
    let u = plane.x;
    let v = plane.y;
    let fan = ray_fan(plane);
    let world = ray_world(plane);
    let dir = frame.levels[level].level_dir[0].xyz * fan.x + frame.levels[level].level_dir[1].xyz * fan.y
        + frame.levels[level].level_dir[2].xyz * fan.z;
    let origin = frame.levels[level].level_origin[0].xyz + frame.levels[level].level_origin[1].xyz * u
        + frame.levels[level].level_origin[2].xyz * v;
    let step_mm = frame.levels[level].step_mm;
    let first_mm = frame.first_mm + jitter * frame.step_mm;
    let stretch = sqrt(dot(world, world));
    let inverse = 1.0 / stretch;

    var ray: Ray;
    ray.grid = grid_of(level);
    ray.step_mm = step_mm;
    ray.first_mm = first_mm;
    ray.stretch = stretch;
    ray.direction = world * inverse;
    ray.base = origin + dir * (inverse * first_mm);
    let step = dir * (inverse * step_mm);
    ray.step = vec3f(ray_axis(step.x), ray_axis(step.y), ray_axis(step.z));
    ray.inverse_step = 1.0 / ray.step;
    let inside = ray_box(ray, level);
    let near_plane = (frame.near_mm * stretch - first_mm) / step_mm;
    let begin = f32(frame.levels[level].begin);
    ray.first = i32(min(ceil(max(max(inside.x, near_plane), begin)), 2e9));
    let end = min(f32(frame.last_index >> (frame.finest_lod + level)), f32(frame.levels[level].last));
    ray.last = i32(clamp(floor(min(inside.y, end)), -1.0, 2e9));
    return ray;
}

// Level-voxel offset of sample `index` (fractions between samples are allowed).
fn ray_offset(ray: Ray, index: f32) -> vec3f {
    return ray.base + index * ray.step;
}

// Sample index at the ray's level of a distance from the eye.
fn ray_index(ray: Ray, distance_mm: f32) -> f32 {
    return (distance_mm - ray.first_mm) / ray.step_mm;
}

// A gradient in voxels of `level` in world units.
fn ray_world_gradient(gradient: vec3f, level: u32) -> vec3f {
    return frame.levels[level].normal_from_gradient[0].xyz * gradient.x
        + frame.levels[level].normal_from_gradient[1].xyz * gradient.y
        + frame.levels[level].normal_from_gradient[2].xyz * gradient.z;
}
