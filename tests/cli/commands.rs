//! Every command once as a user would use it: output, files, exit code.

use std::fs;

use serde_json::Value;

use crate::run::{Folder, read_png};

#[test]
fn brick_prints_its_figures_and_verify_finds_them_sound() {
    let folder = Folder::new();
    let run = folder
        .run(&["brick", "phantom:body:70,40,50", "-o", "body.bsk"])
        .expect(0);
    let value = |name: &str| -> String {
        let line = run
            .stdout
            .lines()
            .find_map(|l| l.strip_prefix(&format!("{name}:")));
        line.unwrap_or_else(|| panic!("no line {name:?} in {}", run.stdout))
            .trim()
            .to_owned()
    };
    assert_eq!(value("voxels"), "140000", "voxels");
    assert_eq!(value("bytes in"), "140000", "bytes in");
    let bytes = fs::metadata(folder.file("body.bsk"))
        .expect("the store")
        .len();
    assert_eq!(value("bytes out"), bytes.to_string(), "bytes out");
    assert!(value("kept bricks").parse::<u64>().is_ok(), "kept bricks");
    // 3 × 2 × 2 bricks, 2 × 1 × 1, 1.
    assert_eq!(value("bricks"), "15", "bricks of all levels");
    assert!(
        value("seconds").parse::<f64>().is_ok() && value("MB/s").parse::<f64>().is_ok(),
        "{}",
        run.stdout
    );
    assert_eq!(folder.names(), ["body.bsk"], "nothing else is left");
    let verify = folder.run(&["verify", "body.bsk"]).expect(0);
    assert!(verify.stdout.contains("sound"), "{}", verify.stdout);
}

#[test]
fn info_says_the_same_as_text_and_as_json() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:40,40,40:u16", "body.bsk");
    let text = folder.run(&["info", store]).expect(0).stdout;
    for wanted in [
        "40 × 40 × 40",
        "u16",
        "1 × 1 × 1 mm",
        "phantom:body:40,40,40:u16",
        "level 1",
    ] {
        assert!(text.contains(wanted), "{wanted:?} in {text}");
    }
    let json = folder.run(&["info", store, "--json"]).expect(0).stdout;
    assert_eq!(
        json.trim_end().lines().count(),
        1,
        "one JSON object on one line: {json}"
    );
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["dims"], serde_json::json!([40, 40, 40]), "dims");
    assert_eq!(json["voxel_type"], "u16", "type");
    assert_eq!(
        json["spacing"],
        serde_json::json!([1.0, 1.0, 1.0]),
        "spacing"
    );
    let bytes = fs::metadata(folder.file(store)).expect("the store").len();
    assert_eq!(json["file_bytes"], bytes, "file_bytes");
    let keys = [
        "affine",
        "value_range",
        "levels",
        "bricks",
        "empty_share",
        "compressed_bytes",
        "percentiles",
        "source",
    ];
    for key in keys {
        assert!(!json[key].is_null(), "{key} in {json}");
    }
}

#[test]
fn presets_are_listed_and_render_takes_them() {
    let folder = Folder::new();
    let text = folder.run(&["presets"]).expect(0).stdout;
    let json: Value =
        serde_json::from_str(&folder.run(&["presets", "--json"]).expect(0).stdout).expect("JSON");
    let names: Vec<&str> = json["presets"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|p| p["name"].as_str())
        .collect();
    let listed: Vec<&str> = text
        .lines()
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(names.len() > 3, "{names:?}");
    assert_eq!(names, listed, "the same names in both");
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    for name in names {
        folder
            .run(&[
                "render", store, "-o", "p.png", "--size", "4x4", "--device", "cpu", "--tf", name,
            ])
            .expect(0);
    }
}

