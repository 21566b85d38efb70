//! The table that renderers read: a transfer function sampled over stored values, opacity corrected for the step.
//!
//! The CPU and the shaders read it by the very same operations, all in f32, in this order:
//! ```text
//! x = min(max((v − lo) · scale, 0), N − 1)
//! i = min(floor(x), N − 2)
//! f = x − i
//! value = entry[i] + (entry[i + 1] − entry[i]) · f
//! ```
//! `lo` and `scale` come from [`Lut::index_lo_scale`]. The difference is taken before the product on purpose: it is
//! exact for values near `lo`, and there is no multiply-add that one compiler fuses and another doesn't.

use super::transfer::TransferFunction;

/// Entries of a table.
pub const LUT_ENTRIES: usize = 4096;

/// What a table's opacity holds for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OpacityCorrection {
    /// As in the transfer function: for `mip`, `minip`, `mean`, and where the shader corrects by itself.
    None,
    /// For one step along the ray: 1 − (1 − a)^(step/unit).
    Step {
        /// Distance of two samples, world mm, more than 0.
        step_mm: f64,
        /// Length for which the transfer function's opacity holds, mm, more than 0 (`--opacity-unit`).
        unit_mm: f64,
    },
    /// Not an opacity but the optical depth of one step, −ln(1 − a) · step/unit: for mode gradient, where it is scaled before
    /// it becomes an opacity. At most that of an opacity of 1 − 10⁻⁷ per unit.
    Depth {
        /// As above.
        step_mm: f64,
        /// As above.
        unit_mm: f64,
    },
}

impl OpacityCorrection {
    /// The opacity `a` (0…1), corrected; accurate for small ones.
    pub fn apply(self, a: f64) -> f64 {
        match self {
            Self::None => a,
            Self::Step { step_mm, unit_mm } => -((-a).ln_1p() * (step_mm / unit_mm)).exp_m1(),
            Self::Depth { step_mm, unit_mm } => -(-a.min(1.0 - 1e-7)).ln_1p() * (step_mm / unit_mm),
        }
    }
}

/// A baked transfer function: [`LUT_ENTRIES`] entries at equal distances over a range of stored values, joined linearly.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    entries: Vec<[f32; 4]>,
    domain: [f64; 2],
    index_lo_scale: [f32; 2],
}

impl Lut {
    /// Samples `tf` at [`LUT_ENTRIES`] stored values from `domain_stored[0]` to `domain_stored[1]`, both included; values
    /// outside get the end entries. `rescale` is (slope, intercept): physical = slope · stored + intercept; the slope may
    /// be negative, not 0. The domain is rounded to f32 first; one of length 0 (or reversed) is widened upward from its
    /// first value.
    ///
    /// [`Lut::fitted_domain`] gives the domain that wastes no entries.
    pub fn bake(
        tf: &TransferFunction,
        rescale: (f64, f64),
        domain_stored: [f64; 2],
        correction: OpacityCorrection,
    ) -> Self {
        let [lo, hi] = domain_stored.map(|v| v as f32);
        // Written so that NaN takes this way, too.
        let hi = if hi > lo {
            hi
        } else {
            lo + 1.0_f32.max(lo.abs() * 1e-6)
        };
        let index_lo_scale = [lo, index_scale(hi - lo, LUT_ENTRIES)];
        let [lo, hi] = [lo, hi].map(f64::from);
        let last = (LUT_ENTRIES - 1) as f64;
        let entries = (0..LUT_ENTRIES)
            .map(|i| {
                let t = i as f64 / last;
                let stored = lo * (1.0 - t) + hi * t;
                let [r, g, b, a] = tf.eval(rescale.0 * stored + rescale.1);
                [r, g, b, correction.apply(a)].map(|c| c as f32)
            })
            .collect();
        Self {
            entries,
            domain: [lo, hi],
            index_lo_scale,
        }
    }

    /// The part of `data_stored` (least and greatest stored value) on which `tf` is not constant, a little wider on each
    /// side so that a step at an end lies inside: the domain with the finest entries.
    pub fn fitted_domain(
        tf: &TransferFunction,
        rescale: (f64, f64),
        data_stored: [f64; 2],
    ) -> [f64; 2] {
        let [a, b] = tf.extent().map(|x| (x - rescale.1) / rescale.0);
        let (lo, hi) = (a.min(b), a.max(b));
        let data = data_stored[1] - data_stored[0];
        // A step function has no extent of its own: it is given a 256th of the data's.
        let margin = ((hi - lo) / 512.0).max(data / 512.0);
        let fitted = [
            (lo - margin).max(data_stored[0]),
            (hi + margin).min(data_stored[1]),
        ];
        if fitted[0] < fitted[1] {
            fitted
        } else {
            data_stored
        }
    }

