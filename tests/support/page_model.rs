//! A plain model of slots, host memory and loads that holds every plan of the pager against the rules. It knows nothing
//! of priorities or policies: it only says what must never happen.

use std::collections::{BTreeMap, BTreeSet};

use brickscope::geom::BrickId;
use brickscope::pager::{
    BrickState, Completion, FrameRequests, Pager, PagerBudget, Plan, Priority, Request,
    RequestClass, SlotId, SlotPool, StepLimits,
};

/// A fault put into the pager on purpose: the model must notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// None.
    Sound,
    /// Held bricks are taken for requested ones.
    ForgetsHeld,
    /// Touched bricks are not kept.
    ForgetsTouched,
    /// Nothing is pinned.
    ForgetsPinned,
    /// Twice the host memory is taken.
    TakesTwiceTheRam,
    /// Twice the loads are started.
    LoadsTwiceAsMuch,
    /// Copies that were dropped are not said to be.
    ForgetsReleases,
    /// Two bricks are put into one slot.
    SharesSlots,
    /// The bound of uploads is ignored.
    UploadsAtOnce,
    /// Bricks that could not be read are tried again at once.
    Retries,
    /// Predicted bricks are taken for requested ones.
    NeedsPredicted,
}

/// Everything that a run is made with.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Slots of the atlas.
    pub slots: u32,
    /// Bounds of memory.
    pub budget: PagerBudget,
}

/// The pager, perhaps with a fault, and the model beside it.
pub struct Model {
    /// The pager.
    pub pager: Pager,
    fault: Fault,
    setup: Setup,
    /// What is in each slot.
    pub table: BTreeMap<SlotId, BrickId>,
    /// Decoded bricks in host memory.
    pub ram: BTreeSet<BrickId>,
    /// Ordered and not completed.
    pub in_flight: BTreeSet<BrickId>,
    failed: BTreeSet<BrickId>,
    pinned: BTreeSet<BrickId>,
    held: BTreeSet<BrickId>,
    kept: BTreeSet<BrickId>,
    /// Requested, and not but predicted.
    requested: BTreeSet<BrickId>,
    placed: BTreeSet<BrickId>,
    /// Loads so far.
    pub loads: u64,
    /// Evictions so far.
    pub evictions: u64,
}

fn as_missing(request: Request) -> Request {
    Request {
        priority: Priority {
            class: RequestClass::Missing,
            ..request.priority
        },
        ..request
    }
}

/// What is broken, in words.
pub type Verdict = Result<(), String>;

macro_rules! check {
    ($holds:expr, $($words:tt)*) => {
        if !$holds {
            return Err(format!($($words)*));
        }
    };
}

impl Model {
    /// A pager with `fault`, and its model.
    pub fn new(setup: Setup, pinned: &[BrickId], fault: Fault) -> Self {
        let mut budget = setup.budget;
        match fault {
            Fault::TakesTwiceTheRam => budget.ram_bytes *= 2,
            Fault::LoadsTwiceAsMuch => {
                budget.in_flight_bytes *= 2;
                budget.max_decoding *= 2;
            }
            _ => {}
        }
        let mut pager = Pager::new(SlotPool::new(setup.slots), budget);
        if fault != Fault::ForgetsPinned {
            pager.pin(pinned).expect("few enough are pinned");
        }
        Self {
            pager,
            fault,
            setup,
            table: BTreeMap::new(),
            ram: BTreeSet::new(),
            in_flight: BTreeSet::new(),
            failed: BTreeSet::new(),
            pinned: pinned.iter().copied().collect(),
            held: BTreeSet::new(),
            kept: BTreeSet::new(),
            requested: BTreeSet::new(),
            placed: BTreeSet::new(),
            loads: 0,
            evictions: 0,
        }
    }

    /// The bricks with a slot.
    pub fn resident(&self) -> BTreeSet<BrickId> {
        self.table.values().copied().collect()
    }

