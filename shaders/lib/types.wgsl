// Every struct shared with the host (src/gpu/layout.rs), and nothing else. tests/shaders.rs compares both.

// One level of the frame's sample grid (scene::LevelFrame). Sample j of the level lies 2^lod · j base steps from sample 0.
// A per-ray quantity is q[0] + u·q[1] + v·q[2] with the image-plane coordinates u, v.
struct LevelUniforms {
    level_dir: array<vec4f, 3>,
    level_origin: array<vec4f, 3>,
    // The rendered box in level voxels, from the anchor.
    box_min: vec4f,
    box_max: vec4f,
    // World normal from level-voxel gradient, columns.
    normal_from_gradient: array<vec4f, 3>,
    // Integer voxel of the level that offsets count from; w unused.
    anchor: vec4i,
    // Bricks of the level; w: the number of its first brick among those of all levels.
    bricks: vec4u,
    // Where the level begins in the indirection texture; w unused.
    indirection_origin: vec4u,
    // First and last sample that are taken at this level.
    begin: i32,
    last: i32,
    step_mm: f32,
    // By how much a point where the level first shows something is moved back for the next frame, mm.
    leap_back_mm: f32,
}

// One frame: the sample grid (scene::RayFrame), the classification's constants and the switches.
struct FrameUniforms {
    world_dir: array<vec4f, 3>,
    // Unit direction to the light, world; w = 1 for a headlight.
    to_light: vec4f,
    // Ambient, diffuse, specular, shininess.
    material: vec4f,
    // Surfaces by rising value: colour and opacity, and the value itself, four to a vector.
    surface_colors: array<vec4f, MAX_SURFACES>,
    surface_values: array<vec4f, MAX_SURFACES_4>,
    // Clip space from an offset in voxels of the mesh's level, cropped to the tile and its margin; reversed depth.
    clip_from_offset: mat4x4f,
    // Integer voxel of the mesh's level that its offsets count from; w unused.
    mesh_anchor: vec4i,
    // Atlas slots per axis of one texture; w unused.
    atlas_slots: vec4u,
    // 1 / edges of an atlas texture in texels.
    texture_from_atlas: vec4f,
    // Picture size in pixels; the tile's origin; the row length of the tile's buffers and their rows; the part of the tile
    // inside the picture.
    picture_size: vec2u,
    tile_origin: vec2u,
    tile_size: vec2u,
    part_size: vec2u,
    // Where in a pixel its ray passes, from its upper left corner, in pixels.
    place_in_pixel: vec2f,
    // Last sample of any ray, in base steps, as samples of level 0.
    last_index: u32,
    first_mm: f32,
    // Distance of base samples.
    step_mm: f32,
    near_mm: f32,
    opacity_cutoff: f32,
    // View depth from depth-buffer value d: perspective depth_scale / d, orthographic depth_bias - depth_scale · d.
    depth_scale: f32,
    depth_bias: f32,
    // What the raster may be off, mm along a ray: one block diagonal.
    slack_mm: f32,
    // Table index = (stored value - lut_lo) · lut_scale, in [0, lut_last].
    lut_scale: f32,
    lut_lo: f32,
    lut_last: f32,
    // Stored value = texel · value_scale.
    value_scale: f32,
    // The least and the greatest stored value of the volume.
    value_floor: f32,
    value_ceiling: f32,
    // Mode gradient: strength of a gradient of length 1.
    gradient_scale: f32,
    // Place in the table of integrals = (stored value - lo) · scale, in [0, last], along either side.
    preintegrated_lo: f32,
    preintegrated_scale: f32,
    preintegrated_last: f32,
    // What samples in bricks that are empty and not resident read: values that can't be seen, on either side of the
    // iso-value.
    empty_below: f32,
    empty_above: f32,
    // Levels that are sampled.
    used_levels: u32,
    // Counts dispatches: what a used slot is stamped with.
    dispatch: u32,
    // The numbers of the level of sample 0, of the first word of the stamps and of the request bits in `feedback`.
    finest_lod: u32,
    stamps_at: u32,
    bits_at: u32,
    // What the host writes into `feedback` for a dispatch (FEEDBACK_LIMIT and others; then the list of work-groups).
    orders_at: u32,
    // Step from a code of `brick_extremes` to the next, in stored values.
    extreme_scale: f32,
    // No sample is greater (mode minip: no negated sample).
    extreme_end: f32,
    // Panoramas: half the picture's width and height, radians.
    half_angles: vec2f,
    levels: array<LevelUniforms, MAX_LEVELS>,
}

// From a frame to the one before, for leaping. A quantity of a ray of this frame is q[0] + u·q[1] + v·q[2].
struct LeapUniforms {
    // The ray in the view of the frame before (x right, y up, z towards the viewer), mm; the direction not normalised.
    origin: array<vec4f, 3>,
    direction: array<vec4f, 3>,
    // Of that frame: half the image plane, and its near plane.
    half_extent: vec2f,
    near_mm: f32,
    // A line in the picture before is followed in at most so many pieces, a pixel long where they suffice.
    most_pieces: f32,
    // Added to all points: not 0 in tests only.
    forward_mm: f32,
    // Up to this distance from the eye, both frames are of one level.
    one_level_mm: f32,
    pad3: u32,
    pad4: u32,
}

// What the ray of a pixel did, as scene::RayCounts tells it.
struct PixelCounts {
    samples: u32,
    skipped: u32,
    contributing: u32,
    // With DEPTHS: distances from the eye of what it met first and of what ended it, mm; 0 where there is none.
    first_mm: f32,
    end_mm: f32,
}

// Where a ray stands between two dispatches.
struct RayState {
    // The next sample, in steps of the ray's level.
    next: i32,
    // RAY_* bits; the low ones are the level.
    flags: u32,
    // What the mode carries on: the extreme so far, the sample before, the sum of samples.
    value: f32,
    // What the mode counts: the base steps of a mean.
    count: u32,
    // Which of the ray's parts is walked.
    part: u32,
}

// The geometry of a picture, for the passes that cut rays to parts. A quantity of a ray is q[0] + u·q[1] + v·q[2].
struct GeometryUniforms {
    // Where rays begin, from the geometry's origin, mm.
    origin: array<vec4f, 3>,
    // Clip space from a position as the meshes have it, cropped to the tile; reversed depth. Panoramas: of each face of a cube
    // around the eye.
    clip_from_mesh: array<mat4x4f, 6>,
    // Number of the first triangle that is drawn.
    first_drawn: u32,
    // How many crossings and how many records there is room for.
    most_crossings: u32,
    most_records: u32,
    // Pixels along an edge of the cube.
    cube_edge: u32,
    // As in FrameUniforms, of this raster: it reaches behind the volume, to the last of the meshes.
    depth_scale: f32,
    depth_bias: f32,
    pad0: u32,
    pad1: u32,
}

// A mesh that cuts or is drawn.
struct MeshRecord {
    // Colour and opacity of one that is drawn.
    color: vec4f,
    // MESH_*.
    kind: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// Where a ray crosses a triangle: one of a pixel's list.
struct Crossing {
    // Number of the next, plus 1; 0 at the end.
    next: u32,
    triangle: u32,
    // Number of the mesh; CROSSING_ENTERS is set where the ray comes from the side that the triangle faces.
    mesh: u32,
    // As the raster tells it, mm along the view direction.
    depth_mm: f32,
}
