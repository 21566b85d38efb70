// Every struct shared with the host (src/gpu/layout.rs), and nothing else. tests/shaders.rs compares both.

// One frame: the sample grid (scene::RayFrame), the classification's constants and the switches.
// A per-ray quantity is q[0] + u·q[1] + v·q[2] with the image-plane coordinates u, v.
struct FrameUniforms {
    world_dir: array<vec4f, 3>,
    level_dir: array<vec4f, 3>,
    level_origin: array<vec4f, 3>,
    // The rendered box in level voxels, from the anchor.
    box_min: vec4f,
    box_max: vec4f,
    // World normal from level-voxel gradient, columns.
    normal_from_gradient: array<vec4f, 3>,
    // Unit direction to the light, world; w = 1 for a headlight.
    to_light: vec4f,
    // Ambient, diffuse, specular, shininess.
    material: vec4f,
    iso_color: vec4f,
    // Clip space from level-voxel offset, cropped to the tile and its margin; reversed depth.
    clip_from_offset: mat4x4f,
    // Integer voxel of the level that offsets count from.
    anchor: vec4i,
    // Bricks of the level; w unused.
    level_bricks: vec4u,
    // Where the level begins in the indirection texture.
    indirection_origin: vec4u,
    // Atlas slots per axis; w unused.
    atlas_slots: vec4u,
    // 1 / atlas edges in texels.
    texture_from_atlas: vec4f,
    // Picture size in pixels, and the tile: origin and size.
    picture_size: vec2u,
    tile_origin: vec2u,
    tile_size: vec2u,
    last_index: u32,
    flags: u32,
    step_mm: f32,
    first_mm: f32,
    near_mm: f32,
    opacity_cutoff: f32,
    // View depth from depth-buffer value d: perspective depth_scale / d, orthographic depth_bias - depth_scale · d.
    depth_scale: f32,
    depth_bias: f32,
    // What the raster may be off, in samples: one block diagonal.
    slack: f32,
    iso: f32,
    // Table index = (stored value - lut_lo) · lut_scale, in [0, lut_last].
    lut_scale: f32,
    lut_lo: f32,
    lut_last: f32,
    // Stored value = texel · value_scale.
    value_scale: f32,
    // The least stored value of the volume.
    value_floor: f32,
    // Work-group number w casts group (w · group_stride) mod (number of groups).
    group_stride: u32,
    pad1: f32,
    pad2: f32,
}
