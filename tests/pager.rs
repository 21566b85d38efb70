//! The pager against a plain model, its policy of eviction against foresight, and its loader against the clock.
//!
//! Invariant 5 of design.md: what a frame needs is not evicted, pinned bricks never are, budgets hold; besides: progress
//! is certain, what fits stays, replays are exact. The model must catch pagers that were broken on purpose.

#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/orbit.rs"]
mod orbit;
#[path = "support/page_model.rs"]
mod page_model;
#[path = "support/rivals.rs"]
mod rivals;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use brickscope::bricking::{self, BrickOptions, NoProgress};
use brickscope::geom::{BrickId, Lod};
use brickscope::pager::replay::{Replay, replay, replay_belady, replay_lru, replay_policy};
use brickscope::pager::{
    BrickState, Completion, FrameRequests, Loader, Pager, PagerBudget, PagerError, Priority,
    ReadHook, Request, RequestClass, SlotPool, StepLimits,
};
use brickscope::store::{Store, StoreError};
use glam::UVec3;
use orbit::{Orbit, mix};
use page_model::{Fault, Model, Setup};
use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestError, TestRunner};

/// Bytes of a brick in these tests.
const BRICK_BYTES: u64 = 10;

fn brick(i: u32) -> BrickId {
    BrickId::new(Lod((i % 3) as u8), UVec3::new(i, 0, 0))
}

fn request(i: u32, class: RequestClass, rays: u32) -> Request {
    Request {
        priority: Priority::new(class, rays, brick(i).lod, i % 5),
        brick: brick(i),
    }
}

fn missing(bricks: impl IntoIterator<Item = u32>) -> Vec<Request> {
    bricks
        .into_iter()
        .map(|i| request(i, RequestClass::Missing, 1))
        .collect()
}

/// Budgets in bricks.
fn budget(ram: u64, in_flight: u64) -> PagerBudget {
    PagerBudget {
        ram_bytes: ram * BRICK_BYTES,
        in_flight_bytes: in_flight * BRICK_BYTES,
        max_decoding: 64,
        brick_bytes: BRICK_BYTES,
    }
}

fn ample() -> PagerBudget {
    budget(1000, 64)
}

// ---- random traces ------------------------------------------------------------------------------------------------

/// A frame of a random trace.
#[derive(Clone, Debug)]
struct Frame {
    /// Brick, is it predicted, rays.
    requests: BTreeMap<u32, (bool, u32)>,
    held: BTreeSet<u32>,
    /// Share of the resident bricks that the last pass touched, of 4.
    touched: u64,
    keep_touched: bool,
    /// Steps before the next frame; `None`: until all is at rest.
    steps: Option<u32>,
    /// Orders that nobody wants are taken back.
    cancels: bool,
}

#[derive(Clone, Debug)]
struct Trace {
    slots: u32,
    pinned: u32,
    ram_bytes: u64,
    in_flight_bytes: u64,
    max_decoding: usize,
    upload_bytes: u64,
    frames: Vec<Frame>,
    /// One of so many bricks can't be read; 0: all can.
    failing: u64,
    seed: u64,
}

const BRICKS: u32 = 48;

fn frames() -> impl Strategy<Value = Frame> {
    (
        prop::collection::btree_map(0..BRICKS, (prop::bool::weighted(0.2), 0_u32..4), 0..24),
        prop::collection::btree_set(0..BRICKS, 0..8),
        0_u64..=4,
        any::<bool>(),
        prop::option::of(0_u32..6),
        any::<bool>(),
    )
        .prop_map(
            |(requests, held, touched, keep_touched, steps, cancels)| Frame {
                requests,
                held,
                touched,
                keep_touched,
                steps,
                cancels,
            },
        )
}

fn traces() -> impl Strategy<Value = Trace> {
    (
        (9_u32..24, 0_u32..3),
        (0_u64..300, 0_u64..80, 1_usize..8, 0_u64..60),
        prop::collection::vec(frames(), 1..10),
        prop_oneof![Just(0_u64), Just(5)],
        any::<u64>(),
    )
        .prop_map(
            |((slots, pinned), (ram, in_flight, max_decoding, upload), frames, failing, seed)| {
                Trace {
                    slots,
                    pinned,
                    ram_bytes: ram,
                    in_flight_bytes: in_flight,
                    max_decoding,
                    upload_bytes: upload,
                    frames,
                    failing,
                    seed,
                }
            },
        )
}

impl Trace {
    fn fails(&self, brick: BrickId) -> bool {
        self.failing > 0 && mix(u64::from(brick.xyz.x) ^ self.seed).is_multiple_of(self.failing)
    }

