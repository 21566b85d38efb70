//! "Can a value in [lo, hi] be seen?", in constant time: the question that decides which blocks and bricks exist for the
//! renderer.
//!
//! Conservative by construction: it looks at the very table that is rendered with, the range widened outward by one
//! entry and by a few f32 roundings, so that it never says no where a sample drawn from the range would show.

use super::lut::Lut;
use super::preintegrated::TransferIntegrals;
use super::range_table::RangeTable;

/// Roundings of f32 by which a range is widened: interpolating between values of a range can leave it by about three.
const ROUNDINGS: f32 = 4.0;

/// Which stored values can be seen, under one classification and mode.
#[derive(Clone, Debug, PartialEq)]
pub enum Visibility {
    /// Everything: modes in which every sample counts (`mean`).
    All,
    /// Values with opacity (`dvr`, `xray`, `gradient`).
    Opacity(OpacityTable),
    /// Ranges that hold an iso-value (`iso`).
    Iso(IsoValues),
    /// Ranges that can raise a maximum (`mip`) above `floor`, the volume's least stored value.
    AboveMinimum {
        /// The volume's least stored value.
        floor: f32,
    },
    /// Ranges that can lower a minimum (`minip`) below `ceiling`, the volume's greatest stored value.
    BelowMaximum {
        /// The volume's greatest stored value.
        ceiling: f32,
    },
}

impl Visibility {
    /// Values that have opacity in `lut`.
    pub fn opacity(lut: &Lut) -> Self {
        Self::Opacity(OpacityTable::new(lut))
    }

    /// Surfaces of `values` (stored, in any order; NaN never shows) in a volume whose stored values lie in `domain`.
    pub fn iso(values: &[f32], domain: [f32; 2]) -> Self {
        Self::Iso(IsoValues::new(values, domain))
    }

    /// Values that have opacity between two entries of the tables made from `integrals`.
    pub fn preintegrated(integrals: &TransferIntegrals) -> Self {
        Self::Opacity(OpacityTable::of_integrals(integrals))
    }

    /// The same, for a volume of bytes: ranges of whole bytes are looked up in a table (T4.3) of what the counts say.
    pub fn of_bytes(self) -> Self {
        match self {
            Self::Opacity(counts) => Self::Opacity(counts.of_bytes()),
            other => other,
        }
    }

    /// False only if no value from `lo` to `hi` (stored, lo ≤ hi) can be seen. A range with a NaN can.
    pub fn is_visible(&self, lo: f32, hi: f32) -> bool {
        if lo.is_nan() || hi.is_nan() {
            return true;
        }
        match self {
            Self::All => true,
            Self::Opacity(table) => table.is_visible(lo, hi),
            Self::Iso(values) => values.is_visible(lo, hi),
            Self::AboveMinimum { floor } => hi > *floor,
            Self::BelowMaximum { ceiling } => lo < *ceiling,
        }
    }
}

/// Running counts of a table's entries that have opacity.
#[derive(Clone, Debug, PartialEq)]
pub struct OpacityTable {
    /// `before[i]`: how many of the first i entries have opacity. Whole numbers: differences are exact.
    before: Vec<u16>,
    lo: f32,
    scale: f32,
    /// What they say of ranges of bytes, where the volume is of bytes.
    bytes: Option<RangeTable>,
}

impl OpacityTable {
    /// The counts for `lut`.
    pub fn new(lut: &Lut) -> Self {
        Self::of_flags(
            lut.entries().iter().map(|e| e[3] > 0.0),
            lut.index_lo_scale(),
        )
    }

    /// The counts for the tables made from `integrals`: an entry counts if there is opacity at it or between it and the one
    /// before, so that a segment between two values is judged by all that lies between the entries around them.
    pub fn of_integrals(integrals: &TransferIntegrals) -> Self {
        Self::of_flags(
            integrals.opaque().iter().copied(),
            integrals.index_lo_scale(),
        )
    }

    fn of_flags(flags: impl Iterator<Item = bool>, [lo, scale]: [f32; 2]) -> Self {
        let mut count = 0;
        let before = std::iter::once(0)
            .chain(flags.map(|flag| {
                count += u16::from(flag);
                count
            }))
            .collect();
        Self {
            before,
            lo,
            scale,
            bytes: None,
        }
    }

    fn of_bytes(self) -> Self {
        Self {
            bytes: Some(RangeTable::new(|lo, hi| self.is_counted(lo, hi))),
            ..self
        }
    }

    /// False only if no value from `lo` to `hi` has opacity.
    fn is_visible(&self, lo: f32, hi: f32) -> bool {
        let known = self.bytes.as_ref().and_then(|t| t.is_visible(lo, hi));
        known.unwrap_or_else(|| self.is_counted(lo, hi))
    }

