//! Clip geometry and meshes in a picture (techniques.md T1.5): the GPU and the fast CPU renderer against the reference, for
//! each kind and for combinations; what is inside and what is outside a mesh make up the whole; layers against an analytic
//! scene.
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

use brickscope::clip::{
    ClipMesh, CutFaces, Geometry, OrientedBox, Plane, Side, SurfaceMesh, TriangleMesh,
};
use brickscope::scene::{PictureSettings, volume_bounds};
use brickscope::volume::VoxelType;
use compare::{Difference, TWIN_BOUND, coverage, difference};
use glam::{DMat3, DVec3, Vec3};
use scenes::{TestStore, cpu, looks, reference, waves};

/// A sphere, as a share of the volume's bounding sphere, off its centre by shares of its radius.
fn sphere(store: &TestStore, radius: f64, off: DVec3) -> Arc<TriangleMesh> {
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let center = bounds.center + off * bounds.radius;
    Arc::new(TriangleMesh::sphere(center, radius * bounds.radius, 3).unwrap())
}

/// A half space through a point of the volume, told as shares of its radius.
fn plane(store: &TestStore, normal: DVec3, off: f64) -> Plane {
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let point = bounds.center + normal.normalize() * (off * bounds.radius);
    Plane::new(normal, -normal.dot(point)).unwrap()
}

fn clip(mesh: &Arc<TriangleMesh>, side: Side) -> ClipMesh {
    ClipMesh {
        mesh: Arc::clone(mesh),
        side,
    }
}

fn drawn(mesh: &Arc<TriangleMesh>, color: [f32; 3], opacity: f32) -> SurfaceMesh {
    SurfaceMesh {
        mesh: Arc::clone(mesh),
        color: Vec3::from(color),
        opacity,
    }
}

/// Every kind of cut and of mesh alone, and together.
fn geometries(store: &TestStore) -> Vec<(&'static str, Geometry)> {
    let meta = store.store.meta();
    let bounds = volume_bounds(meta.dims, &meta.world_from_index);
    let one = plane(store, DVec3::new(0.3, -1.0, 0.4), -0.1);
    let turned = OrientedBox {
        center: bounds.center + DVec3::new(2.0, -3.0, 1.0),
        half_extent: DVec3::new(0.5, 0.35, 0.4) * bounds.radius,
        world_from_box: DMat3::from_rotation_y(0.5) * DMat3::from_rotation_x(0.7),
    };
    let large = sphere(store, 0.6, DVec3::new(0.1, -0.2, 0.0));
    let small = sphere(store, 0.35, DVec3::new(-0.1, -0.25, 0.1));
    let other = sphere(store, 0.3, DVec3::new(0.35, -0.1, -0.2));
    let planes = |planes: Vec<Plane>| Geometry {
        planes,
        ..Geometry::default()
    };
    let clips = |clip_meshes: Vec<ClipMesh>| Geometry {
        clip_meshes,
        ..Geometry::default()
    };
    let surfaces = |surfaces: Vec<SurfaceMesh>| Geometry {
        surfaces,
        ..Geometry::default()
    };
    let glass = |mesh| drawn(mesh, [0.2, 0.6, 0.9], 0.4);
    vec![
        ("a plane", planes(vec![one])),
        ("a box", planes(turned.planes().to_vec())),
        (
            "a box and a plane",
            planes([turned.planes().as_slice(), &[one]].concat()),
        ),
        ("inside a mesh", clips(vec![clip(&large, Side::Inside)])),
        ("outside a mesh", clips(vec![clip(&large, Side::Outside)])),
        (
            "inside one, outside two",
            clips(vec![
                clip(&large, Side::Inside),
                clip(&small, Side::Outside),
                clip(&other, Side::Outside),
            ]),
        ),
        (
            "an opaque mesh",
            surfaces(vec![drawn(&small, [0.9, 0.5, 0.2], 1.0)]),
        ),
        ("a translucent mesh", surfaces(vec![glass(&large)])),
        (
            "layers",
            surfaces(vec![
                glass(&large),
                drawn(&other, [0.8, 0.2, 0.2], 0.6),
                drawn(&small, [0.3, 0.9, 0.3], 1.0),
            ]),
        ),
        (
            "everything",
            Geometry {
                planes: vec![plane(store, DVec3::new(-1.0, 0.2, -0.3), -0.5)],
                clip_meshes: vec![clip(&small, Side::Outside)],
                surfaces: vec![glass(&large), drawn(&other, [0.8, 0.2, 0.2], 1.0)],
                faces: CutFaces::default(),
            },
        ),
        (
            "caps",
            Geometry {
                planes: vec![one],
                clip_meshes: vec![clip(&small, Side::Outside), clip(&other, Side::Outside)],
                surfaces: vec![glass(&large)],
                faces: CutFaces {
                    are_capped: true,
                    have_normals: false,
                },
            },
        ),
        (
            "cut normals",
            Geometry {
                planes: vec![one],
                clip_meshes: vec![clip(&small, Side::Outside)],
                surfaces: Vec::new(),
                faces: CutFaces {
                    are_capped: false,
                    have_normals: true,
                },
            },
        ),
    ]
}

