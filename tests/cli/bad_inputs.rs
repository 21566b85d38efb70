//! Bad inputs: each ends with exit 2, a message that names the file and what is wrong with it, and no output.
//!
//! `cargo test --test cli bad_ -- --nocapture` prints the messages.

use std::fs;
use std::process::Command;

use crate::run::{Folder, finish, gzip, nifti_header, noise, put};

/// Runs `args` and checks the refusal: exit 2, `named` and every one of `wanted` in the message, no new file.
#[track_caller]
fn refused(folder: &Folder, args: &[&str], named: &str, wanted: &[&str]) {
    let before = folder.names();
    let run = folder.run(args);
    assert_eq!(
        run.code,
        Some(2),
        "{args:?}: exit code; {}{}",
        run.stdout,
        run.stderr
    );
    assert!(!run.stderr.contains("panicked"), "{args:?}: {}", run.stderr);
    for wanted in wanted.iter().chain([&named]) {
        assert!(
            run.stderr.contains(wanted),
            "{args:?}: the message has {wanted:?}: {}",
            run.stderr
        );
    }
    assert_eq!(run.stdout, "", "{args:?}: no result");
    assert_eq!(folder.names(), before, "{args:?}: no new file");
    println!(
        "| {} | {} |",
        args.join(" "),
        run.stderr
            .trim_end()
            .trim_start_matches("brickscope: error: ")
    );
}

/// A header of 4 × 4 × 4 voxels of u8 with one change.
fn changed(at: usize, new: &[u8]) -> Vec<u8> {
    let mut bytes = nifti_header([4, 4, 4], 2, 8);
    put(&mut bytes, at, new);
    bytes.extend(noise(64));
    bytes
}

#[test]
fn bad_volumes() {
    let mut sound = nifti_header([64, 64, 16], 2, 8);
    sound.extend(noise(64 * 64 * 16));
    let sound = gzip(&sound);
    let mut flipped = sound.clone();
    let end = flipped.len() - 6;
    flipped[end] ^= 1;
    let i16s = |v: &[i16]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let nrrd = |fields: &str| {
        format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n{fields}\n\n")
    };
    let huge_nrrd = "NRRD0004\ntype: short\ndimension: 3\nsizes: 10000 10000 10000\nencoding: gzip\nendian: little\n\n";
    let huge = changed(42, &i16s(&[10000, 10000, 10000]));
    let rgb = [&i16s(&[128, 24])[..]].concat();
    let four = [i16s(&[4, 4, 4, 4, 5])].concat();
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty.nii", vec![], &["an empty file"]),
        ("empty.nii.gz", vec![], &["an empty file"]),
        (
            "half.nii.gz",
            sound[..sound.len() / 2].to_vec(),
            &["slice", "the end of the stream"],
        ),
        (
            "no-checksum.nii.gz",
            sound[..sound.len() - 8].to_vec(),
            &["the end of"],
        ),
        ("damaged.nii.gz", flipped, &["gzip"]),
        (
            "short-header.nii",
            sound_header()[..200].to_vec(),
            &["348 bytes", "after 200"],
        ),
        (
            "cut.nii",
            changed(0, &[])[..400].to_vec(),
            &["64 bytes", "400 bytes"],
        ),
        (
            "huge.nii",
            huge.clone(),
            &["1000000000000", "10000 × 10000 × 10000"],
        ),
        (
            "huge.nii.gz",
            gzip(&huge),
            &["1000000000000", "cannot decompress to more"],
        ),
        (
            "huge.nrrd",
            huge_nrrd.into(),
            &["2000000000000", "10000 × 10000 × 10000"],
        ),
        (
            "nan-spacing.nii",
            changed(84, &f32::NAN.to_le_bytes()),
            &["pixdim[2]", "a finite spacing above 0", "NaN"],
        ),
        (
            "nan-spacing.nrrd",
            nrrd("spacings: 1 nan 1").into(),
            &["spacings", "finite"],
        ),
        (
            "zero-dims.nii",
            changed(44, &i16s(&[0])),
            &["dim[2]", "a size of at least 1", "found 0"],
        ),
        (
            "negative-dims.nii",
            changed(44, &i16s(&[-3])),
            &["dim[2]", "found -3"],
        ),
        (
            "zero-sizes.nrrd",
            nrrd("").replace("4 4 4", "4 0 4").into(),
            &["sizes", "0"],
        ),
        (
            "unknown-type.nii",
            changed(70, &i16s(&[77])),
            &["datatype", "found 77"],
        ),
        (
            "unknown-type.nrrd",
            nrrd("").replace("uint8", "quaternion").into(),
            &["type", "quaternion"],
        ),
        (
            "4d.nii",
            changed(40, &four),
            &["5 points in time, 0 to 4", "choose one with --time N"],
        ),
        (
            "rgb.nii",
            changed(70, &rgb),
            &["RGB voxels", "not supported"],
        ),
        (
            "complex.nii",
            changed(70, &i16s(&[32])),
            &["complex voxels", "not supported"],
        ),
        (
            "4d.nrrd",
            nrrd("")
                .replace("dimension: 3\nsizes: 4 4 4", "dimension: 4\nsizes: 4 4 4 2")
                .into(),
            &["4-D data", "not supported"],
        ),
        (
            "stack.tif",
            b"II*\0\x08\0\0\0".to_vec(),
            &["the directory of page 0", "a file of 8 bytes"],
        ),
        (
            "cut.dcm",
            [&[0; 128][..], b"DICM"].concat(),
            &["(0002,0010)", "the transfer syntax"],
        ),
        (
            "volume.h5",
            b"\x89HDF\r\n\x1a\n".to_vec(),
            &["HDF5", "not supported"],
        ),
        (
            "text.nii",
            b"hello, this is not a volume".to_vec(),
            &["the first bytes", "--dims and --type"],
        ),
        ("bare.raw", noise(64), &["--dims and --type"]),
    ];
    let folder = Folder::new();
    for (name, bytes, wanted) in cases {
        folder.write(name, &bytes);
        refused(&folder, &["brick", name, "-o", "out.bsk"], name, wanted);
    }
}

