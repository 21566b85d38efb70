//! Real scans (BRICKSCOPE_DATA): every file of a built format goes in, verifies, and is drawn alike by both renderers; one
//! head in 48 axis orders and flips gives one picture; meshes of other programs are read.
#![cfg(feature = "gpu")]

#[path = "support/compare.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod compare;
#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the other tests of pictures")]
mod scenes;

use std::path::{Path, PathBuf};

use brickscope::bricking::{self, NoProgress};
use brickscope::classify::grey_ramp;
use brickscope::clip::TriangleMesh;
use brickscope::input::OpenOptions;
use brickscope::scene::{Mode, PictureSettings, default_window};
use compare::{coverage, difference};
use glam::DVec3;
use scenes::{TestStore, drawn, reference, settings, store_of};

/// The folder of the scans.
fn data() -> PathBuf {
    std::env::var_os("BRICKSCOPE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    )
}

/// The files below `folder` (of the data) whose names end in one of `endings`, sorted.
fn files(folder: &str, endings: &[&str]) -> Vec<PathBuf> {
    let mut out: Vec<PathBuf> = std::fs::read_dir(data().join(folder))
        .unwrap_or_else(|e| panic!("{folder}: {e}"))
        .map(|entry| entry.expect("a readable folder").path())
        .filter(|path| endings.iter().any(|e| path.to_string_lossy().ends_with(e)))
        .collect();
    out.sort();
    assert!(!out.is_empty(), "{folder} has files");
    out
}

fn bricked(path: &Path) -> TestStore {
    bricked_as(path, &OpenOptions::default())
}

fn bricked_as(path: &Path, options: &OpenOptions) -> TestStore {
    let mut source =
        brickscope::input::open(&path.to_string_lossy(), options).unwrap_or_else(|e| panic!("{e}"));
    store_of(source.as_mut())
}

/// A picture with the default grey ramp from the default orbit.
fn plain(store: &TestStore, mode: Mode, edge: u32) -> PictureSettings {
    let mut s = settings(&store.store, mode);
    let [low, high] = default_window(store.store.meta());
    s.classification.transfer =
        grey_ramp(low, high, if mode == Mode::Mip { 1.0 } else { 0.5 }).expect("a window");
    s.classification.iso[0].value = low + 0.3 * (high - low);
    s.size = [edge; 2];
    s
}

#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
fn every_scan_of_a_built_format_is_bricked_and_verifies() {
    let lists = [
        files("nifti", &[".nii", ".nii.gz"]),
        files("nrrd", &[".nrrd", ".nhdr"]),
        files("metaimage", &[".mha", ".mhd"]),
        files("labels", &[".nii.gz"]),
        files("vti", &[".vti"]),
        files(
            "tiff",
            &["img3d.tif", "head.tif", "chromosomes.tif", "em-series"],
        ),
        files("dicom", &["pet", "jpeg2000"]),
        files("zarr", &["simple_0.4", "simple_0.5"]),
    ];
    let plain = lists
        .into_iter()
        .flatten()
        .map(|p| (p, OpenOptions::default()));
    // What has to be chosen, or asked for.
    let even = OpenOptions {
        resample_gaps: true,
        ..OpenOptions::default()
    };
    let channel = OpenOptions {
        channel: Some(1),
        ..OpenOptions::default()
    };
    let chosen = [
        (data().join("dicom/head-tilted"), even),
        (data().join("tiff/xyzc_16bit__dna_conf_wf.tif"), channel),
    ];
    for (path, options) in plain.chain(chosen) {
        let store = bricked_as(&path, &options);
        let report =
            bricking::verify(&store.store, 10, &NoProgress).expect("the store can be read");
        assert_eq!(
            report.fault_count,
            0,
            "{}: {:?}",
            path.display(),
            report.faults
        );
    }
}

#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
fn what_leaves_a_choice_is_refused_with_what_there_is() {
    for (name, words) in [
        ("dicom", &["found 4", "PET WB_0", "--series"][..]),
        (
            "dicom/head-tilted",
            &["4.22 mm", "1.14 mm", "7.38 mm", "--resample-gaps"],
        ),
        ("dicom/pet-seg", &["DICOM-SEG"]),
        (
            "tiff/xyzc_16bit__dna_conf_wf.tif",
            &["2 channels", "--channel"],
        ),
    ] {
        let path = data().join(name);
        let refused = brickscope::input::open(&path.to_string_lossy(), &Default::default());
        let message = refused.err().expect("a refusal").to_string();
        for word in words {
            assert!(message.contains(word), "{name}: {word:?} in {message}");
        }
    }
}

#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
fn meshes_of_other_programs_are_read_and_can_cut() {
    for path in files("mesh", &[".obj", ".ply", ".stl"]) {
        let mesh = TriangleMesh::read(&path).unwrap_or_else(|e| panic!("{e}"));
        let closed = mesh.check_closed();
        let shown = closed
            .as_ref()
            .map_or_else(ToString::to_string, |()| "closed".to_owned());
        println!("{}: {mesh:?}, {shown}", path.display());
        assert!(closed.is_ok(), "{}: {shown}", path.display());
        // A ray along x through the middle enters as often as it leaves.
        let bounds = mesh.bounds();
        let mut origin = bounds.center();
        origin.x = bounds.min.x - 1.0;
        let mut crossings = Vec::new();
        mesh.crossings(origin, DVec3::X, &mut crossings);
        let entered = crossings.iter().filter(|c| c.enters).count();
        assert!(entered > 0, "{}: nothing is met", path.display());
        assert_eq!(entered * 2, crossings.len(), "{}", path.display());
    }
}

#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn one_head_in_48_orientations_is_one_picture() {
    let mut first: Option<brickscope::scene::Image> = None;
    let paths = files("nifti/orientations", &[".nii.gz"]);
    assert_eq!(paths.len(), 48, "all axis orders and flips");
    for path in paths {
        let store = bricked(&path);
        let picture = drawn(&store, &plain(&store, Mode::Mip, 96)).image;
        assert!(
            coverage(&picture) > 0.1,
            "{}: something is seen",
            path.display()
        );
        match &first {
            None => first = Some(picture),
            Some(first) => {
                // The voxels are the same; affines are rounded to f32 in each file. An axis the wrong way round is off by
                // a third of the range in most pixels.
                let d = difference(first, &picture, 0.02);
                assert!(d.mean < 2e-3 && d.beyond < 96, "{}: {d}", path.display());
            }
        }
    }
}