    fn completion(&self, brick: BrickId) -> Completion {
        if self.fails(brick) {
            Completion::Failed(brick)
        } else {
            Completion::Decoded(brick)
        }
    }
}

/// Runs a trace. Completions come in an order, and as many at a time, as `order` says. Returns all plans in words, and
/// the bricks that are resident after each frame.
fn run(
    trace: &Trace,
    order: u64,
    fault: Fault,
) -> Result<(Vec<String>, Vec<BTreeSet<BrickId>>), String> {
    let setup = Setup {
        slots: trace.slots,
        budget: PagerBudget {
            ram_bytes: trace.ram_bytes,
            in_flight_bytes: trace.in_flight_bytes,
            max_decoding: trace.max_decoding,
            brick_bytes: BRICK_BYTES,
        },
    };
    let pinned: Vec<BrickId> = (0..trace.pinned).map(brick).collect();
    let mut model = Model::new(setup, &pinned, fault);
    let limits = StepLimits {
        upload_bytes: trace.upload_bytes,
    };
    let (mut plans, mut residents) = (Vec::new(), Vec::new());
    let mut dice = order;
    let mut roll = |sides: u64| {
        dice = mix(dice.wrapping_add(0x9e37_79b9_7f4a_7c15));
        dice % sides
    };
    for (number, frame) in (0_u64..).zip(&trace.frames) {
        let requests: Vec<Request> = frame
            .requests
            .iter()
            .map(|(&i, &(is_predicted, rays))| {
                let class = if is_predicted {
                    RequestClass::Predicted
                } else {
                    RequestClass::Missing
                };
                request(i, class, rays)
            })
            .collect();
        let held: Vec<BrickId> = frame.held.iter().map(|&i| brick(i)).collect();
        let before = model.resident();
        let touched: Vec<BrickId> = before
            .iter()
            .copied()
            .filter(|b| mix(u64::from(b.xyz.x) ^ trace.seed ^ (number << 32)) % 4 < frame.touched)
            .collect();
        model.begin_frame(&FrameRequests {
            requests: &requests,
            held: &held,
            touched: &touched,
            keep_touched: frame.keep_touched,
        });
        let kept = if frame.keep_touched {
            &touched[..]
        } else {
            &[]
        };
        let needed: BTreeSet<BrickId> = requests
            .iter()
            .map(|r| r.brick)
            .chain(held.iter().chain(&pinned).chain(kept).copied())
            .collect();
        // Bricks predicted don't take the slots of what was used last.
        let fits = needed.len() <= trace.slots as usize
            && frame
                .requests
                .values()
                .all(|(is_predicted, _)| !is_predicted);
        // Every step takes in at least one brick that is under way. A brick is read once, and once more for each brick
        // before it that needed its place in host memory.
        let patience = 200 + 10 * BRICKS;
        for step in 0.. {
            if frame.steps.is_some_and(|most| step >= most) {
                break;
            }
            if step > 0 && model.pager.is_idle() {
                model.compare_at_rest(fits)?;
                break;
            }
            if step > patience {
                return Err("never comes to rest".into());
            }
            let mut completions = Vec::new();
            if frame.cancels {
                let unwanted = model.pager.unwanted_orders();
                let mut unwanted: Vec<BrickId> =
                    unwanted.chain(model.pager.yielding_orders()).collect();
                unwanted.sort_unstable();
                completions.extend(unwanted.into_iter().map(Completion::Cancelled));
            }
            let mut under_way: Vec<BrickId> = model
                .in_flight
                .iter()
                .copied()
                .filter(|b| !completions.contains(&Completion::Cancelled(*b)))
                .collect();
            if !under_way.is_empty() {
                for _ in 0..=roll(under_way.len() as u64) {
                    let brick = under_way.swap_remove(roll(under_way.len() as u64) as usize);
                    completions.push(trace.completion(brick));
                }
            }
            plans.push(format!("{:?}", model.step(&completions, limits)?));
        }
        residents.push(model.resident());
    }
    Ok((plans, residents))
}

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn sound(
    trace: &Trace,
    order: u64,
) -> Result<(Vec<String>, Vec<BTreeSet<BrickId>>), TestCaseError> {
    run(trace, order, Fault::Sound).map_err(TestCaseError::fail)
}

