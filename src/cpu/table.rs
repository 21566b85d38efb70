//! A look-up table as lanes read it: channel by channel, with the differences to the next entry.

use super::rays::axes;
use super::simd::Lanes;
use crate::classify::{LUT_ENTRIES, Lut};

/// One channel: entries, and what the next one is greater.
#[derive(Debug)]
struct Channel {
    entry: Vec<f32>,
    difference: Vec<f32>,
}

impl Channel {
    fn new(lut: &Lut, c: usize) -> Self {
        let entries = lut.entries();
        Self {
            entry: entries[..LUT_ENTRIES - 1].iter().map(|e| e[c]).collect(),
            difference: entries.windows(2).map(|e| e[1][c] - e[0][c]).collect(),
        }
    }

    #[inline(always)]
    fn at<L: Lanes>(&self, l: L, at: &TableIndex<L>) -> L::F {
        l.look_up(&self.entry, at.entry) + l.look_up(&self.difference, at.entry) * at.fraction
    }
}

/// Places in a table.
#[derive(Clone, Copy)]
pub(super) struct TableIndex<L: Lanes> {
    entry: L::I,
    fraction: L::F,
}

/// [`Lut`], by the operations in the head of its file.
#[derive(Debug)]
pub(super) struct Table {
    channels: [Channel; 4],
    lo_scale: [f32; 2],
}

impl Table {
    pub(super) fn new(lut: &Lut) -> Self {
        Self {
            channels: std::array::from_fn(|c| Channel::new(lut, c)),
            lo_scale: lut.index_lo_scale(),
        }
    }

    /// Where stored values are in the table.
    #[inline(always)]
    pub(super) fn index<L: Lanes>(&self, l: L, stored: L::F) -> TableIndex<L> {
        let [lo, scale] = [l.f(self.lo_scale[0]), l.f(self.lo_scale[1])];
        let x = l.min(
            l.max((stored - lo) * scale, l.f(0.0)),
            l.f((LUT_ENTRIES - 1) as f32),
        );
        let entry = l.min_i(l.to_i(l.floor(x)), l.i(LUT_ENTRIES as i32 - 2));
        TableIndex {
            entry,
            fraction: x - l.to_f(entry),
        }
    }

    /// Opacity.
    #[inline(always)]
    pub(super) fn opacity<L: Lanes>(&self, l: L, at: &TableIndex<L>) -> L::F {
        self.channels[3].at(l, at)
    }

    /// Red, green and blue.
    #[inline(always)]
    pub(super) fn color<L: Lanes>(&self, l: L, at: &TableIndex<L>) -> [L::F; 3] {
        axes!(n => self.channels[n].at(l, at))
    }
}
