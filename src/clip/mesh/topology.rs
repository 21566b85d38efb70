//! Is a mesh closed, and do its triangles agree on which side is outside?

use std::sync::OnceLock;

use rayon::prelude::*;

use super::{TriangleMesh, normals};
use crate::clip::MeshError;

/// An edge of a triangle, from the lesser vertex to the greater.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    ends: [u32; 2],
    triangle: u32,
    /// Does the triangle run along it from the lesser to the greater?
    is_upward: bool,
}

impl TriangleMesh {
    /// All edges of all triangles, those between the same vertices beside each other.
    fn edges(&self) -> Vec<Edge> {
        let mut edges: Vec<Edge> = self
            .triangles
            .par_iter()
            .enumerate()
            .flat_map_iter(|(triangle, &[a, b, c])| {
                [[a, b], [b, c], [c, a]].map(|[from, to]| Edge {
                    ends: [from.min(to), from.max(to)],
                    triangle: triangle as u32,
                    is_upward: from < to,
                })
            })
            .collect();
        edges.par_sort_unstable();
        edges
    }

    /// Does the mesh bound a volume: is every edge run along as often in one direction as in the other? Shells may touch and
    /// lie in each other, and one may be inside out.
    ///
    /// # Errors
    /// [`MeshError::Open`] where an edge belongs to an odd number of triangles, [`MeshError::Orientation`] where all belong
    /// to an even number but more triangles run along one way than the other.
    pub fn check_closed(&self) -> Result<(), MeshError> {
        let (mut open, mut turned) = (0, 0);
        let (mut an_open, mut a_turned) = (None, None);
        for same in self.edges().chunk_by(|a, b| a.ends == b.ends) {
            let upward = same.iter().filter(|e| e.is_upward).count();
            if same.len() % 2 != 0 {
                open += 1;
                an_open.get_or_insert(same[0].ends);
            } else if upward * 2 != same.len() {
                turned += 1;
                a_turned.get_or_insert(same[0].ends);
            }
        }
        let places = |ends: [u32; 2]| ends.map(|v| self.vertices[v as usize]);
        if let Some([from, to]) = an_open.map(places) {
            return Err(MeshError::Open {
                edges: open,
                from,
                to,
            });
        }
        if let Some([from, to]) = a_turned.map(places) {
            return Err(MeshError::Orientation {
                edges: turned,
                from,
                to,
            });
        }
        Ok(())
    }

    /// The same with triangles turned over where they disagree with their neighbours: of those that hang together by edges
    /// of exactly two triangles, the fewer are turned. Where that can't be (a Möbius strip), some edge stays in disagreement.
    pub fn oriented(mut self) -> Self {
        let edges = self.edges();
        // At each side of each triangle: the neighbour and whether the two disagree.
        let mut neighbours: Vec<[Option<(u32, bool)>; 3]> = vec![[None; 3]; self.triangles.len()];
        let mut join = |triangle: u32, other: u32, disagree: bool| {
            let sides = &mut neighbours[triangle as usize];
            if let Some(free) = sides.iter_mut().find(|s| s.is_none()) {
                *free = Some((other, disagree));
            }
        };
        for same in edges.chunk_by(|a, b| a.ends == b.ends) {
            if let [a, b] = *same {
                let disagree = a.is_upward == b.is_upward;
                join(a.triangle, b.triangle, disagree);
                join(b.triangle, a.triangle, disagree);
            }
        }
        let mut is_turned: Vec<Option<bool>> = vec![None; self.triangles.len()];
        let mut any = false;
        for seed in 0..self.triangles.len() {
            if is_turned[seed].is_some() {
                continue;
            }
            is_turned[seed] = Some(false);
            let mut shell = vec![seed];
            let mut turned = 0;
            let mut at = 0;
            while let Some(&triangle) = shell.get(at) {
                let own = is_turned[triangle] == Some(true);
                turned += usize::from(own);
                for (other, disagree) in neighbours[triangle].into_iter().flatten() {
                    let other = other as usize;
                    if is_turned[other].is_none() {
                        is_turned[other] = Some(own != disagree);
                        shell.push(other);
                    }
                }
                at += 1;
            }
            let turns_most = turned * 2 > shell.len();
            for triangle in shell {
                if (is_turned[triangle] == Some(true)) != turns_most {
                    self.triangles[triangle].swap(1, 2);
                    self.corner_normals[triangle].swap(1, 2);
                    any = true;
                }
            }
        }
        if any {
            self.bvh = OnceLock::new();
            if !self.has_given_normals {
                self.corner_normals = normals::of_corners(&self.vertices, &self.triangles);
            }
        }
        self
    }

