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

use brickscope::camera::Projection;
use brickscope::engine::{Engine, EngineOptions, Picture, TickBudget};
use brickscope::geom::Lod;
use brickscope::scene::{
    AntiAliasing, Image, Jitter, LayerStats, LodChoice, Mode, PictureSettings, SamplePattern,
    Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, assert_twins, coverage, difference};
use glam::{DVec3, Vec4};
use scenes::{
    TestStore, field, gpu, inside, looks, oblique, phantom, reference, settings, store_of,
};

/// A field with structure at every scale and with empty regions, over several bricks in each axis.
fn waves(voxel_type: VoxelType) -> TestStore {
    waves_of([70, 45, 52], voxel_type)
}

fn waves_of(dims: [u64; 3], voxel_type: VoxelType) -> TestStore {
    let mut source = field(dims, voxel_type, |p| {
        let r = (p - 0.5).length();
        0.5 + 0.5 * (r * 19.0).cos() * (1.0 - r) + 0.1 * (p.x * 40.0).sin() * (p.y * 31.0).cos()
    });
    source.desc.world_from_index = oblique();
    store_of(&mut source)
}

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

/// Draws with technique default and with `technique`, and holds them against each other, to the bit, and one of them against the
/// reference.
fn check(
    engine: &mut Engine,
    store: &TestStore,
    settings: &PictureSettings,
    technique: Technique,
    what: &str,
) -> [Picture; 2] {
    let pictures = [Technique::Default, technique].map(|t| draw(engine, settings, t));
    let truth = reference(store, settings).image;
    assert!(coverage(&truth) > 0.05, "{what}: nearly empty");
    assert_same_bits(&pictures[0].image, &pictures[1].image, what);
    // As in tests/twin.rs: where a value is within rounding of the iso-value, bisection may go the other way.
    let by_comparison = if settings.mode == Mode::Iso {
        truth.pixels.len() / 1000
    } else {
        0
    };
    assert_twins(&pictures[1].image, &truth, by_comparison, what);
    pictures
}

/// Every look under several settings that change how rays are walked.
fn variants(store: &TestStore) -> Vec<(String, PictureSettings)> {
    let mut all = Vec::new();
    for (look, s) in looks(&store.store) {
        let mut orthographic = s.clone();
        orthographic.camera.projection = Projection::Orthographic;
        all.push((format!("{look}, orthographic"), orthographic));
        let mut levels = s.clone();
        levels.camera = inside(
            &store.store,
            DVec3::new(0.45, 0.2, 0.5),
            DVec3::new(0.3, 1.0, 0.2),
        );
        levels.lod_error = 12.0;
        all.push((format!("{look}, from inside at several levels"), levels));
        all.push((look.to_owned(), s));
    }
    all
}

/// Every look with every kind of atlas.
fn every_look(technique: Technique) {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        let mut engine = gpu(&store, EngineOptions::default());
        for (look, s) in looks(&store.store) {
            let what = format!("{}, {voxel_type} {look}", technique.name());
            check(&mut engine, &store, &s, technique, &what);
        }
    }
}

fn every_variant(technique: Technique) {
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, passes_of(5));
    for (look, s) in variants(&store) {
        let what = format!("{}, {look}", technique.name());
        check(&mut engine, &store, &s, technique, &what);
    }
}

/// The atlas has hardly room for one ray: rays wait, take turns, and are evicted from.
fn smallest_atlas(technique: Technique) {
    let store = waves_of([100, 70, 110], VoxelType::U16);
    for (look, mut s) in looks(&store.store) {
        s.size = [48, 40];
        s.lod = LodChoice::Fixed(Lod(0));
        let options = EngineOptions {
            max_slots: Some(9),
            ..EngineOptions::default()
        };
        let small = draw(&mut gpu(&store, options), &s, technique);
        let whole = draw(
            &mut gpu(&store, EngineOptions::default()),
            &s,
            Technique::Default,
        );
        let what = format!("{}, {look} with 9 slots", technique.name());
        assert!(coverage(&whole.image) > 0.05, "{what}: nearly empty");
        assert_same_bits(&whole.image, &small.image, &what);
        assert!(
            small.stats.bricks_evicted > Some(0),
            "{what}: bricks had to leave"
        );
    }
}

