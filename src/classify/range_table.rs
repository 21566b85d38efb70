//! The table CT(min, max) of Krüger and Westermann ("Acceleration Techniques for GPU-based Volume Rendering", 2003, §4;
//! techniques.md T4.3): "is anything in this range visible" for every pair of bytes, so that a range of a volume of bytes
//! costs one look-up.
//!
//! It holds what the prefix sums (T1.2, [`super::OpacityTable`]) say of the same ranges, and so decides nothing by itself.
//! Volumes of other types have too many values: with 256 buckets the table would be coarser than the sums.

/// Values of a byte.
const VALUES: usize = 256;

/// Which ranges of bytes can be seen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RangeTable {
    /// Row i has the ranges that begin at i, a bit for each value at which they end.
    rows: Box<[[u64; VALUES / 64]; VALUES]>,
}

impl RangeTable {
    /// The table of what `is_visible` says; a range that holds a visible one must be visible.
    pub(super) fn new(is_visible: impl Fn(f32, f32) -> bool) -> Self {
        let mut rows = Box::new([[0; VALUES / 64]; VALUES]);
        for (i, row) in rows.iter_mut().enumerate() {
            // What begins here and is seen up to some value is seen up to all further ones.
            let first = (i..VALUES).find(|&j| is_visible(i as f32, j as f32));
            for j in first.unwrap_or(VALUES)..VALUES {
                row[j / 64] |= 1 << (j % 64);
            }
        }
        Self { rows }
    }

    /// Can the range be seen? `None` where its ends are no bytes in order.
    pub(super) fn is_visible(&self, lo: f32, hi: f32) -> Option<bool> {
        // Casts saturate, and take NaN to 0.
        let (i, j) = (lo as u8, hi as u8);
        let are_bytes = f32::from(i) == lo && f32::from(j) == hi && i <= j;
        let [i, j] = [i, j].map(usize::from);
        are_bytes.then(|| self.rows[i][j / 64] >> (j % 64) & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_says_what_it_was_told() {
        // Brute force: a range is seen if it holds one of these.
        let seen = [3.0, 64.0, 255.0];
        let is_visible = |lo, hi| seen.iter().any(|&v| lo <= v && v <= hi);
        let table = RangeTable::new(is_visible);
        for i in 0..=255_u8 {
            for j in i..=255 {
                let [lo, hi] = [i, j].map(f32::from);
                assert_eq!(
                    table.is_visible(lo, hi),
                    Some(is_visible(lo, hi)),
                    "{i} to {j}"
                );
            }
        }
        let strange = [
            (0.5, 2.0),
            (-1.0, 4.0),
            (3.0, 256.0),
            (9.0, 8.0),
            (f32::NAN, 3.0),
        ];
        for (lo, hi) in strange {
            assert_eq!(table.is_visible(lo, hi), None, "{lo} to {hi}");
        }
    }
}
