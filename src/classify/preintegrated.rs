//! The table of integrals of pre-integrated rendering: colour and opacity of a segment by the values at its two ends
//! (Engel, Kraus, Ertl, "High-Quality Pre-Integrated Volume Rendering", 2001, §4; techniques.md T2.1).
//!
//! Between the ends f and b the value is taken to run linearly. With the extinction τ(v) = −ln(1 − a(v)) / unit of a transfer
//! function, the segment's optical depth is exact, ds / (b − f) · ∫ τ dv; its colour is the mean of the colours, weighted
//! by extinction: what lies in the front of a segment doesn't hide what lies in its back (§4.2 there). The integrals are
//! differences of running sums, so that a table costs O(entries).
//!
//! The CPU and the shaders read it by the very same operations, all in f32, in this order:
//! ```text
//! x = min(max((v − lo) · scale, 0), N − 1)      for the value in front (x) and in the back (y)
//! i = min(floor(x), N − 2),  f = x − i          likewise j, g
//! near = e[j][i]     + (e[j][i + 1]     − e[j][i])     · f
//! far  = e[j + 1][i] + (e[j + 1][i + 1] − e[j + 1][i]) · f
//! value = near + (far − near) · g
//! ```

use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::transfer::TransferFunction;

/// Opacity at which extinction ends: a transfer function's 1 would be infinite.
const MOST_OPACITY: f64 = 1.0 - 1e-7;

/// Points of the running sums between two entries, at least.
const POINTS: usize = 16;

/// Least points of the running sums.
const LEAST_POINTS: usize = 1 << 14;

/// Colour and opacity of segments of one length.
#[derive(Clone, Debug, PartialEq)]
pub struct PreintegratedTable {
    side: usize,
    entries: Vec<[f32; 4]>,
    index_lo_scale: [f32; 2],
}

/// The integrals that tables of all segment lengths share.
#[derive(Clone, Debug)]
pub struct TransferIntegrals {
    side: usize,
    domain: [f64; 2],
    unit_mm: f64,
    /// At each entry: ∫ τ dv and ∫ c τ dv from the domain's beginning (τ per opacity unit), in units of the domain's length.
    sums: Vec<[f64; 4]>,
    /// At each entry: colour and τ.
    values: Vec<[f64; 4]>,
    /// At each entry: has the transfer function opacity there or between it and the entry before?
    opaque: Vec<bool>,
}

impl TransferIntegrals {
    /// Integrates `tf` over stored values from `domain_stored[0]` to `domain_stored[1]`, which must be all that occur:
    /// values outside count as the ends, which at an end of a segment would be wrong. `rescale` as for
    /// [`super::Lut::bake`].
    pub fn new(
        tf: &TransferFunction,
        rescale: (f64, f64),
        domain_stored: [f64; 2],
        side: usize,
        unit_mm: f64,
    ) -> Self {
        let [lo, hi] = domain_stored.map(|v| f64::from(v as f32));
        let hi = if hi > lo {
            hi
        } else {
            lo + 1.0_f64.max(lo.abs() * 1e-6)
        };
        let points = (LEAST_POINTS / (side - 1) + 1).max(POINTS);
        let count = (side - 1) * points;
        let at = |p: usize| {
            let t = p as f64 / count as f64;
            let [r, g, b, a] = tf.eval(rescale.0 * (lo * (1.0 - t) + hi * t) + rescale.1);
            // Extinction per opacity unit; exactly 0 where there is no opacity.
            [r, g, b, -(-a.min(MOST_OPACITY)).ln_1p()]
        };
        let mut sums = Vec::with_capacity(side);
        let mut values = Vec::with_capacity(side);
        let mut opaque = Vec::with_capacity(side);
        let mut before = at(0);
        let mut sum = [0.0; 4];
        let mut seen = before[3] > 0.0;
        for p in 0..=count {
            let here = at(p);
            if p > 0 {
                let width = 0.5 / count as f64;
                for c in 0..3 {
                    sum[c] += (before[c] * before[3] + here[c] * here[3]) * width;
                }
                sum[3] += (before[3] + here[3]) * width;
                seen |= before[3] > 0.0 || here[3] > 0.0;
            }
            if p % points == 0 {
                sums.push(sum);
                values.push(here);
                opaque.push(seen);
                seen = false;
            }
            before = here;
        }
        Self {
            side,
            domain: [lo, hi],
            unit_mm,
            sums,
            values,
            opaque,
        }
    }

