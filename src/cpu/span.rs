//! Which samples of a level a packet takes.

use super::intervals::Interval;
use super::simd::Lanes;

/// The samples of a packet at one level: those of each lane, and the one that the packet is at.
#[derive(Clone, Copy)]
pub(super) struct Span<L: Lanes> {
    first: L::I,
    last: L::I,
    /// Behind this there is nothing for any of them.
    limit: i32,
    pub(super) index: i32,
    pub(super) end: i32,
}

impl<L: Lanes> Span<L> {
    /// Of the lanes `alive`.
    #[inline(always)]
    pub(super) fn new(
        l: L,
        first: L::I,
        last: L::I,
        [begin, limit]: Interval,
        alive: L::M,
    ) -> Self {
        let mut span = Self {
            first,
            last,
            limit,
            index: l.least(alive & !l.gt_i(first, last), first).max(begin),
            end: 0,
        };
        span.end_with(l, alive);
        span
    }

    /// Only the lanes `alive` go on.
    #[inline(always)]
    pub(super) fn end_with(&mut self, l: L, alive: L::M) {
        let some = alive & !l.gt_i(self.first, self.last);
        self.end = l.greatest(some, self.last).min(self.limit);
    }

    /// Lanes that have a sample here.
    #[inline(always)]
    pub(super) fn here(&self, l: L) -> L::M {
        let index = l.i(self.index);
        !l.gt_i(self.first, index) & !l.gt_i(index, self.last)
    }

    /// Lanes of which this is not the first sample.
    #[inline(always)]
    pub(super) fn has_before(&self, l: L) -> L::M {
        l.gt_i(l.i(self.index), self.first)
    }

    /// Goes on to the least of `next`, the samples at which the lanes `here` may meet something, or to the first sample of
    /// another lane of `alive`.
    #[inline(always)]
    pub(super) fn leap(&mut self, l: L, alive: L::M, here: L::M, next: L::I) {
        let later = alive & l.gt_i(self.first, l.i(self.index));
        let least = l.least(here, next).min(l.least(later, self.first));
        self.index = least.max(self.index + 1);
    }

    /// Number of the samples of each lane up to `index`, which none has passed.
    #[inline(always)]
    pub(super) fn count_to(&self, l: L, index: L::I) -> L::I {
        l.max_i(l.min_i(index, self.last) - self.first + l.i(1), l.i(0))
    }
}
