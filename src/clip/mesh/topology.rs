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
        let mut neighbours: Vec<Vec<(u32, bool)>> = Vec::new();
        neighbours.resize_with(self.triangles.len(), Vec::new);
        for same in edges.chunk_by(|a, b| a.ends == b.ends) {
            if let [a, b] = *same {
                let disagree = a.is_upward == b.is_upward;
                neighbours[a.triangle as usize].push((b.triangle, disagree));
                neighbours[b.triangle as usize].push((a.triangle, disagree));
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
                for &(other, disagree) in &neighbours[triangle] {
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

    /// The mesh as one that cuts: [`Self::oriented`], and closed.
    ///
    /// # Errors
    /// As [`Self::check_closed`].
    pub fn into_closed(self) -> Result<Self, MeshError> {
        let mesh = self.oriented();
        mesh.check_closed()?;
        Ok(mesh)
    }
}
