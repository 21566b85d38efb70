//! How long bricks take from the first request to their slot. For measurements: nothing depends on it.

use std::collections::{HashMap, HashSet};
use std::time::Instant;

use crate::clock::ms;
use crate::geom::BrickId;

/// Requests under way, and what earlier ones took.
#[derive(Debug, Default)]
pub(super) struct Waits {
    since: HashMap<BrickId, Instant>,
    done_ms: Vec<f64>,
}

impl Waits {
    /// These bricks are wanted now, and no others; those that have a slot are left out.
    pub(super) fn wanted(&mut self, bricks: impl Iterator<Item = BrickId>) {
        let now = Instant::now();
        let wanted: HashSet<BrickId> = bricks.collect();
        self.since.retain(|brick, _| wanted.contains(brick));
        for brick in wanted {
            self.since.entry(brick).or_insert(now);
        }
    }

    /// The brick's copy into its slot was recorded.
    pub(super) fn resident(&mut self, brick: BrickId) {
        if let Some(since) = self.since.remove(&brick) {
            self.done_ms.push(ms(since.elapsed()));
        }
    }

    /// Milliseconds of every wait that ended since the last call.
    pub(super) fn take(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.done_ms)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::UVec3;

    use super::*;
    use crate::geom::Lod;

    #[test]
    fn a_wait_is_from_the_first_request_to_the_slot() {
        let [a, b] = [0, 1].map(|x| BrickId::new(Lod(0), UVec3::new(x, 0, 0)));
        let mut waits = Waits::default();
        waits.wanted([a, b].into_iter());
        std::thread::sleep(Duration::from_millis(20));
        // Asked for again, and b no longer.
        waits.wanted([a].into_iter());
        waits.resident(a);
        waits.resident(b);
        let took = waits.take();
        assert!(took.len() == 1 && took[0] >= 20.0, "{took:?}");
        assert!(waits.take().is_empty(), "told once");
    }
}
