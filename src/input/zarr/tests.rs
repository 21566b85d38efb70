//! Stores made here, whole, odd and damaged ones. What other programs write was compared when the reader was made.

mod image;

use std::io::Write;
use std::path::Path;

use flate2::write::{GzEncoder, ZlibEncoder};
use proptest::prelude::*;
use serde_json::json;
use tempfile::TempDir;

use super::*;
use crate::geom::VoxelBox;
use crate::volume::VoxelType;

/// The array of most tests: voxel (x, y, z) holds x + 10 y + 100 z.
const SHAPE: [u64; 3] = [5, 4, 7];
const CHUNK: [u64; 3] = [2, 3, 4];

/// 64 voxels of u16, 1000 + 3 · (n mod 16), packed by Blosc with LZ4 and bytes shuffled.
const BLOSC_LZ4: &[u8] = b"\x02\x01\x31\x02\x80\x00\x00\x00\x80\x00\x00\x00\x46\x00\x00\x00\x14\x00\x00\x00\x2e\x00\x00\x00\xff\x01\xe8\xeb\
\xee\xf1\xf4\xf7\xfa\xfd\x00\x03\x06\x09\x0c\x0f\x12\x15\x10\x00\x1d\x13\x03\x01\x00\x13\x04\x01\x00\x03\x0f\x00\x13\x03\
\x0f\x00\x0f\x10\x00\x09\x50\x04\x04\x04\x04\x04";

/// The same with Zstandard and bits shuffled.
const BLOSC_ZSTD: &[u8] = b"\x02\x01\x94\x02\x80\x00\x00\x00\x80\x00\x00\x00\x3e\x00\x00\x00\x14\x00\x00\x00\x26\x00\x00\x00\x28\xb5\x2f\xfd\
\x20\x80\xed\x00\x00\x58\xaa\x66\xb4\xc7\x38\xf8\xc0\xff\x00\x00\xff\x08\xa0\x50\xda\x07\xc0\xc3\x01\x0a\xf7\xe7\x63\x43\
\x46\x96\x09\x1a";

/// Writes files, their folders too.
pub(super) fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        put(dir.path(), name, bytes);
    }
    dir
}

fn put(dir: &Path, name: &str, bytes: &[u8]) {
    assert!(!name.starts_with('/'), "only in the folder of the test");
    let path = dir.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

pub(super) fn open(
    dir: &TempDir,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    open_level(dir.path().to_str().unwrap(), options, 0)
}

/// All voxels, read slice by slice.
pub(super) fn voxels(source: &mut dyn VoxelSource) -> Result<Vec<u8>, SourceError> {
    let dims = source.desc().dims;
    let slice = (dims.x * dims.y) as usize * source.desc().voxel_type.size();
    let mut out = vec![0xee; slice * dims.z as usize];
    for (z, out) in (0..).zip(out.chunks_exact_mut(slice)) {
        let min = U64Vec3::new(0, 0, z);
        source.read_box(VoxelBox::new(min, U64Vec3::new(dims.x, dims.y, z + 1)), out)?;
    }
    Ok(out)
}

fn error(dir: &TempDir, options: &OpenOptions) -> String {
    match open(dir, options).and_then(|mut s| voxels(&mut *s)) {
        Ok(_) => panic!("the store was read"),
        Err(e) => e.to_string(),
    }
}

fn value([z, y, x]: [u64; 3]) -> u16 {
    (x + 10 * y + 100 * z) as u16
}

/// The voxels of the array, little-endian.
fn all_values() -> Vec<u8> {
    indices(SHAPE)
        .flat_map(|i| value(i).to_le_bytes())
        .collect()
}

/// All indices of an array, the last axis fastest.
fn indices(shape: [u64; 3]) -> impl Iterator<Item = [u64; 3]> {
    let [nz, ny, nx] = shape;
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [z, y, x])))
}

