//! What a change of the classification costs on the host, by parts: the look-up table, the scan of a level's index, the
//! occupancy of bricks whose block ranges are known, and the bounding mesh of what is active. All but the mesh run on one
//! thread.
//!
//! Data: level 0 of `phantom:body`, 512³, u16: 4096 bricks. "bone" is a ramp that begins at .6 of full scale, "ramp" one
//! from 0 on: few bricks are visible, and all but air. Does not measure: sending tables and mesh to the GPU, and drawing
//! (`cargo bench --bench paging` times whole edits).
//!
//! `cargo bench --bench classify_mesh`

mod support;

use brickscope::classify::{
    Lut, Occupancy, OpacityCorrection, TransferFunction, TransferIntegrals, Visibility, grey_ramp,
};
use brickscope::geom::{BLOCKS_PER_BRICK, BrickId, Lod};
use brickscope::pager::scan;
use brickscope::proxy::{ActiveBlocks, Granularity, bounding_mesh};
use brickscope::store::{BrickReader, Store};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

const EDGE: u64 = 512;
const FULL_SCALE: f64 = 4095.0;
const IDENTITY: (f64, f64) = (1.0, 0.0);
const CORRECTION: OpacityCorrection = OpacityCorrection::Step {
    step_mm: 0.5,
    unit_mm: 1.0,
};

fn ramp(from: f64) -> TransferFunction {
    grey_ramp(from * FULL_SCALE, FULL_SCALE, 0.5).expect("a rising ramp")
}

fn bake(transfer: &TransferFunction) -> Lut {
    let domain = Lut::fitted_domain(transfer, IDENTITY, [0.0, FULL_SCALE]);
    Lut::bake(transfer, IDENTITY, domain, CORRECTION)
}

/// The classifications of the benches, by name.
fn visibilities() -> [(&'static str, Visibility); 3] {
    let iso = (0.7 * FULL_SCALE) as f32;
    [
        ("dvr, bone", Visibility::opacity(&bake(&ramp(0.6)))),
        ("dvr, ramp", Visibility::opacity(&bake(&ramp(0.0)))),
        ("iso", Visibility::iso(&[iso], [0.0, FULL_SCALE as f32])),
    ]
}

/// The block ranges of all bricks of level 0 with a record.
fn known_ranges(store: &Store) -> Vec<(BrickId, Box<[[f32; 2]; BLOCKS_PER_BRICK]>)> {
    let mut reader = BrickReader::new().expect("memory for zstd");
    support::kept_bricks(store)
        .into_iter()
        .map(|id| {
            let data = store.read_brick(id, &mut reader).expect("a sound brick");
            let ranges = data.block_ranges.into_boxed_slice();
            (id, ranges.try_into().expect("a range for each block"))
        })
        .collect()
}

fn classification(criterion: &mut Criterion) {
    let mut group = support::group(criterion, "classify/table");
    let transfer = ramp(0.6);
    group.bench_function("look-up table", |bencher| {
        bencher.iter(|| bake(black_box(&transfer)));
    });
    let lut = bake(&transfer);
    group.bench_function("visibility of it", |bencher| {
        bencher.iter(|| Visibility::opacity(black_box(&lut)));
    });
    // What an edit of a pre-integrated picture costs per step length; one of 256² for 8 bits, of 1024² for others.
    for side in [256, 1024] {
        group.bench_function(format!("table of integrals, {side}²"), |bencher| {
            bencher.iter(|| {
                let domain = [0.0, FULL_SCALE];
                TransferIntegrals::new(black_box(&transfer), IDENTITY, domain, side, 1.0).table(1.0)
            });
        });
    }
    group.finish();

    let (_folder, store) = support::body_store::<u16>(EDGE);
    let mut group = support::group(criterion, "classify/scan of the index");
    group.throughput(Throughput::Elements(store.level(Lod(0)).grid.len()));
    for (name, visibility) in visibilities() {
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                scan(&store, Lod(0), &visibility)
                    .filter(|brick| brick.visible)
                    .count()
            });
        });
    }
    group.finish();

    let known = known_ranges(&store);
    let mut group = support::group(criterion, "classify/occupancy");
    group.throughput(Throughput::Elements(
        (known.len() * BLOCKS_PER_BRICK) as u64,
    ));
    for (name, visibility) in visibilities() {
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for (_, ranges) in &known {
                    black_box(Occupancy::from_ranges(ranges, &visibility));
                }
            });
        });
    }
    group.finish();

    // Volumes of bytes: ranges by prefix sums, and by the table made of these.
    let ramp = grey_ramp(0.6 * 255.0, 255.0, 0.5).expect("a rising ramp");
    let domain = Lut::fitted_domain(&ramp, IDENTITY, [0.0, 255.0]);
    let counted = Visibility::opacity(&Lut::bake(&ramp, IDENTITY, domain, CORRECTION));
    let known: Vec<_> = known
        .iter()
        .map(|(_, ranges)| ranges.map(|r| r.map(|v| (v * (255.0 / FULL_SCALE as f32)).floor())))
        .collect();
    let mut group = support::group(criterion, "classify/occupancy of bytes");
    group.throughput(Throughput::Elements(
        (known.len() * BLOCKS_PER_BRICK) as u64,
    ));
    group.bench_function("table made", |bencher| {
        bencher.iter(|| black_box(&counted).clone().of_bytes());
    });
    for (name, visibility) in [
        ("by prefix sums", counted.clone()),
        ("by the table", counted.clone().of_bytes()),
    ] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for ranges in &known {
                    black_box(Occupancy::from_ranges(ranges, &visibility));
                }
            });
        });
    }
}

fn mesh_extraction(criterion: &mut Criterion) {
    let (_folder, store) = support::body_store::<u16>(EDGE);
    let known = known_ranges(&store);
    let grid = store.level(Lod(0)).grid;
    let mut group = support::group(criterion, "mesh");
    for (name, visibility) in visibilities() {
        let occupied = || {
            known
                .iter()
                .map(|(id, ranges)| (id.xyz, Occupancy::from_ranges(ranges, &visibility)))
        };
        let active = ActiveBlocks::new(grid, occupied()).expect("bricks of the level");
        group.throughput(Throughput::Elements(active.len() as u64));
        for (size, granularity) in [
            ("blocks", Granularity::Blocks),
            ("bricks", Granularity::Bricks),
        ] {
            let triangles = bounding_mesh(&active, granularity)
                .expect("a small mesh")
                .triangle_count();
            eprintln!("mesh/{name}, {size}: {triangles} triangles");
            group.bench_function(format!("{name}, {size}"), |bencher| {
                bencher.iter(|| bounding_mesh(black_box(&active), granularity));
            });
        }
    }
}

criterion_group!(benches, classification, mesh_extraction);
criterion_main!(benches);
