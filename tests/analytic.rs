//! Tier 2: volumes whose pictures are known by pencil, on every renderer. Each bound is derived where it stands.
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

use brickscope::camera::{Camera, Projection};
use brickscope::classify::{
    ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction,
};
use brickscope::engine::{DeviceChoice, Engine, EngineOptions};
use brickscope::scene::{
    GradientFilter, Image, IsoSurface, Jitter, Mode, PictureSettings, ShadingModel, TransferMode,
    volume_bounds,
};
use brickscope::volume::{Rescale, VoxelType};
use compare::{assert_same_bits, coverage};
use glam::{DVec3, Vec3, Vec4};
use memory_source::MemorySource;
use scenes::{TestStore, cpu, field, gpu, reference, settings, store_of};

/// What draws a store: one engine for all pictures of a test.
type Renderers = Vec<(&'static str, Engine)>;

/// The renderers that need no graphics adapter.
fn on_the_cpu(store: &TestStore) -> Renderers {
    let reference = EngineOptions {
        device: DeviceChoice::Reference,
        ..EngineOptions::default()
    };
    vec![
        ("CPU", cpu(store, EngineOptions::default())),
        (
            "reference",
            Engine::with_store(Arc::clone(&store.store), reference).unwrap(),
        ),
    ]
}

fn on_the_gpu(store: &TestStore) -> Renderers {
    vec![("GPU", gpu(store, EngineOptions::default()))]
}

/// The picture of each renderer, by name.
fn drawn(renderers: &mut Renderers, settings: &PictureSettings) -> Vec<(&'static str, Image)> {
    renderers
        .iter_mut()
        .map(|(name, engine)| (*name, engine.render(settings).unwrap().image))
        .collect()
}

/// Two tests of each function: those without an adapter are never ignored.
macro_rules! on_every_renderer {
    ($($test:ident,)*) => {
        mod cpu_and_reference {
            $(#[test]
            fn $test() {
                super::$test(super::on_the_cpu);
            })*
        }

        mod graphics {
            $(#[test]
            #[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
            fn $test() {
                super::$test(super::on_the_gpu);
            })*
        }
    };
}

/// Physical values are stored ones.
fn plain(mut source: MemorySource) -> TestStore {
    source.desc.rescale = Rescale::IDENTITY;
    store_of(&mut source)
}

/// A white transfer function of opacity `a` everywhere.
fn constant_opacity(a: f64) -> TransferFunction {
    white(&[(0.0, a)])
}

/// A white one of these opacities at these values.
fn white(opacities: &[(f64, f64)]) -> TransferFunction {
    let points = opacities.iter().map(|&(x, a)| OpacityPoint::linear(x, a));
    TransferFunction::new(
        "white",
        ColorCurve::new(
            vec![ColorPoint {
                x: 0.0,
                rgb: [1.0; 3],
            }],
            ColorSpace::Rgb,
        )
        .unwrap(),
        OpacityCurve::new(points.collect()).unwrap(),
    )
}

/// Orthographic along −y from the front, `extent` mm high.
fn ortho(center: DVec3, extent: f64) -> Camera {
    let fov = 20.0_f64;
    let distance = extent / 2.0 / (fov / 2.0).to_radians().tan();
    Camera {
        eye: center + DVec3::Y * distance,
        target: center,
        up: DVec3::Z,
        fov_y_degrees: fov,
        projection: Projection::Orthographic,
        near_mm: 0.0,
    }
}

on_every_renderer! {
    a_constant_cube_absorbs_by_its_thickness,
    a_sphere_has_the_silhouette_and_the_normals_of_a_sphere,
    a_linear_ramp_has_one_exact_gradient,
    the_maximum_of_one_bright_voxel_is_that_voxel,
    one_voxel_axes_are_one_voxel_thick,
    the_minimum_of_one_dark_voxel_is_that_voxel,
    the_mean_of_a_ramp_is_its_middle,
    jitter_leaves_the_mean_of_a_constant_alone,
    an_xray_of_a_constant_cube_is_its_thickness,
    gradients_make_opacity,
    two_translucent_spheres_lie_in_each_other,
    an_interval_is_a_shell,
    refined_surfaces_are_met_where_they_are,
    a_preintegrated_constant_cube_is_the_same_without_its_first_sample,
    a_preintegrated_ramp_has_the_integral_whatever_the_step,
    filtered_gradients_are_the_mean_of_seven,
    filtered_gradients_of_a_ramp_are_exact,
}

fn a_constant_cube_absorbs_by_its_thickness(of: fn(&TestStore) -> Renderers) {
    // 40 voxels between outermost centres: 39 mm. N samples ds apart give 1 − (1 − a)^(N·ds/unit), and N is 39/ds or
    // one more, by the phase of the grid.
    let store = plain(field([40; 3], VoxelType::U8, |_| 0.5));
    let mut renderers = of(&store);
    for step in [0.3, 0.5, 1.0, 2.0] {
        for unit in [1.0, 4.0] {
            let mut s = settings(&store.store, Mode::Dvr);
            s.size = [32, 32];
            s.classification.transfer = constant_opacity(0.02);
            s.classification.opacity_unit_mm = Some(unit);
            s.step = step;
            s.camera = ortho(DVec3::splat(19.5), 20.0);
            for (name, image) in drawn(&mut renderers, &s) {
                let alpha = f64::from(image.pixels[16 * 32 + 16].w);
                let of = |samples: f64| 1.0 - 0.98_f64.powf(samples * step / unit);
                let (low, high) = (of((39.0 / step).floor()), of((39.0 / step).floor() + 1.0));
                assert!(
                    alpha > low - 2e-5 && alpha < high + 2e-5,
                    "{name}, step {step}, unit {unit}: {alpha} is not in {low}…{high}"
                );
            }
        }
    }
}

fn a_sphere_has_the_silhouette_and_the_normals_of_a_sphere(of: fn(&TestStore) -> Renderers) {
    let radius = 20.0;
    let store = plain(field([64; 3], VoxelType::F32, |p| {
        // Distance in voxels from the centre, so that the surface of value ½ has that radius; linear within ±16 voxels.
        0.5 + (radius - ((p - 0.5) * 64.0).length()) / 32.0
    }));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso[0].value = 0.5;
    s.classification.iso[0].color = Vec3::ONE;
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    s.size = [128, 128];
    s.camera = ortho(DVec3::splat(31.5), 64.0);
    let pixel_mm = 0.5;
    for (name, image) in drawn(&mut renderers, &s) {
        // Pixels within half a pixel diagonal of the circle may fall either way; trilinear interpolation of a convex
        // distance lies below it by at most h²/8 · curvature · 3 < 0.02 voxel.
        for (i, pixel) in image.pixels.iter().enumerate() {
            let (x, y) = ((i % 128) as f64 + 0.5 - 64.0, (i / 128) as f64 + 0.5 - 64.0);
            let r = x.hypot(y) * pixel_mm;
            if (r - radius).abs() > 0.05 {
                assert_eq!(pixel.w == 1.0, r < radius, "{name}: pixel {i} at {r} mm");
            }
            // A headlight on a sphere: n·l = √(1 − r²/R²). Interpolated normals are off by about a hundredth.
            if r < 0.9 * radius {
                let expected = (1.0 - (r / radius).powi(2)).sqrt();
                assert!(
                    (f64::from(pixel.x) - expected).abs() < 0.02,
                    "{name}: pixel {i}: {} not {expected}",
                    pixel.x
                );
            }
        }
    }
}

fn a_linear_ramp_has_one_exact_gradient(of: fn(&TestStore) -> Renderers) {
    // Along x, across three bricks; the surface of value ½ is the plane x = 48, seen at 30°: n·l = cos 30° at every pixel,
    // to rounding: a seam at a brick's border would show here.
    let store = plain(field([96, 40, 40], VoxelType::F32, |p| p.x));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso[0].value = 0.5;
    s.classification.iso[0].color = Vec3::ONE;
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    let center = volume_bounds(
        store.store.meta().dims,
        &store.store.meta().world_from_index,
    )
    .center;
    let angle = 30_f64.to_radians();
    s.camera = ortho(center, 30.0);
    s.camera.eye =
        center + DVec3::new(angle.cos(), angle.sin(), 0.0) * s.camera.eye.distance(center);
    for (name, image) in drawn(&mut renderers, &s) {
        let hits: Vec<Vec4> = image.pixels.iter().copied().filter(|p| p.w > 0.0).collect();
        assert!(
            hits.len() > 8000,
            "{name}: the plane fills the picture: {}",
            hits.len()
        );
        for hit in hits {
            assert!(
                (f64::from(hit.x) - angle.cos()).abs() < 2e-5,
                "{name}: {} is not cos 30°",
                hit.x
            );
        }
    }
}

fn the_maximum_of_one_bright_voxel_is_that_voxel(of: fn(&TestStore) -> Renderers) {
    one_voxel_is_the_extreme(of, Mode::Mip);
}

fn the_minimum_of_one_dark_voxel_is_that_voxel(of: fn(&TestStore) -> Renderers) {
    one_voxel_is_the_extreme(of, Mode::MinIp);
}

fn one_voxel_is_the_extreme(of: fn(&TestStore) -> Renderers, mode: Mode) {
    // Trilinear: the voxel's tent reaches one voxel to each side of its centre. It lies at a brick's corner.
    let special = DVec3::new(32.0, 31.0, 32.0);
    let store = plain(field([64; 3], VoxelType::U8, |p| {
        let is_special = (p * 64.0).floor() == special;
        f64::from(u8::from(is_special == (mode == Mode::Mip)))
    }));
    let mut s = settings(&store.store, mode);
    // What is as the one voxel is opaque.
    s.classification.transfer = match mode {
        Mode::Mip => white(&[(0.0, 0.0), (255.0, 1.0)]),
        _ => white(&[(0.0, 1.0), (255.0, 0.0)]),
    };
    s.step = 0.05;
    s.size = [129, 129];
    s.camera = ortho(special, 12.9);
    for (name, image) in drawn(&mut of(&store), &s) {
        // At most 1, at least (1 − half a step) along the ray.
        let peak = middle(&image);
        assert!(peak > 0.97 && peak <= 1.0, "{name}: the peak is {peak}");
        for (i, pixel) in image.pixels.iter().enumerate() {
            let (x, z) = ((i % 129) as f64 - 64.0, (i / 129) as f64 - 64.0);
            let (dx, dz) = (x.abs() * 0.1, z.abs() * 0.1);
            let tent = (1.0 - dx).max(0.0) * (1.0 - dz).max(0.0);
            assert!(
                (f64::from(pixel.w) - tent).abs() < 0.03,
                "{name}: pixel {i} at ({dx}, {dz}): {} is not {tent}",
                pixel.w
            );
        }
    }
}

fn one_voxel_axes_are_one_voxel_thick(of: fn(&TestStore) -> Renderers) {
    let store = plain(field([24, 1, 24], VoxelType::U8, |_| 1.0));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Dvr);
    s.classification.transfer = constant_opacity(0.5);
    s.camera = ortho(DVec3::new(11.5, 0.0, 11.5), 30.0);
    s.step = 0.1;
    for (name, image) in drawn(&mut renderers, &s) {
        // 23 of 30 mm of the picture, each way.
        assert!(
            (coverage(&image) - (23.0_f64 / 30.0).powi(2)).abs() < 0.02,
            "{name}: {}",
            coverage(&image)
        );
        // 1 mm at 50 % per mm, within one sample of 0.1 mm.
        let alpha = f64::from(image.pixels[64 * 128 + 64].w);
        let of = |mm: f64| 1.0 - 0.5_f64.powf(mm);
        assert!(
            alpha > of(0.9) - 1e-4 && alpha < of(1.1) + 1e-4,
            "{name}: {alpha}"
        );
    }
}

