//! `bench` through the real binary: the keys of cli.md with figures that can be, reports, comparisons, refusals.

use std::fs;

use serde_json::Value;

use crate::run::{Folder, Run};

/// What every sub-command takes so that a run is short.
const SHORT: [&str; 8] = [
    "--frames",
    "2",
    "--size",
    "64x64",
    "--step",
    "1",
    "--no-ceiling",
    "--json",
];

/// The JSON lines of a run.
fn lines(run: &Run) -> Vec<Value> {
    run.stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")))
        .collect()
}

/// A number under a key.
#[track_caller]
fn number(row: &Value, key: &str) -> f64 {
    row[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} is a number in {row}"))
}

/// `bench render` of a small store on the CPU, with more arguments.
fn render(folder: &Folder, more: &[&str]) -> Run {
    let base = ["bench", "render", "s.bsk", "--device", "cpu"];
    folder.run(&[&base[..], &SHORT, more].concat())
}

/// Every key that cli.md names, in its order, with a value that can be.
#[track_caller]
fn check_render_row(row: &Value) {
    const KEYS: [&str; 15] = [
        "vol",
        "device",
        "mode",
        "size",
        "step",
        "frames",
        "median_ms",
        "min_ms",
        "p90_ms",
        "cpu_ms",
        "first_ms",
        "rss_peak_mib",
        "samples",
        "samples_contributing",
        "gpu_ms",
    ];
    for key in KEYS {
        assert!(row.get(key).is_some(), "{key} is in {row}");
    }
    let [median, min, p90] = ["median_ms", "min_ms", "p90_ms"].map(|key| number(row, key));
    assert!(0.0 < min && min <= median && median <= p90, "{row}");
    // Two frames: numpy's percentiles lie on the line between them.
    assert!(
        (p90 - (min + 1.8 * (median - min))).abs() < 0.01,
        "the 90th percentile of two: {row}"
    );
    let samples = number(row, "samples");
    assert!(samples > 0.0, "{row}");
    if let Some(contributing) = row["samples_contributing"].as_f64() {
        assert!(0.0 < contributing && contributing <= samples, "{row}");
    }
    #[cfg(target_os = "linux")]
    {
        assert!(number(row, "cpu_ms") > 0.0, "{row}");
        assert!(
            (1.0..16384.0).contains(&number(row, "rss_peak_mib")),
            "{row}"
        );
    }
}

#[test]
fn render_prints_the_keys_of_the_contract() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64", "s.bsk");
    let run = render(&folder, &["--mode", "mip"]).expect(0);
    let rows = lines(&run);
    assert_eq!(rows.len(), 1, "one configuration: {}", run.stdout);
    let row = &rows[0];
    check_render_row(row);
    for (key, expected) in [
        ("vol", Value::from("s")),
        ("device", Value::from("cpu")),
        ("mode", Value::from("mip")),
        ("size", Value::from("64x64")),
        ("step", Value::from(1.0)),
        ("frames", Value::from(2)),
        ("gpu_ms", Value::Null),
        ("first_whole_ms", Value::Null),
    ] {
        assert_eq!(row[key], expected, "{key}");
    }
    // The first frame took at least as long as the fastest one, and the process began before it.
    assert!(
        number(row, "first_ms") >= number(row, "min_ms") * 0.5,
        "{row}"
    );
    assert!(
        run.stdout
            .starts_with(r#"{"vol":"s","device":"cpu","mode":"mip","size":"64x64""#),
        "in the order of cli.md: {}",
        run.stdout
    );
}

/// The pictures are those of cli.md: the samples of a frame are those of `render` from the same camera.
#[test]
fn render_turns_as_the_contract_says() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64", "s.bsk");
    let row = &lines(&render(&folder, &["--mode", "mip"]).expect(0))[0];
    // A cube of 64 voxels of 1 mm: the centre at 31.5, the eye 1.5 · 64 · √3 away, at +z and, half a turn on, at −z.
    let distance = 1.5 * 64.0 * 3f64.sqrt();
    let mut samples = 0.0;
    for z in [31.5 + distance, 31.5 - distance] {
        let eye = format!("31.5,31.5,{z}");
        let command = [
            "render",
            "s.bsk",
            "-o",
            "p.png",
            "--device",
            "cpu",
            "--mode",
            "mip",
            "--size",
            "64x64",
            "--step",
            "1",
            "--stats",
            "stats.json",
            "--eye",
            &eye,
            "--target",
            "31.5,31.5,31.5",
            "--up",
            "0,1,0",
            "--fov",
            "30",
        ];
        folder.run(&command).expect(0);
        let stats = fs::read_to_string(folder.file("stats.json")).expect("statistics");
        let stats: Value = serde_json::from_str(&stats).expect("JSON");
        samples += number(&stats, "samples") / 2.0;
    }
    assert_eq!(number(row, "samples"), samples.round());
}

