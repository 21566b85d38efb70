//! What a frame costs on the CPU, by kind of vector instructions, beside the reference renderer.
//!
//! Measures: process-CPU and wall milliseconds per frame over a part of `bench render`'s turn, after one frame to warm up;
//! the renderers take turns, frame by frame. Does not measure: reading and decoding of the bricks of the first view, the
//! graphics adapter (`bench render`, `--bench frame`). Ratios are of one run.
//!
//! `cargo bench --bench cpu_frame -- STORE.bsk [--frames N] [--iso VALUE] [--tf FILE.json] [--unit MM] [--reference no]`

use std::error::Error;
use std::path::PathBuf;

use brickscope::bench::Turn;
use brickscope::camera::Camera;
use brickscope::classify::{grey_ramp, read_transfer_functions};
use brickscope::clock::Stopwatch;
use brickscope::engine::{DeviceChoice, Engine, EngineOptions, InstructionSet};
use brickscope::scene::{
    GradientFilter, IsoSurface, Mode, PictureSettings, ShadingModel, TransferMode, default_window,
    volume_bounds,
};

struct Args {
    store: PathBuf,
    frames: u32,
    iso: Option<f64>,
    tf: Option<PathBuf>,
    unit_mm: Option<f64>,
    reference: bool,
}

fn args() -> Result<Args, Box<dyn Error>> {
    let mut out = Args {
        store: PathBuf::new(),
        frames: 6,
        iso: None,
        tf: None,
        unit_mm: None,
        reference: true,
    };
    let mut words = std::env::args().skip(1).filter(|w| w != "--bench");
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--frames" => out.frames = value()?.parse()?,
            "--iso" => out.iso = Some(value()?.parse()?),
            "--tf" => out.tf = Some(value()?.into()),
            "--unit" => out.unit_mm = Some(value()?.parse()?),
            "--reference" => out.reference = value()? != "no",
            _ => out.store = word.into(),
        }
    }
    if out.store.as_os_str().is_empty() {
        return Err("expected a store; make one with 'brickscope brick INPUT -o OUT.bsk'".into());
    }
    Ok(out)
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = args()?;
    let open = |device, instructions| {
        Engine::open(
            &args.store,
            EngineOptions {
                device,
                instructions,
                ..EngineOptions::default()
            },
        )
    };
    let mut engines = Vec::new();
    for set in InstructionSet::available() {
        engines.push((set.name(), open(DeviceChoice::Cpu, Some(set))?));
    }
    if args.reference {
        engines.push(("reference", open(DeviceChoice::Reference, None)?));
    }
    println!(
        "{}, 512², step 1, {} frames",
        args.store.display(),
        args.frames
    );
    println!(
        "{:>14} {:>10} | {:>9} {:>9} {:>9} | ÷ first (CPU)",
        "mode", "renderer", "cpu ms", "wall ms", "Msamples"
    );
    for kind in Kind::ALL {
        if kind.mode() == Mode::Iso && args.iso.is_none() {
            continue;
        }
        let settings = settings(&args, &engines[0].1, kind)?;
        let turn = Turn::new(&settings, engines[0].1.meta(), args.frames);
        // CPU ms, wall ms, samples.
        let mut costs = vec![[0.0; 3]; engines.len()];
        for (_, engine) in &mut engines {
            engine.render(&turn.frame(0))?;
        }
        for frame in 0..args.frames {
            for ((_, engine), cost) in engines.iter_mut().zip(&mut costs) {
                let settings = turn.frame(frame);
                let watch = Stopwatch::start();
                let picture = engine.render(&settings)?;
                let elapsed = watch.elapsed();
                cost[0] += elapsed.cpu_ms.ok_or("no clock of CPU time")?;
                cost[1] += elapsed.wall_ms;
                cost[2] += picture.stats.samples as f64;
            }
        }
        for ((renderer, _), cost) in engines.iter().zip(&costs) {
            let [cpu, wall, samples] = cost.map(|c| c / f64::from(args.frames));
            println!(
                "{:>14} {renderer:>10} | {cpu:9.1} {wall:9.1} {:9.2} | {:.2}",
                kind.name(),
                samples / 1e6,
                cost[0] / costs[0][0]
            );
        }
    }
    Ok(())
}

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Plain(Mode),
    Lit(Mode),
    /// Mode dvr.
    Preintegrated,
    /// Mode dvr, lit.
    Filtered,
    /// Four translucent surfaces from the value of `--iso` upwards.
    Translucent,
}

impl Kind {
    const ALL: [Self; 11] = [
        Self::Plain(Mode::Dvr),
        Self::Lit(Mode::Dvr),
        Self::Lit(Mode::Iso),
        Self::Plain(Mode::Mip),
        Self::Plain(Mode::MinIp),
        Self::Plain(Mode::Mean),
        Self::Plain(Mode::Xray),
        Self::Lit(Mode::Gradient),
        Self::Preintegrated,
        Self::Filtered,
        Self::Translucent,
    ];

    fn mode(self) -> Mode {
        match self {
            Self::Plain(mode) | Self::Lit(mode) => mode,
            Self::Preintegrated | Self::Filtered => Mode::Dvr,
            Self::Translucent => Mode::Iso,
        }
    }

    fn name(self) -> String {
        match self {
            Self::Plain(mode) => mode.name().to_owned(),
            Self::Lit(mode) => format!("{} lit", mode.name()),
            Self::Preintegrated => "pre-integrated".into(),
            Self::Filtered => "dvr filtered".into(),
            Self::Translucent => "four surfaces".into(),
        }
    }
}

fn settings(args: &Args, engine: &Engine, kind: Kind) -> Result<PictureSettings, Box<dyn Error>> {
    let (meta, mode) = (engine.meta(), kind.mode());
    let transfer = match &args.tf {
        Some(path) => read_transfer_functions(path)?.swap_remove(0),
        None => {
            let [low, high] = default_window(meta);
            grey_ramp(low, high, if mode.projects() { 1.0 } else { 0.5 })?
        }
    };
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let camera = Camera::orbit(&bounds, 0.0, 0.0, 1.0, 30.0)?;
    let mut settings = PictureSettings::new(mode, transfer, camera);
    settings.size = [512, 512];
    settings.classification.opacity_unit_mm = args.unit_mm;
    let surfaces = &mut settings.classification.iso;
    surfaces.extend(args.iso.map(IsoSurface::opaque));
    if let (Kind::Translucent, Some(value)) = (kind, args.iso) {
        *surfaces = (0..4_u8)
            .map(|n| IsoSurface {
                opacity: 0.4,
                ..IsoSurface::opaque(value * (1.0 + 0.1 * f64::from(n)))
            })
            .collect();
    }
    settings.shading.model = match kind {
        Kind::Plain(_) | Kind::Preintegrated => ShadingModel::None,
        Kind::Lit(_) | Kind::Filtered | Kind::Translucent => ShadingModel::Phong,
    };
    if kind == Kind::Filtered {
        settings.shading.gradient = GradientFilter::Filtered;
    }
    if kind == Kind::Preintegrated {
        settings.classification.transfer_mode = TransferMode::Preintegrated;
    }
    settings.step = 1.0;
    Ok(settings)
}
