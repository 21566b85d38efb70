//! The file format: golden bytes, damage at every place, and stores that lie with right checksums.

#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[allow(dead_code, reason = "shared: not every test uses all of it")]
#[path = "support/memory_source.rs"]
mod memory_source;

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use brickscope::bricking::{self, BrickOptions, NoProgress};
use brickscope::geom::{BrickGrid, BrickId, Lod, STORED_VOXELS};
use brickscope::outfile::Existing;
use brickscope::store::codec::{BrickEncoder, EncodedBrick};
use brickscope::store::{BrickReader, Part, Store, StoreError, StoreWriter};
use brickscope::volume::VoxelType;
use glam::UVec3;
use memory_source::{MemorySource, voxels};

fn options() -> BrickOptions {
    BrickOptions {
        memory_bytes: 128 << 20,
        threads: Some(1),
        ..BrickOptions::default()
    }
}

/// 34 × 1 × 1 voxels of u8: 7 up to x = 32, then 9. Two bricks of level 0 (neither Constant: the first one's border
/// holds a 9), one of level 1.
fn two_bricks(path: &Path) {
    let mut bytes = vec![7; 34];
    bytes[32] = 9;
    bytes[33] = 9;
    let mut source = MemorySource::new([34, 1, 1], VoxelType::U8, bytes);
    let options = BrickOptions {
        levels: Some(1),
        ..options()
    };
    bricking::brick(&mut source, path, &options, &NoProgress).unwrap();
}

fn u32_at(b: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(b[at..at + 4].try_into().unwrap())
}

fn u64_at(b: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(b[at..at + 8].try_into().unwrap())
}

