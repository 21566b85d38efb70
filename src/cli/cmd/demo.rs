//! `demo`: from nothing to three pictures, on any machine.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;

use super::render::write_picture;
use crate::bricking::{self, BrickOptions, NoProgress};
use crate::camera::{Camera, DEFAULT_FOV_Y_DEGREES};
use crate::classify::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, OpacityCurve, OpacityPoint, TransferFunction,
    grey_ramp,
};
use crate::engine::{Engine, EngineOptions};
use crate::input;
use crate::outfile::Existing;
use crate::scene::{
    IsoSurface, Mode, PictureSettings, ShadingModel, default_window, volume_bounds,
};
use crate::store::StoreMeta;

/// The volume of the demo: large enough to look right, small enough for a minute on two cores without a GPU.
const VOLUME: &str = "phantom:body:256,170,300:u16";
/// Where it goes.
const FOLDER: &str = "brickscope-demo";

/// Brick a procedural body and render it three ways into ./brickscope-demo.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  brickscope demo")]
pub struct Args {}

/// Makes the store and the pictures; prints each picture's path on standard output.
///
/// # Errors
/// The folder can't be written, or rendering fails.
pub fn run(_args: &Args) -> anyhow::Result<ExitCode> {
    let begin = Instant::now();
    let folder = Path::new(FOLDER);
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {FOLDER} in the current folder"))?;
    let store = folder.join("body.bsk");
    let mut source = input::open(VOLUME, &Default::default())?;
    let options = BrickOptions {
        existing: Existing::Replace,
        ..BrickOptions::default()
    };
    bricking::brick(source.as_mut(), &store, &options, &NoProgress)?;
    let mut engine = Engine::open(&store, EngineOptions::default())?;
    // When standard error is gone there is nobody to tell, but the pictures are wanted all the same.
    let tell = |line: String| {
        let _ = writeln!(io::stderr(), "{line}");
    };
    if let Some(why) = engine.fallback() {
        tell(format!("brickscope: drawing on the CPU: {why}"));
    }
    tell(format!("device: {}", engine.device_name()));
    for (name, settings) in pictures(engine.meta())? {
        let path: PathBuf = folder.join(name);
        let picture = engine.render(&settings)?;
        write_picture(&path, &picture, settings.background)?;
        writeln!(io::stdout(), "{}", path.display())?;
    }
    tell(format!("{:.1} seconds", begin.elapsed().as_secs_f64()));
    Ok(ExitCode::SUCCESS)
}

/// Bone as a surface, organs and vessels as a volume, and a projection, each from its own side.
fn pictures(meta: &StoreMeta) -> anyhow::Result<[(&'static str, PictureSettings); 3]> {
    let full = 4095.0;
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let picture = |mode,
                   azimuth: f64,
                   elevation: f64,
                   transfer,
                   iso,
                   model|
     -> anyhow::Result<PictureSettings> {
        let camera = Camera::orbit(&bounds, azimuth, elevation, 1.15, DEFAULT_FOV_Y_DEGREES)?;
        let mut settings = PictureSettings::new(mode, transfer, camera);
        settings.size = [512, 512];
        settings.classification.iso.extend(iso);
        settings.shading.model = model;
        Ok(settings)
    };
    let [low, high] = default_window(meta);
    let grey = |top| grey_ramp(low, high, top);
    let bone = IsoSurface::opaque(0.66 * full);
    Ok([
        (
            "iso.png",
            picture(
                Mode::Iso,
                30.0,
                10.0,
                grey(0.5)?,
                Some(bone),
                ShadingModel::Phong,
            )?,
        ),
        (
            "dvr.png",
            picture(
                Mode::Dvr,
                0.0,
                0.0,
                tissues(full)?,
                None,
                ShadingModel::Phong,
            )?,
        ),
        (
            "mip.png",
            picture(Mode::Mip, 0.0, 0.0, grey(1.0)?, None, ShadingModel::None)?,
        ),
    ])
}

/// Skin faint, lungs rosy, organs brown, vessels red, bone ivory; values in fractions of `full`.
fn tissues(full: f64) -> Result<TransferFunction, CurveError> {
    let colors = [
        (0.0, [0.0, 0.0, 0.0]),
        (0.08, [0.80, 0.55, 0.50]),
        (0.25, [0.90, 0.75, 0.55]),
        (0.35, [0.75, 0.35, 0.28]),
        (0.46, [0.60, 0.28, 0.20]),
        (0.58, [0.85, 0.10, 0.08]),
        (0.65, [0.85, 0.10, 0.08]),
        (0.69, [0.95, 0.92, 0.82]),
        (1.0, [1.0, 0.98, 0.92]),
    ];
    let opacities = [
        (0.03, 0.0),
        (0.08, 0.006),
        (0.14, 0.0),
        (0.38, 0.0),
        (0.42, 0.02),
        (0.52, 0.04),
        (0.58, 0.25),
        (0.65, 0.25),
        (0.68, 0.5),
        (0.85, 0.9),
    ];
    Ok(TransferFunction::new(
        "demo",
        ColorCurve::new(
            colors
                .iter()
                .map(|&(x, rgb)| ColorPoint { x: x * full, rgb })
                .collect(),
            ColorSpace::Rgb,
        )?,
        OpacityCurve::new(
            opacities
                .iter()
                .map(|&(x, a)| OpacityPoint::linear(x * full, a))
                .collect(),
        )?,
    ))
}
