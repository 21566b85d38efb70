//! The box filter between levels: one formula, used by the pipeline to make levels and by `verify` to check them.
//!
//! A coarse voxel is the mean of the fine voxels that exist among the two (along each halved axis) that it covers; at
//! the end of an odd axis that is one. Integers: the sum is exact, and halves round up. f32: the sum is taken in f64 in
//! a fixed order (lower y before upper y, lower z before upper z, then x), so that the result is the same on every
//! machine and however the work is divided.

use crate::store::Voxel;

/// A voxel type that can be averaged.
pub trait Mean: Voxel {
    /// What rows are summed in.
    type Sum: Copy + Default + Send + Sync;

    /// `sum = a`, element by element.
    fn start(sum: &mut [Self::Sum], row: &[Self]);

    /// `sum += a`, element by element.
    fn add(sum: &mut [Self::Sum], row: &[Self]);

    /// Means of pairs (or of single ones, when `halve` is false) of `sums`, each the sum of 2^`log2` voxels.
    fn finish(sums: &[Self::Sum], log2: u32, halve: bool, out: &mut [Self]);
}

macro_rules! integer_mean {
    ($t:ty) => {
        impl Mean for $t {
            type Sum = u32;

            #[inline]
            fn start(sum: &mut [u32], row: &[Self]) {
                for (s, &v) in sum.iter_mut().zip(row) {
                    *s = u32::from(v);
                }
            }

            #[inline]
            fn add(sum: &mut [u32], row: &[Self]) {
                for (s, &v) in sum.iter_mut().zip(row) {
                    *s += u32::from(v);
                }
            }

            #[inline]
            fn finish(sums: &[u32], log2: u32, halve: bool, out: &mut [Self]) {
                let mean = |sum: u32, log2: u32| ((sum + ((1 << log2) >> 1)) >> log2) as $t;
                if !halve {
                    for (o, &s) in out.iter_mut().zip(sums) {
                        *o = mean(s, log2);
                    }
                    return;
                }
                let (pairs, last) = sums.as_chunks::<2>();
                for (o, [a, b]) in out.iter_mut().zip(pairs) {
                    *o = mean(a + b, log2 + 1);
                }
                if let ([s], Some(o)) = (last, out.last_mut()) {
                    *o = mean(*s, log2);
                }
            }
        }
    };
}

integer_mean!(u8);
integer_mean!(u16);

impl Mean for f32 {
    type Sum = f64;

    #[inline]
    fn start(sum: &mut [f64], row: &[Self]) {
        for (s, &v) in sum.iter_mut().zip(row) {
            *s = f64::from(v);
        }
    }

    #[inline]
    fn add(sum: &mut [f64], row: &[Self]) {
        for (s, &v) in sum.iter_mut().zip(row) {
            *s += f64::from(v);
        }
    }

    #[inline]
    fn finish(sums: &[f64], log2: u32, halve: bool, out: &mut [Self]) {
        // Powers of two: multiplying by the inverse is exact.
        let inverse = 1.0 / f64::from(1u32 << log2);
        if !halve {
            for (o, &s) in out.iter_mut().zip(sums) {
                *o = (s * inverse) as Self;
            }
            return;
        }
        let (pairs, last) = sums.as_chunks::<2>();
        for (o, [a, b]) in out.iter_mut().zip(pairs) {
            *o = ((a + b) * (0.5 * inverse)) as Self;
        }
        if let ([s], Some(o)) = (last, out.last_mut()) {
            *o = (*s * inverse) as Self;
        }
    }
}

/// One or two neighbouring slices of the finer level, of `width` voxels per row.
#[derive(Clone, Copy, Debug)]
pub struct FinePair<'a, T> {
    /// The slice, or the lower one of two.
    pub lower: &'a [T],
    /// The upper one, when z is halved and it exists.
    pub upper: Option<&'a [T]>,
    /// Voxels per row.
    pub width: usize,
    /// Are x and y halved?
    pub halve: [bool; 2],
}

