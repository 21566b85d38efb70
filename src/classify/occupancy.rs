//! The 512 bits of a brick: which of its 8×8×8 blocks (of 4³ voxels) can show something.

use super::visibility::Visibility;
use crate::geom::{BLOCKS_PER_BRICK, BLOCKS_PER_EDGE};

/// One bit per block: bit x + 8·(y + 8·z), least bit of word 0 first, so that a z-slice is two words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Occupancy([u32; BLOCKS_PER_BRICK / 32]);

impl Occupancy {
    /// No block is active.
    pub const EMPTY: Self = Self([0; BLOCKS_PER_BRICK / 32]);
    /// Every block is active.
    pub const FULL: Self = Self([u32::MAX; BLOCKS_PER_BRICK / 32]);

    /// The occupancy with these words.
    pub const fn from_words(words: [u32; BLOCKS_PER_BRICK / 32]) -> Self {
        Self(words)
    }

    /// The blocks whose range (least and greatest stored value, border voxels counted) can be seen; ranges in the order
    /// of the bits.
    pub fn from_ranges(ranges: &[[f32; 2]; BLOCKS_PER_BRICK], visibility: &Visibility) -> Self {
        let mut words = [0; BLOCKS_PER_BRICK / 32];
        for (word, ranges) in words.iter_mut().zip(ranges.chunks_exact(32)) {
            for (bit, &[lo, hi]) in ranges.iter().enumerate() {
                *word |= u32::from(visibility.is_visible(lo, hi)) << bit;
            }
        }
        Self(words)
    }

    /// The 16 words, as shaders read them.
    pub const fn words(&self) -> &[u32; BLOCKS_PER_BRICK / 32] {
        &self.0
    }

    /// Slice `z` (0…7) as 64 bits: bit x + 8·y.
    pub fn slice(&self, z: u32) -> u64 {
        let i = 2 * z as usize;
        u64::from(self.0[i]) | u64::from(self.0[i + 1]) << 32
    }

    /// The occupancy with these eight slices.
    pub fn from_slices(slices: [u64; BLOCKS_PER_EDGE as usize]) -> Self {
        Self(std::array::from_fn(|i| {
            (slices[i / 2] >> (32 * (i % 2))) as u32
        }))
    }

    /// True when no block is active.
    pub fn is_empty(&self) -> bool {
        *self == Self::EMPTY
    }

    /// True when every block is active.
    pub fn is_full(&self) -> bool {
        *self == Self::FULL
    }

    /// Number of active blocks, 0 to 512.
    pub fn count(&self) -> u32 {
        self.0.iter().map(|w| w.count_ones()).sum()
    }

    /// Whether block (x, y, z), each 0…7, is active.
    pub fn get(&self, x: u32, y: u32, z: u32) -> bool {
        let bit = Self::bit(x, y, z);
        self.0[bit / 32] >> (bit % 32) & 1 == 1
    }

    /// Makes block (x, y, z), each 0…7, active or not.
    pub fn set(&mut self, x: u32, y: u32, z: u32, active: bool) {
        let bit = Self::bit(x, y, z);
        let mask = 1 << (bit % 32);
        if active {
            self.0[bit / 32] |= mask;
        } else {
            self.0[bit / 32] &= !mask;
        }
    }

    fn bit(x: u32, y: u32, z: u32) -> usize {
        debug_assert!(
            x.max(y).max(z) < BLOCKS_PER_EDGE,
            "block ({x}, {y}, {z}) is not in a brick"
        );
        (x + BLOCKS_PER_EDGE * (y + BLOCKS_PER_EDGE * z)) as usize
    }

    /// Blocks active in either.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] | other.0[i]))
    }

    /// Blocks active in both.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] & other.0[i]))
    }

    /// The blocks below (x, y, z) on every axis, each 0…8: what a brick at the volume's far edge can hold.
    pub fn corner(x: u32, y: u32, z: u32) -> Self {
        let bits = |n: u32| (1_u64 << n.min(BLOCKS_PER_EDGE)) - 1;
        let rows = (0..y.min(BLOCKS_PER_EDGE)).fold(0, |s, row| s | bits(x) << (8 * row));
        Self::from_slices(std::array::from_fn(
            |k| {
                if (k as u32) < z { rows } else { 0 }
            },
        ))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn blocks() -> impl Iterator<Item = (u32, u32, u32)> {
        (0..512).map(|i| (i % 8, i / 8 % 8, i / 64))
    }

    #[test]
    fn full_and_empty() {
        assert!(
            Occupancy::EMPTY.is_empty() && Occupancy::FULL.is_full(),
            "named so"
        );
        assert_eq!(Occupancy::FULL.count(), 512, "all");
        assert_eq!(Occupancy::corner(8, 8, 8), Occupancy::FULL, "whole corner");
        assert_eq!(Occupancy::corner(3, 0, 8), Occupancy::EMPTY, "no corner");
        assert_eq!(Occupancy::corner(3, 2, 5).count(), 30, "3 · 2 · 5");
    }

    #[test]
    fn ranges_set_the_bits_in_order() {
        let mut ranges = [[0.0, 0.0]; 512];
        ranges[3 + 8 * (5 + 8 * 7)] = [0.0, 2.0];
        let o = Occupancy::from_ranges(&ranges, &Visibility::AboveMinimum { floor: 0.0 });
        assert_eq!(o.count(), 1, "one");
        assert!(o.get(3, 5, 7), "that one");
    }

    proptest! {
        #[test]
        fn words_slices_and_bits_agree(words in any::<[u32; 16]>(), thin in any::<[u32; 16]>()) {
            let o = Occupancy::from_words(words).intersection(&Occupancy::from_words(thin));
            let slices = std::array::from_fn(|z| o.slice(z as u32));
            prop_assert_eq!(Occupancy::from_slices(slices), o);
            let mut copy = Occupancy::EMPTY;
            for (x, y, z) in blocks().filter(|&(x, y, z)| o.get(x, y, z)) {
                copy.set(x, y, z, true);
            }
            prop_assert_eq!(copy, o);
        }
    }
}