#[test]
fn render_takes_lists_and_stores() {
    let folder = Folder::new();
    for name in ["s.bsk", "t.bsk"] {
        folder.brick("phantom:sponge:40,40,40", name);
    }
    let base = ["bench", "render", "s.bsk", "t.bsk", "--device", "cpu"];
    let lists = [
        "--frames",
        "1",
        "--modes",
        "dvr,iso,mip",
        "--iso",
        "100",
        "--sizes",
        "16x16,24x8",
        "--steps",
        "1,2",
        "--no-ceiling",
        "--json",
        "--warm-up",
        "turn",
    ];
    let rows = lines(&folder.run(&[&base[..], &lists].concat()).expect(0));
    assert_eq!(rows.len(), 2 * 3 * 2 * 2, "stores × modes × sizes × steps");
    let first: Vec<bool> = rows.iter().map(|r| r["first_ms"].is_number()).collect();
    assert!(
        first[0] && first[1..].iter().all(|f| !f),
        "only the first picture is the process's first"
    );
    let last = rows.last().expect("rows");
    assert_eq!(
        [&last["vol"], &last["mode"], &last["size"]],
        [&Value::from("t"), &Value::from("mip"), &Value::from("24x8")]
    );
}

#[test]
fn reports_compare_with_themselves() {
    let folder = Folder::new();
    folder.brick("phantom:sponge:40,40,40", "s.bsk");
    let out = ["--modes", "dvr,mip", "--out", "r.json", "--svg", "r.svg"];
    render(&folder, &out).expect(0);
    let report = fs::read_to_string(folder.file("r.json")).expect("the report");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["bench"], "render");
    assert_eq!(report["command"][0], "bench");
    assert!(report["machine"]["threads"].is_number(), "{report}");
    let measured = report["rows"].as_array().expect("rows");
    assert_eq!(measured.len(), 2);
    let svg = fs::read_to_string(folder.file("r.svg")).expect("the plot");
    assert!(
        svg.contains("s dvr 64x64 step 1 cpu") && svg.contains("s mip 64x64 step 1 cpu"),
        "every configuration has its label"
    );

    let run = render(
        &folder,
        &["--modes", "mip,iso", "--iso", "90", "--compare", "r.json"],
    )
    .expect(0);
    let rows = lines(&run);
    let ratio = number(&rows[0]["old_over_new"], "median_ms");
    let expected = number(&measured[1], "median_ms") / number(&rows[0], "median_ms");
    assert!(
        (ratio - expected).abs() < 0.01 * expected + 1e-3,
        "{ratio}, {expected}"
    );
    #[cfg(unix)]
    assert!(number(&rows[0]["old_over_new"], "cpu_ms") > 0.0);
    assert_eq!(rows[1]["old_over_new"], Value::Null, "iso is new");
    assert!(
        run.stderr
            .contains("only in the older report: s dvr 64x64 step 1 cpu"),
        "{}",
        run.stderr
    );

    // The same as a table.
    let table = folder
        .run(&[
            "bench",
            "render",
            "s.bsk",
            "--device",
            "cpu",
            "--frames",
            "1",
            "--size",
            "64x64",
            "--step",
            "1",
            "--no-ceiling",
            "--mode",
            "mip",
            "--compare",
            "r.json",
        ])
        .expect(0);
    let of_row: Vec<&str> = table
        .stdout
        .lines()
        .filter(|l| l.contains("s mip 64x64 step 1 cpu"))
        .collect();
    assert_eq!(of_row.len(), 2, "figures and ratios: {}", table.stdout);
}

