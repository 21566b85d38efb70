//! Every flag that changes how a picture is computed, each once as a user would type it.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;

use crate::run::{Folder, read_png};

/// A picture that was drawn, and the numbers of its drawing.
#[derive(Debug, PartialEq)]
struct Drawn {
    pixels: Vec<u8>,
    samples: u64,
}

/// Draws `body.bsk` at 32 × 32 with `more` flags. Something must be seen.
#[track_caller]
fn draw(folder: &Folder, more: &[&str]) -> Drawn {
    let base = [
        "render", "body.bsk", "-o", "p.png", "--size", "32x32", "--stats", "s.json",
    ];
    folder.run(&[&base[..], more].concat()).expect(0);
    let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
    let stats: Value = serde_json::from_str(&stats).expect("JSON");
    let (width, height, pixels) = read_png(&folder.file("p.png"));
    assert_eq!([width, height], [32, 32], "{more:?}: size");
    assert!(pixels.iter().any(|&p| p > 40), "{more:?}: nothing is seen");
    Drawn {
        pixels,
        samples: stats["samples"].as_u64().expect("a number"),
    }
}

/// The same on the CPU.
#[track_caller]
fn draw_on_cpu(folder: &Folder, flags: &str) -> Drawn {
    let flags: Vec<&str> = flags.split_whitespace().collect();
    draw(folder, &[&["--device", "cpu"], &flags[..]].concat())
}

fn body() -> Folder {
    let folder = Folder::new();
    folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    folder
}

#[test]
fn every_mode_is_another_picture() {
    let folder = body();
    // A window in which the air around the body is bright, so that minima and means show.
    let flags = |mode| match mode {
        "minip" | "mean" => format!("--mode {mode} --window=-1000,3000"),
        "iso" => format!("--mode {mode} --iso 1500"),
        _ => format!("--mode {mode}"),
    };
    let modes = ["dvr", "iso", "mip", "minip", "mean", "xray", "gradient"];
    let pictures: BTreeSet<Vec<u8>> = modes
        .map(|mode| draw_on_cpu(&folder, &flags(mode)).pixels)
        .into();
    assert_eq!(pictures.len(), modes.len(), "no two are the same");
    let default = draw_on_cpu(&folder, "");
    assert_eq!(default, draw_on_cpu(&folder, "--mode dvr"), "the default");
}

/// Two ways to say the default, and flags that say something else.
#[test]
fn sampling_and_classification_are_as_the_flags_say() {
    let folder = body();
    for (base, default, other) in [
        ("", "--jitter none", "--jitter interleaved"),
        ("", "--tf-mode post", "--tf-mode preintegrated"),
        ("", "--interpolation linear", "--interpolation nearest"),
        (
            "--mode iso --iso 1500 --step 4",
            "--refine on",
            "--refine off",
        ),
        (
            "--mode iso --iso 1500",
            "--gradient central",
            "--gradient filtered",
        ),
        ("--mode iso --iso 1500", "--shading phong", "--shading none"),
    ] {
        let [plain, default_picture, other_picture] =
            ["", default, other].map(|flag| draw_on_cpu(&folder, &format!("{base} {flag}")).pixels);
        assert!(plain == default_picture, "{base} {default}: the default");
        assert!(plain != other_picture, "{base} {other}: another picture");
    }
}

#[test]
fn quality_is_a_step() {
    let folder = body();
    for mode in ["--mode dvr", "--mode iso --iso 1500"] {
        let of = |flags: &str| draw_on_cpu(&folder, &format!("{mode} {flags}"));
        let steps = ["0.25", "0.5", "1"].map(|step| of(&format!("--step {step}")));
        for (quality, by_step) in ["fine", "balanced", "fast"].iter().zip(&steps) {
            let by_quality = of(&format!("--quality {quality}"));
            assert_eq!(&by_quality, by_step, "{mode} --quality {quality}");
        }
        assert!(
            steps[0].samples > steps[1].samples && steps[1].samples > steps[2].samples,
            "{mode}: a smaller step takes more samples"
        );
        assert_eq!(of(""), steps[1], "{mode}: balanced is the default");
        assert_eq!(
            of("--quality fine --step 1"),
            steps[2],
            "{mode}: --step is what counts"
        );
    }
}

#[test]
fn surfaces_have_values_colours_and_opacities() {
    let folder = body();
    let of = |flags: &str| {
        let unlit = "--mode iso --shading none";
        draw_on_cpu(&folder, &format!("{unlit} {flags}"))
            .pixels
            .chunks_exact(3)
            .map(|rgb| [rgb[0], rgb[1], rgb[2]])
            .collect::<Vec<[u8; 3]>>()
    };
    let default = of("--iso 500");
    // 0.92, 0.88, 0.80 of 255.
    assert!(
        default
            .iter()
            .all(|p| [[0; 3], [235, 224, 204]].contains(p)),
        "one opaque surface in the default colour"
    );
    let red = of("--iso 500:#ff0000");
    for (red, default) in red.iter().zip(&default) {
        let expected = if *default == [0; 3] { 0 } else { 255 };
        assert_eq!(*red, [expected, 0, 0], "the same in red");
    }
    // 1 − ½, 1 − ¼, … of 255: contacts with one surface.
    let half = of("--iso 500:#00ff00:0.5");
    let greens: BTreeSet<u8> = half.iter().map(|p| p[1]).collect();
    assert!(
        greens.contains(&191)
            && greens
                .iter()
                .all(|g| [0, 128, 191, 223, 239, 247, 251].contains(g)),
        "in and out again, or more often: {greens:?}"
    );
    assert!(half.iter().all(|p| p[0] == 0 && p[2] == 0), "green alone");
    // In any order, and as an interval.
    let two = of("--iso 500:#00ff00:0.5 --iso 1500:#00ff00:0.5");
    assert!(two != half, "another surface shows");
    for same in [
        "--iso 1500:#00ff00:0.5 --iso 500:#00ff00:0.5",
        "--iso 500..1500:#00ff00:0.5",
        "--iso 500..1500:0,1,0:0.5",
    ] {
        assert!(of(same) == two, "{same}");
    }
}

#[test]
fn leaping_changes_no_final_picture() {
    let folder = body();
    let [off, on] = ["off", "on"].map(|leap| draw_on_cpu(&folder, &format!("--leap {leap}")));
    assert_eq!(off, on);
}

/// Needs an adapter; Mesa's software one will do.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(skip_gpu_tests, ignore = "SKIP_GPU_TESTS=1")]
fn every_technique_draws_the_same_picture() {
    use std::cmp::Ordering;

    let folder = body();
    let of = |technique: &str| draw(&folder, &["--technique", technique, "--leap", "on"]);
    let default = of("default");
    let drawn = ["basic", "multipass", "layers", "slab"].map(|technique| {
        let drawn = of(technique);
        assert!(drawn.pixels == default.pixels, "{technique}");
        drawn
    });
    let samples = drawn.map(|d| d.samples.cmp(&default.samples));
    // Nothing is skipped without a mesh, and by layer only where no ray meets anything.
    assert_eq!(
        samples,
        [
            Ordering::Greater,
            Ordering::Equal,
            Ordering::Greater,
            Ordering::Equal
        ],
        "it is not one technique by five names"
    );
}
