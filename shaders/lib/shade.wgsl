// Two-sided Phong with a white highlight. The twin is reference::shade.

fn shade_phong(color: vec3f, gradient: vec3f, ray_direction: vec3f) -> vec3f {
    let length_squared = dot(gradient, gradient);
    let ambient = frame.material.x;
    if length_squared <= 1e-37 {
        return color * ambient;
    }
    let normal = gradient / sqrt(length_squared);
    let to_eye = -ray_direction;
    let to_light = select(frame.to_light.xyz, to_eye, frame.to_light.w > 0.5);
    let diffuse = abs(dot(normal, to_light));
    let halfway = to_light + to_eye;
    let half_length = sqrt(dot(halfway, halfway));
    let highlight = select(0.0, abs(dot(normal, halfway)) / half_length, half_length > 1e-6);
    let specular = frame.material.z * pow(highlight, frame.material.w);
    return clamp(color * (ambient + frame.material.y * diffuse) + specular, vec3f(0.0), vec3f(1.0));
}
