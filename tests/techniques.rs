//! Techniques against each other: however rays are walked, the picture is that of technique default and of the reference
//! (techniques.md, "What 'works' means"; design.md §2, invariants 1 and 2), with negative controls.
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

use std::num::NonZeroU32;
use std::time::Duration;

use brickscope::camera::Projection;
use brickscope::engine::{Engine, EngineOptions, Picture, TickBudget};
use brickscope::geom::Lod;
use brickscope::scene::{
    AntiAliasing, Image, Jitter, LayerStats, LodChoice, Mode, PictureSettings, SamplePattern,
    Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, assert_twins, by_comparison, coverage, difference};
use glam::Vec4;
use scenes::{
    TestStore, drawn, gpu, looks, phantom, reference, settings, through_levels, tick_to_end, waves,
    waves_of,
};

/// The techniques held against the default one.
const OTHERS: [Technique; 2] = [Technique::Multipass, Technique::Layers];

fn with(settings: &PictureSettings, technique: Technique) -> PictureSettings {
    PictureSettings {
        technique,
        ..settings.clone()
    }
}

fn passes_of(samples: u32) -> EngineOptions {
    EngineOptions {
        pass_samples: NonZeroU32::new(samples),
        ..EngineOptions::default()
    }
}

fn draw(engine: &mut Engine, settings: &PictureSettings, technique: Technique) -> Picture {
    engine.render(&with(settings, technique)).unwrap()
}

/// Draws with technique default and with the others, and holds them against each other, to the bit, and one of them against
/// the reference: the default's picture, then the others'.
fn check(
    engine: &mut Engine,
    store: &TestStore,
    settings: &PictureSettings,
    what: &str,
) -> [Picture; 3] {
    let default = draw(engine, settings, Technique::Default);
    let truth = reference(store, settings).image;
    assert!(coverage(&truth) > 0.05, "{what}: nearly empty");
    let allowed = by_comparison(settings.mode, truth.pixels.len());
    assert_twins(&default.image, &truth, allowed, what);
    let [multipass, layers] = OTHERS.map(|technique| {
        let picture = draw(engine, settings, technique);
        let what = format!("{what}, {}", technique.name());
        assert_same_bits(&picture.image, &default.image, &what);
        picture
    });
    [default, multipass, layers]
}

/// Every look over several levels, which change how rays are walked; some with parallel rays, which one piece of code makes
/// for all.
fn variants(store: &TestStore) -> Vec<(String, PictureSettings)> {
    let mut all = Vec::new();
    for (n, (look, s)) in looks(&store.store).into_iter().enumerate() {
        if n % 3 == 0 {
            let mut orthographic = s.clone();
            orthographic.camera.projection = Projection::Orthographic;
            all.push((format!("{look}, orthographic"), orthographic));
        }
        let levels = through_levels(store, s);
        all.push((format!("{look}, from inside at several levels"), levels));
    }
    all
}