#[test]
fn ceilings_are_measured_in_the_same_run() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64:u16", "s.bsk");
    let run = folder
        .run(&[
            "bench", "render", "s.bsk", "--device", "cpu", "--frames", "1", "--size", "16x16",
            "--json",
        ])
        .expect(0);
    let row = &lines(&run)[0];
    for key in [
        "zstd_encode_mb_per_s",
        "zstd_decode_mb_per_s",
        "memcpy_gb_per_s",
    ] {
        assert!(number(&row["ceiling"], key) > 0.0, "{key}: {row}");
    }
    // A store of a few hundred KiB tells nothing of a disk.
    assert_eq!(row["ceiling"]["disk_read_mb_per_s"], Value::Null);
    // The bare kernel: what the picture reached of its rate is the ratio of the two rates.
    let rate = number(row, "samples") / number(row, "cpu_ms") / 1e3;
    let share = rate / number(row, "bare_msamples_per_s");
    let told = number(row, "efficiency");
    assert!(
        told > 0.0 && (told - share).abs() < 0.01 + 0.05 * share,
        "{told}, not {share}"
    );
    assert_eq!(row["bare_clock"], Value::from("cpu"));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = Folder::new();
    folder.brick("phantom:sponge:32,32,32", "s.bsk");
    folder.write("bad.json", b"{\"format\": 1, \"bench\": \"brick\"}");
    folder.write("no.json", b"not JSON");
    let refused = |args: &[&str], expected: &str| {
        let run = folder.run(args).expect(2);
        assert!(run.stderr.contains(expected), "{args:?}: {}", run.stderr);
        assert_eq!(run.stdout, "", "{args:?}: no result");
    };
    for camera in [
        &["--eye", "1,2,3"][..],
        &["--orbit", "30,10"],
        &["--camera", "c.json"],
        &["--fov", "40"],
        &["--projection", "orthographic"],
        &["--near", "3"],
    ] {
        for what in ["render", "page", "classify"] {
            let args = [&["bench", what, "s.bsk"][..], camera].concat();
            refused(&args, &format!("{}: bench {what}", camera[0]));
        }
    }
    let render = ["bench", "render", "s.bsk", "--device", "cpu"];
    let with = |more: &[&'static str]| [&render[..], more].concat();
    refused(
        &with(&["--compare", "bad.json"]),
        "bench: expected \"render\", found \"brick\"",
    );
    refused(&with(&["--compare", "no.json"]), "no.json");
    refused(&with(&["--compare", "missing.json"]), "missing.json");
    refused(&with(&["--out", "no/such/folder.json"]), "does not exist");
    refused(&with(&["--frames", "0"]), "--frames");
    refused(&with(&["--modes", "dvr", "--mode", "mip"]), "--mode");
    refused(&with(&["--mode", "iso"]), "--iso");
    refused(&["bench", "render", "missing.bsk"], "missing.bsk");
    refused(
        &["bench", "page", "s.bsk", "--device", "cpu", "--size", "8x8"],
        "--device NAME",
    );
    refused(
        &[
            "bench",
            "brick",
            "phantom:sponge:32,32,32",
            "--dir",
            "missing",
        ],
        "--dir",
    );
    refused(
        &["bench", "brick", "missing.nrrd", "--no-ceiling"],
        "missing.nrrd",
    );
}

#[test]
fn every_sub_command_has_help_with_an_example() {
    let folder = Folder::new();
    for what in ["render", "brick", "page", "classify", "seeds"] {
        let help = folder.run(&["bench", what, "--help"]).expect(0).stdout;
        let example = help
            .lines()
            .skip_while(|l| !l.starts_with("Example"))
            .nth(1)
            .unwrap_or_default();
        let wanted = format!("brickscope bench {what}");
        assert!(example.trim_start().starts_with(&wanted), "{what}: {help}");
    }
}

#[test]
fn brick_counts_and_leaves_nothing() {
    let folder = Folder::new();
    let run = folder
        .run(&[
            "bench",
            "brick",
            "phantom:body:64,64,64:u16",
            "--zstd",
            "1,3",
            "--threads",
            "1",
            "--dir",
            ".",
            "--json",
        ])
        .expect(0);
    let rows = lines(&run);
    assert_eq!(rows.len(), 2, "{}", run.stdout);
    for (row, zstd) in rows.iter().zip([1, 3]) {
        assert_eq!(row["source"], "phantom:body:64,64,64:u16");
        assert_eq!(
            [&row["source_type"], &row["stored_type"]],
            [&Value::from("u16"); 2]
        );
        assert_eq!(
            (row["zstd"].as_i64(), row["threads"].as_i64()),
            (Some(zstd), Some(1))
        );
        assert_eq!(number(row, "bytes_in"), 2.0 * 64.0 * 64.0 * 64.0);
        // MB of the source per second, by the row's own time.
        let rate = number(row, "bytes_in") / 1e3 / number(row, "wall_ms");
        assert!((number(row, "mb_per_s") / rate - 1.0).abs() < 0.01, "{row}");
        let ceiling = number(&row["ceiling"], "mb_per_s");
        let share = number(row, "of_ceiling");
        assert!(
            (share - number(row, "mb_per_s") / ceiling).abs() < 2e-3,
            "{row}"
        );
    }
    // A higher level packs tighter.
    assert!(number(&rows[1], "bytes_out") < number(&rows[0], "bytes_out"));
    assert!(folder.names().is_empty(), "{:?}", folder.names());
}

