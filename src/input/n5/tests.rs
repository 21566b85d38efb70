//! Blocks made here, and damaged ones.

use std::io::Write;

use flate2::write::GzEncoder;
use glam::DVec3;
use serde_json::json;
use tempfile::TempDir;

use super::*;
use crate::geom::VoxelBox;

const SHAPE: [u64; 3] = [5, 4, 3];
const BLOCK: [u64; 3] = [3, 4, 2];

fn attributes_of(changes: Value) -> Value {
    let mut value = json!({
        "dimensions": SHAPE, "blockSize": BLOCK, "dataType": "int16", "compression": {"type": "raw"},
    });
    for (name, change) in changes.as_object().unwrap() {
        value[name] = change.clone();
    }
    value
}

fn put(dir: &TempDir, name: &str, bytes: &[u8]) {
    assert!(!name.starts_with('/'), "only in the folder of the test");
    let path = dir.path().join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

fn value(x: u64, y: u64, z: u64) -> i16 {
    (x + 10 * y + 100 * z) as i16 - 50
}

/// Writes an array below `path`, its blocks cut at the end of the volume; one of them is not stored.
fn array_at(dir: &TempDir, path: &str, changes: Value, pack: impl Fn(&[u8]) -> Vec<u8>) {
    let metadata = attributes_of(changes).to_string();
    put(dir, &format!("{path}/attributes.json"), metadata.as_bytes());
    for (bx, bz) in [(0, 0), (1, 0), (0, 1)] {
        let first = [bx * BLOCK[0], 0, bz * BLOCK[2]];
        let size: [u64; 3] = std::array::from_fn(|n| BLOCK[n].min(SHAPE[n] - first[n]));
        let mut block = vec![0, 0, 0, 3];
        block.extend(size.iter().flat_map(|&s| (s as u32).to_be_bytes()));
        let mut bytes = Vec::new();
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    bytes.extend(value(first[0] + x, y, first[2] + z).to_be_bytes());
                }
            }
        }
        block.extend(pack(&bytes));
        put(dir, &format!("{path}/{bx}/0/{bz}"), &block);
    }
}

fn expected() -> Vec<u8> {
    let mut out = Vec::new();
    for z in 0..SHAPE[2] {
        for y in 0..SHAPE[1] {
            for x in 0..SHAPE[0] {
                let is_missing = x >= BLOCK[0] && z >= BLOCK[2];
                let v = if is_missing { 0 } else { value(x, y, z) };
                out.extend(v.to_le_bytes());
            }
        }
    }
    out
}