/// A chunk's bytes, its axes in `order`, and 9999 beyond the array.
fn chunk(at: [u64; 3], order: [usize; 3], to_bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
    indices(order.map(|axis| CHUNK[axis]))
        .flat_map(|i| {
            let mut global = [0; 3];
            for (&axis, i) in order.iter().zip(i) {
                global[axis] = at[axis] * CHUNK[axis] + i;
            }
            let inside = global.iter().zip(SHAPE).all(|(g, s)| *g < s);
            to_bytes(if inside { value(global) } else { 9999 })
        })
        .collect()
}

fn grid() -> [u64; 3] {
    std::array::from_fn(|n| SHAPE[n].div_ceil(CHUNK[n]))
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut e = ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

fn zarray(changes: Value) -> Value {
    let mut metadata = json!({
        "zarr_format": 2, "shape": SHAPE, "chunks": CHUNK, "dtype": "<u2", "compressor": null, "fill_value": 7,
        "order": "C", "filters": null,
    });
    merge(&mut metadata, changes);
    metadata
}

fn zarr_json(changes: Value) -> Value {
    let mut metadata = json!({
        "zarr_format": 3, "node_type": "array", "shape": SHAPE, "data_type": "uint16", "fill_value": 7,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": CHUNK}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {},
    });
    merge(&mut metadata, changes);
    metadata
}

fn merge(metadata: &mut Value, changes: Value) {
    for (name, value) in changes.as_object().unwrap() {
        metadata[name] = value.clone();
    }
}

/// An array of format 2 whose chunks `pack` made.
fn array_v2(changes: Value, separator: &str, pack: impl Fn([u64; 3]) -> Vec<u8>) -> TempDir {
    let dir = folder(&[(".zarray", zarray(changes).to_string().as_bytes())]);
    for at in indices(grid()) {
        let name = at.map(|i| i.to_string()).join(separator);
        put(dir.path(), &name, &pack(at));
    }
    dir
}

/// An array of format 3 whose chunks `pack` made.
fn array_v3(changes: Value, pack: impl Fn([u64; 3]) -> Vec<u8>) -> TempDir {
    let dir = folder(&[("zarr.json", zarr_json(changes).to_string().as_bytes())]);
    for at in indices(grid()) {
        let name = format!("c/{}", at.map(|i| i.to_string()).join("/"));
        put(dir.path(), &name, &pack(at));
    }
    dir
}

const C: [usize; 3] = [0, 1, 2];

#[test]
fn format_2_in_every_compression_order_and_byte_order() {
    let le = |at| chunk(at, C, u16::to_le_bytes);
    let stores = [
        array_v2(json!({}), ".", le),
        array_v2(json!({"dimension_separator": "/"}), "/", le),
        array_v2(json!({"compressor": {"id": "gzip"}}), ".", |at| {
            gzip(&le(at))
        }),
        array_v2(json!({"compressor": {"id": "zlib"}}), ".", |at| {
            zlib(&le(at))
        }),
        array_v2(json!({"compressor": {"id": "zstd"}}), ".", |at| {
            zstd::bulk::compress(&le(at), 1).unwrap()
        }),
        array_v2(json!({"dtype": ">u2"}), ".", |at| {
            chunk(at, C, u16::to_be_bytes)
        }),
        array_v2(json!({"order": "F"}), ".", |at| {
            chunk(at, [2, 1, 0], u16::to_le_bytes)
        }),
        array_v2(json!({"order": "F", "dtype": ">u2"}), ".", |at| {
            chunk(at, [2, 1, 0], u16::to_be_bytes)
        }),
    ];
    for (n, store) in stores.iter().enumerate() {
        let mut source = open(store, &OpenOptions::default()).unwrap();
        assert_eq!(
            source.desc().dims,
            U64Vec3::new(7, 4, 5),
            "size of store {n}"
        );
        assert_eq!(
            source.desc().voxel_type,
            VoxelType::U16,
            "type of store {n}"
        );
        assert_eq!(
            voxels(&mut *source).unwrap(),
            all_values(),
            "voxels of store {n}"
        );
    }
}

#[test]
fn blosc_chunks() {
    let expected: Vec<u8> = (0..64u16)
        .flat_map(|n| (1000 + 3 * (n % 16)).to_le_bytes())
        .collect();
    let change = json!({"shape": [4, 4, 4], "chunks": [4, 4, 4], "compressor": {"id": "blosc"}});
    for packed in [BLOSC_LZ4, BLOSC_ZSTD] {
        let metadata = zarray(change.clone()).to_string();
        let store = folder(&[(".zarray", metadata.as_bytes()), ("0.0.0", packed)]);
        let mut source = open(&store, &OpenOptions::default()).unwrap();
        assert_eq!(voxels(&mut *source).unwrap(), expected);
        for n in 0..packed.len() {
            put(store.path(), "0.0.0", &packed[..n]);
            let mut source = open(&store, &OpenOptions::default()).unwrap();
            assert!(voxels(&mut *source).is_err(), "{n} bytes are no chunk");
        }
    }
}

#[test]
fn format_3_codecs() {
    let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
    let transpose = json!({"name": "transpose", "configuration": {"order": [2, 0, 1]}});
    let with_sum = |mut bytes: Vec<u8>| {
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        bytes
    };
    let le = |at| chunk(at, C, u16::to_le_bytes);
    let stores = [
        array_v3(json!({}), le),
        array_v3(
            json!({"codecs": [bytes, {"name": "gzip"}, "crc32c"]}),
            |at| with_sum(gzip(&le(at))),
        ),
        array_v3(
            json!({"codecs": [bytes, "crc32c", {"name": "zstd"}]}),
            |at| zstd::bulk::compress(&with_sum(le(at)), 1).unwrap(),
        ),
        array_v3(json!({"codecs": [transpose, bytes]}), |at| {
            chunk(at, [2, 0, 1], u16::to_le_bytes)
        }),
        // Of x, z, y the first and last are exchanged: y, z, x.
        array_v3(
            json!({"codecs": [
                transpose,
                {"name": "transpose", "configuration": {"order": [2, 1, 0]}},
                {"name": "bytes", "configuration": {"endian": "big"}},
            ]}),
            |at| chunk(at, [1, 0, 2], u16::to_be_bytes),
        ),
    ];
    for (n, store) in stores.iter().enumerate() {
        let mut source = open(store, &OpenOptions::default()).unwrap();
        assert_eq!(
            voxels(&mut *source).unwrap(),
            all_values(),
            "voxels of store {n}"
        );
    }
    put(stores[1].path(), "c/0/0/0", &[1, 2, 3, 4, 5]);
    let error = error(&stores[1], &OpenOptions::default());
    assert!(
        error.contains("c/0/0/0") && error.contains("checksum"),
        "{error}"
    );
}

/// A store of shards of 4 × 2 × 2 chunks; `wrong` may change a shard's index.
fn sharded(at_end: bool, wrong: impl Fn(&mut Vec<[u64; 2]>)) -> TempDir {
    const PER_SHARD: [u64; 3] = [4, 2, 2];
    let codecs = json!([{
        "name": "sharding_indexed",
        "configuration": {
            "chunk_shape": CHUNK,
            "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip"}],
            "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}],
            "index_location": if at_end { "end" } else { "start" },
        },
    }]);
    let shape: Vec<u64> = (0..3).map(|n| CHUNK[n] * PER_SHARD[n]).collect();
    let grid_of_shards = json!({"name": "regular", "configuration": {"chunk_shape": shape}});
    let metadata = zarr_json(json!({"codecs": codecs, "chunk_grid": grid_of_shards}));
    let index_bytes = 16 * 16 + 4;
    let mut index = Vec::new();
    let mut data = Vec::new();
    for at in indices(PER_SHARD) {
        if at.iter().zip(grid()).all(|(a, g)| *a < g) && at != [1, 1, 1] {
            let packed = gzip(&chunk(at, C, u16::to_le_bytes));
            let start = data.len() + if at_end { 0 } else { index_bytes };
            index.push([start as u64, packed.len() as u64]);
            data.extend(packed);
        } else {
            index.push([u64::MAX; 2]);
        }
    }
    wrong(&mut index);
    let mut table: Vec<u8> = index
        .iter()
        .flatten()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    table.extend(crc32c::crc32c(&table).to_le_bytes());
    let shard = if at_end {
        [data, table].concat()
    } else {
        [table, data].concat()
    };
    folder(&[
        ("zarr.json", metadata.to_string().as_bytes()),
        ("c/0/0/0", &shard),
    ])
}