/// The opacity in the middle of the picture.
fn middle(image: &Image) -> f64 {
    f64::from(image.pixels[(image.height / 2 * image.width + image.width / 2) as usize].w)
}

fn the_mean_of_a_ramp_is_its_middle(of: fn(&TestStore) -> Renderers) {
    // Along the rays: samples cover the ramp evenly, to half a step at each end. Across them: every ray has one value.
    let along = plain(field([40, 60, 40], VoxelType::F32, |p| p.y));
    let across = plain(field([60, 40, 40], VoxelType::F32, |p| p.x));
    let (mut of_along, mut of_across) = (of(&along), of(&across));
    for step in [0.3, 1.0, 2.0] {
        let mut s = settings(&along.store, Mode::Mean);
        s.classification.transfer = white(&[(0.0, 0.0), (1.0, 1.0)]);
        s.size = [31, 31];
        s.step = step;
        s.camera = ortho(DVec3::new(19.5, 29.5, 19.5), 20.0);
        for (name, image) in drawn(&mut of_along, &s) {
            let mean = middle(&image);
            let bound = step / 2.0 / 60.0 + 1e-5;
            assert!((mean - 0.5).abs() < bound, "{name}, step {step}: {mean}");
        }
        s.camera = ortho(DVec3::new(29.5, 19.5, 19.5), 31.0);
        for (name, image) in drawn(&mut of_across, &s) {
            for x in 0..31 {
                // A pixel a millimetre, +x to the left.
                let value = (30.0 + f64::from(15 - x)) / 60.0;
                let mean = f64::from(image.pixels[(15 * 31 + x) as usize].w);
                assert!(
                    (mean - value).abs() < 1e-5,
                    "{name}, step {step}, pixel {x}: {mean} is not {value}"
                );
            }
        }
    }
}

