//! Bricking against a dense model: every voxel of every brick of every level, for all types and odd sizes.

#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/memory_source.rs"]
mod memory_source;

use std::path::Path;

use brickscope::bricking::{self, BrickError, BrickOptions, BrickingReport, NoProgress};
use brickscope::geom::{Lod, STORED_VOXELS, VoxelBox};
use brickscope::store::{BrickReader, Store, StoreError};
use brickscope::volume::{SourceError, StoredType, VoxelType};
use glam::U64Vec3;
use memory_source::{MemorySource, voxels};
use proptest::prelude::*;

fn brick(
    source: &mut MemorySource,
    out: &Path,
    options: &BrickOptions,
) -> Result<BrickingReport, BrickError> {
    bricking::brick(source, out, options, &NoProgress)
}

/// Small memory, two threads.
fn options() -> BrickOptions {
    BrickOptions {
        memory_bytes: 128 << 20,
        threads: Some(2),
        ..BrickOptions::default()
    }
}

/// Stored values of a level, as numbers.
fn dense(store: &Store, lod: Lod) -> Vec<f64> {
    let whole = VoxelBox::whole(store.level(lod).grid.voxels);
    let size = store.stored_type().size();
    let mut bytes = vec![0; whole.voxel_count().unwrap() as usize * size];
    let mut reader = BrickReader::new().unwrap();
    store.read_box(lod, whole, &mut reader, &mut bytes).unwrap();
    numbers(store.stored_type(), &bytes)
}

fn numbers(stored_type: StoredType, bytes: &[u8]) -> Vec<f64> {
    match stored_type {
        StoredType::U8 => bytes.iter().map(|&b| b.into()).collect(),
        StoredType::U16 => {
            let (chunks, _) = bytes.as_chunks();
            chunks
                .iter()
                .map(|b| u16::from_le_bytes(*b).into())
                .collect()
        }
        StoredType::F32 => {
            let (chunks, _) = bytes.as_chunks();
            chunks
                .iter()
                .map(|b| f32::from_le_bytes(*b).into())
                .collect()
        }
    }
}

/// What the source's voxels should be when stored, by the documented rule.
fn expected_level_0(voxel_type: VoxelType, bytes: &[u8]) -> Vec<f64> {
    macro_rules! read {
        ($t:ty, $map:expr) => {
            bytes
                .as_chunks::<{ size_of::<$t>() }>()
                .0
                .iter()
                .map(|b| $map(<$t>::from_le_bytes(*b)))
                .collect()
        };
    }
    match voxel_type {
        VoxelType::U8 => read!(u8, f64::from),
        VoxelType::I8 => read!(i8, |v| f64::from(v) + 128.0),
        VoxelType::U16 => read!(u16, f64::from),
        VoxelType::I16 => read!(i16, |v| f64::from(v) + 32768.0),
        VoxelType::U32 => read!(u32, |v| f64::from(v as f32)),
        VoxelType::I32 => read!(i32, |v| f64::from(v as f32)),
        VoxelType::F32 => read!(f32, f64::from),
        VoxelType::F64 => read!(f64, |v| f64::from(v as f32)),
    }
}

/// The box filter, written without any regard for speed.
fn naive_filter(
    fine: &[f64],
    dims: U64Vec3,
    coarse: U64Vec3,
    factor: [u64; 3],
    whole: bool,
) -> Vec<f64> {
    let mut out = Vec::new();
    for z in 0..coarse.z {
        for y in 0..coarse.y {
            for x in 0..coarse.x {
                let (mut sum, mut n) = (0.0, 0.0);
                for dz in 0..factor[2] {
                    for dy in 0..factor[1] {
                        for dx in 0..factor[0] {
                            let p = [x * factor[0] + dx, y * factor[1] + dy, z * factor[2] + dz];
                            if p[0] < dims.x && p[1] < dims.y && p[2] < dims.z {
                                sum += fine[((p[2] * dims.y + p[1]) * dims.x + p[0]) as usize];
                                n += 1.0;
                            }
                        }
                    }
                }
                let mean = sum / n;
                out.push(if whole { (mean + 0.5).floor() } else { mean });
            }
        }
    }
    out
}

