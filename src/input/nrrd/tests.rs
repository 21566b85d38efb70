//! Headers made here, and damaged ones.

use std::io::Write;

use flate2::write::GzEncoder;
use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;
use crate::volume::VoxelSource;

const BASE: &str =
    "NRRD0004\n# a comment\ntype: short\ndimension: 3\nsizes: 3 2 2\nkey:=value: with colon\n";

fn big_endian_voxels() -> Vec<u8> {
    (-2i16..10).flat_map(i16::to_be_bytes).collect()
}

fn little_endian_voxels() -> Vec<u8> {
    (-2i16..10).flat_map(i16::to_le_bytes).collect()
}

fn read_path(path: &Path) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let mut source = open(path)?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
    Ok((desc, out))
}

/// Reads a file of `header`, a blank line, and `voxels`.
fn read(header: &str, voxels: &[u8]) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    let mut bytes = format!("{header}\n").into_bytes();
    bytes.extend(voxels);
    std::fs::write(file.path(), bytes).unwrap();
    read_path(file.path())
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

#[test]
fn encodings_skips_and_byte_orders() {
    let be = big_endian_voxels();
    let mut skipped = b"one line\nxyz".to_vec();
    skipped.extend(&be);
    let mut inside = vec![9; 5];
    inside.extend(&be);
    let cases = [
        ("endian: big\nencoding: raw\n", be.clone()),
        ("endian: big\r\nencoding: gzip\r\n", gzip(&be)),
        (
            "endian: little\nencoding: gz\n",
            gzip(&little_endian_voxels()),
        ),
        (
            "endian: big\nencoding: raw\nline skip: 1\nbyte skip: 3\n",
            skipped.clone(),
        ),
        ("endian: big\nencoding: raw\nbyte skip: -1\n", skipped),
        ("endian: big\nencoding: gzip\nbyte skip: 5\n", gzip(&inside)),
    ];
    for (fields, voxels) in cases {
        let (desc, out) = read(&format!("{BASE}{fields}"), &voxels).unwrap();
        assert_eq!(out, little_endian_voxels(), "{fields}");
        assert_eq!(desc.dims, U64Vec3::new(3, 2, 2), "{fields}");
        assert_eq!(desc.world_from_index, DAffine3::IDENTITY, "{fields}");
    }
}

#[test]
fn a_detached_file_is_found_beside_the_header() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("my voxels.raw"), big_endian_voxels()).unwrap();
    let header = dir.path().join("a.nhdr");
    let text = format!("{BASE}endian: big\nencoding: raw\ndata file: ./my voxels.raw\n");
    std::fs::write(&header, text).unwrap();
    assert_eq!(
        read_path(&header).unwrap().1,
        little_endian_voxels(),
        "voxels"
    );
    for (list, word) in [("LIST\na.raw", "several"), ("s%03d.raw 1 9 1", "several")] {
        let text = format!("{BASE}endian: big\nencoding: raw\ndata file: {list}\n");
        std::fs::write(&header, text).unwrap();
        let error = read_path(&header).err().unwrap().to_string();
        assert!(error.contains(word), "{list}: {error}");
    }
}

#[test]
fn spaces_become_ras() {
    let columns = DMat3::from_cols(
        DVec3::new(0.0, 2.0, 0.0),
        DVec3::new(3.0, 0.0, 0.0),
        DVec3::new(0.0, 0.5, 4.0),
    );
    let origin = DVec3::new(1.0, 2.0, 3.0);
    for (space, signs) in [
        ("RAS", [1.0, 1.0, 1.0]),
        ("right-anterior-superior", [1.0, 1.0, 1.0]),
        ("LPS", [-1.0, -1.0, 1.0]),
        ("left-posterior-superior", [-1.0, -1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0, 1.0]),
    ] {
        let fields = format!(
            "{BASE}endian: big\nencoding: raw\nspace: {space}\n\
             space directions: (0,2,0) (3,0,0) (0,0.5,4)\nspace origin: (1,2,3)\n"
        );
        let (desc, _) = read(&fields, &big_endian_voxels()).unwrap();
        let signs = DVec3::from_array(signs);
        assert_eq!(
            desc.world_from_index,
            DAffine3::from_mat3_translation(DMat3::from_diagonal(signs) * columns, origin * signs),
            "{space}"
        );
    }
}

