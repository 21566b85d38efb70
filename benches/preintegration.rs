//! How far a picture is from the limit of small steps, with and without pre-integration, under a transfer function with a
//! thin peak: the error against post-classification at step 0.1, by step (techniques.md T2.1).
//!
//! The peak lies at a part of the volume's range and is 2 % of it wide. 512², unlit, level 0; errors are of the premultiplied
//! colour and opacity, in 255ths, over the pixels in which the limit shows something. Does not measure time.
//!
//! `cargo bench --bench preintegration -- STORE.bsk [PART]`, PART from 0 to 1, 0.5 if it is not given.

use std::error::Error;
use std::path::Path;

use brickscope::camera::Camera;
use brickscope::classify::{
    ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction,
};
use brickscope::engine::{Engine, EngineOptions};
use brickscope::geom::Lod;
use brickscope::scene::{Image, LodChoice, Mode, PictureSettings, TransferMode, volume_bounds};
use brickscope::store::StoreMeta;

/// What counts as the limit.
const FINE: f64 = 0.1;
const STEPS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Half the peak's width, in parts of the range.
const HALF_WIDTH: f64 = 0.01;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1).filter(|w| w != "--bench");
    let store = words
        .next()
        .ok_or("expected a store; make one with 'brickscope brick INPUT -o OUT.bsk'")?;
    let part = words.next().map_or(Ok(0.5), |w| w.parse::<f64>())?;
    let mut engine = Engine::open(Path::new(&store), EngineOptions::default())?;
    let settings = settings(engine.meta(), part)?;
    let mut draw = |step, transfer_mode| {
        let mut settings = settings.clone();
        settings.step = step;
        settings.classification.transfer_mode = transfer_mode;
        engine.render(&settings).map(|picture| picture.image)
    };
    let limit = draw(FINE, TransferMode::Post)?;
    println!("step   post: mean  99 %   max | pre-integrated: mean  99 %   max");
    let fine = draw(FINE, TransferMode::Preintegrated)?;
    println!(
        "{FINE:4}                          | {}",
        errors(&fine, &limit)
    );
    for step in STEPS {
        let post = errors(&draw(step, TransferMode::Post)?, &limit);
        let integrated = errors(&draw(step, TransferMode::Preintegrated)?, &limit);
        println!("{step:4} {post} | {integrated}");
    }
    Ok(())
}

/// Nothing but a thin peak.
fn settings(meta: &StoreMeta, part: f64) -> Result<PictureSettings, Box<dyn Error>> {
    let at = |part: f64| {
        meta.rescale
            .physical(meta.value_min + part * (meta.value_max - meta.value_min))
    };
    let color = |x, rgb| ColorPoint { x, rgb };
    let transfer = TransferFunction::new(
        "peak",
        ColorCurve::new(
            vec![
                color(at(part - HALF_WIDTH), [0.9, 0.3, 0.1]),
                color(at(part + HALF_WIDTH), [0.2, 0.6, 0.9]),
            ],
            ColorSpace::Rgb,
        )?,
        OpacityCurve::new(vec![
            OpacityPoint::linear(at(part - HALF_WIDTH), 0.0),
            OpacityPoint::linear(at(part), 0.8),
            OpacityPoint::linear(at(part + HALF_WIDTH), 0.0),
        ])?,
    );
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let camera = Camera::orbit(&bounds, 30.0, 20.0, 1.3, 30.0)?;
    let mut settings = PictureSettings::new(Mode::Dvr, transfer, camera);
    settings.size = [512, 512];
    settings.lod = LodChoice::Fixed(Lod(0));
    settings.opacity_cutoff = 1.0;
    Ok(settings)
}

/// Mean, 99th percentile and greatest difference of the pixels that show something in `limit`.
fn errors(image: &Image, limit: &Image) -> String {
    let mut errors: Vec<f32> = image
        .pixels
        .iter()
        .zip(&limit.pixels)
        .filter(|(_, l)| l.w > 0.0)
        .map(|(a, b)| (*a - *b).abs().max_element() * 255.0)
        .collect();
    errors.sort_by(f32::total_cmp);
    let count = errors.len();
    if count == 0 {
        return "nothing to be seen".into();
    }
    let mean = errors.iter().sum::<f32>() / count as f32;
    format!(
        "{mean:10.2} {:6.2} {:6.2}",
        errors[count * 99 / 100],
        errors[count - 1]
    )
}
