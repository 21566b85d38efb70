//! What reading a store costs: opening it, checking a level's index, reading and decoding bricks on one thread, and
//! through the loader's threads.
//!
//! Data: `phantom:body`, 256³, its store in the page cache; only bricks with a record are read, each once a pass. Bytes are
//! those of the decoded voxels, borders included. Does not measure: the disk (`cargo bench --bench paging` drops the page
//! cache), nor copies to the GPU.
//!
//! `cargo bench --bench store_read`

mod support;

use std::sync::Arc;

use brickscope::geom::{Lod, STORED_VOXELS};
use brickscope::pager::Loader;
use brickscope::store::{BrickData, BrickReader, Store, Voxel};
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};

const EDGE: u64 = 256;

fn open(criterion: &mut Criterion) {
    let (_folder, store) = support::body_store::<u16>(EDGE);
    let mut group = support::group(criterion, "store/open");
    group.bench_function("header and metadata", |bencher| {
        bencher.iter(|| Store::open(store.path()).expect("a sound store"));
    });
    group.throughput(Throughput::Elements(store.level(Lod(0)).grid.len()));
    group.bench_function("check of level 0's index", |bencher| {
        // A level is checked once per opened store.
        bencher.iter_batched(
            || Store::open(store.path()).expect("a sound store"),
            |fresh| {
                fresh.check_level(Lod(0)).expect("a sound index");
                fresh
            },
            BatchSize::SmallInput,
        );
    });
}

fn decode(criterion: &mut Criterion) {
    fn of<T: Voxel>(criterion: &mut Criterion) {
        let (_folder, store) = support::body_store::<T>(EDGE);
        let bricks = support::kept_bricks(&store);
        let mut reader = BrickReader::new().expect("memory for zstd");
        let mut data = BrickData::default();
        let mut group = support::group(criterion, "store/read and decode, one thread");
        group.throughput(Throughput::Bytes(
            (bricks.len() * STORED_VOXELS * size_of::<T>()) as u64,
        ));
        group.bench_function(T::TYPE.voxel_type().name(), |bencher| {
            bencher.iter(|| {
                for &id in &bricks {
                    store
                        .read_brick_into(id, &mut reader, &mut data)
                        .expect("a sound brick");
                }
            });
        });
    }
    of::<u8>(criterion);
    of::<u16>(criterion);
    of::<f32>(criterion);
}

fn loader(criterion: &mut Criterion) {
    let (_folder, store) = support::body_store::<u16>(EDGE);
    let bricks = support::kept_bricks(&store);
    let store = Arc::new(store);
    let mut group = support::group(criterion, "store/loader, u16");
    group.throughput(Throughput::Bytes(
        (bricks.len() * STORED_VOXELS * size_of::<u16>()) as u64,
    ));
    for threads in [1, 2, 4] {
        let mut loader = Loader::new(Arc::clone(&store), threads).expect("threads");
        group.bench_function(format!("{threads} threads"), |bencher| {
            bencher.iter(|| {
                loader.order_all(&bricks);
                for _ in &bricks {
                    let (_, data) = loader.receive().expect("as many as ordered");
                    data.expect("a sound brick");
                }
            });
        });
    }
}

criterion_group!(benches, open, decode, loader);
criterion_main!(benches);
