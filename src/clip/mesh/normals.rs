//! Normals of triangles, of their corners, and between the corners.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::TriangleMesh;

/// Triangles that differ by more are seen with an edge between them: cos 30°.
const SMOOTH_COS: f64 = 0.866_025_403_784_438_6;
/// Corners of vertices with more triangles have their triangle's normal: each triangle is compared with each other there.
const MOST_AROUND: usize = 256;

/// Unit normal of a triangle, by its winding; across its longest side where its area is 0.
fn unit_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    // Neither squares nor products of tiny sides may become 0.
    let size = ab.abs().max(ac.abs()).max_element();
    let normal = (ab / size).cross(ac / size);
    normal.try_normalize().unwrap_or_else(|| {
        let longest = [ab, ac, c - b]
            .into_iter()
            .max_by(|p, q| p.length_squared().total_cmp(&q.length_squared()))
            .and_then(|side| (side / size).try_normalize());
        longest.map_or(DVec3::Z, |side| side.any_orthonormal_vector())
    })
}

/// The angle at the first of three corners.
fn angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    (b - a).angle_between(c - a)
}

/// The normals at the corners of each triangle, from the triangles around: [`TriangleMesh::corner_normals`].
pub(super) fn of_corners(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<[Vec3; 3]> {
    let corners = |t: usize| triangles[t].map(|v| vertices[v as usize]);
    let face_normals: Vec<DVec3> = (0..triangles.len())
        .into_par_iter()
        .map(|t| unit_normal(corners(t)))
        .collect();
    // Which corners (3 × triangle + corner) lie at each vertex, one list behind the other.
    let mut begins = vec![0_usize; vertices.len() + 1];
    for &v in triangles.as_flattened() {
        begins[v as usize + 1] += 1;
    }
    for v in 0..vertices.len() {
        begins[v + 1] += begins[v];
    }
    let mut around = vec![0_usize; begins[vertices.len()]];
    let mut next = begins.clone();
    for (corner, &v) in triangles.as_flattened().iter().enumerate() {
        around[next[v as usize]] = corner;
        next[v as usize] += 1;
    }
    let weights: Vec<f64> = (0..triangles.len() * 3)
        .into_par_iter()
        .map(|corner| {
            let places = corners(corner / 3);
            angle(
                places[corner % 3],
                places[(corner + 1) % 3],
                places[(corner + 2) % 3],
            )
        })
        .collect();
    (0..triangles.len())
        .into_par_iter()
        .map(|t| {
            let own = face_normals[t];
            triangles[t].map(|v| {
                let here = &around[begins[v as usize]..begins[v as usize + 1]];
                if here.len() > MOST_AROUND {
                    return own.as_vec3();
                }
                let near = here
                    .iter()
                    .filter(|&&c| face_normals[c / 3].dot(own) >= SMOOTH_COS);
                let sum: DVec3 = near.map(|&c| face_normals[c / 3] * weights[c]).sum();
                sum.try_normalize().unwrap_or(own).as_vec3()
            })
        })
        .collect()
}

/// Takes the `given` normals, of any length, where they are one.
pub(super) fn prefer(given: &[[Vec3; 3]], corner_normals: &mut [[Vec3; 3]]) {
    for (corners, given) in corner_normals.iter_mut().zip(given) {
        for (normal, given) in corners.iter_mut().zip(given) {
            if let Some(unit) = given.as_dvec3().try_normalize() {
                *normal = unit.as_vec3();
            }
        }
    }
}

impl TriangleMesh {
    /// Unit normal of a triangle, to the side from which its corners are seen counter-clockwise.
    pub fn face_normal(&self, triangle: u32) -> DVec3 {
        unit_normal(self.corners(triangle))
    }

    /// Unit normal for lighting at `point` of a triangle, between those of its corners by barycentric coordinates; a point
    /// outside it is moved to its rim. The face's own normal where the corners' cancel out or it has no area.
    pub fn normal_at(&self, triangle: u32, point: DVec3) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        let (ab, ac, ap) = (b - a, c - a, point - a);
        let normal = ab.cross(ac);
        let weights = DVec3::new(
            (b - point).cross(c - point).dot(normal),
            ap.cross(ac).dot(normal),
            ab.cross(ap).dot(normal),
        )
        .max(DVec3::ZERO);
        let normals = self.corner_normals[triangle as usize].map(|n| n.as_dvec3());
        // Their sum is at least the square of twice the area.
        let sum = weights.element_sum();
        let between: DVec3 = (0..3).map(|i| normals[i] * (weights[i] / sum)).sum();
        between
            .try_normalize()
            .unwrap_or_else(|| self.face_normal(triangle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cube_keeps_its_edges() {
        let cube = TriangleMesh::cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)).unwrap();
        for t in 0..12 {
            let own = cube.face_normal(t);
            assert_eq!(own.abs().element_sum(), 1.0, "along an axis: {own}");
            assert_eq!(cube.corner_normals()[t as usize], [own.as_vec3(); 3]);
        }
    }

    #[test]
    fn a_sphere_is_smooth() {
        let sphere = TriangleMesh::sphere(DVec3::ZERO, 10.0, 3).unwrap();
        for t in 0..sphere.triangle_count() as u32 {
            let corners = sphere.corners(t);
            for corner in corners {
                let normal = sphere.normal_at(t, corner);
                assert!(normal.dot(corner / 10.0) > 0.9999, "{normal} at {corner}");
            }
            let middle = (corners[0] + corners[1]) / 2.0;
            let radial = middle.normalize();
            let (smooth, flat) = (sphere.normal_at(t, middle), sphere.face_normal(t));
            assert!(smooth.dot(radial) > 0.9999, "{smooth} at {middle}");
            assert!(flat.dot(radial) < 0.9999, "the faces themselves are not");
            // Moved out of the triangle, its rim is what counts.
            let apart = middle + (middle - corners[2]);
            assert!(sphere.normal_at(t, apart).distance(smooth) < 1e-3);
        }
    }

    /// A weight by number of triangles would lean to the side that is divided once more.
    #[test]
    fn means_are_weighted_by_angles() {
        let at = |x: f64, y: f64, slope: f64| DVec3::new(x, y, slope * x.abs());
        let vertices = vec![
            DVec3::ZERO,
            at(1.0, -1.0, -0.1),
            at(1.0, 1.0, -0.1),
            at(-1.0, 1.0, -0.1),
            at(-1.0, -1.0, -0.1),
            at(1.0, 0.0, -0.1),
        ];
        // Right of the ridge two triangles, left one over the same angle.
        let triangles = vec![[0, 1, 5], [0, 5, 2], [0, 3, 4]];
        let mesh = TriangleMesh::new(vertices, triangles, None).unwrap();
        let normal = mesh.corner_normals()[0][0];
        assert!(normal.x.abs() < 1e-7 && normal.z > 0.9, "{normal}");
    }

    #[test]
    fn given_normals_win_and_get_length_1() {
        let cube = TriangleMesh::cuboid(DVec3::ZERO, DVec3::ONE).unwrap();
        let mut given = vec![Vec3::new(0.0, 3.0, 4.0); 8];
        given[0] = Vec3::ZERO;
        given[1] = Vec3::new(f32::NAN, 0.0, 0.0);
        let (vertices, triangles) = (cube.vertices().to_vec(), cube.triangles().to_vec());
        let mesh = TriangleMesh::new(vertices, triangles, Some(given)).unwrap();
        for (t, corners) in mesh.triangles().iter().enumerate() {
            for (corner, &v) in corners.iter().enumerate() {
                let expected = if v < 2 {
                    mesh.face_normal(t as u32).as_vec3()
                } else {
                    Vec3::new(0.0, 0.6, 0.8)
                };
                let found = mesh.corner_normals()[t][corner];
                assert!(found.distance(expected) < 1e-6, "{found}, not {expected}");
            }
        }
    }

    /// Tiny, huge and without area: still of length 1.
    #[test]
    fn every_triangle_has_a_unit_normal() {
        for size in [1e-300, 1e-9, 1.0, 1e9] {
            for third in [DVec3::new(0.3, 0.7, 0.2), DVec3::new(0.5, 0.0, 0.0)] {
                let vertices = vec![DVec3::ZERO, DVec3::X * size, third * size];
                let mesh = TriangleMesh::new(vertices.clone(), vec![[0, 1, 2]], None).unwrap();
                let at = mesh.normal_at(0, vertices[1] * 0.4);
                for normal in [
                    mesh.face_normal(0),
                    at,
                    mesh.corner_normals()[0][2].as_dvec3(),
                ] {
                    let length = normal.length();
                    assert!((length - 1.0).abs() < 1e-6, "{normal} at {size} mm");
                    assert!(normal.dot(DVec3::X).abs() < 1e-6, "{normal} at {size} mm");
                }
            }
        }
    }
}