#[test]
fn presets_writes_paraview_json_that_render_takes() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let run = folder
        .run(&["presets", "--tf", "ct-bone", "-o", "bone.json"])
        .expect(0);
    assert_eq!(
        (run.stdout.as_str(), run.stderr.as_str()),
        ("bone.json: ct-bone\n", ""),
        "says what is written"
    );
    let picture = |tf: &str, out: &str, more: &[&str]| {
        let args = [
            "render", store, "-o", out, "--size", "16x16", "--device", "cpu", "--tf", tf,
        ];
        let run = folder.run(&[&args, more].concat()).expect(0);
        (fs::read(folder.file(out)).expect("the picture"), run.stderr)
    };
    assert_eq!(
        picture("ct-bone", "a.png", &[]).0,
        picture("bone.json", "b.png", &[]).0,
        "the preset and its file look the same"
    );

    // A volume property of 3D Slicer, with gradient opacity and lighting.
    let vp = "1\n1\n0.7\n0.3\n0.1\n5\n4 0 0 200 0.5\n4 0 0 30 1\n8 0 0.1 0 0 200 1 0.9 0.8\n";
    folder.write("my.vp", vp.as_bytes());
    let (as_said, notes) = picture("my.vp", "c.png", &[]);
    assert!(
        notes.contains("my has gradient opacity, which is not drawn yet"),
        "{notes}"
    );
    let light = [
        "--shading",
        "phong",
        "--diffuse",
        "0.7",
        "--ambient",
        "0.3",
        "--specular",
        "0.1",
        "--shininess",
        "5",
    ];
    assert!(
        as_said == picture("my.vp", "d.png", &light).0,
        "the file's light is that of these flags"
    );
    assert!(
        as_said != picture("my.vp", "e.png", &["--shading", "none"]).0,
        "flags go before the file"
    );
    let args = ["presets", "--tf", "my.vp", "-o", "bone.json"];
    let refused = folder.run(&args).expect(2);
    assert!(refused.stderr.contains("--force"), "{}", refused.stderr);
    let run = folder.run(&[&args[..], &["--force"]].concat()).expect(0);
    assert!(
        run.stderr.contains("gradient opacity, lighting, shading"),
        "what is left out: {}",
        run.stderr
    );
    assert_eq!(
        picture("bone.json", "f.png", &light).0,
        as_said,
        "the same curves"
    );

    // A table of ImageJ lies over the window.
    let greys: Vec<u8> = (0..3).flat_map(|_| 0..=255).collect();
    folder.write("grey.lut", &greys);
    assert!(
        picture("grey.lut", "g.png", &["--window", "100,200"]).0
            != picture("grey.lut", "h.png", &["--window", "200,50"]).0,
        "the window matters"
    );
    for args in [
        &["presets", "--tf", "ct-bone"][..],
        &["presets", "-o", "x.json"],
        &["presets", "--force"],
        &["presets", "--json", "--tf", "ct-bone", "-o", "x.json"],
        &["presets", "--tf", "ct-bones", "-o", "x.json"],
        &["presets", "--tf", "none.vp", "-o", "x.json"],
    ] {
        folder.run(args).expect(2);
    }
    assert!(!folder.file("x.json").exists(), "nothing half-done");
}

#[test]
fn render_writes_picture_and_statistics() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    let base = [
        "render", store, "-o", "p.png", "--size", "24x16", "--device", "cpu",
    ];
    for mode in [
        &["--mode", "dvr"][..],
        &["--mode", "mip"],
        &["--mode", "iso", "--iso", "1500"],
        // In this window the air around the body is bright.
        &["--mode", "minip", "--window=-1000,3000"],
        &["--mode", "mean", "--window=-1000,3000"],
        &["--mode", "xray"],
        &["--mode", "gradient"],
    ] {
        let args = [&base[..], mode, &["--stats", "s.json"]].concat();
        let run = folder.run(&args).expect(0);
        assert_eq!(run.stdout, "", "{mode:?}: nothing on standard output");
        let (width, height, pixels) = read_png(&folder.file("p.png"));
        assert_eq!([width, height], [24, 16], "{mode:?}: size");
        assert!(
            pixels.iter().any(|&p| p > 40),
            "{mode:?}: something is seen"
        );
        let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
        let stats: Value = serde_json::from_str(&stats).expect("JSON");
        assert_eq!(stats["device"], "cpu", "{mode:?}");
        assert_eq!(stats["rays"], 24 * 16, "{mode:?}");
        assert_eq!(stats["converged"], true, "{mode:?}");
        fs::remove_file(folder.file("p.png")).expect("the picture");
    }
}