fn jitter_leaves_the_mean_of_a_constant_alone(of: fn(&TestStore) -> Renderers) {
    // Sums of up to 2¹⁶ samples of 128 are exact in f32.
    let store = plain(field([40; 3], VoxelType::U8, |_| 128.0 / 255.0));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Mean);
    s.classification.transfer = white(&[(0.0, 0.0), (255.0, 1.0)]);
    s.size = [32, 32];
    s.camera = ortho(DVec3::splat(19.5), 20.0);
    let plain = reference(&store, &s).image;
    assert!((middle(&plain) - 128.0 / 255.0).abs() < 1e-6, "the value");
    s.jitter = Jitter::Interleaved;
    for (name, image) in drawn(&mut renderers, &s) {
        assert_same_bits(&image, &plain, name);
    }
}

fn an_xray_of_a_constant_cube_is_its_thickness(of: fn(&TestStore) -> Renderers) {
    // Grey and opacity per millimetre are the value's place p in the window: 1 − (1 − p)^(39 mm), to a sample, whatever
    // the step.
    let place = 0.02;
    let store = plain(field([40; 3], VoxelType::F32, |_| place));
    let mut renderers = of(&store);
    for step in [0.3, 0.5, 1.0, 2.0] {
        let mut s = settings(&store.store, Mode::Xray);
        s.classification.opacity_unit_mm = None;
        // Its opacities are not asked for.
        s.classification.transfer = white(&[(0.0, 0.3), (1.0, 0.9)]);
        s.size = [32, 32];
        s.step = step;
        s.camera = ortho(DVec3::splat(19.5), 20.0);
        for (name, image) in drawn(&mut renderers, &s) {
            let alpha = middle(&image);
            let of = |samples: f64| 1.0 - (1.0 - place).powf(samples * step);
            let (low, high) = (of((39.0 / step).floor()), of((39.0 / step).floor() + 1.0));
            assert!(
                alpha > low - 2e-5 && alpha < high + 2e-5,
                "{name}, step {step}: {alpha} is not in {low}…{high}"
            );
            let grey = f64::from(image.pixels[16 * 32 + 16].x);
            assert!(
                (grey - place * alpha).abs() < 1e-5,
                "{name}, step {step}: {grey} is not {place} of {alpha}"
            );
        }
    }
}

