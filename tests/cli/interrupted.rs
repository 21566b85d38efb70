//! Killed, interrupted, out of space: no output is ever half there.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::run::{Folder, finish};

/// Far more than can be bricked before the test is over.
const LARGE: &str = "phantom:body:1500,1500,1500";

/// Starts bricking something large and waits until the output is being written.
fn start(folder: &Folder) -> Child {
    let mut command = folder.command(&["brick", LARGE, "-o", "out.bsk", "--threads", "1"]);
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let begin = Instant::now();
    let has_begun = || {
        fs::read_dir(folder.path())
            .expect("the folder")
            .flatten()
            .any(|e| e.metadata().is_ok_and(|m| m.len() > 0))
    };
    while !has_begun() {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "no output after a minute"
        );
        assert!(
            child.try_wait().expect("a child").is_none(),
            "ended before it wrote anything"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

#[test]
fn killed_in_the_middle_leaves_no_output() {
    let folder = Folder::new();
    let mut child = start(&folder);
    child.kill().expect("SIGKILL");
    let status = child.wait().expect("a child");
    assert_eq!(status.code(), None, "killed, not finished: {status}");
    assert!(
        !folder.file("out.bsk").exists(),
        "no output; there is {:?}",
        folder.names()
    );
}

#[test]
fn interrupts_leave_nothing_behind() {
    for (signal, code) in [("INT", 130), ("TERM", 130)] {
        let folder = Folder::new();
        let mut child = start(&folder);
        let sent = Command::new("kill")
            .args([&format!("-{signal}"), &child.id().to_string()])
            .status();
        assert!(sent.expect("kill").success(), "the signal was sent");
        let begin = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().expect("a child") {
                break status;
            }
            if begin.elapsed() > Duration::from_secs(20) {
                child.kill().expect("SIGKILL");
                panic!("{signal} was not heeded for 20 seconds");
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        assert_eq!(status.code(), Some(code), "{signal}: exit code");
        assert!(
            folder.names().is_empty(),
            "{signal}: nothing is left, but there is {:?}",
            folder.names()
        );
    }
}

#[test]
fn an_interrupted_force_keeps_the_old_store() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "out.bsk");
    let before = fs::read(folder.file(store)).expect("the store");
    let mut command = folder.command(&["brick", LARGE, "-o", store, "--force", "--threads", "1"]);
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    let begin = Instant::now();
    while folder.names().len() < 2 {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "no output after a minute"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().expect("SIGKILL");
    child.wait().expect("a child");
    assert_eq!(
        fs::read(folder.file(store)).expect("the store"),
        before,
        "the old store is as it was"
    );
}

/// A write that fails in the middle, on any machine: the shell limits the size of files, and the signal that would
/// come with it is ignored, so that the write returns an error as it does on a full disk.
#[test]
fn a_failing_write_is_reported_and_leaves_nothing() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:64,64,64:u16", "s.bsk");
    for args in [
        &["brick", "phantom:body:64,64,64:u16", "-o", "out"][..],
        &["extract", store, "-o", "out.raw"],
        &["extract", store, "-o", "out.nii.gz"],
        &["extract", store, "-o", "out.nrrd"],
        &[
            "render", store, "-o", "out.png", "--size", "200x200", "--mode", "mip", "--device",
            "cpu", "--step", "4",
        ],
    ] {
        let mut command = Command::new("sh");
        let script = "trap '' XFSZ; ulimit -f 4; exec \"$@\"";
        command
            .args(["-c", script, "sh", env!("CARGO_BIN_EXE_brickscope")])
            .args(args)
            .current_dir(folder.path());
        let run = finish(command).expect(2);
        assert!(
            run.stderr.contains("out") && run.stderr.contains("too large"),
            "{args:?}: {}",
            run.stderr
        );
        assert_eq!(folder.names(), [store], "{args:?}: nothing is left");
    }
}

/// A disk that is really full: a tmpfs of 1 MiB in a mount namespace of its own, so that nothing outlives the test.
#[cfg(target_os = "linux")]
#[test]
#[cfg_attr(no_tmpfs, ignore = "no tmpfs can be mounted here")]
fn a_full_disk_is_reported_and_leaves_nothing() {
    let folder = Folder::new();
    fs::create_dir(folder.file("full")).expect("a mount point");
    let in_namespace = |script: &str, args: &[&str]| {
        let mut command = Command::new("unshare");
        command.args([
            "--mount",
            "--map-root-user",
            "sh",
            "-c",
            script,
            "sh",
            env!("CARGO_BIN_EXE_brickscope"),
        ]);
        command
            .args(args)
            .current_dir(folder.path())
            .stdin(Stdio::null());
        command
    };
    let mount = "mount -t tmpfs -o size=1m none full";
    let script = format!("{mount} && \"$@\"; code=$?; ls -A full; exit $code");
    let run = finish(in_namespace(
        &script,
        &[
            "brick",
            "phantom:body:160,160,160:u16",
            "-o",
            "full/out.bsk",
        ],
    ))
    .expect(2);
    assert!(
        run.stderr.contains("full/out.bsk") && run.stderr.contains("No space left"),
        "{}",
        run.stderr
    );
    assert_eq!(
        run.stdout, "",
        "nothing is left on the full disk, and nothing was printed"
    );
}