/// Each look with one voxel type, each type with a third of the looks: a sample is read by one piece of code whatever is made
/// of it. (That the default is right in every look with every type is for tests/twin.rs to show.)
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_look_is_that_of_the_default() {
    let types = [VoxelType::U8, VoxelType::U16, VoxelType::F32];
    for (n, voxel_type) in types.into_iter().enumerate() {
        let store = waves(voxel_type);
        let mut engine = gpu(&store, EngineOptions::default());
        for (look, s) in looks(&store.store).into_iter().skip(n).step_by(types.len()) {
            check(&mut engine, &store, &s, &format!("{voxel_type} {look}"));
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_setting_gives_the_same_picture() {
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, passes_of(5));
    for (what, s) in variants(&store) {
        check(&mut engine, &store, &s, &what);
    }
}

/// The atlas has hardly room for one ray: rays wait, take turns, and are evicted from.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_smallest_atlas_gives_the_same_picture() {
    let store = waves_of([100, 70, 110], VoxelType::U16);
    let mut plenty = gpu(&store, EngineOptions::default());
    let options = EngineOptions {
        max_slots: Some(9),
        ..EngineOptions::default()
    };
    let mut small = OTHERS.map(|technique| (technique, gpu(&store, options.clone())));
    for (look, mut s) in looks(&store.store) {
        s.size = [48, 40];
        s.lod = LodChoice::Fixed(Lod(0));
        let whole = draw(&mut plenty, &s, Technique::Default);
        assert!(coverage(&whole.image) > 0.05, "{look}: nearly empty");
        for (technique, engine) in &mut small {
            let what = format!("{}, {look} with 9 slots", technique.name());
            let picture = draw(engine, &s, *technique);
            assert_same_bits(&picture.image, &whole.image, &what);
            assert!(
                picture.stats.bricks_evicted > Some(0),
                "{what}: bricks had to leave"
            );
        }
    }
}

/// Several rays per pixel, the second set of them from a list of pixels; and pictures of several tiles.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn super_sampling_and_tiles_give_the_same_picture() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut engine = gpu(&store, EngineOptions::default());
    let full = AntiAliasing::Full(SamplePattern::Two);
    let selective = AntiAliasing::Selective {
        pattern: SamplePattern::FourRotated,
        threshold: 0.05,
    };
    for mode in [Mode::Dvr, Mode::Iso, Mode::Mip] {
        for how in [full, selective] {
            let mut s = settings(&store.store, mode);
            s.classification.iso[0].value = 1500.0;
            s.size = [70, 60];
            s.anti_aliasing = how;
            let what = format!("{} {how:?}", mode.name());
            let rays = check(&mut engine, &store, &s, &what).map(|picture| picture.stats.rays);
            assert_eq!(rays, [rays[0]; 3], "{what}: rays");
            assert!(rays[0] > 70 * 60, "{what}: more than one per pixel");
        }
    }
    let mut wide = settings(&store.store, Mode::Dvr);
    wide.size = [1100, 24];
    wide.camera.fov_y_degrees = 0.7;
    check(&mut engine, &store, &wide, "two tiles");
}

/// By ticks: drafts of technique default, and in the end the same picture.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn ticks_give_the_same_picture() {
    let store = phantom("phantom:body:100,70,110:u16");
    let s = settings(&store.store, Mode::Dvr);
    let truth = drawn(&store, &s).image;
    for technique in OTHERS {
        let mut engine = gpu(&store, EngineOptions::default());
        engine.set_picture(with(&s, technique));
        let budget = TickBudget {
            time: Duration::from_millis(20),
            upload_bytes: 1 << 18,
        };
        tick_to_end(&mut engine, &budget);
        assert_same_bits(engine.image().unwrap(), &truth, technique.name());
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_samples_of_a_pass_change_nothing() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut looks = looks(&store.store);
    for (_, s) in &mut looks {
        s.size = [64, 64];
        s.classification.iso[0].value = 1500.0;
    }
    // What is known of blocks decides what is skipped: all engines know all, as to a mean all of them matter.
    let knowing = |options| {
        let mut engine = gpu(&store, options);
        let mut all = settings(&store.store, Mode::Mean);
        all.size = [64, 64];
        draw(&mut engine, &all, Technique::Basic);
        engine
    };
    let mut engine = knowing(EngineOptions::default());
    let defaults: Vec<Picture> = looks
        .iter()
        .map(|(_, s)| draw(&mut engine, s, Technique::Default))
        .collect();
    // The ends with every look, each look with one of those between.
    for (n, samples) in [3, 8, 64, 1, 100_000].into_iter().enumerate() {
        let mut engine = knowing(passes_of(samples));
        let pairs = looks.iter().zip(&defaults).enumerate();
        for (_, ((look, s), default)) in pairs.filter(|(k, _)| n > 2 || k % 3 == n) {
            let what = format!("{look}, {samples} samples a pass");
            let picture = draw(&mut engine, s, Technique::Multipass);
            assert_same_bits(&picture.image, &default.image, &what);
            let [a, b] = [default, &picture].map(|p| (p.stats.samples, p.stats.samples_skipped));
            if matches!(s.mode, Mode::Mip | Mode::MinIp) {
                // A brick is judged by the extreme so far: judged more often, it is left earlier.
                assert!(b.0 <= a.0, "{what}: {b:?} of {a:?} samples");
            } else {
                assert_eq!(a, b, "{what}: samples taken and skipped");
            }
            assert_eq!(
                default.stats.samples_contributing, picture.stats.samples_contributing,
                "{what}: contributing samples"
            );
        }
    }
}

