//! What technique slab costs beside the default caster, by the four levels of work per sample of techniques.md T5: RC (mip),
//! TF (dvr), PH (dvr lit) and GF (dvr lit, filtered gradients).
//!
//! Measures: process-CPU and wall milliseconds per frame over a part of `bench render`'s turn, after one frame to warm up;
//! the engines take turns, frame by frame. Does not measure: reading and decoding of the bricks of the first view. Ratios are
//! of one run.
//!
//! `cargo bench --bench slab -- STORE.bsk [--frames N] [--size PIXELS] [--shapes 8x8x8,16x8x16,…] [--work RC,TF,PH,GF]`

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use brickscope::bench::Turn;
use brickscope::camera::Camera;
use brickscope::classify::grey_ramp;
use brickscope::clock::Stopwatch;
use brickscope::engine::{Engine, EngineOptions};
use brickscope::scene::{
    GradientFilter, Mode, PictureSettings, ShadingModel, SlabShape, Technique, default_window,
    volume_bounds,
};
use brickscope::store::Store;

struct Args {
    store: PathBuf,
    frames: u32,
    size: u32,
    shapes: Vec<SlabShape>,
    work: String,
}

fn shape(text: &str) -> Result<SlabShape, Box<dyn Error>> {
    let numbers: Result<Vec<u32>, _> = text.split('x').map(str::parse).collect();
    let [width, height, depth] = numbers?[..] else {
        return Err(format!("{text:?} is no shape; write 8x8x22").into());
    };
    Ok(SlabShape {
        width,
        height,
        depth,
    })
}

fn args() -> Result<Args, Box<dyn Error>> {
    let mut out = Args {
        store: PathBuf::new(),
        frames: 3,
        size: 512,
        shapes: vec![SlabShape::default()],
        work: "RC,TF,PH,GF".into(),
    };
    let mut words = std::env::args().skip(1).filter(|w| w != "--bench");
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--frames" => out.frames = value()?.parse()?,
            "--size" => out.size = value()?.parse()?,
            "--shapes" => out.shapes = value()?.split(',').map(shape).collect::<Result<_, _>>()?,
            "--work" => out.work = value()?,
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
    let store = Arc::new(Store::open(&args.store)?);
    let open = |slab| {
        let options = EngineOptions {
            slab,
            ..EngineOptions::default()
        };
        Engine::with_store(Arc::clone(&store), options)
    };
    let mut engines = vec![("default".to_owned(), open(SlabShape::default())?)];
    for &shape in &args.shapes {
        engines.push((shape.to_string(), open(shape)?));
    }
    println!(
        "{}, {}², step 1, {} frames, {}",
        args.store.display(),
        args.size,
        args.frames,
        engines[0].1.device_name()
    );
    println!(
        "{:>4} {:>10} | {:>9} {:>9} {:>9} | ÷ default (CPU)",
        "work", "slab", "cpu ms", "wall ms", "Msamples"
    );
    for work in args.work.split(',') {
        let settings = settings(&engines[0].1, work, args.size)?;
        let turn = Turn::new(&settings, engines[0].1.meta(), args.frames);
        let of = |slab: bool, frame| PictureSettings {
            technique: if slab {
                Technique::Slab
            } else {
                Technique::Default
            },
            ..turn.frame(frame)
        };
        // CPU ms, wall ms, samples.
        let mut costs = vec![[0.0; 3]; engines.len()];
        for (number, (_, engine)) in engines.iter_mut().enumerate() {
            engine.render(&of(number > 0, 0))?;
        }
        for frame in 0..args.frames {
            for (number, ((_, engine), cost)) in engines.iter_mut().zip(&mut costs).enumerate() {
                let settings = of(number > 0, frame);
                let watch = Stopwatch::start();
                let picture = engine.render(&settings)?;
                let elapsed = watch.elapsed();
                cost[0] += elapsed.cpu_ms.ok_or("no clock of CPU time")?;
                cost[1] += elapsed.wall_ms;
                cost[2] += picture.stats.samples as f64 / 1e6;
            }
        }
        for ((name, _), cost) in engines.iter().zip(&costs) {
            let [cpu, wall, samples] = cost.map(|c| c / f64::from(args.frames));
            println!(
                "{work:>4} {name:>10} | {cpu:>9.1} {wall:>9.1} {samples:>9.2} | {:.2}",
                cost[0] / costs[0][0]
            );
        }
    }
    Ok(())
}

/// The picture of a level of work.
fn settings(engine: &Engine, work: &str, size: u32) -> Result<PictureSettings, Box<dyn Error>> {
    let meta = engine.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let camera = Camera::orbit(&bounds, 30.0, 15.0, 1.0, 30.0)?;
    let [low, high] = default_window(meta);
    let (mode, opacity) = match work {
        "RC" => (Mode::Mip, 1.0),
        _ => (Mode::Dvr, 0.5),
    };
    let transfer = grey_ramp(low, high, opacity)?;
    let mut settings = PictureSettings::new(mode, transfer, camera);
    settings.size = [size; 2];
    settings.step = 1.0;
    match work {
        "RC" | "TF" => (),
        "PH" => settings.shading.model = ShadingModel::Phong,
        "GF" => {
            settings.shading.model = ShadingModel::Phong;
            settings.shading.gradient = GradientFilter::Filtered;
        }
        other => return Err(format!("{other:?} is no level of work: RC, TF, PH or GF").into()),
    }
    Ok(settings)
}