    /// The same by the counts.
    fn is_counted(&self, lo: f32, hi: f32) -> bool {
        let slack = ROUNDINGS * f32::EPSILON * lo.abs().max(hi.abs());
        let place = |v: f32| (v - self.lo) * self.scale;
        let last = self.before.len() - 2;
        // Lut::index, and one entry outward: floor − 1 below, floor + 1 (the other end of the line) + 1 above. Values at
        // and beyond the table's ends read the end entries alone, exactly: air at the foot of a ramp can't be seen.
        let index = |v: f32| place(v).max(0.0).min(last as f32) as usize;
        let first = if place(lo - slack) >= last as f32 {
            last
        } else {
            index(lo - slack).saturating_sub(1)
        };
        let end = if place(hi + slack) <= 0.0 {
            1
        } else {
            (index(hi + slack) + 3).min(last + 1)
        };
        self.before[end] > self.before[first]
    }
}

/// Iso-values, sorted, and how far outside a range one still counts.
#[derive(Clone, Debug, PartialEq)]
pub struct IsoValues {
    sorted: Vec<f32>,
    slack: f32,
}

impl IsoValues {
    /// The iso-values `values` (NaN are dropped), for stored values in `domain`.
    pub fn new(values: &[f32], domain: [f32; 2]) -> Self {
        let mut sorted: Vec<f32> = values.iter().copied().filter(|v| !v.is_nan()).collect();
        sorted.sort_by(f32::total_cmp);
        Self {
            sorted,
            slack: ROUNDINGS * f32::EPSILON * domain[0].abs().max(domain[1].abs()),
        }
    }

