//! `bench seeds` through the real binary: every row of the tables, ratios that are those of the times, refusals.

use std::fs;

use serde_json::Value;

use crate::run::{Folder, Run};

/// What makes a run short.
const SHORT: [&str; 6] = ["--size", "32", "--frames", "1", "--repeats", "1"];

fn seeds(folder: &Folder, device: &str, more: &[&str]) -> Run {
    let base = ["bench", "seeds", "s.bsk", "--device", device];
    folder.run(&[&base[..], &SHORT, more].concat())
}

fn rows(run: &Run) -> Vec<Value> {
    let row = |line: &str| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}"));
    run.stdout.lines().map(row).collect()
}

/// A row has figures; on the CPU, which has two techniques and doesn't leap, others have a note instead.
#[track_caller]
fn check(row: &Value) {
    let technique = row["technique"].as_str().expect("a technique");
    let leaps = (row["configuration"].as_str()).is_some_and(|c| c.ends_with("leaping"));
    let is_refused =
        row["device"] == "cpu" && (leaps || !["basic", "default"].contains(&technique));
    assert_eq!(row["note"].is_string(), is_refused, "{row}");
    if is_refused {
        assert!(
            row["wall_ms"].is_null() && row["speed_up"].is_null(),
            "{row}"
        );
        return;
    }
    for key in ["wall_ms", "samples_per_pixel"] {
        assert!(row[key].as_f64().is_some_and(|n| n > 0.0), "{key}: {row}");
    }
}

/// The row of the same picture that a row names under `key`.
#[track_caller]
fn named<'a>(row: &Value, key: &str, all: &'a [Value]) -> &'a Value {
    all.iter()
        .find(|r| {
            let is_same = |key: &&str| r[key] == row[key];
            ["table", "vol", "picture"].iter().all(is_same) && r["configuration"] == row[key]
        })
        .unwrap_or_else(|| panic!("the {key} of {row}"))
}

/// Where a picture and the one that it should be were drawn, there is an error.
#[track_caller]
fn check_error(row: &Value, all: &[Value]) {
    let is_drawn = |r: &Value| r["note"].is_null();
    if row["error_against"].is_string() {
        let both = is_drawn(row) && is_drawn(named(row, "error_against", all));
        for key in ["error_rms", "error_p99_9"] {
            assert_eq!(row[key].is_number(), both, "{key}: {row}");
        }
    }
}

/// The ratio of a row is that of the times of the two rows, which one repeat makes exact.
#[track_caller]
fn check_ratio(row: &Value, all: &[Value]) {
    if row["against"].is_null() {
        assert!(row["speed_up"].is_null(), "a baseline: {row}");
        return;
    }
    let baseline = named(row, "against", all);
    let Some(speed_up) = row["speed_up"].as_f64() else {
        let is_refused = |r: &Value| r["note"].is_string();
        assert!(is_refused(row) || is_refused(baseline), "{row}");
        return;
    };
    let clock = match row["clock"].as_str() {
        Some("cpu") => "cpu_ms",
        Some("wall") => "wall_ms",
        other => panic!("the processor's or the wall's clock: {other:?} in {row}"),
    };
    let ms = |r: &Value| r[clock].as_f64().unwrap_or_else(|| panic!("{clock}: {r}"));
    let found = ms(baseline) / ms(row);
    // Times are stored to the microsecond, ratios to a thousandth.
    let most = found * (5e-4 / ms(baseline) + 5e-4 / ms(row)) + 1e-3;
    assert!(
        (found - speed_up).abs() <= most,
        "{found}, not {speed_up}: {row}"
    );
    assert_eq!(row["speed_up"], row["speed_up_least"], "one repeat: {row}");
}

/// How many rows each table has: pictures × ways, as techniques.md asks.
#[test]
fn every_row_of_every_table_is_there() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64", "s.bsk");
    let run = seeds(&folder, "cpu", &["--json"]).expect(0);
    let all = rows(&run);
    let count = |table: &str| all.iter().filter(|r| r["table"] == table).count();
    let counts = ["T1", "T2", "T3", "T4", "T5"].map(count);
    assert_eq!(
        counts,
        [
            3 + 4 + 2,
            2 * 4 + 10,
            7 * 3 + 2 * 6,
            4 + 3,
            4 * 3 * 2 + 2 * 7
        ]
    );
    assert_eq!(counts.iter().sum::<usize>(), all.len());
    for row in &all {
        check(row);
        check_ratio(row, &all);
        check_error(row, &all);
        assert_eq!(row["device"], "cpu", "refused or not: {row}");
    }
    let row = |picture: &str, configuration: &str| {
        all.iter()
            .find(|r| r["picture"] == picture && r["configuration"] == configuration)
            .unwrap_or_else(|| panic!("{picture}: {configuration}"))
    };
    let mesh = row("iso", "mesh");
    assert_eq!(mesh["theirs"][0]["data"], "256²×128");
    let samples = |r: &Value| r["samples_per_pixel"].as_f64().expect("samples");
    assert!(
        samples(mesh) < samples(row("iso", "basic")),
        "skipping saves samples"
    );
    for key in ["bricks_active", "blocks_active"] {
        let share = mesh[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {mesh}"));
        assert!(0.0 < share && share <= 1.0, "{mesh}");
    }
    assert!(
        mesh["blocks_active"].as_f64() < mesh["bricks_active"].as_f64(),
        "blocks fit closer: {mesh}"
    );
    // By rate: a maximum takes every sample.
    let rate = samples(row("maximum, by rate", "basic, step 1"))
        / samples(row("maximum, by rate", "basic, step 2"));
    assert!((rate - 2.0).abs() < 0.1, "{rate}");
}

