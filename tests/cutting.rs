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
use brickscope::scene::{Background, PictureSettings, volume_bounds};
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
        places.push(("parallel rays", s.clone()));
        if look == "dvr" {
            // Parallel rays have a far plane: it lies behind the last mesh, not behind the volume.
            let ahead = (s.camera.target - s.camera.eye).normalize();
            let behind = sphere(store, 0.5, ahead * 3.0);
            s.geometry = Arc::new(Geometry {
                surfaces: vec![drawn(&behind, [0.9, 0.2, 0.7], 1.0)],
                ..Geometry::default()
            });
            let seen = reference(store, &s)
                .image
                .over(Background::Color(Vec3::ZERO));
            let pink = seen.iter().filter(|p| p[0] > 2.0 * p[1] && p[0] > 0.1);
            assert!(pink.count() > 100, "the mesh behind shows");
            places.push(("a mesh behind", s));
        }
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
    let capped = geometries(&store)
        .into_iter()
        .find_map(|(kind, g)| (kind == "caps").then_some(g));
    let mut engine = scenes::gpu(&store, EngineOptions::default());
    // A few slots: rays stop and go on, some at a cap.
    let mut tight = scenes::gpu(
        &store,
        EngineOptions {
            max_slots: Some(10),
            ..EngineOptions::default()
        },
    );
    for (kind, geometry, of) in [
        (
            "everything",
            everything(&store),
            &["dvr", "mip", "pre-integrated", "surfaces"][..],
        ),
        ("caps", capped.unwrap(), &["dvr", "surfaces"]),
    ] {
        for (look, settings) in looks(&store.store) {
            if !of.contains(&look) {
                continue;
            }
            let look = format!("{kind}, {look}");
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
            tight.forget_bricks();
            let paged = tight.render(&s).unwrap();
            compare::assert_same_bits(&paged.image, &default.image, &format!("{look}, few slots"));
            if kind == "caps" {
                // Where slabs stop and go on, too.
                s.technique = Technique::Slab;
                tight.forget_bricks();
                let paged = tight.render(&s).unwrap();
                let d = difference(&paged.image, &default.image, TWIN_BOUND);
                assert_eq!(d.beyond, 0, "{look}, few slots, slab: {d}");
                s.technique = Technique::Default;
            }
            engine.set_picture(s.clone());
            scenes::tick_to_end(&mut engine, &brickscope::engine::TickBudget::default());
            let ticked = engine.image().unwrap();
            compare::assert_same_bits(ticked, &default.image, &format!("{look}, by ticks"));
        }
    }
}

/// A ray may stop at a cut face, whose brick is missing, after it has come to another part of itself, or to another level, where
/// samples have other numbers: it goes on from there.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn rays_that_stop_at_a_cap_go_on_behind_it() {
    use brickscope::engine::EngineOptions;
    use brickscope::scene::{Mode, ShadingModel, Technique};
    let store = scenes::waves_of([150, 200, 120], VoxelType::U8);
    let mut engine = scenes::gpu(&store, EngineOptions::default());
    let mut s = scenes::many_levels(&store, Mode::Iso);
    // Slabs have other gradients.
    s.shading.model = ShadingModel::None;
    // Rays go through everything; caps show above half of the range.
    s.classification.iso = scenes::translucent_surfaces(&store.store)[..1].to_vec();
    s.classification.iso[0].opacity = 0.1;
    let ahead = (s.camera.target - s.camera.eye).normalize();
    // What is cut out lies where a level ends; level 2, behind the second, is not the coarsest, which is always there.
    for (off, radius) in [(37.0, 12.0), (75.0, 5.0), (73.0, 8.0)] {
        let hole = TriangleMesh::sphere(s.camera.eye + ahead * off, radius, 3).unwrap();
        s.geometry = Arc::new(Geometry {
            clip_meshes: vec![clip(&Arc::new(hole), Side::Outside)],
            faces: CutFaces {
                are_capped: true,
                have_normals: false,
            },
            ..Geometry::default()
        });
        let what = format!("a hole of {radius} mm");
        let truth = reference(&store, &s).image;
        for technique in [Technique::Default, Technique::Multipass, Technique::Slab] {
            s.technique = technique;
            engine.forget_bricks();
            let paged = engine.render(&s).unwrap().image;
            let what = format!("{what}, {}", technique.name());
            let d = difference(&paged, &truth, TWIN_BOUND);
            println!("{what}: {d}");
            assert!(d.max < 1e-3, "{what}: {d}");
        }
        s.technique = Technique::Default;
    }
}

