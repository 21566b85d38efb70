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
    a.map(|a| a * s)
}

/// Component by component.
#[inline(always)]
pub(super) fn zip<A: Copy, B: Copy, R>(a: [A; 3], b: [B; 3], f: impl Fn(A, B) -> R) -> [R; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// Pixels side by side.
#[derive(Clone, Copy)]
pub(super) struct Packet<L: Lanes> {
    /// Image-plane coordinates of the pixels' centres.
    u: L::F,
    v: L::F,
    /// Those inside the picture.
    pub(super) inside: L::M,
}

impl<L: Lanes> Packet<L> {
    /// The packet whose first pixel is `(x, y)`.
    #[inline(always)]
    pub(super) fn new(l: L, size: [u32; 2], x: u32, y: u32) -> Self {
        let [across, _] = L::SHAPE;
        let mut at = [[0.0; MAX_LANES]; 2];
        let mut bits = 0;
        for lane in 0..L::WIDTH as u32 {
            let (px, py) = (x + lane % across, y + lane / across);
            at[0][lane as usize] = px as f32;
            at[1][lane as usize] = py as f32;
            bits |= u32::from(px < size[0] && py < size[1]) << lane;
        }
        let half = l.f(0.5);
        let one = l.f(1.0);
        Self {
            u: (l.load_f(&at[0]) + half) * l.f(2.0 / size[0] as f32) - one,
            v: one - (l.load_f(&at[1]) + half) * l.f(2.0 / size[1] as f32),
            inside: l.mask(bits),
        }
    }

    /// A quantity that is linear over the picture.
    #[inline(always)]
    fn at(&self, l: L, q: &[glam::Vec3; 3]) -> Vec3<L> {
        std::array::from_fn(|a| l.f(q[0][a]) + l.f(q[1][a]) * self.u + l.f(q[2][a]) * self.v)
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
        let world = packet.at(l, &frame.world_dir);
        let length = l.sqrt(dot::<L>(world, world));
        let inverse = one / length;
        let direction = packet.at(l, &level.level_dir);
        let base = zip(
            packet.at(l, &level.level_origin),
            scaled::<L>(direction, inverse * l.f(frame.first_mm)),
            |o, d| o + d,
        );
        let still = l.f(1e-20);
        let step = scaled::<L>(direction, inverse * l.f(level.step_mm)).map(|s| {
            // No axis may stand still: the slab test divides by it.
            let moves = l.ge(s, still) | l.ge(l.f(0.0) - s, still);
            l.pick(moves, s, still)
        });
        let to = |corner: glam::Vec3| {
            let corner = corner.to_array();
            std::array::from_fn::<_, 3, _>(|a| (l.f(corner[a]) - base[a]) / step[a])
        };
        let (to_min, to_max) = (to(level.box_min), to(level.box_max));
        let nearer = zip(to_min, to_max, |a, b| l.min(a, b));
        let farther = zip(to_min, to_max, |a, b| l.max(a, b));
        let near = l.max(l.max(nearer[0], nearer[1]), nearer[2]);
        let far = l.min(l.min(farther[0], farther[1]), farther[2]);
        let near_plane = (l.f(frame.near_mm) * length - l.f(frame.first_mm)) / l.f(level.step_mm);
        let zero = l.f(0.0);
        let first = l.max(l.max(near, near_plane), l.f(level.begin as f32));
        let ceil = zero - l.floor(zero - first);
        let last = l.floor(l.min(far, l.f((frame.last_index >> level.lod.0) as f32)));
        // An empty ray may have any numbers; keep them inside i32.
        let bound = |v, least| l.to_i(l.max(l.min(v, l.f(2e9)), l.f(least)));
        Self {
            direction: scaled::<L>(world, inverse),
            base,
            step,
            inverse_step: step.map(|s| one / s),
            first: bound(ceil, 0.0),
            last: bound(l.min(last, l.f(level.end as f32)), -1.0),
        }
    }

    /// Offsets of sample `index`.
    #[inline(always)]
    pub(super) fn offset(&self, index: L::F) -> Vec3<L> {
        zip(self.base, self.step, |b, s| b + index * s)
    }
}
