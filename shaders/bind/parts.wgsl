// Group 3 of the casters: the parts of rays, where the picture has geometry. Owned by render::passes::parts.

// Per pixel of the tile: number of its first record, and how many it has.
@group(3) @binding(0) var part_lists: texture_2d<u32>;
// lib/part.wgsl tells what is in a record.
@group(3) @binding(1) var part_records: texture_2d<u32>;
