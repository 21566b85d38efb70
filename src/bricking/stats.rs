//! Statistics of level 0, each voxel once: range, histogram, percentiles, hash.
//!
//! Integer types are counted value by value: everything is exact. f32 values are counted by their 20 highest bits in
//! order of value (sign, exponent, 11 bits of fraction): whole numbers up to ±4096 are exact, any other value is known
//! to 1/2048 of itself, whatever the range, and the counts do not depend on the order in which voxels come. Inside such
//! a bin values are taken as evenly spread.

use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::geom::{BRICK_BORDER, STORED_EDGE, STORED_VOXELS};
use crate::store::meta::HISTOGRAM_BINS;
use crate::store::{Histogram, Percentiles, Voxel};
use crate::volume::StoredType;

/// A voxel type that can be counted.
pub trait Binned: Voxel {
    /// Number of bins.
    const BINS: usize;
    /// One bin per value?
    const EXACT: bool;

    /// The bin of a value.
    fn bin(self) -> usize;

    /// The least value of a bin (or one beyond the last), as a number.
    fn bin_start(bin: usize) -> f64;
}

impl Binned for u8 {
    const BINS: usize = 1 << 8;
    const EXACT: bool = true;

    #[inline]
    fn bin(self) -> usize {
        self.into()
    }

    fn bin_start(bin: usize) -> f64 {
        bin as f64
    }
}

impl Binned for u16 {
    const BINS: usize = 1 << 16;
    const EXACT: bool = true;

    #[inline]
    fn bin(self) -> usize {
        self.into()
    }

    fn bin_start(bin: usize) -> f64 {
        bin as f64
    }
}

const F32_SHIFT: u32 = 12;
const SIGN: u32 = 1 << 31;

impl Binned for f32 {
    const BINS: usize = 1 << (32 - F32_SHIFT);
    const EXACT: bool = false;

    #[inline]
    fn bin(self) -> usize {
        // Adding 0 turns −0 into 0. Negative floats rise as their bits fall.
        let bits = (self + 0.0).to_bits();
        let key = if bits & SIGN == 0 { bits | SIGN } else { !bits };
        (key >> F32_SHIFT) as usize
    }

    fn bin_start(bin: usize) -> f64 {
        let key = (bin as u64) << F32_SHIFT;
        let Ok(key) = u32::try_from(key) else {
            return f64::INFINITY;
        };
        let bits = if key & SIGN == 0 { !key } else { key & !SIGN };
        f64::from(Self::from_bits(bits))
    }
}

/// Bytes of the totals, for the memory plan.
pub fn total_bytes(stored_type: StoredType) -> u64 {
    8 * bins(stored_type)
}

/// Most bytes of the counts as a journal keeps them, for the memory plan.
pub fn saved_bytes(stored_type: StoredType) -> u64 {
    SAVED_LEN as u64 * bins(stored_type)
}

/// Bytes of a worker's counts, for the memory plan.
pub fn worker_bytes(stored_type: StoredType) -> u64 {
    4 * bins(stored_type)
}

fn bins(stored_type: StoredType) -> u64 {
    let bins = match stored_type {
        StoredType::U8 => u8::BINS,
        StoredType::U16 => u16::BINS,
        StoredType::F32 => f32::BINS,
    };
    bins as u64
}

/// Bytes of a bin's count as a journal keeps it: number of the bin, u32, and count, u64. Empty bins are left out.
const SAVED_LEN: usize = 12;

/// What a journal keeps of the totals, beside the counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SavedTotals {
    hash: u64,
    /// Bits of the least value as f32, and how often it came.
    least: Option<(u32, u64)>,
    /// Bits of the greatest value as f32.
    greatest: Option<u32>,
}

/// Counts of all workers.
pub struct Totals<T> {
    sums: Mutex<Sums<T>>,
}

struct Sums<T> {
    counts: Vec<u64>,
    hash: u64,
    least: Option<(T, u64)>,
    greatest: Option<T>,
}

/// What the statistics come to.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Least stored value.
    pub min: f64,
    /// Greatest stored value.
    pub max: f64,
    /// See [`Histogram`].
    pub histogram: Histogram,
    /// See [`Percentiles`].
    pub percentiles: Percentiles,
    /// See `StoreMeta::source_hash`.
    pub hash: u64,
}

