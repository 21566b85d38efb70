//! Leaping by reprojection (techniques.md T2.2): frames of a movement with and without it agree, and what it does wrong on
//! purpose shows (negative controls).
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use brickscope::camera::{Camera, Projection};
use brickscope::engine::{Engine, EngineOptions, LeapFault, Picture, ReadHookOption, TickBudget};
use brickscope::geom::Lod;
use brickscope::scene::{
    AntiAliasing, Image, LodChoice, Mode, PictureSettings, SamplePattern, ShadingModel, Technique,
    volume_bounds,
};
use brickscope::store::Store;
use brickscope::volume::VoxelType;
use compare::{assert_same_bits, coverage};
use glam::{DVec2, DVec3};
use scenes::{
    TestStore, field, gpu, inside, looks, oblique, phantom, settings, store_of, tick_to_end,
};

/// What a frame that leaps may differ by in a channel: two steps of a screen.
const BOUND: f32 = 2.0 / 255.0;

/// Pixels that may differ by more, of all pixels of a movement.
const SHARE: f64 = 1e-4;

/// A cast block with bores, a flange, thin ribs and a shaft: silhouettes in front of silhouettes.
fn machine() -> TestStore {
    let size = DVec3::new(100.0, 96.0, 60.0);
    let mut source = field([100, 96, 60], VoxelType::U8, |p| {
        let p = (p - 0.5) * size;
        let plane = DVec2::new(p.x, p.y);
        let block = (p.abs() - DVec3::new(38.0, 30.0, 20.0)).max_element();
        let bore = |x: f64| 9.0 - DVec2::new(p.x - x, p.y).length();
        let shaft = DVec2::new(p.y - 8.0, p.z).length() - 4.0;
        let flange = ((plane.length() - 44.0).abs() - 2.0).max(p.z.abs() - 6.0);
        let ribs = ((p.x / 12.0).fract().abs() * 12.0 - 2.0)
            .max(p.y.abs() - 40.0)
            .max((p.z + 24.0).abs() - 2.0);
        let solid = block.max(bore(-20.0)).max(bore(2.0)).max(bore(24.0));
        let distance = solid.min(shaft).min(flange).min(ribs);
        // A soft edge of two voxels, and two materials.
        let inner = if p.z > 4.0 { 0.9 } else { 0.6 };
        (0.5 - distance / 2.0).clamp(0.0, 1.0) * inner
    });
    source.desc.world_from_index = oblique();
    store_of(&mut source)
}

/// A picture that leaps, at step 1.
fn moving(store: &Store, mode: Mode, technique: Technique) -> PictureSettings {
    PictureSettings {
        size: [160, 144],
        step: 1.0,
        lod: LodChoice::Fixed(Lod(0)),
        leap: true,
        technique,
        ..settings(store, mode)
    }
}

fn without(settings: &PictureSettings) -> PictureSettings {
    PictureSettings {
        leap: false,
        ..settings.clone()
    }
}

/// The view of frame `frame` of an orbit of `degrees` per frame.
fn turned(store: &Store, settings: &PictureSettings, frame: u32, degrees: f64) -> PictureSettings {
    let meta = store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let azimuth = 20.0 + f64::from(frame) * degrees;
    let camera = Camera::orbit(&bounds, azimuth, 15.0 + 0.3 * azimuth, 1.0, 30.0).unwrap();
    PictureSettings {
        camera: Camera {
            projection: settings.camera.projection,
            ..camera
        },
        ..settings.clone()
    }
}

/// Pixels that differ by more than the bound.
fn differing(a: &Image, b: &Image) -> u64 {
    let differs = |(p, q): (&glam::Vec4, &glam::Vec4)| {
        let difference = (*p - *q).abs();
        difference.is_nan() || difference.max_element() > BOUND
    };
    a.pixels
        .iter()
        .zip(&b.pixels)
        .filter(|&p| differs(p))
        .count() as u64
}