fn sound_header() -> Vec<u8> {
    nifti_header([4, 4, 4], 2, 8)
}

#[test]
fn bad_raw_options() {
    let folder = Folder::new();
    let raw = folder.write("a.raw", &noise(60));
    let brick = |more: &'static [&'static str]| [&["brick", raw, "-o", "out.bsk"], more].concat();
    let wrong_dims = &["60 bytes", "64 bytes", "correct --dims, --type or --offset"];
    refused(
        &folder,
        &brick(&["--dims", "4,4,4", "--type", "u8"]),
        raw,
        wrong_dims,
    );
    refused(
        &folder,
        &brick(&["--dims", "3,4,5", "--type", "u16"]),
        raw,
        &["120 bytes", "60 bytes"],
    );
    refused(
        &folder,
        &brick(&["--dims", "3,4,5", "--type", "u8", "--offset", "1"]),
        raw,
        &["61 bytes"],
    );
    let huge = "18446744073709551615,18446744073709551615,2";
    refused(
        &folder,
        &[
            "brick", raw, "-o", "out.bsk", "--dims", huge, "--type", "u8",
        ],
        raw,
        &["2^64"],
    );
    // What is wrong here is what was typed, so that is what is named.
    refused(
        &folder,
        &brick(&["--dims", "3,0,5", "--type", "u8"]),
        "3,0,5",
        &["at least 1"],
    );
    refused(
        &folder,
        &brick(&["--dims", "3,4,5", "--type", "u12"]),
        "u12",
        &["u8", "f64"],
    );
    let spacing = |s: &'static str| {
        [
            "brick",
            raw,
            "-o",
            "out.bsk",
            "--dims",
            "3,4,5",
            "--type",
            "u8",
            "--spacing",
            s,
        ]
    };
    refused(&folder, &spacing("1,nan,1"), "1,nan,1", &["finite"]);
    refused(&folder, &spacing("1,-1,1"), "1,-1,1", &["above 0"]);
    refused(
        &folder,
        &["brick", "phantom:nobody:9,9,9", "-o", "out.bsk"],
        "phantom:nobody:9,9,9",
        &["body"],
    );
    refused(
        &folder,
        &["brick", "phantom:body:9,0,9", "-o", "out.bsk"],
        "phantom:body:9,0,9",
        &["0"],
    );
    refused(
        &folder,
        &["brick", "phantom:body:9,9,9:i16", "-o", "out.bsk"],
        "phantom:body:9,9,9:i16",
        &["u8, u16 or f32"],
    );
    let large = [
        "brick",
        "phantom:body:4000,4000,100",
        "-o",
        "out.bsk",
        "--memory",
        "128MiB",
    ];
    refused(
        &folder,
        &large,
        "phantom:body:4000,4000,100",
        &["--memory", "MiB or more"],
    );
}

