//! The shaders, checked without a device: every one is valid with no more than the capabilities that are requested, every
//! file is used, and what host and shader share (structs, bindings) is the same on both sides.
#![cfg(feature = "gpu")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use brickscope::gpu::layout::{self, FRAME_UNIFORMS, SHARED_STRUCTS, SharedStruct};
use brickscope::gpu::shader::{self, AtlasPart, ModePart, ShaderSource};
use brickscope::render::bindings::{self, Entries};
use wgpu::naga::front::wgsl;
use wgpu::naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use wgpu::naga::{
    AddressSpace, ImageClass, ImageDimension, Module, ScalarKind, StorageAccess, StorageFormat,
    TypeInner,
};
use wgpu::{
    BindGroupLayoutEntry, BindingType, BufferBindingType, StorageTextureAccess, TextureFormat,
    TextureSampleType, TextureViewDimension,
};

/// What the features that `gpu::context` asks for give a shader: nothing beyond WGSL itself, since 16-bit normalised
/// textures are only sampled, and filterable floats and timestamps are no matter of the shader. A shader that needs more
/// would not compile on every adapter.
const REQUESTED: Capabilities = Capabilities::empty();

const TYPES: &str = "shaders/lib/types.wgsl";

fn validate(module: &Module) -> Result<ModuleInfo, String> {
    Validator::new(ValidationFlags::all(), REQUESTED)
        .validate(module)
        .map_err(|e| format!("{:?}", e.into_inner()))
}

/// Parses and validates the assembly of `source`; an error names file and line of the part.
fn check(source: &ShaderSource) -> Result<Module, String> {
    let assembled = source.assemble();
    let module = wgsl::parse_str(&assembled.text).map_err(|e| {
        let place = e
            .location(&assembled.text)
            .map_or_else(String::new, |l| assembled.place(l.line_number));
        format!(
            "{}: {place}: {}",
            source.name,
            e.emit_to_string(&assembled.text)
        )
    })?;
    validate(&module).map_err(|e| format!("{}: {e}", source.name))?;
    Ok(module)
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Paths from the root of all `.wgsl` files below `folder`.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a readable folder") {
        let path = entry.expect("a readable folder").path();
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.extension().is_some_and(|e| e == "wgsl") {
            found.push(path);
        }
    }
    found
}

#[test]
fn every_shader_is_valid() {
    let failures: Vec<String> = shader::all()
        .iter()
        .filter_map(|s| check(s).err())
        .collect();
    assert!(
        failures.is_empty(),
        "{} of {} shaders:\n{}",
        failures.len(),
        shader::all().len(),
        failures.join("\n")
    );
}

#[test]
fn every_shader_and_every_file_is_used() {
    let text = fs::read_to_string(root().join("src/gpu/shader.rs")).expect("the list of shaders");
    let declared = text.matches(": ShaderSource =").count();
    assert_eq!(
        shader::OTHERS.len(),
        declared,
        "shader::OTHERS has every shader that is declared by itself"
    );
    let used: BTreeSet<PathBuf> = shader::all()
        .iter()
        .flat_map(|s| s.parts)
        .map(|p| p.path.into())
        .collect();
    let on_disk: BTreeSet<PathBuf> = files(&root().join("shaders"))
        .iter()
        .map(|p| p.strip_prefix(root()).expect("below the root").to_owned())
        .collect();
    assert_eq!(
        used, on_disk,
        "files of shaders/ (right) and parts of shaders (left)"
    );
}

#[test]
fn a_shader_without_one_of_its_parts_is_reported() {
    for source in &shader::all() {
        for missing in 0..source.parts.len() {
            let mut parts = source.parts.to_vec();
            let part = parts.remove(missing);
            let is_entry = part.path.starts_with("shaders/pass/");
            let cut = ShaderSource {
                name: source.name,
                parts: parts.leak(),
            };
            // Without its pass a shader is valid, but there is nothing to run.
            let is_reported = match check(&cut) {
                Err(_) => true,
                Ok(module) => is_entry && module.entry_points.is_empty(),
            };
            assert!(is_reported, "{} without {} passes", source.name, part.path);
        }
    }
}

