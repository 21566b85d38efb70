//! Every struct and constant shared with the shaders: the Rust half. The WGSL half of the structs is
//! `shaders/lib/types.wgsl`, compared by `tests/shaders.rs`; the constants are generated ([`constants_wgsl`]).

use crate::geom::{BLOCK_EDGE, BLOCKS_PER_EDGE, BRICK_BORDER, BRICK_EDGE, STORED_EDGE};

/// A struct's layout on the host, for the test that compares it with the shader's.
#[derive(Debug)]
pub struct SharedStruct {
    /// Its name, in Rust and in WGSL.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// Name and byte offset of each field.
    pub fields: &'static [(&'static str, usize)],
}

/// Declares a `#[repr(C)]` struct and the table that the layout test reads.
macro_rules! shared {
    ($(#[$meta:meta])* $name:ident as $table:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        /// The layout of the struct of that name.
        pub const $table: SharedStruct = SharedStruct {
            name: stringify!($name),
            size: size_of::<$name>(),
            fields: &[$((stringify!($field), std::mem::offset_of!($name, $field)),)*],
        };
    };
}

shared! {
    /// One level of a frame, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    LevelUniforms as LEVEL_UNIFORMS {
        level_dir: [[f32; 4]; 3],
        level_origin: [[f32; 4]; 3],
        box_min: [f32; 4],
        box_max: [f32; 4],
        normal_from_gradient: [[f32; 4]; 3],
        anchor: [i32; 4],
        bricks: [u32; 4],
        indirection_origin: [u32; 4],
        begin: i32,
        last: i32,
        step_mm: f32,
        leap_back_mm: f32,
    }
}

shared! {
    /// One frame, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    FrameUniforms as FRAME_UNIFORMS {
        world_dir: [[f32; 4]; 3],
        to_light: [f32; 4],
        material: [f32; 4],
        surface_colors: [[f32; 4]; MAX_SURFACES as usize],
        surface_values: [[f32; 4]; MAX_SURFACES_4 as usize],
        clip_from_offset: [[f32; 4]; 4],
        mesh_anchor: [i32; 4],
        atlas_slots: [u32; 4],
        texture_from_atlas: [f32; 4],
        picture_size: [u32; 2],
        tile_origin: [u32; 2],
        tile_size: [u32; 2],
        part_size: [u32; 2],
        place_in_pixel: [f32; 2],
        last_index: u32,
        first_mm: f32,
        step_mm: f32,
        near_mm: f32,
        opacity_cutoff: f32,
        depth_scale: f32,
        depth_bias: f32,
        slack_mm: f32,
        lut_scale: f32,
        lut_lo: f32,
        lut_last: f32,
        value_scale: f32,
        value_floor: f32,
        value_ceiling: f32,
        gradient_scale: f32,
        preintegrated_lo: f32,
        preintegrated_scale: f32,
        preintegrated_last: f32,
        empty_below: f32,
        empty_above: f32,
        used_levels: u32,
        dispatch: u32,
        finest_lod: u32,
        stamps_at: u32,
        bits_at: u32,
        orders_at: u32,
        extreme_scale: f32,
        extreme_end: f32,
        half_angles: [f32; 2],
        levels: [LevelUniforms; MAX_LEVELS as usize],
    }
}

shared! {
    /// From a frame to the one before, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    LeapUniforms as LEAP_UNIFORMS {
        origin: [[f32; 4]; 3],
        direction: [[f32; 4]; 3],
        half_extent: [f32; 2],
        near_mm: f32,
        most_pieces: f32,
        forward_mm: f32,
        one_level_mm: f32,
        pad3: u32,
        pad4: u32,
    }
}

shared! {
    /// What the ray of a pixel did, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    PixelCounts as PIXEL_COUNTS {
        samples: u32,
        skipped: u32,
        contributing: u32,
        first_mm: f32,
        end_mm: f32,
    }
}

shared! {
    /// Where a ray stands between two dispatches, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    RayState as RAY_STATE {
        next: i32,
        flags: u32,
        value: f32,
        count: u32,
        part: u32,
    }
}

