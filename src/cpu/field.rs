//! A level as a packet reads it: where each lane is, the brick that it is in, values and gradients there.

use super::bricks::NearBricks;
use super::rays::{Rays, Vec3, axes};
use super::simd::{LaneTable, Lanes, MAX_LANES, PerLane};
use crate::geom::{BLOCK_EDGE, BLOCKS_PER_EDGE, BRICK_BORDER, BRICK_EDGE, STORED_EDGE};
use crate::scene::{Interpolation, LevelFrame};

const EDGE: usize = STORED_EDGE as usize;

/// As [`axes`], of four.
macro_rules! four {
    ($n:ident => $value:expr) => {{
        let [a, b, c] = axes!($n => $value);
        let $n = 3;
        [a, b, c, $value]
    }};
}

/// How voxels lie in memory.
pub(super) trait VoxelKind: Copy {
    /// Bytes of a voxel.
    const BYTES: usize;

    /// The voxel at each of four places, and its neighbour along x.
    fn pairs<L: Lanes>(l: L, voxels: &LaneTable, offset: L::I, at: [usize; 4]) -> [[L::F; 2]; 4];
}

/// u8 voxels.
#[derive(Clone, Copy)]
pub(super) struct U8;
/// u16 voxels.
#[derive(Clone, Copy)]
pub(super) struct U16;
/// f32 voxels.
#[derive(Clone, Copy)]
pub(super) struct F32;

impl VoxelKind for U8 {
    const BYTES: usize = 1;

    #[inline(always)]
    fn pairs<L: Lanes>(l: L, voxels: &LaneTable, offset: L::I, at: [usize; 4]) -> [[L::F; 2]; 4] {
        let low = l.i(0xff);
        let w = voxels.gather4(l, offset, at);
        four!(n => [l.to_f(w[n] & low), l.to_f(l.shr_u::<8>(w[n]) & low)])
    }
}

impl VoxelKind for U16 {
    const BYTES: usize = 2;

    #[inline(always)]
    fn pairs<L: Lanes>(l: L, voxels: &LaneTable, offset: L::I, at: [usize; 4]) -> [[L::F; 2]; 4] {
        let low = l.i(0xffff);
        let w = voxels.gather4(l, offset, at);
        four!(n => [l.to_f(w[n] & low), l.to_f(l.shr_u::<16>(w[n]))])
    }
}

impl VoxelKind for F32 {
    const BYTES: usize = 4;

    #[inline(always)]
    fn pairs<L: Lanes>(l: L, voxels: &LaneTable, offset: L::I, at: [usize; 4]) -> [[L::F; 2]; 4] {
        let here = voxels.gather4(l, offset, at);
        let next = voxels.gather4(l, offset, four!(n => at[n] + 4));
        four!(n => [l.as_f(here[n]), l.as_f(next[n])])
    }
}

/// The kind of voxels of a stored type, as a call.
macro_rules! with_voxel_kind {
    ($stored_type:expr, $kind:ident => $body:expr) => {
        match $stored_type {
            $crate::volume::StoredType::U8 => {
                type $kind = $crate::cpu::field::U8;
                $body
            }
            $crate::volume::StoredType::U16 => {
                type $kind = $crate::cpu::field::U16;
                $body
            }
            $crate::volume::StoredType::F32 => {
                type $kind = $crate::cpu::field::F32;
                $body
            }
        }
    };
}
pub(super) use with_voxel_kind;

const BRICK_SHIFT: u32 = BRICK_EDGE.trailing_zeros();
const BLOCK_SHIFT: u32 = BLOCK_EDGE.trailing_zeros();
const BLOCKS_SHIFT: u32 = BLOCKS_PER_EDGE.trailing_zeros();

/// Where the lanes are.
#[derive(Clone, Copy)]
pub(super) struct Place<L: Lanes> {
    /// The voxel that each is in.
    voxel: [L::I; 3],
    /// The first voxel of its brick.
    brick: [L::I; 3],
    /// The block's number in the brick.
    pub(super) block: L::I,
}

/// A box of voxels per lane, from `low` to before `high`.
#[derive(Clone, Copy)]
pub(super) struct Room<L: Lanes> {
    low: [L::I; 3],
    high: [L::I; 3],
}

