// Group 1: the resident volume. Owned by render::residency.

// Bindings 0, 1 and 6 to 8, the atlas textures and their sampler, are in one of atlas_{filtered,float,uint}.wgsl.

// A word per brick of every level, levels side by side: 2 tag bits and 30 bits of slot or constant.
@group(1) @binding(2) var indirection: texture_3d<u32>;
// Values of constant bricks, in stored units.
@group(1) @binding(3) var<storage, read> constants: array<f32>;
// Two bits per brick of every level, one of BRICK_*.
@group(1) @binding(4) var<storage, read> brick_activity: array<u32>;
// Sixteen bits per brick of every level: its greatest value as a code, and above it its least, both rounded outward; used by
// modes mip and minip only.
@group(1) @binding(9) var<storage, read> brick_extremes: array<u32>;
// 16 words per atlas slot: a bit per 4³ block, or with EXTREME a byte per 8³ voxels, a code as in `brick_extremes`.
@group(1) @binding(5) var<storage, read> occupancy: array<u32>;
