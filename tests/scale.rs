//! Sizes at which 32-bit counts and O(bricks) habits would show: more than 2³² voxels, and 10⁷ bricks in an index.
//!
//! The large ones are ignored by default; they need a release build and half a minute:
//! `cargo test --release --test scale -- --ignored --nocapture --test-threads 1`

#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

use std::path::Path;
use std::time::Instant;

use brickscope::bricking::{self, BrickOptions, NoProgress, plan};
use brickscope::export;
use brickscope::geom::{BrickGrid, BrickId, Lod, STORED_VOXELS, VoxelBox};
use brickscope::outfile::Existing;
use brickscope::store::codec::{BrickEncoder, EncodedBrick};
use brickscope::store::meta::HISTOGRAM_BINS;
use brickscope::store::{
    BrickReader, Conversion, Histogram, LevelMeta, Percentiles, Store, StoreMeta, StoreWriter,
};
use brickscope::volume::{
    ReadOrder, Rescale, SourceError, StoredType, VolumeDesc, VoxelSource, VoxelType,
};
use glam::{DAffine3, DVec3, U64Vec3, UVec3};

const FILL: u8 = 7;

/// Writes a store of u8 voxels in which every brick is Constant but one of level 0, which is given.
fn mostly_constant(path: &Path, dims: [u64; 3], other: Option<(UVec3, &[u8; STORED_VOXELS])>) {
    let dims = U64Vec3::from(dims);
    let levels = plan::levels("t", dims, DVec3::ONE, None).unwrap();
    let grids: Vec<BrickGrid> = levels.iter().map(|l| l.grid).collect();
    let mut writer = StoreWriter::create(path, Existing::Refuse, StoredType::U8, &grids).unwrap();
    let constant = EncodedBrick {
        min: FILL.into(),
        max: FILL.into(),
        record: None,
        crc: 0,
    };
    let encoded =
        other.map(|(xyz, voxels)| (xyz, BrickEncoder::new(1).unwrap().encode(voxels).unwrap()));
    for (l, grid) in grids.iter().enumerate() {
        for i in 0..grid.len() {
            let id = BrickId::new(Lod(l as u8), grid.xyz(i));
            let brick = match &encoded {
                Some((xyz, brick)) if l == 0 && *xyz == id.xyz => brick,
                _ => &constant,
            };
            writer.push(id, brick).unwrap();
        }
    }
    let count = VoxelBox::whole(dims).voxel_count().unwrap();
    let mut counts = vec![0; HISTOGRAM_BINS];
    counts[0] = count;
    let meta = StoreMeta {
        dims,
        source_type: VoxelType::U8,
        stored_type: StoredType::U8,
        conversion: Conversion::default(),
        rescale: Rescale::IDENTITY,
        source_rescale: Rescale::IDENTITY,
        world_from_index: DAffine3::IDENTITY,
        unit: String::new(),
        value_min: FILL.into(),
        value_max: FILL.into(),
        histogram: Histogram {
            start: FILL.into(),
            width: 1.0,
            counts,
        },
        percentiles: Percentiles::default(),
        levels: levels
            .iter()
            .map(|l| LevelMeta {
                dims: l.grid.voxels,
                scale: l.scale,
            })
            .collect(),
        source_name: "constant".into(),
        source_hash: 0,
        writer: "test".into(),
        tags: Default::default(),
    };
    writer.finish(&meta).unwrap();
}

/// The least of some times, in milliseconds.
fn best_ms(mut work: impl FnMut()) -> f64 {
    let times = (0..5).map(|_| {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64() * 1e3
    });
    times.fold(f64::INFINITY, f64::min)
}

/// Opening does not touch the index; checking a level reads it once. Returns both times, in milliseconds.
fn open_and_check(edge_voxels: u64) -> (u64, f64, f64) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("many.bsk");
    mostly_constant(&path, [edge_voxels; 3], None);
    let bricks = Store::open(&path).unwrap().level(Lod(0)).grid.len();
    let open_ms = best_ms(|| drop(Store::open(&path).unwrap()));
    let mut check_ms = f64::INFINITY;
    for _ in 0..3 {
        let store = Store::open(&path).unwrap();
        let begin = Instant::now();
        store.check_level(Lod(0)).unwrap();
        check_ms = check_ms.min(begin.elapsed().as_secs_f64() * 1e3);
        let begin = Instant::now();
        store.check_level(Lod(0)).unwrap();
        assert!(
            begin.elapsed().as_millis() < 50,
            "the second call only tells what the first one found"
        );
        let last = store.level(Lod(0)).grid.bricks - 1;
        let entry = store.entry(BrickId::new(Lod(0), last));
        assert!(
            entry.constant && entry.min == f32::from(FILL),
            "the last entry"
        );
    }
    (bricks, open_ms, check_ms)
}

#[test]
fn opening_does_not_grow_with_the_index() {
    let (few, few_ms, _) = open_and_check(64);
    let (many, many_ms, _) = open_and_check(2048);
    assert_eq!((few, many), (8, 262_144));
    assert!(
        many_ms < few_ms + 100.0,
        "{many} bricks open in {many_ms} ms, {few} in {few_ms} ms"
    );
}

#[test]
#[ignore = "release build: 10⁷ bricks, 370 MB of index in the temporary folder"]
fn ten_million_bricks_open_in_under_a_second() {
    let (bricks, open_ms, check_ms) = open_and_check(6912);
    assert!(bricks >= 10_000_000, "{bricks} bricks");
    println!(
        "{bricks} bricks: open {open_ms:.2} ms, check_level(0) {check_ms:.0} ms ({:.1} GB/s)",
        bricks as f64 * 32.0 / 1e6 / check_ms
    );
    assert!(open_ms < 1000.0, "opened in {open_ms} ms");
}

