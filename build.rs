//! Cfgs for the tests, so that what can't run here is reported as ignored, never as passed: `no_brickscope_data` where
//! the folder of real volumes is missing, `skip_gpu_tests` with `SKIP_GPU_TESTS=1`, `no_tmpfs` and `no_setpriv` where the
//! tests of a full disk and of an unreadable file can't be set up.

use std::env;
use std::path::PathBuf;
use std::process::{Command, Stdio};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=BRICKSCOPE_DATA");
    println!("cargo::rerun-if-env-changed=SKIP_GPU_TESTS");
    println!("cargo::rustc-check-cfg=cfg(no_brickscope_data)");
    println!("cargo::rustc-check-cfg=cfg(skip_gpu_tests)");
    println!("cargo::rustc-check-cfg=cfg(no_tmpfs)");
    println!("cargo::rustc-check-cfg=cfg(no_setpriv)");

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
    // In a mount namespace of its own: nothing stays mounted.
    let mount = [
        "--mount",
        "--map-root-user",
        "mount",
        "-t",
        "tmpfs",
        "-o",
        "size=1m",
        "none",
        "/mnt",
    ];
    if !works("unshare", &mount) {
        println!("cargo::rustc-cfg=no_tmpfs");
    }
    if !works(
        "setpriv",
        &["--bounding-set=-dac_override,-dac_read_search", "true"],
    ) {
        println!("cargo::rustc-cfg=no_setpriv");
    }
    if env::var("SKIP_GPU_TESTS").is_ok_and(|v| v == "1") {
        println!("cargo::rustc-cfg=skip_gpu_tests");
    }
}

/// Does this command exist and succeed?
fn works(program: &str, args: &[&str]) -> bool {
    Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}
