//! Volumes made here, and damaged ones.

use std::io::Write;

use flate2::write::GzEncoder;
use serde_json::json;
use tempfile::TempDir;

use super::*;
use crate::geom::VoxelBox;

fn info(changes: Value) -> Value {
    let mut scale = json!({
        "key": "4_4_8", "size": [5, 2, 3], "resolution": [4, 4, 8], "voxel_offset": [10, -1, 0],
        "chunk_sizes": [[3, 2, 2]], "encoding": "raw",
    });
    let mut info = json!({"type": "image", "data_type": "uint16", "num_channels": 2});
    for (name, change) in changes.as_object().unwrap() {
        let place = if info.get(name).is_some() {
            &mut info
        } else {
            &mut scale
        };
        place[name] = change.clone();
    }
    info["scales"] = json!([scale]);
    info
}

fn value(x: u64, y: u64, z: u64, c: u64) -> u16 {
    (x + 10 * y + 100 * z + 1000 * c) as u16
}

/// A volume with the chunks of the first layer only.
fn volume(changes: Value, suffix: &str, pack: impl Fn(Vec<u8>) -> Vec<u8>) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("info"), info(changes).to_string()).unwrap();
    std::fs::create_dir(dir.path().join("4_4_8")).unwrap();
    for (name, xs) in [("10-13", 0..3), ("13-15", 3..5)] {
        let mut bytes = Vec::new();
        for c in 0..2 {
            for z in 0..2 {
                for y in 0..2 {
                    bytes.extend(xs.clone().flat_map(|x| value(x, y, z, c).to_le_bytes()));
                }
            }
        }
        let path = dir.path().join(format!("4_4_8/{name}_-1-1_0-2{suffix}"));
        std::fs::write(path, pack(bytes)).unwrap();
    }
    dir
}

fn read(
    dir: &TempDir,
    channel: Option<u64>,
) -> Result<(Box<dyn VoxelSource>, Vec<u8>), SourceError> {
    let options = OpenOptions {
        channel,
        ..Default::default()
    };
    let mut source = crate::input::open(dir.path().to_str().unwrap(), &options)?;
    let dims = source.desc().dims;
    let mut out = vec![0; source.desc().byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(dims), &mut out)?;
    Ok((source, out))
}

fn gzip(bytes: Vec<u8>) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(&bytes).unwrap();
    e.finish().unwrap()
}

#[test]
fn raw_and_packed_chunks() {
    let mut expected = Vec::new();
    for z in 0..3 {
        for y in 0..2 {
            expected.extend(
                (0..5).flat_map(|x| if z < 2 { value(x, y, z, 1) } else { 0 }.to_le_bytes()),
            );
        }
    }
    for dir in [
        volume(json!({}), "", |bytes| bytes),
        volume(json!({}), "", gzip),
        volume(json!({}), ".gz", gzip),
    ] {
        let (source, bytes) = read(&dir, Some(1)).unwrap();
        assert_eq!(source.desc().dims, U64Vec3::new(5, 2, 3));
        let d = source.desc();
        assert!(
            d.spacing().abs_diff_eq(DVec3::new(4e-6, 4e-6, 8e-6), 1e-15),
            "{}",
            d.spacing()
        );
        let origin = d.world_from_index.translation;
        assert!(
            origin.abs_diff_eq(DVec3::new(42e-6, -2e-6, 4e-6), 1e-15),
            "{origin}"
        );
        assert_eq!(bytes, expected);
    }
}

#[test]
fn what_is_wrong_is_named() {
    let error = read(&volume(json!({}), "", |b| b), None)
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("--channel 0 to 1"), "{error}");
    for (change, word) in [
        (json!({"encoding": "jpeg"}), "jpeg"),
        (
            json!({"encoding": "compressed_segmentation"}),
            "compressed_segmentation",
        ),
        (
            json!({"sharding": {"@type": "neuroglancer_uint64_sharded_v1"}}),
            "sharded",
        ),
        (json!({"data_type": "uint64"}), "uint64"),
        (json!({"num_channels": 0}), "num_channels"),
        (json!({"size": [5, 2]}), "size"),
        (json!({"chunk_sizes": []}), "chunk_sizes"),
        (json!({"resolution": [0, 1, 1]}), "resolution"),
        (json!({"voxel_offset": [i64::MAX, 0, 0]}), "voxel_offset"),
        (json!({"voxel_offset": [1, 0]}), "voxel_offset"),
        (json!({"key": "../4_4_8"}), "below the store"),
    ] {
        let dir = volume(change, "", |bytes| bytes);
        let error = read(&dir, Some(0)).err().unwrap().to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
    for pack in [|b: Vec<u8>| b[1..].to_vec(), |b| gzip(b)[..30].to_vec()] {
        let error = read(&volume(json!({}), "", pack), Some(0))
            .err()
            .unwrap()
            .to_string();
        assert!(
            error.contains("10-13_-1-1_0-2") || error.contains("13-15_-1-1_0-2"),
            "{error}"
        );
    }
    let dir = volume(json!({}), "", |bytes| bytes);
    let whole = std::fs::read(dir.path().join("info")).unwrap();
    for n in 0..whole.len() {
        std::fs::write(dir.path().join("info"), &whole[..n]).unwrap();
        assert!(read(&dir, Some(0)).is_err(), "{n} bytes are no info");
    }
}
