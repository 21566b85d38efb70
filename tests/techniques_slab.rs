//! Technique slab (techniques.md T5): the picture of the default caster, from values that a work-group shares. What is not
//! lit is equal within the twin bound; what is lit has gradients from other places, and a bound of its own.
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

use std::time::Duration;

use brickscope::camera::Projection;
use brickscope::engine::{Engine, EngineError, EngineOptions, TickBudget};
use brickscope::geom::Lod;
use brickscope::scene::{
    AntiAliasing, Image, Interpolation, Jitter, LodChoice, Mode, PictureSettings, SamplePattern,
    ShadingModel, SlabRim, SlabShape, Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, assert_twins, coverage, difference};
use glam::{DVec3, Vec3};
use scenes::{
    TestStore, field, gpu, inside, looks, oblique, phantom, reference, settings, store_of,
};

/// How lit pictures may differ from those of the default caster: mean and 99th percentile of the differences of channels of
/// pixels that show something. Gradients are taken over two pixels and two steps instead of one voxel, along other axes; here
/// a pixel is about 0.6 voxels wide and a step half of one, so that both see the same structure. Where the gradient turns
/// within a voxel (on edges, at extrema), they point elsewhere.
#[derive(Clone, Copy, Debug)]
struct LitBound {
    mean: f32,
    high: f32,
}

/// On smooth data.
const SMOOTH: LitBound = LitBound {
    mean: 0.01,
    high: 0.1,
};
/// Of values that jump between voxels: most differences over two pixels are 0, some are whole steps.
const STEPS: LitBound = LitBound {
    mean: 0.1,
    high: 0.5,
};
/// On edges within a voxel: there a gradient over one voxel and one over two pixels are of different values.
const SHARP: LitBound = LitBound {
    mean: 0.12,
    high: 0.5,
};

/// A smooth field over several bricks in each axis, in oblique, anisotropic voxels.
fn waves(voxel_type: VoxelType) -> TestStore {
    let mut source = field([70, 45, 52], voxel_type, |p| {
        let r = (p - 0.5).length();
        0.5 + 0.4 * (r * 19.0).cos() * (1.0 - r) + 0.1 * (p.x * 20.0).sin() * (p.y * 15.0).cos()
    });
    source.desc.world_from_index = oblique();
    store_of(&mut source)
}

fn slab(s: &PictureSettings) -> PictureSettings {
    PictureSettings {
        technique: Technique::Slab,
        ..s.clone()
    }
}

/// Looks that rays of one group can share: their samples lie at equal distances.
fn shared_looks(store: &TestStore) -> Vec<(&'static str, PictureSettings)> {
    let mut looks = looks(&store.store);
    looks.retain(|(_, s)| s.jitter == Jitter::None);
    looks
}

fn is_lit(s: &PictureSettings) -> bool {
    SlabRim::of(s).sides > 0
}

/// Mean and 99th percentile of the differences of channels, of pixels that show something.
fn spread(a: &Image, b: &Image) -> [f32; 2] {
    let mut all: Vec<f32> = a
        .pixels
        .iter()
        .zip(&b.pixels)
        .filter(|(p, q)| p.w > 0.0 || q.w > 0.0)
        .flat_map(|(p, q)| (*p - *q).abs().to_array())
        .collect();
    all.sort_by(f32::total_cmp);
    let mean = all.iter().map(|&d| f64::from(d)).sum::<f64>() / all.len() as f64;
    [mean as f32, all[all.len() * 99 / 100]]
}

/// The opacity alone: where it does not depend on gradients it has the twin bound in lit pictures, too.
fn opacities(image: &Image) -> Image {
    let mut alone = image.clone();
    for pixel in &mut alone.pixels {
        *pixel = glam::Vec4::new(0.0, 0.0, 0.0, pixel.w);
    }
    alone
}

/// Compares a picture in slabs with one without.
fn check(
    slabs: &Image,
    other: &Image,
    s: &PictureSettings,
    allowed: usize,
    bound: LitBound,
    what: &str,
) {
    assert!(coverage(other) > 0.05, "{what}: nearly empty");
    // As in tests/twin.rs: bisection decides by comparing.
    let by_comparison = if s.mode == Mode::Iso {
        other.pixels.len() / 1000
    } else {
        0
    };
    if !is_lit(s) {
        assert_twins(slabs, other, allowed + by_comparison, what);
        return;
    }
    let [mean, high] = spread(slabs, other);
    println!("{what}: mean {mean:.4}, 99 % {high:.4}");
    assert!(
        mean <= bound.mean && high <= bound.high,
        "{what}: mean {mean}, 99 % below {high}, allowed {bound:?}"
    );
    if s.mode != Mode::Gradient {
        let what = format!("{what}, opacity");
        assert_twins(
            &opacities(slabs),
            &opacities(other),
            allowed + by_comparison,
            &what,
        );
    }
}

