//! Triangle meshes in world millimetres: what they are made of, with equal vertices made one. How a ray crosses them, whether
//! they are closed and what normals they have is in the modules below; nothing here is drawn.

mod bvh;
mod crossing;
mod normals;
mod shapes;
mod topology;

use std::collections::HashMap;
use std::fmt;
use std::sync::OnceLock;

use glam::{DVec3, Vec3};

use super::MeshError;
use crate::geom::Aabb;
use bvh::Bvh;
pub use crossing::Crossing;

/// Triangles in world millimetres (RAS+), counter-clockwise seen from outside.
///
/// At least one triangle; no two vertices at one place; each vertex belongs to a triangle; the corners of a triangle are
/// three different vertices (its area may be 0 all the same).
#[derive(Clone)]
pub struct TriangleMesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    corner_normals: Vec<[Vec3; 3]>,
    /// Do the normals at corners come from elsewhere than from the triangles?
    has_given_normals: bool,
    bounds: Aabb,
    /// Made for the first ray: who only draws the mesh needs none.
    bvh: OnceLock<Bvh>,
}

impl TriangleMesh {
    /// The most triangles.
    pub const MOST_TRIANGLES: usize = 1 << 31;
    /// The greatest coordinate, mm; areas stay finite in f32, too.
    pub const MOST_MM: f64 = 1e9;

    /// The mesh of `triangles`, which name three `vertices` each. Vertices at one place are made one, triangles with two
    /// equal corners and vertices without triangles are dropped. Where `vertex_normals` (of any length) are 0 or missing,
    /// those of the triangles around are used, see [`Self::corner_normals`].
    ///
    /// # Errors
    /// An index is too great, a coordinate not within ±[`Self::MOST_MM`], normals and vertices differ in number, there are
    /// more than [`Self::MOST_TRIANGLES`], or none is left.
    pub fn new(
        vertices: Vec<DVec3>,
        triangles: Vec<[u32; 3]>,
        vertex_normals: Option<Vec<Vec3>>,
    ) -> Result<Self, MeshError> {
        if triangles.len() > Self::MOST_TRIANGLES {
            return Err(MeshError::TooLarge {
                triangles: triangles.len(),
                most: Self::MOST_TRIANGLES,
            });
        }
        let is_place = |v: &DVec3| v.abs().cmple(DVec3::splat(Self::MOST_MM)).all();
        if let Some(vertex) = vertices.iter().position(|v| !is_place(v)) {
            return Err(MeshError::Coordinates {
                vertex,
                at: vertices[vertex],
                most: Self::MOST_MM,
            });
        }
        if let Some(normals) = vertex_normals.as_ref().map(Vec::len)
            && normals != vertices.len()
        {
            return Err(MeshError::NormalCount {
                normals,
                vertices: vertices.len(),
            });
        }
        let (welded, kept) = weld(&vertices, &triangles)?;
        if kept.is_empty() {
            return Err(MeshError::Empty {
                degenerate: triangles.len(),
            });
        }
        let given: Option<Vec<[Vec3; 3]>> = vertex_normals.map(|normals| {
            let of_corners =
                |&(source, _): &(usize, _)| triangles[source].map(|c| normals[c as usize]);
            kept.iter().map(of_corners).collect()
        });
        let triangles: Vec<[u32; 3]> = kept.into_iter().map(|(_, t)| t).collect();
        let mut corner_normals = normals::of_corners(&welded, &triangles);
        if let Some(given) = &given {
            normals::prefer(given, &mut corner_normals);
        }
        let low = welded.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = welded.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        Ok(Self {
            vertices: welded,
            triangles,
            corner_normals,
            has_given_normals: given.is_some(),
            bounds: Aabb::new(low, high),
            bvh: OnceLock::new(),
        })
    }

    /// World mm; no two are equal.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Three vertices each, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Unit normals for lighting at the corners of each triangle: those given with the vertices, else the means over the
    /// triangles around the vertex that lie within 30° of the triangle itself, weighted by their angles there (Thürmer and
    /// Wüthrich, "Computing Vertex Normals from Polygonal Facets", JGT 1998; 30° as VTK's feature angle). So a cube keeps
    /// its edges.
    pub fn corner_normals(&self) -> &[[Vec3; 3]] {
        &self.corner_normals
    }

    /// How many there are; at least 1.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// A hash of vertices, triangles and normals: the same for meshes that are equal, on every machine.
    pub fn content_hash(&self) -> u64 {
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        for vertex in &self.vertices {
            for value in vertex.to_array() {
                hash.update(&value.to_le_bytes());
            }
        }
        for corner in self.triangles.as_flattened() {
            hash.update(&corner.to_le_bytes());
        }
        for value in self
            .corner_normals
            .as_flattened()
            .iter()
            .flat_map(|n| n.to_array())
        {
            hash.update(&value.to_le_bytes());
        }
        hash.digest()
    }