/// Several rays per pixel, the second set of them from a list of pixels; and pictures of several tiles.
fn super_sampled(technique: Technique) {
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
            let what = format!("{}, {} {how:?}", technique.name(), mode.name());
            let [default, other] = check(&mut engine, &store, &s, technique, &what);
            assert_eq!(default.stats.rays, other.stats.rays, "{what}: rays");
            assert!(
                other.stats.rays > 70 * 60,
                "{what}: more than one per pixel"
            );
        }
    }
    let mut wide = settings(&store.store, Mode::Dvr);
    wide.size = [1100, 24];
    wide.camera.fov_y_degrees = 0.7;
    check(&mut engine, &store, &wide, technique, "two tiles");
}

/// By ticks: drafts of technique default, and in the end the same picture.
fn by_ticks(technique: Technique) {
    let store = phantom("phantom:body:100,70,110:u16");
    let s = settings(&store.store, Mode::Dvr);
    let mut engine = gpu(&store, EngineOptions::default());
    let truth = draw(&mut engine, &s, Technique::Default).image;
    let mut engine = gpu(&store, EngineOptions::default());
    engine.set_picture(with(&s, technique));
    let budget = TickBudget {
        time: std::time::Duration::from_millis(20),
        upload_bytes: 1 << 18,
    };
    let ended = (0..20_000).any(|_| engine.tick(&budget).unwrap().converged);
    assert!(ended, "{}: 20 000 ticks and no end", technique.name());
    assert_same_bits(&truth, engine.image().unwrap(), technique.name());
}

mod multipass {
    use super::*;

    const TECHNIQUE: Technique = Technique::Multipass;

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn every_look_is_that_of_the_default() {
        every_look(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn every_setting_gives_the_same_picture() {
        every_variant(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn the_smallest_atlas_gives_the_same_picture() {
        smallest_atlas(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn super_sampling_and_tiles_give_the_same_picture() {
        super_sampled(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn ticks_give_the_same_picture() {
        by_ticks(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn the_samples_of_a_pass_change_nothing() {
        let store = phantom("phantom:body:100,70,110:u16");
        for (look, mut s) in looks(&store.store) {
            s.size = [64, 64];
            s.classification.iso[0].value = 1500.0;
            let mut engine = gpu(&store, EngineOptions::default());
            // What is known of blocks decides what is skipped: both know all.
            draw(&mut engine, &s, Technique::Default);
            let default = draw(&mut engine, &s, Technique::Default);
            for samples in [1, 3, 8, 64, 100_000] {
                let what = format!("{look}, {samples} samples a pass");
                let mut engine = gpu(&store, passes_of(samples));
                draw(&mut engine, &s, Technique::Default);
                let picture = draw(&mut engine, &s, TECHNIQUE);
                assert_same_bits(&default.image, &picture.image, &what);
                let [a, b] =
                    [&default, &picture].map(|p| (p.stats.samples, p.stats.samples_skipped));
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
}

mod layers {
    use super::*;

    const TECHNIQUE: Technique = Technique::Layers;

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn every_look_is_that_of_the_default() {
        every_look(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn every_setting_gives_the_same_picture() {
        every_variant(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn the_smallest_atlas_gives_the_same_picture() {
        smallest_atlas(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn super_sampling_and_tiles_give_the_same_picture() {
        super_sampled(TECHNIQUE);
    }

    #[test]
    #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
    fn ticks_give_the_same_picture() {
        by_ticks(TECHNIQUE);
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
    fn every_sample_of_the_interval_is_taken() {
        let store = phantom("phantom:body:100,70,110:u16");
        let mut engine = gpu(&store, EngineOptions::default());
        for mode in [Mode::Dvr, Mode::Gradient, Mode::Xray, Mode::Mean, Mode::Mip] {
            for jitter in [Jitter::None, Jitter::Interleaved] {
                let what = format!("{} {jitter:?}", mode.name());
                let mut s = settings(&store.store, mode);
                // Nothing ends a ray but the interval.
                (s.opacity_cutoff, s.jitter) = (1.0, jitter);
                s.size = [125, 120];
                let [basic, layers, default] = [Technique::Basic, TECHNIQUE, Technique::Default]
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
        let picture = draw(&mut engine, &s, TECHNIQUE);
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