proptest! {
    #![proptest_config(config(2000))]

    /// Budgets, protection, slots, progress: everything that the model checks; and the same inputs give the same plans.
    #[test]
    fn random_traces_keep_the_rules(trace in traces()) {
        prop_assert_eq!(sound(&trace, trace.seed)?, sound(&trace, trace.seed)?, "a replay differs");
    }

    /// In whatever order loads end, the same bricks get the slots, even where not all fit.
    #[test]
    fn the_order_of_arrival_does_not_matter(trace in traces(), order in any::<u64>()) {
        let mut trace = trace;
        trace.frames.truncate(1);
        trace.frames[0].steps = None;
        prop_assert_eq!(sound(&trace, trace.seed)?.1, sound(&trace, order)?.1, "the resident bricks differ");
    }

    /// The same over many frames, when everything fits.
    #[test]
    fn what_fits_is_resident_in_any_order(trace in traces(), order in any::<u64>()) {
        let mut trace = trace;
        trace.slots = BRICKS;
        for frame in &mut trace.frames {
            frame.steps = None;
        }
        let (_, one) = sound(&trace, trace.seed)?;
        prop_assert_eq!(&one, &sound(&trace, order)?.1, "the resident bricks differ");
        let mut wanted: BTreeSet<u32> = (0..trace.pinned).collect();
        for (frame, resident) in trace.frames.iter().zip(one) {
            wanted.extend(frame.requests.keys().chain(&frame.held));
            let expected: BTreeSet<BrickId> =
                wanted.iter().map(|&i| brick(i)).filter(|b| !trace.fails(*b)).collect();
            prop_assert_eq!(resident, expected, "what was asked for is there, and stays");
        }
    }

    /// A working set that fits is read once, whatever is touched, asked for and held of it later.
    #[test]
    fn a_working_set_that_fits_stays(trace in traces(), set in prop::collection::btree_set(0..BRICKS, 1..20)) {
        let mut trace = trace;
        trace.slots = 24;
        trace.failing = 0;
        let cold = Frame {
            requests: set.iter().map(|&i| (i, (false, 1))).collect(),
            held: BTreeSet::new(),
            touched: 0,
            keep_touched: false,
            steps: None,
            cancels: false,
        };
        let warm = trace.frames.iter().cloned().map(|mut frame| {
            frame.requests.retain(|i, _| set.contains(i));
            frame.held.retain(|i| set.contains(i));
            frame.steps = None;
            frame
        });
        trace.frames = std::iter::once(cold).chain(warm).collect();
        let mut whole = trace.clone();
        trace.frames.truncate(1);
        let (cold_plans, cold_resident) = sound(&trace, trace.seed)?;
        whole.seed = trace.seed;
        let (plans, residents) = sound(&whole, trace.seed)?;
        prop_assert_eq!(&plans[..cold_plans.len()], &cold_plans[..], "the cold frame is the same");
        for plan in &plans[cold_plans.len()..] {
            prop_assert_eq!(plan, &format!("{:?}", brickscope::pager::Plan::default()), "a warm frame does something");
        }
        prop_assert!(residents.iter().all(|r| *r == cold_resident[0]), "the resident bricks change");
    }
}

/// Every fault is found by the model, and a sound pager is not blamed by the same traces.
#[test]
fn the_model_catches_broken_pagers() {
    for fault in [
        Fault::ForgetsHeld,
        Fault::ForgetsTouched,
        Fault::ForgetsPinned,
        Fault::TakesTwiceTheRam,
        Fault::LoadsTwiceAsMuch,
        Fault::ForgetsReleases,
        Fault::SharesSlots,
        Fault::UploadsAtOnce,
        Fault::Retries,
        Fault::NeedsPredicted,
    ] {
        let config = ProptestConfig {
            max_shrink_iters: 0,
            ..config(2000)
        };
        let outcome = TestRunner::new(config).run(&traces(), |trace| {
            run(&trace, trace.seed, fault)
                .map(|_| ())
                .map_err(TestCaseError::fail)
        });
        let Err(TestError::Fail(reason, trace)) = outcome else {
            panic!("{fault:?} is not noticed: {outcome:?}");
        };
        assert!(
            run(&trace, trace.seed, Fault::Sound).is_ok(),
            "{fault:?} is noticed ({reason}), but a sound pager is blamed too"
        );
    }
}

// ---- single rules -------------------------------------------------------------------------------------------------

/// Runs steps until nothing happens any more; every order is answered by `answer`. Returns the orders.
fn settle(pager: &mut Pager, answer: impl Fn(BrickId) -> Completion) -> Vec<BrickId> {
    let (mut completions, mut orders) = (Vec::new(), Vec::new());
    for _ in 0..1000 {
        let plan = pager.step(&completions, StepLimits::NONE);
        completions = plan.load.iter().copied().map(&answer).collect();
        orders.extend(plan.load);
        if completions.is_empty() && pager.is_idle() {
            return orders;
        }
    }
    panic!("never comes to rest");
}

