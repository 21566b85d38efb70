//! The pager's core: a pure function of state, requests, completions and budget.

use std::collections::{BTreeSet, HashMap, HashSet};

use crate::geom::BrickId;

use super::{
    BrickState, Event, PageTablePatch, Plan, Request, SlotId, SlotPool, Upload, transition,
};

/// The end of a load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Completion {
    /// The voxels are in host memory.
    Decoded(BrickId),
    /// The brick can't be read.
    Failed(BrickId),
}

/// States of all bricks that are not Absent, the slots, and the queue.
#[derive(Debug)]
pub struct Pager {
    states: HashMap<BrickId, BrickState>,
    slots: SlotPool,
    queue: BTreeSet<Request>,
    /// What the current picture needs: never evicted.
    needed: HashSet<BrickId>,
    /// Decoded and waiting for a slot, in order of arrival.
    in_ram: Vec<BrickId>,
    decoding: usize,
}

impl Pager {
    /// A pager over these slots.
    pub fn new(slots: SlotPool) -> Self {
        Self {
            states: HashMap::new(),
            slots,
            queue: BTreeSet::new(),
            needed: HashSet::new(),
            in_ram: Vec::new(),
            decoding: 0,
        }
    }

    /// Where a brick is.
    pub fn state(&self, brick: BrickId) -> BrickState {
        self.states.get(&brick).copied().unwrap_or_default()
    }

    /// The slot of a resident brick.
    pub fn slot(&self, brick: BrickId) -> Option<SlotId> {
        match self.state(brick) {
            BrickState::Resident(slot) => Some(slot),
            _ => None,
        }
    }

    /// Number of slots.
    pub fn capacity(&self) -> usize {
        self.slots.capacity()
    }

    /// Declares what the picture needs: replaces what was wanted before. Resident bricks are marked as used, those that
    /// are no longer wanted leave the queue, new ones join it.
    pub fn request(&mut self, requests: &[Request]) {
        self.needed = requests.iter().map(|r| r.brick).collect();
        for old in std::mem::take(&mut self.queue) {
            if !self.needed.contains(&old.brick) {
                self.apply(old.brick, Event::Drop);
            } else {
                self.queue.insert(old);
            }
        }
        let waiting = std::mem::take(&mut self.in_ram);
        for brick in waiting {
            if self.needed.contains(&brick) {
                self.in_ram.push(brick);
            } else {
                self.apply(brick, Event::Drop);
            }
        }
        for request in requests {
            match self.state(request.brick) {
                BrickState::Absent | BrickState::Failed => {
                    self.apply(request.brick, Event::Request);
                    self.queue.insert(*request);
                }
                BrickState::Resident(_) => self.slots.touch(request.brick),
                BrickState::Queued
                | BrickState::Decoding
                | BrickState::InRam
                | BrickState::Constant => {}
            }
        }
    }

    /// One step: takes what finished, gives slots to what is in host memory, and starts loads while fewer than
    /// `max_decoding` are under way.
    pub fn step(&mut self, completions: &[Completion], max_decoding: usize) -> Plan {
        let mut plan = Plan::default();
        for completion in completions {
            self.decoding -= 1;
            match *completion {
                Completion::Decoded(brick) => {
                    self.apply(brick, Event::Decoded);
                    if self.needed.contains(&brick) {
                        self.in_ram.push(brick);
                    } else {
                        self.apply(brick, Event::Drop);
                    }
                }
                Completion::Failed(brick) => self.apply(brick, Event::Failed),
            }
        }
        for brick in std::mem::take(&mut self.in_ram) {
            let needed = &self.needed;
            match self.slots.place(brick, |old| needed.contains(&old)) {
                Some((slot, evicted)) => {
                    if let Some(old) = evicted {
                        self.apply(old, Event::Drop);
                        plan.patches.push(PageTablePatch {
                            brick: old,
                            slot: None,
                        });
                        plan.evicted += 1;
                    }
                    self.apply(brick, Event::Place(slot));
                    plan.upload.push(Upload { brick, slot });
                    plan.patches.push(PageTablePatch {
                        brick,
                        slot: Some(slot),
                    });
                }
                None => self.in_ram.push(brick),
            }
        }
        while self.decoding < max_decoding {
            let Some(request) = self.queue.pop_first() else {
                break;
            };
            self.apply(request.brick, Event::Start);
            self.decoding += 1;
            plan.load.push(request.brick);
        }
        plan
    }

    /// True when nothing is queued, under way or waiting for a slot.
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.decoding == 0 && self.in_ram.is_empty()
    }

    fn apply(&mut self, brick: BrickId, event: Event) {
        let state = transition(self.state(brick), event)
            .expect("invariant: the pager makes only legal moves");
        if state == BrickState::Absent {
            self.states.remove(&brick);
        } else {
            self.states.insert(brick, state);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::geom::Lod;
    use crate::pager::Priority;

    fn brick(i: u32) -> BrickId {
        BrickId::new(Lod(0), UVec3::new(i, 0, 0))
    }

    proptest! {
        /// Random traces: slots are never shared, what is needed is never evicted, loads stay within the bound, and
        /// whatever fits becomes resident in the end (no livelock).
        #[test]
        fn traces_keep_the_invariants(
            pictures in prop::collection::vec(prop::collection::btree_set(0_u32..40, 1..12), 1..20),
            bound in 1_usize..5,
        ) {
            const SLOTS: u32 = 12;
            let mut pager = Pager::new(SlotPool::new(SLOTS));
            let mut table: HashMap<SlotId, BrickId> = HashMap::new();
            for wanted in pictures {
                let requests: Vec<Request> =
                    wanted.iter().map(|&i| Request { priority: Priority(i % 3), brick: brick(i) }).collect();
                pager.request(&requests);
                let mut under_way: Vec<BrickId> = Vec::new();
                for step in 0..200 {
                    let done: Vec<Completion> = under_way.drain(..).map(Completion::Decoded).collect();
                    let plan = pager.step(&done, bound);
                    for patch in &plan.patches {
                        match patch.slot {
                            Some(slot) => {
                                prop_assert!(table.insert(slot, patch.brick).is_none(), "slot {slot:?} was taken");
                            }
                            None => {
                                prop_assert!(!wanted.contains(&patch.brick.xyz.x), "a needed brick was evicted");
                                table.retain(|_, b| *b != patch.brick);
                            }
                        }
                    }
                    under_way.extend(&plan.load);
                    prop_assert!(under_way.len() <= bound, "more loads than allowed");
                    if pager.is_idle() {
                        break;
                    }
                    prop_assert!(step < 199, "never becomes idle");
                }
                for i in &wanted {
                    prop_assert!(pager.slot(brick(*i)).is_some(), "brick {i} fits but is not resident");
                    prop_assert_eq!(table.get(&pager.slot(brick(*i)).unwrap()), Some(&brick(*i)));
                }
            }
        }
    }

    #[test]
    fn a_failed_brick_is_failed_until_asked_again() {
        let mut pager = Pager::new(SlotPool::new(1));
        let request = [Request {
            priority: Priority(0),
            brick: brick(0),
        }];
        pager.request(&request);
        assert_eq!(pager.step(&[], 1).load, [brick(0)]);
        pager.step(&[Completion::Failed(brick(0))], 1);
        assert_eq!(pager.state(brick(0)), BrickState::Failed, "failed");
        assert!(pager.is_idle(), "nothing hangs");
        pager.request(&request);
        assert_eq!(pager.step(&[], 1).load, [brick(0)], "tried again");
    }
}
