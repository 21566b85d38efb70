//! Flags of geometry, panoramas and depths, as a user would type them, and what is refused of them.

use std::fmt::Write;
use std::fs;

use serde_json::Value;

use crate::run::{Folder, Run, read_png};

/// A cube in mm as ASCII STL; without its last triangle if `is_open`.
fn cube(low: f64, high: f64, is_open: bool) -> String {
    let corner = |n: usize| [0, 1, 2].map(|axis| if n >> axis & 1 == 1 { high } else { low });
    // Two triangles of each face, counter-clockwise from outside.
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = quads
        .iter()
        .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    let mut text = String::from("solid cube\n");
    for triangle in triangles.take(if is_open { 11 } else { 12 }) {
        text.push_str("facet normal 0 0 0\nouter loop\n");
        for [x, y, z] in triangle.map(corner) {
            writeln!(text, "vertex {x} {y} {z}").expect("writing to memory");
        }
        text.push_str("endloop\nendfacet\n");
    }
    text + "endsolid cube\n"
}

fn scene() -> Folder {
    let folder = Folder::new();
    folder.brick("phantom:body:48,48,48:u16", "body.bsk");
    folder.write("cube.stl", cube(10.0, 34.0, false).as_bytes());
    folder.write("open.stl", cube(10.0, 34.0, true).as_bytes());
    folder
}

fn render(folder: &Folder, flags: &str) -> Run {
    let base = "render body.bsk -o p.png --size 40x32 --device cpu --stats s.json";
    let all: Vec<&str> = base.split(' ').chain(flags.split_whitespace()).collect();
    folder.run(&all)
}

/// The picture, and its samples.
#[track_caller]
fn draw(folder: &Folder, flags: &str) -> (Vec<u8>, u64) {
    render(folder, flags).expect(0);
    let stats = fs::read_to_string(folder.file("s.json")).expect("statistics");
    let stats: Value = serde_json::from_str(&stats).expect("JSON");
    let samples = stats["samples"].as_u64().expect("a number");
    (read_png(&folder.file("p.png")).2, samples)
}

#[test]
fn every_cut_is_another_picture_and_takes_fewer_samples() {
    let folder = scene();
    let (whole, all) = draw(&folder, "");
    let nothing_gone = draw(&folder, "--clip-plane 0,0,1,1000");
    assert_eq!(nothing_gone.0, whole, "a plane that removes nothing");
    let mut seen = vec![whole];
    for flags in [
        "--clip-plane 0,-1,0,20",
        "--clip-plane 0,-1,0,20 --clip-plane=-1,0,0,20",
        "--clip-box 12,12,12,30,30,30",
        "--clip-mesh cube.stl",
        "--clip-mesh cube.stl:outside",
    ] {
        let (pixels, samples) = draw(&folder, flags);
        assert!(!seen.contains(&pixels), "{flags}: the same picture");
        assert!(samples < all, "{flags}: {samples} samples of {all}");
        seen.push(pixels);
    }
    assert_eq!(
        draw(&folder, "--clip-mesh cube.stl:inside").0,
        seen[4],
        "inside is the default"
    );
    for flags in [
        "--clip-plane 0,-1,0,20 --caps on",
        "--clip-plane 0,-1,0,20 --shading phong",
        "--clip-plane 0,-1,0,20 --shading phong --cut-normals on",
        "--mesh cube.stl",
        "--mesh cube.stl:#ff0000",
        "--mesh cube.stl:1,0,0:0.5",
        "--projection fisheye --fov 200 --eye 24,24,24 --target 24,0,24",
        "--projection equirectangular --eye 24,24,24 --target 24,0,24",
    ] {
        let pixels = draw(&folder, flags).0;
        assert!(
            !seen.contains(&pixels),
            "{flags}: a picture that was seen before"
        );
        seen.push(pixels);
    }
}

#[test]
fn depths_and_floats_are_written() {
    let folder = scene();
    render(
        &folder,
        "--mesh cube.stl --depth d.png --depth-opaque d.exr",
    )
    .expect(0);
    let (width, height, depths) = read_png(&folder.file("d.png"));
    assert_eq!([width, height], [40, 32]);
    let values: Vec<u16> = depths
        .chunks(2)
        .map(|b| u16::from_be_bytes([b[0], b[1]]))
        .collect();
    assert!(values.contains(&u16::MAX), "some rays meet nothing");
    assert!(values.contains(&0), "one of them is the nearest");
    let signature = [0x76, 0x2f, 0x31, 0x01];
    let is_exr = |name: &str| {
        fs::read(folder.file(name))
            .expect("a file")
            .starts_with(&signature)
    };
    assert!(is_exr("d.exr"));
    folder
        .run(&[
            "render", "body.bsk", "-o", "p.exr", "--size", "16x16", "--device", "cpu",
        ])
        .expect(0);
    assert!(is_exr("p.exr"));
}

#[test]
fn what_cannot_cut_is_refused_by_name() {
    let folder = scene();
    folder.write("no.stl", b"not a mesh at all");
    folder.write("short.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n");
    for (flags, words) in [
        ("--clip-mesh open.stl", &["open.stl", "closed"][..]),
        ("--clip-mesh missing.stl", &["missing.stl"]),
        ("--mesh no.stl", &["no.stl"]),
        ("--mesh short.ply", &["short.ply"]),
        ("--mesh cube.stl:#ff0000:1.5", &["opacity"]),
        ("--clip-plane 0,0,0,1", &["normal"]),
        ("--clip-plane 1,2,3", &["4 finite numbers"]),
        ("--clip-box 1,1,1,1,2,2", &["above its first"]),
        ("--depth d.jpg", &["d.jpg", ".exr"]),
        ("--projection fisheye --fov 300", &["180"]),
        ("--projection perspective --fov 200", &["180"]),
    ] {
        let run = render(&folder, flags).expect(2);
        for word in words {
            assert!(
                run.stderr.contains(word),
                "{flags}: no '{word}' in: {}",
                run.stderr
            );
        }
        assert!(
            !folder.names().contains(&"p.png".to_owned()),
            "{flags}: nothing is written"
        );
    }
}
