//! The `vessels` phantom: a branching tree of hollow tubes, and its centre-lines as the truth to compare with.

use glam::DVec3;

use super::levels::Material;
use super::raster::Scene;
use super::shapes::Shape;

/// A straight piece of a tube. Lengths are fractions of the box's edges, so that tubes stretch with the box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TubeSegment {
    /// One end of the centre-line, 0 to 1 on each axis (0 is the outer face of the first voxel).
    pub from: DVec3,
    /// The other end, away from the root.
    pub to: DVec3,
    /// Radius of the lumen.
    pub lumen_radius: f64,
    /// Radius of the outside of the wall.
    pub outer_radius: f64,
    /// Index of the segment at whose end this one begins; `None` for the root.
    pub parent: Option<usize>,
}

const LUMEN: u8 = 1;
const WALL: u8 = 2;

/// Forks between the root and a tip.
const FORKS: u32 = 6;
/// Straight pieces between two forks.
const PIECES: usize = 5;
/// Child to parent: radii keep r³ in sum at a fork (Murray's law), lengths fall a little slower.
const RADIUS_RATIO: f64 = 0.794;
const LENGTH_RATIO: f64 = 0.8;
/// Wall and lumen to lumen.
const WALL_RATIO: f64 = 1.45;
/// Directions tried for a branch; the one that keeps clear of the rest is taken.
const TRIES: u32 = 24;

/// The tree of the `vessels` phantom: each segment comes after its parent.
pub fn vessel_tree() -> Vec<TubeSegment> {
    let mut tree = Vec::new();
    let root = Branch {
        parent: None,
        from: DVec3::new(0.5, 0.5, 0.0),
        direction: DVec3::Z,
        length: 0.23,
        radius: 0.04,
    };
    // Breadth first: thick branches choose their place before thin ones.
    let mut level = vec![root];
    for fork in 0..=FORKS {
        let mut next = Vec::new();
        for (n, branch) in level.iter().enumerate() {
            let end = branch.grow(&mut tree, fork << 8 | n as u32);
            if fork < FORKS {
                next.extend(branch.children(&tree, end, fork << 8 | n as u32));
            }
        }
        level = next;
    }
    tree
}

struct Branch {
    parent: Option<usize>,
    from: DVec3,
    direction: DVec3,
    length: f64,
    radius: f64,
}

impl Branch {
    /// Appends the branch's pieces, slightly bent; the index of the last.
    fn grow(&self, tree: &mut Vec<TubeSegment>, seed: u32) -> usize {
        let mut parent = self.parent;
        let mut from = self.from;
        for direction in self.path(seed) {
            let to = from + direction * (self.length / PIECES as f64);
            tree.push(TubeSegment {
                from,
                to,
                lumen_radius: self.radius,
                outer_radius: self.radius * WALL_RATIO,
                parent,
            });
            parent = Some(tree.len() - 1);
            from = to;
        }
        tree.len() - 1
    }

    /// The directions of the pieces: bent to one side, and back inward near the faces of the box.
    fn path(&self, seed: u32) -> [DVec3; PIECES] {
        let bend = side(self.direction, seed) * 0.08;
        let piece = self.length / PIECES as f64;
        let (mut direction, mut at) = (self.direction, self.from);
        std::array::from_fn(|_| {
            let inward = DVec3::splat(0.5) - at;
            let near_face = (inward.abs().max_element() - 0.34).max(0.0);
            direction = (direction + bend + inward * (4.0 * near_face)).normalize();
            at += direction * piece;
            direction
        })
    }

    /// Two branches from the end of this one, which is segment `end`.
    fn children(&self, tree: &[TubeSegment], end: usize, seed: u32) -> [Self; 2] {
        let last = tree[end];
        let along = (last.to - last.from).normalize();
        let radius = self.radius * RADIUS_RATIO;
        let length = self.length * LENGTH_RATIO;
        let clearance = |direction: DVec3| {
            let near = last.to + direction * (0.6 * length);
            let tip = last.to + direction * (1.4 * length);
            let wall = |p: DVec3| p.min_element().min((DVec3::ONE - p).min_element());
            let others = tree[..end.saturating_sub(PIECES)]
                .iter()
                .map(|s| (s.to.distance(near).min(s.to.distance(tip))) - s.outer_radius)
                .fold(0.2, f64::min);
            (wall(tip) - 0.03).min(others)
        };
        let best = (0..TRIES)
            .map(|i| side(along, seed.wrapping_mul(TRIES).wrapping_add(i)))
            .max_by(|a, b| {
                let least = |s: &DVec3| {
                    clearance((along + *s * 0.62).normalize())
                        .min(clearance((along - *s * 0.62).normalize()))
                };
                least(a).total_cmp(&least(b))
            })
            .unwrap_or(DVec3::X);
        [0.62, -0.62].map(|tilt| Self {
            parent: Some(end),
            from: last.to,
            direction: (along + best * tilt).normalize(),
            length,
            radius,
        })
    }
}

/// A unit vector across `direction`, chosen by `seed`.
fn side(direction: DVec3, seed: u32) -> DVec3 {
    let component = |n: u32| {
        let mut h = seed.wrapping_mul(0x9e37_79b1) ^ n.wrapping_mul(0x85eb_ca6b);
        h ^= h >> 15;
        h = h.wrapping_mul(0x2c1b_3c6d);
        h ^= h >> 12;
        f64::from(h >> 8) / f64::from(1u32 << 23) - 1.0
    };
    let random = DVec3::new(component(1), component(2), component(3));
    let across = random - direction * random.dot(direction);
    let length = across.length();
    if length > 1e-3 {
        across / length
    } else {
        DVec3::X
    }
}

/// All walls first, then all lumens, so that lumens are joined at the forks.
pub(super) fn scene() -> Scene {
    let noiseless = |level| Material {
        level,
        noisy: false,
    };
    let mut scene = Scene::new(vec![noiseless(0), noiseless(600), noiseless(350)]);
    let tree = vessel_tree();
    for (material, outer) in [(WALL, true), (LUMEN, false)] {
        for s in &tree {
            let radius = if outer {
                s.outer_radius
            } else {
                s.lumen_radius
            };
            let place = |p: DVec3| p * 2.0 - 1.0;
            scene.paint(
                material,
                Shape::capsule(place(s.from), place(s.to), radius * 2.0),
            );
        }
    }
    scene
}
