//! Which frame is due when. Pure: the time is handed in.
//!
//! Frame k of a flight is on at k / rate and is drawn in its slot, from then to (k + 1) / rate. Who is done later is late, and
//! goes on with the slot that is running then: the frames of those between are dropped, as in a viewer.

use crate::export::video::FrameRate;

/// How far ahead cameras are told, seconds.
const HORIZON_SECONDS: f64 = 2.0;
/// How many of them at most.
const MOST_CAMERAS: u64 = 24;

/// The slots of a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    pub(super) rate: FrameRate,
    pub(super) frames: u64,
}

impl Schedule {
    /// The frame to be drawn next, `now` seconds after the flight began, when `last` was drawn last; `None` at the end.
    pub(super) fn next(self, last: u64, now: f64) -> Option<u64> {
        // The rounding of a slot's beginning must not put it before itself.
        let running = (now * self.rate.per_second() + 1e-6).floor() as u64;
        Some(running.max(last + 1)).filter(|&n| n < self.frames)
    }

    /// When the slot of a frame begins, seconds.
    pub(super) fn begin(self, number: u64) -> f64 {
        self.rate.seconds_of(number)
    }

    /// When it ends.
    pub(super) fn end(self, number: u64) -> f64 {
        self.rate.seconds_of(number + 1)
    }

    /// The frames behind `number` whose cameras are told to whoever loads ahead, the next one first. Most of them are also
    /// among those behind the next frame.
    pub(super) fn ahead(self, number: u64) -> impl Iterator<Item = u64> {
        let reach = (HORIZON_SECONDS * self.rate.per_second()).ceil().max(1.0) as u64;
        let stride = reach.div_ceil(MOST_CAMERAS);
        let first = (number + 1).next_multiple_of(stride);
        let last = (number + reach).min(self.frames.saturating_sub(1));
        (first..=last).step_by(stride as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(rate: &str, frames: u64) -> Schedule {
        Schedule {
            rate: rate.parse().unwrap(),
            frames,
        }
    }

    #[test]
    fn frames_come_in_their_slots_and_late_ones_are_dropped() {
        let s = schedule("10", 5);
        assert_eq!(s.next(0, 0.05), Some(1), "in time: the next one");
        assert_eq!(s.next(0, 0.15), Some(1), "late, and its slot still runs");
        assert_eq!(s.next(0, 0.31), Some(3), "two are dropped");
        assert_eq!(s.next(3, 0.39), Some(4));
        assert_eq!(s.next(4, 0.45), None, "the end");
        assert_eq!(s.next(0, 9.0), None, "too late for any");
        let s = schedule("30", 1000);
        for number in 0..999 {
            let begin = s.begin(number + 1);
            assert_eq!(s.next(number, begin), Some(number + 1), "at its beginning");
        }
        assert_eq!(s.end(2), s.begin(3));
    }

    #[test]
    fn cameras_ahead_are_few_and_stay_the_same() {
        let s = schedule("30", 1000);
        let ahead: Vec<u64> = s.ahead(10).collect();
        assert_eq!(ahead[..3], [12, 15, 18]);
        assert_eq!(ahead.last(), Some(&69), "two seconds ahead");
        let next: Vec<u64> = s.ahead(11).collect();
        assert_eq!(next, ahead, "nothing new to look at");
        let slow: Vec<u64> = schedule("4", 12).ahead(6).collect();
        assert_eq!(slow, [7, 8, 9, 10, 11], "no farther than the flight");
        assert_eq!(schedule("0.2", 12).ahead(6).collect::<Vec<_>>(), [7]);
        assert_eq!(schedule("4", 12).ahead(11).count(), 0);
    }
}
