//! Where a ray crosses a mesh: every crossing, each once, without gaps between triangles.
//!
//! After Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (JCGT 2013): vertices are sheared so that the ray is
//! the z axis, each by itself, so that neighbours see the same points; what is then asked is whether the origin lies in a
//! triangle of the plane. Two things differ. The signs of the edge functions are exact, not only equal up to sign between
//! neighbours. And an edge through the origin is decided as if the ray lay at (ε, ε²) for an ε smaller than anything else
//! (Edelsbrunner and Mücke, "Simulation of Simplicity", 1990): so exactly one triangle of those around an edge or a vertex
//! owns it, and a closed mesh is entered as often as it is left, wherever the ray goes.

use glam::DVec3;

use super::TriangleMesh;
use super::bvh::Bvh;

/// Where a ray crosses a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance from the ray's origin, mm.
    pub at_mm: f64,
    /// Which triangle.
    pub triangle: u32,
    /// Does the ray come from the side that the triangle faces?
    pub enters: bool,
}

/// Space in which a ray begins at the origin and runs along z.
struct RaySpace {
    origin: DVec3,
    /// The world's axes that become x, y and z; z is the one along which the ray runs most. Right-handed.
    axes: [usize; 3],
    shear: [f64; 2],
    /// Distance along the ray per z.
    per_z: f64,
}

impl RaySpace {
    fn new(origin: DVec3, direction: DVec3) -> Self {
        let z = direction.abs().max_position();
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let per_z = 1.0 / direction[z];
        Self {
            origin,
            axes,
            shear: [
                direction[axes[0]] / direction[z],
                direction[axes[1]] / direction[z],
            ],
            per_z,
        }
    }

    /// Where a vertex lies beside the ray, and its distance along it.
    fn ray_from_world(&self, vertex: DVec3) -> DVec3 {
        let from_origin = (vertex - self.origin).to_array();
        let [x, y, z] = self.axes.map(|a| from_origin[a]);
        DVec3::new(x - self.shear[0] * z, y - self.shear[1] * z, z * self.per_z)
    }

