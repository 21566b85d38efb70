//! Comparing pictures: in f32 against a bound, and as PNGs against references that only `UPDATE_GOLDEN` writes.

use std::fmt;

use brickscope::scene::{Image, Mode};

/// abs + rel bound between pipelines that compute the same thing in different code (design.md §2, invariant 1).
pub const TWIN_BOUND: f32 = 1e-4;

/// How two f32 pictures differ.
#[derive(Clone, Debug)]
pub struct Difference {
    /// Greatest difference of a channel.
    pub max: f32,
    /// Mean difference over all channels.
    pub mean: f32,
    /// Pixels with a channel beyond abs + rel `bound`.
    pub beyond: usize,
    /// Where `max` is.
    pub worst: [u32; 2],
    /// The pixel there, in both.
    pub values: [[f32; 4]; 2],
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "max {:.3e}, mean {:.3e}, {} pixels beyond the bound, worst at {:?}: {:?} and {:?}",
            self.max, self.mean, self.beyond, self.worst, self.values[0], self.values[1]
        )
    }
}

/// Compares two pictures channel by channel. Panics when their sizes differ.
pub fn difference(a: &Image, b: &Image, bound: f32) -> Difference {
    assert_eq!(
        [a.width, a.height],
        [b.width, b.height],
        "pictures of one size"
    );
    let mut out = Difference {
        max: 0.0,
        mean: 0.0,
        beyond: 0,
        worst: [0, 0],
        values: [[0.0; 4]; 2],
    };
    let mut sum = 0.0_f64;
    for (i, (p, q)) in a.pixels.iter().zip(&b.pixels).enumerate() {
        let mut is_beyond = false;
        for (x, y) in p.to_array().into_iter().zip(q.to_array()) {
            let d = (x - y).abs();
            sum += f64::from(d);
            is_beyond |= d.is_nan() || d > bound + bound * x.abs().max(y.abs());
            if d > out.max {
                out.max = d;
                out.worst = [i as u32 % a.width, i as u32 / a.width];
                out.values = [p.to_array(), q.to_array()];
            }
        }
        out.beyond += usize::from(is_beyond);
    }
    out.mean = (sum / (a.pixels.len() * 4) as f64) as f32;
    out
}

/// Share of pixels that are not empty.
pub fn coverage(image: &Image) -> f64 {
    image.pixels.iter().filter(|p| p.w > 0.0).count() as f64 / image.pixels.len() as f64
}

/// Panics unless both are equal to the bit, and show something.
pub fn assert_same_bits(a: &Image, b: &Image, what: &str) {
    assert!(coverage(b) > 0.0, "{what}: an empty picture tells nothing");
    assert_equal_bits(a, b, what);
}

/// Panics unless both are equal to the bit; for series of which some views show nothing.
pub fn assert_equal_bits(a: &Image, b: &Image, what: &str) {
    let bits = |image: &Image| -> Vec<[u32; 4]> {
        image
            .pixels
            .iter()
            .map(|p| p.to_array().map(f32::to_bits))
            .collect()
    };
    assert!(
        bits(a) == bits(b),
        "{what}: not equal to the bit: {}",
        difference(a, b, 0.0)
    );
}

/// Panics unless all but `allowed` pixels are within the twin bound, and `expected` shows something.
pub fn assert_twins(actual: &Image, expected: &Image, allowed: usize, what: &str) {
    assert!(
        coverage(expected) > 0.0,
        "{what}: an empty picture tells nothing"
    );
    let d = difference(actual, expected, TWIN_BOUND);
    assert!(d.beyond <= allowed, "{what}: {d} (allowed: {allowed})");
}

/// Pixels that may differ as bisection decides by comparing: where a value is within rounding of the iso-value, the hit moves by
/// the last interval, 1/128 of a step (and a nearly grazing ray may take the next crossing). At most one ray in a thousand.
pub fn by_comparison(mode: Mode, rays: usize) -> usize {
    if mode == Mode::Iso { rays / 1000 } else { 0 }
}