    /// The mesh as one that cuts: closed, and [`Self::oriented`] where it is not so already.
    ///
    /// # Errors
    /// As [`Self::check_closed`].
    pub fn into_closed(self) -> Result<Self, MeshError> {
        let mesh = match self.check_closed() {
            Err(MeshError::Orientation { .. }) => self.oriented(),
            other => return other.map(|()| self),
        };
        mesh.check_closed()?;
        Ok(mesh)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    fn ball() -> TriangleMesh {
        TriangleMesh::sphere(DVec3::new(5.0, 6.0, 7.0), 2.0, 2).unwrap()
    }

    fn mesh(vertices: &[DVec3], triangles: Vec<[u32; 3]>) -> TriangleMesh {
        TriangleMesh::new(vertices.to_vec(), triangles, None).unwrap()
    }

    /// Both in one.
    fn both(a: &TriangleMesh, b: &TriangleMesh) -> TriangleMesh {
        let vertices = [a.vertices(), b.vertices()].concat();
        let behind = b
            .triangles()
            .iter()
            .map(|t| t.map(|v| v + a.vertices().len() as u32));
        let triangles = a.triangles().iter().copied().chain(behind).collect();
        mesh(&vertices, triangles)
    }

    #[test]
    fn a_missing_triangle_is_found_and_named() {
        let ball = ball();
        for missing in [0, 17, ball.triangle_count() - 1] {
            let mut triangles = ball.triangles().to_vec();
            triangles.remove(missing);
            let holed = mesh(ball.vertices(), triangles);
            let rim = ball.corners(missing as u32);
            let error = holed.check_closed().unwrap_err();
            let MeshError::Open { edges, from, to } = error else {
                panic!("{error}");
            };
            assert_eq!(edges, 3);
            assert!(rim.contains(&from) && rim.contains(&to) && from != to);
            assert!(error.to_string().contains(&from.to_string()), "{error}");
            assert!(holed.into_closed().is_err());
        }
    }

    #[test]
    fn shells_may_touch_and_lie_in_each_other() {
        let cube = |low: [f64; 3]| {
            let low = DVec3::from_array(low);
            TriangleMesh::cuboid(low, low + 1.0).unwrap()
        };
        let first = cube([0.0; 3]);
        // At a side, along an edge, at a corner, apart.
        for low in [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0; 3], [4.0; 3]] {
            let pair = both(&first, &cube(low));
            assert_eq!(pair.triangle_count(), 24);
            pair.check_closed()
                .unwrap_or_else(|e| panic!("{low:?}: {e}"));
            let oriented = pair.clone().oriented();
            assert_eq!(oriented, pair, "{low:?}: nothing to turn");
        }
        let shell = |radius| TriangleMesh::sphere(DVec3::ZERO, radius, 1).unwrap();
        let hollow = both(&shell(2.0), &shell(-1.0));
        assert_eq!(hollow.clone().oriented(), hollow, "shells keep their sides");
    }

    /// The hemi-icosahedron: every edge belongs to two triangles, yet it has one side only.
    #[test]
    fn a_projective_plane_has_no_outside() {
        let triangles = [
            [0, 1, 2],
            [0, 2, 3],
            [0, 3, 4],
            [0, 4, 5],
            [0, 5, 1],
            [1, 2, 4],
            [2, 3, 5],
            [3, 4, 1],
            [4, 5, 2],
            [5, 1, 3],
        ];
        let vertices: Vec<DVec3> = (0..6_i32)
            .map(|i| DVec3::new(f64::from(i), f64::from(i * i), f64::from(i.pow(3))))
            .collect();
        let error = mesh(&vertices, triangles.to_vec())
            .into_closed()
            .unwrap_err();
        assert!(
            matches!(error, MeshError::Orientation { edges: 1.., .. }),
            "{error}"
        );
    }

    proptest! {
        #[test]
        fn triangles_that_are_turned_over_are_turned_back(
            turned in prop::collection::vec(any::<prop::sample::Index>(), 1..100),
        ) {
            let ball = ball();
            let mut triangles = ball.triangles().to_vec();
            let mut is_turned = vec![false; triangles.len()];
            for index in turned {
                let index = index.index(triangles.len());
                if !std::mem::replace(&mut is_turned[index], true) {
                    triangles[index].swap(1, 2);
                }
            }
            // Less than half, so that the others win.
            let turned = TriangleMesh::new(ball.vertices().to_vec(), triangles, None).unwrap();
            let error = turned.check_closed().unwrap_err();
            prop_assert!(matches!(error, MeshError::Orientation { .. }), "{}", error);
            let closed = turned.into_closed().unwrap();
            let place = |m: &TriangleMesh, t: u32| {
                let mut corners = m.corners(t).map(|v| v.to_array().map(f64::to_bits));
                let least = (0..3).min_by_key(|&i| corners[i]).unwrap();
                corners.rotate_left(least);
                corners
            };
            for t in 0..ball.triangle_count() as u32 {
                prop_assert_eq!(place(&closed, t), place(&ball, t));
                let normal = closed.corner_normals()[t as usize][0].as_dvec3();
                prop_assert!(normal.dot(ball.face_normal(t)) > 0.9, "normals follow");
            }
        }
    }
}