/// Counts of one worker, given to [`Totals`] now and then.
pub struct Tally<T> {
    counts: Vec<u32>,
    pending: u32,
    hash: u64,
    least: Option<(T, u64)>,
    greatest: Option<T>,
    rows: Vec<T>,
    bytes: Vec<u8>,
}

impl<T: Binned> Tally<T> {
    /// No voxels yet.
    pub fn new() -> Self {
        Self {
            counts: vec![0; T::BINS],
            pending: 0,
            hash: 0,
            least: None,
            greatest: None,
            rows: Vec::with_capacity(STORED_VOXELS),
            bytes: Vec::with_capacity(STORED_VOXELS * size_of::<T>()),
        }
    }

    /// Counts a brick's own voxels: `size` of them along each axis from its lowest corner, border left out. `index` is
    /// the brick's linear index.
    pub fn add(
        &mut self,
        index: u64,
        size: [usize; 3],
        brick: &[T; STORED_VOXELS],
        totals: &Totals<T>,
    ) {
        own_voxels(brick, size, &mut self.rows);
        self.bytes.resize(self.rows.len() * size_of::<T>(), 0);
        T::write_le(&self.rows, &mut self.bytes);
        self.hash = self
            .hash
            .wrapping_add(xxh3_64_with_seed(&self.bytes, index));
        let first = self.rows[0];
        let (low, high) = self
            .rows
            .iter()
            .fold((first, first), |(l, h), &v| (l.lesser(v), h.greater(v)));
        if low == high {
            self.counts[low.bin()] += self.rows.len() as u32;
        } else {
            let counts = &mut self.counts[..T::BINS];
            for &v in &self.rows {
                counts[v.bin()] += 1;
            }
        }
        if T::EXACT {
            self.least = merge_least(self.least, Some((low, 0)));
        } else if self.least.is_none_or(|(least, _)| low <= least) {
            let equal = self.rows.iter().filter(|&&v| v == low).count() as u64;
            self.least = merge_least(self.least, Some((low, equal)));
        }
        self.greatest = merge_greatest(self.greatest, Some(high));
        self.pending += self.rows.len() as u32;
        if self.pending > u32::MAX / 2 {
            self.give(totals);
        }
    }

    /// Moves the counts to `totals`.
    pub fn give(&mut self, totals: &Totals<T>) {
        let mut sums = totals.sums.lock().unwrap_or_else(PoisonError::into_inner);
        for (total, count) in sums.counts.iter_mut().zip(&mut self.counts) {
            *total += u64::from(std::mem::take(count));
        }
        sums.hash = sums.hash.wrapping_add(std::mem::take(&mut self.hash));
        sums.least = merge_least(sums.least, self.least.take());
        sums.greatest = merge_greatest(sums.greatest, self.greatest.take());
        self.pending = 0;
    }
}

impl<T: Binned> Default for Tally<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// The voxels of a brick without its border, `size` along each axis, x fastest.
pub fn own_voxels<T: Voxel>(brick: &[T; STORED_VOXELS], size: [usize; 3], out: &mut Vec<T>) {
    let (edge, border) = (STORED_EDGE as usize, BRICK_BORDER as usize);
    out.clear();
    for z in border..border + size[2] {
        for y in border..border + size[1] {
            let row = (z * edge + y) * edge + border;
            out.extend_from_slice(&brick[row..row + size[0]]);
        }
    }
}

fn merge_least<T: Voxel>(a: Option<(T, u64)>, b: Option<(T, u64)>) -> Option<(T, u64)> {
    match (a, b) {
        (Some((a, n)), Some((b, m))) if a == b => Some((a, n + m)),
        (Some(a), Some(b)) => Some(if b.0 < a.0 { b } else { a }),
        (a, b) => a.or(b),
    }
}

fn merge_greatest<T: Voxel>(a: Option<T>, b: Option<T>) -> Option<T> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.greater(b)),
        (a, b) => a.or(b),
    }
}

impl<T: Binned> Totals<T> {
    /// No voxels yet.
    pub fn new() -> Self {
        Self {
            sums: Mutex::new(Sums {
                counts: vec![0; T::BINS],
                hash: 0,
                least: None,
                greatest: None,
            }),
        }
    }