fn frame<'a>(requests: &'a [Request], touched: &'a [BrickId]) -> FrameRequests<'a> {
    FrameRequests {
        requests,
        touched,
        ..FrameRequests::default()
    }
}

fn ids(bricks: impl IntoIterator<Item = u32>) -> Vec<BrickId> {
    bricks.into_iter().map(brick).collect()
}

fn resident(pager: &Pager) -> BTreeSet<u32> {
    pager.resident().map(|(b, _)| b.xyz.x).collect()
}

#[test]
fn loads_come_in_the_order_of_priority() {
    let mut pager = Pager::new(SlotPool::new(20), budget(1000, 1));
    pager.pin(&ids([9])).unwrap();
    let class = |i, class, rays| request(i, class, rays);
    // Levels: 0 → 0, 1 → 1, 2 → 2, 4 → 1, 5 → 2, 7 → 1, 10 → 1; distances are i % 5.
    let requests = [
        class(2, RequestClass::Predicted, 900),
        class(0, RequestClass::Missing, 1),
        class(4, RequestClass::Missing, 1),
        class(1, RequestClass::Missing, 1),
        class(5, RequestClass::Missing, 1),
        class(7, RequestClass::Missing, 3),
        class(10, RequestClass::Missing, 1),
    ];
    let held = ids([11]);
    pager.begin_frame(&FrameRequests {
        requests: &requests,
        held: &held,
        ..FrameRequests::default()
    });
    assert_eq!(
        settle(&mut pager, Completion::Decoded),
        ids([9, 11, 7, 5, 10, 1, 4, 0, 2]),
        "pinned, held, most rays, coarse before fine, near before far, predicted"
    );
    assert!(pager.is_satisfied() && pager.is_placed(), "all is there");
    assert_eq!(
        pager.statistics().misses,
        7,
        "predicted and pinned ones are no misses"
    );
}

#[test]
fn what_is_no_longer_asked_for_is_cancelled() {
    let mut pager = Pager::new(SlotPool::new(20), budget(1000, 2));
    pager.begin_frame(&frame(&missing(0..6), &[]));
    let first = pager.step(&[], StepLimits::NONE).load;
    assert_eq!(first.len(), 2, "two are under way");
    pager.begin_frame(&frame(&missing([8]), &[]));
    for i in 0..6 {
        let expected = if first.contains(&brick(i)) {
            BrickState::Decoding
        } else {
            BrickState::Absent
        };
        assert_eq!(pager.state(brick(i)), expected, "brick {i}");
    }
    assert_eq!(pager.statistics().cancelled, 4, "four left the queue");
    assert_eq!(
        pager.unwanted_orders().collect::<BTreeSet<_>>(),
        first.iter().copied().collect(),
        "two orders are unwanted"
    );
    let plan = pager.step(
        &[
            Completion::Decoded(first[0]),
            Completion::Cancelled(first[1]),
        ],
        StepLimits::NONE,
    );
    assert_eq!(plan.load, ids([8]), "the new request's turn");
    assert_eq!(
        pager.state(first[0]),
        BrickState::InRam,
        "came too late, kept"
    );
    assert_eq!(pager.state(first[1]), BrickState::Absent, "taken back");
    assert!(
        plan.upload.is_empty() && plan.patches.is_empty(),
        "neither gets a slot"
    );

    // Asked for again, the one in host memory needs no load.
    pager.begin_frame(&frame(&missing([first[0].xyz.x]), &[]));
    let plan = pager.step(&[], StepLimits::NONE);
    assert_eq!(plan.upload.len(), 1, "straight to a slot");
    assert!(plan.load.is_empty(), "{:?}", plan.load);
    assert_eq!(pager.statistics().reads, 3, "no read but the three");
}

#[test]
fn an_order_taken_back_and_wanted_again_is_given_again() {
    let mut pager = Pager::new(SlotPool::new(4), budget(10, 1));
    pager.begin_frame(&frame(&missing([1]), &[]));
    assert_eq!(pager.step(&[], StepLimits::NONE).load, ids([1]), "ordered");
    pager.begin_frame(&frame(&[], &[]));
    pager.begin_frame(&frame(&missing([1]), &[]));
    let plan = pager.step(&[Completion::Cancelled(brick(1))], StepLimits::NONE);
    assert_eq!(plan.load, ids([1]), "ordered again");
}