/// The cells of a picture of one tile: those of the grid, with what they took.
fn cells(picture: &Picture) -> &LayerStats {
    let stats = picture.stats.layers.as_ref().unwrap();
    let [wide, high] = [picture.image.width, picture.image.height].map(|n| n.div_ceil(16));
    assert_eq!(stats.cells.len() as u32, wide * high, "every cell once");
    let sum: u64 = stats.cells.iter().map(|c| c.samples).sum();
    assert_eq!(sum, picture.stats.samples, "the cells' samples add up");
    stats
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn layers_take_every_sample_of_the_interval() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut engine = gpu(&store, EngineOptions::default());
    for mode in [Mode::Dvr, Mode::Gradient, Mode::Xray, Mode::Mean, Mode::Mip] {
        for jitter in [Jitter::None, Jitter::Interleaved] {
            let what = format!("{} {jitter:?}", mode.name());
            let mut s = settings(&store.store, mode);
            // Nothing ends a ray but the interval.
            (s.opacity_cutoff, s.jitter) = (1.0, jitter);
            s.size = [125, 120];
            let [basic, layers, default] =
                [Technique::Basic, Technique::Layers, Technique::Default]
                    .map(|t| draw(&mut engine, &s, t));
            let taken = layers.stats.samples;
            assert_eq!(
                taken + layers.stats.samples_skipped,
                basic.stats.samples,
                "{what}: inside the interval or outside"
            );
            assert!(
                default.stats.samples <= taken && taken <= basic.stats.samples,
                "{what}: no block of the interval is skipped"
            );
            if mode.composites() {
                assert!(
                    default.stats.samples < taken && taken < basic.stats.samples,
                    "{what}: {taken} samples"
                );
            }
            let stats = cells(&layers);
            assert!(stats.nodes > 0 && stats.passes > 1, "{what}: {stats:?}");
            for cell in &stats.cells {
                assert_eq!(cell.most, cell.layers, "{what}: as measured, {cell:?}");
            }
        }
    }
    assert!(
        engine
            .render(&settings(&store.store, Mode::Dvr))
            .unwrap()
            .stats
            .layers
            .is_none(),
        "another technique has no layers"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn rays_that_end_early_leave_their_layers() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso[0].value = 600.0;
    let mut engine = gpu(&store, passes_of(4));
    let picture = draw(&mut engine, &s, Technique::Layers);
    let stats = cells(&picture);
    assert!(
        stats.cells.iter().all(|c| c.most <= c.layers),
        "never more than measured"
    );
    let [taken, measured] = [
        stats.cells.iter().map(|c| u64::from(c.most)).sum::<u64>(),
        stats.cells.iter().map(|c| u64::from(c.layers)).sum::<u64>(),
    ];
    assert!(
        taken * 10 < measured * 9,
        "some cells have no ray that needs all layers: {taken} of {measured}"
    );
    assert!(
        picture.stats.samples < measured * 256 / 2,
        "most rays end early"
    );
}

/// What the tests above compare must see a cell that is dropped, and a ray that is left too early.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn negative_controls_fail() {
    let store = waves(VoxelType::U16);
    let s = settings(&store.store, Mode::Dvr);
    let mut engine = gpu(&store, EngineOptions::default());
    let whole = draw(&mut engine, &s, Technique::Multipass).image;
    let beyond = |image: &Image| difference(image, &whole, TWIN_BOUND).beyond;
    assert_eq!(
        beyond(&draw(&mut engine, &s, Technique::Layers).image),
        0,
        "the control's own control"
    );

    let mut dropped = whole.clone();
    for y in 64..80 {
        for x in 64..80 {
            dropped.pixels[y * 128 + x] = Vec4::ZERO;
        }
    }
    assert!(beyond(&dropped) > 200, "a dropped cell of 16×16 is seen");

    // One ray that has but the samples in front of the middle of the volume.
    let mut nearer = s.clone();
    nearer.opacity_cutoff = 0.3;
    let early = draw(&mut engine, &nearer, Technique::Multipass).image;
    let differing = |i: usize| {
        let mut one = whole.clone();
        one.pixels[i] = early.pixels[i];
        beyond(&one) == 1
    };
    let ended = (0..whole.pixels.len())
        .step_by(97)
        .filter(|&i| early.pixels[i] != whole.pixels[i])
        .collect::<Vec<_>>();
    assert!(ended.len() > 20, "rays end earlier: {}", ended.len());
    for i in ended {
        assert!(differing(i), "ray {i} that ends early is seen");
    }
}