/// Panics unless both pictures of a frame show something.
fn assert_shows(with: &Picture, off: &Picture, frame: u32) {
    for (picture, what) in [(with, "leaping"), (off, "without")] {
        let contributing = picture.stats.samples_contributing.unwrap();
        let covered = coverage(&picture.image);
        assert!(
            contributing > 1000 && covered > 0.05,
            "frame {frame}, {what}: {contributing} samples show in {covered} of the picture"
        );
    }
}

/// What a movement came to.
#[derive(Debug, Default)]
struct Movement {
    pixels: u64,
    differing: u64,
    /// Of leaping frames, and of the same frames without.
    samples: [u64; 2],
    leapt: u32,
}

impl Movement {
    fn share(&self) -> f64 {
        self.differing as f64 / self.pixels as f64
    }
}

/// An engine in which all bricks of `store` are: to a mean all of them matter, and an orbit sees all of them in every frame
/// (that none is missing is asserted).
fn filled(store: &TestStore, leap_fault: Option<LeapFault>) -> Engine {
    let options = EngineOptions {
        leap_fault,
        ..EngineOptions::default()
    };
    let mut engine = gpu(store, options);
    let all = moving(&store.store, Mode::Mean, Technique::Basic);
    engine.render(&without(&all)).unwrap();
    engine
}

/// Draws an orbit with and without leaping, frame by frame on one engine that [`filled`] made.
fn movement(
    engine: &mut Engine,
    store: &TestStore,
    settings: &PictureSettings,
    frames: u32,
    degrees: f64,
) -> Movement {
    let mut sum = Movement::default();
    for frame in 0..frames {
        let view = turned(&store.store, settings, frame, degrees);
        let with = engine.draw_moving(&view).unwrap();
        let off = engine.draw_moving(&without(&view)).unwrap();
        assert!(!off.stats.leapt, "off is off");
        assert!(off.stats.converged, "no brick is missing");
        assert_shows(&with, &off, frame);
        sum.leapt += u32::from(with.stats.leapt);
        sum.samples[0] += with.stats.samples;
        sum.samples[1] += off.stats.samples;
        sum.pixels += off.image.pixels.len() as u64;
        sum.differing += differing(&with.image, &off.image);
    }
    sum
}

fn check(
    engine: &mut Engine,
    store: &TestStore,
    settings: &PictureSettings,
    frames: u32,
    what: &str,
) {
    let sum = movement(engine, store, settings, frames, 1.0);
    println!("{what}: {sum:?}, {:.4} %", sum.share() * 100.0);
    assert_eq!(sum.leapt, frames - 1, "{what}: all but the first leap");
    assert!(sum.share() <= SHARE, "{what}: {sum:?}");
    assert!(
        sum.samples[0] < sum.samples[1],
        "{what}: leaping saves samples: {sum:?}"
    );
}