fn with(settings: &PictureSettings, geometry: &Geometry) -> PictureSettings {
    PictureSettings {
        geometry: Arc::new(geometry.clone()),
        size: [96, 80],
        ..settings.clone()
    }
}

/// A sample within rounding of a cut is on either side of it, and a ray that grazes a mesh crosses it or not: so many pixels in
/// a thousand may differ.
const BY_ROUNDING: usize = 4;

fn assert_alike(d: &Difference, pixels: usize, what: &str) {
    println!("{what}: {d}");
    assert!(d.beyond * 1000 <= pixels * BY_ROUNDING, "{what}: {d}");
    assert!(d.mean < 2e-4, "{what}: {d}");
}

fn check(
    store: &TestStore,
    settings: &PictureSettings,
    draw: &mut dyn FnMut(&PictureSettings) -> brickscope::engine::Picture,
    what: &str,
) {
    let truth = reference(store, settings).image;
    let covered = coverage(&truth);
    assert!(covered > 0.05, "{what}: nearly empty ({covered})");
    let picture = draw(settings).image;
    let d = difference(&picture, &truth, TWIN_BOUND);
    assert_alike(&d, truth.pixels.len(), what);
}

fn check_all(draw: &mut dyn FnMut(&TestStore, &PictureSettings) -> brickscope::engine::Picture) {
    let store = waves(VoxelType::U16);
    let looks = looks(&store.store);
    for (kind, geometry) in geometries(&store) {
        for (look, settings) in &looks {
            // All looks in the combination, those that differ there with caps and normals, two with each kind.
            let chosen: &[&str] = match kind {
                "caps" => &[
                    "dvr",
                    "iso",
                    "gradient",
                    "surfaces",
                    "lit pre-integrated",
                    "mip",
                ],
                "cut normals" => &["filtered dvr", "lit pre-integrated", "gradient"],
                _ => &["dvr", "iso"],
            };
            if kind == "everything" || chosen.contains(look) {
                let s = with(settings, &geometry);
                check(
                    &store,
                    &s,
                    &mut |s| draw(&store, s),
                    &format!("{kind}, {look}"),
                );
            }
        }
    }
}

