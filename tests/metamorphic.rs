//! Tier 4: what must not change a picture doesn't, to the bit: skipping, the mesh, the place of bricks in the atlas
//! (design.md §2, invariants 1 and 4; §5; §6).
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

use brickscope::camera::{Camera, Projection};
use brickscope::classify::{OpacityCurve, OpacityPoint};
use brickscope::engine::{Engine, EngineOptions, Picture, SampleFilter};
use brickscope::geom::Lod;
use brickscope::scene::{
    GradientFilter, Jitter, LodChoice, Mode, PictureSettings, Shading, ShadingModel, Technique,
    TransferMode,
};
use brickscope::volume::VoxelType;
use compare::{assert_equal_bits, assert_same_bits, coverage, difference};
use glam::{DAffine3, DVec3};
use memory_source::noise;
use scenes::{
    TestStore, field, gpu, inside, looks, many_levels, oblique, phantom, settings, speckle,
    store_of, translucent_surfaces,
};

/// What is drawn from many cameras, and under every size of the atlas; [`other_looks`] from few.
const MODES: [Mode; 3] = [Mode::Dvr, Mode::Iso, Mode::Mip];

/// All looks but those of [`MODES`].
fn other_looks(store: &TestStore) -> Vec<(&'static str, PictureSettings)> {
    let mut looks = looks(&store.store);
    looks.retain(|(look, _)| MODES.iter().all(|mode| mode.name() != *look));
    looks
}

/// Skipping on and off in one engine, one pipeline. Returns the share of the picture that shows something.
fn check_skipping(engine: &mut Engine, settings: &PictureSettings, what: &str) -> f64 {
    coverage(&skipping(engine, settings, what).image)
}