#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn the_gpu_draws_scans_as_the_reference_does() {
    let mut paths: Vec<PathBuf> = files("nifti/orientations", &[".nii.gz"])
        .into_iter()
        .step_by(8)
        .collect();
    assert_eq!(paths.len(), 6, "six of the 48");
    for name in [
        "nifti/T1.nii.gz",
        "labels/aorta-ct.nii.gz",
        "nrrd/tooth.nhdr",
        "nrrd/fetal-atlas.nrrd",
    ] {
        paths.push(data().join(name));
    }
    for path in paths {
        let store = bricked(&path);
        for mode in [Mode::Dvr, Mode::Iso, Mode::Mip] {
            let s = plain(&store, mode, 256);
            let (gpu, cpu) = (drawn(&store, &s).image, reference(&store, &s).image);
            let d = difference(&gpu, &cpu, compare::TWIN_BOUND);
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            println!(
                "{name:32} {:4} largest {:.2e} mean {:.2e} beyond {}",
                mode.name(),
                d.max,
                d.mean,
                d.beyond
            );
            // As in tests/twin.rs: an iso hit is decided by comparing.
            let allowed = if mode == Mode::Iso {
                gpu.pixels.len() / 1000
            } else {
                0
            };
            assert!(d.beyond <= allowed, "{name} {}: {d}", mode.name());
        }
    }
}
