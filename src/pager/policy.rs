//! Which brick leaves its slot when another needs it.
//!
//! Bricks that have not been used for two passes go first, and among them the one whose next use is farthest, as Bélády's
//! rule has it. The next use is guessed: the last use, plus the time between the two uses before (a pause of one or two
//! passes is no pause: rays reach a brick in several passes of a view). A brick whose guess has passed is taken for
//! gone; the oldest of those goes before all others. So bricks that a turning camera left behind go as under LRU, and
//! of those in a cycle longer than the atlas a part stays, where LRU would lose each just before it is needed. Bricks
//! used in the last pass or in the one before go last, as under LRU: other rays are still on their way to them.
//!
//! Every choice is a look-up in an ordered set: no scans, no randomness, no clock. Bricks of one pass are used in the
//! order in which they are named; who names them in order of their ids has exact replays.
//!
//! Hit rates of an orbit of 36 views, of bricks that let more or less light through. A pass takes all rays of a view
//! one brick (1) or two (2) further; the slots hold 1.25 of the largest view, or a quarter of all views together.
//!
//! | bricks, slots | this | LRU | MRU | random | 2Q | LRFU | Bélády |
//! |---|---|---|---|---|---|---|---|
//! | glassy 1, 1.25 views: 1383 | 0.975 | 0.975 | 0.875 | 0.955 | 0.965 | 0.975 | 0.978 |
//! | glassy 1, ¼ of all: 493 | 0.680 | 0.664 | 0.656 | 0.658 | 0.688 | 0.637 | 0.788 |
//! | hazy 1, 1.25 views: 1223 | 0.964 | 0.964 | 0.861 | 0.933 | 0.945 | 0.963 | 0.972 |
//! | hazy 1, ¼ of all: 405 | 0.518 | 0.506 | 0.521 | 0.506 | 0.531 | 0.525 | 0.689 |
//! | dense 1, 1.25 views: 630 | 0.928 | 0.928 | 0.702 | 0.882 | 0.891 | 0.927 | 0.937 |
//! | dense 1, ¼ of all: 358 | 0.650 | 0.595 | 0.601 | 0.643 | 0.636 | 0.688 | 0.825 |
//! | opaque 1, 1.25 views: 335 | 0.894 | 0.895 | 0.705 | 0.849 | 0.844 | 0.894 | 0.906 |
//! | opaque 1, ¼ of all: 227 | 0.794 | 0.788 | 0.640 | 0.747 | 0.775 | 0.784 | 0.883 |
//! | glassy 2, 1.25 views: 1383 | 0.964 | 0.964 | 0.836 | 0.941 | 0.952 | 0.964 | 0.969 |
//! | glassy 2, ¼ of all: 493 | 0.544 | 0.523 | 0.543 | 0.524 | 0.539 | 0.521 | 0.696 |
//! | hazy 2, 1.25 views: 1223 | 0.952 | 0.952 | 0.825 | 0.919 | 0.929 | 0.951 | 0.962 |
//! | hazy 2, ¼ of all: 405 | 0.385 | 0.380 | 0.366 | 0.361 | 0.392 | 0.355 | 0.598 |
//! | dense 2, 1.25 views: 630 | 0.909 | 0.910 | 0.791 | 0.873 | 0.865 | 0.907 | 0.921 |
//! | dense 2, ¼ of all: 358 | 0.624 | 0.626 | 0.631 | 0.624 | 0.622 | 0.625 | 0.781 |
//! | opaque 2, 1.25 views: 335 | 0.859 | 0.862 | 0.838 | 0.847 | 0.845 | 0.859 | 0.877 |
//! | opaque 2, ¼ of all: 227 | 0.778 | 0.779 | 0.777 | 0.775 | 0.774 | 0.778 | 0.845 |
//!
//! Made by `cargo test --test pager -- --ignored --nocapture policies`. Nowhere more than 0.003 behind LRU; every rival
//! that wins a row is far behind in another.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

use glam::UVec3;
use lru::LruCache;

use super::{Priority, Request};
use crate::geom::{BrickId, Lod};

/// A pause of at most so many passes does not count as one.
const BURST_PASSES: u64 = 2;
/// The guessed pause of bricks before any has been seen.
const FIRST_PAUSE_PASSES: u64 = 8;
/// The mean pause follows a new one by one part in so many.
const PAUSE_INERTIA: u64 = 256;
/// Evicted bricks whose pauses are remembered, per slot.
const REMEMBERED_PER_SLOT: usize = 4;