/// Every brick of every level holds the true voxels, its border too; ranges hold; every level is the filter of the one
/// below; `verify` agrees.
fn check_store(store: &Store, level_0: &[f64]) {
    store.check_all_levels().unwrap();
    let stored_type = store.stored_type();
    let mut reader = BrickReader::new().unwrap();
    let mut below: Option<Vec<f64>> = None;
    for l in 0..store.levels() {
        let lod = Lod(l as u8);
        let level = *store.level(lod);
        let dims = level.grid.voxels;
        let values = dense(store, lod);
        match &below {
            None => assert_eq!(values, level_0, "level 0 holds the source's voxels"),
            Some(fine) => {
                let finer = store.level(Lod(l as u8 - 1));
                let factor = (level.scale / finer.scale).to_array().map(|f| f as u64);
                let whole = stored_type != StoredType::F32;
                let want = naive_filter(fine, finer.grid.voxels, dims, factor, whole);
                for (i, (got, want)) in values.iter().zip(&want).enumerate() {
                    let slack = if whole {
                        0.0
                    } else {
                        want.abs() * 1e-6 + 1e-30
                    };
                    assert!(
                        (got - want).abs() <= slack,
                        "{lod} voxel {i}: {got} for {want}"
                    );
                }
            }
        }
        for id in store.bricks(lod) {
            let data = store.read_brick(id, &mut reader).unwrap();
            let entry = store.entry(id);
            let brick = numbers(stored_type, &data.voxels);
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for (i, &got) in brick.iter().enumerate() {
                let place = [i % 34, i / 34 % 34, i / 1156];
                let p: [u64; 3] = std::array::from_fn(|a| {
                    let p = i64::from(id.xyz[a]) * 32 + place[a] as i64 - 1;
                    p.clamp(0, dims[a] as i64 - 1) as u64
                });
                let want = values[((p[2] * dims.y + p[1]) * dims.x + p[0]) as usize];
                assert_eq!(got, want, "{id}, place {place:?}");
                low = low.min(got);
                high = high.max(got);
                for (b, range) in blocks_around(place).zip(std::iter::repeat(&data.block_ranges)) {
                    let [from, to] = range[b];
                    assert!(
                        f64::from(from) <= got && got <= f64::from(to),
                        "{id}: block {b} holds {got} outside of {from} … {to}"
                    );
                }
            }
            assert_eq!(
                (entry.min.into(), entry.max.into()),
                (low, high),
                "{id}: range"
            );
            assert_eq!(entry.constant, low == high, "{id}: Constant");
            assert_eq!(brick.len(), STORED_VOXELS);
        }
        below = Some(values);
    }
    let coarsest = store.level(Lod(store.levels() as u8 - 1));
    assert_eq!(coarsest.grid.len(), 1, "the coarsest level is one brick");
    let report = bricking::verify(store, 10, &NoProgress).unwrap();
    assert_eq!(report.faults, [], "verify finds it sound");
}

/// The blocks whose 6³ voxels include this place.
fn blocks_around(place: [usize; 3]) -> impl Iterator<Item = usize> {
    let near = place.map(|p| (0..8).filter(move |b| (4 * b..4 * b + 6).contains(&p)));
    let [xs, ys, zs] = near.map(Iterator::collect::<Vec<usize>>);
    zs.into_iter().flat_map(move |z| {
        let xs = xs.clone();
        ys.clone()
            .into_iter()
            .flat_map(move |y| xs.clone().into_iter().map(move |x| (z * 8 + y) * 8 + x))
    })
}

