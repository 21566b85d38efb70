//! How far a ray may go from a block without meeting an active one: a byte per block of a brick.

use crate::classify::{Occupancy, Visibility};
use crate::geom::{BLOCKS_PER_BRICK, BLOCKS_PER_EDGE};
use crate::scene::IsoSurface;

/// Bits 0 to 3 of a block's byte: distance to the nearest active block of the brick, in blocks along the farthest axis
/// (Chebyshev's metric); 0 in an active block, and [`FARTHEST`], the edge of a brick, where none is active. All blocks that are
/// nearer are inactive, and connected by faces, so that they are in one zone.
pub(super) const DISTANCE: u8 = 0x0f;
/// The greatest distance.
pub(super) const FARTHEST: u8 = BLOCKS_PER_EDGE as u8;
/// Behind so many bits: of how many iso-values an inactive block lies above; 0 in an active block.
pub(super) const ZONE_SHIFT: u32 = 4;

const _: () = assert!(
    FARTHEST <= DISTANCE && IsoSurface::MOST < 16,
    "a byte has room for both"
);

/// The bytes of a brick, x fastest.
pub(super) type SkipBytes = [u8; BLOCKS_PER_BRICK];

/// The byte of blocks of zone number `zone` in a brick that has no active one.
pub(super) fn far_away(zone: usize) -> u8 {
    FARTHEST | (zone as u8) << ZONE_SHIFT
}

/// What the caster does in a level's blocks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    /// Which ranges of values can be seen.
    pub(super) visibility: Visibility,
    /// The iso-values, rising, that tell the zones of what can't.
    pub(super) surfaces: Vec<f32>,
}

impl Seen {
    /// Can something be seen in `range`?
    pub(super) fn is_visible(&self, [low, high]: [f32; 2]) -> bool {
        self.visibility.is_visible(low, high)
    }

    /// Above how many of the iso-values does a range lie that can't be seen?
    pub(super) fn zone(&self, [low, _]: [f32; 2]) -> usize {
        self.surfaces.iter().filter(|&&value| low >= value).count()
    }

    /// The bytes of a brick whose blocks have these ranges.
    pub(super) fn of_blocks(&self, ranges: &[[f32; 2]; BLOCKS_PER_BRICK]) -> SkipBytes {
        let active = Occupancy::from_ranges(ranges, &self.visibility);
        let mut bytes = [0; BLOCKS_PER_BRICK];
        let mut reached: [u64; 8] = std::array::from_fn(|z| active.slice(z as u32));
        let mut distance = 1;
        while reached != [u64::MAX; 8] {
            let grown = if distance == FARTHEST {
                [u64::MAX; 8]
            } else {
                dilate(&reached)
            };
            for z in 0..8 {
                let mut new = grown[z] & !reached[z];
                while new != 0 {
                    let block = 64 * z + new.trailing_zeros() as usize;
                    bytes[block] = distance | (self.zone(ranges[block]) as u8) << ZONE_SHIFT;
                    new &= new - 1;
                }
            }
            reached = grown;
            distance += 1;
        }
        bytes
    }
}

/// Slices of 8×8 bits (bit x + 8·y), grown by one on every axis and diagonal.
fn dilate(slices: &[u64; 8]) -> [u64; 8] {
    const NOT_FIRST: u64 = 0xfefe_fefe_fefe_fefe;
    const NOT_LAST: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    let flat = slices.map(|s| {
        let x = s | (s << 1 & NOT_FIRST) | (s >> 1 & NOT_LAST);
        x | x << 8 | x >> 8
    });
    std::array::from_fn(|z| {
        let below = if z > 0 { flat[z - 1] } else { 0 };
        let above = flat.get(z + 1).copied().unwrap_or(0);
        flat[z] | below | above
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bytes_are_distances(places in proptest::collection::vec(0..512_usize, 0..6)) {
            let mut ranges = [[0.0, 1.0]; 512];
            for &p in &places {
                ranges[p] = [0.0, 9.0];
            }
            let seen = Seen { visibility: Visibility::AboveMinimum { floor: 5.0 }, surfaces: Vec::new() };
            let bytes = seen.of_blocks(&ranges);
            let at = |b: usize| [b % 8, b / 8 % 8, b / 64];
            for (b, &byte) in bytes.iter().enumerate() {
                let nearest = places
                    .iter()
                    .map(|&p| (0..3).map(|a| at(p)[a].abs_diff(at(b)[a])).max().unwrap())
                    .min()
                    .unwrap_or(8);
                prop_assert_eq!(usize::from(byte), nearest, "block {}", b);
            }
        }
    }

    #[test]
    fn zones_are_told() {
        let values = [5.0, 6.5, 7.5];
        let seen = Seen {
            visibility: Visibility::iso(&values, [0.0, 9.0]),
            surfaces: values.to_vec(),
        };
        let mut ranges = [[0.0, 1.0]; 512];
        ranges[0] = [8.0, 9.0];
        ranges[1] = [4.0, 8.0];
        ranges[2] = [5.5, 6.0];
        let bytes = seen.of_blocks(&ranges);
        assert_eq!(
            bytes[0],
            1 | 3 << ZONE_SHIFT,
            "above all, beside an active one"
        );
        assert_eq!(bytes[1], 0, "active");
        assert_eq!(bytes[2], 1 | 1 << ZONE_SHIFT, "above one");
        assert_eq!(bytes[3], 2, "below all");
    }
}