#[test]
fn shards_with_their_index_at_either_end() {
    // Chunk (1, 1, 1) is not stored: it has the fill value.
    let expected: Vec<u8> = indices(SHAPE)
        .flat_map(|[z, y, x]| {
            let is_missing = (2..4).contains(&z) && y == 3 && x >= 4;
            (if is_missing { 7 } else { value([z, y, x]) }).to_le_bytes()
        })
        .collect();
    for at_end in [true, false] {
        let store = sharded(at_end, |_| ());
        let mut source = open(&store, &OpenOptions::default()).unwrap();
        assert_eq!(
            voxels(&mut *source).unwrap(),
            expected,
            "index at the end: {at_end}"
        );
        drop(store);
        let mut source = open(&sharded(at_end, |_| ()), &OpenOptions::default()).unwrap();
        let error = voxels(&mut *source).err().unwrap().to_string();
        assert!(
            error.contains("find the folder"),
            "a folder that has gone: {error}"
        );
    }
}

#[test]
fn shards_whose_index_lies() {
    for entry in [
        [0, u64::MAX - 1],
        [u64::MAX - 5, 10],
        [1 << 40, 10],
        [0, 3],
        [5, 0],
    ] {
        let store = sharded(true, |index| index[0] = entry);
        let error = error(&store, &OpenOptions::default());
        assert!(error.contains("c/0/0/0"), "{entry:?}: {error}");
    }
    let store = sharded(true, |_| ());
    let path = store.path().join("c/0/0/0");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let error = error(&store, &OpenOptions::default());
    assert!(error.contains("the shard's index"), "{error}");
}

