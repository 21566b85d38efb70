// The bounding mesh, rasterised to depth only: nearest front, nearest back and farthest back faces in three passes
// (design.md §6). There is no fragment shader: the depth is the result. Reversed depth, near plane at 1.

// A corner of a 4³ block, in blocks of the mesh's level; w unused.
@vertex
fn bounds_vertex(@location(0) corner: vec4u) -> @builtin(position) vec4f {
    let offset = vec3f(vec3i(corner.xyz) * i32(BLOCK_EDGE) - frame.mesh_anchor.xyz);
    return frame.clip_from_offset * vec4f(offset, 1.0);
}
