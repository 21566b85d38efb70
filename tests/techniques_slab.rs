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
    AntiAliasing, GradientFilter, Image, Interpolation, Jitter, LodChoice, Mode, PictureSettings,
    PictureStats, SamplePattern, ShadingModel, SlabRim, SlabShape, Technique,
};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_same_bits, assert_twins, by_comparison, coverage, difference};
use glam::{DVec3, Vec3};
use scenes::{
    TestStore, field, gpu, looks, oblique, phantom, reference, settings, store_of, through_levels,
    tick_to_end,
};

/// How lit pictures may differ from those of the default caster: mean and 99th percentile of the differences of channels of
/// pixels that show something. Gradients are taken over two pixels and two steps instead of one voxel, along other axes; here
/// a pixel is about 0.6 voxels wide and a step half of one, so that both see the same structure. Where the gradient turns
/// within a voxel (on edges, at extrema), they point elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LitBound {
    mean: f32,
    high: f32,
}

/// What decides how much gradients over a voxel and over two pixels differ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Data {
    /// Over a voxel, gradients hardly turn.
    Smooth,
    /// The same from inside: gradients of coarser levels are over larger voxels, but over pixels that are not.
    Levels,
    /// Values that jump between voxels: most differences over two pixels are 0, some are whole steps.
    Steps,
    /// Edges within a voxel: there a gradient over one voxel and one over two pixels are of different values.
    Sharp,
}

impl Data {
    const ALL: [Self; 4] = [Self::Smooth, Self::Levels, Self::Steps, Self::Sharp];

    /// Measured and rounded up, so that what must not pass is beyond (see the negative controls).
    fn bound(self, s: &PictureSettings) -> LitBound {
        let surfaces = match s.mode {
            Mode::Iso => s.classification.iso.len(),
            _ => 0,
        };
        let is_filtered = s.mode == Mode::Dvr && s.shading.gradient == GradientFilter::Filtered;
        let [mean, high] = match (self, surfaces) {
            (Self::Smooth, _) => [0.005, 0.05],
            // Light all along a ray, and the default's filter is two voxels of a coarser level wide.
            (Self::Levels, 0) if is_filtered => [0.045, 0.15],
            (Self::Levels, _) => [0.02, 0.05],
            (Self::Steps, 0) => [0.02, 0.11],
            (Self::Steps, _) => [0.06, 0.35],
            (Self::Sharp, 0) => [0.03, 0.19],
            // One opaque surface is all light, translucent ones are partly their colours.
            (Self::Sharp, 1) => [0.1, 0.4],
            (Self::Sharp, _) => [0.04, 0.2],
        };
        LitBound { mean, high }
    }
}

/// [`scenes::waves`] without what is finer than a few voxels: over a voxel, gradients hardly turn.
fn swells(voxel_type: VoxelType) -> TestStore {
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
    data: Data,
    what: &str,
) {
    assert!(coverage(other) > 0.05, "{what}: nearly empty");
    let allowed = allowed + by_comparison(s.mode, other.pixels.len());
    if !is_lit(s) {
        assert_twins(slabs, other, allowed, what);
        return;
    }
    let ([mean, high], bound) = (spread(slabs, other), data.bound(s));
    println!("{what}: mean {mean:.4}, 99 % {high:.4}");
    assert!(
        mean <= bound.mean && high <= bound.high,
        "{what}: mean {mean}, 99 % below {high}, allowed {bound:?}"
    );
    if s.mode != Mode::Gradient {
        let what = format!("{what}, opacity");
        assert_twins(&opacities(slabs), &opacities(other), allowed, &what);
    }
}

/// Draws both ways with one engine.
fn check_engine(engine: &mut Engine, s: &PictureSettings, allowed: usize, data: Data, what: &str) {
    let slabs = engine.render(&slab(s)).unwrap();
    let other = engine.render(s).unwrap();
    check(&slabs.image, &other.image, s, allowed, data, what);
}

