//! Volumes larger than memory, through the engine: pictures that change while bricks come, slow and failing disks, changes
//! in the middle of everything (design.md §2, invariants 2 and 5; §7). What `Engine::render` gives under small atlases is
//! in `tests/metamorphic.rs`.
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

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use brickscope::camera::Camera;
use brickscope::classify::{ColorCurve, ColorPoint, ColorSpace};
use brickscope::engine::{
    Engine, EngineOptions, ReadHookOption, StandIns, TickBudget, TickEvent, TickReport,
};
use brickscope::geom::{BrickId, Lod};
use brickscope::reference::VoxelField;
use brickscope::scene::{
    Image, LodChoice, Mode, PictureSettings, Shading, ShadingModel, volume_bounds,
};
use brickscope::store::StoreError;
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, coverage, difference};
use glam::{DVec3, IVec3, Vec3, Vec3Swizzles};
use memory_source::noise;
use scenes::{TestStore, field, gpu, inside, looks, phantom, settings, store_of};

/// What is drawn under several sizes of the atlas; [`other_looks`] under the smallest.
const MODES: [Mode; 3] = [Mode::Dvr, Mode::Iso, Mode::Mip];

/// Small pictures of all looks but those of [`MODES`].
fn other_looks(store: &TestStore) -> Vec<(&'static str, PictureSettings)> {
    let mut looks = looks(&store.store);
    looks.retain(|(look, _)| MODES.iter().all(|mode| mode.name() != *look));
    for (_, s) in &mut looks {
        s.size = [56, 48];
        s.lod_error = 0.25;
    }
    looks
}

/// More ticks than any picture here needs: one that hangs fails instead.
const MANY_TICKS: usize = 20_000;

const BUDGET: TickBudget = TickBudget {
    time: Duration::from_millis(20),
    upload_bytes: 1 << 20,
};

/// Ticks until the picture converges or fails; returns what happened on the way.
fn finish(engine: &mut Engine) -> (Vec<TickEvent>, TickReport) {
    finish_by(engine, &BUDGET)
}

/// As [`finish`], by ticks of this budget. A tick reports the last thing that happened in it: short ones miss nothing.
fn finish_by(engine: &mut Engine, budget: &TickBudget) -> (Vec<TickEvent>, TickReport) {
    let mut events = Vec::new();
    for _ in 0..MANY_TICKS {
        let report = engine.tick(budget).unwrap();
        events.extend(report.event);
        if report.converged || report.event == Some(TickEvent::Failed) {
            return (events, report);
        }
    }
    panic!("{MANY_TICKS} ticks and no end: {events:?}");
}