fn gradients_make_opacity(of: fn(&TestStore) -> Renderers) {
    // A ramp of 1/60 per millimetre, in a window of 1: a quarter of it per millimetre would be opaque in full.
    let store = plain(field([40, 60, 40], VoxelType::F32, |p| p.y));
    let mut renderers = of(&store);
    let strength = 4.0 / 60.0;
    for step in [0.5, 1.0, 2.0] {
        let mut s = settings(&store.store, Mode::Gradient);
        s.classification.transfer = white(&[(0.0, 0.2), (1.0, 0.2)]);
        s.size = [16, 16];
        s.step = step;
        s.camera = ortho(DVec3::new(19.5, 29.5, 19.5), 20.0);
        for filter in [GradientFilter::Central, GradientFilter::Filtered] {
            s.shading.gradient = filter;
            for (name, image) in drawn(&mut renderers, &s) {
                let alpha = middle(&image);
                let of = |samples: f64| 1.0 - 0.8_f64.powf(samples * step * strength);
                // At the ends the ramp goes on as a constant, within a voxel: a sample or two have less of a gradient.
                let count = (59.0 / step).floor();
                let (low, high) = (of(count - 2.0 / step), of(count + 1.0));
                assert!(
                    alpha > low - 2e-5 && alpha < high + 2e-5,
                    "{name}, {filter:?}, step {step}: {alpha} is not in {low}…{high}"
                );
            }
        }
    }
}