fn read(
    dir: &TempDir,
    options: &OpenOptions,
) -> Result<(Box<dyn VoxelSource>, Vec<u8>), SourceError> {
    let mut source = open_level(dir.path().to_str().unwrap(), options, 0)?;
    let dims = source.desc().dims;
    let mut out = vec![0; source.desc().byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(dims), &mut out)?;
    Ok((source, out))
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

#[test]
fn blocks_raw_and_packed() {
    let raw = |bytes: &[u8]| bytes.to_vec();
    let zstd = |bytes: &[u8]| zstd::bulk::compress(bytes, 1).unwrap();
    for (compression, pack) in [
        (json!({"type": "raw"}), &raw as &dyn Fn(&[u8]) -> Vec<u8>),
        (json!({"type": "gzip"}), &gzip),
        (json!({"type": "zstd"}), &zstd),
    ] {
        let dir = tempfile::tempdir().unwrap();
        array_at(&dir, ".", json!({"compression": compression}), pack);
        let (source, bytes) = read(&dir, &OpenOptions::default()).unwrap();
        assert_eq!(source.desc().dims, U64Vec3::from_array(SHAPE));
        assert_eq!(bytes, expected(), "{compression}");
        assert!(source.notes()[0].contains("1 mm"), "{:?}", source.notes());
    }
}

#[test]
fn places_as_viewers_write_them() {
    let micrometres = json!({"pixelResolution": {"dimensions": [1.0, 2.0, 4.0], "unit": "um"}});
    let nanometres = json!({"transform": {
        "axes": ["z", "y", "x"], "scale": [4.0, 2.0, 1.0], "translate": [400.0, 0.0, 0.0], "units": ["nm", "nm", "nm"],
    }});
    let bare = json!({"resolution": [1.0, 2.0, 4.0]});
    for (change, unit, origin_z) in [
        (micrometres, 1e-3, 0.0),
        (nanometres, 1e-6, 400e-6),
        (bare, 1.0, 0.0),
    ] {
        let dir = tempfile::tempdir().unwrap();
        array_at(&dir, ".", change, <[u8]>::to_vec);
        let (source, _) = read(&dir, &OpenOptions::default()).unwrap();
        let spacing = DVec3::new(1.0, 2.0, 4.0) * unit;
        assert!(
            source.desc().spacing().abs_diff_eq(spacing, 1e-15),
            "{}",
            source.desc().spacing()
        );
        let z = source.desc().world_from_index.translation.z;
        assert!((z - origin_z).abs() < 1e-12, "origin {z}");
    }
}

#[test]
fn groups_have_levels() {
    let dir = tempfile::tempdir().unwrap();
    let group = json!({"pixelResolution": {"dimensions": [1.0, 1.0, 2.0], "unit": "mm"}});
    put(&dir, "attributes.json", group.to_string().as_bytes());
    array_at(&dir, "s0", json!({}), <[u8]>::to_vec);
    array_at(
        &dir,
        "s1",
        json!({"downsamplingFactors": [2, 2, 1]}),
        <[u8]>::to_vec,
    );
    let location = dir.path().to_str().unwrap();
    let options = OpenOptions::default();
    assert_eq!(
        levels(location, &options).unwrap(),
        [U64Vec3::from_array(SHAPE); 2]
    );
    let level = open_level(location, &options, 1).unwrap();
    assert_eq!(level.desc().spacing(), DVec3::splat(2.0));
    assert_eq!(
        level.desc().world_from_index.translation,
        DVec3::new(0.5, 0.5, 0.0)
    );
    assert!(
        open_level(location, &options, 2).is_err(),
        "a level that is not there"
    );
    let options = OpenOptions {
        dataset: Some("s1".to_owned()),
        ..options
    };
    assert!(read(&dir, &options).is_ok(), "a level by its path");
    let options = OpenOptions {
        dataset: Some("s7".to_owned()),
        ..options
    };
    assert!(read(&dir, &options).is_err(), "nothing there");
}

#[test]
fn what_is_wrong_is_named() {
    for (change, word) in [
        (json!({"compression": {"type": "lz4"}}), "lz4"),
        (json!({"compression": null}), "type"),
        (json!({"dataType": "uint64"}), "uint64"),
        (json!({"blockSize": [0, 1, 1]}), "blockSize"),
        (json!({"blockSize": [3, 4]}), "chunks"),
        (json!({"blockSize": [4096, 4096, 4096]}), "at most"),
        (
            json!({"dimensions": [5, 4, 3, 2], "blockSize": [3, 4, 2, 1]}),
            "axis 3",
        ),
        (
            json!({"pixelResolution": {"dimensions": [0, 1, 1]}}),
            "above 0",
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        array_at(&dir, ".", change, <[u8]>::to_vec);
        let error = read(&dir, &OpenOptions::default())
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn damaged_blocks_are_named() {
    let dir = tempfile::tempdir().unwrap();
    array_at(&dir, ".", json!({"compression": {"type": "gzip"}}), gzip);
    let path = dir.path().join("1/0/0");
    let whole = std::fs::read(&path).unwrap();
    for n in 0..whole.len() {
        std::fs::write(&path, &whole[..n]).unwrap();
        let error = read(&dir, &OpenOptions::default())
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("1/0/0"), "{n} bytes: {error}");
        // What a flipped bit does to a size or to voxels can't always be seen, but it must not panic.
        let mut bytes = whole.clone();
        bytes[n] ^= 0x81;
        std::fs::write(&path, &bytes).unwrap();
        let _ = read(&dir, &OpenOptions::default());
    }
}