/// Each look with one voxel type, each type with a third of the looks: values are read into slabs by one piece of code whatever
/// is made of them.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_voxel_type_and_look_is_that_of_the_default_and_of_the_reference() {
    let types = [VoxelType::U8, VoxelType::U16, VoxelType::F32];
    for (n, voxel_type) in types.into_iter().enumerate() {
        let store = swells(voxel_type);
        let mut engine = gpu(&store, EngineOptions::default());
        // Samples are compared by what is known of bricks in the end: of a brick that is not there yet, more is walked. To a
        // mean all bricks matter.
        engine.render(&settings(&store.store, Mode::Mean)).unwrap();
        let looks = shared_looks(&store).into_iter();
        for (look, s) in looks.skip(n).step_by(types.len()) {
            let what = format!("{voxel_type} {look}");
            let slabs = engine.render(&slab(&s)).unwrap();
            let other = engine.render(&s).unwrap();
            check(&slabs.image, &other.image, &s, 0, Data::Smooth, &what);
            assert_same_samples(&slabs.stats, &other.stats, s.mode, &what);
            let truth = reference(&store, &s).image;
            let what = format!("{what}, reference");
            check(&slabs.image, &truth, &s, 0, Data::Smooth, &what);
        }
    }
}

fn assert_same_samples(slabs: &PictureStats, other: &PictureStats, mode: Mode, what: &str) {
    assert_eq!(slabs.rays, other.rays, "{what}");
    let counts = [slabs.samples, other.samples];
    let off = counts[0].abs_diff(counts[1]);
    let is_near = match mode {
        // What a slab yields can rule out blocks behind it only: most of what a ray's samples do.
        Mode::Mip | Mode::MinIp => {
            let [skipped, by_rays] = [slabs, other].map(|s| s.samples_skipped);
            by_rays > 0 && skipped <= by_rays && skipped * 2 > by_rays
        }
        // Where a ray ends depends on its gradients.
        Mode::Gradient => off < counts[1] / 50,
        // But for rays that end within rounding of the cutoff.
        _ => off <= counts[1] / 1000,
    };
    assert!(is_near, "{what}: {counts:?} samples");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_setting_is_that_of_the_default() {
    let store = swells(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    for (n, (look, of_look)) in shared_looks(&store).into_iter().enumerate() {
        // Rays are laid out by one piece of code for all looks.
        if n % 3 == 0 {
            let mut s = of_look.clone();
            s.camera.projection = Projection::Orthographic;
            let what = format!("orthographic {look}");
            check_engine(&mut engine, &s, 0, Data::Smooth, &what);
        }
        let s = through_levels(&store, of_look.clone());
        let what = format!("{look} from inside at several levels");
        check_engine(&mut engine, &s, 0, Data::Levels, &what);
        let mut s = of_look;
        s.interpolation = Interpolation::Nearest;
        // A sample on the very face between two voxels may take either.
        let what = format!("{look} nearest");
        check_engine(&mut engine, &s, 16, Data::Steps, &what);
    }
    let mut s = settings(&store.store, Mode::Dvr);
    s.lod = LodChoice::Fixed(Lod(1));
    check_engine(&mut engine, &s, 0, Data::Smooth, "level 1");
    // Wider than a tile, and no whole work-groups.
    s.lod = LodChoice::Auto;
    s.size = [1101, 23];
    s.camera.fov_y_degrees = 0.7;
    s.shading.model = ShadingModel::Phong;
    check_engine(&mut engine, &s, 0, Data::Smooth, "two tiles");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn sharp_edges_are_near_the_default() {
    let store = phantom("phantom:body:100,70,110:u8");
    let mut engine = gpu(&store, EngineOptions::default());
    for (look, mut s) in shared_looks(&store) {
        s.classification.iso[0].value = 150.3;
        check_engine(&mut engine, &s, 0, Data::Sharp, &format!("body {look}"));
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_shape_draws_the_same_picture() {
    let store = swells(VoxelType::U16);
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
        gpu(&store, options)
    };
    let (mut plenty, mut too_few) = (with(None), with(Some(9)));
    for (look, mut s) in shared_looks(&store) {
        if !shown.contains(&look) {
            continue;
        }
        s.size = [144, 120];
        s.step = s.step.max(1.0);
        s.lod = LodChoice::Fixed(Lod(0));
        let s = slab(&s);
        let whole = plenty.render(&s).unwrap();
        let refused = too_few.render(&s).unwrap_err();
        let EngineError::Atlas { needed, slots, .. } = refused else {
            panic!("{look}: {refused}");
        };
        assert!(slots == 9 && needed > 9, "{look}: {needed} of {slots}");
        let small = with(Some(needed)).render(&s).unwrap();
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
    tick_to_end(&mut engine, &budget);
    let image = engine.image().unwrap();
    assert_same_bits(image, &rendered.image, "ticks and one picture");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn more_rays_of_a_pixel_are_cast() {
    let store = swells(VoxelType::U8);
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
        check_engine(&mut engine, &s, 0, Data::Smooth, &what);
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
                s.shading.gradient = GradientFilter::Filtered;
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

/// What the bound of a lit picture must tell from it: names and settings.
fn wrong(store: &TestStore, s: &PictureSettings) -> Vec<(&'static str, PictureSettings)> {
    // Seen from a voxel aside, the volume is shifted by one.
    let voxel = store.store.meta().world_from_index.matrix3.x_axis;
    let mut shifted = s.clone();
    shifted.camera.eye += voxel;
    shifted.camera.target += voxel;
    let mut all = vec![("a shifted volume", shifted)];
    // (The mode of gradients needs no light for them.)
    if s.shading.model == ShadingModel::Phong {
        let mut unlit = s.clone();
        unlit.shading.model = ShadingModel::None;
        let mut other_light = s.clone();
        other_light.shading.light = Some(DVec3::new(1.0, 0.3, 0.2));
        all.extend([("no light", unlit), ("another light", other_light)]);
    }
    all
}

/// Negative controls of every bound of lit pictures, in the first look that has it and in the mode of gradients.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn lit_bounds_tell_no_light_another_light_and_a_shifted_volume() {
    let smooth = swells(VoxelType::U16);
    let sharp = phantom("phantom:body:100,70,110:u8");
    for data in Data::ALL {
        let store = if data == Data::Sharp { &sharp } else { &smooth };
        let mut engine = gpu(store, EngineOptions::default());
        let mut seen = Vec::new();
        for (look, mut s) in shared_looks(store) {
            match data {
                Data::Smooth => (),
                Data::Levels => s = through_levels(store, s),
                Data::Steps => s.interpolation = Interpolation::Nearest,
                Data::Sharp => s.classification.iso[0].value = 150.3,
            }
            let bound = data.bound(&s);
            let is_new = s.shading.model == ShadingModel::Phong && !seen.contains(&bound);
            if !is_new && look != Mode::Gradient.name() {
                continue;
            }
            if is_new {
                seen.push(bound);
            }
            let right = engine.render(&s).unwrap().image;
            for (name, wrong) in wrong(store, &s) {
                let image = engine.render(&slab(&wrong)).unwrap().image;
                let [mean, high] = spread(&image, &right);
                assert!(
                    mean > bound.mean || high > bound.high,
                    "{data:?} {look}, {name}: mean {mean}, 99 % below {high}, allowed {bound:?}"
                );
            }
        }
    }
}

/// Slabs take gradients of their own: with those of the default caster, no bounds would be needed.
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn gradients_are_not_those_of_the_default() {
    let store = swells(VoxelType::U16);
    let mut engine = gpu(&store, EngineOptions::default());
    let s = settings(&store.store, Mode::Iso);
    let [slabs, other] = [slab(&s), s].map(|s| engine.render(&s).unwrap().image);
    let d = difference(&slabs, &other, TWIN_BOUND);
    assert!(d.beyond > 100, "{d}");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn shapes_that_cannot_be_drawn_are_refused() {
    let store = swells(VoxelType::U8);
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