fn two_translucent_spheres_lie_in_each_other(of: fn(&TestStore) -> Renderers) {
    // From outside in and out again: outer, inner, inner, outer.
    let (outer, inner) = (20.0, 10.0);
    let store = plain(field([64; 3], VoxelType::F32, |p| {
        0.5 + (outer - ((p - 0.5) * 64.0).length()) / 48.0
    }));
    let mut renderers = of(&store);
    let surface = |radius: f64, color, opacity| IsoSurface {
        value: 0.5 + (outer - radius) / 48.0,
        color,
        opacity,
    };
    let surfaces = [
        surface(inner, Vec3::new(0.0, 1.0, 0.5), 0.6),
        surface(outer, Vec3::new(1.0, 0.0, 0.25), 0.3),
    ];
    let through = |numbers: &[usize]| {
        let mut sum = Vec4::ZERO;
        for &n in numbers {
            let weight = (1.0 - sum.w) * surfaces[n].opacity;
            sum += surfaces[n].color.extend(1.0) * weight;
        }
        sum
    };
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso = surfaces.to_vec();
    s.shading.model = ShadingModel::None;
    s.size = [128, 128];
    s.camera = ortho(DVec3::splat(31.5), 64.0);
    let mut met = [0; 3];
    for (name, image) in drawn(&mut renderers, &s) {
        for (i, pixel) in image.pixels.iter().enumerate() {
            let (x, y) = ((i % 128) as f64 + 0.5 - 64.0, (i / 128) as f64 + 0.5 - 64.0);
            let r = x.hypot(y) * 0.5;
            // As of one sphere: interpolation moves a silhouette by less than 0.05 mm.
            if (r - outer).abs() < 0.05 || (r - inner).abs() < 0.05 {
                continue;
            }
            let (kind, expected) = if r < inner {
                (0, through(&[1, 0, 0, 1]))
            } else if r < outer {
                (1, through(&[1, 1]))
            } else {
                (2, Vec4::ZERO)
            };
            met[kind] += 1;
            assert!(
                pixel.abs_diff_eq(expected, 1e-5),
                "{name}: pixel {i} at {r} mm: {pixel} is not {expected}"
            );
        }
    }
    assert!(met.iter().all(|&n| n > 1000), "all three parts: {met:?}");
}

