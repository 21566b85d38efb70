//! Closed meshes of plain shapes, for tests and measurements.

use glam::DVec3;

use super::TriangleMesh;
use crate::clip::MeshError;

/// The corners of a cuboid: x, y and z are the bits 0, 1 and 2.
const CUBOID: [[u32; 3]; 12] = [
    [0, 4, 6],
    [0, 6, 2],
    [1, 3, 7],
    [1, 7, 5],
    [0, 1, 5],
    [0, 5, 4],
    [2, 6, 7],
    [2, 7, 3],
    [0, 2, 3],
    [0, 3, 1],
    [4, 5, 7],
    [4, 7, 6],
];

impl TriangleMesh {
    /// The most subdivisions of a sphere: 20 · 4^10 triangles, 21 million.
    pub const MOST_SUBDIVISIONS: u32 = 10;

    /// A closed mesh of 20 · 4^`subdivisions` triangles with corners on a sphere: an icosahedron whose triangles are divided
    /// into four, at most [`Self::MOST_SUBDIVISIONS`] times. A negative radius turns it inside out.
    ///
    /// # Errors
    /// As [`Self::new`]: the radius is 0, or a coordinate too great.
    pub fn sphere(center: DVec3, radius: f64, subdivisions: u32) -> Result<Self, MeshError> {
        let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
        // Three golden rectangles, cyclic permutations of (0, ±1, ±golden).
        let corner = |i: usize| {
            let [sign_a, sign_b] = [1, 2].map(|bit| if i & bit == 0 { 1.0 } else { -1.0 });
            let mut at = DVec3::ZERO;
            at[(i / 4 + 1) % 3] = sign_a;
            at[(i / 4 + 2) % 3] = sign_b * golden;
            at.normalize()
        };
        // Of all triples those at the least distance from each other, seen from outside.
        let near = |a: DVec3, b: DVec3| a.distance_squared(b) < 1.2;
        let mut units: Vec<[DVec3; 3]> = Vec::new();
        for a in 0..12 {
            for b in a + 1..12 {
                for c in b + 1..12 {
                    let [p, q, r] = [a, b, c].map(corner);
                    if near(p, q) && near(q, r) && near(r, p) {
                        let is_outward = (q - p).cross(r - p).dot(p) > 0.0;
                        units.push(if is_outward { [p, q, r] } else { [p, r, q] });
                    }
                }
            }
        }
        for _ in 0..subdivisions.min(Self::MOST_SUBDIVISIONS) {
            units = units
                .into_iter()
                .flat_map(|[p, q, r]| {
                    // A sum does not depend on the order: both triangles at an edge get the same place.
                    let [pq, qr, rp] = [p + q, q + r, r + p].map(DVec3::normalize);
                    [[p, pq, rp], [pq, q, qr], [rp, qr, r], [pq, qr, rp]]
                })
                .collect();
        }
        let vertices: Vec<DVec3> = units
            .as_flattened()
            .iter()
            .map(|unit| center + radius * unit)
            .collect();
        let triangles = (0..units.len() as u32)
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect();
        Self::new(vertices, triangles, None)
    }

    /// A closed mesh of 12 triangles: the cuboid along the world's axes between two corners.
    ///
    /// # Errors
    /// As [`Self::new`]: the two are equal, or a coordinate too great.
    pub fn cuboid(low: DVec3, high: DVec3) -> Result<Self, MeshError> {
        let corners = crate::geom::Aabb::new(low, high).corners();
        Self::new(corners.to_vec(), CUBOID.to_vec(), None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume by the divergence theorem, mm³; negative where the mesh is inside out.
    fn volume(mesh: &TriangleMesh) -> f64 {
        (0..mesh.triangle_count() as u32)
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    #[test]
    fn spheres_are_closed_and_round() {
        let center = DVec3::new(3.0, -20.0, 7.5);
        for subdivisions in 0..4 {
            let mesh = TriangleMesh::sphere(center, 2.5, subdivisions).unwrap();
            let n = mesh.triangle_count();
            assert_eq!(n, 20 << (2 * subdivisions));
            assert_eq!(mesh.vertices().len(), n / 2 + 2, "Euler's formula");
            mesh.check_closed().unwrap();
            for v in mesh.vertices() {
                assert!((v.distance(center) - 2.5).abs() < 1e-13, "{v}");
            }
        }
        let fine = TriangleMesh::sphere(center, 2.5, 4).unwrap();
        let of_ball = 4.0 / 3.0 * std::f64::consts::PI * 2.5_f64.powi(3);
        let ratio = volume(&fine) / of_ball;
        assert!((0.99..1.0).contains(&ratio), "{ratio} of the ball");
        let turned = TriangleMesh::sphere(DVec3::ZERO, -2.5, 1).unwrap();
        assert!(
            volume(&turned) < 0.0,
            "a negative radius turns it inside out"
        );
        assert!(TriangleMesh::sphere(center, 0.0, 1).is_err());
    }

    #[test]
    fn cuboids_are_closed_and_face_outward() {
        let (low, high) = (DVec3::new(-1.0, 2.0, 0.0), DVec3::new(1.0, 5.0, 4.0));
        let mesh = TriangleMesh::cuboid(low, high).unwrap();
        assert_eq!((mesh.triangle_count(), mesh.vertices().len()), (12, 8));
        mesh.check_closed().unwrap();
        assert!((volume(&mesh) - 24.0).abs() < 1e-12, "{}", volume(&mesh));
        assert_eq!(mesh.bounds(), crate::geom::Aabb::new(low, high));
    }
}
