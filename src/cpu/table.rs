//! Look-up tables as lanes read them: by value, channel by channel, with the differences to the next entry; and by the two
//! values at the ends of a segment.

use super::rays::axes;
use super::simd::Lanes;
use crate::classify::{LUT_ENTRIES, Lut, PreintegratedTable};

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

impl<L: Lanes> TableIndex<L> {
    /// Where stored values are among `entries`, by `lo` and `scale`.
    #[inline(always)]
    fn new(l: L, stored: L::F, [lo, scale]: [f32; 2], entries: usize) -> Self {
        let x = l.min(
            l.max((stored - l.f(lo)) * l.f(scale), l.f(0.0)),
            l.f((entries - 1) as f32),
        );
        let entry = l.min_i(l.to_i(l.floor(x)), l.i(entries as i32 - 2));
        Self {
            entry,
            fraction: x - l.to_f(entry),
        }
    }
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
        TableIndex::new(l, stored, self.lo_scale, LUT_ENTRIES)
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

/// [`PreintegratedTable`], by the operations in the head of its file.
#[derive(Debug)]
pub(super) struct SegmentTable<'a> {
    /// The channels of an entry side by side: those of two neighbours mostly come with one line of memory.
    channels: &'a [f32],
    side: usize,
    lo_scale: [f32; 2],
}

/// Places in a table of segments: channel 0 of the entry before both ends, and how far the ends are behind it.
#[derive(Clone, Copy)]
pub(super) struct SegmentIndex<L: Lanes> {
    first: L::I,
    front: L::F,
    back: L::F,
}

impl<'a> SegmentTable<'a> {
    pub(super) fn new(table: &'a PreintegratedTable) -> Self {
        Self {
            channels: table.entries().as_flattened(),
            side: table.side(),
            lo_scale: table.index_lo_scale(),
        }
    }

    /// Where the segments from the stored values `front` to `back` are in the table.
    #[inline(always)]
    pub(super) fn index<L: Lanes>(&self, l: L, front: L::F, back: L::F) -> SegmentIndex<L> {
        let front = TableIndex::new(l, front, self.lo_scale, self.side);
        let back = TableIndex::new(l, back, self.lo_scale, self.side);
        SegmentIndex {
            first: l.shl::<2>(back.entry * l.i(self.side as i32) + front.entry),
            front: front.fraction,
            back: back.fraction,
        }
    }

    /// Channel `c` at `at`.
    #[inline(always)]
    pub(super) fn channel<L: Lanes>(&self, l: L, at: &SegmentIndex<L>, c: usize) -> L::F {
        let near = self.in_row(l, at.first + l.i(c as i32), at.front);
        let far = self.in_row(l, at.first + l.i((4 * self.side + c) as i32), at.front);
        near + (far - near) * at.back
    }

    /// Between the entry at `place` and the next of its row.
    #[inline(always)]
    fn in_row<L: Lanes>(&self, l: L, place: L::I, fraction: L::F) -> L::F {
        let here = l.look_up(self.channels, place);
        let next = l.look_up(self.channels, place + l.i(4));
        here + (next - here) * fraction
    }
}