#[test]
fn an_evicted_brick_comes_back_from_host_memory() {
    let mut pager = Pager::new(SlotPool::new(2), ample());
    for (bricks, orders) in [([0, 1], 2), ([2, 3], 2), ([0, 1], 0), ([2, 3], 0)] {
        pager.begin_frame(&frame(&missing(bricks), &[]));
        assert_eq!(
            settle(&mut pager, Completion::Decoded).len(),
            orders,
            "{bricks:?}"
        );
        assert_eq!(resident(&pager), bricks.into(), "resident");
    }
    assert_eq!(pager.statistics().evictions, 6, "each swap evicts both");

    // Without host memory to speak of, everything is read anew, one at a time, and it still ends.
    for ram in [0, 1] {
        let mut pager = Pager::new(SlotPool::new(2), budget(ram, 0));
        for bricks in [[0, 1], [2, 3], [0, 1]] {
            pager.begin_frame(&frame(&missing(bricks), &[]));
            assert_eq!(
                settle(&mut pager, Completion::Decoded).len(),
                2,
                "{bricks:?}"
            );
        }
        assert_eq!(
            (pager.statistics().ram_peak_bytes, pager.statistics().reads),
            (BRICK_BYTES, 6),
            "one brick at a time"
        );
    }
}

#[test]
fn copies_of_resident_bricks_go_first() {
    let mut pager = Pager::new(SlotPool::new(2), budget(3, 8));
    pager.begin_frame(&frame(&missing([0, 1]), &[]));
    settle(&mut pager, Completion::Decoded);
    pager.begin_frame(&frame(&missing([2]), &ids([1])));
    settle(&mut pager, Completion::Decoded);
    assert_eq!(resident(&pager), [1, 2].into(), "the one not touched left");
    assert_eq!(pager.state(brick(0)), BrickState::InRam, "its copy stays");
    pager.begin_frame(&frame(&missing([3]), &ids([1, 2])));
    let plan = pager.step(&[], StepLimits::NONE);
    assert_eq!(
        (plan.load, plan.release),
        (ids([3]), ids([1])),
        "the oldest of the resident"
    );
    assert!(
        pager.has_ram_copy(brick(0)),
        "the evicted one would be a loss"
    );
}

#[test]
fn a_failed_brick_hangs_nothing_and_waits_for_the_word() {
    let mut pager = Pager::new(SlotPool::new(2), ample());
    let answer = |b: BrickId| {
        if b == brick(3) {
            Completion::Failed(b)
        } else {
            Completion::Decoded(b)
        }
    };
    let requests = missing([3, 6, 9]);
    pager.begin_frame(&frame(&requests, &[]));
    assert_eq!(settle(&mut pager, answer).len(), 3, "all were tried");
    assert_eq!(resident(&pager), [6, 9].into(), "its slot goes to the next");
    assert!(pager.is_satisfied() && pager.is_idle(), "nothing hangs");
    assert_eq!(pager.failed().collect::<Vec<_>>(), ids([3]), "it is known");
    pager.begin_frame(&frame(&requests, &ids([6, 9])));
    assert!(settle(&mut pager, answer).is_empty(), "not tried again");
    pager.retry_failed();
    assert_eq!(
        settle(&mut pager, Completion::Decoded),
        ids([3]),
        "but at the word"
    );
    assert_eq!(pager.failed().count(), 0, "and now it is read");
}

#[test]
fn pinned_bricks_leave_a_slot() {
    let mut pager = Pager::new(SlotPool::new(3), ample());
    assert_eq!(
        pager.pin(&ids(0..3)),
        Err(PagerError::Slots {
            slots: 3,
            pinned: 3
        }),
        "no slot is left"
    );
    let message = pager.pin(&ids(0..3)).unwrap_err().to_string();
    assert!(
        message.contains("has 3 ") && message.contains(" 3 bricks"),
        "{message}"
    );
    pager.pin(&ids(0..2)).unwrap();
    assert_eq!(
        settle(&mut pager, Completion::Decoded),
        ids([1, 0]),
        "coarse first, before any frame"
    );
    for i in 2..9 {
        pager.begin_frame(&frame(&missing([i]), &[]));
        settle(&mut pager, Completion::Decoded);
        assert_eq!(resident(&pager), [0, 1, i].into(), "pinned ones stay");
    }
}