fn round_trip(dims: [u64; 3], spacing: [f64; 3], voxel_type: VoxelType, seed: u32, blank: f64) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let n = dims.iter().product::<u64>() as usize;
    let bytes = voxels(voxel_type, n, seed, blank);
    let level_0 = expected_level_0(voxel_type, &bytes);
    let mut source = MemorySource::new(dims, voxel_type, bytes).with_spacing(spacing);
    let report = brick(&mut source, &out, &options()).unwrap();
    let store = Store::open(&out).unwrap();
    assert_eq!(report.voxels, n as u64);
    assert_eq!(report.bytes_out, store.file_len());
    check_store(&store, &level_0);
    // physical values are the source's, whatever the offset
    let meta = store.meta();
    let offset = f64::from(meta.conversion.offset);
    let source_value = level_0[0] - offset;
    assert_eq!(
        meta.rescale.physical(level_0[0]),
        meta.source_rescale.physical(source_value),
        "physical value of the first voxel"
    );
    assert_eq!(
        std::fs::read_dir(dir.path()).unwrap().count(),
        1,
        "nothing but the store"
    );
}

#[test]
fn all_types_and_odd_sizes() {
    let sizes = [
        [1, 1, 1],
        [33, 1, 2],
        [65, 40, 7],
        [1, 1, 65],
        [32, 33, 66],
        [64, 64, 33],
    ];
    for (i, voxel_type) in VoxelType::ALL.into_iter().enumerate() {
        for (j, dims) in sizes.into_iter().enumerate() {
            if (i + j) % 2 == 0 || voxel_type == VoxelType::U16 {
                round_trip(dims, [1.0; 3], voxel_type, (i * 10 + j) as u32, 0.2);
            }
        }
    }
}

#[test]
fn thick_slices() {
    round_trip([130, 70, 9], [1.0, 1.0, 5.0], VoxelType::U16, 5, 0.0);
    round_trip([9, 40, 130], [4.0, 1.0, 1.0], VoxelType::U8, 6, 0.5);
    round_trip([20, 20, 100], [1.0, 1.0, 10.0], VoxelType::F32, 7, 0.0);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_size_and_type(
        dims in [1u64..72, 1u64..72, 1u64..72],
        kind in 0usize..8,
        seed: u32,
        blank in 0.0f64..1.1,
        thick in 0usize..4,
    ) {
        let mut spacing = [1.0; 3];
        if thick < 3 {
            spacing[thick] = 3.0;
        }
        round_trip(dims, spacing, VoxelType::ALL[kind], seed, blank);
    }
}

#[test]
fn bytes_do_not_depend_on_threads_memory_or_order() {
    let dir = tempfile::tempdir().unwrap();
    let dims = [150, 90, 70];
    let bytes = voxels(VoxelType::F32, 150 * 90 * 70, 3, 0.3);
    let make = |name: &str, threads, memory_mib: u64, forward| {
        let mut source = MemorySource::new(dims, VoxelType::F32, bytes.clone());
        if forward {
            source = source.forward();
        }
        let out = dir.path().join(name);
        let options = BrickOptions {
            threads: Some(threads),
            memory_bytes: memory_mib << 20,
            ..options()
        };
        brick(&mut source, &out, &options).unwrap();
        std::fs::read(&out).unwrap()
    };
    let one = make("1", 1, 128, false);
    assert!(one == make("2", 4, 1024, false), "4 threads, more memory");
    assert!(one == make("3", 3, 160, true), "read forward");
}

#[test]
fn one_value_needs_no_records() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let mut source = MemorySource::new([100, 100, 100], VoxelType::I16, vec![0; 2_000_000]);
    let report = brick(&mut source, &out, &options()).unwrap();
    assert_eq!((report.kept_bricks, report.bricks), (0, 64 + 8 + 1));
    let store = Store::open(&out).unwrap();
    assert_eq!(store.header().records_len, 0, "all Constant");
    assert_eq!(store.meta().value_min, 32768.0, "0 + 32768");
    check_store(&store, &vec![32768.0; 1_000_000]);
}

#[test]
fn borders_and_levels_of_constant_and_mixed_bricks() {
    // One bright voxel beside a brick's face: the brick itself is all 0, its border is not.
    let mut bytes = vec![0; 64 * 64 * 64];
    bytes[(10 * 64 + 10) * 64 + 32] = 255;
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let mut source = MemorySource::new([64; 3], VoxelType::U8, bytes.clone());
    let report = brick(&mut source, &out, &options()).unwrap();
    assert_eq!(
        report.kept_bricks,
        2 + 1,
        "both sides of the face, and level 1"
    );
    let store = Store::open(&out).unwrap();
    check_store(&store, &expected_level_0(VoxelType::U8, &bytes));
}

