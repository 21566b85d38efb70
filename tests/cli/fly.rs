//! `fly`: frames are those of `render`, a folder is gone on with, films are complete or not there.

use std::fs;

use brickscope::camera::CameraPath;
use serde_json::Value;

use crate::run::{Folder, Run, finish, read_png};

const PATH: &str = r#"{"keys":[
    {"t":1, "eye":[-60,-70,20], "target":[24,24,24], "up":[0,0,1], "fov":30},
    {"t":2, "eye":[20,-90,40], "target":[24,24,24], "up":[0,0,1], "fov":35},
    {"t":3, "eye":[90,-60,30], "target":[20,30,24], "up":[0,0,1], "fov":30}]}"#;

const MODE: [&str; 4] = ["--mode", "iso", "--iso", "1500"];

/// A store and a path.
fn prepared() -> Folder {
    let folder = Folder::new();
    folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    folder.write("path.json", PATH.as_bytes());
    folder
}

fn args<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let base = [
        "fly",
        "body.bsk",
        "--path",
        "path.json",
        "-o",
        output,
        "--device",
        "cpu",
        "--size",
        "32x24",
        "--fps",
        "3",
    ];
    [&base, &MODE[..], more].concat()
}

fn fly(folder: &Folder, output: &str, more: &[&str]) -> Run {
    folder.run(&args(output, more))
}

