//! The cheapest way through a region: Dijkstra over its open voxels.
//!
//! A step costs its length divided by the square of the distance to the wall (mean of both ends): in a tube of radius r with a
//! bend of radius R, leaving the middle by δ saves δ/R of the length and costs 2δ/r, so ways keep to the middle as long as
//! a tube bends less sharply than half its own radius; and a wide way goes before a narrow one. The penalties of TEASAR
//! (Sato et al. 2000) serve the same end, but depend on the greatest radius of the whole.
//!
//! Steps go to 26 neighbours, over an edge or a corner only when all voxels around it are open: the line from centre to centre
//! never touches a wall.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::I64Vec3;

use super::region::Region;

/// No step leads here.
const UNREACHED: u8 = u8::MAX;
/// The search begins here.
const START: u8 = u8::MAX - 1;

/// What a step costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cost {
    /// Its length.
    Length,
    /// Its length over the square of the distance to the wall.
    Middle,
}

/// Where a search came to.
pub(super) struct Reached<'a> {
    region: &'a Region,
    steps: Vec<Step>,
    /// Per voxel, the step that leads there.
    by: Vec<u8>,
    /// The voxel reached last: the one that costs most.
    pub(super) last: usize,
}

/// A step to a neighbour.
struct Step {
    xyz: [isize; 3],
    offset: isize,
    length_mm: f32,
    /// Offsets of the other voxels that the step passes between.
    beside: Vec<isize>,
}

fn steps(region: &Region) -> Vec<Step> {
    let [nx, ny, _] = region.size.map(|n| n as isize);
    let offset = |v: [isize; 3]| (v[2] * ny + v[1]) * nx + v[0];
    let cube = |f: &mut dyn FnMut([isize; 3])| {
        for z in -1..=1 {
            for y in -1..=1 {
                for x in -1..=1 {
                    f([x, y, z]);
                }
            }
        }
    };
    let mut steps = Vec::new();
    cube(&mut |xyz| {
        if xyz == [0; 3] {
            return;
        }
        let mut beside = Vec::new();
        cube(&mut |v| {
            let is_between = (0..3).all(|a| v[a] == 0 || v[a] == xyz[a]);
            if is_between && v != [0; 3] && v != xyz {
                beside.push(offset(v));
            }
        });
        let step = I64Vec3::from_array(xyz.map(|v| v as i64));
        steps.push(Step {
            xyz,
            offset: offset(xyz),
            length_mm: region.space.step_mm(step) as f32,
            beside,
        });
    });
    steps
}

/// Searches from `start` until `goal` is reached, or everything that can be.
pub(super) fn search(
    region: &Region,
    start: usize,
    goal: Option<usize>,
    cost: Cost,
) -> Reached<'_> {
    let steps = steps(region);
    let n = region.is_open.len();
    let mut by = vec![UNREACHED; n];
    let mut least = vec![f32::INFINITY; n];
    let weight = |at: usize| match cost {
        Cost::Length => 1.0,
        Cost::Middle => {
            // Never 0, so that a step is never free.
            let d = region.distance_mm[at].min(1e9);
            1.0 / (d * d)
        }
    };
    // Costs are not negative: their bits are ordered as they are. Ties by place, so that the way is always the same.
    let order = |cost: f32, at: usize| Reverse(u64::from(cost.to_bits()) << 32 | at as u64);
    let mut queue = BinaryHeap::from([order(0.0, start)]);
    least[start] = 0.0;
    by[start] = START;
    let mut last = start;
    while let Some(Reverse(next)) = queue.pop() {
        let (so_far, at) = (f32::from_bits((next >> 32) as u32), next as u32 as usize);
        if so_far > least[at] {
            continue;
        }
        last = at;
        if goal == Some(at) {
            break;
        }
        let here = region.xyz(at);
        let here_weight = weight(at);
        for (i, step) in steps.iter().enumerate() {
            let is_inside = (0..3).all(|a| {
                let v = here[a] as isize + step.xyz[a];
                v >= 0 && (v as usize) < region.size[a]
            });
            if !is_inside {
                continue;
            }
            let is_open = |offset: isize| region.is_open[at.wrapping_add_signed(offset)];
            if !is_open(step.offset) || !step.beside.iter().all(|&b| is_open(b)) {
                continue;
            }
            let to = at.wrapping_add_signed(step.offset);
            let total = so_far + step.length_mm * 0.5 * (here_weight + weight(to));
            if total < least[to] {
                least[to] = total;
                by[to] = i as u8;
                queue.push(order(total, to));
            }
        }
    }
    Reached {
        region,
        steps,
        by,
        last,
    }
}

