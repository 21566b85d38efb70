//! Near-plane filling (techniques.md T1.6): a camera that moves through a wall, a hollow and the inside of what cuts the volume
//! shows no holes. Every frame of its way equals the reference, which has no mesh and no near faces.
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
use brickscope::clip::{ClipMesh, Geometry, Side, TriangleMesh};
use brickscope::scene::{LodChoice, Mode, PictureSettings};
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, by_comparison, coverage, difference};
use glam::DVec3;
use scenes::{TestStore, field, gpu, oblique, reference, settings, store_of};

/// Frames from outside through a wall into the hollow and out through the other wall.
const STEPS: u32 = 200;

/// A hollow ball with a lumpy wall in oblique voxels.
fn hollow() -> TestStore {
    let mut source = field([60, 56, 50], VoxelType::U8, |p| {
        let off = p - 0.5;
        let lumps = 0.02 * ((off.x * 31.0).sin() + (off.y * 27.0).cos() + (off.z * 35.0).sin());
        let r = off.length() + lumps;
        if (0.24..0.36).contains(&r) {
            0.6 + 0.3 * (off.x * 40.0).sin().abs()
        } else {
            0.0
        }
    });
    source.desc.world_from_index = oblique();
    store_of(&mut source)
}

/// The camera at a part of its way, 0 to 1, with a near plane of a tenth of a voxel.
fn camera(store: &TestStore, part: f64) -> Camera {
    let meta = store.store.meta();
    let at = |p: DVec3| {
        meta.world_from_index
            .transform_point3(p * meta.dims.as_dvec3())
    };
    let [begin, end] = [DVec3::new(0.44, -0.05, 0.47), DVec3::new(0.55, 1.05, 0.52)].map(at);
    let eye = begin.lerp(end, part);
    // It turns on its way.
    let ahead = (end - begin).normalize() + DVec3::Z * (0.4 * (part * 9.0).sin());
    Camera {
        eye,
        target: eye + ahead * 10.0,
        up: DVec3::Z,
        fov_y_degrees: 80.0,
        projection: Projection::Perspective,
        near_mm: 0.1 * meta.spacing().min_element(),
    }
}

fn fly(store: &TestStore, base: &PictureSettings, steps: u32, what: &str) {
    let mut engine = gpu(store, Default::default());
    let mut seen = 0;
    for step in 0..steps {
        let mut s = base.clone();
        s.camera = camera(store, f64::from(step) / f64::from(steps - 1));
        let truth = reference(store, &s).image;
        let picture = engine.render(&s).unwrap().image;
        let d = difference(&picture, &truth, TWIN_BOUND);
        let pixels = truth.pixels.len();
        // One pixel in a hundred of so small a picture, where something is decided by comparing.
        let by_cuts = if base.geometry.is_empty() {
            0
        } else {
            pixels / 100
        };
        let allowed = by_comparison(s.mode, pixels).max(usize::from(s.mode == Mode::Iso)) + by_cuts;
        assert!(d.beyond <= allowed, "{what}, step {step}: {d}");
        seen += u32::from(coverage(&truth) > 0.5);
    }
    assert!(
        seen > steps / 2,
        "{what}: {seen} of {steps} frames show something"
    );
}

fn small(store: &TestStore, mode: Mode) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    (s.size, s.lod, s.step) = ([28, 20], LodChoice::Fixed(brickscope::geom::Lod(0)), 0.5);
    s
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_camera_goes_through_walls_without_holes() {
    let store = hollow();
    fly(&store, &small(&store, Mode::Iso), STEPS, "iso");
    fly(&store, &small(&store, Mode::Dvr), STEPS / 4, "dvr");
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_camera_goes_through_what_cuts_without_holes() {
    let store = hollow();
    let meta = store.store.meta();
    let middle = meta
        .world_from_index
        .transform_point3(meta.dims.as_dvec3() * 0.5);
    let ball =
        |off: DVec3, radius: f64| Arc::new(TriangleMesh::sphere(middle + off, radius, 3).unwrap());
    let mut s = small(&store, Mode::Dvr);
    s.geometry = Arc::new(Geometry {
        clip_meshes: vec![
            ClipMesh {
                mesh: ball(DVec3::ZERO, 26.0),
                side: Side::Inside,
            },
            ClipMesh {
                mesh: ball(DVec3::new(1.0, -16.0, 2.0), 9.0),
                side: Side::Outside,
            },
        ],
        ..Geometry::default()
    });
    fly(&store, &s, STEPS / 2, "cut");
}
