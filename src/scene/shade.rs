//! Phong's model for one ray, as `shaders/lib/shade.wgsl` has it.

use glam::Vec3;

use super::Shading;

/// The colour of a lit sample: two-sided Phong with a white highlight. `gradient` is in world units (any length; zero
/// means no surface: ambient only), `ray` the unit direction of the ray.
pub fn phong(color: Vec3, gradient: Vec3, ray: Vec3, shading: &Shading) -> Vec3 {
    let length = gradient.length();
    if length <= f32::MIN_POSITIVE {
        return color * shading.ambient;
    }
    let normal = gradient / length;
    let to_eye = -ray;
    let to_light = shading.light.map_or(to_eye, |d| -d.as_vec3().normalize());
    let diffuse = normal.dot(to_light).abs();
    let half = to_light + to_eye;
    let half_length = half.length();
    let highlight = if half_length > 1e-6 {
        (normal.dot(half) / half_length).abs()
    } else {
        0.0
    };
    let specular = shading.specular * highlight.powf(shading.shininess);
    (color * (shading.ambient + shading.diffuse * diffuse) + Vec3::splat(specular))
        .clamp(Vec3::ZERO, Vec3::ONE)
}
