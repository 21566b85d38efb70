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
        ("a", &dicom, "DICOM is not supported"),
        (
            "a.vti",
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\">",
            "VTK XML",
        ),
        ("a.gz", &[0x1f, 0x8b, 8, 0, 0], "gzip of something"),
        ("a.raw", b"bare voxels", "--dims"),
    ] {
        let error = refused(name, bytes, None);
        assert!(error.contains(word), "{name}: {error}");
    }
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
        text(folder).contains("a folder without files"),
        "{}",
        text(folder)
    );
    std::fs::write(dir.path().join("1.tif"), b"II*\0").unwrap();
    std::fs::write(dir.path().join("notes.txt"), "of the microscope").unwrap();
    assert!(text(folder).contains("the header"), "{}", text(folder));
    std::fs::write(dir.path().join("2.TIF"), [0; 100]).unwrap();
    assert!(text(folder).contains("a TIFF slice"), "{}", text(folder));
    std::fs::write(dir.path().join("zarr.json"), b"{}").unwrap();
    assert!(text(folder).contains("OME-Zarr"), "{}", text(folder));
    let missing = dir.path().join("no.nii");
    assert!(
        text(missing.to_str().unwrap()).contains("cannot open"),
        "missing"
    );
    assert!(text("/no/such/*.tif").contains("glob"), "glob");
    assert!(text("https://example.org/a.zarr").contains("URL"), "URL");
}
