//! What the pager decides costs: a frame's requests taken in, slots given, loads ordered, evictions chosen.
//!
//! A camera circles in a level of 64³ bricks (2048³ voxels) in 36 views, and in each sees a ball of 2109 bricks, of which
//! about a third are new. Loads complete in the step after they were ordered. Bricks of u16 voxels, the
//! budget of two decode threads. Does not measure: decoding, copies, the GPU, and the making of requests from rays.
//!
//! `cargo bench --bench pager_update`

mod support;

use brickscope::geom::{BLOCKS_PER_BRICK, BrickId, Lod, STORED_VOXELS};
use brickscope::pager::{
    BrickState, Completion, FrameRequests, Pager, PagerBudget, Plan, Priority, Request,
    RequestClass, SlotPool, StepLimits,
};
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::{IVec3, UVec3};
use std::hint::black_box;

const VIEWS: usize = 36;
const GRID: i32 = 64;
const RADIUS: i32 = 8;
const MAX_DECODING: usize = 8;

/// The bricks of each view, with their squared distance from its middle.
fn views() -> Vec<Vec<(BrickId, u32)>> {
    let ball: Vec<IVec3> = (-RADIUS..=RADIUS)
        .flat_map(|z| {
            (-RADIUS..=RADIUS)
                .flat_map(move |y| (-RADIUS..=RADIUS).map(move |x| IVec3::new(x, y, z)))
        })
        .filter(|place| place.length_squared() <= RADIUS * RADIUS)
        .collect();
    (0..VIEWS)
        .map(|view| {
            let angle = std::f64::consts::TAU * view as f64 / VIEWS as f64;
            let reach = f64::from(GRID / 2 - RADIUS - 1);
            let on_circle = |turned: f64| GRID / 2 + (reach * turned).round() as i32;
            let middle = IVec3::new(on_circle(angle.sin()), GRID / 2, on_circle(angle.cos()));
            ball.iter()
                .map(|&place| {
                    let xyz: UVec3 = (middle + place).try_into().expect("inside the grid");
                    (BrickId::new(Lod(0), xyz), place.length_squared() as u32)
                })
                .collect()
        })
        .collect()
}

fn pager(slots: usize) -> Pager {
    let brick_bytes =
        (STORED_VOXELS * size_of::<u16>() + size_of::<[[f32; 2]; BLOCKS_PER_BRICK]>()) as u64;
    let budget = PagerBudget {
        ram_bytes: 1 << 30,
        in_flight_bytes: MAX_DECODING as u64 * brick_bytes,
        max_decoding: MAX_DECODING,
        brick_bytes,
    };
    Pager::new(SlotPool::new(slots as u32), budget)
}

/// What a view without a slot asks for.
fn requests(pager: &Pager, view: &[(BrickId, u32)]) -> Vec<Request> {
    view.iter()
        .filter(|(brick, _)| !matches!(pager.state(*brick), BrickState::Resident(_)))
        .map(|&(brick, distance)| Request {
            priority: Priority::new(RequestClass::Missing, 64, brick.lod, distance),
            brick,
        })
        .collect()
}

/// Steps until the frame has what it can get.
fn settle(pager: &mut Pager) {
    let mut completions: Vec<Completion> = Vec::new();
    loop {
        let plan: Plan = pager.step(&completions, StepLimits::NONE);
        completions.clear();
        completions.extend(plan.load.iter().copied().map(Completion::Decoded));
        if completions.is_empty() && pager.is_idle() {
            break;
        }
    }
}

fn turn(pager: &mut Pager, views: &[Vec<(BrickId, u32)>]) {
    for (number, view) in views.iter().enumerate() {
        let last: Vec<BrickId> = views[(number + VIEWS - 1) % VIEWS]
            .iter()
            .map(|&(brick, _)| brick)
            .collect();
        let asked = requests(pager, view);
        pager.begin_frame(&FrameRequests {
            requests: &asked,
            touched: &last,
            ..FrameRequests::default()
        });
        settle(pager);
    }
}

fn frames(criterion: &mut Criterion) {
    let views = views();
    let seen = views[0].len();
    let mut group = support::group(criterion, "pager/a turn of 36 views");
    group.throughput(Throughput::Elements((VIEWS * seen) as u64));
    for (name, slots) in [
        ("1.25 views in slots", seen + seen / 4),
        ("half a view in slots", seen / 2),
    ] {
        // Warm: the turn before has filled slots and host memory.
        let mut pager = pager(slots);
        turn(&mut pager, &views);
        group.bench_function(name, |bencher| bencher.iter(|| turn(&mut pager, &views)));
    }
}

fn frame_with_all_resident(criterion: &mut Criterion) {
    let view = views().swap_remove(0);
    let touched: Vec<BrickId> = view.iter().map(|&(brick, _)| brick).collect();
    let mut pager = pager(touched.len() + touched.len() / 4);
    let asked = requests(&pager, &view);
    pager.begin_frame(&FrameRequests {
        requests: &asked,
        ..FrameRequests::default()
    });
    settle(&mut pager);
    let mut group = support::group(criterion, "pager/one frame");
    group.throughput(Throughput::Elements(touched.len() as u64));
    group.bench_function("all resident", |bencher| {
        bencher.iter(|| {
            pager.begin_frame(&FrameRequests {
                touched: &touched,
                ..FrameRequests::default()
            });
            black_box(pager.step(&[], StepLimits::NONE));
        });
    });
}

fn first_step(criterion: &mut Criterion) {
    let view = views().swap_remove(0);
    let mut group = support::group(criterion, "pager/first step of an empty atlas");
    group.throughput(Throughput::Elements(view.len() as u64));
    group.bench_function("all missing", |bencher| {
        bencher.iter_batched(
            || {
                let pager = pager(view.len());
                let asked = requests(&pager, &view);
                (pager, asked)
            },
            |(mut pager, asked)| {
                pager.begin_frame(&FrameRequests {
                    requests: &asked,
                    ..FrameRequests::default()
                });
                black_box(pager.step(&[], StepLimits::NONE));
                pager
            },
            BatchSize::SmallInput,
        );
    });
}

criterion_group!(benches, frames, frame_with_all_resident, first_step);
criterion_main!(benches);