/// How the structs of `text` differ from those of the host.
fn layout_differences(text: &str, host: &[SharedStruct]) -> Vec<String> {
    let text = format!("{}{text}", layout::constants_wgsl());
    let module = wgsl::parse_str(&text).expect("WGSL");
    let mut found = Vec::new();
    let mut in_shader = BTreeSet::new();
    for (_, ty) in module.types.iter() {
        let (Some(name), TypeInner::Struct { members, span }) = (&ty.name, &ty.inner) else {
            continue;
        };
        in_shader.insert(name.as_str());
        let Some(shared) = host.iter().find(|s| s.name == name) else {
            found.push(format!("{name} is in WGSL only"));
            continue;
        };
        if shared.size != *span as usize {
            found.push(format!(
                "{name}: {} bytes on the host, {span} in WGSL",
                shared.size
            ));
        }
        let wgsl: Vec<(&str, usize)> = members
            .iter()
            .map(|m| (m.name.as_deref().unwrap_or("?"), m.offset as usize))
            .collect();
        for (i, field) in wgsl.iter().enumerate() {
            if shared.fields.get(i) != Some(field) {
                found.push(format!(
                    "{name}: field {i} is {:?} on the host, {field:?} in WGSL",
                    shared.fields.get(i)
                ));
            }
        }
        if shared.fields.len() != wgsl.len() {
            found.push(format!(
                "{name}: {} fields on the host, {} in WGSL",
                shared.fields.len(),
                wgsl.len()
            ));
        }
    }
    found.extend(
        host.iter()
            .filter(|s| !in_shader.contains(s.name))
            .map(|s| format!("{} is on the host only", s.name)),
    );
    found
}

fn types_text() -> &'static str {
    let part = shader::all()
        .iter()
        .flat_map(|s| s.parts)
        .find(|p| p.path == TYPES);
    part.expect("some shader has the shared types").text
}

