//! How far two pictures are apart.

use crate::bench::summary::{median, percentile};
use crate::scene::Image;

/// The part of the pixels that the greater figure leaves out: the few worst.
const SHARE: f64 = 0.999;

/// Over black, in 255ths of full brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Difference {
    /// Root of the mean square over all channels.
    pub(super) rms: f64,
    /// The 99.9th percentile over the pixels of the greatest difference of a channel.
    pub(super) p99_9: f64,
}

impl Difference {
    /// Between two pictures; `None` where their sizes differ or they have no pixel.
    pub(super) fn of(a: &Image, b: &Image) -> Option<Self> {
        if (a.width, a.height) != (b.width, b.height) {
            return None;
        }
        let mut squares = 0.0;
        let greatest: Vec<f64> = (a.pixels.iter().zip(&b.pixels))
            .map(|(a, b)| {
                let apart = (*a - *b).truncate().as_dvec3() * 255.0;
                squares += apart.length_squared();
                apart.abs().max_element()
            })
            .collect();
        Some(Self {
            p99_9: percentile(&greatest, SHARE)?,
            rms: (squares / (3 * greatest.len()) as f64).sqrt(),
        })
    }

    /// The medians of several; `None` of none.
    pub(super) fn medians(all: &[Self]) -> Option<Self> {
        let of = |figure: fn(&Self) -> f64| median(&all.iter().map(figure).collect::<Vec<_>>());
        Some(Self {
            rms: of(|d| d.rms)?,
            p99_9: of(|d| d.p99_9)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;

    /// 1000 pixels, `worse` of which are brighter by one 51st: 5 of 255.
    fn picture(worse: usize) -> Image {
        let mut image = Image::clear([100, 10]);
        image.pixels[..worse].fill(Vec4::new(0.0, 1.0 / 51.0, 0.0, 1.0));
        image
    }

    fn check(worse: usize, rms: f64, p99_9: f64) {
        let found = Difference::of(&picture(worse), &picture(0)).expect("one size");
        assert!((found.rms - rms).abs() < 1e-4, "{found:?}, not {rms}");
        assert!((found.p99_9 - p99_9).abs() < 1e-4, "{found:?}, not {p99_9}");
    }

    #[test]
    fn differences_are_those_by_hand() {
        check(0, 0.0, 0.0);
        // One of 3000 channels: 5 / √3000; a thousandth of the pixels is beyond the percentile, but for its interpolation
        // between the 999th and the 1000th.
        check(1, 5.0 / 3000f64.sqrt(), 5.0 * 0.001);
        check(1000, 5.0 / 3f64.sqrt(), 5.0);
        assert_eq!(Difference::of(&picture(0), &Image::clear([10, 100])), None);
        let of = |rms| Difference { rms, p99_9: 1.0 };
        assert_eq!(
            Difference::medians(&[of(1.0), of(9.0), of(2.0)]),
            Some(of(2.0))
        );
        assert_eq!(Difference::medians(&[]), None);
    }

    /// The test above sees a root mean square over pixels instead of channels.
    #[test]
    #[should_panic(expected = "not")]
    fn a_wrong_mean_is_seen() {
        check(1000, 5.0, 5.0);
    }
}
