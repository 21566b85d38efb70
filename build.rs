//! Two cfgs for the tests, so that what can't run here is reported as ignored, never as passed:
//! `no_brickscope_data` where the folder of real volumes is missing, `skip_gpu_tests` with `SKIP_GPU_TESTS=1`.

use std::env;
use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=BRICKSCOPE_DATA");
    println!("cargo::rerun-if-env-changed=SKIP_GPU_TESTS");
    println!("cargo::rustc-check-cfg=cfg(no_brickscope_data)");
    println!("cargo::rustc-check-cfg=cfg(skip_gpu_tests)");

    // tests/support/data.rs finds the folder in the same way, when the tests run.
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let folder =
        env::var_os("BRICKSCOPE_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let readme = folder.join("README.md");
    if readme.is_file() {
        // Should the folder go away, the tests are to be ignored again.
        println!("cargo::rerun-if-changed={}", readme.display());
    } else {
        println!("cargo::rustc-cfg=no_brickscope_data");
    }
    if env::var("SKIP_GPU_TESTS").is_ok_and(|v| v == "1") {
        println!("cargo::rustc-cfg=skip_gpu_tests");
    }
}
