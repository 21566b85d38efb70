//! A tree of boxes around the triangles of a mesh: which triangles a ray may cross. It never leaves one out that the ray
//! crosses; which of them it does cross is not told here.

use std::ops::Range;

use glam::DVec3;

/// Parts into which centres are sorted when a set of triangles is divided.
const BINS: usize = 16;
/// The most triangles that stay together.
const MOST_IN_LEAF: usize = 8;
/// Below this depth sets are halved: no mesh makes the tree deeper than this and 32 more.
const MOST_SAH_DEPTH: u32 = 48;
/// What a box costs, in triangles.
const BOX_COST: f64 = 0.5;
/// By how much boxes are widened, of the greatest coordinate of ray and mesh. A vertex beside a ray is off by less than 8
/// roundings of 1.1 · 10⁻¹⁶, a distance to a side of a box by 3.
const WIDENING: f64 = 1e-14;

/// A box around triangles.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    const NONE: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    fn with(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    /// Half its surface.
    fn area(self) -> f64 {
        let edges = (self.high - self.low).max(DVec3::ZERO);
        edges.x * edges.y + edges.y * edges.z + edges.z * edges.x
    }
}

/// Nodes in the order in which a ray looks at them.
#[derive(Clone, Debug)]
struct Node {
    bounds: Bounds,
    /// Its triangles in [`Bvh::order`]; none at an inner node.
    triangles: [u32; 2],
    /// The node after all that lie in this one.
    skip: u32,
}

/// The tree.
#[derive(Clone, Debug)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Bvh {
    /// The tree of all triangles, divided by the surface area heuristic in bins (Wald, "On fast Construction of SAH-based
    /// Bounding Volume Hierarchies", 2007). By one thread: it is made within the first ray, by whichever thread casts that.
    pub(super) fn new(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let of_triangle = |triangle: &[u32; 3]| {
            triangle.iter().fold(Bounds::NONE, |bounds, &v| {
                let at = vertices[v as usize];
                bounds.with(Bounds { low: at, high: at })
            })
        };
        let mut builder = Builder {
            items: triangles
                .iter()
                .zip(0..)
                .map(|(triangle, index)| (of_triangle(triangle), index))
                .collect(),
            nodes: Vec::new(),
        };
        builder.add(0..triangles.len(), 0);
        Self {
            nodes: builder.nodes,
            order: builder.items.into_iter().map(|(_, index)| index).collect(),
        }
    }

    /// Shows `see` every triangle that the ray may cross at a distance of 0 or more, each once.
    pub(super) fn visit(&self, origin: DVec3, direction: DVec3, mut see: impl FnMut(u32)) {
        let root = self.nodes[0].bounds;
        let extremes = [origin.abs(), root.low.abs(), root.high.abs()];
        let widening = extremes[0].max(extremes[1]).max(extremes[2]).max_element() * WIDENING;
        let per_axis = direction.recip();
        let is_backward = per_axis.cmplt(DVec3::ZERO);
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let low = node.bounds.low - widening - origin;
            let high = node.bounds.high + widening - origin;
            let near = DVec3::select(is_backward, high, low) * per_axis;
            let far = DVec3::select(is_backward, low, high) * per_axis;
            // 0 · ∞ is NaN, which `max` and `min` of f64 pass over: such a ray lies in the side of the box.
            let near_mm = near.x.max(near.y).max(near.z).max(0.0);
            let far_mm = far.x.min(far.y).min(far.z);
            if near_mm > far_mm {
                at = node.skip as usize;
                continue;
            }
            let [begin, end] = node.triangles;
            for &triangle in &self.order[begin as usize..end as usize] {
                see(triangle);
            }
            at += 1;
        }
    }
}

/// What the tree is made of while it grows.
struct Builder {
    items: Vec<(Bounds, u32)>,
    nodes: Vec<Node>,
}

/// Twice the centre.
fn center(bounds: &Bounds) -> DVec3 {
    bounds.low + bounds.high
}

