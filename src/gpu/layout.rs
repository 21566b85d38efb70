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
    /// One frame, as `shaders/lib/types.wgsl` documents it field by field.
    #[expect(missing_docs, reason = "documented in shaders/lib/types.wgsl, whose names these are")]
    FrameUniforms as FRAME_UNIFORMS {
        world_dir: [[f32; 4]; 3],
        level_dir: [[f32; 4]; 3],
        level_origin: [[f32; 4]; 3],
        box_min: [f32; 4],
        box_max: [f32; 4],
        normal_from_gradient: [[f32; 4]; 3],
        to_light: [f32; 4],
        material: [f32; 4],
        iso_color: [f32; 4],
        clip_from_offset: [[f32; 4]; 4],
        anchor: [i32; 4],
        level_bricks: [u32; 4],
        indirection_origin: [u32; 4],
        atlas_slots: [u32; 4],
        texture_from_atlas: [f32; 4],
        picture_size: [u32; 2],
        tile_origin: [u32; 2],
        tile_size: [u32; 2],
        last_index: u32,
        flags: u32,
        step_mm: f32,
        first_mm: f32,
        near_mm: f32,
        opacity_cutoff: f32,
        depth_scale: f32,
        depth_bias: f32,
        slack: f32,
        iso: f32,
        lut_scale: f32,
        lut_lo: f32,
        lut_last: f32,
        value_scale: f32,
        value_floor: f32,
        group_stride: u32,
        pad1: f32,
        pad2: f32,
    }
}

/// All shared structs.
pub const SHARED_STRUCTS: &[SharedStruct] = &[FRAME_UNIFORMS];

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
    /// Switch of `FrameUniforms::flags`: mesh interval, brick and block skipping.
    FLAG_SKIP = 1;
    /// Place of the tag bits in an indirection word.
    TAG_SHIFT = 30;
    /// The other bits.
    PAYLOAD_MASK = (1 << 30) - 1;
    /// Tag: not resident.
    TAG_ABSENT = 0;
    /// Tag: the payload is a slot, 10 bits each of its x, y, z.
    TAG_SLOT = 1;
    /// Tag: the payload is a place in the buffer of constants.
    TAG_CONSTANT = 2;
    /// Activity of a brick: no block can be visible.
    BRICK_EMPTY = 0;
    /// Activity of a brick: its occupancy tells.
    BRICK_MIXED = 1;
    /// Activity of a brick: every block can be visible.
    BRICK_FULL = 2;
}
