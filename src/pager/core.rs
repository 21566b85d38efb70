//! The pager's core: a pure function of state, requests, completions and budget.
//!
//! Who gets a slot is settled when a frame begins: the best requests, as many as there are slots to give. They get them
//! whatever the order of decoding, so a frame ends in the same residency however the loads raced. What comes after them
//! is decoded ahead into host memory as far as that allows, and gives way there to whatever is wanted more.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use thiserror::Error;

use super::cache::RamCopies;
use super::policy::Tier;
use super::{
    BrickState, Event, FrameRequests, PageTablePatch, Plan, Priority, Request, RequestClass,
    SlotId, SlotPool, StepLimits, Upload, transition,
};
use crate::geom::BrickId;

/// The end of a load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Completion {
    /// The voxels are in host memory.
    Decoded(BrickId),
    /// The brick can't be read.
    Failed(BrickId),
    /// The order was taken back before a thread began with it.
    Cancelled(BrickId),
}

impl Completion {
    fn brick(self) -> BrickId {
        match self {
            Self::Decoded(brick) | Self::Failed(brick) | Self::Cancelled(brick) => brick,
        }
    }
}

/// What the pager may take. Where a bound is below one brick, one brick is taken at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PagerBudget {
    /// Decoded bricks in host memory, those in flight counted.
    pub ram_bytes: u64,
    /// Bricks ordered and not yet decoded, counted decoded.
    pub in_flight_bytes: u64,
    /// Bricks ordered at once.
    pub max_decoding: usize,
    /// Host bytes of a decoded brick; all are alike.
    pub brick_bytes: u64,
}

impl PagerBudget {
    fn bricks(&self, bytes: u64) -> u64 {
        (bytes / self.brick_bytes.max(1)).max(1)
    }
}

/// A demand that can't be met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PagerError {
    /// The pinned bricks leave no slot for anything else.
    #[error(
        "the atlas has {slots} brick slots, but {pinned} bricks are to stay in it for good and at least one more slot is \
         needed; give it more GPU memory"
    )]
    Slots {
        /// Slots of the atlas.
        slots: usize,
        /// Bricks that were to be pinned.
        pinned: usize,
    },
}

/// Counts since the pager was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PagerStatistics {
    /// Bricks that a pass sampled from their slots, summed over the passes.
    pub hits: u64,
    /// Bricks asked for or held (not predicted) without having a slot, each counted once until it gets one or is no
    /// longer asked for.
    pub misses: u64,
    /// Bricks that lost their slot.
    pub evictions: u64,
    /// Requests dropped before they were ordered, and orders taken back.
    pub cancelled: u64,
    /// Orders given to the loader.
    pub reads: u64,
    /// Bytes of decoded bricks in host memory, those in flight counted.
    pub ram_bytes: u64,
    /// Bytes of the bricks in flight, counted decoded.
    pub in_flight_bytes: u64,
    /// The most that `ram_bytes` has been.
    pub ram_peak_bytes: u64,
    /// The most that `in_flight_bytes` has been.
    pub in_flight_peak_bytes: u64,
}

/// A brick that this frame wants and that has no slot yet.
#[derive(Clone, Copy, Debug)]
struct Wanted {
    priority: Priority,
    /// It will get one of the slots that this frame can give.
    has_slot_share: bool,
}

/// States of all bricks that are not Absent, the slots, and what this frame wants.
#[derive(Debug)]
pub struct Pager {
    budget: PagerBudget,
    states: HashMap<BrickId, BrickState>,
    slots: SlotPool,
    ram: RamCopies,
    decoding: u64,
    pinned: BTreeSet<BrickId>,
    /// What the frame asked for and holds, whatever has become of it.
    asked: BTreeMap<BrickId, Priority>,
    keep_touched: bool,
    /// Of `asked` and `pinned`: what is neither resident nor failed.
    wanted: HashMap<BrickId, Wanted>,
    /// Of `wanted`: what is Queued.
    queue: BTreeSet<Request>,
    /// Of `wanted`: what is InRam and will get a slot.
    ready: BTreeSet<Request>,
    /// Of `wanted`: what is InRam and will get none in this frame.
    parked: BTreeSet<Request>,
    counts: PagerStatistics,
}

impl Pager {
    /// A pager over these slots.
    pub fn new(slots: SlotPool, budget: PagerBudget) -> Self {
        Self {
            budget,
            states: HashMap::new(),
            slots,
            ram: RamCopies::new(),
            decoding: 0,
            pinned: BTreeSet::new(),
            asked: BTreeMap::new(),
            keep_touched: false,
            wanted: HashMap::new(),
            queue: BTreeSet::new(),
            ready: BTreeSet::new(),
            parked: BTreeSet::new(),
            counts: PagerStatistics::default(),
        }
    }