    /// Begins a frame.
    pub fn begin_frame(&mut self, frame: &FrameRequests<'_>) {
        self.placed.clear();
        self.held = frame.held.iter().copied().collect();
        let touched: BTreeSet<BrickId> = frame.touched.iter().copied().collect();
        self.kept = if frame.keep_touched {
            touched.intersection(&self.resident()).copied().collect()
        } else {
            BTreeSet::new()
        };
        let needed = |r: &&Request| r.priority.class < RequestClass::Predicted;
        self.requested = frame
            .requests
            .iter()
            .filter(needed)
            .map(|r| r.brick)
            .collect();
        match self.fault {
            Fault::NeedsPredicted => {
                let requests: Vec<Request> =
                    frame.requests.iter().copied().map(as_missing).collect();
                self.pager.begin_frame(&FrameRequests {
                    requests: &requests,
                    ..*frame
                });
            }
            Fault::ForgetsHeld => self.pager.begin_frame(&FrameRequests {
                held: &[],
                ..*frame
            }),
            Fault::ForgetsTouched => self.pager.begin_frame(&FrameRequests {
                keep_touched: false,
                ..*frame
            }),
            _ => self.pager.begin_frame(frame),
        }
    }

    /// A step, held against the rules.
    pub fn step(&mut self, completions: &[Completion], limits: StepLimits) -> Result<Plan, String> {
        for completion in completions {
            let brick = match *completion {
                Completion::Decoded(brick) => {
                    self.ram.insert(brick);
                    brick
                }
                Completion::Failed(brick) => {
                    self.failed.insert(brick);
                    brick
                }
                Completion::Cancelled(brick) => brick,
            };
            self.in_flight.remove(&brick);
        }
        let allowed = match self.fault {
            Fault::UploadsAtOnce => StepLimits::NONE,
            _ => limits,
        };
        let mut plan = self.pager.step(completions, allowed);
        match self.fault {
            Fault::ForgetsReleases => plan.release.clear(),
            Fault::SharesSlots => {
                for patch in &mut plan.patches {
                    patch.slot = patch.slot.map(|slot| SlotId(slot.0 / 2));
                }
            }
            Fault::Retries => {
                self.pager.retry_failed();
            }
            _ => {}
        }
        self.apply(&plan, limits)?;
        self.compare()?;
        Ok(plan)
    }

    fn apply(&mut self, plan: &Plan, limits: StepLimits) -> Verdict {
        let budget = self.setup.budget;
        let bricks = |bytes: u64| (bytes / budget.brick_bytes).max(1);
        check!(
            plan.upload.len() as u64 <= bricks(limits.upload_bytes),
            "{} uploads in {} bytes",
            plan.upload.len(),
            limits.upload_bytes
        );
        let mut evicted = Vec::new();
        let mut uploads = plan.upload.iter();
        for patch in &plan.patches {
            let brick = patch.brick;
            let Some(slot) = patch.slot else {
                let slots: Vec<SlotId> = self.slots_of(brick);
                check!(slots.len() == 1, "{brick} is evicted from {slots:?}");
                self.table.remove(&slots[0]);
                evicted.push(brick);
                continue;
            };
            let upload = uploads.next();
            check!(
                upload.is_some_and(|u| u.brick == brick && u.slot == slot),
                "{patch:?} goes with {upload:?}"
            );
            check!(
                self.ram.contains(&brick),
                "{brick} is uploaded from nowhere"
            );
            check!(slot.0 < self.setup.slots, "{slot:?} doesn't exist");
            check!(
                self.slots_of(brick).is_empty(),
                "{brick} gets a second slot"
            );
            let old = self.table.insert(slot, brick);
            check!(old.is_none(), "{slot:?} of {old:?} is given to {brick}");
            let is_first = self.held.contains(&brick) || self.pinned.contains(&brick);
            for gone in evicted.drain(..) {
                check!(!self.pinned.contains(&gone), "pinned {gone} is evicted");
                check!(!self.held.contains(&gone), "held {gone} is evicted");
                check!(!self.placed.contains(&gone), "{gone} is evicted at once");
                check!(
                    is_first || !self.kept.contains(&gone),
                    "{gone}, just touched, is evicted for {brick}"
                );
                self.evictions += 1;
            }
            self.placed.insert(brick);
        }
        check!(uploads.next().is_none(), "an upload without a patch");
        check!(evicted.is_empty(), "{evicted:?} evicted for nothing");
        for brick in &plan.release {
            check!(self.ram.remove(brick), "{brick} is released twice");
        }
        for brick in &plan.load {
            check!(!self.failed.contains(brick), "{brick} is read in vain");
            check!(!self.ram.contains(brick), "{brick} is read anew");
            check!(self.slots_of(*brick).is_empty(), "resident {brick} is read");
            check!(self.in_flight.insert(*brick), "{brick} is ordered twice");
            self.loads += 1;
        }
        let (in_flight, ram) = (self.in_flight.len() as u64, self.ram.len() as u64);
        check!(
            in_flight <= bricks(budget.in_flight_bytes) && in_flight <= budget.max_decoding as u64,
            "{in_flight} bricks in flight"
        );
        check!(
            in_flight + ram <= bricks(budget.ram_bytes),
            "{ram} bricks in host memory, {in_flight} in flight, of {}",
            budget.ram_bytes
        );
        Ok(())
    }

