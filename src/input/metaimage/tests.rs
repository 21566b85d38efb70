//! Headers made here, and damaged ones.

use std::io::Write;

use flate2::write::ZlibEncoder;
use glam::DMat3;
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;
use crate::volume::VoxelSource;

const BASE: &str = "ObjectType = Image\nNDims = 3\nDimSize = 3 2 2\nElementType = MET_SHORT\n";

fn voxels_of(to_bytes: fn(i16) -> [u8; 2]) -> Vec<u8> {
    (-2i16..10).flat_map(to_bytes).collect()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut e = ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

fn read_path(path: &Path) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let mut source = open(path)?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
    Ok((desc, out))
}

/// Reads a file of the basic header, `fields`, and `voxels`.
fn read(fields: &str, voxels: &[u8]) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    let mut bytes = format!("{BASE}{fields}ElementDataFile = LOCAL\n").into_bytes();
    bytes.extend(voxels);
    std::fs::write(file.path(), bytes).unwrap();
    read_path(file.path())
}

#[test]
fn byte_orders_compression_and_header_size() {
    let (le, be) = (voxels_of(i16::to_le_bytes), voxels_of(i16::to_be_bytes));
    let mut late = vec![7; 3];
    late.extend(&le);
    for (fields, voxels) in [
        ("", le.clone()),
        ("BinaryDataByteOrderMSB = True\n", be.clone()),
        ("ElementByteOrderMSB = true\n", be.clone()),
        (
            "CompressedData = True\nCompressedDataSize = 99\n",
            zlib(&le),
        ),
        (
            "CompressedData = True\nBinaryDataByteOrderMSB = True\n",
            zlib(&be),
        ),
        ("HeaderSize = 3\n", late.clone()),
        ("HeaderSize = -1\n", late),
    ] {
        let (desc, out) = read(fields, &voxels).unwrap();
        assert_eq!(out, le, "{fields}");
        assert_eq!(desc.world_from_index, DAffine3::IDENTITY, "{fields}");
    }
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("v.zraw"), zlib(&be)).unwrap();
    let header = dir.path().join("v.mhd");
    let fields = "CompressedData = True\nBinaryDataByteOrderMSB = True\nElementDataFile = v.zraw\n";
    std::fs::write(&header, format!("{BASE}{fields}")).unwrap();
    assert_eq!(read_path(&header).unwrap().1, le, "detached");
}

#[test]
fn rows_of_the_matrix_are_directions_in_lps() {
    let voxels = voxels_of(i16::to_le_bytes);
    let place = |fields: &str| read(fields, &voxels).unwrap().0.world_from_index;
    // Axis 0 along +y (posterior), axis 1 along +z, axis 2 along +x (left).
    for names in [
        ("TransformMatrix", "Offset"),
        ("Rotation", "Position"),
        ("Orientation", "Origin"),
    ] {
        let (matrix, offset) = names;
        let affine = place(&format!(
            "{matrix} = 0 1 0 0 0 1 1 0 0\n{offset} = 10 20 30\nElementSpacing = 2 3 4\n"
        ));
        let expected = DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::new(0.0, -2.0, 0.0),
                DVec3::new(0.0, 0.0, 3.0),
                DVec3::new(-4.0, 0.0, 0.0),
            ),
            DVec3::new(-10.0, -20.0, 30.0),
        );
        assert_eq!(affine, expected, "{matrix}");
    }
    let spacing = DVec3::new(2.0, 3.0, 4.0);
    assert_eq!(
        place("ElementSize = 2 3 4\n"),
        DAffine3::from_scale(spacing),
        "no orientation"
    );
}

#[test]
fn wrong_or_unbuilt_headers_say_why() {
    let voxels = voxels_of(i16::to_le_bytes);
    for (fields, word) in [
        ("ElementNumberOfChannels = 3\n", "3 channels"),
        ("BinaryData = False\n", "text"),
        ("ElementSpacing = 1 nan 1\n", "'elementspacing'"),
        ("ElementSpacing = 1 0 1\n", "'elementspacing'"),
        ("TransformMatrix = 1 0 0 1 0 0 0 0 1\n", "'transformmatrix'"),
        ("TransformMatrix = 1 0 0\n", "'transformmatrix'"),
        ("CompressedData = perhaps\n", "'compresseddata'"),
        ("HeaderSize = -2\n", "'headersize'"),
        ("HeaderSize = 1\n", "24 bytes"),
        ("DimSize = 1 1 1\n", "'dimsize'"),
        ("ElementDataFile = LIST\n", "several"),
        ("ElementDataFile = s%03d.raw 1 9 1\n", "several"),
        ("nonsense\n", "line 5"),
    ] {
        let error = read(fields, &voxels).err().map(|e| e.to_string());
        assert!(
            error.as_ref().is_some_and(|e| e.contains(word)),
            "{fields}: {error:?}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        changes in prop::collection::vec((0usize..300, any::<u8>()), 1..6),
        cut in 10usize..400,
    ) {
        let text = format!(
            "{BASE}CompressedData = True\nTransformMatrix = 0 1 0 0 0 1 1 0 0\nOffset = 10 20 30\n\
             ElementSpacing = 2 3 4\nHeaderSize = 0\nElementDataFile = LOCAL\n"
        );
        let mut bytes = text.into_bytes();
        bytes.extend(zlib(&voxels_of(i16::to_le_bytes)));
        for (at, value) in changes {
            let n = bytes.len();
            bytes[at % n] = value;
        }
        bytes.truncate(cut);
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let _ = open(file.path());
    }
}