    /// These bricks are loaded before all others and never evicted; takes the place of what was pinned before.
    ///
    /// # Errors
    /// They leave no slot for anything else; what was pinned before stays so.
    pub fn pin(&mut self, bricks: &[BrickId]) -> Result<(), PagerError> {
        let pinned: BTreeSet<BrickId> = bricks.iter().copied().collect();
        if pinned.len() >= self.slots.capacity() {
            return Err(PagerError::Slots {
                slots: self.slots.capacity(),
                pinned: pinned.len(),
            });
        }
        self.pinned = pinned;
        self.want();
        Ok(())
    }

    /// Begins a frame: what was asked for before and is no longer is forgotten, and the slots are shared out anew.
    pub fn begin_frame(&mut self, frame: &FrameRequests<'_>) {
        self.slots.order.next_pass();
        for &brick in frame.touched {
            if matches!(self.state(brick), BrickState::Resident(_)) {
                self.counts.hits += 1;
                self.slots.order.touch(brick);
                self.ram.touch(brick);
            }
        }
        self.keep_touched = frame.keep_touched;
        let before = std::mem::take(&mut self.asked);
        for &brick in frame.held {
            let priority = Priority::new(RequestClass::Held, u32::MAX, brick.lod, 0);
            self.asked.insert(brick, priority);
        }
        debug_assert!(
            self.asked
                .keys()
                .chain(&self.pinned)
                .collect::<BTreeSet<_>>()
                .len()
                <= self.slots.capacity(),
            "held and pinned bricks fit the slots: the engine sees to it"
        );
        for request in frame.requests {
            self.asked
                .entry(request.brick)
                .and_modify(|p| *p = request.priority.min(*p))
                .or_insert(request.priority);
        }
        for (&brick, priority) in &self.asked {
            let is_new = before
                .get(&brick)
                .is_none_or(|p| p.class == RequestClass::Predicted);
            if is_new
                && priority.class != RequestClass::Predicted
                && !matches!(
                    self.state(brick),
                    BrickState::Resident(_) | BrickState::Failed
                )
            {
                self.counts.misses += 1;
            }
        }
        self.want();
    }

    /// Other predicted bricks take the place of those that the last frame asked for; what it needs stays.
    pub fn predict(&mut self, requests: &[Request]) {
        self.slots.order.unpredict();
        self.asked.retain(|_, p| p.class != RequestClass::Predicted);
        for request in requests {
            self.asked.entry(request.brick).or_insert(request.priority);
        }
        self.want();
    }

    /// One step: takes what finished, gives slots to what is in host memory, and orders loads, all within the budget.
    ///
    /// # Panics
    /// A completion is of a brick that no plan ordered, or that has completed before.
    pub fn step(&mut self, completions: &[Completion], limits: StepLimits) -> Plan {
        let mut plan = Plan::default();
        let mut is_share_left = false;
        for completion in completions {
            is_share_left |= self.complete(*completion);
        }
        if is_share_left {
            self.want();
        }
        self.place(&mut plan, limits);
        self.load(&mut plan);
        self.counts.ram_bytes = (self.ram.len() + self.decoding) * self.budget.brick_bytes;
        self.counts.in_flight_bytes = self.decoding * self.budget.brick_bytes;
        self.counts.ram_peak_bytes = self.counts.ram_peak_bytes.max(self.counts.ram_bytes);
        self.counts.in_flight_peak_bytes = self
            .counts
            .in_flight_peak_bytes
            .max(self.counts.in_flight_bytes);
        plan
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

    /// True for a brick whose voxels are in host memory: decoded, and in no plan's `release` since.
    pub fn has_ram_copy(&self, brick: BrickId) -> bool {
        self.ram.contains(brick)
    }

    /// Number of slots.
    pub fn capacity(&self) -> usize {
        self.slots.capacity()
    }

    /// The bricks with a slot, in the order of their ids.
    pub fn resident(&self) -> impl Iterator<Item = (BrickId, SlotId)> + '_ {
        self.slots.resident()
    }