/// A level under the lanes, from packet to packet.
pub(super) struct Field<'n, 'a, L: Lanes> {
    near: &'n mut NearBricks<'a>,
    /// From a position to the first of the voxels around it, and whether the others count: ½ and 1, or both 0.
    shift: L::F,
    weight: L::F,
    /// The voxel that offsets count from.
    anchor: [L::I; 3],
    /// The last voxel of the level.
    last: [L::I; 3],
    /// Bricks of a row, of a layer.
    row: L::I,
    layer: L::I,
    /// Each lane's brick, by its number; −1 for none yet.
    index: L::I,
    voxels: LaneTable,
    blocks: LaneTable,
    bounds: PerLane<f32>,
    /// Lanes (bits) whose brick's voxels are there.
    has_voxels: u32,
}

impl<'n, 'a, L: Lanes> Field<'n, 'a, L> {
    pub(super) fn new(
        l: L,
        near: &'n mut NearBricks<'a>,
        level: &LevelFrame,
        interpolation: Interpolation,
    ) -> Self {
        let grid = near.level().grid();
        let nothing = near.level().nothing();
        let last = (grid.voxels - 1).as_ivec3();
        let (shift, weight) = match interpolation {
            Interpolation::Linear => (0.5, 1.0),
            Interpolation::Nearest => (0.0, 0.0),
        };
        Self {
            shift: l.f(shift),
            weight: l.f(weight),
            anchor: axes!(n => l.i(level.anchor[n])),
            last: axes!(n => l.i(last[n])),
            row: l.i(grid.bricks.x as i32),
            layer: l.i((grid.bricks.x * grid.bricks.y) as i32),
            index: l.i(-1),
            voxels: LaneTable::new(&nothing.voxels),
            blocks: LaneTable::new(&nothing.blocks),
            bounds: [f32::MIN; MAX_LANES],
            has_voxels: 0,
            near,
        }
    }

    /// Where `lanes` are at `offset`; their bricks are made ready.
    #[inline(always)]
    pub(super) fn locate(&mut self, l: L, offset: Vec3<L>, lanes: L::M) -> Place<L> {
        let (place, index) = self.place(l, offset);
        let moved = lanes & !l.eq_i(index, self.index);
        if l.any(moved) {
            self.enter(l, index, moved, false);
            self.index = l.pick_i(moved, index, self.index);
        }
        place
    }

    /// Where all lanes are at `offset`, and the numbers of their bricks.
    #[inline(always)]
    fn place(&self, l: L, offset: Vec3<L>) -> (Place<L>, L::I) {
        let zero = l.i(0);
        let voxel = axes!(n => {
            let voxel = self.anchor[n] + l.to_i(l.floor(offset[n]));
            l.max_i(l.min_i(voxel, self.last[n]), zero)
        });
        let brick = axes!(n => l.shr::<BRICK_SHIFT>(voxel[n]));
        let in_brick = l.i(BLOCKS_PER_EDGE as i32 - 1);
        let block = axes!(n => l.shr::<BLOCK_SHIFT>(voxel[n]) & in_brick);
        let place = Place {
            voxel,
            brick: axes!(n => l.shl::<BRICK_SHIFT>(brick[n])),
            block: block[0] + l.shl::<BLOCKS_SHIFT>(block[1] + l.shl::<BLOCKS_SHIFT>(block[2])),
        };
        (
            place,
            brick[0] + brick[1] * self.row + brick[2] * self.layer,
        )
    }

    /// Points `lanes` at the bricks of number `index`.
    #[inline(never)]
    fn enter(&mut self, l: L, index: L::I, lanes: L::M, needs_voxels: bool) {
        let each = l.store_i(index);
        let mut left = l.bits(lanes);
        while left != 0 {
            let first = each[left.trailing_zeros() as usize];
            let mut same = 0;
            for (lane, &i) in each[..L::WIDTH].iter().enumerate() {
                same |= u32::from(i == first) << lane;
            }
            same &= left;
            let brick = self.near.get(first as u64, needs_voxels);
            self.voxels.set(same, &brick.voxels);
            self.blocks.set(same, &brick.blocks);
            for (lane, bound) in self.bounds.iter_mut().enumerate() {
                if same >> lane & 1 == 1 {
                    *bound = brick.bound;
                }
            }
            self.has_voxels &= !same;
            if brick.has_voxels {
                self.has_voxels |= same;
            }
            left &= !same;
        }
    }

