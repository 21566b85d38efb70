//! The rows as people read them: a table per system, under it what the ratios are and whose.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::theirs::{self, Reported};
use super::{SeedRow, SeedTable};
use crate::bench::report::Row;
use crate::bench::table::aligned_after;

/// What stands for a figure that there is none of.
const NONE: &str = "–";

/// The tables of all systems that have rows, in order; with the figures that no row has left out.
pub fn sheet(rows: &[SeedRow]) -> String {
    let mut parts = Vec::new();
    for table in SeedTable::ALL {
        let own: Vec<&SeedRow> = rows.iter().filter(|r| r.table == table.name()).collect();
        if !own.is_empty() {
            parts.push(section(table, &own));
        }
    }
    parts.join("\n\n")
}

fn section(table: SeedTable, rows: &[&SeedRow]) -> String {
    let mut lines = vec![
        format!("## {}: {}\n", table.name(), table.title()),
        figures(rows),
        String::new(),
        ratio(rows),
    ];
    lines.extend(reported(rows));
    lines.extend(active(rows));
    match table {
        SeedTable::T2 => lines.push(format!(
            "samples of a pixel without and with leaping, theirs: {:.0} and {:.0}",
            theirs::T2_STEPS[0],
            theirs::T2_STEPS[1]
        )),
        SeedTable::T3 => lines.extend(layers(rows).into_iter().chain([
            "theirs are one-pass layers ÷ layers of equal size; basic here is no layers: each ray in one pass through the \
             bounding box"
                .into(),
        ])),
        SeedTable::T4 => lines.extend(contributing(rows)),
        SeedTable::T1 | SeedTable::T5 => {}
    }
    if rows.iter().any(|r| r.error_rms.is_some()) {
        lines.push(errors(rows));
    }
    lines.extend(notes(rows));
    lines.join("\n")
}

/// The table itself.
fn figures(rows: &[&SeedRow]) -> String {
    let cells: Vec<Vec<String>> = rows.iter().map(|r| r.cells()).collect();
    let kept: Vec<usize> = (0..SeedRow::COLUMNS.len())
        .filter(|&column| cells.iter().any(|row| row[column] != NONE))
        .collect();
    let heads: Vec<&str> = kept.iter().map(|&c| SeedRow::COLUMNS[c]).collect();
    let mut above = String::new();
    let lines = rows.iter().zip(cells).map(|(row, mut cells)| {
        let subject = row.subject();
        if subject == above {
            cells[0].clear();
        }
        above = subject;
        kept.iter()
            .map(|&c| std::mem::take(&mut cells[c]))
            .collect()
    });
    aligned_after(SeedRow::WORDS, &heads, lines)
}

/// How the ratios are formed.
fn ratio(rows: &[&SeedRow]) -> String {
    let clocks: BTreeSet<&str> = rows
        .iter()
        .filter(|r| r.speed_up.is_some())
        .map(|r| match r.clock.as_str() {
            "cpu" => "CPU ms",
            "gpu" => "GPU ms",
            _ => "wall ms",
        })
        .collect();
    let time = match clocks.into_iter().collect::<Vec<_>>()[..] {
        [one] => one.to_owned(),
        _ => "time".to_owned(),
    };
    format!(
        "ours ×: {time} of the row named under 'against' ÷ {time} of this row, more is faster; the median of the repeats, and \
         under 'repeats ×' the least–greatest.\nTimes are per frame. theirs ×: speed ÷ speed as that system reported, on its \
         data:"
    )
}

/// Their ratios by data set: each list once, named by what it stands beside.
fn reported(rows: &[&SeedRow]) -> Vec<String> {
    let mut lists: Vec<(&[Reported], Vec<&SeedRow>)> = Vec::new();
    for row in rows.iter().filter(|r| !r.theirs.is_empty()) {
        match lists.iter_mut().find(|(list, _)| *list == row.theirs) {
            Some((_, beside)) => beside.push(row),
            None => lists.push((&row.theirs, vec![row])),
        }
    }
    lists
        .into_iter()
        .map(|(list, rows)| {
            let mut names: Vec<&str> = Vec::new();
            for row in &rows {
                if !names.contains(&row.configuration.as_str()) {
                    names.push(&row.configuration);
                }
            }
            let pictures: BTreeSet<&str> = rows.iter().map(|r| r.picture.as_str()).collect();
            let pictures: Vec<&str> = pictures.into_iter().collect();
            let of = match pictures[..] {
                [one] => format!(" of {one}"),
                [one, other] => format!(" of {one} and {other}"),
                _ => String::new(),
            };
            let mut line = format!("  {}{of}:", names.join("; "));
            for (number, Reported { data, ratio }) in list.iter().enumerate() {
                let comma = if number > 0 { "," } else { "" };
                write!(line, "{comma} {data} {ratio:.2}").expect("invariant: text takes text");
            }
            line
        })
        .collect()
}

/// Shares that are active, ours and theirs.
fn active(rows: &[&SeedRow]) -> Vec<String> {
    rows.iter()
        .filter_map(|row| {
            let [bricks, blocks] = [row.bricks_active?, row.blocks_active?].map(percent);
            let theirs = [theirs::T1_BRICKS_ACTIVE, theirs::T1_BLOCKS_ACTIVE].map(percent);
            Some(format!(
                "active in {}: {bricks} of the bricks, {blocks} of the blocks; theirs, of one data set: {}, {}",
                row.subject(),
                theirs[0],
                theirs[1]
            ))
        })
        .collect()
}

