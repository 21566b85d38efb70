//! What rays make of planes, of meshes inside and outside, of surfaces, and of all of them together.

use proptest::prelude::*;

use super::*;
use crate::clip::OrientedBox;

const NEVER: f64 = f64::INFINITY;

fn plane(normal: DVec3, offset: f64) -> Plane {
    Plane::new(normal, offset).unwrap()
}

fn clip(mesh: TriangleMesh, side: Side) -> ClipMesh {
    ClipMesh {
        mesh: Arc::new(mesh.into_closed().unwrap()),
        side,
    }
}

fn surface(mesh: TriangleMesh, opacity: f32) -> SurfaceMesh {
    SurfaceMesh {
        mesh: Arc::new(mesh),
        color: Vec3::ONE,
        opacity,
    }
}

fn ball(center: DVec3, radius: f64) -> TriangleMesh {
    TriangleMesh::sphere(center, radius, 3).unwrap()
}

fn cube(center: DVec3, half: f64) -> TriangleMesh {
    TriangleMesh::cuboid(center - half, center + half).unwrap()
}

/// Several meshes as one.
fn together(meshes: &[TriangleMesh]) -> TriangleMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices());
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    TriangleMesh::new(vertices, triangles, None).unwrap()
}

/// A square in the plane x = `at`, of 20 mm.
fn wall(at: f64) -> TriangleMesh {
    let corner = |y: f64, z: f64| DVec3::new(at, y * 10.0, z * 10.0);
    let vertices = vec![
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    TriangleMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]], None).unwrap()
}

/// Along x from −10, a little beside the edges of what is centred.
fn along_x(geometry: &Geometry, near_mm: f64) -> Vec<Span> {
    geometry.spans(DVec3::new(-10.0, 0.1, 0.2), DVec3::X, near_mm)
}

/// Begins and ends, to a micrometre.
fn assert_volume(spans: &[Span], expected: &[[f64; 2]]) {
    let volume: Vec<[f64; 2]> = spans
        .iter()
        .filter(|s| s.begin_mm < s.end_mm)
        .map(|s| [s.begin_mm, s.end_mm])
        .collect();
    let is_near = |a: f64, b: f64| a == b || (a - b).abs() < 1e-6;
    let agree = volume.len() == expected.len()
        && std::iter::zip(volume.as_flattened(), expected.as_flattened())
            .all(|(&a, &b)| is_near(a, b));
    assert!(agree, "{volume:?}, not {expected:?}");
}

#[test]
fn without_anything_a_ray_is_one_span() {
    let spans = along_x(&Geometry::default(), 3.0);
    let whole = Span {
        begin_mm: 3.0,
        end_mm: NEVER,
        cut: None,
        layer: None,
    };
    assert_eq!(spans, [whole]);
}

#[test]
fn half_spaces_cut_at_both_ends() {
    let geometry = Geometry {
        planes: vec![
            plane(DVec3::X, 4.0),
            plane(DVec3::new(2.0, 0.0, 2.0), 0.0),
            plane(DVec3::NEG_X, 5.0),
            plane(DVec3::Y, 1.0),
        ],
        ..Default::default()
    };
    // x ≥ −4, x + z ≥ 0, x ≤ 5 where z = 0.2.
    let spans = along_x(&geometry, 0.0);
    assert_volume(&spans, &[[9.8, 15.0]]);
    let normal = spans[0].cut.unwrap();
    assert!(
        normal.distance(DVec3::new(-1.0, 0.0, -1.0).normalize()) < 1e-12,
        "{normal}"
    );
    // From within nothing is cut in front.
    let spans = along_x(&geometry, 12.0);
    assert_volume(&spans, &[[12.0, 15.0]]);
    assert_eq!(spans[0].cut, None);
    // Behind, beside, and the wrong way.
    assert_eq!(along_x(&geometry, 15.0), []);
    assert_eq!(
        geometry.spans(DVec3::new(-10.0, -1.1, 0.0), DVec3::X, 0.0),
        []
    );
    assert_eq!(geometry.spans(DVec3::new(6.0, 0.0, 0.0), DVec3::X, 0.0), []);
    let along = geometry.spans(DVec3::new(0.0, -3.0, 0.0), DVec3::Y, 0.0);
    assert_volume(&along, &[[2.0, NEVER]]);
}

