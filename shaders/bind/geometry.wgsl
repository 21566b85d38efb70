// Group 1 of the passes that cut rays to parts: the geometry of a picture. Owned by render::passes::parts.

@group(1) @binding(0) var<uniform> geometry: GeometryUniforms;
// Half spaces: normal, world, and offset from the geometry's origin, mm.
@group(1) @binding(1) var<storage, read> half_spaces: array<vec4f>;
@group(1) @binding(2) var<storage, read> meshes: array<MeshRecord>;
// Planes of the triangles of all meshes: unit normal, and offset from the geometry's origin, mm.
@group(1) @binding(3) var<storage, read> triangle_planes: array<vec4f>;
// Of each triangle that is drawn: three corners, from the geometry's origin, mm, and the normals there.
@group(1) @binding(4) var<storage, read> triangle_corners: array<vec4f>;
// Per pixel of the tile, or of the faces of the cube: number of the first crossing of its list, plus 1; 0 where there is none.
@group(1) @binding(5) var<storage, read_write> crossing_heads: array<atomic<u32>>;
@group(1) @binding(6) var<storage, read_write> crossings: array<Crossing>;
// PARTS_*: crossings and records so far, also those for which there was no room; and what the host orders. That is not in the
// uniforms, for the reason that lib/cast.wgsl gives.
@group(1) @binding(7) var<storage, read_write> part_words: array<atomic<u32>, PARTS_WORDS>;