/// An engine on the device of that name.
fn engines(store: &TestStore) -> Vec<(&'static str, brickscope::engine::Engine)> {
    use brickscope::engine::{DeviceChoice, Engine, EngineOptions};
    let mut engines = vec![("cpu", cpu(store, EngineOptions::default()))];
    let options = EngineOptions {
        device: DeviceChoice::Reference,
        ..EngineOptions::default()
    };
    let reference = Engine::with_store(Arc::clone(&store.store), options).unwrap();
    engines.push(("reference", reference));
    #[cfg(feature = "gpu")]
    if !cfg!(skip_gpu_tests) {
        engines.push(("gpu", scenes::gpu(store, EngineOptions::default())));
    }
    engines
}

#[test]
fn inside_and_outside_make_up_the_whole() {
    use brickscope::scene::{Mode, Technique};
    let store = waves(VoxelType::U16);
    // Hollow, and of two shells that lie apart.
    let [ball, hollow, other] = [(0.6, 0.1), (0.3, 0.12), (0.2, 0.9)]
        .map(|(radius, off)| sphere(&store, radius, DVec3::new(off, -off, 0.1)));
    let mut vertices = ball.vertices().to_vec();
    let mut triangles = ball.triangles().to_vec();
    for (mesh, turned) in [(&hollow, true), (&other, false)] {
        let first = vertices.len() as u32;
        vertices.extend_from_slice(mesh.vertices());
        triangles.extend(
            mesh.triangles()
                .iter()
                .map(|&[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }.map(|v| v + first)),
        );
    }
    let mesh = Arc::new(TriangleMesh::new(vertices, triangles, None).unwrap());
    mesh.check_closed().unwrap();
    for (device, mut engine) in engines(&store) {
        let mut draw = |mode, clip_meshes: Vec<ClipMesh>| {
            let mut s = scenes::settings(&store.store, mode);
            s.geometry = Arc::new(Geometry {
                clip_meshes,
                ..Geometry::default()
            });
            // Every sample of every ray.
            (s.size, s.technique, s.opacity_cutoff) = ([80, 64], Technique::Basic, 1.0);
            engine.render(&s).unwrap()
        };
        let only = |side| vec![clip(&mesh, side)];
        for mode in [Mode::Mean, Mode::Mip] {
            let whole = draw(mode, Vec::new()).stats.samples;
            let inside = draw(mode, only(Side::Inside)).stats.samples;
            let outside = draw(mode, only(Side::Outside)).stats.samples;
            assert!(
                inside * 10 > whole && outside * 10 > whole,
                "{device}: both matter"
            );
            assert_eq!(inside + outside, whole, "{device}, {}", mode.name());
        }
        // The greatest value of a ray is inside or outside.
        let [whole, inside, outside] = [Vec::new(), only(Side::Inside), only(Side::Outside)]
            .map(|clips| draw(Mode::Mip, clips).image.pixels);
        let is_like = |a: glam::Vec4, b: glam::Vec4| (a - b).abs().max_element() < 1e-4;
        let of_one = |k: usize| is_like(whole[k], inside[k]) || is_like(whole[k], outside[k]);
        assert!((0..whole.len()).all(of_one), "{device}: one of both");
        // The control: neither alone is the whole.
        for (name, part) in [("inside", &inside), ("outside", &outside)] {
            let differ = (0..whole.len())
                .filter(|&k| !is_like(whole[k], part[k]))
                .count();
            assert!(
                differ > whole.len() / 50,
                "{device}: {name} differs in {differ}"
            );
        }
    }
}

