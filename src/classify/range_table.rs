//! The table CT(min, max) of Krüger and Westermann ("Acceleration Techniques for GPU-based Volume Rendering", 2003, §4;
//! techniques.md T4.3): "is anything in this range visible" for every pair of 256 buckets of values, so that a change of the
//! transfer function costs nothing per voxel and a look-up costs two indices.
//!
//! It holds what [`Visibility`] says, the one place that judges ranges (prefix sums, T1.2), outward to whole buckets.

use super::visibility::Visibility;

/// Buckets along a side.
const BUCKETS: usize = 256;

/// Which ranges can be seen, by the buckets of their ends.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeTable {
    /// Row i has the ranges that begin in bucket i, a bit for each bucket in which they end.
    rows: Vec<[u64; BUCKETS / 64]>,
    lo: f32,
    scale: f32,
}

impl RangeTable {
    /// The table of `visibility` for stored values from `domain[0]` to `domain[1]`, which must be all that occur. A domain
    /// without a finite width makes every range visible.
    pub fn new(visibility: &Visibility, domain: [f32; 2]) -> Self {
        let [lo, hi] = domain;
        let width = (hi - lo) / BUCKETS as f32;
        let scale = width.recip();
        // Written so that NaN takes this way, too.
        if !(width > 0.0 && width.is_finite() && scale.is_finite()) {
            return Self {
                rows: vec![[u64::MAX; BUCKETS / 64]; BUCKETS],
                lo: 0.0,
                scale: 0.0,
            };
        }
        // Rounding may put a value into the neighbouring bucket.
        let slack = width * 1e-3;
        let begin = |i: usize| (lo + i as f32 * width - slack).max(lo);
        let end = |i: usize| (lo + (i + 1) as f32 * width + slack).min(hi);
        let rows = (0..BUCKETS)
            .map(|i| {
                let mut row = [0; BUCKETS / 64];
                // What begins here and is seen up to some bucket is seen up to all further ones.
                let first = (i..BUCKETS).find(|&j| visibility.is_visible(begin(i), end(j)));
                for j in first.unwrap_or(BUCKETS)..BUCKETS {
                    row[j / 64] |= 1 << (j % 64);
                }
                row
            })
            .collect();
        Self { rows, lo, scale }
    }

    /// False only if no value from `lo` to `hi` (stored, lo ≤ hi) can be seen. A range with a NaN can.
    pub fn is_visible(&self, lo: f32, hi: f32) -> bool {
        // Casts saturate, and take NaN to 0: the whole first row and its last bit.
        let bucket = |v: f32| (((v - self.lo) * self.scale) as usize).min(BUCKETS - 1);
        let (i, j) = (bucket(lo), bucket(hi));
        self.rows[i][j / 64] >> (j % 64) & 1 == 1 || lo.is_nan() || hi.is_nan()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::classify::{Lut, OpacityCorrection, grey_ramp};

    proptest! {
        /// Invisible only where the prefix sums say so; visible only where they do within two buckets.
        #[test]
        fn it_says_what_visibility_says(
            values in proptest::collection::vec(-90.0..90.0_f32, 0..4),
            from in -120.0..120.0_f64,
            a in -100.0..100.0_f32,
            width in prop_oneof![0.0..2.0_f32, 0.0..100.0_f32],
            of_opacity in any::<bool>(),
        ) {
            let domain = [-100.0, 100.0_f32];
            let ramp = grey_ramp(from, from + 30.0, 0.5).unwrap();
            let lut = Lut::bake(&ramp, (1.0, 0.0), domain.map(f64::from), OpacityCorrection::None);
            let visibility = match of_opacity {
                true => Visibility::opacity(&lut),
                false => Visibility::iso(&values, domain),
            };
            let table = RangeTable::new(&visibility, domain);
            let b = (a + width).min(domain[1]);
            let visible = table.is_visible(a, b);
            prop_assert!(visible || !visibility.is_visible(a, b), "[{a}, {b}] shows");
            let near = 2.0 * 200.0 / 256.0;
            let wide =
                visibility.is_visible((a - near).max(domain[0]), (b + near).min(domain[1]));
            prop_assert!(!visible || wide, "nothing near [{a}, {b}] shows");
        }
    }

    #[test]
    fn degenerate_domains_hide_nothing() {
        let seen = Visibility::iso(&[5.0], [0.0, 10.0]);
        for domain in [[5.0, 5.0], [0.0, f32::INFINITY], [f32::MIN, f32::MAX]] {
            let table = RangeTable::new(&seen, domain);
            assert!(table.is_visible(4.0, 6.0), "{domain:?}");
        }
        let table = RangeTable::new(&seen, [0.0, 10.0]);
        assert!(table.is_visible(f32::NAN, f32::NAN), "NaN is never skipped");
        assert!(!table.is_visible(6.0, 10.0), "above the value");
        let hidden = RangeTable::new(&Visibility::iso(&[], [0.0, 1.0]), [0.0, 1.0]);
        assert!(!hidden.is_visible(0.0, 1.0), "a table can say no");
    }
}
