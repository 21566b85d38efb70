//! Tier 2: volumes whose pictures are known by pencil, on both renderers. Each bound is derived where it stands.
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
use brickscope::classify::{
    ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction,
};
use brickscope::scene::{Image, Mode, PictureSettings, volume_bounds};
use brickscope::volume::{Rescale, VoxelType};
use compare::coverage;
use glam::{DVec3, Vec4};
use memory_source::MemorySource;
use scenes::{TestStore, drawn, field, reference, settings, store_of};

/// The picture of both renderers, by name.
fn both(store: &TestStore, settings: &PictureSettings) -> [(&'static str, Image); 2] {
    [
        ("GPU", drawn(store, settings).image),
        ("reference", reference(store, settings).image),
    ]
}

/// Physical values are stored ones.
fn plain(mut source: MemorySource) -> TestStore {
    source.desc.rescale = Rescale::IDENTITY;
    store_of(&mut source)
}

/// A white transfer function of opacity `a` everywhere.
fn constant_opacity(a: f64) -> TransferFunction {
    TransferFunction {
        name: "constant".into(),
        color: ColorCurve::new(
            vec![ColorPoint {
                x: 0.0,
                rgb: [1.0; 3],
            }],
            ColorSpace::Rgb,
        )
        .unwrap(),
        opacity: OpacityCurve::new(vec![OpacityPoint::linear(0.0, a)]).unwrap(),
    }
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

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_constant_cube_absorbs_by_its_thickness() {
    // 40 voxels between outermost centres: 39 mm. N samples ds apart give 1 − (1 − a)^(N·ds/unit), and N is 39/ds or
    // one more, by the phase of the grid.
    let store = plain(field([40; 3], VoxelType::U8, |_| 0.5));
    for step in [0.3, 0.5, 1.0, 2.0] {
        for unit in [1.0, 4.0] {
            let mut s = settings(&store.store, Mode::Dvr);
            s.size = [32, 32];
            s.classification.transfer = constant_opacity(0.02);
            s.classification.opacity_unit_mm = Some(unit);
            s.step = step;
            s.camera = ortho(DVec3::splat(19.5), 20.0);
            for (name, image) in both(&store, &s) {
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

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_sphere_has_the_silhouette_and_the_normals_of_a_sphere() {
    let radius = 20.0;
    let store = plain(field([64; 3], VoxelType::F32, |p| {
        // Distance in voxels from the centre, so that the surface of value ½ has that radius; linear within ±16 voxels.
        0.5 + (radius - ((p - 0.5) * 64.0).length()) / 32.0
    }));
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso[0].value = 0.5;
    s.classification.iso[0].color = glam::Vec3::ONE;
    s.shading.specular = 0.0;
    (s.shading.ambient, s.shading.diffuse) = (0.0, 1.0);
    s.size = [128, 128];
    s.camera = ortho(DVec3::splat(31.5), 64.0);
    let pixel_mm = 0.5;
    for (name, image) in both(&store, &s) {
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

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_linear_ramp_has_one_exact_gradient() {
    // Along x, across three bricks; the surface of value ½ is the plane x = 48, seen at 30°: n·l = cos 30° at every pixel,
    // to rounding: a seam at a brick's border would show here.
    let store = plain(field([96, 40, 40], VoxelType::F32, |p| p.x));
    let mut s = settings(&store.store, Mode::Iso);
    s.classification.iso[0].value = 0.5;
    s.classification.iso[0].color = glam::Vec3::ONE;
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
    for (name, image) in both(&store, &s) {
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

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_maximum_of_one_bright_voxel_is_that_voxel() {
    // Trilinear: the bright voxel's tent reaches one voxel to each side of its centre. It lies at a brick's corner.
    let bright = DVec3::new(32.0, 31.0, 32.0);
    let store = plain(field([64; 3], VoxelType::U8, |p| {
        if (p * 64.0).floor() == bright {
            1.0
        } else {
            0.0
        }
    }));
    let mut s = settings(&store.store, Mode::Mip);
    s.classification.transfer = brickscope::classify::grey_ramp(0.0, 255.0, 1.0).unwrap();
    s.step = 0.05;
    s.size = [129, 129];
    s.camera = ortho(bright, 12.9);
    for (name, image) in both(&store, &s) {
        // Brightness of the peak: at most 1, at least (1 − half a step) along the ray, as alpha² (colour · opacity).
        let peak = f64::from(image.pixels[64 * 129 + 64].w);
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

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn one_voxel_axes_are_one_voxel_thick() {
    let store = plain(field([24, 1, 24], VoxelType::U8, |_| 1.0));
    let mut s = settings(&store.store, Mode::Dvr);
    s.classification.transfer = constant_opacity(0.5);
    s.camera = ortho(DVec3::new(11.5, 0.0, 11.5), 30.0);
    s.step = 0.1;
    for (name, image) in both(&store, &s) {
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