fn an_interval_is_a_shell(of: fn(&TestStore) -> Renderers) {
    // Values in LOW..HIGH lie between two spheres. Which one a ray meets first is known by pencil, from outside and from
    // between them; its colour tells which one was met, and a light from one side where.
    let (outer, inner) = (20.0, 10.0);
    let center = DVec3::splat(31.5);
    let store = plain(field([64; 3], VoxelType::F32, |p| {
        0.5 + (outer - ((p - 0.5) * 64.0).length()) / 48.0
    }));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    let [low, high] = [outer, inner].map(|radius| 0.5 + (outer - radius) / 48.0);
    s.classification.iso = [(low, Vec3::X), (high, Vec3::Y)]
        .map(|(value, color)| IsoSurface {
            color,
            ..IsoSurface::opaque(value)
        })
        .to_vec();
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    let direction = DVec3::new(2.0, 1.0, 1.0).normalize();
    s.shading.light = Some(direction);
    s.size = [64, 64];
    // What is seen there: the outer sphere, the inner one, nothing.
    for (place, back, fov, seen) in [
        ("from outside", 45.0, 60.0_f64, [true, false, true]),
        (
            "from between them, inward",
            15.0,
            100.0,
            [true, true, false],
        ),
        (
            "from between them, outward",
            -15.0,
            100.0,
            [true, false, false],
        ),
    ] {
        let eye = center + DVec3::Y * back;
        s.camera = Camera {
            eye,
            target: eye - DVec3::Y,
            up: DVec3::Z,
            fov_y_degrees: fov,
            projection: Projection::Perspective,
            near_mm: 0.0,
        };
        let extent = (fov / 2.0).to_radians().tan();
        for (name, image) in drawn(&mut renderers, &s) {
            let mut met = [0; 3];
            for (i, pixel) in image.pixels.iter().enumerate() {
                let [x, z] = [i % 64, i / 64].map(|n| (n as f64 + 0.5) / 32.0 - 1.0);
                // Towards −y, +x to the left.
                let ray = DVec3::new(-x * extent, -1.0, -z * extent).normalize();
                let from = eye - center;
                let past = from.dot(ray);
                let nearest = (from.length_squared() - past * past).sqrt();
                // As of one sphere: interpolation moves a silhouette by less than 0.05 mm.
                if (nearest - outer).abs() < 0.05 || (nearest - inner).abs() < 0.05 {
                    continue;
                }
                let half_chord = |radius: f64| (radius * radius - nearest * nearest).sqrt();
                let (kind, distance) = if nearest > outer {
                    (2, 0.0)
                } else if from.length() > outer {
                    (0, -past - half_chord(outer))
                } else if nearest < inner && past < 0.0 {
                    (1, -past - half_chord(inner))
                } else {
                    (0, -past + half_chord(outer))
                };
                met[kind] += 1;
                let hit = from + ray * distance;
                let light = hit.normalize().dot(direction).abs() as f32;
                let expected = [Vec3::X * light, Vec3::Y * light, Vec3::ZERO][kind];
                assert!(
                    pixel.truncate().abs_diff_eq(expected, 0.03) && (pixel.w == 1.0) == (kind < 2),
                    "{name}, {place}: pixel {i}: {pixel} is not {expected}"
                );
            }
            assert_eq!(met.map(|n| n > 1000), seen, "{name}, {place}: {met:?}");
        }
    }
}

