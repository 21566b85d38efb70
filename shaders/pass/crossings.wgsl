// Where rays cross the triangles of meshes: a raster that draws nothing, but puts every fragment on its pixel's list. The rule
// of the raster (a pixel on a common edge is of one triangle) makes the crossings of a closed mesh balance on every ray. Where
// a crossing lies is told by the triangle's plane (pass/parts.wgsl), about where by the depth.

override ORTHOGRAPHIC: bool = false;
// PANORAMA_*. The raster is that of the six faces of a cube, an instance for each.
override PANORAMA: u32 = 0u;

const MOST_COUNTED: u32 = 1u << 31u;

struct CrossingVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) triangle: u32,
    @location(1) @interpolate(flat, either) mesh: u32,
    @location(2) @interpolate(flat, either) face: u32,
}

// Three to a triangle: the position, and the number of its mesh.
@vertex
fn crossings_vertex(
    @builtin(vertex_index) index: u32,
    @builtin(instance_index) face: u32,
    @location(0) position: vec3f,
    @location(1) mesh: u32,
) -> CrossingVertex {
    return CrossingVertex(geometry.clip_from_mesh[face] * vec4f(position, 1.0), index / 3u, mesh, face);
}

@fragment
fn crossings_fragment(vertex: CrossingVertex, @builtin(front_facing) enters: bool) -> @location(0) vec4f {
    let pixel = vec2u(vertex.position.xy);
    var head = pixel.y * frame.tile_size.x + pixel.x;
    var is_inside = all(pixel < frame.part_size);
    if PANORAMA != PANORAMA_NONE {
        head = (vertex.face * geometry.cube_edge + pixel.y) * geometry.cube_edge + pixel.x;
        is_inside = true;
    }
    // Farther the number needn't go: so many there is room for nowhere. Beyond 2^32 it would begin anew.
    if is_inside && atomicLoad(&part_words[PARTS_CROSSINGS]) < MOST_COUNTED {
        let place = atomicAdd(&part_words[PARTS_CROSSINGS], 1u);
        if place < geometry.most_crossings {
            let next = atomicExchange(&crossing_heads[head], place + 1u);
            let mesh = vertex.mesh | select(0u, CROSSING_ENTERS, enters);
            var depth_mm = 1.0 / vertex.position.w;
            if ORTHOGRAPHIC {
                depth_mm = geometry.depth_bias - geometry.depth_scale * vertex.position.z;
            }
            crossings[place] = Crossing(next, vertex.triangle, mesh, depth_mm);
        }
    }
    return vec4f(0.0);
}