    /// The table for segments of `step_mm`.
    pub fn table(&self, step_mm: f64) -> PreintegratedTable {
        let side = self.side;
        let last = (side - 1) as f64;
        let depth = step_mm / self.unit_mm;
        let entry = |i: usize, j: usize| {
            // Colour times extinction, and extinction, of the mean between the two values.
            let [r, g, b, extinction] = if i == j {
                let [r, g, b, e] = self.values[i];
                [r * e, g * e, b * e, e]
            } else {
                let share = last / (j as f64 - i as f64);
                std::array::from_fn(|c| (self.sums[j][c] - self.sums[i][c]) * share)
            };
            if extinction <= 0.0 {
                return [0.0; 4];
            }
            let opacity = -(-extinction * depth).exp_m1();
            let scale = opacity / extinction;
            [r * scale, g * scale, b * scale, opacity].map(|v| v as f32)
        };
        let mut entries = vec![[0.0; 4]; side * side];
        // The table is symmetric: colours are means. One half is worked out, the other copied.
        entries
            .par_chunks_exact_mut(side)
            .enumerate()
            .for_each(|(j, row)| {
                for (i, value) in row[..=j].iter_mut().enumerate() {
                    *value = entry(i, j);
                }
            });
        for j in 0..side {
            for i in j + 1..side {
                entries[j * side + i] = entries[i * side + j];
            }
        }
        PreintegratedTable {
            side,
            entries,
            index_lo_scale: self.index_lo_scale(),
        }
    }

    /// `lo` and `scale` of x = (v − lo) · scale, the place of a stored value along either side of a table.
    pub fn index_lo_scale(&self) -> [f32; 2] {
        let [lo, hi] = self.domain.map(|v| v as f32);
        [lo, super::lut::index_scale(hi - lo, self.side)]
    }

    /// At each entry along a side: can a segment that ends between it and the entry before be seen?
    pub(super) fn opaque(&self) -> &[bool] {
        &self.opaque
    }
}

/// What the integrals are of: all that their tables depend on but the length of the segments.
#[derive(Clone, Debug, PartialEq)]
struct IntegralsKey {
    tf: TransferFunction,
    rescale: (f64, f64),
    domain_stored: [f64; 2],
    side: usize,
    unit_mm: f64,
}

/// The integrals and tables that were last asked for: pictures of one transfer function share them, whatever the camera does.
/// Clones are the same one.
#[derive(Clone, Debug, Default)]
pub struct SegmentTables {
    last: Arc<Mutex<Option<KnownTables>>>,
}

#[derive(Debug)]
struct KnownTables {
    key: IntegralsKey,
    integrals: Arc<TransferIntegrals>,
    /// By length of the segments, mm.
    tables: Vec<(f64, Arc<PreintegratedTable>)>,
}

impl SegmentTables {
    /// The integrals ([`TransferIntegrals::new`]) and a table for each length of segments (mm), in that order: those that are
    /// there, or new ones. Tables of other lengths are dropped.
    pub fn of(
        &self,
        tf: &TransferFunction,
        rescale: (f64, f64),
        domain_stored: [f64; 2],
        side: usize,
        unit_mm: f64,
        steps_mm: &[f64],
    ) -> (Arc<TransferIntegrals>, Vec<Arc<PreintegratedTable>>) {
        let key = IntegralsKey {
            tf: tf.clone(),
            rescale,
            domain_stored,
            side,
            unit_mm,
        };
        // What a panic left is whole: nothing is changed in place.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let known = last.take().filter(|known| known.key == key);
        let (integrals, known) = match known {
            Some(known) => (known.integrals, known.tables),
            None => {
                let new = TransferIntegrals::new(tf, rescale, domain_stored, side, unit_mm);
                (Arc::new(new), Vec::new())
            }
        };
        let mut tables: Vec<(f64, Arc<PreintegratedTable>)> = Vec::with_capacity(steps_mm.len());
        for &step_mm in steps_mm {
            let there = tables.iter().chain(&known).find(|t| t.0 == step_mm);
            let table =
                there.map_or_else(|| Arc::new(integrals.table(step_mm)), |t| Arc::clone(&t.1));
            tables.push((step_mm, table));
        }
        let own = tables.iter().map(|t| Arc::clone(&t.1)).collect();
        *last = Some(KnownTables {
            key,
            integrals: Arc::clone(&integrals),
            tables,
        });
        (integrals, own)
    }
}

