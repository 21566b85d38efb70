//! Depths of a picture: of the first thing that a ray meets, and of what ends it. Both renderers against the reference, and one
//! scene that is known.
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::sync::Arc;

use brickscope::camera::{Camera, Projection};
use brickscope::clip::{CutFaces, Geometry, Plane, SurfaceMesh, TriangleMesh};
use brickscope::engine::Engine;
use brickscope::scene::{Image, Mode, PictureSettings, volume_bounds};
use brickscope::volume::VoxelType;
use glam::{DVec3, Vec3};
use scenes::{TestStore, cpu, looks, reference, settings, waves};

/// Pictures with depths: every look, as it is and with a capped cut and meshes.
fn pictures(store: &TestStore) -> Vec<(String, PictureSettings)> {
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let surface = |off: DVec3, opacity| SurfaceMesh {
        mesh: Arc::new(
            TriangleMesh::sphere(bounds.center + off * bounds.radius, 0.3 * bounds.radius, 3)
                .unwrap(),
        ),
        color: Vec3::new(0.8, 0.4, 0.2),
        opacity,
    };
    let normal = DVec3::new(0.3, -1.0, 0.4);
    let geometry = Arc::new(Geometry {
        planes: vec![Plane::new(normal, -normal.dot(bounds.center)).unwrap()],
        surfaces: vec![
            surface(DVec3::new(0.2, -0.2, 0.1), 1.0),
            surface(DVec3::new(-0.3, 0.4, 0.0), 0.5),
        ],
        faces: CutFaces {
            are_capped: true,
            have_normals: false,
        },
        ..Geometry::default()
    });
    let chosen = [
        "dvr",
        "iso",
        "mip",
        "gradient",
        "lit pre-integrated",
        "surfaces",
    ];
    let mut pictures = Vec::new();
    for (look, mut s) in looks(&store.store) {
        if chosen.contains(&look) {
            (s.size, s.depths) = ([64, 56], true);
            let mut cut = s.clone();
            cut.geometry = Arc::clone(&geometry);
            pictures.push((look.to_owned(), s));
            pictures.push((format!("{look}, cut"), cut));
        }
    }
    pictures
}

/// Pixels whose depths are not those of `truth`, to a thousandth of a millimetre.
fn different(image: &Image, truth: &Image) -> usize {
    let pairs = image
        .depths
        .iter()
        .flatten()
        .zip(truth.depths.iter().flatten());
    let is_like = |a: f32, b: f32| a == b || (a - b).abs() <= 1e-3 + 1e-5 * b.abs();
    pairs
        .filter(|(a, b)| !(is_like(a[0], b[0]) && is_like(a[1], b[1])))
        .count()
}

fn check(engine: &mut Engine, store: &TestStore) {
    for (what, s) in pictures(store) {
        let truth = reference(store, &s).image;
        let image = engine.render(&s).unwrap().image;
        let depths = truth.depths.as_ref().unwrap();
        let met = depths.iter().filter(|d| d[0].is_finite()).count();
        assert!(
            met > 300 || what == "mip",
            "{what}: {met} pixels show something"
        );
        assert!(
            depths.iter().all(|d| d[0] <= d[1]),
            "{what}: first things first"
        );
        let off = different(&image, &truth);
        // What lies within rounding of a cut or of a surface is met or not.
        assert!(
            off * 1000 <= depths.len() * 4,
            "{what}: {off} pixels differ"
        );
        // The control: a step farther.
        let mut moved = image;
        let step = 0.5 * store.store.meta().spacing().min_element() as f32;
        for d in moved.depths.iter_mut().flatten() {
            d[0] += step;
        }
        assert!(different(&moved, &truth) >= met, "{what}: moved by a step");
    }
}

#[test]
fn the_cpu_tells_depths_as_the_reference_does() {
    let store = waves(VoxelType::U16);
    check(&mut cpu(&store, Default::default()), &store);
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_tells_depths_as_the_reference_does() {
    let store = waves(VoxelType::U16);
    check(&mut scenes::gpu(&store, Default::default()), &store);
}

#[test]
fn the_depth_of_a_ball_is_known() {
    let store = waves(VoxelType::U8);
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let radius = 0.2 * bounds.radius;
    // Before the volume, seen along −y; of so many triangles that it is a ball to 1e-3 of its radius.
    let middle = bounds.center + DVec3::Y * (1.5 * bounds.radius);
    let mut s = settings(&store.store, Mode::Mip);
    (s.size, s.depths) = ([21, 21], true);
    s.camera = Camera {
        eye: middle + DVec3::Y * (2.0 * bounds.radius),
        target: middle,
        up: DVec3::Z,
        fov_y_degrees: 8.0,
        projection: Projection::Orthographic,
        near_mm: 0.0,
    };
    s.geometry = Arc::new(Geometry {
        surfaces: vec![SurfaceMesh {
            mesh: Arc::new(TriangleMesh::sphere(middle, radius, 5).unwrap()),
            color: Vec3::ONE,
            opacity: 1.0,
        }],
        ..Geometry::default()
    });
    let half_mm = (4.0_f64.to_radians()).tan() * 2.0 * bounds.radius;
    let image = cpu(&store, Default::default()).render(&s).unwrap().image;
    let depths = image.depths.unwrap();
    let mut hits = 0;
    for (n, [first, end]) in depths.into_iter().enumerate() {
        let at = |n: usize| ((n as f64 + 0.5) / 21.0 * 2.0 - 1.0) * half_mm;
        let off = at(n % 21).hypot(at(n / 21));
        if off < 0.95 * radius {
            let truth = 2.0 * bounds.radius - (radius * radius - off * off).sqrt();
            assert!(
                (f64::from(first) - truth).abs() < 5e-3 * radius,
                "{first} for {truth}"
            );
            assert_eq!(first, end);
            hits += 1;
        } else if off > 1.05 * radius {
            assert_eq!(
                [first, end],
                [f32::INFINITY; 2],
                "nothing, {off} mm off the axis"
            );
        }
    }
    assert!(hits > 100, "{hits}");
}