    /// Is there a lane of `lanes` whose brick's voxels nobody has needed so far?
    #[inline(always)]
    pub(super) fn lacks_voxels(&self, l: L, lanes: L::M) -> bool {
        l.bits(lanes) & !self.has_voxels != 0
    }

    /// Reads the voxels of the bricks of `lanes` that nobody has needed so far.
    #[inline(always)]
    pub(super) fn need_voxels(&mut self, l: L, lanes: L::M) {
        let lanes = lanes & l.mask(!self.has_voxels);
        if l.any(lanes) {
            self.enter(l, self.index, lanes, true);
        }
    }

    /// The byte of each lane's block ([`super::skip`]).
    #[inline(always)]
    pub(super) fn skip_byte(&self, l: L, place: &Place<L>) -> L::I {
        self.blocks.gather(l, place.block) & l.i(0xff)
    }

    /// What no sample of the lane's block, and of its brick, is beyond.
    #[inline(always)]
    pub(super) fn bounds(&self, l: L, place: &Place<L>) -> [L::F; 2] {
        let brick = l.load_f(&self.bounds);
        let block = l.as_f(self.blocks.gather(l, l.shl::<2>(place.block)));
        [l.min(block, brick), brick]
    }

    /// The blocks that are nearer than `distance` to each lane's, in its brick.
    #[inline(always)]
    pub(super) fn blocks_around(&self, l: L, place: &Place<L>, distance: L::I) -> Room<L> {
        let reach = l.shl::<BLOCK_SHIFT>(distance);
        let size = l.i(BRICK_EDGE as i32);
        let edge = l.i(BLOCK_EDGE as i32);
        let own = axes!(n => l.shl::<BLOCK_SHIFT>(l.shr::<BLOCK_SHIFT>(place.voxel[n])));
        Room {
            low: axes!(n => l.max_i(own[n] + edge - reach, place.brick[n])),
            high: axes!(n => l.min_i(own[n] + reach, place.brick[n] + size)),
        }
    }

    /// Each lane's brick.
    #[inline(always)]
    pub(super) fn whole_brick(&self, l: L, place: &Place<L>) -> Room<L> {
        let size = l.i(BRICK_EDGE as i32);
        Room {
            low: place.brick,
            high: axes!(n => place.brick[n] + size),
        }
    }

    /// The first sample behind `room`. Rounding may take it a hair beyond: the ranges of blocks cover half a voxel more.
    #[inline(always)]
    pub(super) fn behind(&self, l: L, rays: &Rays<L>, room: &Room<L>) -> L::I {
        let end = self.end(l, rays, room);
        l.to_i(l.floor(l.max(l.min(end, l.f(1e9)), l.f(-1.0)))) + l.i(1)
    }

    /// Where the rays leave `room`, in samples.
    #[inline(always)]
    pub(super) fn end(&self, l: L, rays: &Rays<L>, room: &Room<L>) -> L::F {
        let t = self.passes(l, rays, &room.high, &room.low);
        l.min(l.min(t[0], t[1]), t[2])
    }

    /// Where they enter it. Through the face by which they left its neighbour: the same number.
    #[inline(always)]
    pub(super) fn begin(&self, l: L, rays: &Rays<L>, room: &Room<L>) -> L::F {
        let t = self.passes(l, rays, &room.low, &room.high);
        l.max(l.max(t[0], t[1]), t[2])
    }

    /// Where they pass the planes before the voxels `rising` along the axes on which they rise, `falling` on the others.
    #[inline(always)]
    fn passes(&self, l: L, rays: &Rays<L>, rising: &[L::I; 3], falling: &[L::I; 3]) -> Vec3<L> {
        let zero = l.f(0.0);
        axes!(n => {
            let rises = l.gt(rays.step[n], zero);
            let face = l.pick_i(rises, rising[n], falling[n]) - self.anchor[n];
            (l.to_f(face) - rays.base[n]) * rays.inverse_step[n]
        })
    }

