//! The cells of a grid that a straight line passes.

use glam::{DVec3, IVec3, UVec3};

/// The cells of edge 1 that the line from one point to another passes, in its order, each once; those outside the grid are
/// left out. A line along a face between two cells is in the upper one.
#[derive(Clone, Debug)]
pub struct CellWalk {
    /// The cell to be passed next; none at the end.
    cell: Option<IVec3>,
    /// Faces still to be crossed, per axis. Counted, so that rounding leads nobody out of the grid.
    left: UVec3,
    /// Towards which neighbour each axis goes.
    stride: IVec3,
    /// Where on the line (0 at its beginning, 1 at its end) the next face of each axis is.
    next: DVec3,
    /// From one face of an axis to the next.
    apart: DVec3,
}

impl CellWalk {
    /// The walk from `from` to `to` through a grid of `cells` cells. Nothing is passed where a coordinate is not finite.
    pub fn new(from: DVec3, to: DVec3, cells: UVec3) -> Self {
        let mut walk = Self {
            cell: None,
            left: UVec3::ZERO,
            stride: IVec3::ZERO,
            next: DVec3::INFINITY,
            apart: DVec3::INFINITY,
        };
        let Some((from, to)) = clipped(from, to, cells.as_dvec3()) else {
            return walk;
        };
        // At the upper face of the grid a point belongs to the last cell.
        let last = cells.as_ivec3() - 1;
        let cell_of = |p: DVec3| p.floor().as_ivec3().clamp(IVec3::ZERO, last);
        let (first, end) = (cell_of(from), cell_of(to));
        let along = to - from;
        for axis in 0..3 {
            let stride = (end[axis] - first[axis]).signum();
            walk.stride[axis] = stride;
            if stride != 0 {
                let face = first[axis] + i32::from(stride > 0);
                walk.next[axis] = (f64::from(face) - from[axis]) / along[axis];
                walk.apart[axis] = (1.0 / along[axis]).abs();
            }
        }
        walk.cell = Some(first);
        walk.left = (end - first).abs().as_uvec3();
        walk
    }
}

/// The part of the line inside the box from 0 to `size`.
fn clipped(from: DVec3, to: DVec3, size: DVec3) -> Option<(DVec3, DVec3)> {
    let along = to - from;
    let (mut begin, mut end) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        let (low, high) = (-from[axis], size[axis] - from[axis]);
        if along[axis] == 0.0 {
            if low > 0.0 || high < 0.0 {
                return None;
            }
            continue;
        }
        let (a, b) = (low / along[axis], high / along[axis]);
        begin = begin.max(a.min(b));
        end = end.min(a.max(b));
    }
    let inside = begin <= end && along.is_finite() && from.is_finite();
    inside.then(|| (from + along * begin, from + along * end))
}

impl Iterator for CellWalk {
    type Item = UVec3;

    fn next(&mut self) -> Option<UVec3> {
        let cell = self.cell.take()?;
        // The nearest face.
        let axis = (0..3)
            .filter(|&axis| self.left[axis] > 0)
            .min_by(|&a, &b| self.next[a].total_cmp(&self.next[b]));
        if let Some(axis) = axis {
            let mut then = cell;
            then[axis] += self.stride[axis];
            self.cell = Some(then);
            self.left[axis] -= 1;
            self.next[axis] += self.apart[axis];
        }
        Some(cell.as_uvec3())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn walk(from: [f64; 3], to: [f64; 3]) -> Vec<[u32; 3]> {
        CellWalk::new(from.into(), to.into(), UVec3::new(4, 3, 2))
            .map(|c| c.to_array())
            .collect()
    }

    #[test]
    fn lines_by_pencil() {
        assert_eq!(
            walk([0.5, 0.25, 0.5], [2.5, 1.5, 0.5]),
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0]],
            "up and to the right"
        );
        assert_eq!(
            walk([9.0, 1.5, 1.5], [-9.0, 1.5, 1.5]),
            [[3, 1, 1], [2, 1, 1], [1, 1, 1], [0, 1, 1]],
            "backwards through the whole grid"
        );
        assert_eq!(
            walk([1.5, 1.5, 1.5], [1.5, 1.5, 1.5]),
            [[1, 1, 1]],
            "a point"
        );
        assert!(
            walk([5.0, 0.5, 0.5], [9.0, 0.5, 0.5]).is_empty(),
            "beside it"
        );
        assert!(
            walk([0.5, 3.5, 0.5], [3.5, 3.5, 0.5]).is_empty(),
            "above it"
        );
        assert!(
            walk([f64::NAN, 0.5, 0.5], [1.0, 0.5, 0.5]).is_empty(),
            "nowhere"
        );
    }

    proptest! {
        /// Neighbour by neighbour, inside the grid, from the cell of one end to that of the other, and every point of the
        /// line lies in (or, by rounding, at the face of) a cell that was passed.
        #[test]
        fn cells_are_those_of_the_points(
            from in prop::array::uniform3(-2.0_f64..9.0),
            to in prop::array::uniform3(-2.0_f64..9.0),
        ) {
            let cells = UVec3::new(7, 5, 6);
            let (from, to) = (DVec3::from(from), DVec3::from(to));
            let passed: Vec<UVec3> = CellWalk::new(from, to, cells).collect();
            for pair in passed.windows(2) {
                let apart = (pair[0].as_ivec3() - pair[1].as_ivec3()).abs();
                prop_assert_eq!(apart.element_sum(), 1, "{:?} and {:?} share a face", pair[0], pair[1]);
            }
            prop_assert!(passed.iter().all(|c| c.cmplt(cells).all()), "inside");
            for i in 0..=1000 {
                let p = from.lerp(to, f64::from(i) / 1000.0);
                let inside = p.cmpge(DVec3::ZERO).all() && p.cmple(cells.as_dvec3()).all();
                let near = |c: &UVec3| {
                    let low = c.as_dvec3() - 1e-9;
                    p.cmpge(low).all() && p.cmple(low + 1.0 + 2e-9).all()
                };
                prop_assert!(!inside || passed.iter().any(near), "{} is in no cell", p);
            }
        }
    }
}
