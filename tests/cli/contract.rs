//! What holds for all commands: help, exit codes, what is refused, broken pipes, numbers below zero.

use std::collections::BTreeMap;

use crate::run::{Folder, finish};

/// The commands of cli.md; those that are not built are refused.
const COMMANDS: [&str; 12] = [
    "brick", "info", "verify", "extract", "render", "fly", "path", "view", "serve", "demo",
    "bench", "presets",
];

/// What is listed under "Commands:" by `--help`.
fn built(folder: &Folder) -> Vec<String> {
    let help = folder.run(&["--help"]).expect(0).stdout;
    let list = help
        .split_once("Commands:\n")
        .expect("a list of commands")
        .1;
    list.lines()
        .take_while(|l| !l.is_empty())
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next().map(str::to_owned))
        .collect()
}

#[test]
fn every_command_has_help_with_an_example_or_is_refused() {
    let folder = Folder::new();
    let built = built(&folder);
    for name in [
        "brick", "info", "verify", "extract", "render", "path", "fly", "demo", "presets",
    ] {
        assert!(
            built.iter().any(|b| b == name),
            "{name} is built: {built:?}"
        );
    }
    for name in &built {
        assert!(COMMANDS.contains(&name.as_str()), "{name} is in cli.md");
        let run = folder.run(&[name, "--help"]).expect(0);
        assert_eq!(run.stderr, "", "{name}: help is a result");
        let example = run
            .stdout
            .lines()
            .skip_while(|l| !l.starts_with("Example"))
            .nth(1)
            .unwrap_or_default();
        assert!(
            example
                .trim_start()
                .starts_with(&format!("brickscope {name}")),
            "{name} --help has an example: {}",
            run.stdout
        );
    }
    for name in COMMANDS.iter().filter(|c| !built.iter().any(|b| b == *c)) {
        let run = folder.run(&[name]).expect(2);
        assert!(
            run.stderr.contains(&format!("'{name}'")),
            "{name}: {}",
            run.stderr
        );
        assert_eq!(run.stdout, "", "{name}: no result");
    }
}

/// Flags and values of cli.md that may not be built yet: each is in the help, or refused by name with exit 2.
#[test]
fn what_is_not_built_is_refused_and_not_in_the_help() {
    const FLAGS: &[(&str, &str, &str)] = &[
        ("brick", "--resume", ""),
        ("brick", "--series", "1.2.3"),
        ("render", "--samples", "4"),
        ("render", "--aa", "off"),
        ("render", "--ram", "1GiB"),
        ("render", "--jitter", "none"),
        ("render", "--lod-error", "1"),
        ("render", "--clip-plane", "0,0,1,0"),
        ("render", "--clip-box", "0,0,0,1,1,1"),
        ("render", "--clip-mesh", "a.stl"),
        ("render", "--mesh", "a.stl"),
        ("render", "--leap", "on"),
        ("render", "--no-such-flag", ""),
    ];
    const VALUES: &[(&str, &str, &str)] = &[
        ("render", "--mode", "xray"),
        ("render", "--mode", "minip"),
        ("render", "--mode", "mean"),
        ("render", "--mode", "gradient"),
        ("render", "--mode", "no-such-mode"),
        ("render", "--tf-mode", "preintegrated"),
        ("render", "--technique", "multipass"),
        ("render", "--technique", "layers"),
        ("render", "--technique", "slab"),
    ];
    let folder = Folder::new();
    let mut help = BTreeMap::new();
    for command in ["brick", "render"] {
        help.insert(command, folder.run(&[command, "--help"]).expect(0).stdout);
    }
    let mut refused = 0;
    for &(command, flag, value) in FLAGS.iter().chain(VALUES) {
        let is_value = VALUES.contains(&(command, flag, value));
        // The list of values follows the flag, up to the next blank line.
        let listed: &str = help[command]
            .split(|c: char| c.is_whitespace() || c == ',')
            .any(|w| w == flag)
            .then(|| {
                help[command]
                    .split_once(&format!("{flag} "))
                    .map_or("", |(_, rest)| rest)
            })
            .map_or("", |rest| rest.split("\n\n").next().unwrap_or_default());
        let is_built = if is_value {
            listed
                .split("[possible values: ")
                .nth(1)
                .and_then(|l| l.split(']').next())
                .is_some_and(|l| l.split(", ").any(|v| v.trim() == value))
        } else {
            help[command].split_whitespace().any(|w| w == flag)
        };
        if is_built {
            continue;
        }
        refused += 1;
        let mut args = vec![command, "some-file", "-o", "out.png", flag];
        args.extend((!value.is_empty()).then_some(value));
        let run = folder.run(&args).expect(2);
        let named = if is_value { value } else { flag };
        assert!(
            run.stderr.contains(&format!("'{named}")),
            "{command} {flag} {value}: {}",
            run.stderr
        );
    }
    assert!(refused >= 2, "at least the made-up ones are refused");
    assert!(folder.names().is_empty(), "no file: {:?}", folder.names());
}

