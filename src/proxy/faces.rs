//! The faces of one brick, as bit sets, and their merging into rectangles.
//!
//! A face set is 8 planes of 8×8 bits. A plane's bit is u + 8·v, with (u, v) = (y, z) for faces across x, (x, z) across
//! y, (x, y) across z.

use crate::classify::Occupancy;

/// Least bit of each row of 8.
const FIRST_OF_ROW: u64 = 0x0101_0101_0101_0101;
/// Greatest bit of each row of 8.
const LAST_OF_ROW: u64 = 0x8080_8080_8080_8080;

/// The faces of `own`'s active blocks towards inactive ones, for −x, +x, −y, +y, −z, +z; `around` are the bricks beyond
/// these sides, in the same order.
pub(super) fn faces(own: &Occupancy, around: &[Occupancy; 6]) -> [[u64; 8]; 6] {
    let mut faces = [[0; 8]; 6];
    for z in 0..8_u32 {
        let s = own.slice(z);
        if s == 0 {
            continue;
        }
        let beside: [u64; 4] = std::array::from_fn(|side| around[side].slice(z));
        // Each block's neighbour on that side, moved to the block's own bit.
        let across_x = [
            s & !((s << 1) & !FIRST_OF_ROW | (beside[0] >> 7) & FIRST_OF_ROW),
            s & !((s >> 1) & !LAST_OF_ROW | (beside[1] << 7) & LAST_OF_ROW),
        ];
        let across_y = [
            s & !(s << 8 | beside[2] >> 56),
            s & !(s >> 8 | beside[3] << 56),
        ];
        for side in 0..2 {
            for (plane, bits) in faces[side].iter_mut().enumerate() {
                *bits |= column(across_x[side], plane) << (8 * z);
            }
            for (plane, bits) in faces[2 + side].iter_mut().enumerate() {
                *bits |= (across_y[side] >> (8 * plane) & 0xff) << (8 * z);
            }
        }
        let below = if z == 0 {
            around[4].slice(7)
        } else {
            own.slice(z - 1)
        };
        let above = if z == 7 {
            around[5].slice(0)
        } else {
            own.slice(z + 1)
        };
        faces[4][z as usize] = s & !below;
        faces[5][z as usize] = s & !above;
    }
    faces
}

/// Column `x` of an 8×8 slice as 8 bits: bit y of the result is bit x + 8·y of the slice.
fn column(slice: u64, x: usize) -> u64 {
    // Bit 8y times 2^(56 − 7y) lands on bit 56 + y, and no two products meet.
    (slice >> x & FIRST_OF_ROW).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// A rectangle of a plane, in blocks: from (`u0`, `v0`) to (`u1`, `v1`), the latter outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rect {
    pub(super) u0: u16,
    pub(super) v0: u16,
    pub(super) u1: u16,
    pub(super) v1: u16,
}

/// Cuts the set bits of `plane` into rectangles: from the least bit on, as wide as possible, then as high as possible.
pub(super) fn rectangles(mut plane: u64) -> impl Iterator<Item = Rect> {
    std::iter::from_fn(move || {
        if plane == 0 {
            return None;
        }
        let bit = plane.trailing_zeros();
        let (u0, v0) = (bit % 8, bit / 8);
        let row = plane >> (8 * v0) & 0xff;
        let width = (row >> u0).trailing_ones();
        let run = ((1_u64 << width) - 1) << u0;
        let mut v1 = v0;
        while v1 < 8 && plane >> (8 * v1) & run == run {
            plane &= !(run << (8 * v1));
            v1 += 1;
        }
        Some(Rect {
            u0: u0 as u16,
            v0: v0 as u16,
            u1: (u0 + width) as u16,
            v1: v1 as u16,
        })
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn columns(slice in any::<u64>(), x in 0..8_usize) {
            for y in 0..8 {
                prop_assert_eq!(column(slice, x) >> y & 1, slice >> (x + 8 * y) & 1);
            }
        }

        #[test]
        fn rectangles_cover_each_bit_once(a in any::<u64>(), b in any::<u64>(), both in any::<bool>()) {
            let plane = if both { a & b } else { a | b };
            let mut left = plane;
            for r in rectangles(plane) {
                for v in r.v0..r.v1 {
                    for u in r.u0..r.u1 {
                        let bit = 1 << (u + 8 * v);
                        prop_assert!(left & bit != 0, "({u}, {v}) is set and not covered twice");
                        left &= !bit;
                    }
                }
            }
            prop_assert_eq!(left, 0);
        }
    }
}
