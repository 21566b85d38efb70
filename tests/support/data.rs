//! The folder of real volumes. Tests that need it carry
//! `#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]`; build.rs looks for it in the same place.

use std::path::PathBuf;

/// A file of that folder: `nifti/engine.nii.gz`.
pub fn data(name: &str) -> PathBuf {
    let folder = std::env::var_os("BRICKSCOPE_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    assert!(
        path.exists(),
        "{} is missing; BRICKSCOPE_DATA says where the volumes are",
        path.display()
    );
    path
}