#[test]
fn bad_pictures() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let bad = |flags: &str, named: &str, wanted: &[&str]| {
        let base = ["render", store, "-o", "p.png", "--size", "4x4"];
        let flags: Vec<&str> = flags.split_whitespace().collect();
        let args = [&base[..], &["--device", "cpu"], &flags].concat();
        refused(&folder, &args, named, wanted);
    };
    let nine = "--iso 1 --iso 2 --iso 3 --iso 4 --iso 5 --iso 6 --iso 7 --iso 8 --iso 9";
    let at_most = &["at most 8"];
    bad(&format!("--mode iso {nine}"), "9 iso-values", at_most);
    bad(
        "--mode iso --iso 1..2 --iso 3..4 --iso 5..6 --iso 7..8 --iso 9",
        "9 iso-values",
        &["an interval has two", "at most 8"],
    );
    bad("--mode iso", "--iso VALUE", &[]);
    bad(
        "--technique slab --jitter interleaved",
        "--technique slab",
        &["--jitter"],
    );
    let values = &["'--iso <VALUE", "VALUE or LOW..HIGH"];
    for value in ["nan", "inf", "50..10", "50..50", "1..", "..1", "x", ""] {
        bad(
            &format!("--mode iso --iso={value}"),
            &format!("'{value}'"),
            values,
        );
    }
    bad("--mode iso --iso 3:red", "'3:red'", &["#rrggbb"]);
    for opacity in ["2", "-0.1", "nan", ""] {
        let surface = format!("3:#00ff00:{opacity}");
        let flags = format!("--mode iso --iso {surface}");
        bad(&flags, &format!("'{surface}'"), &["an opacity from 0 to 1"]);
    }
    for (flag, value) in [
        ("--mode", "mips"),
        ("--jitter", "blue"),
        ("--gradient", "sobel"),
        ("--quality", "best"),
        ("--tf-mode", "pre"),
        ("--leap", "maybe"),
        ("--technique", "magic"),
    ] {
        bad(
            &format!("{flag} {value}"),
            &format!("'{value}'"),
            &[flag, "possible values"],
        );
    }
}

#[test]
fn bad_places() {
    let folder = Folder::new();
    fs::create_dir(folder.file("folder")).expect("a folder");
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let sponge = "phantom:sponge:32,32,32";
    refused(
        &folder,
        &["brick", "missing.nii", "-o", "out.bsk"],
        "missing.nii",
        &["cannot open"],
    );
    refused(
        &folder,
        &["brick", "folder", "-o", "out.bsk"],
        "folder",
        &["a folder without volumes"],
    );
    refused(&folder, &["info", "folder"], "folder", &["a folder"]);
    refused(
        &folder,
        &["info", "missing.bsk"],
        "missing.bsk",
        &["cannot open"],
    );
    for (args, out) in [
        (&["brick", sponge, "-o", "folder"][..], "folder"),
        (&["extract", store, "-o", "folder"], "folder"),
        (
            &["render", store, "-o", "folder", "--device", "cpu"],
            "folder",
        ),
    ] {
        refused(&folder, args, out, &[]);
    }
    let no_folder = &["no/such", "does not exist"];
    refused(
        &folder,
        &["brick", sponge, "-o", "no/such/out.bsk"],
        "no/such/out.bsk",
        no_folder,
    );
    refused(
        &folder,
        &["extract", store, "-o", "no/such/out.raw"],
        "no/such/out.raw",
        no_folder,
    );
    refused(
        &folder,
        &["render", store, "-o", "no/such/out.png", "--device", "cpu"],
        "no/such/out.png",
        no_folder,
    );
    let before = fs::read(folder.file(store)).expect("the store");
    refused(
        &folder,
        &["brick", sponge, "-o", store],
        store,
        &["already exists", "--force"],
    );
    assert_eq!(
        fs::read(folder.file(store)).expect("the store"),
        before,
        "the store is as it was"
    );
    folder
        .run(&["brick", "phantom:body:32,32,32", "-o", store, "--force"])
        .expect(0);
    assert_ne!(
        fs::read(folder.file(store)).expect("the store"),
        before,
        "--force replaces it"
    );
}