    /// What was counted so far, for a journal; the counts are appended to `counts`.
    pub fn save(&self, counts: &mut Vec<u8>) -> SavedTotals {
        let sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
        for (bin, &count) in sums.counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            counts.extend((bin as u32).to_le_bytes());
            counts.extend(count.to_le_bytes());
        }
        SavedTotals {
            hash: sums.hash,
            least: sums.least.map(|(v, n)| (v.to_f32().to_bits(), n)),
            greatest: sums.greatest.map(|v| v.to_f32().to_bits()),
        }
    }

    /// What [`Self::save`] saved after `voxels` voxels; `None` when that can't have been.
    pub fn restore(saved: &SavedTotals, counts: &[u8], voxels: u64) -> Option<Self> {
        let value = |bits: u32| {
            let value = f32::from_bits(bits);
            value.is_finite().then(|| T::from_f32(value))
        };
        let (pairs, rest) = counts.as_chunks::<SAVED_LEN>();
        let mut all = vec![0; T::BINS];
        let mut total = 0u64;
        for pair in pairs {
            let (bin, count) = pair.split_at(4);
            let bin = u32::from_le_bytes(bin.try_into().ok()?);
            let count = u64::from_le_bytes(count.try_into().ok()?);
            *all.get_mut(bin as usize)? = count;
            total = total.checked_add(count)?;
        }
        let least = match saved.least {
            Some((bits, n)) => Some((value(bits)?, n)),
            None => None,
        };
        let greatest = match saved.greatest {
            Some(bits) => Some(value(bits)?),
            None => None,
        };
        let is_sound = rest.is_empty()
            && total == voxels
            && least.is_some() == (voxels > 0)
            && greatest.is_some() == (voxels > 0);
        is_sound.then(|| Self {
            sums: Mutex::new(Sums {
                counts: all,
                hash: saved.hash,
                least,
                greatest,
            }),
        })
    }

    /// The statistics of what was counted: at least one voxel.
    pub fn summary(self) -> Summary {
        let sums = self
            .sums
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let (least, at_least) = sums.least.expect("invariant: a volume has voxels");
        let greatest = sums.greatest.expect("invariant: a volume has voxels");
        // Adding 0 turns −0 into 0, so that the order of equal values does not show.
        let (min, max) = (
            f64::from(least.to_f32()) + 0.0,
            f64::from(greatest.to_f32()) + 0.0,
        );
        let counts = Counts::<T> {
            counts: &sums.counts,
            min,
            max,
            marker: std::marker::PhantomData,
        };
        let at_least = if T::EXACT {
            sums.counts[least.bin()]
        } else {
            at_least
        };
        let all = |percent: f64| counts.percentile(percent, 0, 0);
        let above = |percent: f64| counts.percentile(percent, least.bin(), at_least);
        Summary {
            min,
            max,
            histogram: counts.histogram(),
            percentiles: Percentiles {
                p0_1: all(0.1),
                p1: all(1.0),
                p5: all(5.0),
                p25: all(25.0),
                p50: all(50.0),
                p75: all(75.0),
                p95: all(95.0),
                p99: all(99.0),
                p99_9: all(99.9),
                p1_above_min: above(1.0),
                p99_9_above_min: above(99.9),
            },
            hash: sums.hash,
        }
    }
}

impl<T: Binned> Default for Totals<T> {
    fn default() -> Self {
        Self::new()
    }
}

struct Counts<'a, T> {
    counts: &'a [u64],
    min: f64,
    max: f64,
    marker: std::marker::PhantomData<T>,
}