#[test]
fn chunks_that_are_not_stored_have_the_fill_value() {
    let fills = [
        ("<u2", json!(65535), vec![0xff, 0xff]),
        (">i2", json!(-2), vec![0xfe, 0xff]),
        ("|u1", Value::Null, vec![0]),
        ("<f4", json!("NaN"), f32::NAN.to_le_bytes().to_vec()),
        (
            ">f8",
            json!("-Infinity"),
            f64::NEG_INFINITY.to_le_bytes().to_vec(),
        ),
        ("<f4", json!("0x3f800000"), 1f32.to_le_bytes().to_vec()),
        ("<i4", json!(3.0), vec![3, 0, 0, 0]),
    ];
    for (dtype, fill, element) in fills {
        let metadata = zarray(json!({"dtype": dtype, "fill_value": fill})).to_string();
        let store = folder(&[(".zarray", metadata.as_bytes())]);
        let mut source = open(&store, &OpenOptions::default()).unwrap();
        assert_eq!(
            voxels(&mut *source).unwrap(),
            element.repeat(140),
            "{dtype} {fill}"
        );
    }
    for (dtype, fill) in [
        ("<u2", json!(-1)),
        ("<u2", json!(0.5)),
        ("<i2", json!("NaN")),
        ("|u1", json!("x")),
    ] {
        let metadata = zarray(json!({"dtype": dtype, "fill_value": fill})).to_string();
        let error = error(
            &folder(&[(".zarray", metadata.as_bytes())]),
            &OpenOptions::default(),
        );
        assert!(error.contains("fill_value"), "{error}");
    }
}