#[test]
fn golden_bytes_of_two_bricks() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("two.bsk");
    two_bricks(&path);
    let b = std::fs::read(&path).unwrap();
    assert_eq!(&b[0..8], b"\x89BSK\r\n\x1a\n", "signature");
    assert_eq!(u32_at(&b, 8), 1, "version");
    assert_eq!(&b[12..16], [4, 3, 2, 1], "byte order mark");
    assert_eq!(u32_at(&b, 16), 1280, "header length");
    assert_eq!(u32_at(&b, 20), 1, "levels");
    assert_eq!(u64_at(&b, 24), b.len() as u64, "file length");
    assert_eq!(u64_at(&b, 32), 1280, "records start after the header");
    let records = u64_at(&b, 40) as usize;
    let (meta, meta_len) = (u64_at(&b, 48) as usize, u64_at(&b, 56) as usize);
    assert_eq!(
        meta,
        (1280 + records).next_multiple_of(64),
        "metadata place"
    );
    assert_eq!(u32_at(&b, 64), crc32c::crc32c(&b[meta..meta + meta_len]));
    assert_eq!(&b[68..72], [0, 1, 0, 0], "u8, zstd, no filter, zero");
    assert_eq!(
        (u32_at(&b, 72), u32_at(&b, 76)),
        (32, 1),
        "brick and border"
    );
    assert!(b[80..128].iter().all(|&v| v == 0), "zeros");
    let index = u64_at(&b, 128) as usize;
    assert_eq!(index, (meta + meta_len).next_multiple_of(64), "index place");
    assert_eq!(u64_at(&b, 136), 64, "two entries");
    assert_eq!(
        [u32_at(&b, 144), u32_at(&b, 148), u32_at(&b, 152)],
        [2, 1, 1],
        "grid"
    );
    assert_eq!(u32_at(&b, 156), crc32c::crc32c(&b[index..index + 64]));
    assert!(b[160..1276].iter().all(|&v| v == 0), "no more levels");
    assert_eq!(u32_at(&b, 1276), crc32c::crc32c(&b[..1276]), "header CRC");
    assert_eq!(index + 64, b.len(), "the index ends the file");

    // First brick: 7 and, in its border, 9.
    let first = &b[index..index + 32];
    assert_eq!(u64_at(first, 0), 1280, "first record");
    let len = u32_at(first, 8) as usize;
    assert_eq!(&first[12..16], 7.0f32.to_le_bytes(), "min");
    assert_eq!(&first[16..20], 9.0f32.to_le_bytes(), "max");
    assert_eq!(u32_at(first, 20), 0, "not Constant");
    assert_eq!(u32_at(first, 24), crc32c::crc32c(&b[1280..1280 + len]));
    assert_eq!(u32_at(first, 28), 0, "zero");
    let second = &b[index + 32..index + 64];
    assert_eq!(u64_at(second, 0) as usize, 1280 + len, "records are packed");

    // The record: ranges and voxels.
    let plain = zstd::bulk::decompress(&b[1280..1280 + len], 100_000).unwrap();
    assert_eq!(plain.len(), 1024 + 34 * 34 * 34);
    assert_eq!(&plain[0..2], [0, 0], "block 0 is all 7");
    assert_eq!(
        &plain[14..16],
        [0, 255],
        "block 7 reaches the border: 7 to 9"
    );
    let row = &plain[1024..1024 + 34];
    assert!(row[..33].iter().all(|&v| v == 7) && row[33] == 9, "{row:?}");

    // All of it, as the zstd of Cargo.lock packs it.
    assert_eq!(
        crc32c::crc32c(&b[1280..1280 + records]),
        GOLDEN_RECORDS_CRC,
        "records"
    );
    let text = std::str::from_utf8(&b[meta..meta + meta_len]).unwrap();
    assert!(text.starts_with(r#"{"writer":"brickscope "#), "{text:.80}");
    for part in [
        r#""dims":[34,1,1]"#,
        r#""source_type":"u8","stored_type":"u8""#,
        r#""rescale":{"slope":2.0,"intercept":-5.0}"#,
        r#""spacing":[1.0,1.0,1.0],"origin":[0.0,0.0,0.0]"#,
        r#""unit":"HU","value_min":7.0,"value_max":9.0"#,
        r#""levels":[{"dims":[34,1,1],"scale":[1.0,1.0,1.0]}]"#,
        r#""source_name":"memory","source_hash":"#,
        r#""counts":[32,0,2,0,"#,
    ] {
        assert!(text.contains(part), "metadata has {part}: {text:.900}");
    }
}

/// Measured once, with zstd 1.5.7.
const GOLDEN_RECORDS_CRC: u32 = 3_282_635_453;

/// Open and verify: the first thing that is wrong, by part.
fn first_fault(path: &Path) -> Result<(), String> {
    let store = Store::open(path).map_err(|e| e.to_string())?;
    let report = bricking::verify(&store, 3, &NoProgress).map_err(|e| e.to_string())?;
    match report.faults.first() {
        Some(fault) => Err(fault.to_string()),
        None => Ok(()),
    }
}

#[test]
fn truncation_at_every_offset() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("two.bsk");
    two_bricks(&path);
    let whole = std::fs::read(&path).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    for len in (0..whole.len() as u64).rev() {
        file.set_len(len).unwrap();
        match Store::open(&path) {
            Err(StoreError::Length { found, .. }) if len > 0 => assert_eq!(found, len),
            Err(StoreError::NotAStore { .. }) if len == 0 => {}
            other => panic!("cut to {len} bytes: {other:?}"),
        }
    }
    let mut longer = whole;
    longer.push(0);
    std::fs::write(&path, &longer).unwrap();
    assert!(
        matches!(Store::open(&path), Err(StoreError::Length { .. })),
        "a byte too many"
    );
}

#[test]
fn the_index_is_checked_at_its_first_use() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("two.bsk");
    two_bricks(&path);
    let place = Store::open(&path).unwrap().header().levels[0];
    for at in place.offset..place.offset + place.len {
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at as usize] ^= 4;
        let bad = dir.path().join("bad.bsk");
        std::fs::write(&bad, &bytes).unwrap();
        let store = Store::open(&bad).expect("header and metadata are sound");
        let index_is_named = |error: StoreError| matches!(error, StoreError::Damaged { part: Part::Index(Lod(0)), offset, .. } if offset == place.offset);
        for _ in 0..2 {
            assert!(
                index_is_named(store.check_level(Lod(0)).unwrap_err()),
                "byte {at}, each time"
            );
        }
        assert!(
            index_is_named(store.check_all_levels().unwrap_err()),
            "byte {at}, by all levels"
        );
        let mut reader = BrickReader::new().unwrap();
        let first = BrickId::new(Lod(0), UVec3::ZERO);
        assert!(
            index_is_named(store.read_brick(first, &mut reader).unwrap_err()),
            "byte {at}: reading checks by itself"
        );
        let report = bricking::verify(&store, 9, &NoProgress).unwrap();
        assert!(
            matches!(&report.faults[..], [fault] if fault.part == Part::Index(Lod(0))),
            "byte {at}: {:?}",
            report.faults
        );
    }
    // A wrong entry with a right checksum is named by its own place.
    let mut bytes = std::fs::read(&path).unwrap();
    let second = place.offset as usize + 32;
    bytes[second + 28] = 1;
    let crc = crc32c::crc32c(&bytes[place.offset as usize..]);
    bytes[156..160].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32c::crc32c(&bytes[..1276]);
    bytes[1276..1280].copy_from_slice(&crc.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let found = Store::open(&path).unwrap().check_level(Lod(0));
    assert!(
        matches!(&found, Err(StoreError::Damaged { part: Part::Index(Lod(0)), offset, .. }) if *offset == second as u64),
        "{found:?}"
    );
}