#[test]
fn the_cpu_cuts_as_the_reference_does() {
    let mut engine = None;
    check_all(&mut |store, s| {
        let engine = engine.get_or_insert_with(|| cpu(store, Default::default()));
        engine.render(s).unwrap()
    });
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_cuts_as_the_reference_does() {
    let mut engine = None;
    check_all(&mut |store, s| {
        let engine = engine.get_or_insert_with(|| scenes::gpu(store, Default::default()));
        engine.render(s).unwrap()
    });
}

/// The combination of all kinds of geometry.
fn everything(store: &TestStore) -> Geometry {
    geometries(store)
        .into_iter()
        .find_map(|(kind, g)| (kind == "everything").then_some(g))
        .unwrap()
}

/// Cuts where other things happen, too: several levels on a ray, an eye inside the volume and inside what cuts it, parallel rays,
/// several rays of a pixel.
fn places(store: &TestStore) -> Vec<(&'static str, PictureSettings)> {
    let geometry = everything(store);
    let mut places = Vec::new();
    for (look, settings) in looks(&store.store) {
        if ![
            "dvr",
            "iso",
            "mip",
            "mean",
            "lit pre-integrated",
            "surfaces",
        ]
        .contains(&look)
        {
            continue;
        }
        let whole = with(&settings, &geometry);
        places.push((
            "several levels",
            scenes::through_levels(store, whole.clone()),
        ));
        let mut s = whole.clone();
        s.camera.projection = brickscope::camera::Projection::Orthographic;
        places.push(("parallel rays", s));
        let mut s = whole.clone();
        // In the mesh that is cut out, of which the near plane takes a part.
        s.camera = scenes::inside(
            &store.store,
            DVec3::new(0.42, 0.36, 0.52),
            DVec3::new(0.6, 1.0, 0.3),
        );
        s.camera.near_mm = 1.0;
        places.push(("inside", s));
        let mut s = whole;
        s.anti_aliasing =
            brickscope::scene::AntiAliasing::Full(brickscope::scene::SamplePattern::FourRotated);
        s.size = [48, 40];
        places.push(("four rays", s));
    }
    places
}

#[test]
fn the_cpu_cuts_everywhere_as_the_reference_does() {
    let store = waves(VoxelType::U16);
    let mut engine = cpu(&store, Default::default());
    for (place, s) in places(&store) {
        let what = format!("{place}, {}", s.mode.name());
        check(&store, &s, &mut |s| engine.render(s).unwrap(), &what);
    }
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_cuts_everywhere_as_the_reference_does() {
    let store = waves(VoxelType::U16);
    let mut engine = scenes::gpu(&store, Default::default());
    for (place, s) in places(&store) {
        let what = format!("{place}, {}", s.mode.name());
        check(&store, &s, &mut |s| engine.render(s).unwrap(), &what);
    }
}

#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn every_technique_cuts_alike() {
    use brickscope::engine::EngineOptions;
    use brickscope::scene::{ShadingModel, Technique};
    let store = waves(VoxelType::U16);
    let geometry = everything(&store);
    let mut engine = scenes::gpu(&store, EngineOptions::default());
    // A few slots: rays stop and go on.
    let mut tight = scenes::gpu(
        &store,
        EngineOptions {
            max_slots: Some(10),
            ..EngineOptions::default()
        },
    );
    for (look, settings) in looks(&store.store) {
        if !["dvr", "mip", "pre-integrated", "surfaces"].contains(&look) {
            continue;
        }
        let mut s = scenes::through_levels(&store, with(&settings, &geometry));
        s.shading.model = ShadingModel::None;
        let default = engine.render(&s).unwrap();
        for technique in Technique::ALL {
            s.technique = technique;
            let what = format!("{look}, {}", technique.name());
            let picture = engine.render(&s).unwrap();
            let d = difference(&picture.image, &default.image, TWIN_BOUND);
            println!("{what}: {d}");
            assert_eq!(d.beyond, 0, "{what}: {d}");
        }
        s.technique = Technique::Default;
        let paged = tight.render(&s).unwrap();
        println!("{look}: evicted {:?}", paged.stats.bricks_evicted);
        compare::assert_same_bits(&paged.image, &default.image, &format!("{look}, few slots"));
        engine.set_picture(s.clone());
        scenes::tick_to_end(&mut engine, &brickscope::engine::TickBudget::default());
        let ticked = engine.image().unwrap();
        compare::assert_same_bits(ticked, &default.image, &format!("{look}, by ticks"));
    }
}