impl Reached<'_> {
    /// True when the search came to a voxel.
    pub(super) fn has(&self, at: usize) -> bool {
        self.by[at] != UNREACHED
    }

    /// The way to a voxel that was reached, from the start on.
    pub(super) fn way_to(&self, end: usize) -> Vec<usize> {
        let mut way = vec![end];
        let mut at = end;
        while let Some(step) = self.steps.get(usize::from(self.by[at])) {
            at = at.wrapping_add_signed(-step.offset);
            way.push(at);
        }
        debug_assert!(way.len() <= self.region.is_open.len(), "no way is a ring");
        way.reverse();
        way
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3, U64Vec3};

    use super::*;
    use crate::geom::{BrickGrid, Lod, VoxelBox};
    use crate::path::space::LevelSpace;

    fn region(size: [usize; 3], is_open: impl Fn([usize; 3]) -> bool) -> Region {
        let dims = U64Vec3::from_array(size.map(|n| n as u64));
        let space = LevelSpace {
            lod: Lod(0),
            grid: BrickGrid::for_voxels(dims).unwrap(),
            world_from_voxel: DAffine3::IDENTITY,
            voxel_from_world: DAffine3::IDENTITY,
            spacing_mm: DVec3::ONE,
        };
        let n = size.iter().product();
        let flags = (0..n)
            .map(|i: usize| is_open([i % size[0], i / size[0] % size[1], i / size[0] / size[1]]));
        Region::new(space, VoxelBox::whole(dims), flags.collect())
    }

    /// Half a ring of radius 20 with a section of radius 5, and how far a way in it is from the middle at most.
    fn farthest_off(cost: Cost) -> f64 {
        let at =
            |v: [usize; 3]| DVec3::new(v[0] as f64 - 26.0, v[1] as f64 - 2.0, v[2] as f64 - 6.0);
        let off = |p: DVec3| (p.truncate().length() - 20.0).hypot(p.z);
        let ring = region([53, 30, 13], |v| off(at(v)) <= 5.0);
        let place = |x: u64| ring.index(U64Vec3::new(x, 2, 6)).unwrap();
        let reached = search(&ring, place(6), Some(place(46)), cost);
        let way = reached.way_to(place(46));
        assert!(way.iter().all(|&i| ring.is_open[i]), "the way is open");
        way.iter()
            .map(|&i| off(at(ring.xyz(i))))
            .fold(0.0, f64::max)
    }

    #[test]
    fn the_way_keeps_to_the_middle() {
        let (middle, shortest) = (farthest_off(Cost::Middle), farthest_off(Cost::Length));
        assert!(middle < 1.5, "{middle} voxels from the middle");
        // Negative control: the shortest way cuts the bend.
        assert!(shortest > 3.0, "the shortest way is {shortest} voxels off");
    }

    #[test]
    fn no_step_slips_between_walls() {
        // Two rooms that share an edge.
        let rooms = region([8, 8, 4], |v| {
            (1..7).contains(&v[0]) && (1..7).contains(&v[1]) && (v[0] < 4) == (v[1] < 4)
        });
        let place = |x: u64| rooms.index(U64Vec3::new(x, x, 1)).unwrap();
        let reached = search(&rooms, place(2), None, Cost::Middle);
        assert!(
            reached.has(place(1)) && !reached.has(place(5)),
            "one room only"
        );
        assert_eq!(
            reached.way_to(place(3)).len(),
            2,
            "over the corner inside it"
        );
    }
}