shared! {
    /// The geometry of a picture, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    GeometryUniforms as GEOMETRY_UNIFORMS {
        origin: [[f32; 4]; 3],
        clip_from_mesh: [[[f32; 4]; 4]; 6],
        first_drawn: u32,
        most_crossings: u32,
        most_records: u32,
        cube_edge: u32,
        depth_scale: f32,
        depth_bias: f32,
        pad0: u32,
        pad1: u32,
    }
}

shared! {
    /// A mesh that cuts or is drawn, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    MeshRecord as MESH_RECORD {
        color: [f32; 4],
        kind: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

shared! {
    /// Where a ray crosses a triangle, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    Crossing as CROSSING {
        next: u32,
        triangle: u32,
        mesh: u32,
        depth_mm: f32,
    }
}

/// All shared structs.
pub const SHARED_STRUCTS: &[SharedStruct] = &[
    LEVEL_UNIFORMS,
    FRAME_UNIFORMS,
    LEAP_UNIFORMS,
    PIXEL_COUNTS,
    RAY_STATE,
    GEOMETRY_UNIFORMS,
    MESH_RECORD,
    CROSSING,
];

macro_rules! constants {
    ($($(#[$meta:meta])* $name:ident = $value:expr;)*) => {
        $($(#[$meta])* pub const $name: u32 = $value;)*

        /// The constants as WGSL: the first part of every shader.
        pub fn constants_wgsl() -> String {
            let mut text = String::from("// Generated from src/gpu/layout.rs.\n");
            for (name, value) in [
                ("BRICK_EDGE", BRICK_EDGE), ("BRICK_SHIFT", BRICK_EDGE.trailing_zeros()),
                ("BRICK_BORDER", BRICK_BORDER), ("STORED_EDGE", STORED_EDGE),
                ("BLOCK_EDGE", BLOCK_EDGE), ("BLOCK_SHIFT", BLOCK_EDGE.trailing_zeros()),
                ("BLOCKS_PER_EDGE", BLOCKS_PER_EDGE), ("BLOCKS_SHIFT", BLOCKS_PER_EDGE.trailing_zeros()),
                $((stringify!($name), $name),)*
            ] {
                text.push_str(&format!("const {name}: u32 = {value}u;\n"));
            }
            text
        }
    };
}

constants! {
    /// Most levels of a volume: 2²⁴ voxels along an axis.
    MAX_LEVELS = 20;
    /// Most surfaces of a picture.
    MAX_SURFACES = 8;
    /// Vectors of four that hold a number for each.
    MAX_SURFACES_4 = 2;
    /// Place of the tag bits in an indirection word.
    TAG_SHIFT = 30;
    /// The other bits.
    PAYLOAD_MASK = (1 << 30) - 1;
    /// Tag: not resident.
    TAG_ABSENT = 0;
    /// Tag: the payload is a slot: 9 bits each of its x, y, z, 2 bits of its texture.
    TAG_SLOT = 1;
    /// Tag: the payload is a place in the buffer of constants.
    TAG_CONSTANT = 2;
    /// Activity of a brick: nothing in it can be visible, all values are below the iso-value.
    BRICK_EMPTY = 0;
    /// Activity of a brick: its occupancy tells.
    BRICK_MIXED = 1;
    /// Activity of a brick: every block can be visible, or it is not known which.
    BRICK_FULL = 2;
    /// Activity of a brick: nothing in it can be visible, all values are above the iso-value.
    BRICK_EMPTY_ABOVE = 3;
    /// Bits of `RayState::flags` that hold the ray's level.
    RAY_LEVEL_MASK = 255;
    /// Bit of `RayState::flags`: nothing more to do.
    RAY_FINISHED = 1 << 31;
    /// The ray ended before the volume did; the rest is not skipped, but behind something.
    RAY_ENDED = 1 << 8;
    /// Place of the bits that hold on the upper sides of how many surfaces the last sample lies.
    RAY_ZONE_SHIFT = 12;
    /// Those bits, moved down.
    RAY_ZONE_MASK = 15;
    /// There was a sample right before `next`.
    RAY_HAS_BEFORE = 1 << 10;
    /// The ray meets the volume.
    RAY_INSIDE = 1 << 11;
    /// The cut face at which the ray's part begins was looked at.
    RAY_CAPPED = 1 << 9;
    /// The ray waits for a brick until the host's next submission.
    RAY_STOPPED = 1 << 30;
    /// Word of the feedback: 2³² − 1 − number of the first stopped pixel of the tile; 0 when none stopped.
    FEEDBACK_FIRST_STOPPED = 0;
    /// Word of the feedback: rays that stopped.
    FEEDBACK_STOPPED = 1;
    /// Word of the feedback: bricks that were asked for, also those that no longer fit the list.
    FEEDBACK_LISTED = 2;
    /// Word of the feedback: pixels that technique multipass has listed so far; 0 between its passes.
    FEEDBACK_LIVE = 3;
    /// Words of the feedback: unfinished rays of each work-group of a tile.
    FEEDBACK_PENDING = 16;
    /// Bits of a brick's hash under which the rays that miss it are counted.
    FEEDBACK_RAYS_BITS = 12;
    /// Words of the feedback: rays by hash.
    FEEDBACK_RAYS = FEEDBACK_PENDING + MAX_GROUPS;
    /// Words of the feedback: the list of bricks.
    FEEDBACK_LIST = FEEDBACK_RAYS + (1 << FEEDBACK_RAYS_BITS);
    /// Bricks that fit the list.
    FEEDBACK_LIST_MAX = 1 << 14;
    /// Word of the host's orders: a ray that took this many samples in the dispatch goes on in the next one.
    FEEDBACK_LIMIT = 0;
    /// Word of the host's orders: levels that are sampled, and the coarser ones that can stand in.
    FEEDBACK_LEVELS = 1;
    /// Word of the host's orders: what is skipped, 0 or one of SKIP_*.
    FEEDBACK_SKIP = 2;
    /// What is skipped: all outside the mesh interval, and bricks and blocks in it.
    SKIP_BLOCKS = 1;
    /// What is skipped: all outside the mesh interval.
    SKIP_OUTSIDE = 2;
    /// What is skipped: bricks and blocks; there is no mesh.
    SKIP_WITHOUT_MESH = 3;
    /// Rays are those of one raster.
    PANORAMA_NONE = 0;
    /// An angle from the picture's middle is a distance.
    PANORAMA_FISHEYE = 1;
    /// Columns are longitudes, rows latitudes.
    PANORAMA_SPHERE = 2;
    /// Word of the host's orders: 1 where work-groups are parts of the list of pixels, 0 where they are of the tile.
    FEEDBACK_PIXELS = 3;
    /// Word of the host's orders: 1 where the caster's work-groups are of the list of pixels that a pass before has made.
    FEEDBACK_COMPACTED = 4;
    /// Word of the host's orders: 1 where the caster doesn't tell which rays are not finished: a pass behind it does.
    FEEDBACK_QUIET = 5;
    /// Words of the host's orders: the list of work-groups.
    FEEDBACK_GROUPS = 6;
    /// Words of the feedback up to here are of one dispatch.
    FEEDBACK_HEAD = FEEDBACK_LIST + FEEDBACK_LIST_MAX;
    /// Edge of the cells whose samples technique layers counts, pixels: two work-groups.
    CELL_EDGE = 16;
    /// Most meshes that cut: as many windings are counted.
    MOST_CLIP_MESHES = 16;
    /// A mesh of which the inside is kept.
    MESH_INSIDE = 0;
    /// A mesh of which the outside is kept.
    MESH_OUTSIDE = 1;
    /// A mesh that is drawn.
    MESH_DRAWN = 2;
    /// Bit of `Crossing::mesh`: the ray comes from the side that the triangle faces.
    CROSSING_ENTERS = 1 << 31;
    /// Word of the passes that cut rays to parts: crossings so far.
    PARTS_CROSSINGS = 0;
    /// Word of these passes: records so far.
    PARTS_RECORDS = 1;
    /// Word of these passes, ordered by the host: half spaces.
    PARTS_PLANES = 2;
    /// Word of these passes, ordered by the host: meshes that cut.
    PARTS_CLIP_MESHES = 3;
    /// Word of these passes, ordered by the host: triangles of all meshes.
    PARTS_TRIANGLES = 4;
    /// How many words these are.
    PARTS_WORDS = 5;
    /// Records of parts in a row of their texture.
    PART_RECORDS_WIDE = 2048;
    /// Most work-groups of a tile.
    MAX_GROUPS = 1 << 14;
}