#[test]
fn exit_codes_are_0_1_and_2() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:40,40,40", "s.bsk");
    folder.run(&["verify", store]).expect(0);
    folder.run(&["--version"]).expect(0);
    let mut bytes = std::fs::read(folder.file(store)).expect("the store");
    // The first record follows the header of 1280 bytes.
    bytes[1300] ^= 1;
    let bad = folder.write("bad.bsk", &bytes);
    let run = folder.run(&["verify", bad]).expect(1);
    assert!(
        run.stdout.contains("bad.bsk") && run.stdout.contains("brick"),
        "{}",
        run.stdout
    );
    for usage in [
        &[][..],
        &["brick"],
        &["render", store],
        &["info", store, "--no-such-flag"],
    ] {
        let run = folder.run(usage).expect(2);
        assert!(
            run.stdout.is_empty() && !run.stderr.is_empty(),
            "{usage:?}: {} / {}",
            run.stdout,
            run.stderr
        );
    }
    let iso = folder
        .run(&[
            "render", store, "-o", "p.png", "--mode", "iso", "--device", "cpu",
        ])
        .expect(2);
    assert!(
        iso.stderr.contains("--iso"),
        "mode iso without a value: {}",
        iso.stderr
    );
}

#[test]
fn numbers_below_zero_are_values() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let base = [
        "render", store, "-o", "p.png", "--size", "4x4", "--device", "cpu",
    ];
    for more in [
        &[
            "--eye",
            "-40,-50,-60",
            "--target",
            "-1,2,3",
            "--up",
            "-0.1,0,1",
        ][..],
        &["--eye=-40,-50,-60", "--target=-1,2,3"],
        &["--orbit", "-30,-20"],
        &["--orbit=-30,-20,1.5"],
        &["--window", "-100,50"],
        &["--light", "-1,-1,0"],
        &["--clip-plane", "-1,0,0,20"],
        &["--mode", "iso", "--iso", "-5"],
    ] {
        let run = folder.run(&[&base[..], more].concat());
        assert_eq!(run.code, Some(0), "{more:?}: {}", run.stderr);
    }
    for (args, value) in [
        (
            &["extract", store, "-o", "x.raw", "--box", "-1,0,0,4,4,4"][..],
            "'-1,0,0,4,4,4'",
        ),
        (
            &["render", store, "-o", "p.png", "--step", "-0.5"],
            "'-0.5'",
        ),
        (&["render", store, "-o", "p.png", "--near", "-1"], "'-1'"),
        (
            &["render", store, "-o", "p.png", "--size", "-4x4"],
            "'-4x4'",
        ),
        (
            &["render", store, "-o", "p.png", "--mesh", "-a.stl"],
            "-a.stl",
        ),
    ] {
        let run = folder.run(args).expect(2);
        assert!(
            run.stderr.contains(value),
            "taken as a value, and refused: {}",
            run.stderr
        );
    }
    let misspelt = folder.run(&["info", store, "--jsno"]).expect(2);
    assert!(
        misspelt.stderr.contains("unexpected"),
        "{}",
        misspelt.stderr
    );
    // More than half of all directions, seen from the default place.
    let fisheye = ["--projection", "fisheye", "--fov", "220"];
    folder.run(&[&base[..], &fisheye].concat()).expect(0);
    let refused = folder.run(&[&base[..], &fisheye[2..]].concat()).expect(2);
    assert!(refused.stderr.contains("220"), "{}", refused.stderr);
}

#[test]
fn a_broken_pipe_exits_0() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let unread = |args: &[&str]| {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = folder.command(args);
        command.stdout(writer);
        command.output().expect("the binary starts")
    };
    for args in [
        &["info", store][..],
        &["info", store, "--json"],
        &["presets"],
        &["verify", store],
        &["extract", store, "-o", "x.raw"],
        &["brick", "phantom:sponge:32,32,32", "-o", "t.bsk"],
        &["--help"],
    ] {
        let output = unread(args);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {stderr}");
        assert_eq!(stderr, "", "{args:?}: nothing to complain of");
    }
    folder.run(&["verify", "t.bsk"]).expect(0);
}

/// Not a broken pipe: the result did not arrive, and nobody asked it to stop.
#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_exits_2() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    let full = std::fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .expect("/dev/full");
    let mut command = folder.command(&["info", store]);
    command.stdout(full);
    let child = command
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let output = child.wait_with_output().expect("the binary ends");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("space"), "{stderr}");
}

#[test]
fn a_closed_standard_error_does_not_lose_the_picture() {
    let folder = Folder::new();
    let store = folder.brick("phantom:sponge:32,32,32", "s.bsk");
    // Two transfer functions in one file are worth a note on standard error.
    let points = r#""RGBPoints":[0,0,0,0,255,1,1,1],"Points":[0,0,0.5,0,255,1,0.5,0]"#;
    let tf = format!(
        r#"[{{"Name":"a","ColorSpace":"RGB",{points}}},{{"Name":"b","ColorSpace":"RGB",{points}}}]"#
    );
    folder.write("two.json", tf.as_bytes());
    let args = [
        "render", store, "-o", "p.png", "--size", "4x4", "--device", "cpu", "--tf", "two.json",
    ];
    let noted = finish(folder.command(&args)).expect(0);
    assert!(
        noted.stderr.contains("2 transfer functions"),
        "there is a note: {}",
        noted.stderr
    );
    std::fs::remove_file(folder.file("p.png")).expect("the picture");
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let status = folder
        .command(&args)
        .stderr(writer)
        .status()
        .expect("the binary starts");
    assert!(
        status.success() && folder.file("p.png").exists(),
        "{status}, and the picture is there"
    );
}
