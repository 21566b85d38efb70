//! Frames per second, exact.

use std::fmt;
use std::str::FromStr;

/// Frames per second as a fraction: 30, 29.97 (2997/100) or 30000/1001.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate {
    frames: u32,
    seconds: u32,
}

impl FrameRate {
    /// Most frames per second.
    const MOST: u32 = 1000;
    /// Most digits behind the point.
    const MOST_DIGITS: usize = 4;

    /// When frame `number` is shown, seconds.
    pub fn seconds_of(self, number: u64) -> f64 {
        number as f64 * f64::from(self.seconds) / f64::from(self.frames)
    }

    /// How many frames `seconds` have, at least one.
    pub fn frames_in(self, seconds: f64) -> u64 {
        ((seconds * self.per_second()).round() as u64).max(1)
    }

    /// Frames per second.
    pub fn per_second(self) -> f64 {
        f64::from(self.frames) / f64::from(self.seconds)
    }
}

impl fmt::Display for FrameRate {
    /// `30` or `30000/1001`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.seconds {
            1 => write!(f, "{}", self.frames),
            seconds => write!(f, "{}/{seconds}", self.frames),
        }
    }
}

impl FromStr for FrameRate {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let whole = |part: &str| {
            let digits = !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
            digits.then(|| part.parse::<u32>().ok()).flatten()
        };
        let parts = match (s.split_once('/'), s.split_once('.')) {
            (Some((frames, seconds)), _) => whole(frames).zip(whole(seconds)),
            (None, Some((units, rest))) if rest.len() <= Self::MOST_DIGITS => {
                let scale = 10_u32.pow(rest.len() as u32);
                whole(units)
                    .and_then(|units| units.checked_mul(scale))
                    .zip(whole(rest))
                    .and_then(|(units, rest)| Some((units.checked_add(rest)?, scale)))
            }
            (None, Some(_)) => None,
            (None, None) => whole(s).map(|frames| (frames, 1)),
        };
        parts
            .filter(|&(frames, seconds)| {
                frames > 0 && seconds > 0 && u64::from(frames) <= u64::from(Self::MOST) * u64::from(seconds)
            })
            .map(|(frames, seconds)| {
                let common = greatest_common_divisor(frames, seconds);
                Self {
                    frames: frames / common,
                    seconds: seconds / common,
                }
            })
            .ok_or_else(|| {
                format!("'{s}': expected frames per second above 0 and up to 1000, such as 30, 29.97 or 30000/1001")
            })
    }
}

fn greatest_common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 {
        a
    } else {
        greatest_common_divisor(b, a % b)
    }
}

/// For tests.
#[cfg(test)]
pub(super) const TEN: FrameRate = FrameRate {
    frames: 10,
    seconds: 1,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_exact() {
        let rate = |s: &str| s.parse::<FrameRate>();
        for (typed, told) in [
            ("30", "30"),
            ("29.97", "2997/100"),
            ("30000/1001", "30000/1001"),
            ("0.5", "1/2"),
            ("25.0", "25"),
        ] {
            assert_eq!(rate(typed).map(|r| r.to_string()), Ok(told.into()));
        }
        for bad in [
            "0",
            "-5",
            "1001",
            "1/0",
            "0/1",
            "1e3",
            "/5",
            "",
            ".",
            "5.",
            "nan",
            "1.23456",
            "99999999999",
        ] {
            assert!(rate(bad).is_err(), "{bad:?} is no rate");
        }
        let film = rate("30000/1001").unwrap();
        assert_eq!(film.seconds_of(30_000), 1001.0);
        assert_eq!(film.frames_in(10.0), 300);
        assert_eq!(film.frames_in(0.0), 1, "a film has a frame");
    }
}