#[test]
fn what_is_not_supported_is_refused_by_name() {
    let v2 = [
        (json!({"zarr_format": 4}), "zarr_format"),
        (json!({"dtype": "<i8"}), "<i8"),
        (json!({"dtype": "|b1"}), "|b1"),
        (json!({"dtype": "<f2"}), "<f2"),
        (json!({"dtype": [["a", "<u2"]]}), "<u2"),
        (json!({"compressor": {"id": "lzma"}}), "lzma"),
        (json!({"filters": [{"id": "delta"}]}), "delta"),
        (json!({"order": "Z"}), "order"),
        (json!({"shape": [0, 4, 7]}), "shape"),
        (
            json!({"shape": [1u64 << 40, 1u64 << 40, 1u64 << 40]}),
            "2^64",
        ),
        (json!({"chunks": [2, 3]}), "chunks"),
        (
            json!({"chunks": [1u64 << 20, 1u64 << 20, 1u64 << 62]}),
            "at most",
        ),
        (json!({"chunks": [2048, 1024, 1024]}), "at most"),
        (
            json!({"shape": [2, 5, 4, 7], "chunks": [1, 2, 3, 4]}),
            "have no names",
        ),
    ];
    for (change, word) in v2 {
        let store = folder(&[(".zarray", zarray(change).to_string().as_bytes())]);
        let error = error(&store, &OpenOptions::default());
        assert!(
            error.contains(word) && error.contains(".zarray"),
            "{word}: {error}"
        );
    }
    let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
    let shard = json!({"name": "sharding_indexed", "configuration": {"chunk_shape": CHUNK, "codecs": [bytes]}});
    let nested = json!({"name": "sharding_indexed", "configuration": {"chunk_shape": CHUNK, "codecs": [shard]}});
    let v3 = [
        (json!({"data_type": "uint64"}), "uint64"),
        (json!({"data_type": {"name": "struct"}}), "struct"),
        (json!({"codecs": [bytes, {"name": "pcodec"}]}), "pcodec"),
        (json!({"codecs": [{"name": "delta"}, bytes]}), "delta"),
        (json!({"codecs": []}), "codecs"),
        (
            json!({"codecs": [{"name": "transpose", "configuration": {"order": [0, 0, 1]}}, bytes]}),
            "order",
        ),
        (json!({"codecs": [shard, "gzip"]}), "gzip"),
        (json!({"codecs": [nested]}), "a shard of shards"),
        (
            json!({"chunk_grid": {"name": "rectilinear"}}),
            "rectilinear",
        ),
        (json!({"chunk_key_encoding": {"name": "fanout"}}), "fanout"),
        (
            json!({"storage_transformers": [{"name": "x"}]}),
            "storage transformer",
        ),
        (json!({"news": {"must_understand": true}}), "news"),
        (json!({"node_type": "tree"}), "node_type"),
    ];
    for (change, word) in v3 {
        let store = folder(&[("zarr.json", zarr_json(change).to_string().as_bytes())]);
        let error = error(&store, &OpenOptions::default());
        assert!(
            error.contains(word) && error.contains("zarr.json"),
            "{word}: {error}"
        );
    }
    let harmless = zarr_json(json!({"news": {"must_understand": false}})).to_string();
    assert!(
        open(
            &folder(&[("zarr.json", harmless.as_bytes())]),
            &OpenOptions::default()
        )
        .is_ok()
    );
}

#[test]
fn chunks_of_a_wrong_length_are_named() {
    for (bytes, word) in [(47, "47 bytes"), (49, "49 bytes"), (1 << 20, "at most")] {
        let store = array_v2(json!({}), ".", |_| vec![0; bytes]);
        let error = error(&store, &OpenOptions::default());
        assert!(error.contains(word), "{bytes}: {error}");
    }
    // A few bytes that would become very many.
    let bomb = gzip(&vec![0; 1 << 20]);
    let store = array_v2(json!({"compressor": {"id": "gzip"}}), ".", |_| bomb.clone());
    let error = error(&store, &OpenOptions::default());
    assert!(
        error.contains("more than 48 bytes") && error.contains('0'),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    /// Whatever is in the files, reading ends, with voxels or an error.
    #[test]
    fn damage_never_panics(
        (in_chunk, at_end) in any::<(bool, bool)>(),
        place in any::<prop::sample::Index>(),
        new in any::<u8>(),
        cut in any::<bool>(),
    ) {
        let store = sharded(at_end, |_| ());
        let path = store.path().join(if in_chunk { "c/0/0/0" } else { "zarr.json" });
        let mut bytes = std::fs::read(&path).unwrap();
        let n = place.index(bytes.len());
        if cut {
            bytes.truncate(n);
        } else {
            bytes[n] = new;
        }
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(mut source) = open(&store, &OpenOptions::default())
            && source.desc().byte_count() < Some(1 << 20)
        {
            let _ = voxels(&mut *source);
        }
    }
}
