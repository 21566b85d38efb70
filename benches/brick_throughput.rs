//! What bricking costs, and its parts: the whole pass on all cores, and on one core the box filter between levels, the
//! ranges of a brick's blocks, and a brick's record (ranges, byte shuffle, zstd, checksum).
//!
//! Data: `phantom:body` in memory, 512³ for the pass (seven in ten of its bricks are of one value, which costs little). The pass writes the
//! store to the folder of temporary files and syncs it, as `brick` does. Does not measure: reading an input, and what a
//! volume larger than memory costs.
//!
//! `cargo bench --bench brick_throughput`

mod support;

use brickscope::bricking::downsample::{Mean, coarse_slices};
use brickscope::bricking::{BrickOptions, NoProgress, brick};
use brickscope::geom::STORED_VOXELS;
use brickscope::store::codec::BlockRanges;
use brickscope::store::{Existing, Voxel};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

const VOLUME_EDGE: u64 = 512;
const PART_EDGE: u64 = 128;

fn whole_pass(criterion: &mut Criterion) {
    fn of<T: Voxel>(criterion: &mut Criterion) {
        let mut source = support::body::<T>(VOLUME_EDGE);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("body.bsk");
        let options = BrickOptions {
            existing: Existing::Replace,
            ..BrickOptions::default()
        };
        let mut group = support::group(criterion, "brick/whole pass");
        group
            .sample_size(10)
            .throughput(Throughput::Bytes(source.bytes.len() as u64));
        group.bench_function(T::TYPE.voxel_type().name(), |bencher| {
            bencher.iter(|| brick(&mut source, &path, &options, &NoProgress).expect("a store"));
        });
    }
    of::<u8>(criterion);
    of::<u16>(criterion);
    of::<f32>(criterion);
}

fn downsampling(criterion: &mut Criterion) {
    fn of<T: Mean>(criterion: &mut Criterion) {
        let voxels = support::body_voxels::<T>(PART_EDGE);
        let mut group = support::group(criterion, "brick/downsampling");
        group.throughput(Throughput::Elements(voxels.len() as u64));
        group.bench_function(T::TYPE.voxel_type().name(), |bencher| {
            bencher.iter(|| {
                coarse_slices(&voxels, [PART_EDGE as usize; 3], [true; 3], |slice| {
                    black_box(slice);
                });
            });
        });
    }
    of::<u8>(criterion);
    of::<u16>(criterion);
    of::<f32>(criterion);
}

fn block_ranges(criterion: &mut Criterion) {
    fn of<T: Voxel>(criterion: &mut Criterion) {
        let voxels = support::middle_brick::<T>(PART_EDGE);
        let mut ranges = BlockRanges::default();
        let mut group = support::group(criterion, "brick/block ranges");
        group.throughput(Throughput::Elements(STORED_VOXELS as u64));
        group.bench_function(T::TYPE.voxel_type().name(), |bencher| {
            bencher.iter(|| {
                ranges.measure(black_box(&voxels));
                black_box(&ranges);
            });
        });
    }
    of::<u8>(criterion);
    of::<u16>(criterion);
    of::<f32>(criterion);
}

fn record(criterion: &mut Criterion) {
    fn of<T: Voxel>(criterion: &mut Criterion) {
        let voxels = support::middle_brick::<T>(PART_EDGE);
        let mut encoder = support::encoder::<T>();
        let mut group = support::group(criterion, "brick/record");
        group.throughput(Throughput::Bytes((STORED_VOXELS * size_of::<T>()) as u64));
        group.bench_function(T::TYPE.voxel_type().name(), |bencher| {
            bencher.iter_with_large_drop(|| {
                encoder.encode(black_box(&voxels)).expect("memory for zstd")
            });
        });
    }
    of::<u8>(criterion);
    of::<u16>(criterion);
    of::<f32>(criterion);
}

criterion_group!(benches, whole_pass, downsampling, block_ranges, record);
criterion_main!(benches);