/// A homogeneous body with three sheets of glass in it, two of them between the same two samples: known by pencil.
#[test]
fn layers_lie_where_they_are_in_a_homogeneous_body() {
    use brickscope::camera::{Camera, Projection};
    use brickscope::classify::{
        ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, TransferFunction,
    };
    use brickscope::scene::{Mode, TransferMode};
    let store = scenes::store_of(&mut scenes::field([40; 3], VoxelType::U8, |p| {
        // One voxel of another value far from the rays: a volume of one value has no range.
        if p.length() < 0.03 { 1.0 } else { 0.8 }
    }));
    let (body, opacity) = (Vec3::new(0.2, 0.5, 0.8), 0.05_f64);
    let transfer = TransferFunction::new(
        "body",
        ColorCurve::new(
            [-1000.0, 1000.0]
                .map(|x| ColorPoint {
                    x,
                    rgb: body.as_dvec3().to_array(),
                })
                .to_vec(),
            ColorSpace::Rgb,
        )
        .unwrap(),
        OpacityCurve::new(
            [-1000.0, 1000.0]
                .map(|x| OpacityPoint::linear(x, opacity))
                .to_vec(),
        )
        .unwrap(),
    );
    let eye_y = 119.63;
    let camera = Camera {
        eye: DVec3::new(22.0, eye_y, 21.0),
        target: DVec3::new(22.0, 0.0, 21.0),
        up: DVec3::Z,
        fov_y_degrees: 1.0,
        projection: Projection::Orthographic,
        near_mm: 0.0,
    };
    let sheet = |at_mm: f64, color: [f32; 3], opacity: f32| {
        let y = eye_y - at_mm;
        let corners = [(-200.0, -200.0), (400.0, -200.0), (0.0, 500.0)];
        let vertices = corners.map(|(x, z)| DVec3::new(x, y, z)).to_vec();
        drawn(
            &Arc::new(TriangleMesh::new(vertices, vec![[0, 1, 2]], None).unwrap()),
            color,
            opacity,
        )
    };
    let sheets = [
        (90.27, [0.9, 0.1, 0.1], 0.3),
        (90.41, [0.1, 0.9, 0.1], 0.5),
        (105.9, [0.1, 0.2, 0.9], 0.4),
    ];
    let mut s = PictureSettings::new(Mode::Dvr, transfer, camera);
    (s.size, s.step, s.opacity_cutoff) = ([12, 10], 0.5, 1.0);
    s.lod = brickscope::scene::LodChoice::Fixed(brickscope::geom::Lod(0));
    s.geometry = Arc::new(Geometry {
        // Told back to front.
        surfaces: sheets
            .iter()
            .rev()
            .map(|&(at, c, o)| sheet(at, c, o))
            .collect(),
        ..Geometry::default()
    });
    // Seen head-on by a headlight: all of the colour that there is, and the highlight.
    let lit = |c: [f32; 3]| {
        let light = brickscope::scene::Shading::default();
        let matte = Vec3::from(c) * (light.ambient + light.diffuse);
        (matte + light.specular).min(Vec3::ONE).as_dvec3()
    };
    // Samples lie at multiples of the step; the box is entered 80.63 mm from the eye and left at 119.63 mm. Sample i stands for
    // what follows it up to the next, a segment for what lies between two.
    let expected = |end_mm: f64| {
        let (mut color, mut passing, mut at_mm) = (DVec3::ZERO, 1.0, 81.0);
        let mut through = |to_mm: f64, layer: Option<([f32; 3], f64)>| {
            let clear = (1.0 - opacity).powf(to_mm - at_mm);
            color += body.as_dvec3() * (passing * (1.0 - clear));
            passing *= clear;
            if let Some((c, o)) = layer {
                color += lit(c) * (passing * o);
                passing *= 1.0 - o;
            }
            at_mm = to_mm;
        };
        for (to_mm, c, o) in sheets {
            through(to_mm, Some((c, f64::from(o))));
        }
        through(end_mm, None);
        color.extend(1.0 - passing).as_vec4()
    };
    for (device, mut engine) in engines(&store) {
        for (mode, end_mm) in [
            (TransferMode::Post, 120.0),
            (TransferMode::Preintegrated, 119.5),
        ] {
            s.classification.transfer_mode = mode;
            let pixels = engine.render(&s).unwrap().image.pixels;
            let wanted = expected(end_mm);
            for p in pixels {
                let off = (p - wanted).abs().max_element();
                assert!(off < 2e-4, "{device}, {mode:?}: {p} for {wanted}");
            }
        }
    }
}