impl<T: Binned> Counts<'_, T> {
    /// Ends of a bin, cut to the values that occur.
    fn ends(&self, bin: usize) -> (f64, f64) {
        let cut = |v: f64| v.max(self.min).min(self.max);
        (cut(T::bin_start(bin)), cut(T::bin_start(bin + 1)))
    }

    /// Nearest rank: the least value with at least `percent` of the voxels at or below it; `without` voxels of bin `from`
    /// are left out. With none left, the minimum.
    fn percentile(&self, percent: f64, from: usize, without: u64) -> f64 {
        let total = self.counts.iter().sum::<u64>() - without;
        if total == 0 {
            return self.min;
        }
        let rank = ((percent / 100.0 * total as f64).ceil() as u64).clamp(1, total);
        let mut below = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            let count = if bin == from { count - without } else { count };
            if below + count >= rank {
                let (start, end) = self.ends(bin);
                return if T::EXACT {
                    start
                } else {
                    start + (end - start) * ((rank - below) as f64 / count as f64)
                };
            }
            below += count;
        }
        self.max
    }

    fn histogram(&self) -> Histogram {
        let bins = HISTOGRAM_BINS as f64;
        let width = if T::EXACT {
            ((self.max - self.min + 1.0) / bins).ceil()
        } else if self.max > self.min {
            (self.max - self.min) / bins
        } else {
            1.0
        };
        let place = |v: f64| (((v - self.min) / width) as usize).min(HISTOGRAM_BINS - 1);
        let mut out = vec![0u64; HISTOGRAM_BINS];
        for (bin, &count) in self.counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            let (start, end) = self.ends(bin);
            let (first, last) = (place(start), place(end));
            if T::EXACT || first == last {
                out[first] += count;
                continue;
            }
            // Spread evenly; cumulative rounding keeps the sum exact.
            let mut given = 0;
            for (i, slot) in (first..=last).zip(&mut out[first..=last]) {
                let edge = self.min + (i + 1) as f64 * width;
                let share = ((edge - start) / (end - start)).clamp(0.0, 1.0);
                let until = if i == last {
                    count
                } else {
                    ((share * count as f64).round() as u64).clamp(given, count)
                };
                *slot += until - given;
                given = until;
            }
        }
        Histogram {
            start: self.min,
            width,
            counts: out,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary<T: Binned>(fill: impl Fn(usize) -> T) -> (Summary, Vec<T>) {
        let totals = Totals::<T>::new();
        let mut all = Vec::new();
        for index in 0..3u64 {
            let mut tally = Tally::new();
            let brick: Vec<T> = (0..STORED_VOXELS)
                .map(|i| fill(i + index as usize * 7919))
                .collect();
            let brick: Box<[T; STORED_VOXELS]> = brick.try_into().ok().unwrap();
            let size = [32, 20, 5 + index as usize];
            tally.add(index, size, &brick, &totals);
            tally.give(&totals);
            let mut own = Vec::new();
            own_voxels(&brick, size, &mut own);
            all.extend(own);
        }
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        (totals.summary(), all)
    }

    fn rank<T: Binned>(sorted: &[T], percent: f64) -> f64 {
        let i = (percent / 100.0 * sorted.len() as f64).ceil() as usize;
        f64::from(sorted[i.max(1) - 1].to_f32())
    }

    #[test]
    fn integers_are_exact() {
        let (s, sorted) = summary::<u16>(|i| (i * i % 5003 + 40) as u16);
        assert_eq!(s.percentiles.p50, rank(&sorted, 50.0), "median");
        assert_eq!(s.percentiles.p0_1, rank(&sorted, 0.1), "0.1 %");
        let above: Vec<u16> = sorted.iter().copied().filter(|&v| v > sorted[0]).collect();
        assert_eq!(s.percentiles.p1_above_min, rank(&above, 1.0), "1 % above");
        assert_eq!(s.percentiles.p99_9_above_min, rank(&above, 99.9), "99.9 %");
        assert_eq!(s.histogram.width, 2.0, "5003 values in 4096 bins: two each");
        let total: u64 = s.histogram.counts.iter().sum();
        assert_eq!(total, sorted.len() as u64, "every voxel counted once");
        let third = sorted.iter().filter(|&&v| (v - sorted[0]) / 2 == 3).count();
        assert_eq!(s.histogram.counts[3], third as u64, "bin 3");
    }

    #[test]
    fn floats_are_close_and_whole_numbers_exact() {
        for (scale, base) in [(1.0, 0.0), (1e-6, 0.0), (0.001, 273.0), (-1e20, 5.0)] {
            let (s, sorted) = summary::<f32>(|i| (i * i % 4001) as f32 * scale + base);
            for (got, percent) in [
                (s.percentiles.p1, 1.0),
                (s.percentiles.p50, 50.0),
                (s.percentiles.p99_9, 99.9),
            ] {
                let want = rank(&sorted, percent);
                assert!(
                    (got - want).abs() <= want.abs() / 1024.0,
                    "{percent} %: {got} for {want}"
                );
            }
            let total: u64 = s.histogram.counts.iter().sum();
            assert_eq!(total, sorted.len() as u64, "every voxel counted once");
            assert_eq!(
                (s.min, s.max),
                (sorted[0].into(), sorted[sorted.len() - 1].into())
            );
        }
        let (s, _) = summary::<f32>(|i| if i % 10 == 0 { 5.0 } else { 0.0 });
        assert!(
            (s.percentiles.p1_above_min - 5.0).abs() < 0.01,
            "only the fives are above the minimum: {}",
            s.percentiles.p1_above_min
        );
        let (s, _) = summary::<f32>(|_| 3.5);
        assert_eq!(
            s.percentiles.p1_above_min, 3.5,
            "nothing above: the minimum"
        );
    }

    #[test]
    fn saved_totals_go_on_as_if_nothing_had_happened() {
        fn check<T: Binned>(value: impl Fn(usize) -> T) {
            let brick = |index: usize| -> Box<[T; STORED_VOXELS]> {
                let voxels: Vec<T> = (0..STORED_VOXELS).map(|i| value(i + index * 31)).collect();
                voxels.try_into().ok().unwrap()
            };
            let count = |totals: &Totals<T>, bricks: std::ops::Range<usize>| {
                let mut tally = Tally::new();
                for i in bricks {
                    tally.add(i as u64, [32, 7, 5], &brick(i), totals);
                }
                tally.give(totals);
            };
            let straight = Totals::<T>::new();
            count(&straight, 0..4);
            let first = Totals::<T>::new();
            count(&first, 0..2);
            let mut counts = Vec::new();
            let saved = first.save(&mut counts);
            let voxels = 2 * 32 * 7 * 5;
            let again = Totals::<T>::restore(&saved, &counts, voxels).expect("as saved");
            count(&again, 2..4);
            assert_eq!(again.summary(), straight.summary(), "saved in between");
            for (counts, voxels) in [
                (&counts[..counts.len() - 1], voxels),
                (&counts[12..], voxels),
                (&counts[..], voxels + 1),
            ] {
                assert!(
                    Totals::<T>::restore(&saved, counts, voxels).is_none(),
                    "what can't have been"
                );
            }
        }
        check::<u8>(|i| (i * i % 251) as u8);
        check::<u16>(|i| (i * i % 50_021) as u16);
        check::<f32>(|i| (i * i % 5003) as f32 * 0.37 - 900.0);
    }

    #[test]
    fn counts_beyond_32_bits() {
        let totals = Totals::<u8>::new();
        let mut tally = Tally::<u8>::new();
        let brick = Box::new([9; STORED_VOXELS]);
        // 2¹⁷ whole bricks are 2³² voxels.
        let saved = {
            tally.add(0, [32, 32, 32], &brick, &totals);
            tally.give(&totals);
            let mut counts = Vec::new();
            let mut saved = totals.save(&mut counts);
            saved.least = saved.least.map(|(v, _)| (v, 1 << 40));
            saved
        };
        let mut counts = Vec::new();
        counts.extend(9u32.to_le_bytes());
        counts.extend((1u64 << 40).to_le_bytes());
        let totals = Totals::<u8>::restore(&saved, &counts, 1 << 40).unwrap();
        for index in [1 << 17, u64::from(u32::MAX) + 5] {
            tally.add(index, [32, 32, 32], &brick, &totals);
        }
        tally.give(&totals);
        let summary = totals.summary();
        let total: u64 = summary.histogram.counts.iter().sum();
        assert_eq!(total, (1 << 40) + 2 * 32_768, "no count is cut to 32 bits");
        assert_eq!(summary.percentiles.p99_9, 9.0, "ranks beyond 32 bits");
    }

    #[test]
    fn bins_are_in_order_of_value() {
        let values = [f32::MIN, -1.0, -1e-40, -0.0, 0.0, 1e-40, 1.0, f32::MAX];
        for pair in values.windows(2) {
            assert!(pair[0].bin() <= pair[1].bin(), "{pair:?}");
            let (start, end) = (
                f32::bin_start(pair[0].bin()),
                f32::bin_start(pair[0].bin() + 1),
            );
            let v = f64::from(pair[0]);
            assert!(
                start <= v && (v < end || v == 0.0),
                "{v} in {start} … {end}"
            );
        }
    }
}