/// A way to divide triangles by their centres.
struct Split {
    axis: usize,
    /// First bin of the second half.
    bin: usize,
    cost: f64,
}

/// The bin of a centre.
fn bin_of(at: f64, low: f64, high: f64) -> usize {
    let bin = (at - low) / (high - low) * BINS as f64;
    (bin as usize).min(BINS - 1)
}

/// The cheapest way to divide `items`, whose centres lie in `centers`; none where all centres are one.
fn cheapest(items: &[(Bounds, u32)], centers: Bounds) -> Option<Split> {
    let mut best: Option<Split> = None;
    for axis in 0..3 {
        let (low, high) = (centers.low[axis], centers.high[axis]);
        if low >= high {
            continue;
        }
        let mut bins = [(Bounds::NONE, 0_usize); BINS];
        for (bounds, _) in items {
            let bin = &mut bins[bin_of(center(bounds)[axis], low, high)];
            *bin = (bin.0.with(*bounds), bin.1 + 1);
        }
        // What the halves cost behind each bin.
        let mut behind = [0.0; BINS];
        let mut rest = (Bounds::NONE, 0);
        for i in (1..BINS).rev() {
            rest = (rest.0.with(bins[i].0), rest.1 + bins[i].1);
            behind[i] = rest.0.area() * rest.1 as f64;
        }
        let mut first = (Bounds::NONE, 0);
        for bin in 1..BINS {
            first = (first.0.with(bins[bin - 1].0), first.1 + bins[bin - 1].1);
            let cost = first.0.area() * first.1 as f64 + behind[bin];
            let is_divided = first.1 > 0 && first.1 < items.len();
            if is_divided && best.as_ref().is_none_or(|b| cost < b.cost) {
                best = Some(Split { axis, bin, cost });
            }
        }
    }
    best
}

impl Builder {
    /// Appends the tree of some items, which it sorts.
    fn add(&mut self, range: Range<usize>, depth: u32) {
        let items = &mut self.items[range.clone()];
        let bounds = items.iter().fold(Bounds::NONE, |b, i| b.with(i.0));
        let own = self.nodes.len();
        let mut node = Node {
            bounds,
            triangles: [0, 0],
            skip: own as u32 + 1,
        };
        let Some(middle) = divide(items, bounds, depth) else {
            node.triangles = [range.start as u32, range.end as u32];
            self.nodes.push(node);
            return;
        };
        self.nodes.push(node);
        self.add(range.start..range.start + middle, depth + 1);
        self.add(range.start + middle..range.end, depth + 1);
        self.nodes[own].skip = self.nodes.len() as u32;
    }
}

/// Sorts items into two parts; where the second begins. `None` where they stay together.
fn divide(items: &mut [(Bounds, u32)], bounds: Bounds, depth: u32) -> Option<usize> {
    if items.len() <= 2 {
        return None;
    }
    let centers = items.iter().fold(Bounds::NONE, |b, i| {
        let at = center(&i.0);
        b.with(Bounds { low: at, high: at })
    });
    let is_small = items.len() <= MOST_IN_LEAF;
    let split = (depth < MOST_SAH_DEPTH)
        .then(|| cheapest(items, centers))
        .flatten();
    match split {
        Some(split) => {
            let area = bounds.area();
            if is_small && split.cost + 2.0 * BOX_COST * area >= items.len() as f64 * area {
                return None;
            }
            let (low, high) = (centers.low[split.axis], centers.high[split.axis]);
            let is_first =
                |i: &(Bounds, u32)| bin_of(center(&i.0)[split.axis], low, high) < split.bin;
            let mut middle = 0;
            for i in 0..items.len() {
                if is_first(&items[i]) {
                    items.swap(i, middle);
                    middle += 1;
                }
            }
            Some(middle)
        }
        None if is_small => None,
        None => {
            let axis = (centers.high - centers.low).max_position();
            let middle = items.len() / 2;
            items.select_nth_unstable_by(middle, |a, b| {
                center(&a.0)[axis].total_cmp(&center(&b.0)[axis])
            });
            Some(middle)
        }
    }
}
