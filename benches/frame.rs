//! What a frame costs: the default technique against `basic`, on the first graphics adapter (the software one first).
//!
//! Measures: process-CPU and wall milliseconds per frame over a turn of small steps, everything resident after one
//! warm-up frame, mesh and visibility made anew for each frame as `render` does. Does not measure: reading, decoding,
//! uploading, pipeline compilation. Ratios are of one run, interleaved; CPU time is the steadier figure on a shared
//! machine.
//!
//! `cargo bench --bench frame -- STORE.bsk [--frames N] [--size N] [--iso VALUE] [--mode M] [--shading none|phong]
//! [--step S] [--filter hardware] [--tf FILE.json] [--camera orbit|turntable] [--technique T]`

#[cfg(not(feature = "gpu"))]
fn main() {
    eprintln!("this bench needs the feature `gpu`");
}

#[cfg(feature = "gpu")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    gpu::main()
}

#[cfg(feature = "gpu")]
mod gpu {
    use std::error::Error;
    use std::path::PathBuf;

    use brickscope::camera::Camera;
    use brickscope::classify::{grey_ramp, read_paraview};
    use brickscope::clock::Stopwatch;
    use brickscope::engine::{DeviceChoice, Engine, EngineOptions, SampleFilter};
    use brickscope::scene::{
        IsoSurface, Mode, PictureSettings, PictureStats, ShadingModel, Technique, default_window,
        volume_bounds,
    };

    struct Args {
        store: PathBuf,
        frames: u32,
        size: u32,
        iso: Option<f64>,
        mode: Option<String>,
        step: f64,
        filter: SampleFilter,
        shading: Option<ShadingModel>,
        tf: Option<PathBuf>,
        turntable: bool,
        techniques: Vec<Technique>,
    }