fn check_techniques(store: &TestStore, frames: u32, what: &str) {
    let mut engine = filled(store, None);
    for mode in [Mode::Iso, Mode::Dvr] {
        for technique in [Technique::Basic, Technique::Default] {
            let settings = moving(&store.store, mode, technique);
            let what = format!("{what} {} {}", mode.name(), technique.name());
            check(&mut engine, store, &settings, frames, &what);
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn an_orbit_around_a_machine_is_as_without() {
    check_techniques(&machine(), 36, "machine");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn an_orbit_around_a_body_is_as_without() {
    check_techniques(&phantom("phantom:body:110,80,120:u8"), 18, "body");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn an_orbit_around_a_sponge_is_as_without() {
    check_techniques(&phantom("phantom:sponge:80,80,80:u8"), 18, "sponge");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn other_looks_are_as_without() {
    let store = machine();
    let mut others: Vec<(&str, PictureSettings)> = looks(&store.store);
    let mut parallel = settings(&store.store, Mode::Iso);
    parallel.camera.projection = Projection::Orthographic;
    others.push(("orthographic", parallel));
    let mut fine = settings(&store.store, Mode::Dvr);
    fine.shading.model = ShadingModel::Phong;
    others.push(("lit dvr", fine));
    let mut engine = filled(&store, None);
    for (look, of_look) in others {
        let settings = PictureSettings {
            // Pixels half again as wide as voxels, as the level rule has them. Where they are wider still, slits open in
            // one frame of which the frame before has seen nothing.
            size: [160, 144],
            lod: LodChoice::Fixed(Lod(0)),
            leap: true,
            technique: Technique::Basic,
            ..of_look
        };
        let frames = if settings.mode.projects() { 3 } else { 6 };
        let sum = movement(&mut engine, &store, &settings, frames, 1.0);
        println!("{look}: {sum:?}, {:.4} %", sum.share() * 100.0);
        if settings.mode.projects() {
            assert_eq!(sum.leapt, 0, "{look} never leaps");
            assert_eq!(sum.differing, 0, "{look} is the same");
            continue;
        }
        assert_eq!(sum.leapt, frames - 1, "{look}: all but the first leap");
        assert!(sum.share() <= SHARE, "{look}: {sum:?}");
        assert!(sum.samples[0] < sum.samples[1], "{look}: {sum:?}");
    }
}

/// The same movement in order and with a fault: only the second is beyond the bound.
fn assert_fault_shows(fault: LeapFault, degrees: f64) {
    let store = machine();
    let settings = moving(&store.store, Mode::Iso, Technique::Basic);
    let [right, wrong] = [None, Some(fault)].map(|fault| {
        let mut engine = filled(&store, fault);
        movement(&mut engine, &store, &settings, 12, degrees)
    });
    println!("{fault:?} at {degrees}°: {wrong:?}, in order {right:?}");
    assert!(right.share() <= SHARE, "{fault:?}: in order {right:?}");
    assert!(wrong.share() > 2.0 * SHARE, "{fault:?}: {wrong:?}");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn points_not_moved_back_show() {
    assert_fault_shows(LeapFault::NotMovedBack, 1.0);
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn rays_that_are_not_followed_show() {
    assert_fault_shows(LeapFault::OnePixel, 8.0);
}

/// Draws `from` and then `to`, both with leaping: did the second one leap, and how many of its pixels are wrong?
fn step(engine: &mut Engine, from: &PictureSettings, to: &PictureSettings) -> (bool, u64) {
    engine.draw_moving(from).unwrap();
    let with = engine.draw_moving(to).unwrap();
    let off = engine.draw_moving(&without(to)).unwrap();
    (with.stats.leapt, differing(&with.image, &off.image))
}

/// What leaping must not survive: names and settings, each a change of `settings`.
fn edits(settings: &PictureSettings) -> Vec<(&'static str, PictureSettings)> {
    let of = |change: &dyn Fn(&mut PictureSettings)| {
        let mut edited = settings.clone();
        change(&mut edited);
        edited
    };
    vec![
        ("iso-value", of(&|s| s.classification.iso[0].value *= 0.4)),
        (
            "opacity",
            of(&|s| {
                let points = s.classification.transfer.opacity.points().to_vec();
                let nearer = points.into_iter().map(|mut p| {
                    p.x *= 0.5;
                    p
                });
                s.classification.transfer.opacity =
                    brickscope::classify::OpacityCurve::new(nearer.collect()).unwrap();
            }),
        ),
        ("size", of(&|s| s.size = [s.size[0], s.size[1] + 16])),
        ("field of view", of(&|s| s.camera.fov_y_degrees = 25.0)),
        (
            "projection",
            of(&|s| s.camera.projection = Projection::Orthographic),
        ),
        ("near plane", of(&|s| s.camera.near_mm = 1.0)),
        ("step", of(&|s| s.step = 0.75)),
        ("level rule", of(&|s| s.lod = LodChoice::Fixed(Lod(1)))),
        (
            "interpolation",
            of(&|s| s.interpolation = brickscope::scene::Interpolation::Nearest),
        ),
        (
            "mode",
            of(&|s| {
                s.mode = if s.mode == Mode::Iso {
                    Mode::Xray
                } else {
                    Mode::Gradient
                }
            }),
        ),
    ]
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn edits_and_jumps_reinitialise() {
    let store = machine();
    for mode in [Mode::Iso, Mode::Dvr] {
        let settings = PictureSettings {
            size: [96, 96],
            ..moving(&store.store, mode, Technique::Basic)
        };
        let view = turned(&store.store, &settings, 0, 1.0);
        let mut engine = gpu(&store, EngineOptions::default());
        let (leapt, wrong) = step(&mut engine, &view, &view);
        assert!(
            leapt && wrong == 0,
            "{mode:?}: the same view again: {wrong}"
        );
        for (name, edited) in edits(&view) {
            let (leapt, wrong) = step(&mut engine, &view, &edited);
            assert!(!leapt, "{mode:?}: another {name}");
            assert_eq!(wrong, 0, "{mode:?}: another {name}");
        }
        let (leapt, wrong) = step(
            &mut engine,
            &view,
            &turned(&store.store, &settings, 60, 1.0),
        );
        assert!(!leapt && wrong == 0, "{mode:?}: a jump by 60°");
        engine.forget_bricks();
        assert!(
            !engine.draw_moving(&view).unwrap().stats.leapt,
            "{mode:?}: another atlas"
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn points_kept_over_an_edit_show() {
    let store = machine();
    let options = EngineOptions {
        leap_fault: Some(LeapFault::KeepsPoints),
        ..EngineOptions::default()
    };
    let mut engine = gpu(&store, options);
    for (mode, name) in [(Mode::Iso, "iso-value"), (Mode::Dvr, "opacity")] {
        let settings = PictureSettings {
            size: [96, 96],
            ..moving(&store.store, mode, Technique::Basic)
        };
        let view = turned(&store.store, &settings, 0, 1.0);
        let (_, edited) = edits(&view).into_iter().find(|e| e.0 == name).unwrap();
        let (leapt, wrong) = step(&mut engine, &view, &edited);
        assert!(leapt, "the fault keeps the points");
        assert!(wrong > 96, "{name}: {wrong} pixels are wrong");
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_final_picture_never_leaps() {
    let store = machine();
    let mut settings = moving(&store.store, Mode::Dvr, Technique::Basic);
    settings.size = [96, 96];
    settings.anti_aliasing = AntiAliasing::Full(SamplePattern::Two);
    let views: Vec<PictureSettings> = (0..4)
        .map(|k| turned(&store.store, &settings, k, 1.0))
        .collect();
    let rested = gpu(&store, EngineOptions::default())
        .render(&without(&views[3]))
        .unwrap();
    let mut engine = gpu(&store, EngineOptions::default());
    let mut leapt = 0;
    for view in &views {
        leapt += u32::from(engine.draw_moving(view).unwrap().stats.leapt);
    }
    assert_eq!(leapt, 3, "frames of the movement do");
    let after = engine.render(&views[3]).unwrap();
    assert_same_bits(&after.image, &rested.image, "rendered after a movement");
    assert!(!after.stats.leapt, "and says so");
    // The same by ticks, whose drafts leap.
    for view in &views {
        engine.set_picture(view.clone());
        for _ in 0..2 {
            engine.tick(&TickBudget::default()).unwrap();
        }
    }
    tick_to_end(&mut engine, &TickBudget::default());
    assert_same_bits(
        engine.image().unwrap(),
        &rested.image,
        "ticked after a movement",
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn memory_is_counted_when_leaping_is_on() {
    let store = machine();
    let settings = moving(&store.store, Mode::Iso, Technique::Basic);
    let bytes = |settings: &PictureSettings| {
        let mut engine = gpu(&store, EngineOptions::default());
        engine
            .draw_moving(settings)
            .unwrap()
            .stats
            .gpu_bytes
            .unwrap()
    };
    let more = bytes(&settings) - bytes(&without(&settings));
    // Points of two frames and starts.
    let pixels = u64::from(settings.size[0] * settings.size[1]);
    assert!(
        (12 * pixels..12 * pixels + 1024).contains(&more),
        "{more} bytes"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn stand_ins_and_levels_are_as_without() {
    let store = phantom("phantom:body:200,180,210:u8");
    for mode in [Mode::Iso, Mode::Dvr] {
        for technique in [Technique::Basic, Technique::Default] {
            stand_ins(&store, mode, technique);
        }
    }
}

fn stand_ins(store: &TestStore, mode: Mode, technique: Technique) {
    let closed = Arc::new(AtomicBool::new(false));
    let gate = Arc::clone(&closed);
    let hook = move |_| {
        if gate.load(Ordering::SeqCst) {
            return Err(brickscope::store::StoreError::Io {
                path: "gate".into(),
                doing: "read",
                error: std::io::Error::other("closed"),
            });
        }
        Ok(())
    };
    let options = EngineOptions {
        max_slots: Some(50),
        ram_bytes: 4 << 20,
        read_hook: Some(ReadHookOption(Arc::new(hook))),
        ..EngineOptions::default()
    };
    let mut engine = gpu(store, options);
    let mut settings = moving(&store.store, mode, technique);
    settings.classification.iso[0].value = 150.0;
    // From the middle of the volume on a pixel is half as wide as a voxel of level 1.
    let bounds = volume_bounds(
        store.store.meta().dims,
        &store.store.meta().world_from_index,
    );
    let tangent = 15.0_f64.to_radians().tan();
    let pixel_mm =
        2.0 * tangent / f64::from(settings.size[1]) * bounds.radius / 15.0_f64.to_radians().sin();
    settings.lod = LodChoice::Auto;
    settings.lod_error = 2.0 / pixel_mm;
    let first = turned(&store.store, &settings, 0, 1.0);
    let mut rounds = 0;
    while engine.draw_moving(&first).unwrap().stats.bricks_uploaded != Some(0) {
        rounds += 1;
        assert!(rounds < 100, "all that fits is there in the end");
    }
    closed.store(true, Ordering::SeqCst);
    let mut sum = Movement::default();
    let mut stood_in = 0;
    for frame in 0..12 {
        let view = turned(&store.store, &settings, frame, 1.0);
        let with = engine.draw_moving(&view).unwrap();
        let off = engine.draw_moving(&without(&view)).unwrap();
        assert_shows(&with, &off, frame);
        if with.stats.bricks_uploaded != Some(0) {
            assert!(!with.stats.leapt, "frame {frame}: bricks came");
        }
        if off.stats.bricks_uploaded != Some(0) || off.stats.bricks_evicted != Some(0) {
            continue;
        }
        sum.leapt += u32::from(with.stats.leapt);
        stood_in += u32::from(!off.stats.converged);
        sum.pixels += off.image.pixels.len() as u64;
        sum.differing += differing(&with.image, &off.image);
    }
    let what = format!("stand-ins, {} {}", mode.name(), technique.name());
    println!("{what}: {sum:?}, {stood_in} frames with stand-ins");
    assert!(sum.leapt > 5, "{what}: {sum:?}");
    assert!(
        stood_in > 5,
        "{what}: coarser bricks stood in in {stood_in} frames"
    );
    assert!(sum.share() <= SHARE, "{what}: {sum:?}");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn from_inside_it_is_as_without() {
    let store = machine();
    let mut engine = gpu(&store, EngineOptions::default());
    let mut settings = moving(&store.store, Mode::Dvr, Technique::Basic);
    settings.size = [96, 96];
    let mut wrong = 0;
    for frame in 0..8 {
        let direction = DVec3::new(0.3 + 0.02 * f64::from(frame), 1.0, 0.2);
        settings.camera = inside(&store.store, DVec3::new(0.45, 0.2, 0.5), direction);
        let with = engine.draw_moving(&settings).unwrap();
        let off = engine.draw_moving(&without(&settings)).unwrap();
        assert_shows(&with, &off, frame);
        assert_eq!(
            with.stats.leapt,
            frame > 0,
            "a camera that only turns leaps"
        );
        wrong += differing(&with.image, &off.image);
    }
    assert!(wrong <= 7, "{wrong} pixels of 8 frames");
}

#[test]
fn the_cpu_renders() {
    let store = machine();
    let mut settings = moving(&store.store, Mode::Iso, Technique::Default);
    settings.size = [64, 64];
    let mut cpu = scenes::cpu(&store, EngineOptions::default());
    let drawn = cpu.draw_moving(&settings).unwrap();
    assert_same_bits(
        &drawn.image,
        &cpu.render(&without(&settings)).unwrap().image,
        "a moving frame on the CPU",
    );
}
