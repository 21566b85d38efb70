//! The lumen that is connected with a seed: a flood fill over faces (6 neighbours), brick by brick, a bit per voxel.
//!
//! Steps over edges and corners would leak through walls that are one voxel thin and oblique.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, VecDeque};

use glam::{I64Vec3, U64Vec3, UVec3};

use super::error::CenterlineError;
use super::lumen::{Bits, Lumen, ROWS, row_of, split};
use crate::geom::{BRICK_EDGE, BrickGrid, VoxelBox};

/// What a brick of the fill takes: two bits per voxel and its place in the table.
pub(super) const BYTES_PER_BRICK: u64 = (2 * ROWS * 4 + 64) as u64;

/// A connected set of voxels of a level.
pub(super) struct Component {
    grid: BrickGrid,
    /// By brick; `None` where a brick without lumen was looked at.
    bricks: HashMap<u64, Option<Box<Filled>>>,
}

struct Filled {
    lumen: Box<Bits>,
    filled: Box<Bits>,
    /// Waits in the queue.
    is_queued: bool,
}

impl Component {
    /// Fills from `seed`, a voxel of the lumen. `is_too_big` is asked now and then, with the box of the bricks that were
    /// reached and their number, whether to give up; then the answer is `None`.
    ///
    /// # Errors
    /// A brick is damaged.
    pub(super) fn fill(
        lumen: &mut Lumen<'_>,
        seed: U64Vec3,
        is_too_big: &mut dyn FnMut(&VoxelBox, u64) -> bool,
    ) -> Result<Option<Self>, CenterlineError> {
        let grid = lumen.space.grid;
        let mut this = Self {
            grid,
            bricks: HashMap::new(),
        };
        let (first, inside) = split(seed);
        let mut bounds = grid.brick_box(first);
        // Bricks with bits that were put in from outside and have not spread yet.
        let mut queue = VecDeque::from([first]);
        let Some(brick) = this.brick(lumen, first)? else {
            return Ok(Some(this));
        };
        brick.filled[row_of(inside)] |= brick.lumen[row_of(inside)] & (1 << inside.x);
        while let Some(xyz) = queue.pop_front() {
            let Some(brick) = this.brick(lumen, xyz)? else {
                continue;
            };
            brick.is_queued = false;
            brick.spread();
            let faces = brick.faces();
            for (step, face) in STEPS.into_iter().zip(faces) {
                let to = xyz.as_i64vec3() + step;
                let is_inside =
                    to.cmpge(I64Vec3::ZERO).all() && to.cmplt(grid.bricks.as_i64vec3()).all();
                if !is_inside || face.iter().all(|&row| row == 0) {
                    continue;
                }
                let to = to.as_uvec3();
                if let Some(neighbour) = this.brick(lumen, to)?
                    && neighbour.enter(step, &face)
                {
                    let is_queued = std::mem::replace(&mut neighbour.is_queued, true);
                    let own = grid.brick_box(to);
                    bounds = VoxelBox::new(bounds.min.min(own.min), bounds.max.max(own.max));
                    if !is_queued {
                        queue.push_back(to);
                        if is_too_big(&bounds, this.bricks.len() as u64) {
                            return Ok(None);
                        }
                    }
                }
            }
        }
        Ok(Some(this))
    }