#[test]
fn a_held_set_takes_the_whole_atlas_if_it_must() {
    let mut pager = Pager::new(SlotPool::new(5), budget(2, 2));
    pager.pin(&ids([40])).unwrap();
    pager.begin_frame(&frame(&missing(0..4), &[]));
    settle(&mut pager, Completion::Decoded);
    // All slots are kept or asked for, host memory is small, and yet what is held comes, all of it.
    let held = ids(10..14);
    pager.begin_frame(&FrameRequests {
        requests: &missing((0..8).chain(20..30)),
        held: &held,
        touched: &ids(0..4),
        keep_touched: true,
    });
    settle(&mut pager, Completion::Decoded);
    assert_eq!(
        resident(&pager),
        [40, 10, 11, 12, 13].into(),
        "the held set"
    );
    assert!(
        pager.is_placed() && !pager.is_satisfied(),
        "the others wait"
    );
}

#[test]
fn predicted_bricks_push_out_nothing_that_was_just_used() {
    let mut pager = Pager::new(SlotPool::new(4), ample());
    pager.begin_frame(&frame(&missing(0..4), &[]));
    settle(&mut pager, Completion::Decoded);
    let predicted = [
        request(7, RequestClass::Predicted, 9),
        request(8, RequestClass::Predicted, 9),
    ];
    pager.begin_frame(&frame(&predicted, &ids([0, 1, 2])));
    settle(&mut pager, Completion::Decoded);
    assert_eq!(
        resident(&pager),
        [0, 1, 2, 8].into(),
        "one slot was to spare"
    );
    assert_eq!(
        pager.state(brick(7)),
        BrickState::InRam,
        "the other is decoded ahead"
    );
}

#[test]
fn a_new_prediction_takes_the_place_of_the_one_before() {
    let predicted = |i: u32| request(i, RequestClass::Predicted, 1);
    let mut pager = Pager::new(SlotPool::new(4), ample());
    let before = [predicted(6), predicted(9)];
    let asked = [&missing([0, 3])[..], &before].concat();
    pager.begin_frame(&frame(&asked, &[]));
    pager.predict(&[predicted(3), predicted(9), predicted(12)]);
    settle(&mut pager, Completion::Decoded);
    assert_eq!(
        resident(&pager),
        [0, 3, 9, 12].into(),
        "what the frame missed, and what is predicted now"
    );
    pager.begin_frame(&frame(&[predicted(9), predicted(12)], &ids([0, 3])));
    pager.predict(&[predicted(12), predicted(15)]);
    settle(&mut pager, Completion::Decoded);
    assert_eq!(
        resident(&pager),
        [0, 3, 12, 15].into(),
        "what is predicted no more goes, what was used stays"
    );
    assert_eq!(pager.statistics().misses, 2, "and nothing else is missed");
}

#[test]
fn predicted_bricks_give_way_to_what_is_needed() {
    let mut pager = Pager::new(SlotPool::new(4), ample());
    let predicted = |i: u32| Request {
        // Sooner, the lower the number.
        priority: Priority::new(RequestClass::Predicted, 0, Lod(0), i),
        brick: brick(i),
    };
    let all: Vec<Request> = [0, 3, 6, 9].map(predicted).into();
    pager.begin_frame(&frame(&all, &[]));
    settle(&mut pager, Completion::Decoded);
    assert_eq!(resident(&pager), [0, 3, 6, 9].into(), "free slots are used");
    // The last pass used one of them, needs two more, and the same are predicted as before.
    let needed = missing([12, 15]);
    let requests = [&needed[..], &all[..], &[predicted(18)]].concat();
    pager.begin_frame(&FrameRequests {
        keep_touched: true,
        ..frame(&requests, &ids([9]))
    });
    settle(&mut pager, Completion::Decoded);
    assert_eq!(
        resident(&pager),
        [0, 9, 12, 15].into(),
        "those predicted for later went, and for what is needed alone"
    );
}

#[test]
fn orders_of_predicted_bricks_are_taken_back_for_what_is_needed() {
    let mut pager = Pager::new(SlotPool::new(8), budget(8, 2));
    let predicted = |i: u32| request(i, RequestClass::Predicted, 0);
    let foreseen = [predicted(0), predicted(1), predicted(2)];
    pager.begin_frame(&frame(&foreseen, &[]));
    let orders = pager.step(&[], StepLimits::NONE).load;
    assert_eq!(orders.len(), 2, "as many as may be in flight");
    assert_eq!(pager.yielding_orders().count(), 0, "nothing else is needed");
    let requests = [&missing([9])[..], &foreseen].concat();
    pager.begin_frame(&frame(&requests, &[]));
    let mut yielding: Vec<BrickId> = pager.yielding_orders().collect();
    yielding.sort_unstable();
    let mut ordered = orders.clone();
    ordered.sort_unstable();
    assert_eq!(yielding, ordered, "both");
    // A thread has begun with the first of them.
    let plan = pager.step(&[Completion::Cancelled(orders[1])], StepLimits::NONE);
    assert_eq!(plan.load, ids([9]), "what is needed comes next");
    assert_eq!(
        pager.yielding_orders().count(),
        0,
        "nothing that is needed waits for its order"
    );
    let done = [
        Completion::Decoded(orders[0]),
        Completion::Decoded(brick(9)),
    ];
    let plan = pager.step(&done, StepLimits::NONE);
    assert!(
        plan.load.contains(&orders[1]),
        "the order taken back is given again: {:?}",
        plan.load
    );
}

