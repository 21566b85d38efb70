//! What is told from content, and how the rest is refused.

use glam::{DVec3, U64Vec3};

use super::*;
use crate::input::{Endian, RawParams};
use crate::volume::VoxelType;

fn raw() -> RawParams {
    RawParams {
        dims: U64Vec3::new(2, 2, 2),
        voxel_type: VoxelType::U8,
        endian: Endian::Little,
        spacing: DVec3::ONE,
        offset: 0,
    }
}

/// The error of opening a file called `name` that holds `bytes`.
fn refused(name: &str, bytes: &[u8], raw: Option<RawParams>) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    match open(
        path.to_str().unwrap(),
        &OpenOptions {
            raw,
            ..Default::default()
        },
    ) {
        Ok(_) => panic!("{name} was opened"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn content_counts_not_the_name() {
    let nrrd = b"NRRD0001\ntype: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\nx";
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("misnamed.nii");
    std::fs::write(&path, nrrd).unwrap();
    assert!(
        open(path.to_str().unwrap(), &Default::default()).is_ok(),
        "an NRRD file called .nii"
    );
    assert!(
        open("phantom:body:8,8,8", &Default::default()).is_ok(),
        "a phantom"
    );
}

#[test]
fn what_cannot_be_opened_says_why() {
    let mut dicom = vec![0; 128];
    dicom.extend(b"DICM");
    for (name, bytes, word) in [
        ("empty.nii", &b""[..], "an empty file"),
        ("a.tif", b"II*\0....", "the directory of page 0"),
        ("big.tif", b"MM\0+....", "offsets of 8 bytes"),
        ("a.png", b"\x89PNG\r\n\x1a\n", "a sound PNG picture"),
        ("a.jpg", b"\xff\xd8\xff\xe0....", "a sound JPEG picture"),
        ("a", &dicom, "(0002,0010)"),
        (
            "a.vti",
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\">",
            "the VTK XML",
        ),
        (
            "a.vtp",
            b"<VTKFile type=\"PolyData\"></VTKFile>",
            "VTK XML of type \"PolyData\" is not supported",
        ),
        ("a.vtk", b"# vtk DataFile Version 3.0\n", "VTK legacy"),
        ("a.img", b"bare voxels", "the header of these voxels"),
        ("a.gz", &[0x1f, 0x8b, 8, 0, 0], "gzip of something"),
        ("a.raw", b"bare voxels", "--dims"),
    ] {
        let error = refused(name, bytes, None);
        assert!(error.contains(word), "{name}: {error}");
    }
}

#[test]
fn small_formats_are_told_by_content() {
    let mut mgh = vec![0; 284];
    for (i, n) in [1i32, 2, 3, 4, 1, 0].into_iter().enumerate() {
        mgh[4 * i..4 * i + 4].copy_from_slice(&n.to_be_bytes());
    }
    let mut mrc = vec![0; 1024];
    for (word, n) in [(0, 2i32), (1, 3), (2, 4), (3, 2), (16, 1), (17, 2), (18, 3)] {
        mrc[4 * word..4 * word + 4].copy_from_slice(&n.to_le_bytes());
    }
    let mut old = mrc.clone();
    mrc[208..212].copy_from_slice(b"MAP ");
    let compressed = false;
    assert_eq!(format(&mgh), Some(Format::Mgh { compressed }), "MGH");
    assert_eq!(format(&mrc), Some(Format::Mrc { compressed }), "MRC");
    assert_eq!(
        format(&old),
        Some(Format::Mrc { compressed }),
        "MRC before its mark"
    );
    old[64] = 2;
    assert_eq!(format(&old), None, "an axis twice");
    for (bytes, expected) in [
        (&mgh, Format::Mgh { compressed: true }),
        (&mrc, Format::Mrc { compressed: true }),
    ] {
        let mut e = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut e, bytes).unwrap();
        let packed = e.finish().unwrap();
        assert_eq!(format(&packed), Some(expected), "in gzip");
        assert_eq!(
            format(&packed[..packed.len() - 9]),
            Some(expected),
            "the first bytes of gzip"
        );
    }
    mgh[23] = 11;
    assert_eq!(format(&mgh), None, "a type that MGH does not have");
}

#[test]
fn either_file_of_a_pair_opens_it() {
    let dir = tempfile::tempdir().unwrap();
    let mut header = vec![0u8; 348];
    header[..4].copy_from_slice(&348u32.to_le_bytes());
    for (i, n) in [3i16, 2, 2, 2].into_iter().enumerate() {
        header[40 + 2 * i..42 + 2 * i].copy_from_slice(&n.to_le_bytes());
    }
    header[70] = 2;
    for i in 1..4 {
        header[76 + 4 * i..80 + 4 * i].copy_from_slice(&1f32.to_le_bytes());
    }
    std::fs::write(dir.path().join("a.hdr"), header).unwrap();
    std::fs::write(dir.path().join("a.img"), [3; 8]).unwrap();
    for name in ["a.hdr", "a.img"] {
        let path = dir.path().join(name);
        let source = open(path.to_str().unwrap(), &Default::default()).unwrap();
        assert_eq!(source.desc().dims, U64Vec3::splat(2), "{name}");
        assert!(!source.notes().is_empty(), "{name}: what was not known");
    }
    let mut params = raw();
    params.dims.z = 2;
    let path = dir.path().join("a.img");
    assert!(
        open(path.to_str().unwrap(), &OpenOptions::of_raw(params)).is_ok(),
        "whoever says what the voxels are is believed"
    );
}

#[test]
fn raw_options_are_for_raw() {
    let error = refused("a.nrrd", b"NRRD0004\n", Some(raw()));
    assert!(error.contains("NRRD"), "{error}");
    let error = match open("phantom:body:8,8,8", &OpenOptions::of_raw(raw())) {
        Ok(_) => panic!("options for .raw were taken for a phantom"),
        Err(e) => e.to_string(),
    };
    assert!(error.contains("a phantom"), "{error}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.raw");
    std::fs::write(&path, b"NRRD0004").unwrap();
    assert!(
        open(path.to_str().unwrap(), &OpenOptions::of_raw(raw())).is_ok(),
        "voxels may look like a header"
    );
}

#[test]
fn folders_missing_files_and_globs() {
    let dir = tempfile::tempdir().unwrap();
    let text = |spec: &str| match open(spec, &OpenOptions::default()) {
        Ok(_) => panic!("{spec} was opened"),
        Err(e) => e.to_string(),
    };
    let folder = dir.path().to_str().unwrap();
    assert!(
        text(folder).contains("a folder without volumes"),
        "{}",
        text(folder)
    );
    std::fs::write(dir.path().join("1.tif"), b"II*\0").unwrap();
    std::fs::write(dir.path().join("notes.txt"), "of the microscope").unwrap();
    assert!(text(folder).contains("the header"), "{}", text(folder));
    std::fs::write(dir.path().join("2.TIF"), [0; 100]).unwrap();
    assert!(text(folder).contains("a TIFF slice"), "{}", text(folder));
    std::fs::write(dir.path().join("zarr.json"), b"{}").unwrap();
    assert!(text(folder).contains("zarr.json"), "{}", text(folder));
    let missing = dir.path().join("no.nii");
    assert!(
        text(missing.to_str().unwrap()).contains("cannot open"),
        "missing"
    );
    assert!(text("/no/such/*.tif").contains("the glob"), "glob");
    assert!(text("s3://bucket/a.zarr").contains("s3"), "URL");
}
