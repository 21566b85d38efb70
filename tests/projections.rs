//! Panoramas and wide angles: fisheye, equirectangular and perspective pictures up to 150°, from inside the volume. The GPU and
//! the fast CPU renderer against the reference, with and without geometry.
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

use brickscope::camera::Projection;
use brickscope::clip::{ClipMesh, CutFaces, Geometry, Plane, Side, SurfaceMesh, TriangleMesh};
use brickscope::engine::Engine;
use brickscope::scene::PictureSettings;
use brickscope::volume::VoxelType;
use compare::{TWIN_BOUND, assert_twins, by_comparison, coverage, difference};
use glam::{DVec3, Vec3};
use scenes::{TestStore, cpu, inside, looks, reference, waves};

/// Pictures from inside, in every direction and nearly so.
fn views(store: &TestStore) -> Vec<(String, PictureSettings)> {
    let kinds = [
        (Projection::Perspective, 150.0, [96, 64]),
        (Projection::Fisheye, 120.0, [80, 64]),
        (Projection::Fisheye, 240.0, [64, 64]),
        (Projection::Equirectangular, 90.0, [112, 56]),
    ];
    let chosen = ["dvr", "iso", "mean", "lit pre-integrated"];
    let mut views = Vec::new();
    for (look, settings) in looks(&store.store) {
        if !chosen.contains(&look) {
            continue;
        }
        for (projection, fov, size) in kinds {
            let mut s = settings.clone();
            s.camera = inside(
                &store.store,
                DVec3::new(0.45, 0.4, 0.52),
                DVec3::new(0.5, 1.0, 0.3),
            );
            (s.camera.projection, s.camera.fov_y_degrees, s.size) = (projection, fov, size);
            s.camera.near_mm = 0.2;
            views.push((format!("{} {fov}, {look}", projection.name()), s));
        }
    }
    views
}

fn check(engine: &mut Engine, store: &TestStore) {
    for (view, s) in views(store) {
        let truth = reference(store, &s).image;
        assert!(coverage(&truth) > 0.3, "{view}: {}", coverage(&truth));
        let picture = engine.render(&s).unwrap().image;
        let allowed = by_comparison(s.mode, truth.pixels.len());
        assert_twins(&picture, &truth, allowed, &view);
    }
}

#[test]
fn the_cpu_draws_panoramas_as_the_reference_does() {
    let store = waves(VoxelType::U8);
    check(&mut cpu(&store, Default::default()), &store);
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_draws_panoramas_as_the_reference_does() {
    let store = waves(VoxelType::U8);
    check(&mut scenes::gpu(&store, Default::default()), &store);
}

/// A ball around the eye that is kept, another one that is cut out, a sheet of glass.
fn geometry(store: &TestStore, s: &PictureSettings) -> [(&'static str, Geometry); 2] {
    let eye = s.camera.eye;
    let meta = store.store.meta();
    let spacing = meta.spacing().min_element();
    let ball = |off: DVec3, radius: f64| {
        Arc::new(TriangleMesh::sphere(eye + off * spacing, radius * spacing, 3).unwrap())
    };
    let plane = Plane::new(
        DVec3::new(0.3, 0.1, 1.0),
        -eye.dot(DVec3::new(0.3, 0.1, 1.0)) + 4.0,
    );
    let planes = Geometry {
        planes: vec![plane.unwrap()],
        faces: CutFaces {
            are_capped: true,
            have_normals: true,
        },
        ..Geometry::default()
    };
    let meshes = Geometry {
        clip_meshes: vec![
            ClipMesh {
                mesh: ball(DVec3::new(2.0, 3.0, 1.0), 24.0),
                side: Side::Inside,
            },
            ClipMesh {
                mesh: ball(DVec3::new(6.0, 9.0, 0.0), 7.0),
                side: Side::Outside,
            },
        ],
        surfaces: vec![SurfaceMesh {
            mesh: ball(DVec3::new(-8.0, 5.0, 3.0), 6.0),
            color: Vec3::new(0.2, 0.5, 0.9),
            opacity: 0.5,
        }],
        ..planes.clone()
    };
    [("planes", planes), ("meshes", meshes)]
}

fn check_cuts(engine: &mut Engine, store: &TestStore, is_exact: bool) {
    for (view, s) in views(store) {
        if !(view.ends_with("dvr") || view.ends_with("iso")) {
            continue;
        }
        for (kind, geometry) in geometry(store, &s) {
            let s = PictureSettings {
                geometry: Arc::new(geometry),
                ..s.clone()
            };
            let truth = reference(store, &s).image;
            let picture = engine.render(&s).unwrap().image;
            // On the GPU panoramas find meshes in the pixels of a cube: their facets are told apart to a pixel of it.
            let is_panorama = s.camera.projection.is_panoramic();
            let (bound, per_mille) = match (is_exact, kind) {
                (false, "meshes") if is_panorama => (2.0 / 255.0, 40),
                _ => (TWIN_BOUND, 4),
            };
            let d = difference(&picture, &truth, bound);
            println!("{view}, {kind}: {d}");
            assert!(
                d.beyond * 1000 <= truth.pixels.len() * per_mille && d.mean < 2e-3,
                "{view}, {kind}: {d}"
            );
        }
    }
}

#[test]
fn the_cpu_cuts_panoramas_as_the_reference_does() {
    let store = waves(VoxelType::U8);
    check_cuts(&mut cpu(&store, Default::default()), &store, true);
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_cuts_panoramas_as_the_reference_does() {
    let store = waves(VoxelType::U8);
    check_cuts(&mut scenes::gpu(&store, Default::default()), &store, false);
}