    /// The bricks that could not be read, in no order.
    pub fn failed(&self) -> impl Iterator<Item = BrickId> + '_ {
        let is_failed = |(_, state): &(&BrickId, &BrickState)| **state == BrickState::Failed;
        self.states
            .iter()
            .filter(is_failed)
            .map(|(&brick, _)| brick)
    }

    /// Bricks that could not be read may be tried again: those that this frame asked for are.
    pub fn retry_failed(&mut self) {
        let failed: Vec<BrickId> = self.failed().collect();
        for brick in failed {
            self.apply(brick, Event::Retry);
        }
        self.want();
    }

    /// Bricks that were ordered and that nobody asks for any more, in no order. An engine may take back those orders,
    /// and reports what it took back as [`Completion::Cancelled`]; the others end up in host memory.
    pub fn unwanted_orders(&self) -> impl Iterator<Item = BrickId> + '_ {
        self.states
            .iter()
            .filter(|(brick, state)| {
                **state == BrickState::Decoding && !self.wanted.contains_key(brick)
            })
            .map(|(&brick, _)| brick)
    }

    /// Bricks that were ordered and are but predicted, while bricks that are needed wait for their order, in no order. An
    /// engine takes back those orders that no thread has begun with, as it does unwanted ones: then no prediction
    /// delays what is needed. They are ordered again after it.
    pub fn yielding_orders(&self) -> impl Iterator<Item = BrickId> + '_ {
        let needed = |r: &Request| r.priority.class < RequestClass::Predicted;
        let must_yield = self.queue.first().is_some_and(needed);
        let is_predicted = |w: &Wanted| w.priority.class == RequestClass::Predicted;
        self.states
            .iter()
            .filter(move |(brick, state)| {
                must_yield
                    && **state == BrickState::Decoding
                    && self.wanted.get(brick).is_some_and(is_predicted)
            })
            .map(|(&brick, _)| brick)
    }

    /// True when nothing is in flight and a step would do nothing: so it stays until the next frame.
    pub fn is_idle(&self) -> bool {
        self.decoding == 0 && self.ready.is_empty() && !self.can_load()
    }

    /// True when everything that this frame asks for or holds, and all that is pinned, has a slot or can't be read.
    pub fn is_satisfied(&self) -> bool {
        self.wanted.is_empty()
    }

    /// True when everything that will get a slot in this frame has one. What is still asked for waits for the next
    /// frame, so a pass may run: it will not see more by waiting.
    pub fn is_placed(&self) -> bool {
        self.wanted.values().all(|wanted| !wanted.has_slot_share)
    }

    /// Counts so far.
    pub fn statistics(&self) -> PagerStatistics {
        self.counts
    }

    /// Makes `wanted` and its parts anew from `asked` and `pinned`, and shares out the slots.
    fn want(&mut self) {
        let mut all: BTreeMap<BrickId, Priority> = self.asked.clone();
        for &brick in &self.pinned {
            let first = Priority::new(RequestClass::Pinned, u32::MAX, brick.lod, 0);
            all.insert(brick, first);
        }
        let before = std::mem::take(&mut self.wanted);
        self.queue.clear();
        self.ready.clear();
        self.parked.clear();
        let mut requests = Vec::with_capacity(all.len());
        for (&brick, &priority) in &all {
            match self.state(brick) {
                BrickState::Resident(_) if priority.class <= RequestClass::Held => {
                    self.slots.order.protect(brick);
                }
                BrickState::Resident(_) if priority.class == RequestClass::Predicted => {
                    self.slots.order.predict(Request { priority, brick });
                }
                BrickState::Resident(_) => self.slots.order.ask(brick),
                BrickState::Failed | BrickState::Constant => {}
                BrickState::Absent
                | BrickState::Queued
                | BrickState::Decoding
                | BrickState::InRam => requests.push(Request { priority, brick }),
            }
        }
        requests.sort_unstable();
        for (rank, &request) in requests.iter().enumerate() {
            let most = self.may_evict(request.priority.class);
            let wanted = Wanted {
                priority: request.priority,
                has_slot_share: rank < self.slots.available(most),
            };
            self.wanted.insert(request.brick, wanted);
            match self.state(request.brick) {
                BrickState::Absent => {
                    self.apply(request.brick, Event::Request);
                    self.queue.insert(request);
                }
                BrickState::Queued => {
                    self.queue.insert(request);
                }
                BrickState::InRam => self.await_slot(request.brick, wanted),
                _ => {}
            }
        }
        let mut forgotten: Vec<BrickId> = before
            .into_keys()
            .filter(|b| !self.wanted.contains_key(b))
            .collect();
        forgotten.sort_unstable();
        for brick in forgotten {
            match self.state(brick) {
                BrickState::Queued => {
                    self.apply(brick, Event::Drop);
                    self.counts.cancelled += 1;
                }
                BrickState::InRam => self.ram.set_spare(brick),
                _ => {}
            }
        }
    }

    /// What a request may evict. A held brick may evict all that is not itself held, pinned or just placed: its frame
    /// must make progress.
    fn may_evict(&self, class: RequestClass) -> Tier {
        match class {
            RequestClass::Pinned | RequestClass::Held => Tier::Asked,
            RequestClass::Missing if !self.keep_touched => Tier::Latest,
            RequestClass::Missing => Tier::Predicted,
            RequestClass::Predicted => Tier::Previous,
        }
    }

    /// A wanted brick is in host memory.
    fn await_slot(&mut self, brick: BrickId, wanted: Wanted) {
        let request = Request {
            priority: wanted.priority,
            brick,
        };
        self.ram.set_waiting(brick);
        if wanted.has_slot_share {
            self.ready.insert(request);
        } else {
            self.parked.insert(request);
        }
    }

    /// Takes the end of a load; true when the brick leaves its share of the slots to others.
    fn complete(&mut self, completion: Completion) -> bool {
        let brick = completion.brick();
        self.decoding = self
            .decoding
            .checked_sub(1)
            .expect("completions are of bricks that were ordered");
        match completion {
            Completion::Decoded(_) => {
                self.apply(brick, Event::Decoded);
                match self.wanted.get(&brick) {
                    Some(&wanted) => self.await_slot(brick, wanted),
                    None => self.ram.set_spare(brick),
                }
                false
            }
            Completion::Failed(_) => {
                self.apply(brick, Event::Failed);
                self.wanted.remove(&brick).is_some_and(|w| w.has_slot_share)
            }
            Completion::Cancelled(_) => {
                self.apply(brick, Event::Drop);
                self.counts.cancelled += 1;
                if let Some(&Wanted { priority, .. }) = self.wanted.get(&brick) {
                    // Wanted again since: back to the queue.
                    self.apply(brick, Event::Request);
                    self.queue.insert(Request { priority, brick });
                }
                false
            }
        }
    }

    /// Gives slots to what is in host memory and has a share of them.
    fn place(&mut self, plan: &mut Plan, limits: StepLimits) {
        let most_uploads = self.budget.bricks(limits.upload_bytes);
        while (plan.upload.len() as u64) < most_uploads {
            let Some(request) = self.ready.pop_first() else {
                return;
            };
            let brick = request.brick;
            let most = self.may_evict(request.priority.class);
            let placed = self
                .slots
                .place(brick, most)
                .expect("invariant: a brick with a share finds a slot");
            self.wanted.remove(&brick);
            let mut is_asked_evicted = false;
            if let Some(old) = placed.evicted {
                plan.evicted += 1;
                self.counts.evictions += 1;
                plan.patches.push(PageTablePatch {
                    brick: old,
                    slot: None,
                });
                if self.ram.contains(old) {
                    self.apply(old, Event::Evict);
                    self.ram.set_spare(old);
                } else {
                    self.apply(old, Event::Drop);
                }
                is_asked_evicted = self.asked.contains_key(&old);
            }
            self.apply(brick, Event::Place(placed.slot));
            self.ram.set_resident(brick);
            let slot = placed.slot;
            plan.upload.push(Upload { brick, slot });
            plan.patches.push(PageTablePatch {
                brick,
                slot: Some(slot),
            });
            if is_asked_evicted {
                // A held brick took the slot of a requested one, or a requested one that of a predicted one, which now
                // waits like the others.
                self.want();
            }
        }
    }

    /// Orders the most wanted bricks while they fit the budgets.
    fn load(&mut self, plan: &mut Plan) {
        while self.can_load() {
            let Some(request) = self.queue.pop_first() else {
                return;
            };
            while self.ram.len() + self.decoding >= self.budget.bricks(self.budget.ram_bytes) {
                self.make_room(plan);
            }
            self.apply(request.brick, Event::Start);
            self.decoding += 1;
            self.counts.reads += 1;
            plan.load.push(request.brick);
        }
    }

    /// True when the first of the queue fits the budgets, or something can go that is wanted less.
    fn can_load(&self) -> bool {
        let Some(first) = self.queue.first() else {
            return false;
        };
        let most = self
            .budget
            .bricks(self.budget.in_flight_bytes)
            .min((self.budget.max_decoding as u64).max(1));
        self.decoding < most
            && (self.ram.len() + self.decoding < self.budget.bricks(self.budget.ram_bytes)
                || self.ram.has_droppable()
                || self.parked.last().is_some_and(|worst| worst > first))
    }

    /// Drops one copy in host memory: of a resident brick, else one that nobody asks for, else the least wanted of
    /// those that get no slot in this frame.
    fn make_room(&mut self, plan: &mut Plan) {
        if let Some(brick) = self.ram.pop_of_resident() {
            plan.release.push(brick);
        } else if let Some(brick) = self.ram.pop_spare() {
            self.apply(brick, Event::Drop);
            plan.release.push(brick);
        } else {
            let worst = self
                .parked
                .pop_last()
                .expect("invariant: can_load saw something to drop");
            self.ram.remove(worst.brick);
            self.apply(worst.brick, Event::Drop);
            self.apply(worst.brick, Event::Request);
            self.queue.insert(worst);
            plan.release.push(worst.brick);
        }
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