/// `--samples` alone means all pixels, `--aa selective` those that differ.
#[test]
fn more_rays_are_cast_where_they_are_asked_for() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    let draw = |more: &[&str]| {
        let base = [
            "render", store, "-o", "p.png", "--size", "24x16", "--device", "cpu", "--stats",
            "s.json",
        ];
        folder.run(&[&base[..], more].concat()).expect(0);
        let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
        let stats: Value = serde_json::from_str(&stats).expect("JSON");
        (
            stats["rays"].as_u64().expect("a number"),
            stats["samples"].as_u64().expect("a number"),
            read_png(&folder.file("p.png")).2,
        )
    };
    let off = draw(&["--aa", "off"]);
    let full = draw(&["--samples", "4r"]);
    let selective = draw(&["--aa", "selective:0.05"]);
    assert_eq!([off.0, full.0], [24 * 16, 4 * 24 * 16], "rays");
    assert!(
        off.0 < selective.0 && selective.0 < off.0 + full.0,
        "{} rays: some pixels get four more",
        selective.0
    );
    assert!(off.1 < selective.1 && off.1 < full.1, "samples of all rays");
    assert!(off.2 != full.2 && off.2 != selective.2, "another picture");
    let two = draw(&["--aa", "selective:0.05", "--samples", "2"]);
    assert_eq!(
        (two.0 - off.0) * 2,
        selective.0 - off.0,
        "half as many rays of the same pixels"
    );
}

/// Both devices draw the same picture. Needs an adapter; Mesa's software one will do.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS=1")]
fn the_gpu_draws_what_the_cpu_draws() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    let draw = |device: &str| {
        let args = [
            "render", store, "-o", "p.png", "--size", "24x16", "--stats", "s.json", "--device",
            device,
        ];
        folder.run(&args).expect(0);
        let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
        let stats: Value = serde_json::from_str(&stats).expect("JSON");
        (
            stats["device"].as_str().map(str::to_owned),
            read_png(&folder.file("p.png")).2,
        )
    };
    let (gpu, gpu_pixels) = draw("auto");
    let (cpu, cpu_pixels) = draw("cpu");
    assert_eq!(
        [gpu.as_deref(), cpu.as_deref()],
        [Some("gpu"), Some("cpu")],
        "auto is the GPU"
    );
    let worst = gpu_pixels
        .iter()
        .zip(&cpu_pixels)
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    // 1e-4 of f32 may round to the next of 255 steps.
    assert!(worst <= Some(1), "pixels differ by up to {worst:?} of 255");
}

/// The keys of cli.md's `--stats`, null where not applicable.
#[test]
fn statistics_have_every_key_of_the_contract() {
    const KEYS: &str = "device adapter driver version wall_ms first_complete_ms converged_ms converged passes_ms rays samples \
        samples_skipped bricks_visible bricks_requested bricks_read bricks_uploaded bricks_evicted bricks_touched \
        bytes_read bytes_decompressed bytes_uploaded atlas_slots atlas_bytes gpu_bytes mesh_triangles";
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    folder
        .run(&[
            "render", store, "-o", "p.png", "--size", "4x4", "--device", "cpu", "--stats", "s.json",
        ])
        .expect(0);
    let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
    let stats: Value = serde_json::from_str(&stats).expect("JSON");
    let missing: Vec<&str> = KEYS
        .split_whitespace()
        .filter(|k| stats.get(k).is_none())
        .collect();
    assert!(missing.is_empty(), "missing keys: {missing:?} in {stats}");
}