impl<T: Mean> FinePair<'_, T> {
    /// Rows of a fine slice.
    fn height(&self) -> usize {
        self.lower.len() / self.width
    }

    /// Voxels along x of the coarse slice.
    pub fn coarse_width(&self) -> usize {
        halved(self.width, self.halve[0])
    }

    /// Rows of the coarse slice.
    pub fn coarse_height(&self) -> usize {
        halved(self.height(), self.halve[1])
    }

    /// Fills rows `first…` of the coarse slice; `out` holds whole rows. `sums` is scratch.
    pub fn rows(&self, first: usize, out: &mut [T], sums: &mut Vec<T::Sum>) {
        sums.resize(self.width, T::Sum::default());
        for (i, out) in out.chunks_exact_mut(self.coarse_width()).enumerate() {
            let y = (first + i) << u32::from(self.halve[1]);
            let second = self.halve[1] && y + 1 < self.height();
            let row = |slice: &'_ [T], y: usize| -> std::ops::Range<usize> {
                debug_assert!((y + 1) * self.width <= slice.len(), "invariant: row inside");
                y * self.width..(y + 1) * self.width
            };
            T::start(sums, &self.lower[row(self.lower, y)]);
            if second {
                T::add(sums, &self.lower[row(self.lower, y + 1)]);
            }
            if let Some(upper) = self.upper {
                T::add(sums, &upper[row(upper, y)]);
                if second {
                    T::add(sums, &upper[row(upper, y + 1)]);
                }
            }
            let log2 = u32::from(second) + u32::from(self.upper.is_some());
            T::finish(sums, log2, self.halve[0], out);
        }
    }
}

/// The slices of the coarser level above a box of the finer one, whose lowest corner has even coordinates: `fine` has
/// `size` voxels along each axis, x fastest; `each` is given one slice after another.
pub fn coarse_slices<T: Mean>(
    fine: &[T],
    size: [usize; 3],
    halve: [bool; 3],
    mut each: impl FnMut(&[T]),
) {
    let slice_len = size[0] * size[1];
    let (mut coarse, mut sums) = (Vec::new(), Vec::new());
    for slices in fine.chunks(slice_len << usize::from(halve[2])) {
        let (lower, upper) = slices.split_at(slice_len);
        let pair = FinePair {
            lower,
            upper: (!upper.is_empty()).then_some(upper),
            width: size[0],
            halve: [halve[0], halve[1]],
        };
        coarse.resize(pair.coarse_width() * pair.coarse_height(), T::default());
        pair.rows(0, &mut coarse, &mut sums);
        each(&coarse);
    }
}

fn halved(n: usize, halve: bool) -> usize {
    if halve { n.div_ceil(2) } else { n }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all<T: Mean>(pair: &FinePair<'_, T>) -> Vec<T> {
        let mut out = vec![T::default(); pair.coarse_width() * pair.coarse_height()];
        pair.rows(0, &mut out, &mut Vec::new());
        out
    }

    #[test]
    fn odd_sizes_average_only_what_exists() {
        let lower = [1u8, 2, 10, 4, 5, 20, 100, 101, 255];
        let pair = FinePair {
            lower: &lower,
            upper: None,
            width: 3,
            halve: [true, true],
        };
        // (1+2+4+5)/4 = 3; (10+20)/2 = 15; (100+101)/2 = 100.5 → 101; 255 alone.
        assert_eq!(all(&pair), [3, 15, 101, 255], "3×3 to 2×2");
        let x_only = FinePair {
            halve: [true, false],
            ..pair
        };
        assert_eq!(all(&x_only), [2, 10, 5, 20, 101, 255], "halves round up");
    }

    #[test]
    fn two_slices_of_each_type() {
        let (lower, upper) = ([65535u16; 4], [65535, 65535, 65535, 65532]);
        let pair = FinePair {
            lower: &lower,
            upper: Some(&upper),
            width: 2,
            halve: [true, true],
        };
        assert_eq!(all(&pair), [65535], "65534.625 rounds to 65535");
        let (lower, upper) = ([1e30f32, 1.0, -1e30, 0.0], [0.0f32; 4]);
        let pair = FinePair {
            lower: &lower,
            upper: Some(&upper),
            width: 2,
            halve: [true, true],
        };
        assert_eq!(all(&pair), [0.125], "the sum is in f64, columns first");
    }
}