fn frames(folder: &Folder, output: &str) -> Vec<(String, Vec<u8>)> {
    let mut names: Vec<String> = fs::read_dir(folder.file(output))
        .expect("a folder")
        .map(|e| {
            e.expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .filter(|n| n != "fly.json")
        .collect();
    names.sort();
    let read = |n: String| {
        let bytes = fs::read(folder.file(output).join(&n)).expect("a frame");
        (n, bytes)
    };
    names.into_iter().map(read).collect()
}

#[test]
fn frames_are_those_of_render() {
    let folder = prepared();
    let json = fly(&folder, "film", &["--json", "--stats", "s.json"])
        .expect(0)
        .stdout;
    let report: Value = serde_json::from_str(&json).expect("one JSON object");
    assert_eq!(
        (&report["frames"], &report["drawn"]),
        (&6.into(), &6.into())
    );
    assert!(
        report["realtime"].is_null() && report.get("per_frame").is_none(),
        "{json}"
    );
    let stats = fs::read(folder.file("s.json")).expect("statistics");
    let stats: Value = serde_json::from_slice(&stats).expect("JSON");
    assert_eq!(stats["per_frame"].as_array().map(Vec::len), Some(6));
    assert_eq!(stats["per_frame"][5]["stats"]["converged"], true);

    let frames = frames(&folder, "film");
    let names: Vec<&str> = frames.iter().map(|(n, _)| n.as_str()).collect();
    assert_eq!([names[0], names[5]], ["frame-00000.png", "frame-00005.png"]);
    assert_eq!(names.len(), 6, "two seconds at three frames each");
    let path = CameraPath::read(&folder.file("path.json")).expect("a path");
    for (number, (name, bytes)) in frames.iter().enumerate() {
        let camera = path.camera_at(1.0 + number as f64 / 3.0);
        folder.write("camera.json", camera.to_json().as_bytes());
        let picture = [
            "render",
            "body.bsk",
            "-o",
            "p.png",
            "--camera",
            "camera.json",
            "--device",
            "cpu",
            "--size",
            "32x24",
        ];
        folder.run(&[&picture[..], &MODE].concat()).expect(0);
        assert!(
            fs::read(folder.file("p.png")).expect("a picture") == *bytes,
            "{name} is the picture of render"
        );
    }
    assert!(frames[0].1 != frames[5].1, "the camera moves");
}

#[test]
fn a_folder_is_gone_on_with_and_another_flight_refused() {
    let folder = prepared();
    fly(&folder, "film", &[]).expect(0);
    let whole = frames(&folder, "film");
    let frame = |n: usize| folder.file("film").join(&whole[n].0);
    fs::remove_file(frame(1)).expect("a frame");
    fs::write(frame(4), &whole[4].1[..whole[4].1.len() / 2]).expect("half a frame");
    let json = fly(&folder, "film", &["--json"]).expect(0).stdout;
    let report: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(report["drawn"], 2, "only what was missing: {json}");
    assert!(frames(&folder, "film") == whole, "the same bytes");

    for (more, named) in [
        (&["--step", "2"][..], "settings.step"),
        (&["--seconds", "1"], "frames"),
        (&["--near", "3"], "settings.near_mm"),
        (&["--background", "#ffffff"], "settings.background"),
    ] {
        let refused = fly(&folder, "film", more).expect(2);
        assert!(
            refused.stderr.contains(named) && refused.stderr.contains("--force"),
            "{more:?}: {}",
            refused.stderr
        );
        assert!(
            frames(&folder, "film") == whole,
            "{more:?}: nothing is touched"
        );
    }
    // What makes no picture removes none.
    for more in [
        &["--force", "--mode", "iso"][..],
        &["--force", "--tf", "nowhere"],
        &["--force", "--lod", "9"],
    ] {
        let without_mode = [&args("film", more)[..12], more].concat();
        let refused = folder.run(&without_mode).expect(2);
        assert!(
            frames(&folder, "film") == whole,
            "{more:?}: {}",
            refused.stderr
        );
    }
    fly(&folder, "film", &["--seconds", "1", "--force"]).expect(0);
    assert_eq!(frames(&folder, "film").len(), 3, "all frames anew");
}

#[test]
fn what_would_be_written_twice_is_refused() {
    let folder = prepared();
    fly(&folder, "film", &["--seconds", "0.3"]).expect(0);
    for stats in ["film/fly.json", "film/frame-00000.png", "./film"] {
        let refused = fly(&folder, "film", &["--stats", stats]).expect(2);
        assert!(refused.stderr.contains(stats), "{}", refused.stderr);
    }
    fly(
        &folder,
        "film",
        &["--seconds", "0.3", "--stats", "film/s.json"],
    )
    .expect(0);
    let stats = fs::read(folder.file("film/s.json")).expect("statistics");
    let stats: Value = serde_json::from_slice(&stats).expect("JSON");
    assert_eq!(stats["device"], "cpu");
    let refused = fly(&folder, "no/film", &[]).expect(2);
    assert!(
        refused.stderr.contains("make it first"),
        "{}",
        refused.stderr
    );
    let render = ["render", "body.bsk", "-o", "p.png", "--depth", "./p.png"];
    let refused = folder.run(&render).expect(2);
    assert!(refused.stderr.contains("one file"), "{}", refused.stderr);
    assert!(!folder.file("p.png").exists());
}

#[test]
fn in_real_time_every_slot_has_a_frame() {
    let folder = prepared();
    let more = ["--realtime", "--json", "--stats", "s.json"];
    let run = fly(&folder, "film", &more).expect(0);
    assert!(run.stderr.contains("loaded ahead"), "{}", run.stderr);
    let json = run.stdout;
    let report: Value = serde_json::from_str(&json).expect("JSON");
    let realtime = &report["realtime"];
    assert_eq!(realtime["prefetch"], false, "the CPU has none");
    let lods = realtime["lods"].as_object().expect("levels");
    let on_levels: u64 = lods.values().filter_map(Value::as_u64).sum();
    assert_eq!(Some(on_levels), report["drawn"].as_u64(), "{json}");
    assert_eq!(report["frames"], 6);
    assert_eq!(realtime["missing_frames"], 0, "the CPU waits for bricks");
    let (drawn, dropped) = (&report["drawn"], &realtime["dropped_frames"]);
    let sum = drawn.as_u64().zip(dropped.as_u64()).map(|(a, b)| a + b);
    assert_eq!(sum, Some(6), "drawn or dropped: {json}");
    let frames = frames(&folder, "film");
    assert_eq!(frames.len(), 6, "what is dropped is the frame before");
    for (name, _) in &frames {
        let (width, height, _) = read_png(&folder.file("film").join(name));
        assert_eq!([width, height], [32, 24], "{name}");
    }
    let refused = fly(&folder, "film", &["--realtime"]).expect(2);
    assert!(refused.stderr.contains("real time"), "{}", refused.stderr);
    let refused = fly(&folder, "other", &["--prefetch", "off"]).expect(2);
    assert!(refused.stderr.contains("--realtime"), "{}", refused.stderr);
}

#[test]
fn what_makes_no_film_is_refused_before_anything_is_drawn() {
    let folder = prepared();
    let before = folder.names();
    for (output, more, named) in [
        ("a.mp4", &["--size", "33x24"][..], "34x24"),
        ("a.mp4", &["--background", "transparent"], "transparency"),
        ("a.webm", &[], ".mp4"),
        ("no/such/folder", &[], "make it first"),
        ("no/such.mp4", &[], "does not exist"),
        ("body.bsk", &[], "is a file"),
        ("a", &["--fps", "0"], "frames per second"),
        ("a", &["--seconds", "1e6"], "at most 100000"),
        ("a", &["--eye", "1,2,3"], "--eye"),
        ("a", &["--path", "body.bsk"], "body.bsk"),
    ] {
        let mut all = args(output, more);
        if more
            .first()
            .is_some_and(|flag| ["--size", "--fps", "--path"].contains(flag))
        {
            // Instead of what is there.
            let at = all.iter().position(|a| *a == more[0]).expect("the flag");
            all.drain(at..at + 2);
        }
        let refused = folder.run(&all).expect(2);
        assert!(
            refused.stderr.contains(named),
            "{output} {more:?}: {}",
            refused.stderr
        );
        assert_eq!(refused.stdout, "", "{output} {more:?}: no result");
    }
    assert_eq!(folder.names(), before, "nothing is left behind");
}

/// A program on PATH that takes `ffmpeg`'s place: it knows libx264 and then does `then`, with the film's name in `$film`.
#[cfg(unix)]
fn with_ffmpeg(folder: &Folder, then: &str, more: &[&str]) -> Run {
    use std::os::unix::fs::PermissionsExt;
    fs::create_dir_all(folder.file("bin")).expect("a folder");
    let script = format!(
        "#!/bin/sh\ncase \"$*\" in *-encoders*) echo ' V libx264'; exit 0;; esac\n\
         for film; do :; done; film=${{film#file:}}\n{then}\n"
    );
    folder.write("bin/ffmpeg", script.as_bytes());
    let executable = fs::Permissions::from_mode(0o755);
    fs::set_permissions(folder.file("bin/ffmpeg"), executable).expect("permissions");
    let mut command = folder.command(&args("film.mp4", more));
    let path = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{}:{path}", folder.file("bin").display()));
    finish(command)
}

#[cfg(unix)]
#[test]
fn ffmpeg_gets_all_frames_and_its_film_appears_complete() {
    let folder = prepared();
    let json = with_ffmpeg(&folder, "cat > \"$film\"", &["--json"])
        .expect(0)
        .stdout;
    let report: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(report["encoder"], "ffmpeg");
    let film = fs::read(folder.file("film.mp4")).expect("a film");
    assert_eq!(film.len(), 6 * 32 * 24 * 3 / 2, "six frames in 4:2:0");
    assert!(
        film.iter().all(|&b| (16..=240).contains(&b)),
        "limited range"
    );
    let refused = with_ffmpeg(&folder, "cat > \"$film\"", &[]).expect(2);
    assert!(refused.stderr.contains("--force"), "{}", refused.stderr);
    with_ffmpeg(&folder, "cat > \"$film\"", &["--force"]).expect(0);

    fs::remove_file(folder.file("film.mp4")).expect("a film");
    let before = folder.names();
    for then in [
        "echo no such codec >&2; exit 3",
        "cat > \"$film\"; echo disk full >&2; exit 1",
    ] {
        let failed = with_ffmpeg(&folder, then, &[]).expect(2);
        let said = then
            .split("echo ")
            .nth(1)
            .and_then(|t| t.split(" >").next());
        assert!(
            failed.stderr.contains(said.expect("words")),
            "{}",
            failed.stderr
        );
        assert_eq!(folder.names(), before, "{then}: nothing is left behind");
    }
}

/// Without `ffmpeg`: the encoder that is built in, or none.
#[test]
fn without_ffmpeg_there_is_the_built_in_encoder_or_a_remedy() {
    let folder = prepared();
    let before = folder.names();
    let film = || {
        let mut command = folder.command(&args("film.mp4", &["--force"]));
        command.env("PATH", folder.path());
        finish(command)
    };
    if !cfg!(feature = "h264") {
        let refused = film().expect(2);
        assert!(
            refused.stderr.contains("ffmpeg") && refused.stderr.contains("--features h264"),
            "{}",
            refused.stderr
        );
        assert_eq!(folder.names(), before, "nothing is left behind");
        return;
    }
    film().expect(0);
    let first = fs::read(folder.file("film.mp4")).expect("a film");
    assert_eq!(sample_count(&first), Some(6), "frames in the film");
    film().expect(0);
    let again = fs::read(folder.file("film.mp4")).expect("a film");
    assert!(first == again, "the same frames give the same film");
}

/// The samples of the first track of an MP4 file: the number in its box `stsz`.
fn sample_count(film: &[u8]) -> Option<u32> {
    let mut boxes = film;
    for name in [b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsz"] {
        loop {
            let size = u32::from_be_bytes(boxes.get(..4)?.try_into().ok()?) as usize;
            let (this, rest) = boxes.split_at_checked(size.max(8))?;
            if this[4..8] == *name {
                boxes = &this[8..];
                break;
            }
            boxes = rest;
        }
    }
    // Version and flags, the size of all samples, their number.
    Some(u32::from_be_bytes(boxes.get(8..12)?.try_into().ok()?))
}