    fn args() -> Result<Args, Box<dyn Error>> {
        let mut out = Args {
            store: PathBuf::new(),
            frames: 6,
            size: 512,
            iso: None,
            mode: None,
            step: 1.0,
            filter: SampleFilter::default(),
            shading: None,
            tf: None,
            turntable: false,
            techniques: vec![Technique::Default, Technique::Basic],
        };
        let mut words = std::env::args().skip(1).filter(|w| w != "--bench");
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or(format!("{word} needs a value"));
            match word.as_str() {
                "--frames" => out.frames = value()?.parse()?,
                "--size" => out.size = value()?.parse()?,
                "--iso" => out.iso = Some(value()?.parse()?),
                "--mode" => out.mode = Some(value()?),
                "--step" => out.step = value()?.parse()?,
                "--filter" => {
                    out.filter = match value()?.as_str() {
                        "hardware" => SampleFilter::Hardware,
                        _ => SampleFilter::Exact,
                    }
                }
                "--shading" => {
                    out.shading = Some(match value()?.as_str() {
                        "none" => ShadingModel::None,
                        _ => ShadingModel::Phong,
                    })
                }
                "--tf" => out.tf = Some(value()?.into()),
                "--camera" => out.turntable = value()? == "turntable",
                "--technique" => {
                    out.techniques = vec![match value()?.as_str() {
                        "basic" => Technique::Basic,
                        _ => Technique::Default,
                    }]
                }
                _ => out.store = word.into(),
            }
        }
        if out.store.as_os_str().is_empty() {
            return Err(
                "expected a store; make one with 'brickscope brick INPUT -o OUT.bsk'".into(),
            );
        }
        Ok(out)
    }

    #[derive(Default)]
    struct Cost {
        cpu_ms: f64,
        wall_ms: f64,
        raycast_ms: f64,
        bounds_ms: f64,
        last: PictureStats,
    }

    pub(super) fn main() -> Result<(), Box<dyn Error>> {
        let args = args()?;
        let options = EngineOptions {
            device: DeviceChoice::SoftwareGpu,
            filter: args.filter,
            ..EngineOptions::default()
        };
        let mut engine = Engine::open(&args.store, options)?;
        println!(
            "{}, {}, {}², step {}",
            engine.device_name(),
            args.store.display(),
            args.size,
            args.step
        );
        println!(
            "{:>6} {:>6} {:>8} | {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} | ratio (CPU)",
            "mode",
            "shaded",
            "tech",
            "cpu ms",
            "wall ms",
            "raycast",
            "bounds",
            "Msamples",
            "M contr.",
            "triangles"
        );
        let meta = engine.meta();
        let [low, high] = default_window(meta);
        let iso = args.iso.unwrap_or(0.5 * (low + high));
        let bounds = volume_bounds(meta.dims, &meta.world_from_index);
        let transfer = match &args.tf {
            Some(path) => read_paraview(path)?.swap_remove(0),
            None => grey_ramp(low, high, 0.5)?,
        };
        for (name, mode, shaded) in [
            ("dvr", Mode::Dvr, false),
            ("dvr", Mode::Dvr, true),
            ("iso", Mode::Iso, true),
            ("mip", Mode::Mip, false),
        ] {
            if args.mode.as_deref().is_some_and(|m| m != name) {
                continue;
            }
            let model = if shaded {
                ShadingModel::Phong
            } else {
                ShadingModel::None
            };
            if args.shading.is_some_and(|s| s != model) {
                continue;
            }
            let camera = |frame| {
                if args.turntable {
                    // The distance of the peers' benches: 1.5 diagonals of the box.
                    let distance = 3.0 * bounds.radius;
                    Ok(Camera::turntable(
                        frame,
                        args.frames,
                        bounds.center,
                        distance,
                    ))
                } else {
                    let azimuth = 360.0 * f64::from(frame) / f64::from(args.frames);
                    Camera::orbit(&bounds, azimuth, 15.0, 1.0, 30.0)
                }
            };
            let settings = |technique, frame| -> Result<PictureSettings, Box<dyn Error>> {
                let mut settings = PictureSettings::new(mode, transfer.clone(), camera(frame)?);
                settings.size = [args.size; 2];
                settings.classification.iso.push(IsoSurface::opaque(iso));
                settings.shading.model = model;
                settings.step = args.step;
                settings.technique = technique;
                Ok(settings)
            };
            let techniques = &args.techniques;
            let mut costs: Vec<Cost> = techniques.iter().map(|_| Cost::default()).collect();
            // Warm-up: pipelines, and the bricks of all.
            for &technique in techniques {
                engine.render(&settings(technique, 0)?)?;
            }
            for frame in 0..args.frames {
                // Who comes second finds the bricks of this view in the caches: they take turns.
                for turn in 0..techniques.len() {
                    let which = (frame as usize + turn) % techniques.len();
                    let (technique, cost) = (techniques[which], &mut costs[which]);
                    let settings = settings(technique, frame)?;
                    let watch = Stopwatch::start();
                    let picture = engine.render(&settings)?;
                    let elapsed = watch.elapsed();
                    cost.cpu_ms += elapsed.cpu_ms.ok_or("no clock of CPU time")?;
                    cost.wall_ms += elapsed.wall_ms;
                    for (pass, ms) in picture.stats.passes_ms.iter().flatten() {
                        *(if pass == "raycast" {
                            &mut cost.raycast_ms
                        } else {
                            &mut cost.bounds_ms
                        }) += ms;
                    }
                    cost.last = picture.stats;
                }
            }
            let n = f64::from(args.frames);
            for (technique, cost) in techniques.iter().zip(&costs) {
                let tech = technique.name();
                println!(
                    "{name:>6} {shaded:>6} {tech:>8} | {:9.1} {:9.1} {:9.1} {:9.1} {:9.2} {:9.2} {:9} | {:.2}",
                    cost.cpu_ms / n,
                    cost.wall_ms / n,
                    cost.raycast_ms / n,
                    cost.bounds_ms / n,
                    cost.last.samples as f64 / 1e6,
                    cost.last.samples_contributing.unwrap_or(0) as f64 / 1e6,
                    cost.last.mesh_triangles.unwrap_or(0),
                    costs[costs.len() - 1].cpu_ms / cost.cpu_ms
                );
            }
        }
        Ok(())
    }
}