    fn is_visible(&self, lo: f32, hi: f32) -> bool {
        let first = self.sorted.partition_point(|&v| v < lo - self.slack);
        self.sorted
            .get(first)
            .is_some_and(|&v| v <= hi + self.slack)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::classify::{
        ColorCurve, ColorPoint, ColorSpace, LUT_ENTRIES, OpacityCorrection, OpacityCurve,
        OpacityPoint, TransferFunction,
    };

    fn function(points: &[(f64, f64, f64)]) -> TransferFunction {
        let mut xs: Vec<f64> = points.iter().map(|p| p.0).collect();
        xs.sort_by(f64::total_cmp);
        let points = xs
            .iter()
            .zip(points)
            .map(|(&x, p)| OpacityPoint {
                // Most of the range is fully transparent, as in real functions.
                opacity: if p.1 < 0.6 { 0.0 } else { p.1 - 0.6 },
                sharpness: p.2,
                ..OpacityPoint::linear(x, 0.0)
            })
            .collect();
        TransferFunction::new(
            "",
            ColorCurve::new(
                vec![ColorPoint {
                    x: 0.0,
                    rgb: [1.0; 3],
                }],
                ColorSpace::Rgb,
            )
            .unwrap(),
            OpacityCurve::new(points).unwrap(),
        )
    }

    fn lut(points: &[(f64, f64, f64)], domain: [f64; 2]) -> Lut {
        let correction = OpacityCorrection::Step {
            step_mm: 0.1,
            unit_mm: 1.0,
        };
        Lut::bake(&function(points), (1.0, 0.0), domain, correction)
    }

    #[test]
    fn air_at_the_foot_of_a_ramp_is_invisible() {
        let ramp = crate::classify::grey_ramp(0.0, 255.0, 0.06).unwrap();
        let lut = Lut::bake(&ramp, (1.0, 0.0), [0.0, 255.0], OpacityCorrection::None);
        let table = Visibility::opacity(&lut);
        assert!(!table.is_visible(0.0, 0.0), "opacity 0 exactly");
        assert!(!table.is_visible(-3.0, -0.1), "below the table");
        assert!(table.is_visible(0.0, 1e-3), "a hair above");
        assert!(table.is_visible(255.0, 300.0), "the top entry");
    }

    proptest! {
        /// Invariant 4: never invisible where a sample would show; and exact to two entries the other way.
        #[test]
        fn opacity_is_conservative_and_tight(
            points in proptest::collection::vec((0.0..1000.0, 0.0..1.0, 0.0..1.0), 2..12),
            offset in prop_oneof![Just(0.0), -1e5..1e5_f64],
            a in -200.0..1200.0_f64,
            width in prop_oneof![0.0..5.0_f64, 0.0..800.0_f64],
        ) {
            let moved: Vec<_> = points.iter().map(|p| (p.0 + offset, p.1, p.2)).collect();
            let lut = lut(&moved, [offset, offset + 1000.0]);
            let (lo, hi) = ((a + offset) as f32, (a + width + offset) as f32);
            let visible = Visibility::opacity(&lut).is_visible(lo, hi);
            let shown = (0..=2000).any(|i| {
                let v = lo + (hi - lo) * (i as f32 / 2000.0);
                lut.sample(v)[3] > 0.0
            });
            prop_assert!(visible || !shown, "a sample of [{lo}, {hi}] shows");
            // Brute force over the entries, outward by the widening and the slack.
            let slack = 4 + (f64::from(lo.abs().max(hi.abs())) * 5e-7 * 4.1) as usize;
            let first = (lut.index(lo) as usize).saturating_sub(slack);
            let last = (lut.index(hi) as usize + slack).min(LUT_ENTRIES - 1);
            let near = lut.entries()[first..=last].iter().any(|e| e[3] > 0.0);
            prop_assert!(!visible || near, "nothing near [{lo}, {hi}] shows");
        }

        /// The table of a volume of bytes changes no answer, whole bytes or not.
        #[test]
        fn bytes_are_judged_alike(
            points in proptest::collection::vec((0.0..255.0, 0.0..1.0, 0.0..1.0), 2..12),
            a in 0_u8..=255,
            b in 0_u8..=255,
            beyond in 0.0..2.0_f32,
        ) {
            let counted = Visibility::opacity(&lut(&points, [0.0, 255.0]));
            let looked_up = counted.clone().of_bytes();
            let [lo, hi] = [a.min(b), a.max(b)].map(f32::from);
            for hi in [hi, hi + beyond] {
                prop_assert_eq!(looked_up.is_visible(lo, hi), counted.is_visible(lo, hi));
            }
        }

        /// The same for segments: never invisible where one between two values of the range would show.
        #[test]
        fn segments_are_judged_conservatively(
            points in proptest::collection::vec((0.0..1000.0, 0.0..1.0, 0.0..1.0), 2..12),
            a in 0.0..1000.0_f64,
            width in prop_oneof![0.0..5.0_f64, 0.0..800.0_f64],
        ) {
            let integrals =
                TransferIntegrals::new(&function(&points), (1.0, 0.0), [0.0, 1000.0], 256, 1.0);
            let table = integrals.table(0.1);
            let (lo, hi) = (a as f32, (a + width).min(1000.0) as f32);
            let visible = Visibility::preintegrated(&integrals).is_visible(lo, hi);
            let value = |i: u8| lo + (hi - lo) * (f32::from(i) / 30.0);
            let shown = (0..=30).any(|i| (0..=30).any(|j| table.sample(value(i), value(j))[3] > 0.0));
            prop_assert!(visible || !shown, "a segment within [{lo}, {hi}] shows");
            // Three entries further out there must be something.
            let entry = 1000.0 / 255.0;
            let near = |v: f32, by: f64| (f64::from(v) + by).clamp(0.0, 1000.0) as f32;
            let wide = table.sample(near(lo, -3.5 * entry), near(hi, 3.5 * entry))[3] > 0.0;
            prop_assert!(!visible || wide, "nothing near [{lo}, {hi}] shows");
        }

        #[test]
        fn iso_matches_a_linear_search(
            values in proptest::collection::vec(-100.0..100.0_f32, 0..6),
            a in -120.0..120.0_f32,
            width in 0.0..30.0_f32,
        ) {
            let visibility = Visibility::iso(&values, [-100.0, 100.0]);
            let inside = values.iter().any(|&v| a <= v && v <= a + width);
            let near = values.iter().any(|&v| a - 1e-3 <= v && v <= a + width + 1e-3);
            let visible = visibility.is_visible(a, a + width);
            prop_assert!(visible || !inside, "an iso-value inside is found");
            prop_assert!(!visible || near, "none is made up");
        }
    }

    #[test]
    fn extremes() {
        let mip = Visibility::AboveMinimum { floor: 3.0 };
        assert!(!mip.is_visible(3.0, 3.0), "all at the minimum");
        assert!(mip.is_visible(3.0, 4.0), "something above");
        let minip = Visibility::BelowMaximum { ceiling: 9.0 };
        assert!(!minip.is_visible(9.0, 9.0), "all at the maximum");
        assert!(minip.is_visible(8.0, 9.0), "something below");
        assert!(Visibility::All.is_visible(0.0, 0.0), "all");
        assert!(mip.is_visible(f32::NAN, f32::NAN), "NaN is never skipped");
        assert!(
            !Visibility::iso(&[f32::NAN], [0.0, 1.0]).is_visible(-1e9, 1e9),
            "a NaN iso-value shows nothing"
        );
    }

    #[test]
    fn values_outside_the_domain_use_the_end_entries() {
        let lut = lut(
            &[(0.0, 0.0, 0.0), (900.0, 0.0, 0.0), (1000.0, 1.0, 0.0)],
            [0.0, 1000.0],
        );
        let visibility = Visibility::opacity(&lut);
        assert!(
            visibility.is_visible(5000.0, 6000.0),
            "above: the last entry"
        );
        assert!(!visibility.is_visible(-10.0, -5.0), "below: the first");
        assert!(!visibility.is_visible(0.0, 800.0), "transparent part");
    }
}