#[test]
fn a_cube_is_kept_inside_or_outside() {
    let geometry = |side| Geometry {
        clip_meshes: vec![clip(cube(DVec3::ZERO, 2.0), side)],
        ..Default::default()
    };
    let inside = along_x(&geometry(Side::Inside), 1.0);
    assert_volume(&inside, &[[8.0, 12.0]]);
    assert_eq!(
        inside[0].cut,
        Some(DVec3::NEG_X),
        "the cut face looks at the eye"
    );
    let outside = along_x(&geometry(Side::Outside), 1.0);
    assert_volume(&outside, &[[1.0, 8.0], [12.0, NEVER]]);
    assert_eq!(outside[0].cut, None);
    assert_eq!(outside[1].cut, Some(DVec3::NEG_X), "from inside, too");
    // The eye, or the near plane, in the cube.
    assert_volume(&along_x(&geometry(Side::Inside), 10.5), &[[10.5, 12.0]]);
    assert_eq!(along_x(&geometry(Side::Inside), 10.5)[0].cut, None);
    assert_volume(&along_x(&geometry(Side::Outside), 10.5), &[[12.0, NEVER]]);
    let middle = geometry(Side::Inside).spans(DVec3::ZERO, DVec3::X, 0.0);
    assert_volume(&middle, &[[0.0, 2.0]]);
    // Past it.
    assert_eq!(along_x(&geometry(Side::Inside), 12.5), []);
    assert_volume(&along_x(&geometry(Side::Outside), 12.5), &[[12.5, NEVER]]);
}

/// The rule is non-zero: a shell within a shell is hollow when it is inside out, solid when it is not.
#[test]
fn shells_in_shells_are_hollow_when_turned() {
    let inner = cube(DVec3::ZERO, 1.0);
    let turned: Vec<[u32; 3]> = inner
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b])
        .collect();
    let turned = TriangleMesh::new(inner.vertices().to_vec(), turned, None).unwrap();
    let outer = cube(DVec3::ZERO, 4.0);
    let of = |meshes: &[TriangleMesh], side| Geometry {
        clip_meshes: vec![clip(together(meshes), side)],
        ..Default::default()
    };
    let hollow = [outer.clone(), turned.clone()];
    let spans = along_x(&of(&hollow, Side::Inside), 0.0);
    assert_volume(&spans, &[[6.0, 9.0], [11.0, 14.0]]);
    assert_eq!(spans[1].cut, Some(DVec3::NEG_X));
    let spans = along_x(&of(&hollow, Side::Outside), 0.0);
    assert_volume(&spans, &[[0.0, 6.0], [9.0, 11.0], [14.0, NEVER]]);
    // From the hollow.
    let spans = of(&hollow, Side::Inside).spans(DVec3::new(0.0, 0.1, 0.2), DVec3::X, 0.0);
    assert_volume(&spans, &[[1.0, 4.0]]);
    let solid = along_x(&of(&[outer.clone(), inner], Side::Inside), 0.0);
    assert_volume(&solid, &[[6.0, 14.0]]);
    // All of it inside out, and shells that overlap.
    let alone = along_x(&of(&[turned], Side::Inside), 0.0);
    assert_volume(&alone, &[[9.0, 11.0]]);
    let row = [outer, cube(DVec3::X * 3.0, 4.0), cube(DVec3::X * 20.0, 1.0)];
    let spans = along_x(&of(&row, Side::Inside), 0.0);
    assert_volume(&spans, &[[6.0, 17.0], [29.0, 31.0]]);
}

