//! The screen quadtree of technique `layers` (techniques.md T3.3): cells of a tile whose rays have similar numbers of samples
//! become one node, which is processed for its own number of layers. Pure.

/// A square of cells, cut where the tile ends, that is processed as one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Node {
    /// Column and row of its first cell.
    pub(super) place: [u32; 2],
    /// Cells along an edge, a power of two.
    pub(super) edge: u32,
    /// The most samples that a ray in it has to take.
    pub(super) layers: u32,
}

/// What is known of a square of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Square {
    Outside,
    /// May become part of a larger node: the least and the greatest count of its cells.
    Whole(u32, u32),
    /// Its nodes are told.
    Cut,
}

struct Tree<'a> {
    counts: &'a [u32],
    wide: u32,
    high: u32,
    threshold: u32,
    nodes: Vec<Node>,
}

/// The nodes of a tile with `counts` samples per cell, in rows of `wide`. Four siblings are one node where all their cells'
/// counts are within `threshold` of each other; cells without samples are only joined with each other.
pub(super) fn nodes(counts: &[u32], wide: u32, threshold: u32) -> Vec<Node> {
    let high = (counts.len() as u32).div_ceil(wide.max(1));
    let mut tree = Tree {
        counts,
        wide,
        high,
        threshold,
        nodes: Vec::new(),
    };
    let edge = wide.max(high).next_power_of_two();
    let root = tree.square([0, 0], edge);
    tree.keep(root, [0, 0], edge);
    tree.nodes
}

impl Tree<'_> {
    fn square(&mut self, place: [u32; 2], edge: u32) -> Square {
        let [x, y] = place;
        if x >= self.wide || y >= self.high {
            return Square::Outside;
        }
        if edge == 1 {
            let count = self.counts[(y * self.wide + x) as usize];
            return Square::Whole(count, count);
        }
        let half = edge / 2;
        let quarters = [[x, y], [x + half, y], [x, y + half], [x + half, y + half]];
        let found = quarters.map(|at| self.square(at, half));
        let joined = found.into_iter().reduce(|a, b| self.join(a, b));
        let joined = joined.unwrap_or(Square::Cut);
        if joined == Square::Cut {
            for (square, at) in found.into_iter().zip(quarters) {
                self.keep(square, at, half);
            }
        }
        joined
    }

    fn join(&self, a: Square, b: Square) -> Square {
        match (a, b) {
            (Square::Outside, other) | (other, Square::Outside) => other,
            (Square::Whole(a0, a1), Square::Whole(b0, b1)) => {
                let (least, most) = (a0.min(b0), a1.max(b1));
                if most - least <= self.threshold && (least > 0 || most == 0) {
                    Square::Whole(least, most)
                } else {
                    Square::Cut
                }
            }
            (Square::Cut, _) | (_, Square::Cut) => Square::Cut,
        }
    }

    fn keep(&mut self, square: Square, place: [u32; 2], edge: u32) {
        if let Square::Whole(_, layers) = square {
            self.nodes.push(Node {
                place,
                edge,
                layers,
            });
        }
    }
}

/// The layers of each of `cells` cells, in rows of `wide`: those of its node.
pub(super) fn layers_of_cells(nodes: &[Node], wide: u32, cells: usize) -> Vec<u32> {
    let high = (cells as u32).div_ceil(wide.max(1));
    let mut layers = vec![0; cells];
    for node in nodes {
        let [x, y] = node.place;
        for row in y..(y + node.edge).min(high) {
            let begin = (row * wide + x) as usize;
            let end = (row * wide + (x + node.edge).min(wide)) as usize;
            layers[begin..end].fill(node.layers);
        }
    }
    layers
}

