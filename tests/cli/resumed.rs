//! `brick --resume` through the real binary: killed at any moment, once or twice, the store is the same to the byte.

use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::run::{Folder, noise};

/// Four seconds of work and more in a build for tests: a checkpoint comes after one.
const ARGS: [&str; 8] = [
    "brick",
    "phantom:body:400,400,400:u16",
    "-o",
    "out.bsk",
    "--threads",
    "1",
    "--zstd",
    "15",
];

fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
    ARGS.iter().chain(more).copied().collect()
}

fn start(folder: &Folder, args: &[&str]) -> Child {
    folder
        .command(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts")
}

/// The newest checkpoint in the folder's journal, 0 without any.
fn checkpoint(folder: &Folder) -> u64 {
    ["journal-0", "journal-1"]
        .iter()
        .filter_map(|name| {
            fs::read(folder.file(&format!(".out.bsk.brickscope-partial/{name}"))).ok()
        })
        .filter_map(|bytes| Some(u64::from_le_bytes(bytes.get(24..32)?.try_into().ok()?)))
        .max()
        .unwrap_or(0)
}

/// Waits until a checkpoint after number `after` is on disk, and some time more, then sends SIGKILL. False when the run was done before.
fn kill_after_checkpoint(mut child: Child, folder: &Folder, after: u64, more_ms: u64) -> bool {
    let begin = Instant::now();
    // The second one: while it is seen being written, the first one is whole.
    while checkpoint(folder) <= after + 1 {
        assert!(begin.elapsed() < Duration::from_secs(60), "no checkpoint");
        if child.try_wait().expect("a child").is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(more_ms));
    child.kill().expect("SIGKILL");
    child.wait().expect("a child").code().is_none()
}

#[test]
fn killed_and_resumed_to_the_byte() {
    let folder = Folder::new();
    folder.run(&ARGS).expect(0);
    let whole = fs::read(folder.file("out.bsk")).expect("the store");
    let mut resumed = 0;
    // At different places between two checkpoints, and so in different layers.
    let random = noise(2);
    for more in random.iter().map(|&r| u64::from(r) * 2) {
        fs::remove_file(folder.file("out.bsk")).expect("the store");
        let killed = kill_after_checkpoint(start(&folder, &ARGS), &folder, 0, more);
        if !killed {
            // This machine was faster than the kill: nothing to resume, which is said.
            continue;
        }
        assert_eq!(
            folder.names(),
            [".out.bsk.brickscope-partial"],
            "only the unfinished parts are left"
        );
        let info = folder.run(&["info", "out.bsk"]).expect(2);
        assert!(
            info.stderr.contains("not finished") && info.stderr.contains("--resume"),
            "{}",
            info.stderr
        );
        let run = folder.run(&with(&["--resume"])).expect(0);
        assert!(
            run.stderr.contains("resuming after slice"),
            "{more} ms: {}",
            run.stderr
        );
        assert!(
            fs::read(folder.file("out.bsk")).expect("the store") == whole,
            "{more} ms: the same to the byte"
        );
        assert_eq!(folder.names(), ["out.bsk"], "nothing else is left");
        resumed += 1;
    }
    assert!(resumed > 0, "no run lasted until a checkpoint");

    // Killed twice.
    fs::remove_file(folder.file("out.bsk")).expect("the store");
    if kill_after_checkpoint(start(&folder, &ARGS), &folder, 0, 0) {
        let first = checkpoint(&folder);
        let again = start(&folder, &with(&["--resume"]));
        kill_after_checkpoint(again, &folder, first, 10);
    }
    // The second one may have come to its end.
    if !folder.file("out.bsk").exists() {
        folder.run(&with(&["--resume"])).expect(0);
    }
    assert!(
        fs::read(folder.file("out.bsk")).expect("the store") == whole,
        "killed twice: the same to the byte"
    );
    assert_eq!(folder.names(), ["out.bsk"], "nothing else is left");
}

#[test]
fn refusals_interrupts_and_other_processes() {
    let folder = Folder::new();
    assert!(
        kill_after_checkpoint(start(&folder, &ARGS), &folder, 0, 0),
        "killed in the middle"
    );
    // Another input, other options: refused by what differs, and nothing is lost.
    for (args, words) in [
        (
            &[
                "brick",
                "phantom:body:400,400,400:u8",
                "-o",
                "out.bsk",
                "--zstd",
                "15",
                "--resume",
            ][..],
            ["the voxel type was u16 and is u8", "the source"],
        ),
        (
            &[
                "brick",
                "phantom:body:400,400,400:u16",
                "-o",
                "out.bsk",
                "--zstd",
                "8",
                "--resume",
            ],
            ["--zstd was 15 and is 8", "out.bsk"],
        ),
    ] {
        let run = folder.run(args).expect(2);
        for word in words {
            assert!(run.stderr.contains(word), "'{word}' in: {}", run.stderr);
        }
        assert!(checkpoint(&folder) > 0, "the unfinished parts stay");
    }
    // A second process on the same output is refused while the first one works.
    let mut first = start(&folder, &with(&["--resume"]));
    let seen = checkpoint(&folder);
    let begin = Instant::now();
    while checkpoint(&folder) == seen && first.try_wait().expect("a child").is_none() {
        assert!(begin.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    let second = folder.run(&with(&[])).expect(2);
    assert!(
        second.stderr.contains("another process") || second.stderr.contains("already exists"),
        "{}",
        second.stderr
    );
    // Ctrl-C leaves nothing, here as ever.
    let sent = std::process::Command::new("kill")
        .args(["-INT", &first.id().to_string()])
        .status();
    assert!(sent.expect("kill").success(), "the signal was sent");
    let status = first.wait().expect("a child");
    if status.code() == Some(130) {
        assert!(
            folder.names().is_empty(),
            "nothing is left: {:?}",
            folder.names()
        );
    } else {
        assert_eq!(folder.names(), ["out.bsk"], "it was done before the signal");
    }
}

/// A changed file is refused by what its length and time say; a stream is read again and says so.
#[test]
fn files_are_known_by_length_and_time_and_streams_are_read_again() {
    let folder = Folder::new();
    let dims = [400u32, 400, 200];
    let mut bytes = crate::run::nifti_header(dims.map(|n| n as i16), 512, 16);
    let voxels = noise(1 << 20);
    for _ in 0..62 {
        bytes.extend_from_slice(&voxels);
    }
    bytes.truncate(352 + 400 * 400 * 200 * 2);
    folder.write("a.nii.gz", &crate::run::gzip(&bytes));
    let args = [
        "brick",
        "a.nii.gz",
        "-o",
        "out.bsk",
        "--threads",
        "1",
        "--zstd",
        "15",
    ];
    let resume = [&args[..], &["--resume"]].concat();
    assert!(
        kill_after_checkpoint(start(&folder, &args), &folder, 0, 0),
        "killed in the middle"
    );
    let file = fs::File::options()
        .append(true)
        .open(folder.file("a.nii.gz"))
        .expect("the source");
    let time = file.metadata().and_then(|m| m.modified()).expect("a time");
    file.set_modified(time + Duration::from_secs(60))
        .expect("another time");
    let run = folder.run(&resume).expect(2);
    assert!(
        run.stderr.contains("the source's file was") && run.stderr.contains("bytes, changed at"),
        "{}",
        run.stderr
    );
    file.set_modified(time).expect("the old time");
    let run = folder.run(&resume).expect(0);
    assert!(
        run.stderr.contains("resuming after slice") && run.stderr.contains("read again"),
        "{}",
        run.stderr
    );
    let resumed = fs::read(folder.file("out.bsk")).expect("the store");
    let straight = [&args[..], &["--force"]].concat();
    folder.run(&straight).expect(0);
    assert!(
        fs::read(folder.file("out.bsk")).expect("the store") == resumed,
        "the same to the byte"
    );
}