/// How readily a brick leaves: lower goes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Tier {
    /// Not used in the last two passes.
    Stale,
    /// Used in the pass before the last.
    Previous,
    /// Predicted by this frame, and not used in the last pass.
    Predicted,
    /// Used in the last pass.
    Latest,
    /// Asked for by this frame.
    Asked,
}

/// When a brick was used.
#[derive(Clone, Copy, Debug)]
struct Uses {
    /// The pass of the last use.
    last: u64,
    /// The place of the last use among all.
    stamp: u64,
    /// Passes between the two uses before the last pause; unknown for a brick seen once.
    pause: Option<u64>,
}

/// Order of stale bricks: by the guessed next use, then the last one used first.
type Key = (u64, Reverse<u64>);

/// Where a brick with a slot is that was not used lately, or is not to leave.
#[derive(Clone, Copy, Debug)]
enum Place {
    Stale(Key),
    Predicted(Priority),
    Asked,
    Protected,
}

/// The bricks with a slot, in the order in which they would leave.
#[derive(Debug)]
pub(super) struct EvictionOrder {
    pass: u64,
    /// Uses so far: what stamps are made of.
    uses: u64,
    /// Mean pause of all bricks, times [`PAUSE_INERTIA`].
    mean_pause: u64,
    /// Used in the pass before the last or later, in that order: using one again, the common case, is one look-up.
    recent: LruCache<BrickId, Uses>,
    /// Of `recent`: used in the last pass.
    latest: usize,
    /// All other bricks with a slot.
    others: HashMap<BrickId, (Uses, Place)>,
    stale: BTreeSet<(Key, BrickId)>,
    /// Predicted by this frame: the last of them leaves first.
    predicted: BTreeSet<Request>,
    /// Asked for by this frame, by last use.
    asked: BTreeSet<(u64, BrickId)>,
    protected: Vec<BrickId>,
    evicted: LruCache<BrickId, Uses>,
}

impl EvictionOrder {
    /// Of an empty atlas of `slots` slots.
    pub(super) fn new(slots: usize) -> Self {
        Self {
            pass: 0,
            uses: 0,
            mean_pause: FIRST_PAUSE_PASSES * PAUSE_INERTIA,
            recent: LruCache::unbounded(),
            latest: 0,
            others: HashMap::new(),
            stale: BTreeSet::new(),
            predicted: BTreeSet::new(),
            asked: BTreeSet::new(),
            protected: Vec::new(),
            evicted: LruCache::new(
                (slots * REMEMBERED_PER_SLOT)
                    .try_into()
                    .unwrap_or(std::num::NonZeroUsize::MIN),
            ),
        }
    }

    /// A pass is over: everything is a pass older, and nothing is protected, asked for or predicted any more. What was,
    /// counts as used by the pass that is over.
    pub(super) fn next_pass(&mut self) {
        let asked = std::mem::take(&mut self.asked).into_iter().map(|(_, b)| b);
        let predicted = std::mem::take(&mut self.predicted)
            .into_iter()
            .map(|request| request.brick);
        let needed: Vec<BrickId> = asked
            .chain(predicted)
            .chain(self.protected.drain(..))
            .collect();
        for brick in needed {
            if let Some((uses, _)) = self.others.remove(&brick) {
                let uses = if uses.last == self.pass {
                    uses
                } else {
                    self.used(uses)
                };
                self.recent.push(brick, uses);
            }
        }
        self.pass += 1;
        self.latest = 0;
        while let Some((&brick, &uses)) = self.recent.peek_lru()
            && uses.last + 1 < self.pass
        {
            self.recent.pop_lru();
            self.make_stale(brick, uses);
        }
    }

    fn make_stale(&mut self, brick: BrickId, uses: Uses) {
        let pause = uses.pause.unwrap_or(self.mean_pause / PAUSE_INERTIA);
        let key = (uses.last + pause, Reverse(uses.stamp));
        self.stale.insert((key, brick));
        self.others.insert(brick, (uses, Place::Stale(key)));
    }

    /// Nothing is predicted any more. What was has not been used for that.
    pub(super) fn unpredict(&mut self) {
        for request in std::mem::take(&mut self.predicted) {
            if let Some((uses, _)) = self.others.remove(&request.brick) {
                self.make_stale(request.brick, uses);
            }
        }
    }

    /// The last pass used the brick, if it has a slot. What is protected or asked for counts as used in any case.
    pub(super) fn touch(&mut self, brick: BrickId) {
        if let Some(&uses) = self.recent.get(&brick) {
            if uses.last < self.pass {
                self.latest += 1;
            }
            let uses = self.used(uses);
            self.recent.put(brick, uses);
        } else if let Some(&(uses, Place::Stale(key))) = self.others.get(&brick) {
            let uses = self.used(uses);
            self.stale.remove(&(key, brick));
            self.others.remove(&brick);
            self.recent.push(brick, uses);
            self.latest += 1;
        }
    }