/// The passes over `groups` that take `samples` samples each: the groups in another order, and how many of the first of them
/// each pass has. After its last layer a ray has one pass more, in which it finds that nothing is left.
pub(super) fn passes(
    groups: &[u32],
    samples: u32,
    layers_of: impl Fn(u32) -> u32,
) -> (Vec<u32>, Vec<u32>) {
    let count = |group: u32| layers_of(group) / samples + 1;
    let mut sorted = groups.to_vec();
    // A stable sort: who needs as many passes stays in place.
    sorted.sort_by_key(|&group| std::cmp::Reverse(count(group)));
    let most = sorted.first().map_or(0, |&group| count(group));
    let sizes = (0..most)
        .map(|pass| sorted.partition_point(|&group| count(group) > pass) as u32)
        .collect();
    (sorted, sizes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every cell in exactly one node, which has the most of its cells' counts, all within the threshold.
    fn check(counts: &[u32], wide: u32, threshold: u32) -> Vec<Node> {
        let nodes = nodes(counts, wide, threshold);
        let mut met = vec![0; counts.len()];
        for node in &nodes {
            let [x, y] = node.place;
            assert!(x % node.edge == 0 && y % node.edge == 0, "{node:?}");
            let inside: Vec<usize> = (0..counts.len())
                .filter(|&i| {
                    let [cx, cy] = [i as u32 % wide, i as u32 / wide];
                    (x..x + node.edge).contains(&cx) && (y..y + node.edge).contains(&cy)
                })
                .collect();
            let of = inside.iter().map(|&i| counts[i]);
            let (least, most) = (of.clone().min().unwrap(), of.max().unwrap());
            assert_eq!(most, node.layers, "{node:?}");
            assert!(most - least <= threshold, "{node:?}: {least} to {most}");
            assert!(least > 0 || most == 0, "{node:?}: empty cells are apart");
            for i in inside {
                met[i] += 1;
            }
        }
        assert!(met.iter().all(|&n| n == 1), "each cell once: {met:?}");
        let layers = layers_of_cells(&nodes, wide, counts.len());
        assert!(
            layers.iter().zip(counts).all(|(l, c)| l >= c),
            "enough layers for every cell"
        );
        nodes
    }

    #[test]
    fn like_siblings_become_one_node() {
        assert_eq!(
            check(&[100; 16], 4, 0),
            [Node {
                place: [0, 0],
                edge: 4,
                layers: 100
            }]
        );
        let mut counts = [100; 16];
        counts[5] = 109;
        assert_eq!(check(&counts, 4, 9).len(), 1, "within the threshold");
        let cut = check(&counts, 4, 8);
        assert_eq!(cut.len(), 3 + 4, "one quarter is cut, the others are not");
        assert!(cut.contains(&Node {
            place: [1, 1],
            edge: 1,
            layers: 109
        }));
    }

    #[test]
    fn nodes_do_not_creep() {
        // Neighbours differ by little, all together by much.
        let counts: Vec<u32> = (0..64).map(|i| 100 + i % 8 + i / 8).collect();
        for threshold in 0..16 {
            check(&counts, 8, threshold);
        }
        assert_eq!(check(&counts, 8, 14).len(), 1);
        assert!(check(&counts, 8, 13).len() > 1);
    }

    #[test]
    fn tiles_of_any_shape_are_covered() {
        for (wide, high) in [(1_u32, 1_u32), (3, 5), (7, 2), (24, 24), (1, 9)] {
            let counts: Vec<u32> = (0..wide * high)
                .map(|i| (i.wrapping_mul(2_654_435_761) >> 28) * 7)
                .collect();
            for threshold in [0, 8, 60, 1000] {
                check(&counts, wide, threshold);
            }
        }
        assert_eq!(
            check(&[0, 0, 0, 5], 2, 100).len(),
            4,
            "no layers for what is empty"
        );
    }

    #[test]
    fn each_group_has_the_passes_of_its_layers() {
        let layers = [0, 16, 3, 17, 8, 7];
        let (sorted, sizes) = passes(&[0, 1, 2, 3, 4, 5], 8, |g| layers[g as usize]);
        assert_eq!(sorted, [1, 3, 4, 0, 2, 5]);
        assert_eq!(sizes, [6, 3, 2]);
        for (place, &group) in sorted.iter().enumerate() {
            let had = sizes.iter().filter(|&&n| (place as u32) < n).count() as u32;
            assert!(
                had * 8 > layers[group as usize] && (had - 1) * 8 <= layers[group as usize],
                "group {group} has {had} passes"
            );
        }
        assert_eq!(passes(&[], 8, |_| 0), (vec![], vec![]));
    }
}