    /// Bytes from the beginning of the bricks to voxel `voxel` of the level, which is in them or their border.
    #[inline(always)]
    fn voxel_at<K: VoxelKind>(&self, l: L, place: &Place<L>, voxel: [L::I; 3]) -> L::I {
        let edge = l.i(EDGE as i32);
        let border = l.i(BRICK_BORDER as i32);
        let [x, y, z] = axes!(n => voxel[n] - place.brick[n] + border);
        let at = x + (y + z * edge) * edge;
        match K::BYTES {
            1 => at,
            2 => l.shl::<1>(at),
            _ => l.shl::<2>(at),
        }
    }

    /// The values at `offset`, which is in the bricks of `place`. The nearest voxel's is the trilinear one of weights 0.
    #[inline(always)]
    pub(super) fn value<K: VoxelKind>(&self, l: L, place: &Place<L>, offset: Vec3<L>) -> L::F {
        let shifted = axes!(n => offset[n] - self.shift);
        let floor = axes!(n => l.floor(shifted[n]));
        let f = axes!(n => (shifted[n] - floor[n]) * self.weight);
        let voxel = axes!(n => l.to_i(floor[n]) + self.anchor[n]);
        let at = self.voxel_at::<K>(l, place, voxel);
        let row = EDGE * K::BYTES;
        trilinear_at::<L, K>(l, &self.voxels, at, [row, EDGE * row], f)
    }

    /// The values at `offset`, at most a voxel beyond the bricks of `place`, that `lanes` need: from the next brick where a
    /// voxel is neither in theirs nor in its border. Without a seam: borders are the neighbours' voxels.
    #[inline(always)]
    pub(super) fn value_beside<K: VoxelKind>(
        &mut self,
        l: L,
        place: &Place<L>,
        offset: Vec3<L>,
        lanes: L::M,
    ) -> L::F {
        // Outside the level the edge voxel repeats: values are those at its faces.
        let offset = axes!(n => {
            let low = l.to_f(l.i(0) - self.anchor[n]);
            let high = l.to_f(self.last[n] + l.i(1) - self.anchor[n]);
            l.max(l.min(offset[n], high), low)
        });
        let border = l.i(BRICK_BORDER as i32);
        let beyond = axes!(n => {
            let first = l.to_i(l.floor(offset[n] - self.shift)) + self.anchor[n] - place.brick[n];
            // The second of two voxels may be in the border.
            let is_behind = l.gt_i(first + l.i(1), l.i(BRICK_EDGE as i32 - 1) + border);
            l.gt_i(l.i(0) - border, first) | is_behind
        });
        let beyond = (beyond[0] | beyond[1] | beyond[2]) & lanes;
        if !l.any(beyond) {
            return self.value::<K>(l, place, offset);
        }
        let (there, index) = self.place(l, offset);
        self.enter(l, index, beyond, true);
        let mixed = Place {
            brick: axes!(n => l.pick_i(beyond, there.brick[n], place.brick[n])),
            ..*place
        };
        let value = self.value::<K>(l, &mixed, offset);
        self.enter(l, self.index, beyond, true);
        value
    }
}

/// Between the eight voxels from the one at byte `at` on, of rows and layers of so many bytes.
#[inline(always)]
pub(super) fn trilinear_at<L: Lanes, K: VoxelKind>(
    l: L,
    voxels: &LaneTable,
    at: L::I,
    [row, layer]: [usize; 2],
    f: Vec3<L>,
) -> L::F {
    let pairs = K::pairs(l, voxels, at, [0, row, layer, layer + row]);
    let [a, b, c, d] = four!(n => lerp::<L>(pairs[n], f[0]));
    lerp::<L>([lerp::<L>([a, b], f[1]), lerp::<L>([c, d], f[1])], f[2])
}

/// Between two values.
#[inline(always)]
fn lerp<L: Lanes>([a, b]: [L::F; 2], t: L::F) -> L::F {
    a + (b - a) * t
}