    /// The brick got a slot; it is protected until the next pass.
    pub(super) fn insert(&mut self, brick: BrickId) {
        let before = self.evicted.pop(&brick).unwrap_or(Uses {
            last: self.pass,
            stamp: 0,
            pause: None,
        });
        let uses = self.used(before);
        self.others.insert(brick, (uses, Place::Protected));
        self.protected.push(brick);
    }

    /// The brick does not leave in this pass.
    pub(super) fn protect(&mut self, brick: BrickId) {
        if let Some(uses) = self.take_out(brick) {
            self.others.insert(brick, (uses, Place::Protected));
            self.protected.push(brick);
        }
    }

    /// The brick leaves in this pass only for what is needed more than a request, unless it is protected.
    pub(super) fn ask(&mut self, brick: BrickId) {
        if let Some(uses) = self.take_out(brick) {
            self.others.insert(brick, (uses, Place::Asked));
            self.asked.insert((uses.stamp, brick));
        }
    }

    /// The brick leaves in this pass for what is needed, not for what is predicted, too; those predicted for later go first.
    /// Of no effect on one that the last pass used.
    pub(super) fn predict(&mut self, request: Request) {
        let brick = request.brick;
        let is_latest = |uses: &Uses| uses.last == self.pass;
        if self.recent.peek(&brick).is_some_and(is_latest) {
            return;
        }
        if let Some(uses) = self.take_out(brick) {
            let place = Place::Predicted(request.priority);
            self.others.insert(brick, (uses, place));
            self.predicted.insert(request);
        }
    }

    /// Number of bricks that may leave, up to and with tier `most`.
    pub(super) fn evictable(&self, most: Tier) -> usize {
        let previous = self.recent.len() - self.latest;
        let counts = [
            self.stale.len(),
            previous,
            self.predicted.len(),
            self.latest,
            self.asked.len(),
        ];
        counts[..=most as usize].iter().sum()
    }

    /// Takes out the brick to leave, of tier `most` at most.
    pub(super) fn evict(&mut self, most: Tier) -> Option<BrickId> {
        let (brick, tier) = self.head()?;
        if tier > most {
            return None;
        }
        let uses = self.take_out(brick)?;
        self.evicted.push(brick, uses);
        Some(brick)
    }

    /// The brick that would leave first.
    fn head(&self) -> Option<(BrickId, Tier)> {
        if let (Some(((next, _), overdue)), Some(((farthest, _), _))) =
            (self.stale.first(), self.stale.last())
        {
            // What should have come back goes before what is yet to come.
            let from = (
                (*farthest, Reverse(u64::MAX)),
                BrickId::new(Lod(0), UVec3::ZERO),
            );
            let brick = if next + 1 < self.pass {
                *overdue
            } else {
                self.stale.range(from..).next()?.1
            };
            return Some((brick, Tier::Stale));
        }
        let recent = self.recent.peek_lru();
        if let Some((&brick, uses)) = recent
            && uses.last < self.pass
        {
            return Some((brick, Tier::Previous));
        }
        if let Some(request) = self.predicted.last() {
            return Some((request.brick, Tier::Predicted));
        }
        if let Some((&brick, _)) = recent {
            return Some((brick, Tier::Latest));
        }
        let &(_, brick) = self.asked.first()?;
        Some((brick, Tier::Asked))
    }

    /// Takes a brick out of the order, unless it is protected.
    fn take_out(&mut self, brick: BrickId) -> Option<Uses> {
        if let Some(uses) = self.recent.pop(&brick) {
            if uses.last == self.pass {
                self.latest -= 1;
            }
            return Some(uses);
        }
        let &(uses, place) = self.others.get(&brick)?;
        match place {
            Place::Protected => return None,
            Place::Asked => self.asked.remove(&(uses.stamp, brick)),
            Place::Predicted(priority) => self.predicted.remove(&Request { priority, brick }),
            Place::Stale(key) => self.stale.remove(&(key, brick)),
        };
        self.others.remove(&brick);
        Some(uses)
    }

    /// `uses` with one more, now.
    fn used(&mut self, uses: Uses) -> Uses {
        let pause = self.pass - uses.last;
        let pause = if pause > BURST_PASSES {
            self.mean_pause = self.mean_pause - self.mean_pause / PAUSE_INERTIA + pause;
            Some(pause)
        } else {
            uses.pause
        };
        self.uses += 1;
        Uses {
            last: self.pass,
            stamp: self.uses,
            pause,
        }
    }
}