impl PreintegratedTable {
    /// Entries along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Premultiplied colour and opacity, 0 to 1; row j has the segments that end in value number j, in the order of the
    /// values in which they begin.
    pub fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }

    /// `lo` and `scale` of x = (v − lo) · scale, the place of a stored value along either side.
    pub fn index_lo_scale(&self) -> [f32; 2] {
        self.index_lo_scale
    }

    /// Premultiplied colour and opacity of the segment from the stored value `front` to `back`, by the operations in the
    /// head of this file.
    pub fn sample(&self, front: f32, back: f32) -> [f32; 4] {
        let [lo, scale] = self.index_lo_scale;
        let last = (self.side - 1) as f32;
        let place = |v: f32| {
            let x = ((v - lo) * scale).max(0.0).min(last);
            let i = (x as usize).min(self.side - 2);
            (i, x - i as f32)
        };
        let ((i, f), (j, g)) = (place(front), place(back));
        let row = |j: usize| {
            let a = self.entries[j * self.side + i];
            let b = self.entries[j * self.side + i + 1];
            std::array::from_fn::<f32, 4, _>(|c| a[c] + (b[c] - a[c]) * f)
        };
        let (near, far) = (row(j), row(j + 1));
        std::array::from_fn(|c| near[c] + (far[c] - near[c]) * g)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::{
        ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint, grey_ramp,
    };

    fn peak(center: f64, width: f64) -> TransferFunction {
        let color = |x, rgb| ColorPoint { x, rgb };
        TransferFunction::new(
            "peak",
            ColorCurve::new(
                vec![color(0.0, [1.0, 0.0, 0.5]), color(255.0, [0.0, 1.0, 0.5])],
                ColorSpace::Rgb,
            )
            .unwrap(),
            OpacityCurve::new(vec![
                OpacityPoint::linear(center - width, 0.0),
                OpacityPoint::linear(center, 0.9),
                OpacityPoint::linear(center + width, 0.0),
            ])
            .unwrap(),
        )
    }

    /// Midpoint rule with many parts, from the definition.
    fn brute_force(tf: &TransferFunction, f: f64, b: f64, depth: f64) -> [f64; 4] {
        let n = 20_000;
        let mut sum = [0.0; 4];
        for k in 0..n {
            let v = f + (b - f) * (f64::from(k) + 0.5) / f64::from(n);
            let [r, g, bl, a] = tf.eval(v);
            let e = -(-a.min(MOST_OPACITY)).ln_1p() / f64::from(n);
            for (s, c) in sum.iter_mut().zip([r * e, g * e, bl * e, e]) {
                *s += c;
            }
        }
        let opacity = -(-sum[3] * depth).exp_m1();
        let scale = if sum[3] > 0.0 { opacity / sum[3] } else { 0.0 };
        [sum[0] * scale, sum[1] * scale, sum[2] * scale, opacity]
    }

    #[test]
    fn entries_are_the_integral() {
        let tf = peak(100.4, 3.0);
        let integrals = TransferIntegrals::new(&tf, (1.0, 0.0), [0.0, 255.0], 256, 2.0);
        let table = integrals.table(1.0);
        for (f, b) in [
            (0.0, 255.0),
            (90.0, 101.0),
            (101.0, 90.0),
            (99.0, 100.0),
            (10.0, 20.0),
        ] {
            let want = brute_force(&tf, f, b, 0.5);
            let got = table.sample(f as f32, b as f32);
            for c in 0..4 {
                assert!(
                    (f64::from(got[c]) - want[c]).abs() < 2e-4,
                    "segment {f} to {b}: {got:?}, not {want:?}"
                );
            }
        }
        assert_eq!(
            table.sample(10.0, 60.0),
            [0.0; 4],
            "nothing there: exactly nothing"
        );
        let thin = TransferIntegrals::new(&peak(100.4, 0.3), (1.0, 0.0), [0.0, 255.0], 256, 1.0);
        assert!(
            thin.table(1.0).sample(90.0, 110.0)[3] > 0.01,
            "a peak between two entries isn't lost"
        );
    }

    #[test]
    fn tables_are_worked_out_once() {
        let ramp = |top| grey_ramp(0.0, 255.0, top).unwrap();
        let (tables, domain) = (SegmentTables::default(), [0.0, 255.0]);
        let of = |tf: &TransferFunction, unit, steps: &[f64]| {
            tables
                .clone()
                .of(tf, (1.0, 0.0), domain, 256, unit, steps)
                .1
        };
        let first = of(&ramp(0.5), 1.0, &[0.5, 1.0]);
        let again = of(&ramp(0.5), 1.0, &[1.0, 2.0]);
        assert!(Arc::ptr_eq(&first[1], &again[0]), "the same length");
        assert_ne!(again[0], again[1], "another length");
        for other in [of(&ramp(0.6), 1.0, &[1.0]), of(&ramp(0.6), 2.0, &[1.0])] {
            assert_ne!(other[0], first[1], "of another function or unit");
        }
        let fresh = TransferIntegrals::new(&ramp(0.6), (1.0, 0.0), domain, 256, 1.0);
        assert_eq!(*of(&ramp(0.6), 1.0, &[1.0])[0], fresh.table(1.0));
    }

    #[test]
    fn two_halves_make_a_whole() {
        let ramp = grey_ramp(0.0, 255.0, 0.6).unwrap();
        let integrals = TransferIntegrals::new(&ramp, (1.0, 0.0), [0.0, 255.0], 256, 1.0);
        let (half, whole) = (integrals.table(0.5), integrals.table(1.0));
        for v in [1.0_f32, 77.3, 254.0] {
            let a = half.sample(v, v)[3];
            let b = whole.sample(v, v)[3];
            assert!(
                (a + (1.0 - a) * a - b).abs() < 1e-5,
                "at {v}: {a} twice, {b}"
            );
        }
    }

    #[test]
    fn opaque_stays_finite() {
        let solid = grey_ramp(0.0, 0.0, 1.0).unwrap();
        let table = TransferIntegrals::new(&solid, (1.0, 0.0), [-5.0, 5.0], 1024, 1.0).table(1.0);
        let e = table.sample(4.0, 5.0);
        assert!(e[3] > 0.999_99 && e.iter().all(|v| v.is_finite()), "{e:?}");
        assert_eq!(table.sample(-5.0, -1.0), [0.0; 4], "transparent part");
    }
}