/// More crossings on a ray than are sorted at a time: an onion of thirty shells that cut, and as many sheets of glass.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn rays_that_cross_a_hundred_faces_are_cut_as_the_reference_does() {
    let store = waves(VoxelType::U16);
    let shells = |count: u32, off: DVec3, from: f64| {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for n in 0..count {
            let radius = from + 0.7 * f64::from(n) / f64::from(count);
            let shell = sphere(&store, radius, off);
            let first = vertices.len() as u32;
            vertices.extend_from_slice(shell.vertices());
            // Every other one faces inward: layers and gaps.
            let is_turned = n % 2 == 0;
            triangles.extend(shell.triangles().iter().map(|&[a, b, c]| {
                if is_turned { [a, c, b] } else { [a, b, c] }.map(|v| v + first)
            }));
        }
        Arc::new(TriangleMesh::new(vertices, triangles, None).unwrap())
    };
    let geometry = Geometry {
        clip_meshes: vec![clip(&shells(30, DVec3::ZERO, 0.05), Side::Inside)],
        surfaces: vec![drawn(
            &shells(24, DVec3::new(0.1, 0.0, 0.1), 0.08),
            [0.3, 0.6, 0.9],
            0.02,
        )],
        ..Geometry::default()
    };
    let mut engine = scenes::gpu(&store, Default::default());
    let mut crossed = 0;
    for (look, settings) in looks(&store.store) {
        if ["dvr", "iso"].contains(&look) {
            let s = with(&settings, &geometry);
            let middle = s.camera.eye;
            let ahead = (s.camera.target - middle).normalize();
            crossed = geometry.spans(middle, ahead, 0.0).len();
            // Edges of a hundred shells: more rays graze one.
            let truth = reference(&store, &s).image;
            let d = difference(&engine.render(&s).unwrap().image, &truth, TWIN_BOUND);
            println!("{look}: {d}");
            assert!(
                d.beyond * 1000 <= truth.pixels.len() * 12 && d.mean < 2e-4,
                "{look}: {d}"
            );
        }
    }
    assert!(crossed > 64, "{crossed} parts on the ray in the middle");

    // With less memory than the lists of a tile need: in smaller tiles.
    let mut tight = scenes::gpu(
        &store,
        brickscope::engine::EngineOptions {
            gpu_memory_bytes: Some(96 << 20),
            ..Default::default()
        },
    );
    let mut s = with(&looks(&store.store)[0].1, &geometry);
    s.size = [160, 128];
    let tiled = tight.render(&s).unwrap();
    assert!(
        tiled.notes.iter().any(|n| n.contains("smaller tiles")),
        "{:?}",
        tiled.notes
    );
    assert!(tiled.stats.gpu_bytes.unwrap() <= 96 << 20);
    let d = difference(&tiled.image, &engine.render(&s).unwrap().image, TWIN_BOUND);
    println!("in smaller tiles: {d}");
    assert!(d.beyond <= 40 && d.mean < 1e-4, "in smaller tiles: {d}");
}

/// A volume 2¹⁵ voxels long, seen along its length: what lies at its far end is where it is, to a hundredth of a voxel, and cut
/// there.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_far_end_of_a_long_volume_is_exact() {
    use brickscope::camera::{Camera, Projection};
    use brickscope::scene::Mode;
    const LONG: u64 = 1 << 15;
    let store = scenes::store_of(&mut scenes::field([LONG, 24, 24], VoxelType::U8, |p| {
        let x = p.x * LONG as f64;
        let off = (p.y - 0.5).hypot(p.z - 0.5);
        // Beads on a string, every 64 voxels, in the last quarter only.
        let bead = ((x / 64.0).fract() - 0.5).hypot(off * 24.0 / 64.0);
        if p.x > 0.75 {
            (1.0 - bead * 4.0).max(0.0)
        } else {
            0.0
        }
    }));
    let mut s = scenes::settings(&store.store, Mode::Iso);
    let end = LONG as f64;
    s.camera = Camera {
        eye: DVec3::new(-20.0, 12.0, 14.0),
        target: DVec3::new(end, 11.5, 11.5),
        up: DVec3::Z,
        fov_y_degrees: 0.05,
        projection: Projection::Perspective,
        near_mm: 0.1,
    };
    (s.size, s.step, s.depths) = ([24, 20], 1.0, true);
    s.lod = brickscope::scene::LodChoice::Fixed(brickscope::geom::Lod(0));
    let far = DVec3::new(end - 300.0, 11.5, 11.5);
    let geometry = Geometry {
        planes: vec![Plane::new(DVec3::X, -(end - 1000.0)).unwrap()],
        surfaces: vec![drawn(
            &Arc::new(TriangleMesh::sphere(far, 9.0, 4).unwrap()),
            [0.9, 0.4, 0.2],
            1.0,
        )],
        ..Geometry::default()
    };
    let mut engine = scenes::gpu(&store, Default::default());
    for geometry in [Geometry::default(), geometry] {
        s.geometry = Arc::new(geometry);
        let truth = reference(&store, &s).image;
        let image = engine.render(&s).unwrap().image;
        let pairs = || {
            image
                .depths
                .iter()
                .flatten()
                .zip(truth.depths.iter().flatten())
        };
        let seen = pairs()
            .filter(|(_, t)| t[0] > 0.74 * end as f32 && t[0].is_finite())
            .count();
        assert!(seen > 60, "{seen} pixels show the far end");
        let off = |(a, b): &(&[f32; 2], &[f32; 2])| a[0] != b[0] && (a[0] - b[0]).abs() > 0.01;
        let wrong = pairs().filter(off).count();
        assert!(
            wrong * 100 <= 3 * seen,
            "{wrong} of {seen} pixels are off by more than 0.01 mm"
        );
    }
}