#[test]
fn shared_structs_have_the_same_layout_on_both_sides() {
    let found = layout_differences(types_text(), SHARED_STRUCTS);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_moved_renamed_or_foreign_field_is_reported() {
    let text = types_text();
    let changed = |from: &str, to: &str| {
        assert!(
            text.contains(from),
            "the control changes {from:?}, which is gone"
        );
        layout_differences(&text.replacen(from, to, 1), SHARED_STRUCTS).join("\n")
    };
    let shifted = changed("    step_mm: f32,", "    extra: f32,\n    step_mm: f32,");
    assert!(
        shifted.contains("\"extra\"") && shifted.contains("\"step_mm\""),
        "shifted: {shifted}"
    );
    let renamed = changed("    slack_mm: f32,", "    slackness: f32,");
    assert!(renamed.contains("\"slackness\""), "renamed: {renamed}");
    let padded = changed("    pad4: u32,", "    pad4: u32,\n    pad5: vec4f,");
    assert!(
        padded.contains("bytes on the host") && padded.contains("\"pad5\""),
        "longer: {padded}"
    );
    let foreign = layout_differences(
        &format!("{text}\nstruct Stray {{ a: u32 }}"),
        SHARED_STRUCTS,
    )
    .join("\n");
    assert!(
        foreign.contains("Stray is in WGSL only"),
        "foreign: {foreign}"
    );
    let missing = layout_differences("struct Other { a: u32 }", &[FRAME_UNIFORMS]).join("\n");
    assert!(
        missing.contains("FrameUniforms is on the host only"),
        "missing: {missing}"
    );
}

/// What a variable of `module` needs of the layout: a check of the entry's type, and words for it.
fn matches_variable(
    module: &Module,
    variable: &wgpu::naga::GlobalVariable,
    entry: &BindGroupLayoutEntry,
) -> bool {
    let is_buffer = |wanted: BufferBindingType| matches!(entry.ty, BindingType::Buffer { ty, has_dynamic_offset: false, .. } if ty == wanted);
    match variable.space {
        AddressSpace::Uniform => is_buffer(BufferBindingType::Uniform),
        AddressSpace::Storage { access } => is_buffer(BufferBindingType::Storage {
            read_only: !access.contains(StorageAccess::STORE),
        }),
        AddressSpace::Handle => match (&module.types[variable.ty].inner, entry.ty) {
            (TypeInner::Sampler { comparison }, BindingType::Sampler(ty)) => {
                *comparison == (ty == wgpu::SamplerBindingType::Comparison)
            }
            (
                TypeInner::Image {
                    dim,
                    arrayed,
                    class,
                },
                BindingType::Texture {
                    sample_type,
                    view_dimension,
                    multisampled,
                },
            ) => {
                let dims = match (dim, arrayed) {
                    (ImageDimension::D2, false) => TextureViewDimension::D2,
                    (ImageDimension::D2, true) => TextureViewDimension::D2Array,
                    (ImageDimension::D3, false) => TextureViewDimension::D3,
                    _ => return false,
                };
                let (kinds, multi) = match class {
                    ImageClass::Depth { multi } => {
                        (sample_type == TextureSampleType::Depth, *multi)
                    }
                    ImageClass::Sampled {
                        kind: ScalarKind::Float,
                        multi,
                    } => (
                        matches!(sample_type, TextureSampleType::Float { .. }),
                        *multi,
                    ),
                    ImageClass::Sampled {
                        kind: ScalarKind::Uint,
                        multi,
                    } => (sample_type == TextureSampleType::Uint, *multi),
                    _ => return false,
                };
                kinds && dims == view_dimension && multi == multisampled
            }
            (
                TypeInner::Image {
                    dim: ImageDimension::D2,
                    arrayed: false,
                    class: ImageClass::Storage { format, access },
                },
                BindingType::StorageTexture {
                    access: StorageTextureAccess::WriteOnly,
                    format: layout,
                    view_dimension: TextureViewDimension::D2,
                },
            ) => {
                *access == StorageAccess::STORE
                    && matches!(
                        (format, layout),
                        (StorageFormat::R32Float, TextureFormat::R32Float)
                            | (StorageFormat::R32Uint, TextureFormat::R32Uint)
                            | (StorageFormat::Rg32Uint, TextureFormat::Rg32Uint)
                            | (StorageFormat::Rgba32Uint, TextureFormat::Rgba32Uint)
                    )
            }
            _ => false,
        },
        _ => false,
    }
}

/// How the bindings that a shader declares differ from the layouts of its groups.
fn binding_differences(name: &str, module: &Module, groups: &[Entries]) -> Vec<String> {
    let mut found = Vec::new();
    let mut declared = BTreeSet::new();
    for (_, variable) in module.global_variables.iter() {
        let Some(binding) = variable.binding else {
            continue;
        };
        let words = variable.name.as_deref().unwrap_or("?");
        let place = (binding.group as usize, binding.binding);
        let place_words = format!("{name}: @group({}) @binding({}) {words}", place.0, place.1);
        if !declared.insert(place) {
            found.push(format!("{place_words}: declared twice"));
        }
        let entry = groups
            .get(place.0)
            .and_then(|g| g.iter().find(|e| e.binding == place.1));
        match entry {
            None => found.push(format!("{place_words}: not in the layout")),
            Some(entry) if !matches_variable(module, variable, entry) => {
                found.push(format!("{place_words}: the layout has {:?}", entry.ty));
            }
            Some(_) => {}
        }
    }
    for (group, entries) in groups.iter().enumerate() {
        for entry in *entries {
            if !declared.contains(&(group, entry.binding)) {
                found.push(format!(
                    "{name}: @group({group}) @binding({}): in the layout only",
                    entry.binding
                ));
            }
        }
    }
    found
}

#[test]
fn bindings_are_those_of_the_layouts() {
    let names =
        |all: Vec<&str>| -> BTreeSet<String> { all.into_iter().map(str::to_owned).collect() };
    assert_eq!(
        names(bindings::shaders().iter().map(|(s, _)| s.name).collect()),
        names(shader::all().iter().map(|s| s.name).collect()),
        "every shader has its groups"
    );
    let found: Vec<String> = bindings::shaders()
        .iter()
        .flat_map(|(source, groups)| match check(source) {
            Ok(module) => binding_differences(source.name, &module, groups),
            Err(error) => vec![error],
        })
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn bindings_of_another_kind_or_place_are_reported() {
    let module = check(&shader::caster(
        shader::RAYCASTERS,
        ModePart::Post,
        AtlasPart::Float,
    ))
    .expect("a valid shader");
    let differences =
        |groups: &[Entries]| binding_differences("raycast", &module, groups).join("\n");
    let uint = differences(&[bindings::FRAME, bindings::VOLUME_UINT, bindings::RAYCAST]);
    assert!(
        uint.contains("@binding(0) atlas: the layout has"),
        "uint atlas: {uint}"
    );
    let filtered = differences(&[
        bindings::FRAME,
        bindings::VOLUME_FILTERED,
        bindings::RAYCAST,
    ]);
    assert!(
        filtered.contains("@binding(0) atlas: the layout has"),
        "a 3D atlas: {filtered}"
    );
    let more = differences(&[
        bindings::FRAME,
        bindings::VOLUME_FLOAT,
        bindings::RAYCAST,
        bindings::PARTS,
        bindings::FRAME,
    ]);
    assert!(
        more.contains("@group(4) @binding(0): in the layout only"),
        "a group too many: {more}"
    );
    let short = differences(&[
        bindings::FRAME,
        bindings::VOLUME_FLOAT,
        &bindings::RAYCAST[..4],
    ]);
    assert!(
        short.contains("@group(2) @binding(4) counts: not in the layout"),
        "one too few: {short}"
    );
    let swapped = differences(&[bindings::FRAME, bindings::RAYCAST, bindings::VOLUME_FLOAT]);
    assert!(
        swapped.contains("atlas3: the layout has"),
        "groups swapped: {swapped}"
    );
}