#[test]
fn every_flipped_byte_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bsk");
    // Two levels, u16, some padding of every kind.
    let bytes = voxels(VoxelType::U16, 40 * 3 * 2, 1, 0.0);
    let mut source = MemorySource::new([40, 3, 2], VoxelType::U16, bytes);
    bricking::brick(&mut source, &path, &options(), &NoProgress).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let header = Store::open(&path).unwrap().header().clone();
    assert!(!header.padding().is_empty(), "there is padding to flip");
    let records = 1280..1280 + header.records_len as usize;
    // In place: truncating and rewriting the file each time makes some file systems flush it each time.
    let mut file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    let mut put = |at: usize, byte: u8| {
        file.seek(SeekFrom::Start(at as u64)).unwrap();
        file.write_all(&[byte]).unwrap();
    };
    for (at, &byte) in whole.iter().enumerate() {
        put(at, byte ^ (1 << (at % 8)));
        let found = first_fault(&path);
        assert!(found.is_err(), "flipped bit {} of byte {at}", at % 8);
        // Damage that can be opened is named by part; reading that brick is an error too.
        let place = at as u64;
        if records.contains(&at) {
            let store = Store::open(&path).unwrap();
            let mut reader = BrickReader::new().unwrap();
            let damaged = (0..2)
                .flat_map(|l| store.bricks(Lod(l)).collect::<Vec<_>>())
                .filter_map(|id| store.read_brick(id, &mut reader).err())
                .collect::<Vec<_>>();
            assert!(
                matches!(&damaged[..], [StoreError::Damaged { part: Part::Brick(_), offset, .. }] if *offset <= place),
                "byte {at}: {damaged:?}"
            );
        }
        put(at, byte);
    }
}

/// Rewrites a store with `change` applied to each brick's voxels and to its encoded form: all checksums are right again.
fn rewrite(
    from: &Path,
    to: &Path,
    mut voxels: impl FnMut(BrickId, &mut [u8; STORED_VOXELS]),
    mut encoded: impl FnMut(BrickId, &mut EncodedBrick),
) {
    let store = Store::open(from).unwrap();
    let grids: Vec<BrickGrid> = (0..store.levels())
        .map(|l| store.level(Lod(l as u8)).grid)
        .collect();
    let mut writer =
        StoreWriter::create(to, Existing::Replace, store.stored_type(), &grids).unwrap();
    let mut encoder = BrickEncoder::<u8>::new(1).unwrap();
    let mut reader = BrickReader::new().unwrap();
    for l in 0..store.levels() {
        for id in store.bricks(Lod(l as u8)) {
            let data = store.read_brick(id, &mut reader).unwrap();
            let mut brick: Box<[u8; STORED_VOXELS]> = data.voxels.try_into().unwrap();
            voxels(id, &mut brick);
            let mut packed = encoder.encode(&brick).unwrap();
            encoded(id, &mut packed);
            writer.push(id, &packed).unwrap();
        }
    }
    writer.finish(store.meta()).unwrap();
}

