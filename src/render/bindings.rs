//! What each shader binds, as data. Bind group layouts are built from these tables, and `tests/shaders.rs` compares them
//! with the declarations in WGSL.

use wgpu::{
    BindGroupLayoutEntry, BindingType, BufferBindingType, SamplerBindingType, ShaderStages,
    StorageTextureAccess, TextureFormat, TextureSampleType, TextureViewDimension,
};

use crate::gpu::shader::{self, AtlasPart, ShaderSource};

/// The entries of one bind group's layout.
pub type Entries = &'static [BindGroupLayoutEntry];

const fn entry(binding: u32, visibility: ShaderStages, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry {
        binding,
        visibility,
        ty,
        count: None,
    }
}

const fn compute(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    entry(binding, ShaderStages::COMPUTE, ty)
}

const fn buffer(ty: BufferBindingType) -> BindingType {
    BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

const fn texture(
    sample_type: TextureSampleType,
    view_dimension: TextureViewDimension,
) -> BindingType {
    BindingType::Texture {
        sample_type,
        view_dimension,
        multisampled: false,
    }
}

const fn volume(sample_type: TextureSampleType) -> BindingType {
    texture(sample_type, TextureViewDimension::D3)
}

const fn slices(sample_type: TextureSampleType) -> BindingType {
    texture(sample_type, TextureViewDimension::D2Array)
}

const READ: BindingType = buffer(BufferBindingType::Storage { read_only: true });
const WRITE: BindingType = buffer(BufferBindingType::Storage { read_only: false });
const DEPTH: BindingType = texture(TextureSampleType::Depth, TextureViewDimension::D2);

const DISTANCES: BindingType = texture(
    TextureSampleType::Float { filterable: false },
    TextureViewDimension::D2,
);
const WRITE_DISTANCES: BindingType = BindingType::StorageTexture {
    access: StorageTextureAccess::WriteOnly,
    format: TextureFormat::R32Float,
    view_dimension: TextureViewDimension::D2,
};

const PAGE_TABLE: BindGroupLayoutEntry = compute(2, volume(TextureSampleType::Uint));
const CONSTANTS: BindGroupLayoutEntry = compute(3, READ);
const ACTIVITY: BindGroupLayoutEntry = compute(4, READ);
const OCCUPANCY: BindGroupLayoutEntry = compute(5, READ);
const EXTREMES: BindGroupLayoutEntry = compute(9, READ);

/// Entries of group 1: the first atlas texture, its sampler, the tables, the other atlas textures.
macro_rules! volume_entries {
    ($texture:expr, $sampler:expr) => {
        &[
            compute(0, $texture),
            compute(1, BindingType::Sampler($sampler)),
            PAGE_TABLE,
            CONSTANTS,
            ACTIVITY,
            OCCUPANCY,
            compute(6, $texture),
            compute(7, $texture),
            compute(8, $texture),
            EXTREMES,
        ]
    };
}

/// Group 0: `bind/frame.wgsl`.
pub const FRAME: Entries = &[
    entry(
        0,
        ShaderStages::VERTEX_FRAGMENT.union(ShaderStages::COMPUTE),
        buffer(BufferBindingType::Uniform),
    ),
    compute(
        1,
        texture(
            TextureSampleType::Float { filterable: false },
            TextureViewDimension::D2,
        ),
    ),
    compute(
        2,
        texture(
            TextureSampleType::Float { filterable: false },
            TextureViewDimension::D2Array,
        ),
    ),
];

/// Group 1: `bind/volume.wgsl` with `bind/atlas_filtered.wgsl`.
pub const VOLUME_FILTERED: Entries = volume_entries!(
    volume(TextureSampleType::Float { filterable: true }),
    SamplerBindingType::Filtering
);

/// Group 1: `bind/volume.wgsl` with `bind/atlas_float.wgsl`.
pub const VOLUME_FLOAT: Entries = volume_entries!(
    slices(TextureSampleType::Float { filterable: false }),
    SamplerBindingType::NonFiltering
);

/// Group 1: `bind/volume.wgsl` with `bind/atlas_uint.wgsl`.
pub const VOLUME_UINT: Entries = volume_entries!(
    slices(TextureSampleType::Uint),
    SamplerBindingType::NonFiltering
);

/// Group 2 of the caster: `pass/raycast.wgsl`.
pub const RAYCAST: Entries = &[
    compute(0, DEPTH),
    compute(1, DEPTH),
    compute(2, DEPTH),
    compute(3, WRITE),
    compute(4, WRITE),
    compute(5, WRITE),
    compute(6, WRITE),
    compute(7, BindingType::Sampler(SamplerBindingType::NonFiltering)),
    compute(
        8,
        texture(TextureSampleType::Uint, TextureViewDimension::D2),
    ),
    compute(9, DISTANCES),
    compute(10, WRITE_DISTANCES),
];

/// Group 3 of the caster: `bind/parts.wgsl`.
pub const PARTS: Entries = &[
    compute(
        0,
        texture(TextureSampleType::Uint, TextureViewDimension::D2),
    ),
    compute(
        1,
        texture(TextureSampleType::Uint, TextureViewDimension::D2),
    ),
];

/// Group 1 of the passes that cut rays to parts: `bind/geometry.wgsl`.
pub const GEOMETRY: Entries = &[
    entry(
        0,
        ShaderStages::VERTEX_FRAGMENT.union(ShaderStages::COMPUTE),
        buffer(BufferBindingType::Uniform),
    ),
    compute(1, READ),
    compute(2, READ),
    compute(3, READ),
    compute(4, READ),
    entry(
        5,
        ShaderStages::FRAGMENT.union(ShaderStages::COMPUTE),
        WRITE,
    ),
    entry(
        6,
        ShaderStages::FRAGMENT.union(ShaderStages::COMPUTE),
        WRITE,
    ),
    entry(
        7,
        ShaderStages::FRAGMENT.union(ShaderStages::COMPUTE),
        WRITE,
    ),
];

const fn write_words(format: TextureFormat) -> BindingType {
    BindingType::StorageTexture {
        access: StorageTextureAccess::WriteOnly,
        format,
        view_dimension: TextureViewDimension::D2,
    }
}

/// Group 2 of `pass/parts.wgsl`: the lists that are written.
pub const PART_LISTS: Entries = &[
    compute(0, write_words(TextureFormat::Rg32Uint)),
    compute(1, write_words(TextureFormat::Rgba32Uint)),
];

/// Group 1 of `pass/leap.wgsl`.
pub const LEAP: Entries = &[
    compute(0, buffer(BufferBindingType::Uniform)),
    compute(1, DISTANCES),
    compute(2, BindingType::Sampler(SamplerBindingType::NonFiltering)),
    compute(3, WRITE_DISTANCES),
];

/// Group 1 of the passes that look at rays and sample nothing: `pass/{report,compact,layers}.wgsl`.
pub const RAYS: Entries = &[
    compute(0, WRITE),
    compute(1, WRITE),
    compute(
        2,
        texture(TextureSampleType::Uint, TextureViewDimension::D2),
    ),
];

/// Group 2 of `pass/compact.wgsl`: the list that is written.
pub const LIVE_LIST: Entries = &[compute(0, write_words(TextureFormat::R32Uint))];

/// Group 3 of `pass/compact.wgsl`: what indirect dispatches read.
pub const LIVE_GROUPS: Entries = &[compute(0, WRITE)];

/// Group 2 of `pass/layers.wgsl`.
pub const LAYERS: Entries = &[
    compute(0, DEPTH),
    compute(1, DEPTH),
    compute(2, DEPTH),
    compute(3, BindingType::Sampler(SamplerBindingType::NonFiltering)),
    compute(4, WRITE),
];

/// Group 2 of the bare caster: `pass/bare.wgsl`.
pub const BARE: Entries = &[compute(0, WRITE), compute(1, WRITE)];

/// Group 1 with the part that reads the atlas.
pub const fn volume_of(atlas: AtlasPart) -> Entries {
    match atlas {
        AtlasPart::Filtered => VOLUME_FILTERED,
        AtlasPart::Float => VOLUME_FLOAT,
        AtlasPart::Uint => VOLUME_UINT,
    }
}

/// Every shader with its groups, in order.
pub fn shaders() -> Vec<(ShaderSource, Vec<Entries>)> {
    let casters = shader::RAYCASTERS.iter().chain(shader::SLABCASTERS);
    let casters = casters.map(|&(_, atlas, s)| (s, vec![FRAME, volume_of(atlas), RAYCAST, PARTS]));
    let bare = |source, atlas| (source, vec![FRAME, volume_of(atlas), BARE]);
    [
        (shader::BOUNDS, vec![FRAME]),
        (shader::LEAP, vec![FRAME, LEAP]),
        (shader::REPORT, vec![FRAME, RAYS]),
        (shader::COMPACT, vec![FRAME, RAYS, LIVE_LIST, LIVE_GROUPS]),
        (shader::LAYERS, vec![FRAME, RAYS, LAYERS]),
        (shader::CROSSINGS, vec![FRAME, GEOMETRY]),
        (shader::RAY_PARTS, vec![FRAME, GEOMETRY, PART_LISTS]),
        bare(shader::BARE_FILTERED, AtlasPart::Filtered),
        bare(shader::BARE_FLOAT, AtlasPart::Float),
        bare(shader::BARE_UINT, AtlasPart::Uint),
    ]
    .into_iter()
    .chain(casters)
    .collect()
}