#[test]
fn planes_boxes_and_meshes_intersect() {
    let block = OrientedBox::between(DVec3::new(-3.0, -9.0, -9.0), DVec3::new(9.0, 9.0, 9.0));
    let mut geometry = Geometry {
        planes: block.unwrap().planes().to_vec(),
        clip_meshes: vec![
            clip(ball(DVec3::ZERO, 5.0), Side::Inside),
            clip(cube(DVec3::X * 2.0, 1.0), Side::Outside),
        ],
        ..Default::default()
    };
    // −3 by the box, the cube from 1 to 3, the ball near 5.
    let spans = along_x(&geometry, 0.0);
    let end = spans[1].end_mm;
    assert!((14.9..15.0).contains(&end), "{end}");
    assert_volume(&spans, &[[7.0, 11.0], [13.0, end]]);
    assert_eq!(spans[0].cut, Some(DVec3::NEG_X), "of the box");
    assert_eq!(spans[1].cut, Some(DVec3::NEG_X), "of the cube");
    geometry.planes.push(plane(DVec3::NEG_X, 2.0));
    assert_volume(&along_x(&geometry, 0.0), &[[7.0, 11.0]]);
    geometry.planes.push(plane(DVec3::X, -2.0));
    assert_volume(&along_x(&geometry, 0.0), &[]);
}

#[test]
fn layers_come_in_order_and_an_opaque_one_is_the_last() {
    let mut geometry = Geometry {
        surfaces: vec![
            surface(wall(6.0), 1.0),
            surface(wall(-2.0), 0.5),
            surface(wall(3.0), 0.25),
            surface(wall(8.0), 0.5),
        ],
        ..Default::default()
    };
    let layers = |spans: &[Span]| -> Vec<(usize, f64)> {
        let of = |s: &Span| s.layer.map(|l| (l.surface, l.at_mm));
        spans.iter().filter_map(of).collect()
    };
    let spans = along_x(&geometry, 0.0);
    assert_eq!(layers(&spans), [(1, 8.0), (2, 13.0), (0, 16.0)]);
    assert_volume(&spans, &[[0.0, 8.0], [8.0, 13.0], [13.0, 16.0]]);
    assert_eq!(spans.len(), 3, "nothing behind what is opaque");
    let normal = spans[0].layer.unwrap().normal;
    assert!((normal.dot(DVec3::X).abs() - 1.0).abs() < 1e-12, "{normal}");
    // From between them.
    assert_eq!(layers(&along_x(&geometry, 10.0)), [(2, 13.0), (0, 16.0)]);
    geometry.surfaces[0].opacity = 0.99;
    let spans = along_x(&geometry, 0.0);
    assert_eq!(layers(&spans), [(1, 8.0), (2, 13.0), (0, 16.0), (3, 18.0)]);
    assert_eq!(spans[4].end_mm, NEVER);
}