#[test]
fn without_a_space_only_spacing_is_kept() {
    let be = big_endian_voxels();
    let read = |fields: &str| {
        read(&format!("{BASE}endian: big\nencoding: raw\n{fields}"), &be)
            .map(|(desc, _)| desc.world_from_index)
            .map_err(|e| e.to_string())
    };
    assert_eq!(
        read("spacings: 1 2 3.5\n"),
        Ok(DAffine3::from_scale(DVec3::new(1.0, 2.0, 3.5))),
        "spacings"
    );
    assert_eq!(
        read("space dimension: 3\nspace directions: (0,2,0) (3,0,0) (0,0,4)\n"),
        Ok(DAffine3::from_scale(DVec3::new(2.0, 3.0, 4.0))),
        "lengths of directions"
    );
    assert_eq!(
        read("spacings: 1 1 1\nunits: \"um\" \"um\" \"um\"\n"),
        Ok(DAffine3::from_scale(DVec3::splat(0.001))),
        "micrometres"
    );
    for bad in ["1 nan 1", "1 0 1", "1 inf 1", "1 -1 1", "1 1", "a b c"] {
        let error = read(&format!("spacings: {bad}\n")).unwrap_err();
        assert!(error.contains("'spacings'"), "{bad}: {error}");
    }
}

#[test]
fn axes_outside_of_space_need_one_sample() {
    let header = |sizes: &str| {
        format!(
            "NRRD0005\ntype: short\ndimension: 4\nsizes: {sizes}\nkinds: list domain domain domain\n\
             endian: big\nencoding: raw\nspace: RAS\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n"
        )
    };
    let (desc, _) = read(&header("1 3 2 2"), &big_endian_voxels()).unwrap();
    assert_eq!(desc.dims, U64Vec3::new(3, 2, 2), "dropped");
    let error = read(&header("3 2 2 1"), &big_endian_voxels())
        .err()
        .unwrap();
    assert!(
        error.to_string().contains("an axis of 3 samples"),
        "{error}"
    );
}

#[test]
fn wrong_headers_name_the_field() {
    for (fields, word) in [
        ("encoding: raw\n", "'endian'"),
        ("endian: big\nencoding: bzip2\n", "bzip2"),
        ("endian: big\nencoding: hex\n", "hex"),
        ("endian: big\nencoding: fancy\n", "'encoding'"),
        ("endian: big\nencoding: raw\nsizes: 1 1 1\n", "'sizes'"),
        ("endian: big\nencoding: raw\nnonsense\n", "line 9"),
        ("endian: big\nencoding: raw\nbyte skip: 1\n", "25 bytes"),
        (
            "endian: big\nencoding: raw\nspace: LPS\nspace directions: (1,0,0) (1,0,0) (0,0,1)\n",
            "'space directions'",
        ),
    ] {
        let error = read(&format!("{BASE}{fields}"), &big_endian_voxels())
            .err()
            .map(|e| e.to_string())
            .unwrap_or_default();
        let short = word == "25 bytes" && error.contains("24 bytes from byte");
        assert!(error.contains(word) || short, "{word}: {error}");
    }
    let endless = "x".repeat(2 << 20);
    let error = read(&format!("{BASE}content: {endless}\n"), &[])
        .err()
        .unwrap();
    assert!(error.to_string().contains("1048576"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        changes in prop::collection::vec((0usize..400, any::<u8>()), 1..6),
        cut in 10usize..500,
    ) {
        let text = format!(
            "{BASE}endian: big\nencoding: gzip\nspace: LPS\nspace directions: (0,2,0) (3,0,0) (0,0,4)\n\
             space origin: (1,2,3)\nbyte skip: 0\nline skip: 0\nspacings: 1 1 1\n\n"
        );
        let mut bytes = text.into_bytes();
        bytes.extend(gzip(&big_endian_voxels()));
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