#[test]
fn classify_times_edits_beside_the_render_itself() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64", "s.bsk");
    let run = folder
        .run(&[
            "bench", "classify", "s.bsk", "--device", "cpu", "--edits", "2", "--size", "32x32",
            "--step", "1", "--lods", "0,1", "--json",
        ])
        .expect(0);
    let rows = lines(&run);
    let what: Vec<(String, String, Option<i64>)> = rows
        .iter()
        .map(|r| {
            let word = |key: &str| r[key].as_str().unwrap_or_default().to_owned();
            (word("mode"), word("what"), r["level"].as_i64())
        })
        .collect();
    let expected: Vec<_> = [0, 1]
        .into_iter()
        .flat_map(|level| ["dvr", "iso"].map(|mode| (mode, level)))
        .flat_map(|(mode, level)| {
            ["render itself", "edit"].map(|what| (mode.to_owned(), what.to_owned(), Some(level)))
        })
        .collect();
    assert_eq!(what, expected);
    for row in &rows {
        let (whole, exact) = (number(row, "whole_ms"), number(row, "converged_ms"));
        assert!(0.0 < whole && whole <= exact, "{row}");
        assert!(number(row, "whole_p90_ms") >= whole, "{row}");
        assert_eq!(
            row["over_render_ms"].is_number(),
            row["what"] == "edit",
            "{row}"
        );
    }
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn render_on_a_graphics_device_has_passes_and_a_bare_rate() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64:u16", "s.bsk");
    let run = folder
        .run(&[
            "bench", "render", "s.bsk", "--frames", "2", "--size", "64x64", "--step", "1",
            "--json", "--whole",
        ])
        .expect(0);
    let row = &lines(&run)[0];
    check_render_row(row);
    assert_eq!(row["device"], "gpu");
    let (whole, first) = (number(row, "first_whole_ms"), number(row, "first_ms"));
    assert!(0.0 < whole && whole <= first, "{row}");
    let bare = number(row, "bare_msamples_per_s");
    assert!(bare > 0.0, "{row}");
    // The configuration's own rate ÷ the bare one, by the same clock.
    let own_ms = match row["bare_clock"].as_str() {
        Some("cpu") => number(row, "cpu_ms"),
        Some("gpu") => number(row, "gpu_ms"),
        other => panic!("a clock: {other:?}"),
    };
    let own = number(row, "samples") / own_ms / 1e3;
    let efficiency = number(row, "efficiency");
    assert!(
        (efficiency - own / bare).abs() < 0.02 * own / bare + 1e-3,
        "{row}"
    );
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn page_counts_bricks_and_waits() {
    let folder = Folder::new();
    folder.brick("phantom:body:96,96,96", "s.bsk");
    let run = folder
        .run(&[&["bench", "page", "s.bsk"][..], &SHORT, &["--frames", "3"]].concat())
        .expect(2);
    assert!(
        run.stderr.contains("--frames"),
        "given twice: {}",
        run.stderr
    );
    let run = folder
        .run(&[&["bench", "page", "s.bsk"][..], &SHORT].concat())
        .expect(0);
    let rows = lines(&run);
    let phases: Vec<&str> = rows.iter().filter_map(|r| r["phase"].as_str()).collect();
    assert_eq!(phases, ["cold first", "warm first", "warm turn"]);
    for row in &rows[..2] {
        let uploaded = number(row, "bricks_uploaded");
        assert!(uploaded > 0.0, "nothing was resident: {row}");
        assert_eq!(uploaded, number(row, "bricks_read"), "each once: {row}");
        let waits = number(row, "waits");
        assert!(0.0 < waits && waits <= uploaded, "{row}");
        let (median, p99) = (
            number(row, "latency_median_ms"),
            number(row, "latency_p99_ms"),
        );
        assert!(0.0 < median && median <= p99, "{row}");
        assert_eq!(row["hit_rate"], Value::Null, "{row}");
    }
    let turn = &rows[2];
    let rate = 1.0 - number(turn, "bricks_uploaded") / number(turn, "bricks_touched");
    assert!((number(turn, "hit_rate") - rate).abs() < 1e-3, "{turn}");
}
