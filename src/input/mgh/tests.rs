//! Files made here, plain and gzip; damaged ones are refused without a panic.

use std::io::Write;

use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;
use crate::volume::VoxelSource;

/// A file of two frames of 3 × 2 × 2 voxels of i16, counting up from −2.
fn sample() -> Vec<u8> {
    let mut bytes = vec![0; HEADER_BYTES];
    for (i, n) in [1i32, 3, 2, 2, 2, 4].into_iter().enumerate() {
        bytes[4 * i..4 * i + 4].copy_from_slice(&n.to_be_bytes());
    }
    bytes[GOOD_RAS + 1] = 1;
    let reals = [
        2.0f32, 3.0, 4.0, // spacing
        -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, // x, y and z in RAS
        10.0, 20.0, 30.0, // centre
    ];
    for (i, v) in reals.into_iter().enumerate() {
        bytes[SPACING + 4 * i..SPACING + 4 * i + 4].copy_from_slice(&v.to_be_bytes());
    }
    bytes.extend((-2i16..22).flat_map(i16::to_be_bytes));
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

fn open_bytes(bytes: &[u8], compressed: bool, time: Option<u64>) -> Result<VoxelFile, SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let options = OpenOptions {
        time,
        ..OpenOptions::default()
    };
    open(file.path(), compressed, &options)
}

fn read(bytes: &[u8], compressed: bool, time: u64) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let mut source = open_bytes(bytes, compressed, Some(time))?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
    Ok((desc, out))
}

#[test]
fn frames_and_place() {
    let bytes = sample();
    for compressed in [false, true] {
        let bytes = if compressed {
            gzip(&bytes)
        } else {
            bytes.clone()
        };
        for (time, from) in [(0, -2i16), (1, 10)] {
            let (desc, voxels) = read(&bytes, compressed, time).unwrap();
            let expected: Vec<u8> = (from..from + 12).flat_map(i16::to_le_bytes).collect();
            assert_eq!(voxels, expected, "frame {time}");
            assert_eq!(desc.voxel_type, VoxelType::I16, "type");
            // The centre is index 1.5, 1, 1.
            let center = desc
                .world_from_index
                .transform_point3(DVec3::new(1.5, 1.0, 1.0));
            assert_eq!(center, DVec3::new(10.0, 20.0, 30.0), "centre");
            let m = desc.world_from_index.matrix3;
            assert_eq!(m.x_axis, DVec3::NEG_X * 2.0, "x");
            assert_eq!(m.y_axis, DVec3::NEG_Z * 3.0, "y");
            assert_eq!(m.z_axis, DVec3::Y * 4.0, "z");
        }
        let error = open_bytes(&bytes, compressed, None)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("--time N"), "{error}");
    }
}

#[test]
fn without_orientation_it_is_coronal() {
    let mut bytes = sample();
    bytes[GOOD_RAS + 1] = 0;
    let source = open_bytes(&bytes, false, Some(0)).unwrap();
    assert!(
        source.notes()[0].contains("coronal"),
        "{:?}",
        source.notes()
    );
    let m = source.desc().world_from_index.matrix3;
    assert_eq!(m.z_axis, DVec3::Y, "slices go to the front");
}

#[test]
fn what_is_not_built_or_wrong_is_named() {
    for (at, value, word) in [
        (VERSION, 2i32, "the version"),
        (DIMS + 4, 0, "height"),
        (FRAMES, -1, "nframes"),
        (TYPE, 5, "1 bit"),
        (TYPE, 99, "the type"),
        (SPACING, 0, "xsize"),
        (DIMS, 1 << 30, "bytes"),
    ] {
        let mut bytes = sample();
        bytes[at..at + 4].copy_from_slice(&value.to_be_bytes());
        for compressed in [false, true] {
            let bytes = if compressed {
                gzip(&bytes)
            } else {
                bytes.clone()
            };
            let error = open_bytes(&bytes, compressed, Some(0)).err();
            let error = error.map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains(word), "{word}: {error}");
        }
    }
}

#[test]
fn a_cut_file_is_refused_at_every_length() {
    let bytes = sample();
    let packed = gzip(&bytes);
    for n in 0..bytes.len() {
        assert!(read(&bytes[..n], false, 1).is_err(), "{n} bytes");
    }
    for n in 0..packed.len() {
        assert!(read(&packed[..n], true, 1).is_err(), "{n} bytes of gzip");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        compressed: bool,
        changes in prop::collection::vec((0usize..HEADER_BYTES, any::<u8>()), 1..6),
        cut in 0usize..340,
    ) {
        let mut bytes = sample();
        for (at, value) in changes {
            bytes[at] = value;
        }
        bytes.truncate(cut.max(20));
        let bytes = if compressed { gzip(&bytes) } else { bytes };
        let _ = open_bytes(&bytes, compressed, Some(0));
    }
}