/// What the quadtree did.
fn layers(rows: &[&SeedRow]) -> Vec<String> {
    rows.iter()
        .filter_map(|row| {
            Some(format!(
                "{} of {}: {:.0} nodes, {:.0} passes a frame; a cell of 16² pixels has {:.0} layers, of which a ray takes {:.0} at most (means)",
                row.configuration,
                row.subject(),
                row.layer_nodes?,
                row.layer_passes?,
                row.cell_layers?,
                row.cell_most?
            ))
        })
        .collect()
}

/// Which share of the plain caster's samples changes the picture.
fn contributing(rows: &[&SeedRow]) -> Vec<String> {
    rows.iter()
        .filter(|row| row.against.is_none())
        .filter_map(|row| {
            let all = row.samples_per_pixel.filter(|&n| n > 0.0)?;
            let same = |r: &&&SeedRow| r.subject() == row.subject() && r.technique == "default";
            let needed = rows.iter().find(same)?.contributing_per_pixel?;
            let [least, most] = theirs::T4_CONTRIBUTING.map(percent);
            Some(format!(
                "contributing samples of {} ÷ samples of the plain caster: {}; theirs: {least}–{most} of typical images",
                row.subject(),
                percent(needed / all)
            ))
        })
        .collect()
}

/// What the errors are of.
fn errors(rows: &[&SeedRow]) -> String {
    let exact: BTreeSet<&str> = rows
        .iter()
        .filter(|r| r.error_rms.is_some())
        .filter_map(|r| r.error_against.as_deref())
        .collect();
    let exact: Vec<&str> = exact.into_iter().collect();
    format!(
        "RMS and 99.9th percentile of the pixels: difference from the pictures of {}, over black, in 255ths",
        exact.join(", of ")
    )
}

/// Why figures are missing, each reason once.
fn notes(rows: &[&SeedRow]) -> Vec<String> {
    let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
    for row in rows {
        let Some(reason) = row.note.as_deref() else {
            continue;
        };
        let what = format!("{}: {}", row.subject(), row.configuration);
        match reasons.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, rows)) => rows.push(what),
            None => reasons.push((reason, vec![what])),
        }
    }
    reasons
        .into_iter()
        .map(|(reason, rows)| match &rows[..] {
            [one] => format!("{NONE} {one}: {reason}"),
            rows => format!("{NONE} {} rows: {reason}", rows.len()),
        })
        .collect()
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(configuration: &str, against: Option<&str>, list: &[Reported]) -> SeedRow {
        SeedRow {
            table: "T4".into(),
            vol: "foot".into(),
            picture: "dvr".into(),
            configuration: configuration.into(),
            device: "cpu".into(),
            mode: "dvr".into(),
            technique: "default".into(),
            size: "8x8".into(),
            step: 1.0,
            level: Some(0),
            iso: Vec::new(),
            frames: 1,
            repeats: 3,
            wall_ms: Some(5.0),
            cpu_ms: Some(10.0),
            gpu_ms: None,
            clock: "cpu".into(),
            samples_per_pixel: Some(100.0),
            contributing_per_pixel: Some(2.0),
            against: against.map(Into::into),
            speed_up: against.map(|_| 2.5),
            speed_up_least: against.map(|_| 2.25),
            speed_up_greatest: against.map(|_| 2.75),
            theirs: list.to_vec(),
            error_against: None,
            error_rms: None,
            error_p99_9: None,
            layer_nodes: None,
            layer_passes: None,
            cell_layers: None,
            cell_most: None,
            bricks_active: None,
            blocks_active: None,
            note: None,
            adapter: None,
            version: String::new(),
        }
    }

    #[test]
    fn ours_stand_beside_theirs_and_what_nobody_has_is_left_out() {
        let mut refused = row("multipass", Some("plain"), theirs::T4_ESS);
        (refused.cpu_ms, refused.speed_up) = (None, None);
        (refused.speed_up_least, refused.speed_up_greatest) = (None, None);
        refused.note = Some("not built".into());
        let rows = [
            row("plain", None, &[]),
            row("ERT", Some("plain"), theirs::T4_ERT),
            refused,
        ];
        let text = sheet(&rows);
        let line = |start: &str| {
            text.lines()
                .find(|l| l.contains(start))
                .unwrap_or_else(|| panic!("{start} is in {text}"))
        };
        let head = line("drawn by");
        assert!(!head.contains("GPU ms") && !head.contains("RMS"), "{head}");
        let ert: Vec<&str> = line("ERT  ").split('|').map(str::trim).collect();
        assert_eq!(
            ert[1..ert.len() - 1],
            [
                "",
                "ERT",
                "plain",
                "10.0",
                "5.0",
                "100.0",
                "2.50",
                "2.25–2.75",
                "1.00–3.00"
            ],
        );
        assert!(line("  ERT of dvr:").contains("Head 3.00, Aneurism 1.85"));
        assert!(line("ours ×: CPU ms of").contains("the median"));
        assert!(line("contributing").contains("2.0 %; theirs: 0.2 %–4.0 %"));
        assert_eq!(line("– foot"), "– foot dvr: multipass: not built");
        assert_eq!(sheet(&[]), "");
    }
}
