//! Policies of eviction that were tried and not taken, for the table in `src/pager/policy.rs`.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use brickscope::geom::BrickId;
use brickscope::pager::replay::Replacement;

use crate::orbit::mix;

/// Bricks by the pass that used them last; which one goes is up to `choose`.
pub struct ByLastUse {
    pass: u64,
    last: BTreeMap<BrickId, u64>,
    choose: fn(BrickId, u64, u64) -> u64,
}

impl ByLastUse {
    fn new(choose: fn(BrickId, u64, u64) -> u64) -> Self {
        Self {
            pass: 0,
            last: BTreeMap::new(),
            choose,
        }
    }

    /// The most recently used goes.
    pub fn mru() -> Self {
        Self::new(|_, last, _| u64::MAX - last)
    }

    /// Any one goes, the same in every run.
    pub fn random() -> Self {
        Self::new(|brick, _, pass| {
            let xyz = brick.xyz.to_array().map(u64::from);
            mix(xyz[0] + (xyz[1] << 16) + (xyz[2] << 32) + (pass << 48) + u64::from(brick.lod.0))
        })
    }
}

impl Replacement for ByLastUse {
    fn next_pass(&mut self) {
        self.pass += 1;
    }

    fn touch(&mut self, brick: BrickId) {
        self.last.insert(brick, self.pass);
    }

    fn insert(&mut self, brick: BrickId) {
        self.last.insert(brick, self.pass);
    }

    fn evict(&mut self) -> Option<BrickId> {
        let (&brick, _) = self
            .last
            .iter()
            .filter(|(_, last)| **last < self.pass)
            .min_by_key(|(brick, last)| ((self.choose)(**brick, **last, self.pass), **brick))?;
        self.last.remove(&brick);
        Some(brick)
    }
}

/// Full 2Q (Johnson and Shasha, 1994): a quarter of the slots for newcomers, memory of half as many as there are slots.
pub struct TwoQueues {
    slots: usize,
    pass: u64,
    newcomers: BTreeSet<(u64, BrickId)>,
    main: BTreeSet<(u64, BrickId)>,
    place: HashMap<BrickId, (bool, u64)>,
    remembered: VecDeque<BrickId>,
    used: BTreeSet<BrickId>,
}

impl TwoQueues {
    pub fn new(slots: usize) -> Self {
        Self {
            slots,
            pass: 0,
            newcomers: BTreeSet::new(),
            main: BTreeSet::new(),
            place: HashMap::new(),
            remembered: VecDeque::new(),
            used: BTreeSet::new(),
        }
    }
}

impl Replacement for TwoQueues {
    fn next_pass(&mut self) {
        self.pass += 1;
        self.used.clear();
    }

    fn touch(&mut self, brick: BrickId) {
        self.used.insert(brick);
        if let Some((true, last)) = self.place.get(&brick).copied() {
            self.main.remove(&(last, brick));
            self.main.insert((self.pass, brick));
            self.place.insert(brick, (true, self.pass));
        }
    }

    fn insert(&mut self, brick: BrickId) {
        self.used.insert(brick);
        let known = self.remembered.iter().position(|b| *b == brick);
        if let Some(i) = known {
            self.remembered.remove(i);
            self.main.insert((self.pass, brick));
        } else {
            self.newcomers.insert((self.pass, brick));
        }
        self.place.insert(brick, (known.is_some(), self.pass));
    }

    fn evict(&mut self) -> Option<BrickId> {
        let oldest = |queue: &BTreeSet<(u64, BrickId)>| {
            queue.iter().find(|(_, b)| !self.used.contains(b)).copied()
        };
        let (newcomer, main) = (oldest(&self.newcomers), oldest(&self.main));
        let (_, brick) = if self.newcomers.len() > self.slots / 4 {
            newcomer.or(main)?
        } else {
            main.or(newcomer)?
        };
        let (is_main, last) = self.place.remove(&brick)?;
        if is_main {
            self.main.remove(&(last, brick));
        } else {
            self.newcomers.remove(&(last, brick));
            self.remembered.push_back(brick);
            if self.remembered.len() > self.slots / 2 {
                self.remembered.pop_front();
            }
        }
        Some(brick)
    }
}

/// LRFU (Lee et al., 2001): uses count, halved every four passes; the least count goes.
pub struct AgedFrequency {
    pass: u64,
    /// Pass and count of the last use.
    counts: BTreeMap<BrickId, (u64, f64)>,
    evicted: HashMap<BrickId, (u64, f64)>,
}

impl AgedFrequency {
    pub fn new() -> Self {
        Self {
            pass: 0,
            counts: BTreeMap::new(),
            evicted: HashMap::new(),
        }
    }

    fn aged(&self, (last, count): (u64, f64)) -> f64 {
        count * (-((self.pass - last) as f64) / 4.0).exp2()
    }

    fn used(&mut self, brick: BrickId) {
        let old = self.counts.get(&brick).copied();
        let old = old
            .or_else(|| self.evicted.remove(&brick))
            .unwrap_or((self.pass, 0.0));
        self.counts.insert(brick, (self.pass, self.aged(old) + 1.0));
    }
}

impl Replacement for AgedFrequency {
    fn next_pass(&mut self) {
        self.pass += 1;
    }

    fn touch(&mut self, brick: BrickId) {
        self.used(brick);
    }

    fn insert(&mut self, brick: BrickId) {
        self.used(brick);
    }

    fn evict(&mut self) -> Option<BrickId> {
        let (&brick, &count) = self
            .counts
            .iter()
            .filter(|(_, (last, _))| *last < self.pass)
            .min_by(|a, b| self.aged(*a.1).total_cmp(&self.aged(*b.1)))?;
        self.counts.remove(&brick);
        self.evicted.insert(brick, count);
        Some(brick)
    }
}
