//! What the criterion benches measure on: phantoms in memory, stores of them in a folder of their own.

#![allow(
    dead_code,
    reason = "each bench is a program of its own and uses a part"
)]

#[path = "../../tests/support/memory_source.rs"]
pub mod memory_source;

use std::time::Duration;

use brickscope::bricking::border::{Window, cut};
use brickscope::bricking::{BrickOptions, NoProgress, brick};
use brickscope::geom::{BRICK_EDGE, BrickId, Lod, STORED_VOXELS, VoxelBox};
use brickscope::input::phantom::Phantom;
use brickscope::store::codec::BrickEncoder;
use brickscope::store::{Store, Voxel};
use brickscope::volume::VoxelSource;
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion};
use glam::{U64Vec3, UVec3};
use memory_source::MemorySource;
use tempfile::TempDir;

/// A group whose benches together stay well under a minute.
pub fn group<'a>(criterion: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = criterion.benchmark_group(name);
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    group
}

/// `phantom:body` as a cube of `edge` voxels of type `T`, all of it in memory.
pub fn body<T: Voxel>(edge: u64) -> MemorySource {
    let spec = format!(
        "phantom:body:{edge},{edge},{edge}:{}",
        T::TYPE.voxel_type().name()
    );
    let mut phantom = Phantom::from_spec(&spec).expect("a phantom");
    let desc = phantom.desc().clone();
    let mut bytes = vec![0; desc.byte_count().expect("a small volume") as usize];
    let whole = VoxelBox::new(U64Vec3::ZERO, desc.dims);
    phantom
        .read_box(whole, &mut bytes)
        .expect("computed voxels");
    MemorySource::new(desc.dims.to_array(), desc.voxel_type, bytes)
}

/// The voxels of [`body`].
pub fn body_voxels<T: Voxel>(edge: u64) -> Vec<T> {
    let source = body::<T>(edge);
    let mut voxels = vec![T::default(); source.bytes.len() / size_of::<T>()];
    T::read_le(&source.bytes, &mut voxels);
    voxels
}

/// The brick with its border in the middle of [`body`]: noisy tissue of several kinds, so nothing of it is constant.
pub fn middle_brick<T: Voxel>(edge: u64) -> Box<[T; STORED_VOXELS]> {
    let voxels = body_voxels::<T>(edge);
    let level = U64Vec3::splat(edge);
    let window = Window {
        level,
        held: VoxelBox::new(U64Vec3::ZERO, level),
        voxels: &voxels,
    };
    let mut out = Box::new([T::default(); STORED_VOXELS]);
    cut(
        &window,
        UVec3::splat(edge as u32 / BRICK_EDGE / 2),
        &mut out,
    );
    out
}

/// A store of [`body`]; it is there as long as the folder is.
pub fn body_store<T: Voxel>(edge: u64) -> (TempDir, Store) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("body.bsk");
    brick(
        &mut body::<T>(edge),
        &path,
        &BrickOptions::default(),
        &NoProgress,
    )
    .expect("a store");
    let store = Store::open(&path).expect("a sound store");
    store.check_all_levels().expect("a sound index");
    (folder, store)
}

/// The bricks of level 0 that have a record: the others cost nothing to read.
pub fn kept_bricks(store: &Store) -> Vec<BrickId> {
    store
        .bricks(Lod(0))
        .filter(|&id| !store.entry(id).constant)
        .collect()
}

/// An encoder of the level that bricking takes by default.
pub fn encoder<T: Voxel>() -> BrickEncoder<T> {
    BrickEncoder::new(BrickOptions::default().zstd_level).expect("memory for zstd")
}