#[test]
fn tables_are_chosen_and_reports_compare() {
    let folder = Folder::new();
    folder.brick("phantom:sponge:40,40,40", "s.bsk");
    let out = [
        "--tables", "t4,T1,T4", "--iso", "100", "--iso", "s=60", "--out", "r.json", "--svg",
        "r.svg",
    ];
    let run = seeds(&folder, "cpu", &out).expect(0);
    let heads: Vec<&str> = run
        .stdout
        .lines()
        .filter(|l| l.starts_with("## "))
        .collect();
    assert!(
        heads.len() == 2 && heads[0].starts_with("## T1: "),
        "each once, in order: {heads:?}"
    );
    for text in [
        "theirs ×",
        "Aneurism 1.85",
        "ours ×: CPU ms",
        "s: 40×40×40 u8, iso 60,",
    ] {
        assert!(run.stdout.contains(text), "{text}: {}", run.stdout);
    }
    let report: Value =
        serde_json::from_str(&fs::read_to_string(folder.file("r.json")).expect("the report"))
            .expect("JSON");
    assert_eq!(report["bench"], "seeds");
    let measured = report["rows"].as_array().expect("rows");
    assert_eq!(measured.len(), 9 + 7);
    assert_eq!(
        measured[0]["iso"],
        serde_json::json!([60.0]),
        "the store's own value"
    );
    let svg = fs::read_to_string(folder.file("r.svg")).expect("the plot");
    assert!(
        svg.starts_with("<svg")
            && svg.contains("T1 s iso: mesh 32x32 step 1 level 0 iso 60 cpu")
            && svg.contains("times as fast"),
        "speed-ups"
    );
    assert!(!svg.contains("s iso: basic"), "a baseline has none");
    let again = seeds(
        &folder,
        "cpu",
        &[
            "--tables",
            "T1",
            "--iso",
            "60",
            "--json",
            "--compare",
            "r.json",
        ],
    )
    .expect(0);
    for row in rows(&again) {
        assert!(row["old_over_new"]["wall_ms"].is_number(), "{row}");
    }
    assert!(
        again
            .stderr
            .contains("only in the older report: T4 s dvr: plain"),
        "{}",
        again.stderr
    );
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = Folder::new();
    folder.brick("phantom:sponge:32,32,32", "s.bsk");
    for (more, expected) in [
        (["--tables", "T6"], "T1, T2, T3, T4, T5"),
        (["--tables", "T1,"], "--tables"),
        (["--iso", "t=5"], "no such store; those given are s"),
        (["--iso", "s="], "expected VALUE or STORE=VALUE"),
        (["--lod", "9"], "s.bsk: level 9 is not in the store"),
        (["--tf", "no-such"], "no such preset"),
        (["--compare", "missing.json"], "missing.json"),
    ] {
        let run = seeds(&folder, "cpu", &more).expect(2);
        assert!(run.stderr.contains(expected), "{more:?}: {}", run.stderr);
        assert_eq!(run.stdout, "", "{more:?}: no result");
    }
    let base = ["bench", "seeds", "s.bsk", "--device", "cpu"];
    for more in [
        ["--frames", "0"],
        ["--frames", "361"],
        ["--repeats", "0"],
        ["--size", "1"],
    ] {
        let run = folder.run(&[&base[..], &more].concat()).expect(2);
        assert!(run.stderr.contains(more[0]), "{more:?}: {}", run.stderr);
    }
    fs::create_dir(folder.file("t")).expect("a folder");
    folder.brick("phantom:sponge:32,32,32", "t/s.bsk");
    let twice = folder
        .run(&["bench", "seeds", "s.bsk", "t/s.bsk"])
        .expect(2);
    assert!(
        twice.stderr.contains("two of the stores are called s"),
        "{}",
        twice.stderr
    );
    let missing = folder.run(&["bench", "seeds", "missing.bsk"]).expect(2);
    assert!(missing.stderr.contains("missing.bsk"), "{}", missing.stderr);
}

#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS")]
fn a_graphics_device_compares_by_its_clock() {
    let folder = Folder::new();
    folder.brick("phantom:body:64,64,64:u16", "s.bsk");
    let run = seeds(&folder, "llvmpipe", &["--json"]).expect(0);
    let all = rows(&run);
    assert_eq!(all.len(), 9 + 18 + 33 + 7 + 38);
    for row in &all {
        check(row);
        check_ratio(row, &all);
        check_error(row, &all);
        assert_eq!(
            (&row["device"], &row["clock"]),
            (&"gpu".into(), &"cpu".into()),
            "{row}"
        );
    }
}