/// More than 2³² voxels, of which those behind the 2³²th are told apart.
const BEYOND: [u64; 3] = [2048, 2048, 1040];

/// The value of a voxel near the far end of [`BEYOND`].
fn far_value(x: u64, y: u64, z: u64) -> u8 {
    (x * 3 + y * 5 + z * 11) as u8
}

#[test]
fn voxels_beyond_32_bits_are_read_and_extracted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.bsk");
    let far = UVec3::new(63, 63, 32);
    let mut voxels = Box::new([0; STORED_VOXELS]);
    for (i, v) in voxels.iter_mut().enumerate() {
        // Place 1 is the brick's own first voxel, at 32 times its number.
        let at = |p: usize, brick: u32, n: u64| (u64::from(brick) * 32 + p as u64 - 1).min(n - 1);
        *v = far_value(
            at(i % 34, far.x, BEYOND[0]),
            at(i / 34 % 34, far.y, BEYOND[1]),
            at(i / 1156, far.z, BEYOND[2]),
        );
    }
    mostly_constant(&path, BEYOND, Some((far, &voxels)));
    let store = Store::open(&path).unwrap();
    assert!(
        VoxelBox::whole(store.meta().dims).voxel_count() > Some(1 << 32),
        "more than 2³² voxels"
    );
    // The far brick from x 2016, y 2016 and z 1024 on, and some of its neighbours.
    let min = U64Vec3::new(2014, 2013, 1017);
    let wanted = VoxelBox::new(min, min + 20);
    let expected: Vec<u8> = (min.z..min.z + 20)
        .flat_map(|z| (min.y..min.y + 20).map(move |y| (y, z)))
        .flat_map(|(y, z)| (min.x..min.x + 20).map(move |x| (x, y, z)))
        .map(|(x, y, z)| {
            if x >= 2016 && y >= 2016 && z >= 1024 {
                far_value(x, y, z)
            } else {
                FILL
            }
        })
        .collect();
    assert!(expected.iter().any(|&v| v != FILL), "the far brick is met");
    let mut found = vec![0; expected.len()];
    let mut reader = BrickReader::new().unwrap();
    store
        .read_box(Lod(0), wanted, &mut reader, &mut found)
        .unwrap();
    assert!(found == expected, "read_box");
    let out = dir.path().join("far.raw");
    let mut bytes = 0;
    export::extract(&store, (Lod(0), wanted), &out, Existing::Refuse, &mut |n| {
        bytes += n
    })
    .unwrap();
    assert!(std::fs::read(&out).unwrap() == expected, "extract");
    assert_eq!(bytes, expected.len() as u64, "all of it told");
}

/// [`BEYOND`], computed: one value, but for the last 40 slices.
struct Beyond(VolumeDesc);

impl VoxelSource for Beyond {
    fn desc(&self) -> &VolumeDesc {
        &self.0
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::Random
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let size = voxels.size();
        for (i, slice) in out.chunks_mut((size.x * size.y) as usize).enumerate() {
            let z = voxels.min.z + i as u64;
            if z + 40 < self.0.dims.z {
                slice.fill(FILL);
                continue;
            }
            for (j, row) in slice.chunks_mut(size.x as usize).enumerate() {
                for (x, v) in row.iter_mut().enumerate() {
                    *v = far_value(x as u64, voxels.min.y + j as u64, z);
                }
            }
        }
        Ok(())
    }
}

#[test]
#[ignore = "release build: 4.4 × 10⁹ voxels through bricking, verify and extract"]
fn voxels_beyond_32_bits_are_bricked_verified_and_extracted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.bsk");
    let mut source = Beyond(VolumeDesc {
        dims: U64Vec3::from(BEYOND),
        voxel_type: VoxelType::U8,
        world_from_index: DAffine3::IDENTITY,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: "beyond".into(),
    });
    let options = BrickOptions {
        memory_bytes: 512 << 20,
        ..BrickOptions::default()
    };
    let report = bricking::brick(&mut source, &path, &options, &NoProgress).unwrap();
    let voxels = BEYOND.iter().product::<u64>();
    assert_eq!((report.voxels, report.bytes_in), (voxels, voxels));
    let store = Store::open(&path).unwrap();
    assert_eq!(
        store.meta().histogram.counts.iter().sum::<u64>(),
        voxels,
        "each voxel counted once"
    );
    assert_eq!(
        store.meta().percentiles.p50,
        f64::from(FILL),
        "ranks beyond 32 bits"
    );
    let verified = bricking::verify(&store, 10, &NoProgress).unwrap();
    assert_eq!(verified.faults, [], "sound");
    let out = dir.path().join("whole.raw");
    let whole = VoxelBox::whole(U64Vec3::from(BEYOND));
    export::extract(&store, (Lod(0), whole), &out, Existing::Refuse, &mut |_| {}).unwrap();
    assert_eq!(std::fs::metadata(&out).unwrap().len(), voxels, "all of it");
    // The end of the file, against the source.
    let file = std::fs::File::open(&out).unwrap();
    let mut found = vec![0; (2 * BEYOND[0] * BEYOND[1]) as usize];
    let mut expected = found.clone();
    let last = VoxelBox::new(U64Vec3::new(0, 0, BEYOND[2] - 2), U64Vec3::from(BEYOND));
    source.read_box(last, &mut expected).unwrap();
    read_end(file, &mut found);
    assert!(found == expected, "the last two slices");
}

fn read_end(mut file: std::fs::File, out: &mut [u8]) {
    use std::io::{Read, Seek, SeekFrom};
    file.seek(SeekFrom::End(-(out.len() as i64))).unwrap();
    file.read_exact(out).unwrap();
}