    /// Does the pager think of the world as it is?
    fn compare(&self) -> Verdict {
        let pager = &self.pager;
        let resident: BTreeMap<SlotId, BrickId> = pager.resident().map(|(b, s)| (s, b)).collect();
        check!(resident == self.table, "the slots differ");
        let known = self.table.values().chain(&self.ram).chain(&self.in_flight);
        for &brick in known.chain(&self.failed) {
            let state = pager.state(brick);
            let is_right = match state {
                BrickState::Resident(slot) => self.table.get(&slot) == Some(&brick),
                BrickState::InRam => self.ram.contains(&brick) && self.slots_of(brick).is_empty(),
                BrickState::Decoding => self.in_flight.contains(&brick),
                BrickState::Failed => self.failed.contains(&brick),
                BrickState::Absent | BrickState::Queued | BrickState::Constant => {
                    self.fault == Fault::Retries && self.failed.contains(&brick)
                }
            };
            check!(is_right, "{brick} is not {state:?}");
            check!(
                pager.has_ram_copy(brick) == self.ram.contains(&brick),
                "copy of {brick}"
            );
        }
        let counts = pager.statistics();
        let brick_bytes = self.setup.budget.brick_bytes;
        let in_flight = self.in_flight.len() as u64;
        check!(
            counts.in_flight_bytes == in_flight * brick_bytes
                && counts.ram_bytes == (self.ram.len() as u64 + in_flight) * brick_bytes
                && counts.ram_peak_bytes >= counts.ram_bytes
                && counts.in_flight_peak_bytes >= counts.in_flight_bytes
                && counts.reads == self.loads
                && counts.evictions == self.evictions,
            "{counts:?} miscounts"
        );
        Ok(())
    }

    /// A frame at rest: what was promised for it is done.
    pub fn compare_at_rest(&self, fits: bool) -> Verdict {
        let resident = self.resident();
        for brick in self.held.iter().chain(&self.pinned) {
            check!(
                resident.contains(brick) || self.failed.contains(brick),
                "{brick} is needed and never came"
            );
        }
        check!(self.pager.is_placed(), "at rest with bricks to be placed");
        let needed: BTreeSet<BrickId> = [&self.held, &self.pinned, &self.kept, &self.requested]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        if needed.len() <= self.setup.slots as usize {
            for brick in &needed {
                check!(
                    resident.contains(brick) || self.failed.contains(brick),
                    "{brick} fits and never came"
                );
            }
        }
        check!(
            !fits || self.pager.is_satisfied(),
            "everything fits and is not there"
        );
        Ok(())
    }

    fn slots_of(&self, brick: BrickId) -> Vec<SlotId> {
        self.table
            .iter()
            .filter(|(_, b)| **b == brick)
            .map(|(&slot, _)| slot)
            .collect()
    }
}