/// Draws both ways with one engine.
fn check_engine(
    engine: &mut Engine,
    s: &PictureSettings,
    allowed: usize,
    bound: LitBound,
    what: &str,
) {
    let slabs = engine.render(&slab(s)).unwrap();
    let other = engine.render(s).unwrap();
    check(&slabs.image, &other.image, s, allowed, bound, what);
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_voxel_type_and_look_is_that_of_the_default_and_of_the_reference() {
    for voxel_type in [VoxelType::U8, VoxelType::U16, VoxelType::F32] {
        let store = waves(voxel_type);
        let mut engine = gpu(&store, EngineOptions::default());
        for (look, s) in shared_looks(&store) {
            let what = format!("{voxel_type} {look}");
            let slabs = engine.render(&slab(&s)).unwrap();
            let other = engine.render(&s).unwrap();
            check(&slabs.image, &other.image, &s, 0, SMOOTH, &what);
            let what = format!("{what}, reference");
            check(
                &slabs.image,
                &reference(&store, &s).image,
                &s,
                0,
                SMOOTH,
                &what,
            );
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_setting_is_that_of_the_default() {
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, of_look) in shared_looks(&store) {
        let mut s = of_look.clone();
        s.camera.projection = Projection::Orthographic;
        let what = format!("orthographic {look}");
        check_engine(&mut engine, &s, 0, SMOOTH, &what);
        let mut s = of_look.clone();
        let place = DVec3::new(0.45, 0.2, 0.5);
        s.camera = inside(&store.store, place, DVec3::new(0.3, 1.0, 0.2));
        s.lod_error = 12.0;
        let what = format!("{look} from inside at several levels");
        check_engine(&mut engine, &s, 0, SHARP, &what);
        let mut s = of_look;
        s.interpolation = Interpolation::Nearest;
        // A sample on the very face between two voxels may take either.
        let what = format!("{look} nearest");
        check_engine(&mut engine, &s, 16, STEPS, &what);
    }
    let mut s = settings(&store.store, Mode::Dvr);
    s.lod = LodChoice::Fixed(Lod(1));
    check_engine(&mut engine, &s, 0, SMOOTH, "level 1");
    // Wider than a tile, and no whole work-groups.
    s.lod = LodChoice::Auto;
    s.size = [1101, 23];
    s.camera.fov_y_degrees = 0.7;
    s.shading.model = ShadingModel::Phong;
    check_engine(&mut engine, &s, 0, SHARP, "two tiles");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn sharp_edges_are_near_the_default() {
    let store = phantom("phantom:body:100,70,110:u8");
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, mut s) in shared_looks(&store) {
        // The mean of so much air is transparent.
        if s.mode == Mode::Mean {
            continue;
        }
        s.classification.iso[0].value = 150.3;
        check_engine(&mut engine, &s, 0, SHARP, &format!("body {look}"));
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_shape_draws_the_same_picture() {
    let store = waves(VoxelType::U16);
    let shape = |width, height, depth| EngineOptions {
        slab: SlabShape {
            width,
            height,
            depth,
        },
        ..EngineOptions::default()
    };
    let drawn: Vec<(&str, PictureSettings)> = shared_looks(&store)
        .into_iter()
        .filter(|(look, _)| ["filtered dvr", "surfaces", "lit pre-integrated"].contains(look))
        .collect();
    let mut engine = gpu(&store, shape(8, 8, 1));
    let expected: Vec<Image> = drawn
        .iter()
        .map(|(_, s)| engine.render(&slab(s)).unwrap().image)
        .collect();
    for [width, height, depth] in [
        [8, 8, 8],
        [16, 8, 13],
        [12, 10, 5],
        [16, 16, 4],
        [32, 16, 2],
    ] {
        let mut engine = gpu(&store, shape(width, height, depth));
        for ((look, s), expected) in drawn.iter().zip(&expected) {
            let what = format!("{look}, {width}×{height}×{depth}");
            let picture = engine.render(&slab(s)).unwrap();
            assert_twins(&picture.image, expected, 0, &what);
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_smallest_atlas_draws_the_same_picture() {
    let store = phantom("phantom:body:200,180,210:u16");
    let shown = [
        "mip",
        "filtered dvr",
        "filtered surfaces",
        "lit pre-integrated",
    ];
    for (look, mut s) in shared_looks(&store) {
        if !shown.contains(&look) {
            continue;
        }
        s.size = [144, 120];
        s.step = s.step.max(1.0);
        s.lod = LodChoice::Fixed(Lod(0));
        let s = slab(&s);
        let with = |slots| {
            let options = EngineOptions {
                max_slots: slots,
                slab: SlabShape {
                    width: 8,
                    height: 8,
                    depth: 24,
                },
                ..EngineOptions::default()
            };
            gpu(&store, options).render(&s)
        };
        let whole = with(None).unwrap();
        let refused = with(Some(9)).unwrap_err();
        let EngineError::Atlas { needed, slots, .. } = refused else {
            panic!("{look}: {refused}");
        };
        assert!(slots == 9 && needed > 9, "{look}: {needed} of {slots}");
        let small = with(Some(needed)).unwrap();
        let evicted = small.stats.bricks_evicted.unwrap();
        println!("{look}: {needed} slots, {evicted} bricks had to leave");
        assert!(evicted > 0, "{look}: {needed} slots are few");
        assert_twins(&small.image, &whole.image, 0, look);
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_changing_picture_becomes_the_rendered_one() {
    let store = phantom("phantom:body:100,90,110:u8");
    let mut s = slab(&settings(&store.store, Mode::Dvr));
    s.shading.model = ShadingModel::Phong;
    let mut engine = gpu(&store, EngineOptions::default());
    let rendered = engine.render(&s).unwrap();
    engine.set_picture(s);
    let budget = TickBudget {
        time: Duration::from_millis(50),
        upload_bytes: 1 << 20,
    };
    for _ in 0..2000 {
        if engine.tick(&budget).unwrap().converged {
            break;
        }
    }
    let image = engine.image().unwrap();
    assert_same_bits(image, &rendered.image, "ticks and one picture");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn more_rays_of_a_pixel_are_cast() {
    let store = waves(VoxelType::U8);
    let mut engine = gpu(&store, EngineOptions::default());
    let mut s = settings(&store.store, Mode::Dvr);
    s.size = [61, 47];
    for aa in [
        AntiAliasing::Full(SamplePattern::Two),
        AntiAliasing::Selective {
            pattern: SamplePattern::FourRotated,
            threshold: 0.04,
        },
    ] {
        s.anti_aliasing = aa;
        let what = format!("{aa:?}");
        check_engine(&mut engine, &s, 0, SMOOTH, &what);
    }
}

/// A volume whose value rises along (1, 2, −1.5) of its voxels, looked at from inside: an oblique plane that fills the picture.
fn ramp(projection: Projection) -> (TestStore, PictureSettings, DVec3) {
    let dims = [64, 60, 56];
    let slope = DVec3::new(1.0, 2.0, -1.5) / 500.0;
    let size = DVec3::new(dims[0] as f64, dims[1] as f64, dims[2] as f64);
    let mut source = field(dims, VoxelType::F32, |p| 0.5 + slope.dot((p - 0.5) * size));
    source.desc.world_from_index = oblique();
    let gradient = source.desc.world_from_index.matrix3.inverse().transpose() * slope;
    let store = store_of(&mut source);
    let mut s = settings(&store.store, Mode::Iso);
    let normal = gradient.normalize();
    let aside = normal.any_orthonormal_vector();
    let center = store
        .store
        .meta()
        .world_from_index
        .transform_point3(size * 0.5 - 0.5);
    // 12 mm before the plane, at a slant: all that is seen lies well inside the volume.
    s.camera.eye = center - (normal * 0.9 + aside * 0.4).normalize() * 12.0;
    s.camera.target = center;
    s.camera.up = normal.cross(aside);
    s.camera.fov_y_degrees = 40.0;
    s.camera.near_mm = 0.0;
    s.camera.projection = projection;
    s.classification.iso[0].value = store.store.meta().rescale.physical(0.5);
    s.classification.iso[0].color = Vec3::new(0.9, 0.6, 0.3);
    s.lod = LodChoice::Fixed(Lod(0));
    s.shading.specular = 0.0;
    (store, s, normal)
}

/// What Phong's model makes of the ramp's surface under light from `light`.
fn lit(s: &PictureSettings, normal: DVec3, light: DVec3) -> Vec3 {
    let diffuse = normal.dot(light.normalize()).abs() as f32;
    s.classification.iso[0].color * (s.shading.ambient + s.shading.diffuse * diffuse)
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gradient_of_a_ramp_is_exact() {
    let light = DVec3::new(0.3, -1.0, 0.5);
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let (store, mut s, normal) = ramp(projection);
        s.shading.light = Some(light);
        let mut engine = gpu(&store, EngineOptions::default());
        for filtered in [false, true] {
            if filtered {
                s.shading.gradient = brickscope::scene::GradientFilter::Filtered;
            }
            let image = engine.render(&slab(&s)).unwrap().image;
            let what = format!("{projection:?}, filtered: {filtered}");
            assert!(
                coverage(&image) > 0.99,
                "{what}: the plane fills the picture"
            );
            // Values of about 0.5 are rounded to 3e-8, positions to 1e-6 voxel; a pixel is 0.05 voxels wide, over which the
            // value changes by 2e-4: the normal is right to 1e-3.
            let worst = |expected: Vec3| {
                let off = |p: &glam::Vec4| (p.truncate() - expected).abs().max_element();
                image.pixels.iter().map(off).fold(0.0, f32::max)
            };
            let error = worst(lit(&s, normal, light));
            println!("{what}: {error:.2e}");
            assert!(error < 2e-3, "{what}: {error}");
            // Negative control: the normal as it is in eye space, not turned into the world.
            let forward = (s.camera.target - s.camera.eye).normalize();
            let right = forward.cross(s.camera.up).normalize();
            let in_eye = DVec3::new(
                normal.dot(right),
                normal.dot(right.cross(forward)),
                normal.dot(forward),
            );
            let control = worst(lit(&s, in_eye, light));
            assert!(
                control > 0.05,
                "{what}: not turned, it would be off by {control}"
            );
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn lit_bounds_tell_another_light_and_a_shifted_volume() {
    // Negative controls of the bounds of lit pictures.
    let store = waves(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    let mut s = settings(&store.store, Mode::Iso);
    let right = engine.render(&s).unwrap().image;
    let slabs = engine.render(&slab(&s)).unwrap().image;
    let [mean, high] = spread(&slabs, &right);
    assert!(mean <= SMOOTH.mean && high <= SMOOTH.high, "{mean}, {high}");
    s.shading.light = Some(DVec3::new(1.0, 0.3, 0.2));
    let [mean, high] = spread(&engine.render(&slab(&s)).unwrap().image, &right);
    assert!(
        mean > SMOOTH.mean && high > SMOOTH.high,
        "another light: {mean}, {high}"
    );
    let d = difference(&slabs, &right, TWIN_BOUND);
    assert!(
        d.beyond > 100,
        "gradients are not those of the default: {d}"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_same_samples_are_taken() {
    let store = waves(VoxelType::U8);
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, s) in shared_looks(&store) {
        // By what is known of bricks in the end: of a brick that is not there yet, more is walked.
        engine.render(&slab(&s)).unwrap();
        let slabs = engine.render(&slab(&s)).unwrap().stats;
        let other = engine.render(&s).unwrap().stats;
        assert_eq!(slabs.rays, other.rays, "{look}");
        let counts = [slabs.samples, other.samples];
        let off = counts[0].abs_diff(counts[1]);
        match s.mode {
            // What a slab yields can rule out blocks behind it only.
            Mode::Mip | Mode::MinIp => assert!(counts[0] < counts[1] * 2, "{look}: {counts:?}"),
            // Where a ray ends depends on its gradients.
            Mode::Gradient => assert!(off < counts[1] / 50, "{look}: {counts:?}"),
            // But for rays that end within rounding of the cutoff.
            _ => assert!(off <= counts[1] / 1000, "{look}: {counts:?}"),
        }
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn shapes_that_cannot_be_drawn_are_refused() {
    let store = waves(VoxelType::U8);
    let mut s = slab(&settings(&store.store, Mode::Dvr));
    s.size = [32, 32];
    let with = |width, height, depth, s: &PictureSettings| {
        let options = EngineOptions {
            slab: SlabShape {
                width,
                height,
                depth,
            },
            ..EngineOptions::default()
        };
        gpu(&store, options).render(s)
    };
    for [width, height, depth] in [[10, 8, 8], [8, 7, 8], [8, 8, 0], [4, 8, 8], [8, 8, 28]] {
        let refused = with(width, height, depth, &s).unwrap_err();
        let is_named = matches!(refused, EngineError::SlabShape { shape } if shape.width == width);
        assert!(is_named, "{width}×{height}×{depth}: {refused}");
    }
    let refused = with(1024, 512, 8, &s).unwrap_err();
    let message = refused.to_string();
    assert!(
        matches!(refused, EngineError::SlabLimit { .. }) && message.contains("1024×512×8"),
        "{message}"
    );
    // What fits unlit need not fit lit.
    assert!(with(16, 16, 27, &s).is_ok(), "27 KiB and a word per ray");
    s.shading.model = ShadingModel::Phong;
    let refused = with(16, 16, 27, &s).unwrap_err();
    assert!(
        matches!(refused, EngineError::SlabLimit { what: "bytes", .. }),
        "{refused}"
    );
    s.jitter = Jitter::Interleaved;
    let refused = with(8, 8, 8, &s).unwrap_err();
    assert!(matches!(refused, EngineError::SlabJitter), "{refused}");
}
