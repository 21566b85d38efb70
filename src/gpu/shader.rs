//! Shaders as ordered lists of parts: `include_str!`ed WGSL files and one generated part, concatenated.
//!
//! WGSL's module scope has no order, so no dependency solver is needed, and every file stays plain WGSL. `DUMP_WGSL=DIR`
//! writes the assembled sources. Errors are reported by file and line of the part, not of the assembly.

use std::fmt::Write;

use super::{GpuContext, GpuError, layout};

/// One file of a shader.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Path from the crate's root.
    pub path: &'static str,
    /// Its text.
    pub text: &'static str,
}

impl Part {
    /// The embedded text; in debug builds the file below `SHADER_DIR`, if that is set, so that shaders can be tried
    /// without a build.
    fn current_text(&self) -> std::borrow::Cow<'static, str> {
        if cfg!(debug_assertions)
            && let Some(folder) = std::env::var_os("SHADER_DIR")
        {
            let path = std::path::Path::new(&folder).join(self.path);
            match std::fs::read_to_string(&path) {
                Ok(text) => return text.into(),
                Err(error) => tracing::warn!("SHADER_DIR: cannot read {}: {error}", path.display()),
            }
        }
        self.text.into()
    }
}

macro_rules! part {
    ($path:expr) => {
        Part {
            path: concat!("shaders/", $path),
            text: include_str!(concat!("../../shaders/", $path)),
        }
    };
}

/// A shader by its parts.
#[derive(Clone, Copy, Debug)]
pub struct ShaderSource {
    /// Name, for labels and dumps.
    pub name: &'static str,
    /// Its parts, in the order of assembly.
    pub parts: &'static [Part],
}

const TYPES: Part = part!("lib/types.wgsl");
const FRAME: Part = part!("bind/frame.wgsl");
const VOLUME: Part = part!("bind/volume.wgsl");
const RAY: Part = part!("lib/ray.wgsl");
const BRICK: Part = part!("lib/brick.wgsl");
const SAMPLE: Part = part!("lib/sample.wgsl");
const EXACT: Part = part!("lib/exact.wgsl");
const CLASSIFY: Part = part!("lib/classify.wgsl");
const SHADE: Part = part!("lib/shade.wgsl");
const INTERVAL: Part = part!("lib/interval.wgsl");
const WALK: Part = part!("lib/walk.wgsl");
const FEEDBACK: Part = part!("lib/feedback.wgsl");
const CAST: Part = part!("lib/cast.wgsl");
const PARTS: Part = part!("bind/parts.wgsl");
const PART: Part = part!("lib/part.wgsl");
const GEOMETRY: Part = part!("bind/geometry.wgsl");
const RAYCAST: Part = part!("pass/raycast.wgsl");
const DIRECT: Part = part!("lib/direct.wgsl");
const SLAB: Part = part!("lib/slab.wgsl");
const GRADIENT: Part = part!("lib/gradient.wgsl");
const BARE_EXACT: Part = part!("lib/bare_exact.wgsl");
const BARE: Part = part!("pass/bare.wgsl");

/// The depth raster of the bounding mesh.
pub const BOUNDS: ShaderSource = ShaderSource {
    name: "bounds",
    parts: &[TYPES, FRAME, part!("pass/bounds.wgsl")],
};

/// Where rays start, from the frame before.
pub const LEAP: ShaderSource = ShaderSource {
    name: "leap",
    parts: &[TYPES, FRAME, RAY, part!("pass/leap.wgsl")],
};

/// Which rays are not finished, after several passes.
pub const REPORT: ShaderSource = ShaderSource {
    name: "report",
    parts: &[TYPES, FRAME, CAST, part!("pass/report.wgsl")],
};

/// The rays that go on, between two passes of technique multipass.
pub const COMPACT: ShaderSource = ShaderSource {
    name: "compact",
    parts: &[TYPES, FRAME, CAST, part!("pass/compact.wgsl")],
};

/// The samples that are left, before the passes of technique layers.
pub const LAYERS: ShaderSource = ShaderSource {
    name: "layers",
    parts: &[TYPES, FRAME, CAST, RAY, INTERVAL, part!("pass/layers.wgsl")],
};

/// Where rays cross the triangles of meshes.
pub const CROSSINGS: ShaderSource = ShaderSource {
    name: "crossings",
    parts: &[TYPES, FRAME, GEOMETRY, part!("pass/crossings.wgsl")],
};

