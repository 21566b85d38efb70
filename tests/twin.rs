//! Tier 3: the GPU caster against the CPU reference, pixel by pixel in f32 (design.md §2, invariant 1), with negative
//! controls: what must not pass doesn't.
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

use brickscope::camera::Projection;
use brickscope::engine::{Engine, EngineOptions, SampleFilter};
use brickscope::geom::Lod;
use brickscope::scene::{
    Image, Interpolation, LodChoice, Mode, PictureSettings, PictureStats, Shading, ShadingModel,
    Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_twins, by_comparison, coverage, difference};
use glam::DVec3;
use scenes::{
    TestStore, drawn, field, gpu, inside, looks, phantom, reference, settings, store_of,
    through_levels, waves,
};

/// Draws on both, compares, and demands that there is something to compare. The GPU's picture.
fn check(
    engine: &mut Engine,
    store: &TestStore,
    settings: &PictureSettings,
    allowed: usize,
    what: &str,
) -> Image {
    let gpu = engine.render(settings).unwrap().image;
    let cpu = reference(store, settings).image;
    let covered = coverage(&cpu);
    assert!(
        covered > 0.05,
        "{what}: the picture is nearly empty ({covered})"
    );
    let allowed = allowed + by_comparison(settings.mode, cpu.pixels.len());
    assert_twins(&gpu, &cpu, allowed, what);
    gpu
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_voxel_type_and_mode_matches_the_reference() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        let mut engine = gpu(&store, EngineOptions::default());
        for (look, s) in looks(&store.store) {
            check(&mut engine, &store, &s, 0, &format!("{voxel_type} {look}"));
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_setting_matches_the_reference() {
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    let mut check = |s: &PictureSettings, allowed, what: &str| {
        check(&mut engine, &store, s, allowed, what);
    };
    let of = |mode| settings(&store.store, mode);
    let phong = |mut s: PictureSettings| {
        s.shading = Shading {
            model: ShadingModel::Phong,
            ..Shading::default()
        };
        s
    };
    check(&phong(of(Mode::Dvr)), 0, "shaded dvr");
    let mut side_light = phong(of(Mode::Dvr));
    side_light.shading.light = Some(DVec3::new(1.0, 0.5, -0.3));
    check(&side_light, 0, "dvr lit from the side");
    for (look, mut of_look) in looks(&store.store) {
        // Half of the pixels of the pictures above are enough of each; of the same level.
        of_look.size = [96, 80];
        of_look.lod = LodChoice::Fixed(Lod(0));
        let mut s = of_look.clone();
        s.camera.projection = Projection::Orthographic;
        check(&s, 0, &format!("orthographic {look}"));
        let mut s = of_look.clone();
        s.lod = LodChoice::Auto;
        s.camera = inside(
            &store.store,
            DVec3::new(0.45, 0.55, 0.5),
            DVec3::new(0.3, 1.0, 0.2),
        );
        check(&s, 0, &format!("{look} from inside"));
        let mut s = of_look.clone();
        s.interpolation = Interpolation::Nearest;
        // A sample on the very face between two voxels may take either: rounding of 1e-5 voxel decides.
        check(&s, 16, &format!("{look} nearest"));
        let mut s = of_look;
        s.lod = LodChoice::Fixed(Lod(1));
        check(&s, 0, &format!("{look} at level 1"));
    }
    let mut coarse = of(Mode::Iso);
    (coarse.step, coarse.refine) = (3.0, false);
    check(&coarse, 0, "iso at step 3, not refined");
    // Wider than a tile: the seam between tiles must not show.
    let mut wide = of(Mode::Dvr);
    wide.size = [1100, 24];
    wide.camera.fov_y_degrees = 0.7;
    check(&wide, 0, "two tiles");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn several_levels_in_one_picture_match_the_reference() {
    let store = waves(VoxelType::U16);
    let mut whole = gpu(&store, EngineOptions::default());
    for (look, s) in looks(&store.store) {
        let mut s = through_levels(&store, s);
        // Where surfaces end rays, coarser levels must begin nearer.
        if s.classification.iso.len() > 1 {
            s.lod_error = 120.0;
        }
        let what = format!("{look} at several levels");
        // With fresh caches: every level comes as this picture asks for it.
        let mut fresh = gpu(&store, EngineOptions::default());
        let levels = check(&mut fresh, &store, &s, 0, &what);
        s.lod = LodChoice::Fixed(Lod(0));
        let one = whole.render(&s).unwrap().image;
        assert!(
            difference(&levels, &one, TWIN_BOUND).beyond > 100,
            "{what}: not only level 0"
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn sharp_edges_match_the_reference() {
    let store = phantom("phantom:body:100,70,110:u8");
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, mut s) in looks(&store.store) {
        s.classification.iso[0].value = 150.3;
        check(&mut engine, &store, &s, 0, &format!("body {look}"));
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn without_optional_features_pictures_match_too() {
    for voxel_type in [VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        let s = settings(&store.store, Mode::Dvr);
        let truth = reference(&store, &s).image;
        for filter in [SampleFilter::Exact, SampleFilter::Hardware] {
            let options = EngineOptions {
                filter,
                use_optional_features: false,
                ..EngineOptions::default()
            };
            let gpu = gpu(&store, options).render(&s).unwrap();
            let what = format!("bare {voxel_type} {filter:?}");
            assert_twins(&gpu.image, &truth, 0, &what);
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_hardware_filter_is_close() {
    // Its weights are coarse: up to 2.7e-3 of the range per sample on lavapipe's R8 (design.md §5).
    let store = waves(VoxelType::U8);
    let options = EngineOptions {
        filter: SampleFilter::Hardware,
        ..EngineOptions::default()
    };
    let s = settings(&store.store, Mode::Mip);
    let gpu = gpu(&store, options).render(&s).unwrap();
    let d = difference(&gpu.image, &reference(&store, &s).image, 0.02);
    assert!(d.beyond == 0, "hardware filter: {d}");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn sample_counts_are_those_of_the_reference() {
    let store = phantom("phantom:body:100,70,110:u16");
    for mode in [Mode::Dvr, Mode::Mip] {
        let mut s = settings(&store.store, mode);
        s.opacity_cutoff = 1.0;
        s.technique = Technique::Basic;
        let (gpu, cpu) = (drawn(&store, &s).stats, reference(&store, &s).stats);
        assert_eq!(
            gpu.samples,
            cpu.samples,
            "{}: samples without skipping",
            mode.name()
        );
        assert_contributing(&gpu, &cpu, mode);
        s.technique = Technique::Default;
        let skipping = drawn(&store, &s).stats;
        assert_eq!(
            skipping.samples + skipping.samples_skipped,
            cpu.samples,
            "{}: every sample is either taken or skipped",
            mode.name()
        );
        assert!(
            skipping.samples < cpu.samples / 2,
            "{}: skipping skips the air",
            mode.name()
        );
    }
}

/// Whether a sample contributes is decided by comparing, which rounding may turn in one of a thousand.
fn assert_contributing(gpu: &PictureStats, cpu: &PictureStats, mode: Mode) {
    let of = |stats: &PictureStats| stats.samples_contributing.unwrap();
    let (gpu, cpu) = (of(gpu), of(cpu));
    assert!(
        cpu > 1000 && gpu.abs_diff(cpu) <= cpu / 1000,
        "{}: {gpu} contributing samples, the reference counts {cpu}",
        mode.name()
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn surfaces_are_hit_as_often_as_by_the_reference() {
    let store = phantom("phantom:body:100,70,110:u16");
    let mut s = settings(&store.store, Mode::Iso);
    s.size = [96, 96];
    let truth = reference(&store, &s).stats;
    for technique in [Technique::Basic, Technique::Default] {
        s.technique = technique;
        assert_contributing(&drawn(&store, &s).stats, &truth, Mode::Iso);
    }
}

/// What each control changes; all must be seen by the comparison that the tests above trust.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn negative_controls_fail() {
    let value =
        |p: DVec3| 0.5 + 0.5 * ((p - 0.5).length() * 19.0).cos() * (1.0 - (p - 0.5).length());
    let dims = [70_u64, 45, 52];
    let plain = store_of(&mut field(dims, VoxelType::U16, value));
    let s = settings(&plain.store, Mode::Dvr);
    let truth = reference(&plain, &s).image;
    let beyond = |image: &Image| difference(image, &truth, TWIN_BOUND).beyond;
    let mut engine = gpu(&plain, EngineOptions::default());
    let mut right = engine.render(&s).unwrap().image;
    assert_eq!(beyond(&right), 0, "the control's own control");

    let shifted = store_of(&mut field(dims, VoxelType::U16, |p| {
        value(p + DVec3::new(1.0 / 70.0, 0.0, 0.0))
    }));
    assert!(
        beyond(&drawn(&shifted, &s).image) > 500,
        "a volume shifted by one voxel is seen"
    );

    let dropped = store_of(&mut field(dims, VoxelType::U16, |p| {
        let brick = (p * DVec3::new(70.0, 45.0, 52.0) / 32.0).floor();
        if brick == DVec3::new(1.0, 0.0, 0.0) {
            0.0
        } else {
            value(p)
        }
    }));
    assert!(
        beyond(&drawn(&dropped, &s).image) > 500,
        "a dropped brick is seen"
    );

    let mut denser = s.clone();
    denser.classification.opacity_unit_mm = Some(1.0 / 1.03);
    assert!(
        beyond(&engine.render(&denser).unwrap().image) > 500,
        "3 % more opacity is seen"
    );

    let mut coarser = s.clone();
    coarser.lod = LodChoice::Fixed(Lod(1));
    assert!(
        beyond(&engine.render(&coarser).unwrap().image) > 500,
        "the wrong level is seen"
    );

    for p in &mut right.pixels {
        (p.x, p.z) = (p.z, p.x);
    }
    assert!(beyond(&right) > 500, "swapped channels are seen");
}