    /// The least box around all triangles, world mm.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The corners of a triangle, world mm.
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize])
    }
}

/// Meshes are equal by what was given; whether a ray was cast already does not count.
impl PartialEq for TriangleMesh {
    fn eq(&self, other: &Self) -> bool {
        self.vertices == other.vertices
            && self.triangles == other.triangles
            && self.corner_normals == other.corner_normals
    }
}

/// Counts alone: meshes stand in settings that are printed.
impl fmt::Debug for TriangleMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TriangleMesh")
            .field("vertices", &self.vertices.len())
            .field("triangles", &self.triangles.len())
            .finish_non_exhaustive()
    }
}

/// A triangle of a list, and what it is after welding.
type Kept = (usize, [u32; 3]);

/// The vertices that are used, each place once (bit by bit, −0 as 0), in the order of their first use, and the triangles with
/// three different corners.
fn weld(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(Vec<DVec3>, Vec<Kept>), MeshError> {
    const UNSEEN: u32 = u32::MAX;
    let mut welded = Vec::new();
    let mut by_place: HashMap<[u64; 3], u32> = HashMap::new();
    let mut welded_from_given = vec![UNSEEN; vertices.len()];
    let mut kept = Vec::with_capacity(triangles.len());
    for (triangle, &corners) in triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&c| c as usize >= vertices.len()) {
            return Err(MeshError::Index {
                triangle,
                index,
                vertices: vertices.len(),
            });
        }
        let [a, b, c] = corners.map(|c| vertices[c as usize]);
        if a == b || b == c || c == a {
            continue;
        }
        let corners = corners.map(|given| {
            let known = &mut welded_from_given[given as usize];
            if *known == UNSEEN {
                // −0 + 0 = 0.
                let place = vertices[given as usize] + DVec3::ZERO;
                *known = *by_place
                    .entry(place.to_array().map(f64::to_bits))
                    .or_insert_with(|| {
                        welded.push(place);
                        (welded.len() - 1) as u32
                    });
            }
            *known
        });
        kept.push((triangle, corners));
    }
    Ok((welded, kept))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five triangles of which two are the same places under other numbers, one is a line and one a point.
    #[test]
    fn vertices_are_welded_and_degenerate_triangles_dropped() {
        let vertices = vec![
            DVec3::new(9.0, 9.0, 9.0),
            DVec3::ZERO,
            DVec3::X,
            DVec3::Y,
            DVec3::new(-0.0, 0.0, -0.0),
            DVec3::X,
            DVec3::new(0.0, -1.0, 0.0),
        ];
        let triangles = vec![[1, 2, 3], [1, 4, 2], [3, 3, 3], [4, 6, 5]];
        let mesh = TriangleMesh::new(vertices, triangles, None).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 3, 1]]);
        assert_eq!(
            mesh.vertices(),
            [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::NEG_Y]
        );
        assert!(mesh.vertices()[0].x.is_sign_positive());
        let bounds = Aabb::new(DVec3::new(0.0, -1.0, 0.0), DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(
            mesh.bounds(),
            bounds,
            "a vertex without triangles does not count"
        );
        let shown = format!("{mesh:?}");
        assert_eq!(shown, "TriangleMesh { vertices: 4, triangles: 2, .. }");
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let message = |vertices: &[DVec3], triangles: &[[u32; 3]], normals: Option<Vec<Vec3>>| {
            TriangleMesh::new(vertices.to_vec(), triangles.to_vec(), normals)
                .unwrap_err()
                .to_string()
        };
        let three = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let found = message(&three, &[[0, 1, 2], [0, 1, 3]], None);
        assert!(
            found.contains("triangle 1: expected vertices 0 to 2, found 3"),
            "{found}"
        );
        for bad in [f64::NAN, f64::INFINITY, 2e9] {
            let found = message(&[DVec3::ZERO, DVec3::X * bad, DVec3::Y], &[[0, 1, 2]], None);
            assert!(
                found.contains("vertex 1: expected coordinates within"),
                "{found}"
            );
        }
        let found = message(&three, &[[0, 1, 1]], None);
        assert!(
            found.contains("no triangles") && found.contains("1 have fewer"),
            "{found}"
        );
        assert!(message(&[], &[], None).contains("no triangles"));
        let found = message(&three, &[[0, 1, 2]], Some(vec![Vec3::X]));
        assert!(found.contains("1 normals and 3 vertices"), "{found}");
    }

    #[test]
    fn a_mesh_stays_equal_to_itself_when_rays_were_cast() {
        let mesh = TriangleMesh::sphere(DVec3::ZERO, 1.0, 1).unwrap();
        let copy = mesh.clone();
        let mut out = Vec::new();
        mesh.crossings(DVec3::ZERO, DVec3::X, &mut out);
        assert_eq!(out.len(), 1);
        assert_eq!(mesh, copy);
        assert_ne!(mesh, TriangleMesh::sphere(DVec3::ZERO, 2.0, 1).unwrap());
    }
}