/// The parts that geometry leaves of rays.
pub const RAY_PARTS: ShaderSource = ShaderSource {
    name: "parts",
    parts: &[TYPES, FRAME, RAY, SHADE, GEOMETRY, part!("pass/parts.wgsl")],
};

/// Which part reads the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AtlasPart {
    /// Through the hardware's linear filter.
    Filtered,
    /// Interpolation by hand, of floats.
    Float,
    /// Interpolation by hand, of integers.
    Uint,
}

/// Which part tells what a sample does to its ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModePart {
    /// Every sample is classified and composited.
    Post,
    /// Every segment is, by a table of integrals.
    Preintegrated,
    /// Every sample is, by the strength of its gradient.
    Gradient,
    /// Surfaces of values.
    Surfaces,
    /// The greatest or the least value is classified.
    Extreme,
    /// The mean is.
    Mean,
}

/// The casters: one for each part that reads the atlas and each that tells the mode.
macro_rules! casters {
    ($(#[$meta:meta])* $name:ident, $word:literal, $pass:literal; $($mode:ident $file:literal [$($part:expr),*];)*) => {
        $(#[$meta])*
        pub const $name: &[(ModePart, AtlasPart, ShaderSource)] = &[$(
            (ModePart::$mode, AtlasPart::Filtered, ShaderSource {
                name: concat!($word, "_", $file, "_filtered"),
                parts: &[
                    TYPES, FRAME, VOLUME, part!("bind/atlas_filtered.wgsl"), RAY, BRICK, SAMPLE,
                    $($part,)* PARTS, PART, INTERVAL, WALK, FEEDBACK, CAST, part!(concat!("mode/", $file, ".wgsl")), RAYCAST,
                    part!(concat!("pass/", $pass, ".wgsl")),
                ],
            }),
            (ModePart::$mode, AtlasPart::Float, ShaderSource {
                name: concat!($word, "_", $file, "_float"),
                parts: &[
                    TYPES, FRAME, VOLUME, part!("bind/atlas_float.wgsl"), EXACT, RAY, BRICK, SAMPLE,
                    $($part,)* PARTS, PART, INTERVAL, WALK, FEEDBACK, CAST, part!(concat!("mode/", $file, ".wgsl")), RAYCAST,
                    part!(concat!("pass/", $pass, ".wgsl")),
                ],
            }),
            (ModePart::$mode, AtlasPart::Uint, ShaderSource {
                name: concat!($word, "_", $file, "_uint"),
                parts: &[
                    TYPES, FRAME, VOLUME, part!("bind/atlas_uint.wgsl"), EXACT, RAY, BRICK, SAMPLE,
                    $($part,)* PARTS, PART, INTERVAL, WALK, FEEDBACK, CAST, part!(concat!("mode/", $file, ".wgsl")), RAYCAST,
                    part!(concat!("pass/", $pass, ".wgsl")),
                ],
            }),
        )*];
    };
}

casters! {
    /// The caster of every technique in which each ray walks by itself.
    RAYCASTERS, "raycast", "cast_rays";
    Post "post" [DIRECT, CLASSIFY, GRADIENT, SHADE];
    Preintegrated "preintegrated" [DIRECT, GRADIENT, SHADE];
    Gradient "gradient" [DIRECT, CLASSIFY, GRADIENT, SHADE];
    Surfaces "surfaces" [DIRECT, GRADIENT, SHADE];
    Extreme "extreme" [DIRECT, CLASSIFY];
    Mean "mean" [DIRECT, CLASSIFY];
}

casters! {
    /// The caster in which a work-group's rays advance together, with their values in workgroup memory.
    SLABCASTERS, "slab", "cast_slabs";
    Post "post" [SLAB, CLASSIFY, SHADE];
    Preintegrated "preintegrated" [SLAB, SHADE];
    Gradient "gradient" [SLAB, CLASSIFY, SHADE];
    Surfaces "surfaces" [SLAB, SHADE];
    Extreme "extreme" [SLAB, CLASSIFY];
    Mean "mean" [SLAB, CLASSIFY];
}

/// The one of `casters` with these parts.
pub fn caster(
    casters: &[(ModePart, AtlasPart, ShaderSource)],
    mode: ModePart,
    atlas: AtlasPart,
) -> ShaderSource {
    casters
        .iter()
        .find(|c| (c.0, c.1) == (mode, atlas))
        .expect("invariant: every mode is listed for every atlas")
        .2
}

/// The bare caster on a dense, filterable texture.
pub const BARE_FILTERED: ShaderSource = ShaderSource {
    name: "bare_filtered",
    parts: &[
        TYPES,
        FRAME,
        VOLUME,
        part!("bind/atlas_filtered.wgsl"),
        RAY,
        BRICK,
        CLASSIFY,
        part!("lib/bare_filtered.wgsl"),
        BARE,
    ],
};

/// The bare caster with interpolation by hand, on float and normalised formats.
pub const BARE_FLOAT: ShaderSource = ShaderSource {
    name: "bare_float",
    parts: &[
        TYPES,
        FRAME,
        VOLUME,
        part!("bind/atlas_float.wgsl"),
        EXACT,
        RAY,
        BRICK,
        CLASSIFY,
        BARE_EXACT,
        BARE,
    ],
};

/// The bare caster with interpolation by hand, on `R16Uint`.
pub const BARE_UINT: ShaderSource = ShaderSource {
    name: "bare_uint",
    parts: &[
        TYPES,
        FRAME,
        VOLUME,
        part!("bind/atlas_uint.wgsl"),
        EXACT,
        RAY,
        BRICK,
        CLASSIFY,
        BARE_EXACT,
        BARE,
    ],
};

/// The shaders that are not casters.
pub const OTHERS: &[ShaderSource] = &[
    BOUNDS,
    LEAP,
    REPORT,
    COMPACT,
    LAYERS,
    CROSSINGS,
    RAY_PARTS,
    BARE_FILTERED,
    BARE_FLOAT,
    BARE_UINT,
];

/// Every shader, for the tests.
pub fn all() -> Vec<ShaderSource> {
    let casters = RAYCASTERS.iter().chain(SLABCASTERS).map(|c| c.2);
    OTHERS.iter().copied().chain(casters).collect()
}

/// An assembled shader and where its lines come from.
#[derive(Debug)]
pub struct Assembled {
    /// The text for the compiler.
    pub text: String,
    /// First line (1-based) of each part in `text`.
    first_lines: Vec<(u32, &'static str)>,
}

impl ShaderSource {
    /// Joins the generated constants and the parts.
    pub fn assemble(&self) -> Assembled {
        let mut text = layout::constants_wgsl();
        let mut first_lines = vec![(1, "generated constants")];
        for part in self.parts {
            first_lines.push((text.lines().count() as u32 + 1, part.path));
            text.push_str(&part.current_text());
            if !text.ends_with('\n') {
                text.push('\n');
            }
        }
        Assembled { text, first_lines }
    }

    /// Compiles the shader on the device.
    ///
    /// # Errors
    /// The device refuses it; the message names file and line.
    pub fn compile(&self, gpu: &GpuContext) -> Result<wgpu::ShaderModule, GpuError> {
        let assembled = self.assemble();
        if let Some(folder) = std::env::var_os("DUMP_WGSL") {
            let path = std::path::Path::new(&folder).join(format!("{}.wgsl", self.name));
            if let Err(error) = std::fs::write(&path, &assembled.text) {
                tracing::warn!("DUMP_WGSL: cannot write {}: {error}", path.display());
            }
        }
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(self.name),
                source: wgpu::ShaderSource::Wgsl(assembled.text.as_str().into()),
            });
        if let Some(error) = pollster::block_on(scope.pop()) {
            let mut reason = error.to_string();
            let info = pollster::block_on(module.get_compilation_info());
            for message in info.messages {
                if let Some(at) = message.location {
                    let _ = write!(reason, "\n{}", assembled.place(at.line_number));
                }
            }
            return Err(GpuError::Device {
                doing: "compiling a shader",
                reason,
            });
        }
        Ok(module)
    }
}

impl Assembled {
    /// `shaders/lib/brick.wgsl:17` for a line of the assembly.
    pub fn place(&self, line: u32) -> String {
        let (first, path) = self
            .first_lines
            .iter()
            .rev()
            .find(|(first, _)| *first <= line)
            .unwrap_or(&(1, "?"));
        format!("{path}:{}", line - first + 1)
    }
}
