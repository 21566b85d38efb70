//! What a flight is: its frames, and all that decides their pixels, as `fly.json` has it.

use anyhow::{Context, bail};
use serde_json::{Map, Value, json};

use super::{Args, Flight};
use crate::clip::{Geometry, TriangleMesh};
use crate::engine::Engine;
use crate::export::video::FrameRate;
use crate::scene::PictureSettings;

/// Frames have five digits.
const MOST_FRAMES: u64 = 100_000;

/// How many frames a flight of `seconds` has.
///
/// # Errors
/// More than frames have numbers.
pub(super) fn frame_count(rate: FrameRate, seconds: f64) -> anyhow::Result<u64> {
    let frames = rate.frames_in(seconds);
    if frames > MOST_FRAMES {
        bail!(
            "{seconds} seconds at {rate} frames a second are {frames} frames; at most {MOST_FRAMES} can be written; give fewer \
             --seconds or a lower --fps"
        );
    }
    Ok(frames)
}

/// All that decides the frames. The device does, too: those of two may differ in the last bit of a colour.
///
/// # Errors
/// The path can't be told as JSON.
pub(super) fn describe(args: &Args, flight: &Flight, engine: &Engine) -> anyhow::Result<Value> {
    let meta = engine.meta();
    let path: Value = serde_json::from_str(&flight.path.to_json()).context("telling the path")?;
    Ok(json!({
        "brickscope": env!("CARGO_PKG_VERSION"),
        "store": {
            "source": meta.source_name,
            "hash": format!("{:016x}", meta.source_hash),
            "dims": meta.dims.to_array(),
            "levels": meta.levels.len(),
            "type": meta.stored_type.voxel_type().name(),
        },
        "path": path,
        "frames": flight.frames,
        "fps": flight.rate.to_string(),
        "realtime": args.realtime,
        "device": engine.device_name(),
        "settings": settings(&flight.settings),
    }))
}

/// What cuts and what is drawn; meshes by what they are made of, wherever their files lie.
fn geometry_value(geometry: &Geometry) -> Value {
    let Geometry {
        planes,
        clip_meshes,
        surfaces,
        faces,
    } = geometry;
    let hash = |mesh: &TriangleMesh| format!("{:016x}", mesh.content_hash());
    json!({
        "planes": planes.iter().map(|p| p.normal().extend(p.offset()).to_array()).collect::<Vec<_>>(),
        "clip_meshes": clip_meshes
            .iter()
            .map(|c| json!([hash(&c.mesh), format!("{:?}", c.side)]))
            .collect::<Vec<_>>(),
        "meshes": surfaces
            .iter()
            .map(|s| json!([hash(&s.mesh), s.color.to_array(), s.opacity]))
            .collect::<Vec<_>>(),
        "caps": faces.are_capped,
        "cut_normals": faces.have_normals,
    })
}

/// Every setting but the camera, which is the path's.
fn settings(settings: &PictureSettings) -> Value {
    // Spelt out, so that no setting that is added is forgotten.
    let PictureSettings {
        size,
        background,
        mode,
        classification,
        shading,
        step,
        moving_step: _,
        interpolation,
        jitter,
        refine,
        lod,
        lod_error,
        opacity_cutoff,
        technique,
        leap,
        anti_aliasing,
        geometry,
        // Films have none.
        depths: _,
        camera,
    } = settings;
    let debug = |value: &dyn std::fmt::Debug| Value::from(format!("{value:?}"));
    let mut map = Map::new();
    for (name, value) in [
        ("size", json!(size)),
        ("background", debug(background)),
        ("mode", json!(mode.name())),
        ("transfer", debug(&classification.transfer)),
        ("opacity_unit_mm", json!(classification.opacity_unit_mm)),
        ("iso", debug(&classification.iso)),
        ("tf_mode", debug(&classification.transfer_mode)),
        ("shading", debug(shading)),
        ("step", json!(step)),
        ("interpolation", debug(interpolation)),
        ("jitter", debug(jitter)),
        ("refine", json!(refine)),
        ("lod", debug(lod)),
        ("lod_error", json!(lod_error)),
        ("opacity_cutoff", json!(opacity_cutoff)),
        ("technique", debug(technique)),
        ("leap", json!(leap)),
        ("anti_aliasing", debug(anti_aliasing)),
        ("geometry", geometry_value(geometry)),
        ("projection", debug(&camera.projection)),
        ("near_mm", json!(camera.near_mm)),
    ] {
        map.insert(name.into(), value);
    }
    Value::Object(map)
}
