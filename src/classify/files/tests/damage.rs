//! Damaged and oversized files are refused, soon, and never panic.

use proptest::prelude::*;

use super::{every_format, parse};
use crate::classify::to_paraview;

#[test]
fn great_files_are_refused_soon() {
    let begun = std::time::Instant::now();
    let many: String = (0..200_000).map(|i| format!(" a{i}=\"\"")).collect();
    for (what, text) in [
        ("attributes", format!("<ColorMap{many}/>")),
        (
            "namespaces",
            format!("<ColorMap{}/>", many.replace(" a", " xmlns:a")),
        ),
        ("depth", "<a>".repeat(3_000_000)),
        ("brackets", "[".repeat(3_000_000)),
        (
            "points",
            format!("<ColorMap>{}</ColorMap>", "<Point/>".repeat(70_000)),
        ),
        (
            "nodes",
            format!("<ColorMap>{}</ColorMap>", "<b/>".repeat(2_000_000)),
        ),
        (
            "number",
            format!("1\n1\n1\n1\n1\n1\n{}\n", "9".repeat(1_000_000)),
        ),
        ("rows", "1 2 3\n".repeat(1_000_000)),
        ("knots", {
            let point = |i: u32| {
                let c = i % 2;
                format!(r#"{{"x":{i},"color":[{c},0,0],"midpoint":0.4,"sharpness":0.5}}"#)
            };
            let points: Vec<String> = (0..60_000).map(point).collect();
            let points = points.join(",");
            format!(
                r#"{{"volumeProperties":[{{"components":[{{"rgbTransferFunction":{{"points":[{points}]}},
                "scalarOpacity":{{"points":[{{"x":0,"y":0}}]}}}}]}}]}}"#
            )
        }),
    ] {
        assert!(parse("great", text.as_bytes()).is_err(), "{what}");
    }
    assert!(begun.elapsed().as_secs() < 60, "{:?}", begun.elapsed());
}

/// A file of each format, and what is done to it: bytes replaced, cut, or put in.
fn damaged(bytes: &[u8], changes: &[(u32, u8, u8)], end: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for &(at, byte, kind) in changes {
        let at = at as usize % bytes.len();
        match kind % 4 {
            0 => bytes[at] = byte,
            // What numbers and structure are made of.
            1 => bytes[at] = b"0123456789.-+eE \n\"<>[]{},:/="[usize::from(byte) % 28],
            2 => bytes.insert(at, byte),
            _ => {
                bytes.remove(at);
            }
        }
        if bytes.is_empty() {
            return bytes;
        }
    }
    if end.is_multiple_of(4) {
        bytes.truncate(end as usize / 4 % bytes.len());
    }
    bytes
}

/// What is read from damaged bytes is sound, or refused in words that name the file.
fn check_damage(format: usize, changes: &[(u32, u8, u8)], end: u32) -> Result<(), TestCaseError> {
    let (name, bytes) = every_format().swap_remove(format);
    match parse(name, &damaged(&bytes, changes, end)) {
        Ok(functions) => {
            prop_assert!(!functions.is_empty(), "at least one");
            for tf in functions {
                let [lo, hi] = tf.extent();
                prop_assert!(lo.is_finite() && hi.is_finite() && lo <= hi, "{:?}", tf);
                let rgba = tf.eval(0.5 * lo + 0.5 * hi);
                prop_assert!(rgba.iter().all(|v| (0.0..=1.0).contains(v)), "{:?}", rgba);
                let back = parse("back.json", to_paraview(&[tf]).as_bytes());
                prop_assert!(back.is_ok(), "{:?}", back);
            }
        }
        Err(e) => prop_assert!(e.to_string().starts_with(name), "{}", e),
    }
    Ok(())
}

/// One property per format, so that each gets its own cases.
macro_rules! damage_to {
    ($($test:ident: $format:expr,)*) => {
        proptest! {
            #![proptest_config(ProptestConfig::with_cases(1000))]
            $(
                #[test]
                fn $test(
                    changes in prop::collection::vec(any::<(u32, u8, u8)>(), 1..6),
                    end in any::<u32>(),
                ) {
                    check_damage($format, &changes, end)?;
                }
            )*
        }
    };
}

damage_to! {
    damaged_paraview_json: 0,
    damaged_paraview_xml: 1,
    damaged_slicer_json: 2,
    damaged_slicer_lines: 3,
    damaged_slicer_presets: 4,
    damaged_bare_tables: 5,
    damaged_tables_with_header: 6,
    damaged_rows: 7,
    damaged_tables_as_text: 8,
}