fn refined_surfaces_are_met_where_they_are(of: fn(&TestStore) -> Renderers) {
    // v = X·Y, which trilinear interpolation has exactly, and its gradient (Y, X, 0): where X is known, the light of a
    // headlight along y tells Y, the depth. Along a ray v is linear: nothing but the step makes an error.
    let store = plain(field([64; 3], VoxelType::F32, |p| {
        let at = p * 64.0 + 7.5;
        at.x * at.y / 5184.0
    }));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso = vec![IsoSurface {
        color: Vec3::ONE,
        ..IsoSurface::opaque(1600.0 / 5184.0)
    }];
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    s.size = [64, 64];
    s.step = 5.0;
    s.camera = ortho(DVec3::splat(31.5), 32.0);
    for refine in [true, false] {
        s.refine = refine;
        for (name, image) in drawn(&mut renderers, &s) {
            let mut worst = 0.0_f64;
            for (i, pixel) in image.pixels.iter().enumerate() {
                assert_eq!(pixel.w, 1.0, "{name}: pixel {i} shows the surface");
                // Half a millimetre a pixel, +x to the left; X is 8 at the first voxel.
                let x = 39.5 + (31.5 - (i % 64) as f64) * 0.5;
                let light = f64::from(pixel.x);
                let y = x * (1.0 / (light * light) - 1.0).sqrt();
                worst = worst.max((y - 1600.0 / x).abs());
            }
            // Six bisections of a step of five voxels, and the rounding of the light.
            let bound = 5.0 / 128.0 + 2e-3;
            assert!(
                if refine { worst < bound } else { worst > 2.0 },
                "{name}, refined: {refine}: {worst} voxels off"
            );
        }
    }
}

fn a_preintegrated_constant_cube_is_the_same_without_its_first_sample(
    of: fn(&TestStore) -> Renderers,
) {
    let store = plain(field([40; 3], VoxelType::U8, |_| 0.5));
    let mut renderers = of(&store);
    for step in [0.5, 1.0, 4.0] {
        let mut s = settings(&store.store, Mode::Dvr);
        s.size = [32, 32];
        s.classification.transfer = constant_opacity(0.02);
        s.step = step;
        s.camera = ortho(DVec3::splat(19.5), 20.0);
        let post = reference(&store, &s).image;
        s.classification.transfer_mode = TransferMode::Preintegrated;
        let of_step = 1.0 - 0.98_f64.powf(step);
        for (name, image) in drawn(&mut renderers, &s) {
            // N samples have N − 1 segments between them, each of the same opacity.
            let alpha = middle(&image);
            let with_first = alpha + (1.0 - alpha) * of_step;
            assert!(
                (with_first - middle(&post)).abs() < 1e-5,
                "{name}, step {step}: {with_first}, not {}",
                middle(&post)
            );
        }
    }
}

fn a_preintegrated_ramp_has_the_integral_whatever_the_step(of: fn(&TestStore) -> Renderers) {
    // A peak of opacity h, 2w wide, in a ramp of 1/60 per millimetre: with extinction −ln(1 − a) its optical depth is
    // 60 · 2w/h · ((1 − h) ln(1 − h) + h), however few samples lie in it.
    let store = plain(field([40, 60, 40], VoxelType::F32, |p| p.y));
    let mut renderers = of(&store);
    let (h, w) = (0.4_f64, 0.04);
    let depth = 60.0 * 2.0 * w / h * ((1.0 - h) * (1.0 - h).ln() + h);
    let expected = 1.0 - (-depth).exp();
    for step in [0.5, 1.0, 4.0, 9.0] {
        let mut s = settings(&store.store, Mode::Dvr);
        s.classification.transfer = white(&[(0.5 - w, 0.0), (0.5, h), (0.5 + w, 0.0)]);
        s.classification.transfer_mode = TransferMode::Preintegrated;
        s.opacity_cutoff = 1.0;
        s.size = [16, 16];
        s.step = step;
        s.camera = ortho(DVec3::new(19.5, 29.5, 19.5), 20.0);
        for (name, image) in drawn(&mut renderers, &s) {
            let alpha = middle(&image);
            // The table has 1024 entries a side, joined linearly: kinks of the peak's foot are off by up to an entry's.
            assert!(
                (alpha - expected).abs() < 2e-3,
                "{name}, step {step}: {alpha} is not {expected}"
            );
        }
        if step == 9.0 {
            s.classification.transfer_mode = TransferMode::Post;
            let post = middle(&reference(&store, &s).image);
            assert!(
                (post - expected).abs() > 0.05,
                "the control: samples alone would miss it: {post}"
            );
        }
    }
}