#[test]
fn stores_that_lie_with_right_checksums() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bsk");
    let bad = dir.path().join("bad.bsk");
    let bytes = voxels(VoxelType::U8, 70 * 40 * 35, 4, 0.4);
    let mut source = MemorySource::new([70, 40, 35], VoxelType::U8, bytes);
    bricking::brick(&mut source, &path, &options(), &NoProgress).unwrap();
    let target = BrickId::new(Lod(0), UVec3::new(1, 0, 0));

    rewrite(&path, &bad, |_, _| {}, |_, _| {});
    assert_eq!(first_fault(&bad), Ok(()), "a faithful copy is sound");

    let place = |x: usize, y: usize, z: usize| (z * 34 + y) * 34 + x;
    let faults = |voxel: usize, lod: u8| {
        let target = BrickId::new(Lod(lod), if lod == 0 { target.xyz } else { UVec3::ZERO });
        let flip = |id, v: &mut [u8; STORED_VOXELS]| {
            if id == target {
                v[voxel] ^= 0x80;
            }
        };
        rewrite(&path, &bad, flip, |_, _| {});
        let store = Store::open(&bad).unwrap();
        let report = bricking::verify(&store, 100, &NoProgress).unwrap();
        report
            .faults
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .join("\n")
    };
    let of_border = faults(place(0, 10, 10), 0);
    assert!(
        of_border.contains("brick (1, 0, 0) of level 0")
            && of_border.contains("border voxel [0, 10, 10]"),
        "a border that is not the neighbour's: {of_border}"
    );
    let of_repeat = faults(place(10, 0, 10), 0);
    assert!(
        of_repeat.contains("border voxel [10, 0, 10]"),
        "an edge that is not repeated: {of_repeat}"
    );
    let of_own = faults(place(1, 10, 10), 0);
    assert!(
        of_own.contains("brick (0, 0, 0) of level 0")
            && of_own.contains("brick (0, 0, 0) of level 1"),
        "a voxel that neighbour and level 1 know otherwise: {of_own}"
    );
    let inner = faults(place(17, 17, 17), 1);
    assert!(
        inner.contains("the mean of the voxels of level 0"),
        "a coarse voxel that is no mean: {inner}"
    );

    let with = |change: &dyn Fn(&mut EncodedBrick)| {
        rewrite(
            &path,
            &bad,
            |_, _| {},
            |id, brick| {
                if id == target {
                    change(brick);
                }
            },
        );
        first_fault(&bad).expect_err("found")
    };
    let repack = |brick: &mut EncodedBrick, change: &dyn Fn(&mut Vec<u8>)| {
        let mut plain = zstd::bulk::decompress(brick.record.as_ref().unwrap(), 100_000).unwrap();
        change(&mut plain);
        let packed = zstd::bulk::compress(&plain, 1).unwrap();
        brick.crc = crc32c::crc32c(&packed);
        brick.record = Some(packed);
    };
    let range = with(&|b| repack(b, &|plain| plain[100] += 1));
    assert!(range.contains("range byte 100"), "a narrow range: {range}");
    let short = with(&|b| {
        repack(b, &|plain| {
            plain.pop();
        });
    });
    assert!(short.contains("zstd frame"), "a short record: {short}");
    let max = with(&|b| b.max -= 1.0);
    assert!(max.contains("as the index says"), "a wrong maximum: {max}");
    let constant = with(&|b| {
        b.record = None;
        b.crc = 0;
        b.max = b.min;
    });
    assert!(
        constant.contains("voxel"),
        "not Constant at all: {constant}"
    );
}

#[test]
fn other_files_are_refused_by_kind() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("two.bsk");
    two_bricks(&path);
    let whole = std::fs::read(&path).unwrap();
    let with = |at: usize, value: u8| {
        let mut bad = whole.clone();
        bad[at] = value;
        std::fs::write(&path, &bad).unwrap();
        Store::open(&path).unwrap_err()
    };
    assert!(matches!(with(0, 0), StoreError::NotAStore { .. }));
    let version = with(8, 2);
    assert!(matches!(
        version,
        StoreError::Version {
            found: 2,
            supported: 1,
            ..
        }
    ));
    let text = version.to_string();
    assert!(
        text.contains("expected format version 1, found 2"),
        "names both versions: {text}"
    );
    assert!(matches!(
        with(100, 1),
        StoreError::Damaged {
            part: Part::Header,
            ..
        }
    ));
    assert!(matches!(
        Store::open(dir.path()),
        Err(StoreError::NotAStore { .. })
    ));
    assert!(matches!(
        Store::open(&dir.path().join("none")),
        Err(StoreError::Io { .. })
    ));
}
