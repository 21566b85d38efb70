//! Modules import downward only: the module table of ARCHITECTURE.md as data, held against every file of `src/`.
//!
//! Reads source text, so it sees every feature and platform at once. Comments and strings are left out; `use crate::…`
//! (also in groups), paths `crate::…` and chains of `super::` that climb out of a module all count. Test modules may
//! besides import whatever lies in a lower layer: a writer's test reads with a reader.

use std::fs;
use std::path::{Path, PathBuf};

/// A folder of `src/`: its layer, and what it may import.
struct Module {
    name: &'static str,
    layer: u8,
    may_import: &'static [&'static str],
}

const fn module(layer: u8, name: &'static str, may_import: &'static [&'static str]) -> Module {
    Module {
        name,
        layer,
        may_import,
    }
}

/// The table. Rows of folders that are not there yet are those that are planned.
const MODULES: &[Module] = &[
    module(0, "geom", &[]),
    module(0, "outfile", &[]),
    module(0, "clock", &[]),
    module(1, "volume", &["geom"]),
    module(1, "camera", &["geom"]),
    module(1, "classify", &["geom"]),
    module(2, "input", &["volume", "geom"]),
    module(2, "store", &["volume", "geom", "outfile"]),
    module(2, "proxy", &["geom", "volume", "classify"]),
    module(2, "clip", &["geom"]),
    module(3, "export", &["store", "volume", "geom", "outfile"]),
    module(3, "bricking", &["store", "volume", "geom"]),
    module(3, "pager", &["store", "geom", "classify"]),
    module(
        3,
        "scene",
        &["store", "camera", "classify", "clip", "volume", "geom"],
    ),
    module(4, "path", &["store", "volume", "camera", "geom"]),
    module(4, "gpu", &["geom"]),
    module(
        5,
        "render",
        &[
            "gpu", "pager", "proxy", "clip", "classify", "camera", "volume", "geom", "scene",
        ],
    ),
    module(
        5,
        "reference",
        &[
            "store", "volume", "classify", "clip", "camera", "geom", "scene",
        ],
    ),
    module(
        5,
        "cpu",
        &[
            "store", "volume", "classify", "clip", "camera", "geom", "scene",
        ],
    ),
    module(
        6,
        "engine",
        &[
            "render",
            "reference",
            "cpu",
            "pager",
            "store",
            "gpu",
            "camera",
            "classify",
            "clip",
            "volume",
            "geom",
            "proxy",
            "scene",
            "clock",
        ],
    ),
    module(7, "viewer", &["engine", "camera", "classify", "gpu"]),
    module(7, "server", &["engine", "camera", "classify"]),
    module(
        7,
        "bench",
        &[
            "engine", "bricking", "input", "store", "scene", "camera", "classify", "geom",
            "volume", "outfile", "clock",
        ],
    ),
    module(
        8,
        "cli",
        &[
            "bench",
            "clock",
            "geom",
            "outfile",
            "volume",
            "camera",
            "classify",
            "input",
            "store",
            "proxy",
            "clip",
            "export",
            "path",
            "bricking",
            "pager",
            "scene",
            "gpu",
            "render",
            "reference",
            "engine",
            "viewer",
            "server",
        ],
    ),
];

/// The only ones that may name `wgpu`.
const MAY_NAME_WGPU: &[&str] = &["gpu", "render", "engine", "viewer"];

fn find(name: &str) -> Option<&'static Module> {
    MODULES.iter().find(|m| m.name == name)
}