/// As [`check_skipping`]; returns the picture drawn with skipping.
fn skipping(engine: &mut Engine, settings: &PictureSettings, what: &str) -> Picture {
    let mut plain = settings.clone();
    plain.technique = Technique::Basic;
    let (skipping, plain) = (
        engine.render(settings).unwrap(),
        engine.render(&plain).unwrap(),
    );
    assert_equal_bits(&skipping.image, &plain.image, what);
    assert!(
        skipping.stats.samples <= plain.stats.samples,
        "{what}: skipping takes no more samples"
    );
    assert_eq!(
        skipping.stats.samples_contributing, plain.stats.samples_contributing,
        "{what}: what is skipped would not have changed the picture"
    );
    skipping
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn speckle_with_mesh_is_speckle_without_from_100_cameras() {
    let store = speckle(23, oblique());
    let mut engine = gpu(&store, EngineOptions::default());
    let mut random = noise(100 * 6, 42).map(|v| f64::from(v) / f64::from(1 << 24));
    let mut next = |low: f64, high: f64| low + (high - low) * random.next().expect("enough noise");
    let mut covered = 0.0;
    for i in 0..100 {
        let mode = MODES[i % 3];
        let mut s = settings(&store.store, mode);
        s.size = [72, 56];
        s.step = [0.5, 1.0, 5.0][i / 3 % 3];
        let (place, direction) = (
            DVec3::new(next(0.0, 1.0), next(0.0, 1.0), next(0.0, 1.0)),
            DVec3::new(next(-1.0, 1.0), next(-1.0, 1.0), next(-1.0, 1.0)),
        );
        if i % 2 == 0 {
            s.camera = inside(&store.store, place, direction);
        } else {
            let bounds = brickscope::scene::volume_bounds(store.store.meta().dims, &oblique());
            s.camera = Camera::orbit(
                &bounds,
                place.x * 360.0,
                direction.y * 89.0,
                0.7 + place.z * 4.0,
                40.0,
            )
            .unwrap();
            if i % 4 == 1 {
                s.camera.projection = Projection::Orthographic;
            }
        }
        covered += check_skipping(
            &mut engine,
            &s,
            &format!("camera {i}, {}, step {}", mode.name(), s.step),
        );
    }
    assert!(
        covered / 100.0 > 0.3,
        "the cameras see something: {covered} %"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_mirrored_affine_keeps_front_faces_in_front() {
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let store = speckle(200, mirrored);
    let mut engine = gpu(&store, EngineOptions::default());
    for mode in MODES {
        let mut s = settings(&store.store, mode);
        s.step = 1.0;
        assert!(
            check_skipping(&mut engine, &s, mode.name()) > 0.02,
            "something is seen"
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn skipping_changes_nothing_in_a_body() {
    let store = phantom("phantom:body:120,80,130:u16");
    for filter in [SampleFilter::Exact, SampleFilter::Hardware] {
        let mut engine = gpu(
            &store,
            EngineOptions {
                filter,
                ..EngineOptions::default()
            },
        );
        for mode in MODES {
            for (model, step) in [(ShadingModel::None, 0.5), (ShadingModel::Phong, 2.5)] {
                let mut s = settings(&store.store, mode);
                s.shading = Shading {
                    model,
                    ..Shading::default()
                };
                s.step = step;
                let covered = check_skipping(
                    &mut engine,
                    &s,
                    &format!("{filter:?} {} step {step}", mode.name()),
                );
                assert!(covered > 0.05, "something is seen: {covered}");
                s.camera = inside(
                    &store.store,
                    DVec3::new(0.5, 0.5, 0.6),
                    DVec3::new(0.2, -1.0, 0.1),
                );
                check_skipping(
                    &mut engine,
                    &s,
                    &format!("{filter:?} {} step {step} inside", mode.name()),
                );
            }
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn skipping_changes_no_look() {
    let store = phantom("phantom:body:120,80,130:u16");
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, mut s) in other_looks(&store) {
        s.size = [72, 56];
        for step in [s.step, 5.0] {
            s.step = step;
            let what = format!("{look}, step {step}");
            let covered = check_skipping(&mut engine, &s, &what);
            assert!(covered > 0.02, "{what}: something is seen: {covered}");
        }
        s.camera = inside(
            &store.store,
            DVec3::new(0.5, 0.5, 0.6),
            DVec3::new(0.2, -1.0, 0.1),
        );
        check_skipping(&mut engine, &s, &format!("{look} from inside"));
    }
}

/// Values of which only some between 0 and 255 show, which no voxel has: a segment from one to the other crosses them.
fn peak(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    let meta = store.store.meta();
    let at = |stored| meta.rescale.physical(stored);
    s.classification.transfer.opacity = OpacityCurve::new(vec![
        OpacityPoint::linear(at(122.0), 0.0),
        OpacityPoint::linear(at(127.5), 0.9),
        OpacityPoint::linear(at(133.0), 0.0),
    ])
    .unwrap();
    s
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn skipping_leaves_what_lies_between_two_samples() {
    let blobs = speckle(150, oblique());
    // Two bricks long each: most blocks are of one value.
    let slabs = store_of(&mut field([40, 200, 40], VoxelType::U8, |p| {
        f64::from((p.y * 3.125) as u32 % 2)
    }));
    for (scene, store) in [("blobs", &blobs), ("slabs", &slabs)] {
        let mut segments = peak(store, Mode::Dvr);
        segments.classification.transfer_mode = TransferMode::Preintegrated;
        let mut lit = segments.clone();
        lit.shading.model = ShadingModel::Phong;
        lit.shading.gradient = GradientFilter::Filtered;
        let mut surfaces = settings(&store.store, Mode::Iso);
        surfaces.classification.iso = translucent_surfaces(&store.store);
        let mut gradient = settings(&store.store, Mode::Gradient);
        gradient.shading.gradient = GradientFilter::Filtered;
        // Long steps of all rays together would miss the slabs' sides.
        gradient.jitter = Jitter::Interleaved;
        let mut engine = gpu(store, EngineOptions::default());
        for (look, mut s) in [
            ("segments", segments),
            ("lit segments", lit),
            ("surfaces", surfaces),
            ("filtered gradients", gradient),
        ] {
            s.size = [72, 56];
            s.lod = LodChoice::Fixed(Lod(0));
            s.camera = inside(
                &store.store,
                DVec3::new(0.5, -0.1, 0.5),
                DVec3::new(0.1, 1.0, 0.05),
            );
            for step in [1.0, 4.0, 40.0] {
                s.step = step;
                let what = format!("{scene}, {look}, step {step}");
                let picture = skipping(&mut engine, &s, &what);
                let covered = coverage(&picture.image);
                assert!(covered > 0.005, "{what}: something is seen: {covered}");
                assert!(
                    picture.stats.samples_skipped > picture.stats.samples / 3,
                    "{what}: and skipped"
                );
            }
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_place_in_the_atlas_changes_no_look() {
    let store = phantom("phantom:marschner-lobb:100,90,80:u16");
    let mut engines = [0, 1].map(|slot_order_seed| {
        let options = EngineOptions {
            slot_order_seed,
            ..EngineOptions::default()
        };
        gpu(&store, options)
    });
    for (look, mut s) in other_looks(&store) {
        s.size = [72, 56];
        let [plain, shuffled] = engines
            .each_mut()
            .map(|engine| engine.render(&s).unwrap().image);
        let covered = coverage(&plain);
        assert!(covered > 0.05, "{look}: something is seen: {covered}");
        assert_same_bits(&plain, &shuffled, &format!("{look}, shuffled slots"));
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_place_in_the_atlas_changes_nothing() {
    let store = phantom("phantom:marschner-lobb:100,90,80:u16");
    let bytes = phantom("phantom:body:100,90,80:u8");
    for (store, mode) in [
        (&store, Mode::Dvr),
        (&store, Mode::Iso),
        (&bytes, Mode::Dvr),
        (&bytes, Mode::Mip),
    ] {
        for filter in [SampleFilter::Exact, SampleFilter::Hardware] {
            let s = settings(&store.store, mode);
            let pictures = [0, 1, 2].map(|slot_order_seed| {
                let options = EngineOptions {
                    filter,
                    slot_order_seed,
                    ..EngineOptions::default()
                };
                gpu(store, options).render(&s).unwrap().image
            });
            assert!(coverage(&pictures[0]) > 0.05, "something is seen");
            for other in &pictures[1..] {
                assert_same_bits(
                    &pictures[0],
                    other,
                    &format!("{filter:?} {} shuffled slots", mode.name()),
                );
            }
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_missing_block_is_seen() {
    // The control of the tests above: one 4³ block less must change the picture.
    let (with, without) = (
        speckle(200, DAffine3::IDENTITY),
        speckle(201, DAffine3::IDENTITY),
    );
    let s = settings(&with.store, Mode::Dvr);
    let draw = |store: &TestStore| {
        gpu(store, EngineOptions::default())
            .render(&s)
            .unwrap()
            .image
    };
    assert!(
        difference(&draw(&with), &draw(&without), 0.0).beyond > 0,
        "other blocks, other picture"
    );
}

/// The picture under an atlas of `slots` slots, and what it took.
fn under(store: &TestStore, settings: &PictureSettings, slots: Option<u64>) -> Picture {
    let options = EngineOptions {
        max_slots: slots,
        slot_order_seed: slots.unwrap_or(0),
        ..EngineOptions::default()
    };
    gpu(store, options).render(settings).unwrap()
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn any_atlas_gives_the_same_picture() {
    let store = phantom("phantom:body:200,180,210:u16");
    for mode in MODES {
        for (model, step, technique) in [
            (ShadingModel::None, 0.5, Technique::Default),
            (ShadingModel::Phong, 2.5, Technique::Default),
            (ShadingModel::Phong, 5.0, Technique::Basic),
        ] {
            let mut s = settings(&store.store, mode);
            s.size = [96, 80];
            s.lod = LodChoice::Fixed(Lod(0));
            s.step = step;
            s.technique = technique;
            s.shading = Shading {
                model,
                ..Shading::default()
            };
            let whole = under(&store, &s, None);
            let seen = coverage(&whole.image);
            assert!(seen > 0.02, "{} {model:?} step {step}: {seen}", mode.name());
            assert_eq!(whole.stats.bricks_evicted, Some(0), "everything fits");
            for slots in [9, 64, 512] {
                let what = format!("{} {model:?} step {step}, {slots} slots", mode.name());
                let small = under(&store, &s, Some(slots));
                assert!(small.stats.atlas_slots <= Some(slots), "{what}");
                assert_same_bits(&whole.image, &small.image, &what);
                if slots == 9 {
                    assert!(small.stats.bricks_evicted > Some(0), "{what}: evicts");
                }
            }
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_smallest_atlas_gives_every_look() {
    let store = phantom("phantom:body:120,100,130:u16");
    let mut whole = gpu(&store, EngineOptions::default());
    let mut small = gpu(
        &store,
        EngineOptions {
            max_slots: Some(9),
            slot_order_seed: 9,
            ..EngineOptions::default()
        },
    );
    for (look, mut s) in other_looks(&store) {
        s.size = [40, 32];
        // From afar, and from a place that sees several levels.
        let near = many_levels(&store, s.mode);
        let near = PictureSettings {
            camera: near.camera,
            lod_error: near.lod_error,
            ..s.clone()
        };
        s.lod = LodChoice::Fixed(Lod(0));
        for (what, s) in [("level 0", s), ("several levels", near)] {
            let what = format!("{look}, {what}, 9 slots");
            let all = whole.render(&s).unwrap().image;
            let few = small.render(&s).unwrap();
            let covered = coverage(&all);
            assert!(covered > 0.05, "{what}: something is seen: {covered}");
            assert!(few.stats.bricks_evicted > Some(0), "{what}: evicts");
            assert_same_bits(&all, &few.image, &what);
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn several_levels_in_one_picture_under_any_atlas() {
    let store = phantom("phantom:body:200,180,210:u16");
    for mode in MODES {
        let s = many_levels(&store, mode);
        let whole = under(&store, &s, None);
        assert!(
            coverage(&whole.image) > 0.05,
            "{}: something is seen",
            mode.name()
        );
        for slots in [9, 64] {
            let what = format!("{}, {slots} slots", mode.name());
            assert_same_bits(&whole.image, &under(&store, &s, Some(slots)).image, &what);
        }
        let mut plain = s.clone();
        plain.technique = Technique::Basic;
        let plain = under(&store, &plain, None);
        assert_same_bits(
            &whole.image,
            &plain.image,
            &format!("{}: skipping", mode.name()),
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn fewer_slots_than_a_ray_may_need_are_refused_with_both_numbers() {
    let store = phantom("phantom:body:200,180,210:u16");
    let options = EngineOptions {
        max_slots: Some(8),
        ..EngineOptions::default()
    };
    let error = gpu(&store, options)
        .render(&settings(&store.store, Mode::Dvr))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("up to 9 bricks") && error.contains("but 8 fit"),
        "{error}"
    );
}