#[test]
fn nan_and_infinity() {
    let n = 40 * 40 * 40;
    let mut bytes = voxels(VoxelType::F32, n, 8, 0.0);
    let mut want = expected_level_0(VoxelType::F32, &bytes);
    let (min, max) = want
        .iter()
        .fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
    for (i, v, becomes) in [
        (50_000, f32::NAN, min),
        (50_001, f32::INFINITY, max),
        (63_999, f32::NEG_INFINITY, min),
    ] {
        bytes[4 * i..4 * i + 4].copy_from_slice(&v.to_le_bytes());
        want[i] = becomes;
    }
    // What was overwritten above must not have been an end of the range.
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let mut source = MemorySource::new([40; 3], VoxelType::F32, bytes.clone());
    let report = brick(&mut source, &out, &options()).unwrap();
    assert_eq!(
        (report.conversion.nan_values, report.conversion.inf_values),
        (1, 2)
    );
    check_store(&Store::open(&out).unwrap(), &want);

    let again = dir.path().join("b.bsk");
    let forward = || MemorySource::new([40; 3], VoxelType::F32, bytes.clone()).forward();
    let refused = brick(&mut forward(), &again, &options());
    assert!(
        matches!(refused, Err(BrickError::FiniteRangeNeeded { .. })),
        "a stream can't be read twice: {refused:?}"
    );
    assert!(!again.exists(), "no output");
    let range = bricking::finite_range(&mut forward(), 3).unwrap();
    assert_eq!((range.min, range.max), (min, max), "the finite range");
    let options = BrickOptions {
        finite_range: Some(range),
        ..options()
    };
    brick(&mut forward(), &again, &options).unwrap();
    assert!(
        std::fs::read(&out).unwrap() == std::fs::read(&again).unwrap(),
        "both ways give the same store"
    );
}

#[test]
fn refusals_leave_nothing_behind() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let mut bytes = voxels(VoxelType::U16, 50 * 50 * 50, 2, 2.0);
    let at = (45 * 50 + 3) * 50 + 7;
    bytes[2 * at..2 * at + 2].copy_from_slice(&300u16.to_le_bytes());
    let mut source = MemorySource::new([50; 3], VoxelType::U16, bytes);
    let as_u8 = BrickOptions {
        store_type: Some(StoredType::U8),
        ..options()
    };
    match brick(&mut source, &out, &as_u8) {
        Err(BrickError::Value { voxel, value, .. }) => {
            assert_eq!((voxel, value), (U64Vec3::new(7, 3, 45), 300.0));
        }
        other => panic!("300 is no u8: {other:?}"),
    }
    source.fail_at = Some(47);
    let failed = brick(&mut source, &out, &options());
    assert!(
        matches!(
            failed,
            Err(BrickError::Source(SourceError::Malformed { .. }))
        ),
        "{failed:?}"
    );
    let left = std::fs::read_dir(dir.path()).unwrap().count();
    assert_eq!(left, 0, "no output, no scratch");
    source.fail_at = None;
    brick(&mut source, &out, &options()).unwrap();
    let before = std::fs::read(&out).unwrap();
    let refused = brick(&mut source, &out, &options());
    assert!(
        matches!(refused, Err(BrickError::Store(StoreError::Out(_)))),
        "an existing file is kept: {refused:?}"
    );
    assert!(std::fs::read(&out).unwrap() == before, "untouched");
}

#[test]
fn losses_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.bsk");
    let bytes: Vec<u8> = [1u32, 16_777_217, 16_777_216, 16_777_219]
        .into_iter()
        .flat_map(u32::to_le_bytes)
        .collect();
    let mut source = MemorySource::new([4, 1, 1], VoxelType::U32, bytes);
    let report = brick(&mut source, &out, &options()).unwrap();
    assert_eq!(report.conversion.lossy_values, 2, "two of four are no f32");
    let store = Store::open(&out).unwrap();
    assert!(!store.meta().conversion.is_exact(), "the store says so");
}