#[test]
fn surfaces_are_seen_where_the_volume_is_cut_away() {
    let geometry = Geometry {
        faces: CutFaces::default(),
        planes: vec![plane(DVec3::X, 0.0), plane(DVec3::NEG_X, 5.0)],
        clip_meshes: vec![clip(cube(DVec3::X * 2.0, 1.0), Side::Outside)],
        surfaces: [-2.0, 0.5, 2.0, 4.0, 7.0]
            .map(|at| surface(wall(at), 0.5))
            .to_vec(),
    };
    let spans = along_x(&geometry, 0.0);
    let layers: Vec<usize> = spans
        .iter()
        .filter_map(|s| Some(s.layer?.surface))
        .collect();
    assert_eq!(layers, [0, 1, 2, 3, 4], "all of them: {spans:#?}");
    assert_volume(
        &spans,
        &[[10.0, 10.5], [10.5, 11.0], [13.0, 14.0], [14.0, 15.0]],
    );
    let cuts: Vec<bool> = spans
        .iter()
        .filter(|s| s.begin_mm < s.end_mm)
        .map(|s| s.cut.is_some())
        .collect();
    assert_eq!(
        cuts,
        [true, false, true, false],
        "behind a layer nothing is cut"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// Every part of a ray is inside or outside a ball, none both; and it is where it says.
    #[test]
    fn inside_and_outside_part_every_ray(
        origin in prop::array::uniform3(-3.0..3.0_f64),
        aim in prop::array::uniform3(-1.5..1.5_f64),
        near_mm in 0.0..4.0_f64,
    ) {
        thread_local! {
            static BALL: Arc<TriangleMesh> = Arc::new(ball(DVec3::splat(0.25), 1.5));
        }
        let (origin, aim) = (DVec3::from_array(origin), DVec3::from_array(aim));
        prop_assume!(origin.distance(aim) > 1e-3);
        let direction = (aim - origin).normalize();
        let of = |side| {
            let geometry = Geometry {
                clip_meshes: vec![ClipMesh { mesh: BALL.with(Arc::clone), side }],
                ..Default::default()
            };
            geometry.spans(origin, direction, near_mm)
        };
        let (inside, outside) = (of(Side::Inside), of(Side::Outside));
        for (spans, side) in [(&inside, Side::Inside), (&outside, Side::Outside)] {
            for span in spans {
                if let Some(cut) = span.cut {
                    prop_assert!(cut.dot(direction) <= 0.0, "{cut} looks away");
                    prop_assert!((cut.length() - 1.0).abs() < 1e-9);
                }
                // A chord of the polyhedron lies this far within the ball at most.
                let end_mm = span.end_mm.min(span.begin_mm + 10.0);
                for part in [0.01, 0.3, 0.99] {
                    let at = origin + direction * (span.begin_mm + (end_mm - span.begin_mm) * part);
                    let from_center = at.distance(DVec3::splat(0.25));
                    let is_right = match side {
                        Side::Inside => from_center < 1.5,
                        Side::Outside => from_center > 1.5 * 0.98,
                    };
                    prop_assert!(is_right, "{side:?} at {from_center} of 1.5 mm");
                }
            }
        }
        let mut all: Vec<[f64; 2]> = inside.iter().chain(&outside).map(|s| [s.begin_mm, s.end_mm]).collect();
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        prop_assert_eq!(all[0][0], near_mm);
        prop_assert_eq!(all[all.len() - 1][1], NEVER);
        for pair in all.windows(2) {
            prop_assert_eq!(pair[0][1], pair[1][0], "{:?}", all);
        }
    }
}

#[test]
fn touching_shells_cut_nothing_between_them() {
    let both = together(&[cube(DVec3::ZERO, 1.0), cube(DVec3::X * 2.0, 1.0)]);
    for (side, wanted) in [
        (Side::Inside, vec![[9.0, 13.0]]),
        (Side::Outside, vec![[0.0, 9.0], [13.0, NEVER]]),
    ] {
        let geometry = Geometry {
            clip_meshes: vec![clip(both.clone(), side)],
            ..Geometry::default()
        };
        assert_volume(&along_x(&geometry, 0.0), &wanted);
    }
}

#[test]
fn a_face_that_is_cut_and_drawn_is_cut_behind_its_layer() {
    let geometry = Geometry {
        clip_meshes: vec![clip(cube(DVec3::ZERO, 1.0), Side::Inside)],
        surfaces: vec![surface(cube(DVec3::ZERO, 1.0), 0.5)],
        ..Geometry::default()
    };
    let spans = along_x(&geometry, 0.0);
    let layers: Vec<f64> = spans.iter().filter_map(|s| Some(s.layer?.at_mm)).collect();
    assert_eq!(layers, [9.0, 11.0]);
    assert_volume(&spans, &[[9.0, 11.0]]);
    let kept = spans.iter().find(|s| s.begin_mm < s.end_mm).unwrap();
    assert_eq!(kept.cut, Some(DVec3::NEG_X), "{spans:#?}");
}