#[cfg(unix)]
#[test]
#[cfg_attr(no_setpriv, ignore = "no setpriv to take root's privileges away")]
fn bad_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    let name = folder.write("secret.nii", &sound_header());
    fs::set_permissions(folder.file(name), fs::Permissions::from_mode(0o000)).expect("a mode");
    fs::create_dir(folder.file("shut")).expect("a folder");
    fs::set_permissions(folder.file("shut"), fs::Permissions::from_mode(0o500)).expect("a mode");
    // Root reads everything, unless these two privileges are taken from it.
    let unprivileged = |args: &[&str]| {
        let mut command = Command::new("setpriv");
        command
            .arg("--bounding-set=-dac_override,-dac_read_search")
            .args(args)
            .current_dir(folder.path());
        command
    };
    let is_root = fs::File::open(folder.file(name)).is_ok();
    let binary = env!("CARGO_BIN_EXE_brickscope");
    for args in [
        &["brick", name, "-o", "out.bsk"][..],
        &["info", name],
        &["brick", "phantom:body:9,9,9", "-o", "shut/out.bsk"],
    ] {
        let run = match is_root {
            true => finish(unprivileged(&[&[binary], args].concat())),
            false => folder.run(args),
        };
        let run = run.expect(2);
        let named = if args[0] == "info" || args[1] == name {
            name
        } else {
            "shut/out.bsk"
        };
        assert!(
            run.stderr.contains(named) && run.stderr.contains("denied"),
            "{args:?}: {}",
            run.stderr
        );
        println!("| {} | {} |", args.join(" "), run.stderr.trim_end());
    }
    assert_eq!(folder.names(), ["secret.nii", "shut"], "no output");
    // So that the temporary folder can be removed.
    fs::set_permissions(folder.file("shut"), fs::Permissions::from_mode(0o700)).expect("a mode");
}

/// A flipped byte in each part of a store, and a byte too few: which command says what.
#[test]
fn bad_stores() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:40,40,40", "s.bsk");
    let sound = fs::read(folder.file(store)).expect("the store");
    let metadata = sound
        .windows(9)
        .position(|w| w == b"\"writer\":")
        .expect("the metadata");
    let flipped = |name: &'static str, at: usize| {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        folder.write(name, &bytes)
    };
    let commands = |name: &'static str| {
        [
            vec!["info", name],
            vec!["verify", name],
            vec![
                "render",
                name,
                "-o",
                "p.png",
                "--size",
                "8x8",
                "--lod",
                "0",
                "--device",
                "cpu",
                "--technique",
                "basic",
            ],
            vec!["extract", name, "-o", "x.raw"],
        ]
    };
    // The header says where the rest is: without it nothing can be checked.
    let header = flipped("h.bsk", 100);
    for args in commands(header) {
        refused(&folder, &args, header, &["header", "damaged"]);
    }
    // Damage inside is what verify is for: exit 1.
    let by_verify = |name: &str, part: &str| {
        let run = folder.run(&["verify", name]).expect(1);
        assert!(
            run.stdout.contains(name) && run.stdout.contains(part),
            "{name}: {}",
            run.stdout
        );
        println!(
            "| verify {name} (exit 1) | {} |",
            run.stdout.lines().next().unwrap_or_default()
        );
    };
    for (name, at, part) in [
        ("m.bsk", metadata + 12, "metadata"),
        ("i.bsk", sound.len() - 40, "index"),
    ] {
        let name = flipped(name, at);
        for args in commands(name) {
            match args[0] {
                "verify" => by_verify(name, part),
                _ => refused(&folder, &args, name, &[part, "damaged", "offset"]),
            }
        }
    }
    // A record is only read by who needs it.
    let record = flipped("r.bsk", 1280 + 20);
    for args in commands(record) {
        match args[0] {
            "verify" => by_verify(record, "brick"),
            "info" => drop(folder.run(&args).expect(0)),
            _ => refused(&folder, &args, record, &["brick", "damaged", "offset"]),
        }
    }
    let short = folder.write("short.bsk", &sound[..sound.len() - 1]);
    let longer = [&sound[..], &[0]].concat();
    let long = folder.write("long.bsk", &longer);
    for args in commands(short).into_iter().chain(commands(long)) {
        let expected = sound.len().to_string();
        refused(&folder, &args, args[1], &["expected a file of", &expected]);
    }
    for args in commands(folder.write("empty.bsk", b""))
        .into_iter()
        .chain(commands(folder.write("text.bsk", &[b'x'; 2000])))
    {
        refused(&folder, &args, args[1], &["not a brick store"]);
    }
}
