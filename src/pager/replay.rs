//! What a policy of eviction would have made of a trace: hits by replay, with no loads, no budgets, no pager.
//!
//! A trace is a list of passes, and a pass is the set of bricks that it used, in any order. First those that are
//! resident are used, then the others are brought in one by one. What a pass uses is not evicted by it; where its set
//! exceeds the slots, it goes on as another pass.

use std::collections::{BTreeSet, HashMap, VecDeque};

use lru::LruCache;

use super::policy::{EvictionOrder, Tier};
use crate::geom::BrickId;

/// The outcome of a replay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replay {
    /// Bricks used, summed over the passes.
    pub accesses: u64,
    /// Those that were resident when they were used.
    pub hits: u64,
}

impl Replay {
    /// Hits per access; 1 when there was none.
    pub fn hit_rate(&self) -> f64 {
        if self.accesses == 0 {
            1.0
        } else {
            self.hits as f64 / self.accesses as f64
        }
    }
}

/// A policy of eviction.
pub trait Replacement {
    /// A pass begins: everything may leave again.
    fn next_pass(&mut self);
    /// A resident brick is used.
    fn touch(&mut self, brick: BrickId);
    /// A brick becomes resident, and is used.
    fn insert(&mut self, brick: BrickId);
    /// Takes out one resident brick that this pass has not used; `None` when there is none.
    fn evict(&mut self) -> Option<BrickId>;
}

/// Replays `trace` on `slots` slots under `policy`.
pub fn replay(trace: &[Vec<BrickId>], slots: usize, policy: &mut impl Replacement) -> Replay {
    let mut outcome = Replay::default();
    if slots == 0 {
        outcome.accesses = trace.iter().map(|pass| pass.len() as u64).sum();
        return outcome;
    }
    let mut resident: BTreeSet<BrickId> = BTreeSet::new();
    for pass in trace {
        outcome.accesses += pass.len() as u64;
        let mut left = pass.clone();
        while !left.is_empty() {
            policy.next_pass();
            left.retain(|brick| {
                let hit = resident.contains(brick);
                if hit {
                    outcome.hits += 1;
                    policy.touch(*brick);
                }
                !hit
            });
            let mut misses = std::mem::take(&mut left).into_iter();
            for brick in misses.by_ref() {
                if resident.len() >= slots {
                    let Some(old) = policy.evict() else {
                        left.push(brick);
                        break;
                    };
                    resident.remove(&old);
                }
                resident.insert(brick);
                policy.insert(brick);
            }
            left.extend(misses);
        }
    }
    outcome
}

/// Replays `trace` under the pager's own policy.
pub fn replay_policy(trace: &[Vec<BrickId>], slots: usize) -> Replay {
    replay(trace, slots, &mut EvictionOrder::new(slots))
}

/// Replays `trace` under plain LRU.
pub fn replay_lru(trace: &[Vec<BrickId>], slots: usize) -> Replay {
    let mut lru = Lru {
        pass: 0,
        bricks: LruCache::unbounded(),
    };
    replay(trace, slots, &mut lru)
}

/// Replays `trace` with foresight: the brick goes whose next use is farthest. An upper bound for every policy: it may
/// also evict what the same pass has used.
pub fn replay_belady(trace: &[Vec<BrickId>], slots: usize) -> Replay {
    let mut uses: HashMap<BrickId, VecDeque<u64>> = HashMap::new();
    for (time, &brick) in (0..).zip(trace.iter().flatten()) {
        uses.entry(brick).or_default().push_back(time);
    }
    let mut outcome = Replay::default();
    let mut by_next: BTreeSet<(u64, BrickId)> = BTreeSet::new();
    for (time, &brick) in (0..).zip(trace.iter().flatten()) {
        outcome.accesses += 1;
        let coming = uses.entry(brick).or_default();
        coming.pop_front();
        let next = coming.front().copied().unwrap_or(u64::MAX);
        if by_next.remove(&(time, brick)) {
            outcome.hits += 1;
        } else if by_next.len() >= slots {
            by_next.pop_last();
        }
        if slots > 0 {
            by_next.insert((next, brick));
        }
    }
    outcome
}

impl Replacement for EvictionOrder {
    fn next_pass(&mut self) {
        Self::next_pass(self);
    }

    fn touch(&mut self, brick: BrickId) {
        Self::touch(self, brick);
        self.protect(brick);
    }

    fn insert(&mut self, brick: BrickId) {
        Self::insert(self, brick);
    }

    fn evict(&mut self) -> Option<BrickId> {
        Self::evict(self, Tier::Asked)
    }
}

/// Plain LRU: the yardstick.
struct Lru {
    pass: u64,
    bricks: LruCache<BrickId, u64>,
}

impl Replacement for Lru {
    fn next_pass(&mut self) {
        self.pass += 1;
    }

    fn touch(&mut self, brick: BrickId) {
        self.bricks.push(brick, self.pass);
    }

    fn insert(&mut self, brick: BrickId) {
        self.bricks.push(brick, self.pass);
    }

    fn evict(&mut self) -> Option<BrickId> {
        let (_, &used) = self.bricks.peek_lru()?;
        if used == self.pass {
            return None;
        }
        self.bricks.pop_lru().map(|(brick, _)| brick)
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec3;

    use super::*;
    use crate::geom::Lod;

    fn trace(passes: &[&[u32]]) -> Vec<Vec<BrickId>> {
        let brick = |&x: &u32| BrickId::new(Lod(0), UVec3::new(x, 0, 0));
        passes
            .iter()
            .map(|p| p.iter().map(brick).collect())
            .collect()
    }

    fn counts(replay: Replay) -> (u64, u64) {
        (replay.hits, replay.accesses)
    }

    #[test]
    fn hits_are_those_of_pencil_and_paper() {
        let cycle = trace(&[&[1], &[2], &[3], &[1], &[2], &[3], &[1], &[2], &[3]]);
        assert_eq!(counts(replay_lru(&cycle, 2)), (0, 9), "LRU loses a cycle");
        // 1 2 | 3 for 2 | 1 hit | 2 for 1 | 3 hit | 1 for 3 | 2 hit | 3.
        assert_eq!(counts(replay_belady(&cycle, 2)), (3, 9), "foresight");
        for replayed in [replay_lru, replay_policy, replay_belady] {
            assert_eq!(counts(replayed(&cycle, 3)), (6, 9), "all fits");
            assert_eq!(counts(replayed(&cycle, 0)), (0, 9), "no slots, no hits");
            assert_eq!(counts(replayed(&[], 3)), (0, 0), "nothing to do");
        }
        let wide = trace(&[&[1, 2, 3, 4, 5], &[5, 4, 3, 2, 1]]);
        assert_eq!(
            counts(replay_lru(&wide, 2)),
            (2, 10),
            "a pass wider than the atlas ends with its last two resident, and begins with them"
        );
        assert!(
            (replay_lru(&[], 1).hit_rate() - 1.0).abs() < f64::EPSILON,
            "nothing missed"
        );
    }
}