// ---- the policy of eviction ---------------------------------------------------------------------------------------

/// Orbits from glassy to opaque.
const ORBITS: [(&str, Orbit); 4] = [
    ("glassy", orbit(16, 0.3, true)),
    ("hazy", orbit(16, 1.0, false)),
    ("dense", orbit(16, 2.5, false)),
    ("opaque", orbit(14, 5.0, true)),
];

const fn orbit(edge: i32, opacity: f64, has_levels: bool) -> Orbit {
    Orbit {
        edge,
        views: 36,
        rays: 48,
        opacity,
        has_levels,
    }
}

/// An atlas of 1.25 × the largest view keeps nearly what foresight keeps; one of a quarter of all views together keeps
/// more than LRU does.
#[test]
fn an_orbit_stays_near_foresight_and_beats_lru() {
    for (name, orbit) in ORBITS {
        let (trace, (largest, union)) = (orbit.trace(1), orbit.working_sets());
        let slots = largest * 5 / 4;
        let (ours, best) = (replay_policy(&trace, slots), replay_belady(&trace, slots));
        assert!(
            ours.hits as f64 >= 0.9 * best.hits as f64,
            "{name}: {ours:?} is far from {best:?}"
        );
        let slots = union / 4;
        let (ours, lru) = (replay_policy(&trace, slots), replay_lru(&trace, slots));
        assert!(
            ours.hits > lru.hits,
            "{name}: {ours:?} against LRU's {lru:?}"
        );
        let best = replay_belady(&trace, slots);
        assert!(best.hits >= ours.hits, "{name}: nothing beats foresight");
    }
}

/// The table of `src/pager/policy.rs`.
#[test]
#[ignore = "prints a table; checks nothing"]
fn policies() {
    for (depth, (name, orbit)) in [1, 2].into_iter().flat_map(|d| ORBITS.map(|o| (d, o))) {
        let (trace, (largest, union)) = (orbit.trace(depth), orbit.working_sets());
        for (atlas, slots) in [("1.25 views", largest * 5 / 4), ("¼ of all", union / 4)] {
            let row: Vec<Replay> = vec![
                replay_policy(&trace, slots),
                replay_lru(&trace, slots),
                replay(&trace, slots, &mut rivals::ByLastUse::mru()),
                replay(&trace, slots, &mut rivals::ByLastUse::random()),
                replay(&trace, slots, &mut rivals::TwoQueues::new(slots)),
                replay(&trace, slots, &mut rivals::AgedFrequency::new()),
                replay_belady(&trace, slots),
            ];
            let rates: Vec<String> = row.iter().map(|r| format!("{:.3}", r.hit_rate())).collect();
            println!(
                "//! | {name} {depth}, {atlas}: {slots} | {} |",
                rates.join(" | ")
            );
        }
    }
}