/// `text` with comments and the insides of string and character literals blanked; lines stay where they are.
fn code_only(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let blank = |c: char| if c == '\n' { '\n' } else { ' ' };
    let starts = |i: usize, what: &str| {
        what.chars()
            .enumerate()
            .all(|(k, c)| chars.get(i + k) == Some(&c))
    };
    let mut i = 0;
    while i < chars.len() {
        let begin = i;
        let is_word = i > 0 && (chars[i - 1].is_alphanumeric() || chars[i - 1] == '_');
        if starts(i, "//") {
            while i < chars.len() && chars[i] != '\n' {
                i += 1;
            }
        } else if starts(i, "/*") {
            let mut depth = 0;
            while i < chars.len() {
                if starts(i, "/*") {
                    depth += 1;
                    i += 2;
                } else if starts(i, "*/") {
                    depth -= 1;
                    i += 2;
                    if depth == 0 {
                        break;
                    }
                } else {
                    i += 1;
                }
            }
        } else if !is_word && (starts(i, "r\"") || starts(i, "r#")) && {
            let hashes = chars[i + 1..].iter().take_while(|&&c| c == '#').count();
            chars.get(i + 1 + hashes) == Some(&'"')
        } {
            let hashes = chars[i + 1..].iter().take_while(|&&c| c == '#').count();
            let end: String = format!("\"{}", "#".repeat(hashes));
            i += 2 + hashes;
            while i < chars.len() && !starts(i, &end) {
                i += 1;
            }
            i += end.len();
        } else if chars[i] == '"' {
            i += 1;
            while i < chars.len() && chars[i] != '"' {
                i += if chars[i] == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if chars[i] == '\''
            && (chars.get(i + 1) == Some(&'\\') || chars.get(i + 2) == Some(&'\''))
        {
            // A character, not a lifetime.
            i += if chars[i + 1] == '\\' { 3 } else { 2 };
            while i < chars.len() && chars[i] != '\'' {
                i += 1;
            }
            i += 1;
        } else {
            out.push(chars[i]);
            i += 1;
            continue;
        }
        out.extend(chars[begin..i.min(chars.len())].iter().map(|&c| blank(c)));
    }
    out
}

/// The identifiers that `path` begins with: one, or those of a group `{a::b, c}`.
fn heads(path: &str) -> Vec<String> {
    let word = |s: &str| -> String {
        s.trim_start()
            .chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    let path = path.trim_start();
    let Some(group) = path.strip_prefix('{') else {
        return vec![word(path)];
    };
    let (mut depth, mut names, mut begin) = (0, Vec::new(), 0);
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            '}' | ',' if depth == 0 => {
                names.push(word(&group[begin..i]));
                begin = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    names.retain(|n| !n.is_empty());
    names
}

/// Every place where a whole identifier `word` stands in `code`, as byte offsets.
fn places<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(word)
        .filter(move |(at, _)| {
            !code[..*at].chars().next_back().is_some_and(is_word)
                && !code[at + word.len()..].chars().next().is_some_and(is_word)
        })
        .map(|(at, _)| at)
}

/// What in `text`, the file at `path` (from `src/`), breaks the rules: `path:line: …`, one each.
fn violations(path: &Path, text: &str) -> Vec<String> {
    let parts: Vec<String> = path
        .with_extension("")
        .iter()
        .map(|p| p.to_string_lossy().into_owned())
        .collect();
    let Some(own) = find(&parts[0]) else {
        return vec![format!(
            "src/{}: the folder {} is not in the table",
            path.display(),
            parts[0]
        )];
    };
    // How many `super::` reach the root of the crate.
    let depth = parts.iter().filter(|p| *p != "mod").count();
    let code = code_only(text);
    let is_test_file = parts.iter().any(|p| p == "tests");
    let tests_begin = code.find("#[cfg(test)]\nmod tests {").unwrap_or(code.len());
    let mut found = Vec::new();
    let mut report = |at: usize, what: String| {
        let line = code[..at].matches('\n').count() + 1;
        found.push(format!("src/{}:{line}: {what}", path.display()));
    };
    let mut imports: Vec<(usize, String)> = Vec::new();
    for at in places(&code, "crate") {
        if let Some(path) = code[at + "crate".len()..].trim_start().strip_prefix("::") {
            imports.extend(heads(path).into_iter().map(|name| (at, name)));
        }
    }
    for at in places(&code, "super") {
        let mut rest = &code[at..];
        let mut climbed = 0;
        while let Some(next) = rest
            .trim_start()
            .strip_prefix("super")
            .and_then(|r| r.trim_start().strip_prefix("::"))
        {
            rest = next;
            climbed += 1;
        }
        let is_inner = code[..at].trim_end().ends_with("super::");
        if climbed >= depth && !is_inner {
            imports.extend(
                heads(rest)
                    .into_iter()
                    .filter(|n| find(n).is_some())
                    .map(|name| (at, name)),
            );
        }
    }
    for (at, name) in imports {
        if name == own.name || own.may_import.contains(&name.as_str()) {
            continue;
        }
        let is_test = is_test_file || at > tests_begin;
        match find(&name) {
            None => report(at, format!("crate::{name} is not in the table")),
            Some(other) if is_test && other.layer < own.layer => {}
            Some(other) => report(
                at,
                format!(
                    "{} (layer {}) may not import {name} (layer {})",
                    own.name, own.layer, other.layer
                ),
            ),
        }
    }
    if !MAY_NAME_WGPU.contains(&own.name) {
        for at in places(&code, "wgpu") {
            report(at, format!("{} may not name wgpu", own.name));
        }
    }
    found
}

/// All `.rs` files below `folder`.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).expect("src is readable") {
        let path = entry.expect("src is readable").path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn modules_import_downward_only() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = sources(&src);
    assert!(
        files.len() > 50,
        "only {} files found in {}",
        files.len(),
        src.display()
    );
    let found: Vec<String> = files
        .iter()
        .filter_map(|file| {
            let path = file.strip_prefix(&src).expect("a file of src");
            // The roots name every module.
            let is_root = ["lib.rs", "main.rs"].iter().any(|r| path == Path::new(r));
            (!is_root)
                .then(|| violations(path, &fs::read_to_string(file).expect("a readable file")))
        })
        .flatten()
        .collect();
    assert!(
        found.is_empty(),
        "{} violations:\n{}",
        found.len(),
        found.join("\n")
    );
}

#[test]
fn the_table_itself_goes_downward() {
    for (i, m) in MODULES.iter().enumerate() {
        assert!(
            MODULES[..i].iter().all(|other| other.name != m.name),
            "{} has two rows",
            m.name
        );
        for name in m.may_import {
            let other = find(name)
                .unwrap_or_else(|| panic!("{} may import {name}, which has no row", m.name));
            assert!(
                other.layer < m.layer,
                "{} (layer {}) imports {name} (layer {})",
                m.name,
                m.layer,
                other.layer
            );
        }
    }
}

/// The scanner, on a made-up text: what must be found is found, on its line, and nothing else.
#[test]
fn upward_imports_are_caught() {
    let text = "\
//! Docs may say crate::cli::main and wgpu.
use crate::volume::VoxelType;
use crate::engine::Engine;
use crate::{geom::Lod, render::{self, frame}, outfile};
/* crate::server */
fn f() { let _ = \"crate::viewer\"; let _c = '\"'; crate::pager::plan(); }
use super::super::bricking;
use wgpu::Device;
#[cfg(test)]
mod tests {
    use crate::classify::Preset;
    use crate::export::create;
}
";
    let lines = |path: &str| -> Vec<String> {
        violations(Path::new(path), text)
            .iter()
            .map(|v| {
                v.trim_start_matches(&format!("src/{path}:"))
                    .split_once(':')
                    .map_or("", |(l, _)| l)
                    .to_owned()
            })
            .collect()
    };
    // Line 12: a test may import what is lower, but export is not.
    assert_eq!(
        lines("store/reader.rs"),
        ["3", "4", "6", "12", "7", "8"],
        "{:#?}",
        violations(Path::new("store/reader.rs"), text)
    );
    let unknown = violations(Path::new("attic/mod.rs"), "");
    assert!(
        unknown[0].contains("attic is not in the table"),
        "{unknown:?}"
    );
}