    /// The entries: red, green, blue (straight, not premultiplied) and opacity, 0 to 1. Always [`LUT_ENTRIES`].
    pub fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }

    /// Stored values of the first and the last entry, exact in f32.
    pub fn domain(&self) -> [f64; 2] {
        self.domain
    }

    /// `lo` and `scale` of x = (v − lo) · scale, the index of a stored value.
    pub fn index_lo_scale(&self) -> [f32; 2] {
        self.index_lo_scale
    }

    /// The position of `stored` in the table, 0 to [`LUT_ENTRIES`] − 1; NaN is at 0.
    pub fn index(&self, stored: f32) -> f32 {
        let [lo, scale] = self.index_lo_scale;
        ((stored - lo) * scale)
            .max(0.0)
            .min((LUT_ENTRIES - 1) as f32)
    }

    /// Colour and opacity of a stored value, by the operations in the head of this file.
    pub fn sample(&self, stored: f32) -> [f32; 4] {
        let x = self.index(stored);
        let i = (x as usize).min(LUT_ENTRIES - 2);
        let f = x - i as f32;
        let (a, b) = (self.entries[i], self.entries[i + 1]);
        std::array::from_fn(|c| a[c] + (b[c] - a[c]) * f)
    }
}

/// The scale that takes `length` to the last index of `entries`: rounded up where needed, so that the end of the domain reads
/// the last entry and nothing of the one before it.
pub(super) fn index_scale(length: f32, entries: usize) -> f32 {
    let last = (entries - 1) as f32;
    let mut scale = last / length;
    // A division is off by at most half a unit: one step is enough.
    if length * scale < last {
        scale = scale.next_up();
    }
    scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::grey_ramp;

    #[test]
    fn a_ramp_comes_out_as_a_ramp() {
        let tf = grey_ramp(100.0, 300.0, 0.5).unwrap();
        let lut = Lut::bake(&tf, (1.0, 0.0), [0.0, 1000.0], OpacityCorrection::None);
        for v in [-5.0, 0.0, 120.0, 200.0, 299.0, 500.0, 1e9] {
            let (got, want) = (lut.sample(v), tf.eval(f64::from(v)));
            for c in 0..4 {
                assert!(
                    // A kink lies up to half an entry (0.12) from the entries beside it.
                    (f64::from(got[c]) - want[c]).abs() < 0.25 / 200.0,
                    "at {v}: {got:?}, not {want:?}"
                );
            }
        }
        assert_eq!(
            lut.sample(f32::NAN),
            lut.sample(0.0),
            "NaN is the first entry"
        );
    }

    #[test]
    fn a_negative_slope_turns_the_table_round() {
        let tf = grey_ramp(-1000.0, 0.0, 1.0).unwrap();
        let lut = Lut::bake(&tf, (-2.0, 0.0), [0.0, 500.0], OpacityCorrection::None);
        assert_eq!(lut.sample(0.0), [1.0; 4], "stored 0 is 0 HU: white");
        assert_eq!(lut.sample(500.0), [0.0; 4], "stored 500 is −1000 HU: black");
        assert_eq!(
            Lut::fitted_domain(&tf, (-2.0, 0.0), [-1e4, 1e4])[0].signum(),
            -1.0,
            "the fitted domain is in stored values, widened"
        );
    }

    #[test]
    fn the_ends_of_the_domain_read_the_end_entries_exactly() {
        let mut length = 1e-3_f32;
        while length < 1e6 {
            let x = length * index_scale(length, LUT_ENTRIES);
            let last = (LUT_ENTRIES - 1) as f32;
            assert!(
                x >= last && x < last + 0.01,
                "length {length} ends at entry {x}"
            );
            length *= 1.0137;
        }
    }

    #[test]
    fn two_half_steps_make_a_whole_one() {
        let step = |step_mm| OpacityCorrection::Step {
            step_mm,
            unit_mm: 2.0,
        };
        for a in [0.0, 1e-12, 0.3, 0.999, 1.0] {
            let half = step(1.0).apply(a);
            let whole = half + (1.0 - half) * half;
            assert!(
                (whole - a).abs() <= 1e-15 + 1e-12 * a,
                "{a}: two halves make {whole}"
            );
            assert_eq!(half > 0.0, a > 0.0, "{a} stays visible");
        }
        assert!(step(0.5).apply(1.0) == 1.0, "opaque stays opaque");
    }

    #[test]
    fn a_fitted_domain_changes_nothing_but_resolution() {
        let tf = grey_ramp(1000.0, 1100.0, 1.0).unwrap();
        let domain = Lut::fitted_domain(&tf, (1.0, 0.0), [0.0, 65535.0]);
        assert!(
            domain[0] < 1000.0 && domain[1] > 1100.0 && domain[1] - domain[0] < 400.0,
            "{domain:?}"
        );
        let lut = Lut::bake(&tf, (1.0, 0.0), domain, OpacityCorrection::None);
        for v in 0..=65535_u16 {
            let d = f64::from(lut.sample(f32::from(v))[3]) - tf.eval(f64::from(v))[3];
            assert!(d.abs() < 5e-4, "at {v}: off by {d}");
        }
        assert_eq!(
            Lut::fitted_domain(&tf, (1.0, 0.0), [2000.0, 3000.0]),
            [2000.0, 3000.0],
            "no overlap: the data's own"
        );
    }
}
