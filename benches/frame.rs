//! What a frame costs: the default technique against others (`basic`, where none is named), on the first graphics adapter (the software one first).
//!
//! Measures: process-CPU and wall milliseconds per frame over a turn of small steps, everything resident after one
//! warm-up frame, mesh and visibility made anew for each frame as `render` does. Does not measure: reading, decoding,
//! uploading, pipeline compilation. Ratios are of one run, interleaved; CPU time is the steadier figure on a shared
//! machine.
//!
//! `cargo bench --bench frame -- STORE.bsk [--frames N] [--size N] [--iso VALUE] [--mode M] [--shading none|phong]
//! [--step S] [--filter hardware] [--tf FILE.json] [--camera orbit|turntable] [--technique T[:SAMPLES]]…`
//!
//! SAMPLES: of a ray in a pass, of techniques multipass and layers. Each technique has an engine of its own.

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
    use std::num::NonZeroU32;
    use std::path::PathBuf;

    use brickscope::camera::Camera;
    use brickscope::classify::{grey_ramp, read_transfer_functions};
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
        techniques: Vec<Contestant>,
    }

    #[derive(Clone, Copy)]
    struct Contestant {
        technique: Technique,
        pass_samples: Option<NonZeroU32>,
    }

    impl Contestant {
        const fn of(technique: Technique) -> Self {
            Self {
                technique,
                pass_samples: None,
            }
        }

        fn parse(word: &str) -> Result<Self, Box<dyn Error>> {
            let (name, samples) = word.split_once(':').unwrap_or((word, ""));
            let technique = Technique::ALL.into_iter().find(|t| t.name() == name);
            Ok(Self {
                technique: technique.ok_or_else(|| format!("no technique {name}"))?,
                pass_samples: match samples {
                    "" => None,
                    n => Some(n.parse()?),
                },
            })
        }

        fn name(self) -> String {
            match self.pass_samples {
                Some(n) => format!("{}:{n}", self.technique.name()),
                None => self.technique.name().to_owned(),
            }
        }
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
            techniques: Vec::new(),
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
                    out.techniques.push(Contestant::parse(&value()?)?);
                }
                _ => out.store = word.into(),
            }
        }
        if out.techniques.is_empty() {
            out.techniques = [Technique::Default, Technique::Basic]
                .map(Contestant::of)
                .to_vec();
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
        let engine = |contestant: &Contestant| {
            let options = EngineOptions {
                device: DeviceChoice::SoftwareGpu,
                filter: args.filter,
                pass_samples: contestant.pass_samples,
                ..EngineOptions::default()
            };
            Engine::open(&args.store, options)
        };
        let engines: Result<Vec<Engine>, _> = args.techniques.iter().map(engine).collect();
        let mut engines = engines?;
        println!(
            "{}, {}, {}², step {}",
            engines[0].device_name(),
            args.store.display(),
            args.size,
            args.step
        );
        println!(
            "{:>6} {:>6} {:>12} | {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9} | ratio (CPU)",
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
        let meta = engines[0].meta().clone();
        let meta = &meta;
        let [low, high] = default_window(meta);
        let iso = args.iso.unwrap_or(0.5 * (low + high));
        let bounds = volume_bounds(meta.dims, &meta.world_from_index);
        let transfer = match &args.tf {
            Some(path) => read_transfer_functions(path)?.swap_remove(0),
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
            for (contestant, engine) in techniques.iter().zip(&mut engines) {
                engine.render(&settings(contestant.technique, 0)?)?;
            }
            for frame in 0..args.frames {
                // Who comes second finds the bricks of this view in the caches: they take turns.
                for turn in 0..techniques.len() {
                    let which = (frame as usize + turn) % techniques.len();
                    let (technique, cost) = (techniques[which], &mut costs[which]);
                    let settings = settings(technique.technique, frame)?;
                    let watch = Stopwatch::start();
                    let picture = engines[which].render(&settings)?;
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
                    "{name:>6} {shaded:>6} {tech:>12} | {:9.1} {:9.1} {:9.1} {:9.1} {:9.2} {:9.2} {:9} | {:.2}",
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
