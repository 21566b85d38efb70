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
//! | hit rate, orbit of 36 views | this | LRU | MRU | random | 2Q | LRFU | Bélády |
//! |---|---|---|---|---|---|---|---|
//! | FIGURES
//!
//! Made by `cargo test --release --test pager -- --ignored --nocapture policies`.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

use glam::UVec3;
use lru::LruCache;

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
    /// Used in the last pass.
    Latest,
    /// Asked for by this frame.
    Asked,
}

impl Tier {
    const ALL: [Self; 4] = [Self::Stale, Self::Previous, Self::Latest, Self::Asked];
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

/// Order within a tier: stale bricks by the guessed next use, then the last one used first; others by last use.
type Key = (u64, Reverse<u64>);

/// A brick with a slot. Protected ones are in no tier.
#[derive(Clone, Copy, Debug)]
struct Member {
    uses: Uses,
    place: Option<(Tier, Key)>,
}

/// The bricks with a slot, in the order in which they would leave.
#[derive(Debug)]
pub(super) struct EvictionOrder {
    pass: u64,
    uses: u64,
    /// Mean pause of all bricks, times [`PAUSE_INERTIA`].
    mean_pause: u64,
    members: HashMap<BrickId, Member>,
    tiers: [BTreeSet<(Key, BrickId)>; 4],
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
            members: HashMap::new(),
            tiers: std::array::from_fn(|_| BTreeSet::new()),
            protected: Vec::new(),
            evicted: LruCache::new(
                (slots * REMEMBERED_PER_SLOT)
                    .try_into()
                    .unwrap_or(std::num::NonZeroUsize::MIN),
            ),
        }
    }

    /// A pass is over: nothing is protected or asked for any more, and everything is a pass older.
    pub(super) fn next_pass(&mut self) {
        self.pass += 1;
        let mut aged = std::mem::take(&mut self.protected);
        for tier in [Tier::Previous, Tier::Latest, Tier::Asked] {
            aged.extend(self.tiers[tier as usize].iter().map(|&(_, brick)| brick));
        }
        for brick in aged {
            let Some(member) = self.members.get(&brick) else {
                continue;
            };
            let tier = match self.pass - member.uses.last {
                0 => Tier::Latest,
                1 => Tier::Previous,
                _ => Tier::Stale,
            };
            self.put(brick, Some(tier));
        }
    }

    /// The last pass used the brick, if it has a slot.
    pub(super) fn touch(&mut self, brick: BrickId) {
        let Some(&Member { uses, place }) = self.members.get(&brick) else {
            return;
        };
        let uses = self.used(uses);
        self.members.insert(brick, Member { uses, place });
        if matches!(
            place,
            Some((Tier::Stale | Tier::Previous | Tier::Latest, _))
        ) {
            self.put(brick, Some(Tier::Latest));
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
        self.members.insert(brick, Member { uses, place: None });
        self.protected.push(brick);
    }

    /// The brick does not leave in this pass.
    pub(super) fn protect(&mut self, brick: BrickId) {
        if self.members.get(&brick).is_some_and(|m| m.place.is_some()) {
            self.put(brick, None);
            self.protected.push(brick);
        }
    }

    /// The brick leaves in this pass only for what is needed more than a request, unless it is protected.
    pub(super) fn ask(&mut self, brick: BrickId) {
        if self.members.get(&brick).is_some_and(|m| m.place.is_some()) {
            self.put(brick, Some(Tier::Asked));
        }
    }

    /// Number of bricks that may leave, up to and with tier `most`.
    pub(super) fn evictable(&self, most: Tier) -> usize {
        self.tiers[..=most as usize].iter().map(BTreeSet::len).sum()
    }

    /// Takes out the brick to leave, of tier `most` at most.
    pub(super) fn evict(&mut self, most: Tier) -> Option<(BrickId, Tier)> {
        for tier in Tier::ALL.into_iter().filter(|t| *t <= most) {
            let set = &mut self.tiers[tier as usize];
            let head = match (tier, set.last()) {
                // What should have come back goes before what is yet to come.
                (Tier::Stale, Some(&((farthest, _), _)))
                    if set
                        .first()
                        .is_some_and(|((next, _), _)| next + 1 >= self.pass) =>
                {
                    let first = BrickId::new(Lod(0), UVec3::ZERO);
                    set.range(((farthest, Reverse(u64::MAX)), first)..)
                        .next()
                        .copied()
                }
                _ => set.first().copied(),
            };
            if let Some(head) = head {
                set.remove(&head);
                let (_, brick) = head;
                if let Some(member) = self.members.remove(&brick) {
                    self.evicted.push(brick, member.uses);
                }
                return Some((brick, tier));
            }
        }
        None
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

    /// Moves a brick to a tier, or out of them all.
    fn put(&mut self, brick: BrickId, tier: Option<Tier>) {
        let Some(member) = self.members.get_mut(&brick) else {
            return;
        };
        if let Some((old, key)) = member.place {
            self.tiers[old as usize].remove(&(key, brick));
        }
        member.place = tier.map(|tier| {
            let uses = member.uses;
            let key = match tier {
                Tier::Stale => {
                    let pause = uses.pause.unwrap_or(self.mean_pause / PAUSE_INERTIA);
                    (uses.last + pause, Reverse(uses.stamp))
                }
                Tier::Previous | Tier::Latest | Tier::Asked => (uses.stamp, Reverse(0)),
            };
            self.tiers[tier as usize].insert((key, brick));
            (tier, key)
        });
    }
}