    /// Where the ray crosses a triangle, corners in this space: its distance, and does it enter?
    fn crossing(&self, [a, b, c]: [DVec3; 3]) -> Option<(f64, bool)> {
        let weights = [edge(b, c), edge(c, a), edge(a, b)];
        let sides = [
            side(weights[0], b, c),
            side(weights[1], c, a),
            side(weights[2], a, b),
        ];
        let is_left = sides.iter().all(|&s| s > 0.0);
        if !is_left && !sides.iter().all(|&s| s < 0.0) {
            return None;
        }
        // No two have different signs, and not all are 0: the triangle would have no area here, and no side of it be left of
        // the origin and another not right of it.
        let sum: f64 = weights.iter().sum();
        let at_mm = (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / sum;
        // Counter-clockwise around z is seen from behind when z is the way the ray goes.
        Some((at_mm, is_left != (self.per_z > 0.0)))
    }
}

/// Twice the area of the triangle of the origin, `p` and `q`, positive where the origin lies left of the way from `p` to `q`.
/// The sign is exact, unless products underflow (10⁻¹⁴⁰ mm from the ray).
fn edge(p: DVec3, q: DVec3) -> f64 {
    let (plus, minus) = (p.x * q.y, p.y * q.x);
    if plus != minus {
        // Rounding keeps the order.
        return plus - minus;
    }
    // What rounding took away; exact, too.
    p.x.mul_add(q.y, -plus) - p.y.mul_add(q.x, -minus)
}

/// Of the sign of `edge`; where that is 0, of what it would be for a ray at (ε, ε²): ε (p.y − q.y) + ε² (q.x − p.x).
fn side(edge: f64, p: DVec3, q: DVec3) -> f64 {
    if edge != 0.0 {
        edge
    } else if p.y != q.y {
        p.y - q.y
    } else {
        q.x - p.x
    }
}

impl TriangleMesh {
    /// Appends to `out` all places where the ray from `origin` (world mm) along `direction` (unit) crosses the mesh at a
    /// distance greater than 0, in no order.
    ///
    /// A ray through an edge or a vertex crosses one of its triangles, or as many in as out where it only touches. On the
    /// whole line a closed mesh is left as often as it is entered.
    pub fn crossings(&self, origin: DVec3, direction: DVec3, out: &mut Vec<Crossing>) {
        let space = RaySpace::new(origin, direction);
        let bvh = self
            .bvh
            .get_or_init(|| Bvh::new(&self.vertices, &self.triangles));
        bvh.visit(origin, direction, |triangle| {
            let corners = self.corners(triangle).map(|v| space.ray_from_world(v));
            if let Some((at_mm, enters)) = space.crossing(corners)
                && at_mm > 0.0
            {
                out.push(Crossing {
                    at_mm,
                    triangle,
                    enters,
                });
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whatever the tree says: every triangle is tried.
    fn brute_force(mesh: &TriangleMesh, origin: DVec3, direction: DVec3) -> Vec<Crossing> {
        let space = RaySpace::new(origin, direction);
        (0..mesh.triangle_count() as u32)
            .filter_map(|triangle| {
                let corners = mesh.corners(triangle).map(|v| space.ray_from_world(v));
                let (at_mm, enters) = space.crossing(corners)?;
                (at_mm > 0.0).then_some(Crossing {
                    at_mm,
                    triangle,
                    enters,
                })
            })
            .collect()
    }

    fn crossings(mesh: &TriangleMesh, origin: DVec3, direction: DVec3) -> Vec<Crossing> {
        let mut found = Vec::new();
        mesh.crossings(origin, direction, &mut found);
        found.sort_by(|a, b| a.at_mm.total_cmp(&b.at_mm));
        found
    }

    fn balance(crossings: &[Crossing]) -> i32 {
        crossings
            .iter()
            .map(|c| if c.enters { 1 } else { -1 })
            .sum()
    }

    /// A cube from −1 to 1 whose sides are divided into `n` × `n` squares of two triangles.
    fn fine_cube(n: u32) -> TriangleMesh {
        let at = |i: u32| f64::from(i) * 2.0 / f64::from(n) - 1.0;
        let mut vertices = Vec::new();
        for (axis, far) in [
            (0, false),
            (0, true),
            (1, false),
            (1, true),
            (2, false),
            (2, true),
        ] {
            for i in 0..n {
                for j in 0..n {
                    let corner = |[di, dj]: [u32; 2]| {
                        let mut v = DVec3::ZERO;
                        v[axis] = if far { 1.0 } else { -1.0 };
                        v[(axis + 1) % 3] = at(i + di);
                        v[(axis + 2) % 3] = at(j + dj);
                        v
                    };
                    let mut order = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]];
                    if !far {
                        order.reverse();
                    }
                    vertices.extend(order.map(corner));
                }
            }
        }
        let triangles = (0..vertices.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        let mesh = TriangleMesh::new(vertices, triangles.collect(), None).unwrap();
        mesh.check_closed().unwrap();
        mesh
    }

    /// Vertices, middles of edges and of triangles.
    fn aims(mesh: &TriangleMesh) -> Vec<DVec3> {
        let mut aims = mesh.vertices().to_vec();
        for t in 0..mesh.triangle_count() as u32 {
            let [a, b, c] = mesh.corners(t);
            aims.extend([(a + b) / 2.0, (b + c) / 2.0, (a + b + c) / 3.0]);
        }
        aims
    }

    /// Rays through the middle of convex bodies, exactly at what may leak: in once, out once.
    #[test]
    fn no_ray_leaks_between_triangles() {
        let sphere = TriangleMesh::sphere(DVec3::ZERO, 1.0, 2).unwrap();
        let cube = fine_cube(4);
        for mesh in [&sphere, &cube] {
            for aim in aims(mesh) {
                for origin in [DVec3::new(0.25, 0.125, 0.5), DVec3::ZERO] {
                    let direction = (aim - origin).normalize();
                    let out = crossings(mesh, origin, direction);
                    assert_eq!(out.len(), 1, "from {origin} to {aim}: {out:?}");
                    assert!(!out[0].enters, "from inside to {aim}");
                    assert!((out[0].at_mm - origin.distance(aim)).abs() < 1e-12);
                    let both = crossings(mesh, origin - 8.0 * direction, direction);
                    assert_eq!(both.len(), 2, "through {aim}: {both:?}");
                    assert!(both[0].enters && !both[1].enters, "through {aim}");
                }
            }
        }
    }

    /// Both products round to 1 + 2ε, of which one is ε² more.
    #[test]
    fn the_side_of_an_edge_is_told_by_what_rounding_takes_away() {
        let e = f64::EPSILON;
        let (p, q) = (
            DVec3::new(1.0 + e, 1.0, 0.0),
            DVec3::new(1.0 + 2.0 * e, 1.0 + e, 0.0),
        );
        assert_eq!(p.x * q.y, p.y * q.x);
        assert_eq!(edge(p, q), e * e);
        assert_eq!(edge(q, p), -e * e);
    }

    /// Where nothing is round: turned, moved far, and rays that come from anywhere.
    #[test]
    fn rays_at_vertices_of_a_turned_mesh_far_away_are_balanced() {
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
        let place = |v: &DVec3| turn * *v * 70.0 + DVec3::new(9e4, -3e5, 12.0);
        let cube = fine_cube(5);
        let vertices: Vec<DVec3> = cube.vertices().iter().map(place).collect();
        let mesh = TriangleMesh::new(vertices, cube.triangles().to_vec(), None).unwrap();
        let aims: Vec<(DVec3, DVec3)> = aims(&cube).into_iter().zip(aims(&mesh)).collect();
        let mut crossed = 0;
        for (a, from) in aims.iter().step_by(7) {
            for (b, to) in aims.iter().step_by(3).filter(|to| to.1 != *from) {
                let direction = (*to - *from).normalize();
                let found = crossings(&mesh, *from - 1e3 * direction, direction);
                assert_eq!(balance(&found), 0, "{from} to {to}: {found:?}");
                // Within a side, which rounding has made uneven, anything may be crossed.
                let is_within = (0..3).any(|k| a[k].abs() == 1.0 && a[k] == b[k]);
                if !is_within {
                    assert_eq!(found.len(), 2, "{from} to {to}: {found:?}");
                    crossed += 1;
                }
            }
        }
        assert!(crossed > 10_000, "{crossed} rays through");
    }

    /// Along axes and diagonals, through vertices, along edges and within sides: exact ties of every kind.
    #[test]
    fn rays_along_a_grid_of_vertices_are_balanced_and_counted_once() {
        let cube = fine_cube(4);
        let steps = || (-5..=5).map(|i| f64::from(i) * 0.25);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut direction = DVec3::ZERO;
                direction[axis] = sign;
                for i in steps() {
                    for j in steps() {
                        let mut origin = direction * -3.0;
                        origin[(axis + 1) % 3] = i;
                        origin[(axis + 2) % 3] = j;
                        let found = crossings(&cube, origin, direction);
                        assert_eq!(balance(&found), 0, "{origin} {direction}: {found:?}");
                        let (a, b) = (i.abs(), j.abs());
                        if a < 1.0 && b < 1.0 {
                            assert_eq!(found.len(), 2, "{origin} {direction}: {found:?}");
                        } else if a > 1.0 || b > 1.0 {
                            assert_eq!(found.len(), 0, "{origin} {direction}: {found:?}");
                        }
                    }
                }
            }
        }
        // Lines between vertices, many of them within sides.
        let vertices = cube.vertices();
        for a in vertices {
            for b in vertices.iter().step_by(3).filter(|b| *b != a) {
                let direction = (*b - *a).normalize();
                let found = crossings(&cube, *a - 10.0 * direction, direction);
                assert_eq!(balance(&found), 0, "{a} to {b}: {found:?}");
                assert!(found.len() <= 2, "{a} to {b}: {found:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_trying_all_finds(
            origin in prop::array::uniform3(-3.0..3.0_f64),
            aim in prop::array::uniform3(-1.2..1.2_f64),
            is_flat in prop::array::uniform3(any::<bool>()),
        ) {
            thread_local! {
                static MESHES: [TriangleMesh; 2] =
                    [TriangleMesh::sphere(DVec3::ZERO, 1.0, 3).unwrap(), fine_cube(6)];
            }
            let origin = DVec3::from_array(origin);
            let mut aim = DVec3::from_array(aim) - origin;
            for axis in 0..3 {
                if is_flat[axis] {
                    aim[axis] = 0.0;
                }
            }
            prop_assume!(aim != DVec3::ZERO);
            let direction = aim.normalize();
            MESHES.with(|meshes| {
                for mesh in meshes {
                    let found = crossings(mesh, origin, direction);
                    let mut expected = brute_force(mesh, origin, direction);
                    expected.sort_by(|a, b| a.at_mm.total_cmp(&b.at_mm));
                    prop_assert_eq!(&found, &expected);
                    let line = crossings(mesh, origin - 9.0 * direction, direction);
                    prop_assert_eq!(balance(&line), 0);
                }
                Ok(())
            })?;
        }
    }
}