    fn brick(
        &mut self,
        lumen: &mut Lumen<'_>,
        xyz: UVec3,
    ) -> Result<Option<&mut Filled>, CenterlineError> {
        let index = self.grid.index(xyz);
        let brick = match self.bricks.entry(index) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(lumen.bits(xyz)?.map(|lumen| {
                Box::new(Filled {
                    lumen,
                    filled: Box::new([0; ROWS]),
                    is_queued: false,
                })
            })),
        };
        Ok(brick.as_deref_mut())
    }

    /// True when a voxel of the level belongs to it.
    pub(super) fn contains(&self, voxel: U64Vec3) -> bool {
        let (xyz, inside) = split(voxel);
        let brick = self.bricks.get(&self.grid.index(xyz));
        brick.is_some_and(|b| {
            b.as_ref()
                .is_some_and(|b| b.filled[row_of(inside)] >> inside.x & 1 == 1)
        })
    }

    /// Its rows that are not empty: the first voxel of the row, and 32 bits.
    pub(super) fn rows(&self) -> impl Iterator<Item = (U64Vec3, u32)> + '_ {
        self.bricks.iter().flat_map(|(&index, brick)| {
            let start = self.grid.xyz(index).as_u64vec3() * u64::from(BRICK_EDGE);
            let filled = brick.as_ref().map(|b| &b.filled);
            filled.into_iter().flat_map(move |filled| {
                let rows = filled.iter().enumerate().filter(|(_, row)| **row != 0);
                rows.map(move |(i, &row)| {
                    let (y, z) = (
                        i as u64 % u64::from(BRICK_EDGE),
                        i as u64 / u64::from(BRICK_EDGE),
                    );
                    (start + U64Vec3::new(0, y, z), row)
                })
            })
        })
    }

    /// All its voxels.
    pub(super) fn voxels(&self) -> impl Iterator<Item = U64Vec3> + '_ {
        self.rows().flat_map(|(start, row)| {
            (0..BRICK_EDGE)
                .filter(move |x| row >> x & 1 == 1)
                .map(move |x| start + U64Vec3::new(u64::from(x), 0, 0))
        })
    }

    /// Number of its voxels.
    pub(super) fn count(&self) -> u64 {
        self.rows()
            .map(|(_, row)| u64::from(row.count_ones()))
            .sum()
    }

    /// The smallest box around it.
    pub(super) fn bounds(&self) -> VoxelBox {
        let mut bounds = VoxelBox::new(U64Vec3::MAX, U64Vec3::ZERO);
        for (start, row) in self.rows() {
            let first = start + U64Vec3::new(u64::from(row.trailing_zeros()), 0, 0);
            let end = start + U64Vec3::new(u64::from(BRICK_EDGE - row.leading_zeros()), 1, 1);
            bounds = VoxelBox::new(bounds.min.min(first), bounds.max.max(end));
        }
        bounds
    }
}

/// Steps to the six neighbours, in the order of [`Filled::faces`].
const STEPS: [I64Vec3; 6] = [
    I64Vec3::NEG_X,
    I64Vec3::X,
    I64Vec3::NEG_Y,
    I64Vec3::Y,
    I64Vec3::NEG_Z,
    I64Vec3::Z,
];

const EDGE: usize = BRICK_EDGE as usize;

impl Filled {
    /// Lets the filled bits reach whatever lumen of the brick is connected with them.
    fn spread(&mut self) {
        let mut changed = true;
        while changed {
            changed = false;
            for i in 0..ROWS {
                changed |= self.grow_row(i);
            }
            for i in (0..ROWS).rev() {
                changed |= self.grow_row(i);
            }
        }
    }

    /// A row's bits from those of the four rows beside it, then along it.
    fn grow_row(&mut self, i: usize) -> bool {
        let lumen = self.lumen[i];
        let (y, z) = (i % EDGE, i / EDGE);
        let filled = &self.filled;
        let mut row = filled[i];
        if y > 0 {
            row |= filled[i - 1];
        }
        if y < EDGE - 1 {
            row |= filled[i + 1];
        }
        if z > 0 {
            row |= filled[i - EDGE];
        }
        if z < EDGE - 1 {
            row |= filled[i + EDGE];
        }
        row &= lumen;
        loop {
            let wider = (row | row << 1 | row >> 1) & lumen;
            if wider == row {
                break;
            }
            row = wider;
        }
        let changed = row != filled[i];
        self.filled[i] = row;
        changed
    }

    /// The filled bits on the six faces, 32 rows each: of x faces bit y of row z, of y faces bit x of row z, of z faces bit x
    /// of row y.
    fn faces(&self) -> [[u32; EDGE]; 6] {
        let mut faces = [[0; EDGE]; 6];
        for (z, rows) in self.filled.chunks_exact(EDGE).enumerate() {
            for (y, &row) in rows.iter().enumerate() {
                faces[0][z] |= (row & 1) << y;
                faces[1][z] |= (row >> (EDGE - 1)) << y;
            }
            faces[2][z] = rows[0];
            faces[3][z] = rows[EDGE - 1];
        }
        faces[4].copy_from_slice(&self.filled[..EDGE]);
        faces[5].copy_from_slice(&self.filled[ROWS - EDGE..]);
        faces
    }

