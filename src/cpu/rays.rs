//! Rays of a packet: neighbouring pixels, one per lane, by the operations of [`crate::reference`] in their order.

use super::simd::{Lanes, MAX_LANES};
use crate::scene::{LevelFrame, RayFrame};

/// Three numbers per lane.
pub(super) type Vec3<L> = [<L as Lanes>::F; 3];

/// a · b.
#[inline(always)]
pub(super) fn dot<L: Lanes>(a: Vec3<L>, b: Vec3<L>) -> L::F {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a · s.
#[inline(always)]
pub(super) fn scaled<L: Lanes>(a: Vec3<L>, s: L::F) -> Vec3<L> {
    axes!(n => a[n] * s)
}

/// `[value for axis 0, for 1, for 2]`. No closures: they would not be compiled for the processor's instructions
/// ([`super::simd::Kernel::run`]).
macro_rules! axes {
    ($n:ident => $value:expr) => {
        [
            {
                let $n = 0;
                $value
            },
            {
                let $n = 1;
                $value
            },
            {
                let $n = 2;
                $value
            },
        ]
    };
}
pub(super) use axes;

/// A ray per lane, of pixels near each other.
#[derive(Clone, Copy)]
pub(super) struct Packet<L: Lanes> {
    /// Image-plane coordinates of the rays.
    u: L::F,
    v: L::F,
    /// Weights of the direction's three vectors.
    fan: Vec3<L>,
    /// Distances of their samples 0, mm.
    pub(super) first_mm: L::F,
    /// Those inside the picture.
    pub(super) inside: L::M,
    /// Pixels that stand for all of them where something is known by cell: the first so many.
    cells_of: [[u32; 2]; MAX_LANES],
    cells: usize,
}

impl<L: Lanes> Packet<L> {
    /// A block of neighbours, of which `(x, y)` is the first; `place`: where in its pixel each ray passes. Blocks are not
    /// larger than cells.
    #[inline(always)]
    pub(super) fn block(l: L, frame: &RayFrame, [x, y]: [u32; 2], place: [f32; 2]) -> Self {
        let [across, _] = L::SHAPE;
        let mut pixels = [[x, y]; MAX_LANES];
        let mut bits = 0;
        for lane in 0..L::WIDTH as u32 {
            let [px, py] = [x + lane % across, y + lane / across];
            pixels[lane as usize] = [px, py];
            bits |= u32::from(px < frame.size[0] && py < frame.size[1]) << lane;
        }
        Self::new(l, frame, pixels, place, (bits, 1))
    }

    /// Pixels of the picture from a list: at least one, at most one per lane.
    #[inline(always)]
    pub(super) fn listed(l: L, frame: &RayFrame, list: &[[u32; 2]], place: [f32; 2]) -> Self {
        let mut pixels = [list[0]; MAX_LANES];
        pixels[..list.len()].copy_from_slice(list);
        let bits = ((1_u64 << list.len()) - 1) as u32;
        Self::new(l, frame, pixels, place, (bits, list.len()))
    }

    #[inline(always)]
    fn new(
        l: L,
        frame: &RayFrame,
        pixels: [[u32; 2]; MAX_LANES],
        place: [f32; 2],
        (inside, cells): (u32, usize),
    ) -> Self {
        let mut at = [[0.0; MAX_LANES]; 6];
        for (lane, &[x, y]) in pixels.iter().take(L::WIDTH).enumerate() {
            let [u, v] = frame.plane_at(x, y, place);
            at[0][lane] = u;
            at[1][lane] = v;
            at[2][lane] = frame.first_mm_of_pixel(x, y);
            let fan = frame.fan([u, v]);
            for (of, weight) in at[3..].iter_mut().zip(fan) {
                of[lane] = weight;
            }
        }
        Self {
            u: l.load_f(&at[0]),
            v: l.load_f(&at[1]),
            fan: axes!(n => l.load_f(&at[3 + n])),
            first_mm: l.load_f(&at[2]),
            inside: l.mask(inside),
            cells_of: pixels,
            cells,
        }
    }

    /// Pixels in all cells in which the packet has rays.
    #[inline(always)]
    pub(super) fn cells(&self) -> &[[u32; 2]] {
        &self.cells_of[..self.cells]
    }

    /// Where on the image plane the rays pass.
    pub(super) fn planes(&self, l: L) -> Vec<[f32; 2]> {
        let (u, v) = (l.store_f(self.u), l.store_f(self.v));
        (0..L::WIDTH).map(|lane| [u[lane], v[lane]]).collect()
    }

    /// A direction.
    #[inline(always)]
    fn towards(&self, l: L, q: &[glam::Vec3; 3]) -> Vec3<L> {
        let fan = &self.fan;
        axes!(n => l.f(q[0][n]) * fan[0] + l.f(q[1][n]) * fan[1] + l.f(q[2][n]) * fan[2])
    }

    /// A quantity that is linear over the picture.
    #[inline(always)]
    fn at(&self, l: L, q: &[glam::Vec3; 3]) -> Vec3<L> {
        axes!(n => l.f(q[0][n]) + l.f(q[1][n]) * self.u + l.f(q[2][n]) * self.v)
    }
}

/// A packet's rays at one level: offsets in level voxels from the level's anchor, by sample of that level.
#[derive(Clone, Copy)]
pub(super) struct Rays<L: Lanes> {
    /// Unit direction, world.
    pub(super) direction: Vec3<L>,
    /// Offset of sample 0.
    pub(super) base: Vec3<L>,
    /// From a sample to the next; nowhere 0.
    pub(super) step: Vec3<L>,
    /// 1 / step.
    pub(super) inverse_step: Vec3<L>,
    /// First and last sample inside the volume and the level's part of the ray; empty when first > last.
    pub(super) first: L::I,
    pub(super) last: L::I,
}

impl<L: Lanes> Rays<L> {
    /// The rays of `packet` at `level`.
    #[inline(always)]
    pub(super) fn new(l: L, frame: &RayFrame, level: &LevelFrame, packet: &Packet<L>) -> Self {
        let one = l.f(1.0);
        let world = packet.towards(l, &frame.world_dir);
        let length = l.sqrt(dot::<L>(world, world));
        let inverse = one / length;
        let direction = packet.towards(l, &level.level_dir);
        let origin = packet.at(l, &level.level_origin);
        let to_first = inverse * packet.first_mm;
        let base = axes!(n => origin[n] + direction[n] * to_first);
        let still = l.f(1e-20);
        let exact = scaled::<L>(direction, inverse * l.f(level.step_mm));
        let step = axes!(n => {
            // No axis may stand still: the slab test divides by it.
            let moves = l.ge(exact[n], still) | l.ge(l.f(0.0) - exact[n], still);
            l.pick(moves, exact[n], still)
        });
        let to_min = axes!(n => (l.f(level.box_min[n]) - base[n]) / step[n]);
        let to_max = axes!(n => (l.f(level.box_max[n]) - base[n]) / step[n]);
        let nearer = axes!(n => l.min(to_min[n], to_max[n]));
        let farther = axes!(n => l.max(to_min[n], to_max[n]));
        let near = l.max(l.max(nearer[0], nearer[1]), nearer[2]);
        let far = l.min(l.min(farther[0], farther[1]), farther[2]);
        let near_plane = (l.f(frame.near_mm) * length - packet.first_mm) / l.f(level.step_mm);
        let zero = l.f(0.0);
        let first = l.max(l.max(near, near_plane), l.f(level.begin as f32));
        let ceil = zero - l.floor(zero - first);
        let last = l.floor(l.min(far, l.f((frame.last_index >> level.lod.0) as f32)));
        Self {
            direction: scaled::<L>(world, inverse),
            base,
            step,
            inverse_step: axes!(n => one / step[n]),
            // An empty ray may have any numbers; keep them inside i32.
            first: l.to_i(l.max(l.min(ceil, l.f(2e9)), zero)),
            last: l.to_i(l.max(l.min(last, l.f(level.end as f32)), l.f(-1.0))),
        }
    }

    /// Offsets of sample `index`.
    #[inline(always)]
    pub(super) fn offset(&self, index: L::F) -> Vec3<L> {
        axes!(n => self.base[n] + index * self.step[n])
    }
}