/// Also: a standard error that nobody reads stops nothing.
#[test]
fn demo_makes_three_pictures_and_prints_only_their_paths() {
    let folder = Folder::new();
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let output = folder
        .command(&["demo"])
        .stderr(writer)
        .output()
        .expect("the binary starts");
    let stdout = String::from_utf8(output.stdout).expect("text");
    assert_eq!(output.status.code(), Some(0), "exit code; stdout: {stdout}");
    let lines: Vec<&str> = stdout.lines().collect();
    assert_eq!(lines.len(), 3, "three lines: {stdout}");
    for line in lines {
        assert!(
            line.starts_with("brickscope-demo/"),
            "a path alone: {line:?}"
        );
        let (width, height, pixels) = read_png(&folder.file(line));
        assert!(width > 100 && height > 100, "{line}: {width} × {height}");
        let seen = pixels.iter().filter(|&&p| p > 40).count();
        assert!(seen > pixels.len() / 20, "{line}: something is seen");
    }
}

/// The tube of the vessels phantom from its root to the first fork, as a path that reads back.
#[test]
fn path_writes_a_flight_through_the_lumen_and_says_how_long_it_is() {
    let folder = Folder::new();
    let store = folder.brick("phantom:vessels:96,96,96", "v.bsk");
    let base = [
        "path",
        store,
        "--from",
        "47.5,47.5,2",
        "--lumen",
        "140,170",
        "-o",
        "p.json",
    ];
    let to = ["--to", "47.5,47.5,18"];
    let run = folder
        .run(&[&base[..], &to, &["--json", "--seconds", "4"]].concat())
        .expect(0);
    assert_eq!(run.stderr, "", "nothing to tell");
    let json: Value = serde_json::from_str(&run.stdout).expect("JSON");
    let number = |key: &str| {
        json[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {json}"))
    };
    assert!((number("length_mm") - 16.0).abs() < 3.0, "{json}");
    assert!((number("mean_radius_mm") - 3.8).abs() < 1.0, "{json}");
    assert_eq!(number("inside_share"), 1.0, "{json}");
    assert_eq!(number("level"), 0.0, "{json}");
    let text = fs::read(folder.file("p.json")).expect("the path");
    let path: Value = serde_json::from_slice(&text).expect("JSON");
    let keys = path["keys"].as_array().expect("keys");
    assert_eq!(keys.len() as f64, number("points"), "a key per point");
    assert_eq!(keys[keys.len() - 1]["t"], 4.0, "four seconds");
    for key in ["t", "eye", "target", "up", "fov"] {
        assert!(!keys[0][key].is_null(), "{key} in {}", keys[0]);
    }
    let lines = folder
        .run(&[&base[..], &["--to", "farthest", "--speed", "10"]].concat())
        .expect(0)
        .stdout;
    assert!(
        lines.contains("length_mm:") && lines.contains("mm_per_s:"),
        "{lines}"
    );
    fs::remove_file(folder.file("p.json")).expect("the path");
    for (more, words) in [
        (
            &["--to", "10,10,10"][..],
            &["--to", "nearest voxel of the lumen"][..],
        ),
        (&["--to", "1,1"], &["farthest"]),
        (
            &["--to", "47.5,47.5,18", "--seconds", "1", "--speed", "1"],
            &["--speed"],
        ),
        (&["--to", "47.5,47.5,18", "--fov", "180"], &["180"]),
    ] {
        let run = folder.run(&[&base[..], more].concat()).expect(2);
        for word in words {
            assert!(run.stderr.contains(word), "{word:?} in {}", run.stderr);
        }
        assert_eq!(folder.names(), ["v.bsk"], "{more:?}: no path is left");
    }
}