    /// Takes over what touches the brick when the fill comes by `step`; true when that is new.
    fn enter(&mut self, step: I64Vec3, face: &[u32; EDGE]) -> bool {
        let mut is_new = false;
        let mut add = |i: usize, bits: u32| {
            let new = bits & self.lumen[i] & !self.filled[i];
            self.filled[i] |= new;
            is_new |= new != 0;
        };
        for (k, &bits) in face.iter().enumerate() {
            match step.to_array() {
                [0, 0, 1] => add(k, bits),
                [0, 0, _] if step.z < 0 => add((EDGE - 1) * EDGE + k, bits),
                [0, 1, 0] => add(k * EDGE, bits),
                [0, _, 0] if step.y < 0 => add(k * EDGE + EDGE - 1, bits),
                [x, ..] => {
                    let column = if x > 0 { 0 } else { EDGE - 1 };
                    for y in 0..EDGE {
                        add(k * EDGE + y, (bits >> y & 1) << column);
                    }
                }
            }
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::DAffine3;

    use super::*;
    use crate::bricking::{BrickOptions, NoProgress, brick};
    use crate::geom::Lod;
    use crate::store::Store;
    use crate::volume::{ReadOrder, Rescale, SourceError, VolumeDesc, VoxelSource, VoxelType};

    /// Bytes computed voxel by voxel.
    struct Made(VolumeDesc, fn(U64Vec3) -> u8);

    impl VoxelSource for Made {
        fn desc(&self) -> &VolumeDesc {
            &self.0
        }

        fn order(&self) -> ReadOrder {
            ReadOrder::Random
        }

        fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
            let size = voxels.size();
            for (i, out) in (0u64..).zip(out) {
                let at = U64Vec3::new(i % size.x, i / size.x % size.y, i / size.x / size.y);
                *out = self.1(voxels.min + at);
            }
            Ok(())
        }
    }

    fn store(dims: U64Vec3, value: fn(U64Vec3) -> u8) -> (tempfile::TempDir, Store) {
        let desc = VolumeDesc {
            dims,
            voxel_type: VoxelType::U8,
            world_from_index: DAffine3::IDENTITY,
            rescale: Rescale::IDENTITY,
            unit: String::new(),
            name: "made".into(),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.bsk");
        brick(
            &mut Made(desc, value),
            &path,
            &BrickOptions::default(),
            &NoProgress,
        )
        .unwrap();
        let store = Store::open(&path).unwrap();
        (folder, store)
    }

    /// A maze: noise with two of three voxels open, bricks that are all open, bricks that are all closed.
    fn maze(v: U64Vec3) -> u8 {
        if v.cmpge(U64Vec3::new(32, 0, 0)).all() && v.cmplt(U64Vec3::new(64, 32, 32)).all() {
            return 9;
        }
        if v.x >= 64 && v.y < 32 {
            return 0;
        }
        let h = (v.x * 73_856_093) ^ (v.y * 19_349_663) ^ (v.z * 83_492_791);
        if (h ^ (h >> 13)).wrapping_mul(0x9e37_79b9) >> 16 & 0xff < 100 {
            9
        } else {
            200
        }
    }

    fn brute(dims: U64Vec3, seed: U64Vec3) -> BTreeSet<[u64; 3]> {
        let mut seen = BTreeSet::from([seed.to_array()]);
        let mut stack = vec![seed];
        while let Some(v) = stack.pop() {
            for step in STEPS {
                let to = v.as_i64vec3() + step;
                if to.min_element() < 0 || !to.cmplt(dims.as_i64vec3()).all() {
                    continue;
                }
                let to = to.as_u64vec3();
                if (5..=50).contains(&maze(to)) && seen.insert(to.to_array()) {
                    stack.push(to);
                }
            }
        }
        seen
    }

    #[test]
    fn fills_what_brute_force_fills() {
        let dims = U64Vec3::new(81, 70, 45);
        let (_folder, store) = store(dims, maze);
        let mut lumen = Lumen::new(&store, Lod(0), (5.0, 50.0)).unwrap();
        for seed in [U64Vec3::new(40, 10, 5), U64Vec3::new(70, 60, 44)] {
            if !(5..=50).contains(&maze(seed)) {
                continue;
            }
            let found = Component::fill(&mut lumen, seed, &mut |_, _| false)
                .unwrap()
                .unwrap();
            let wanted = brute(dims, seed);
            let voxels: BTreeSet<[u64; 3]> = found.voxels().map(|v| v.to_array()).collect();
            assert_eq!(voxels, wanted, "the component of {seed}");
            assert_eq!(found.count(), wanted.len() as u64, "its size");
            let (low, high) = wanted.iter().fold(([u64::MAX; 3], [0; 3]), |(l, h), v| {
                (
                    std::array::from_fn(|a| v[a].min(l[a])),
                    std::array::from_fn(|a| (v[a] + 1).max(h[a])),
                )
            });
            assert_eq!(
                found.bounds(),
                VoxelBox::new(low.into(), high.into()),
                "its box"
            );
            assert!(
                wanted.len() > 32_768,
                "more than the open brick: {}",
                wanted.len()
            );
        }
        let mut asked = 0;
        let stopped = Component::fill(&mut lumen, U64Vec3::new(40, 10, 5), &mut |_, bricks| {
            asked += 1;
            bricks > 3
        });
        assert!(
            stopped.unwrap().is_none() && asked > 0,
            "stops when told to"
        );
    }
}