/// Rays through a small atlas, pass by pass: the engine's loop without an engine. Every view converges whatever the
/// atlas; one that fits is loaded once.
#[test]
fn views_converge_in_any_atlas() {
    let orbit = Orbit {
        edge: 8,
        views: 12,
        rays: 24,
        opacity: 0.5,
        has_levels: true,
    };
    let (largest, union) = orbit.working_sets();
    for (slots, ram) in [
        (9, 1),
        (9, 40),
        (largest / 2, 10),
        (largest * 5 / 4, 1000),
        (union, 1000),
    ] {
        let setup = Setup {
            slots: slots as u32,
            budget: budget(ram, 4),
        };
        let mut model = Model::new(setup, &[], Fault::Sound);
        let mut touched: BTreeSet<BrickId> = BTreeSet::new();
        for view in 0..orbit.views {
            let rays = orbit.view(view);
            let mut at = vec![0; rays.len()];
            let most = rays.iter().map(Vec::len).sum::<usize>();
            for pass in 0.. {
                assert!(pass <= most, "no ray moves");
                let resident = model.resident();
                let mut stopped: BTreeMap<BrickId, u32> = BTreeMap::new();
                let mut held = None;
                for (ray, at) in rays.iter().zip(&mut at) {
                    while let Some(next) = ray.get(*at).filter(|b| resident.contains(b)) {
                        touched.insert(*next);
                        *at += 1;
                    }
                    if let Some(&next) = ray.get(*at) {
                        held.get_or_insert(next);
                        *stopped.entry(next).or_default() += 1;
                    }
                }
                let used: Vec<BrickId> = std::mem::take(&mut touched).into_iter().collect();
                let requests: Vec<Request> = stopped
                    .iter()
                    .map(|(&brick, &rays)| Request {
                        priority: Priority::new(RequestClass::Missing, rays, brick.lod, 0),
                        brick,
                    })
                    .collect();
                let held: Vec<BrickId> = held.into_iter().collect();
                model.begin_frame(&FrameRequests {
                    requests: &requests,
                    held: &held,
                    touched: &used,
                    keep_touched: false,
                });
                if requests.is_empty() {
                    break;
                }
                let mut completions = Vec::new();
                while !model.pager.is_placed() {
                    model.step(&completions, StepLimits::NONE).unwrap();
                    completions = model
                        .in_flight
                        .iter()
                        .copied()
                        .map(Completion::Decoded)
                        .collect();
                }
            }
        }
        assert!(
            slots < union || model.loads == union as u64,
            "what fits is read once"
        );
    }
}

// ---- the loader ---------------------------------------------------------------------------------------------------

/// A small store, and the folder that it lies in.
fn small_store() -> (tempfile::TempDir, Arc<Store>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.bsk");
    let mut source = brickscope::input::open("phantom:body:96,96,96", &Default::default()).unwrap();
    bricking::brick(
        source.as_mut(),
        &path,
        &BrickOptions::default(),
        &NoProgress,
    )
    .unwrap();
    let store = Arc::new(Store::open(&path).unwrap());
    store.check_all_levels().unwrap();
    (folder, store)
}

#[test]
fn the_loader_reads_cancels_and_reports() {
    let (_folder, store) = small_store();
    let bricks: Vec<BrickId> = store
        .bricks(Lod(0))
        .filter(|b| store.entry(*b).record.is_some())
        .take(6)
        .collect();
    let (open, gate) = crossbeam_channel::unbounded::<()>();
    let (arrived, arrivals) = crossbeam_channel::unbounded::<BrickId>();
    let (path, bad) = (store.path().to_owned(), bricks[1]);
    let hook: ReadHook = Arc::new(move |brick| {
        arrived.send(brick).unwrap();
        // Once its other end is gone, the gate stands open.
        let _ = gate.recv();
        if brick == bad {
            let found = "a made-up fault".into();
            return Err(StoreError::NotAStore {
                path: path.clone(),
                found,
            });
        }
        Ok(())
    });
    let mut loader = Loader::with_hook(Arc::clone(&store), 1, hook).unwrap();
    assert!(
        loader.receive().is_none() && loader.try_receive().is_none(),
        "nothing was ordered"
    );
    loader.order(bricks[0]);
    loader.order_all(&bricks[1..]);
    assert_eq!(loader.in_flight(), 6, "six are under way");
    assert_eq!(
        arrivals.recv().unwrap(),
        bricks[0],
        "the thread has the first"
    );
    assert!(!loader.cancel(bricks[0]), "which can't be taken back");
    assert!(
        loader.cancel(bricks[3]) && !loader.cancel(bricks[3]),
        "another can, once"
    );
    assert_eq!(loader.in_flight(), 5, "five are left");
    assert!(
        loader.receive_timeout(Duration::from_millis(20)).is_none(),
        "the gate is closed"
    );
    for _ in 0..5 {
        open.send(()).unwrap();
    }
    let mut reader = brickscope::store::BrickReader::new().unwrap();
    for &brick in [0, 1, 2, 4, 5].map(|i| &bricks[i]) {
        let (got, result) = loader.receive().unwrap();
        assert_eq!(got, brick, "one thread keeps the order");
        match result {
            Ok(data) => assert_eq!(
                data.voxels,
                store.read_brick(brick, &mut reader).unwrap().voxels,
                "{brick}"
            ),
            Err(error) => assert_eq!(brick, bad, "{error}"),
        }
    }
    assert_eq!(loader.in_flight(), 0, "all came");
    assert!(
        loader.receive_timeout(Duration::from_secs(60)).is_none(),
        "and none is waited for"
    );

    // Dropped with orders waiting, it ends after the brick in hand.
    loader.order_all(&bricks);
    open.send(()).unwrap();
    drop(open);
    drop(loader);
}