fn small(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    s.size = [96, 80];
    s.lod = LodChoice::Auto;
    s.lod_error = 0.25;
    s
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_changing_picture_is_whole_and_becomes_the_rendered_one() {
    let store = phantom("phantom:body:200,180,210:u16");
    for mode in MODES {
        let s = small(&store, mode);
        let rendered = gpu(&store, EngineOptions::default()).render(&s).unwrap();
        for slots in [None, Some(64), Some(9)] {
            let what = format!("{}, {slots:?} slots", mode.name());
            let options = EngineOptions {
                max_slots: slots,
                ..EngineOptions::default()
            };
            let mut engine = gpu(&store, options);
            engine.set_picture(s.clone());
            assert!(engine.image().is_none() && !engine.is_converged(), "{what}");
            let mut events = Vec::new();
            for _ in 0..MANY_TICKS {
                let report = engine.tick(&BUDGET).unwrap();
                let Some(event) = report.event else { continue };
                events.push(event);
                // Whatever is shown is whole: about as much of it is covered as in the end.
                let (now, end) = (coverage(engine.image().unwrap()), coverage(&rendered.image));
                assert!(
                    (now - end).abs() < 0.08,
                    "{what}: {now} of the picture is covered at {event:?}, in the end {end}"
                );
                if report.converged {
                    break;
                }
            }
            assert_eq!(events.last(), Some(&TickEvent::Converged), "{what}");
            assert!(
                events.contains(&TickEvent::Whole),
                "{what}: a coarse picture came first: {events:?}"
            );
            assert!(engine.is_converged(), "{what}");
            assert_same_bits(&rendered.image, engine.image().unwrap(), &what);
            let stats = engine.statistics().unwrap().unwrap();
            assert!(
                stats.converged && stats.first_complete_ms <= stats.converged_ms,
                "{what}: {stats:?}"
            );
            let again = engine.tick(&BUDGET).unwrap();
            assert_eq!(again.event, None, "{what}: nothing more to do");
        }
    }
}

/// A hook that waits before each read, and notes it.
fn noted(
    wait: impl Fn(BrickId) -> Duration + Send + Sync + 'static,
) -> (EngineOptions, Arc<Mutex<Vec<BrickId>>>) {
    let reads = Arc::new(Mutex::new(Vec::new()));
    let log = Arc::clone(&reads);
    let hook = move |brick| {
        std::thread::sleep(wait(brick));
        log.lock().unwrap().push(brick);
        Ok(())
    };
    let options = EngineOptions {
        read_hook: Some(ReadHookOption(Arc::new(hook))),
        decode_threads: 4,
        ..EngineOptions::default()
    };
    (options, reads)
}

/// 0 to 3 ms, another for each brick.
fn uneven(brick: BrickId) -> Duration {
    let mixed = (brick.xyz.x * 31 + brick.xyz.y * 17 + brick.xyz.z * 7 + u32::from(brick.lod.0))
        .wrapping_mul(2_654_435_769);
    Duration::from_micros(u64::from(mixed >> 20) % 3000)
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_slow_disk_and_any_order_of_arrival_change_nothing() {
    let store = phantom("phantom:body:200,180,210:u16");
    for mode in MODES {
        let s = small(&store, mode);
        let rendered = gpu(&store, EngineOptions::default()).render(&s).unwrap();
        let (options, reads) = noted(uneven);
        let mut engine = gpu(&store, options.clone());
        engine.set_picture(s.clone());
        let short = TickBudget {
            time: Duration::from_millis(1),
            ..BUDGET
        };
        let (events, _) = finish_by(&mut engine, &short);
        assert_same_bits(
            &rendered.image,
            engine.image().unwrap(),
            &format!("{}: live from a slow disk", mode.name()),
        );
        assert!(
            events.iter().filter(|e| **e == TickEvent::Refined).count() >= 2,
            "{}: the picture is refined while bricks come: {events:?}",
            mode.name()
        );
        let mut sorted = reads.lock().unwrap().clone();
        sorted.sort_unstable();
        let count = sorted.len();
        sorted.dedup();
        assert_eq!(count, sorted.len(), "no brick is read twice");
        let slow = gpu(&store, options).render(&s).unwrap();
        assert_same_bits(&rendered.image, &slow.image, mode.name());
    }
}

/// Bricks come late, in any order, and have to make room for others: drafts go around those that are missing.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_look_becomes_the_rendered_one() {
    let store = phantom("phantom:body:120,100,130:u16");
    let mut oracle = gpu(&store, EngineOptions::default());
    let (slow, _) = noted(uneven);
    let few = EngineOptions {
        max_slots: Some(9),
        ..slow.clone()
    };
    let short = TickBudget {
        time: Duration::from_millis(1),
        ..BUDGET
    };
    for (what, options) in [("a slow disk", slow), ("9 slots", few)] {
        let mut engine = gpu(&store, options);
        let mut missed = 0;
        for (look, s) in other_looks(&store) {
            engine.forget_bricks();
            engine.set_picture(s.clone());
            let mut is_missing = false;
            let ended = (0..MANY_TICKS).any(|_| {
                let report = engine.tick(&short).unwrap();
                is_missing |= report.missing_bricks > 0 && engine.image().is_some();
                report.converged
            });
            assert!(ended, "{look}, {what}: {MANY_TICKS} ticks and no end");
            missed += usize::from(is_missing);
            let rendered = oracle.render(&s).unwrap().image;
            let covered = coverage(&rendered);
            assert!(covered > 0.05, "{look}: something is seen: {covered}");
            let live = engine.image().unwrap();
            assert_same_bits(&rendered, live, &format!("{look}, {what}"));
        }
        assert!(
            missed > 8,
            "{what}: {missed} looks were shown with bricks missing"
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_brick_that_cannot_be_read_is_said_and_hangs_nothing() {
    let store = phantom("phantom:body:200,180,210:u16");
    let s = small(&store, Mode::Dvr);
    let rendered = gpu(&store, EngineOptions::default()).render(&s).unwrap();
    let finest = rendered.touched.iter().map(|b| b.lod).min().unwrap();
    fails_and_heals(&store, &s, &rendered, finest, 5);
    // The coarse picture that comes first, of level 2; the final one is of level 0.
    let larger = PictureSettings {
        size: [240, 200],
        lod_error: 0.5,
        ..s
    };
    let rendered = gpu(&store, EngineOptions::default())
        .render(&larger)
        .unwrap();
    fails_and_heals(&store, &larger, &rendered, Lod(2), 1);
}

fn fails_and_heals(
    store: &TestStore,
    s: &PictureSettings,
    rendered: &brickscope::engine::Picture,
    lod: Lod,
    nth: usize,
) {
    let of_level: Vec<BrickId> = store
        .store
        .bricks(lod)
        .filter(|&b| !store.store.entry(b).constant)
        .collect();
    let touched: Vec<BrickId> = rendered
        .touched
        .iter()
        .copied()
        .filter(|b| b.lod == lod)
        .collect();
    let is_final = !touched.is_empty();
    let broken = *if is_final { &touched } else { &of_level }
        .get(nth)
        .unwrap();
    let is_broken = Arc::new(std::sync::atomic::AtomicBool::new(true));
    let switch = Arc::clone(&is_broken);
    let was_asked = Arc::new(std::sync::atomic::AtomicBool::new(false));
    let asked = Arc::clone(&was_asked);
    let hook = move |brick| {
        if brick == broken {
            asked.store(true, std::sync::atomic::Ordering::SeqCst);
        }
        if brick == broken && switch.load(std::sync::atomic::Ordering::SeqCst) {
            return Err(StoreError::Io {
                path: "test.bsk".into(),
                doing: "read a brick (injected)",
                error: std::io::Error::other("bad sector"),
            });
        }
        Ok(())
    };
    let options = EngineOptions {
        read_hook: Some(ReadHookOption(Arc::new(hook))),
        ..EngineOptions::default()
    };
    let mut engine = gpu(store, options);
    if !is_final {
        // Only the first, coarse picture misses it: drafts go around it.
        engine.set_picture(s.clone());
        assert!(finish(&mut engine).1.converged, "{broken} is not needed");
        assert_same_bits(engine.image().unwrap(), &rendered.image, "without it");
        assert!(
            was_asked.load(std::sync::atomic::Ordering::SeqCst),
            "the coarse picture asked for {broken}"
        );
        return;
    }
    let error = engine.render(s).unwrap_err().to_string();
    assert!(
        error.contains("test.bsk") && error.contains("bad sector"),
        "the error says what and where: {error}"
    );
    engine.set_picture(s.clone());
    let (_, report) = finish(&mut engine);
    assert_eq!(report.event, Some(TickEvent::Failed));
    assert!(!report.converged && report.failed_bricks == 1, "{report:?}");
    let stands_in = difference(engine.image().unwrap(), &rendered.image, 0.0);
    assert!(
        stands_in.beyond > 0 && stands_in.mean < 0.02,
        "a coarser brick stands in for one: {stands_in}"
    );
    assert_eq!(
        engine.tick(&BUDGET).unwrap().event,
        None,
        "it is not tried again and again"
    );
    // The disk recovers; the next picture asks again.
    is_broken.store(false, std::sync::atomic::Ordering::SeqCst);
    assert_same_bits(&engine.render(s).unwrap().image, &rendered.image, "healed");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn what_is_hidden_or_empty_is_not_read() {
    // An opaque wall across the volume, noise behind it, nothing before it.
    let random: Vec<u32> = noise(192 * 64 * 64, 3).collect();
    let mut source = field([64, 192, 64], VoxelType::U8, |_| 0.0);
    for (i, byte) in source.bytes.iter_mut().enumerate() {
        let y = i / 64 % 192;
        *byte = match y {
            0..96 => 0,
            96..104 => 255,
            _ => (random[i] >> 16) as u8,
        };
    }
    let store = store_of(&mut source);
    for mode in [Mode::Iso, Mode::Dvr] {
        let mut s = settings(&store.store, mode);
        s.lod = LodChoice::Fixed(Lod(0));
        // From the side of low y.
        s.camera = Camera {
            eye: DVec3::new(31.0, -150.0, 31.0),
            target: DVec3::new(31.0, 0.0, 31.0),
            up: DVec3::Z,
            fov_y_degrees: 20.0,
            ..s.camera
        };
        s.opacity_cutoff = 0.95;
        let (options, reads) = noted(|_| Duration::ZERO);
        let picture = gpu(&store, options).render(&s).unwrap();
        assert!(coverage(&picture.image) > 0.3, "the wall is seen");
        let reads: BTreeSet<BrickId> = reads
            .lock()
            .unwrap()
            .iter()
            .copied()
            .filter(|b| b.lod == Lod(0))
            .collect();
        assert!(!reads.is_empty(), "{}: the wall is read", mode.name());
        for brick in &reads {
            // Bricks 0 to 2 are empty up to the wall's border, brick 3 holds the wall, 4 and 5 are behind it.
            assert!(
                (2..=3).contains(&brick.xyz.y),
                "{}: {brick} can't be seen",
                mode.name()
            );
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_new_classification_uploads_no_voxel() {
    let store = phantom("phantom:body:200,180,210:u16");
    let s = small(&store, Mode::Dvr);
    let mut engine = gpu(&store, EngineOptions::default());
    engine.set_picture(s.clone());
    finish(&mut engine);
    let before = engine.image().unwrap().clone();
    let mut other = s.classification.clone();
    // Less can be seen, and it looks different.
    other.transfer = scenes::transfer(&store.store, 0.3);
    engine.set_classification(other.clone());
    let (_, report) = finish(&mut engine);
    assert!(report.converged);
    let stats = engine.statistics().unwrap().unwrap();
    assert_eq!(stats.bytes_uploaded, Some(0), "{stats:?}");
    let changed = PictureSettings {
        classification: other,
        ..s
    };
    let rendered = gpu(&store, EngineOptions::default())
        .render(&changed)
        .unwrap();
    assert_same_bits(&rendered.image, engine.image().unwrap(), "the new picture");
    assert!(
        difference(&before, &rendered.image, TWIN_BOUND).beyond > 100,
        "it is another one"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_new_classification_uploads_no_voxel_of_any_look() {
    let store = phantom("phantom:body:120,100,130:u16");
    let mut engine = gpu(&store, EngineOptions::default());
    let mut oracle = gpu(&store, EngineOptions::default());
    for (look, s) in other_looks(&store) {
        engine.forget_bricks();
        engine.set_picture(s.clone());
        finish(&mut engine);
        let stats = engine.statistics().unwrap().unwrap();
        assert!(stats.bytes_uploaded > Some(0), "{look}: {stats:?}");
        let before = engine.image().unwrap().clone();
        let mut other = s.classification.clone();
        // No more can be seen, and it looks different.
        if s.mode.projects() {
            other.transfer.color = ColorCurve::new(
                vec![ColorPoint {
                    x: 0.0,
                    rgb: [0.2, 0.9, 0.5],
                }],
                ColorSpace::Rgb,
            )
            .unwrap();
        } else {
            other.transfer = scenes::transfer(&store.store, 0.3);
            // Mode xray asks for nothing else.
            other.opacity_unit_mm = other.opacity_unit_mm.map(|mm| mm / 2.0);
        }
        for surface in &mut other.iso {
            surface.opacity = surface.opacity.max(0.6);
            surface.color = Vec3::ONE - surface.color;
        }
        engine.set_classification(other.clone());
        finish(&mut engine);
        let stats = engine.statistics().unwrap().unwrap();
        assert_eq!(stats.bytes_uploaded, Some(0), "{look}: {stats:?}");
        let changed = PictureSettings {
            classification: other,
            ..s
        };
        let rendered = oracle.render(&changed).unwrap().image;
        assert_same_bits(&rendered, engine.image().unwrap(), look);
        let changed = difference(&before, &rendered, TWIN_BOUND).beyond;
        assert!(changed > 100, "{look}: {changed} pixels are others");
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn several_atlas_textures_hold_what_one_does_not() {
    let store = phantom("phantom:body:120,110,130:u8");
    for mode in MODES {
        let mut s = small(&store, mode);
        s.lod = LodChoice::Fixed(Lod(0));
        s.shading = Shading {
            model: ShadingModel::Phong,
            ..Shading::default()
        };
        let one = gpu(&store, EngineOptions::default()).render(&s).unwrap();
        let options = EngineOptions {
            // 3 × 3 × 3 slots.
            max_atlas_edge: 128,
            ..EngineOptions::default()
        };
        let several = gpu(&store, options).render(&s).unwrap();
        assert!(
            several.stats.atlas_slots > Some(27),
            "{}: more than one texture: {:?}",
            mode.name(),
            several.stats.atlas_slots
        );
        let d = difference(&one.image, &several.image, TWIN_BOUND);
        assert_eq!(d.beyond, 0, "{}: {d}", mode.name());
    }
}

#[test]
fn a_ramp_stays_a_ramp_at_every_level() {
    // Odd sizes: at the far edge a coarse voxel covers fewer fine ones.
    let dims = [150_u64, 131, 97];
    let value = |p: DVec3| 0.1 + 0.3 * p.x + 0.25 * p.y + 0.2 * p.z;
    let store = store_of(&mut field(dims, VoxelType::F32, value));
    let store = &store.store;
    for lod in 1..store.levels() as u8 {
        store.check_level(Lod(lod)).unwrap();
        let level = *store.level(Lod(lod));
        let voxels = VoxelField::new(store, Lod(lod), 64 << 20);
        let mut reader = voxels.reader();
        let mut random = noise(3000, u32::from(lod)).map(|v| f64::from(v) / f64::from(1 << 24));
        let mut checked = 0;
        while let (Some(x), Some(y), Some(z)) = (random.next(), random.next(), random.next()) {
            let fine = DVec3::new(x, y, z) * DVec3::from(dims.map(|n| n as f64));
            let at = fine / level.scale;
            // Not beyond the first centre, nor within a coarse voxel of the far edge.
            let whole = (DVec3::from(dims.map(|n| n as f64)) / level.scale).floor() - 1.0;
            if at.min_element() < 0.5 || at.cmpgt(whole).any() {
                continue;
            }
            checked += 1;
            let got = reader.trilinear(IVec3::ZERO, at.as_vec3());
            let expected = value(fine / DVec3::from(dims.map(|n| n as f64)));
            // The box filter of a ramp is the ramp; what is left is rounding of f32.
            assert!(
                (f64::from(got) - expected).abs() < 2e-5,
                "level {lod} at {fine}: {got}, expected {expected}"
            );
        }
        assert!(checked > 20, "level {lod}: {checked} places");
        assert!(reader.error.is_none(), "all bricks can be read");
    }
}

/// Random changes of everything, thousands of them, and the invariants after each.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn two_thousand_random_changes() {
    const CHANGES: usize = 2000;
    let store = phantom("phantom:body:120,100,130:u16");
    let bounds = volume_bounds(
        store.store.meta().dims,
        &store.store.meta().world_from_index,
    );
    let mut random = noise(CHANGES * 12, 11);
    let mut next = |below: u32| (random.next().unwrap() >> 4) % below;
    let mut engine = gpu(
        &store,
        EngineOptions {
            max_slots: Some(40),
            gpu_memory_bytes: Some(24 << 20),
            ..EngineOptions::default()
        },
    );
    let mut budget = 24 << 20;
    let mut oracle = gpu(&store, EngineOptions::default());
    let mut s = settings(&store.store, Mode::Dvr);
    s.size = [48, 40];
    let (mut converged, mut compared) = (0, 0);
    for change in 0..CHANGES {
        match next(6) {
            0 | 1 => {
                let place = Vec3::new(next(100) as f32, next(100) as f32, next(100) as f32) / 100.0;
                s.camera = if next(4) == 0 {
                    inside(
                        &store.store,
                        place.as_dvec3(),
                        place.zxy().as_dvec3() - DVec3::splat(0.45),
                    )
                } else {
                    let (azimuth, elevation) = (f64::from(next(360)), f64::from(next(160)) - 80.0);
                    let zoom = 0.6 + f64::from(next(30)) / 10.0;
                    Camera::orbit(&bounds, azimuth, elevation, zoom, 35.0).unwrap()
                };
            }
            2 => {
                let from = 0.1 + f64::from(next(34)) / 100.0;
                s.classification.transfer = scenes::transfer(&store.store, from);
            }
            3 => {
                s.mode = MODES[next(3) as usize];
                s.classification.iso[0].value = 200.0 + f64::from(next(3000));
            }
            4 => {
                s.lod_error = [0.3, 1.0, 3.0][next(3) as usize];
                s.step = [0.5, 1.0, 4.0][next(3) as usize];
            }
            _ if next(8) == 0 => {
                budget = [12 << 20, 16 << 20, 24 << 20, 64 << 20][next(4) as usize];
                engine.set_budgets(Some(budget), [1 << 20, 4 << 20, 64 << 20][next(3) as usize]);
            }
            _ => {
                // Of one kind to a software adapter, which would compile the shaders for each.
                s.size = [[48, 40], [33, 37], [120, 10]][next(3) as usize];
            }
        }
        engine.set_picture(s.clone());
        let tick = TickBudget {
            time: Duration::from_millis(u64::from(next(4))),
            upload_bytes: 1 << (10 + next(14)),
        };
        for _ in 0..next(4) {
            let report = engine.tick(&tick).unwrap();
            assert_eq!(report.failed_bricks, 0, "change {change}");
            assert_eq!(report.converged, engine.is_converged(), "change {change}");
        }
        let used = engine.statistics().unwrap().unwrap().gpu_bytes.unwrap_or(0);
        assert!(
            used <= budget,
            "change {change}: {used} bytes of {budget} on the device"
        );
        if change % 50 == 49 {
            finish(&mut engine);
            converged += 1;
            let expected: Image = oracle.render(&s).unwrap().image;
            let what = format!("change {change}: {:?} {:?} {:?}", s.mode, s.size, s.camera);
            if coverage(&expected) > 0.0 {
                assert_same_bits(&expected, engine.image().unwrap(), &what);
                compared += 1;
            }
        }
    }
    assert!(
        converged == CHANGES / 50 && compared * 4 > converged * 3,
        "{compared} of {converged} pictures show something"
    );
}

/// A moving picture's next views are there when they are drawn, if they were told and there was time; what the last frame was
/// drawn from stays.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn what_is_predicted_is_there_and_takes_nothing_away() {
    let store = phantom("phantom:body:200,180,210:u16");
    let bounds = volume_bounds(
        store.store.meta().dims,
        &store.store.meta().world_from_index,
    );
    for mode in [Mode::Iso, Mode::Dvr] {
        let mut base = PictureSettings {
            lod: LodChoice::Fixed(Lod(0)),
            ..small(&store, mode)
        };
        // The skin: other bricks from every side.
        base.classification.iso[0].value = 300.0;
        let view = |azimuth: f64| PictureSettings {
            camera: Camera::orbit(&bounds, azimuth, 10.0, 4.0, 10.0).unwrap(),
            ..base.clone()
        };
        let [here, there] = [0.0, 90.0].map(view);
        let missing = |told: &[Camera]| {
            // Fewer slots than bricks of all views together.
            let options = EngineOptions {
                max_slots: Some(200),
                ..EngineOptions::default()
            };
            let mut engine = gpu(&store, options);
            engine.predict(&base, told).unwrap();
            let first = engine.draw_moving(&here).unwrap();
            assert_eq!(first.stats.bricks_requested, Some(0), "all of it fits");
            // Ends by itself, when nothing more can be loaded.
            engine.page(Duration::from_secs(600)).unwrap();
            let again = engine.draw_moving(&here).unwrap();
            assert!(
                again.stand_ins == StandIns::default(),
                "{mode:?}: nothing is taken away"
            );
            assert_same_bits(&first.image, &again.image, mode.name());
            let moved = engine.draw_moving(&there).unwrap();
            let bricks: u64 = moved.stand_ins.bricks.values().sum();
            assert_eq!(Some(bricks), moved.stats.bricks_requested);
            assert_eq!(bricks > 0, moved.stand_ins.rays > 0, "who missed them");
            bricks
        };
        let (without, with) = (missing(&[]), missing(&[there.camera]));
        assert!(without > 0, "{mode:?}: else this says nothing");
        assert_eq!(with, 0, "{mode:?}: {without} are missing untold");
    }
}