fn filtered_gradients_are_the_mean_of_seven(of: fn(&TestStore) -> Renderers) {
    // v = (Y + X·Z²) / 200 about voxel (20, 20, 20). At voxel centres X, Z the central difference along x is Z² there and
    // half a voxel along x and y, and, interpolated linearly, Z² ± Z + ½ half a voxel along z: Z² + 1/7 in the mean. Along
    // z it is 2·X·Z at all of them in the mean, along y 1.
    let store = plain(field([41; 3], VoxelType::F32, |p| {
        let at = p * 41.0 - 20.5;
        0.5 + (at.y + at.x * at.z * at.z) / 200.0
    }));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso = vec![IsoSurface {
        color: Vec3::ONE,
        ..IsoSurface::opaque(0.5)
    }];
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    s.size = [41, 41];
    s.camera = ortho(DVec3::splat(20.0), 41.0);
    for (filter, more) in [
        (GradientFilter::Central, 0.0),
        (GradientFilter::Filtered, 1.0 / 7.0),
    ] {
        s.shading.gradient = filter;
        for (name, image) in drawn(&mut renderers, &s) {
            for (x, z) in (-2..=2).flat_map(|x| (-3..=3).map(move |z| (x, z))) {
                let pixel = image.pixels[((20 - z) * 41 + 20 - x) as usize];
                let (x, z) = (f64::from(x), f64::from(z));
                let normal = DVec3::new(z * z + more, 1.0, 2.0 * x * z).normalize();
                assert!(
                    (f64::from(pixel.x) - normal.y).abs() < 1e-4,
                    "{name}, {filter:?} at ({x}, {z}): {} is not {}",
                    pixel.x,
                    normal.y
                );
            }
        }
    }
}

fn filtered_gradients_of_a_ramp_are_exact(of: fn(&TestStore) -> Renderers) {
    // As central ones: across three bricks, seen at 30°, every pixel is cos 30°; a seam would show.
    let store = plain(field([96, 40, 40], VoxelType::F32, |p| p.x));
    let mut renderers = of(&store);
    let mut s = settings(&store.store, Mode::Iso);
    s.shading.specular = 0.0;
    s.shading.gradient = GradientFilter::Filtered;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    let angle = 30_f64.to_radians();
    // In the middle of a brick, and at a border between two.
    for (value, x) in [(0.5, 47.5), (64.1 / 96.0, 63.6)] {
        s.classification.iso = vec![IsoSurface {
            color: Vec3::ONE,
            ..IsoSurface::opaque(value)
        }];
        let center = DVec3::new(x, 19.5, 19.5);
        s.camera = ortho(center, 20.0);
        let away = s.camera.eye.distance(center);
        s.camera.eye = center + DVec3::new(angle.cos(), angle.sin(), 0.0) * away;
        for (name, image) in drawn(&mut renderers, &s) {
            let hits: Vec<Vec4> = image.pixels.iter().copied().filter(|p| p.w > 0.0).collect();
            assert!(hits.len() > 8000, "{name}: the plane fills the picture");
            for hit in hits {
                assert!(
                    (f64::from(hit.x) - angle.cos()).abs() < 3e-5,
                    "{name}: {} is not cos 30°",
                    hit.x
                );
            }
        }
    }
}
