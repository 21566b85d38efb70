//! What every sub-command of `bench` does with its rows: a table or JSON lines, a report, a plot, a comparison.

use std::io::{self, Write};
use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value};

use crate::bench::{Comparison, Machine, Ratios, Report, Row, aligned, table, write_plot};
use crate::outfile::{Existing, OutFile};

/// Where figures go.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct OutputArgs {
    /// One JSON line per configuration instead of a table
    #[arg(long)]
    json: bool,
    /// Write the report to this file: machine, command, version and figures
    #[arg(long, value_name = "REPORT.json", help_heading = "Reports")]
    out: Option<PathBuf>,
    /// Draw the times as bars into this file; bench seeds: the speed-ups
    #[arg(long, value_name = "PLOT.svg", help_heading = "Reports")]
    svg: Option<PathBuf>,
    /// Hold the figures against an older report: old ÷ new, more than 1 is faster
    #[arg(long, value_name = "OLD.json", help_heading = "Reports")]
    compare: Option<PathBuf>,
}

impl OutputArgs {
    /// Before minutes of work: can the files be written at all? And the older report.
    ///
    /// # Errors
    /// An output can't be written, or the report is none of this sub-command.
    pub(super) fn open<R: Row>(&self) -> anyhow::Result<Option<Report<R>>> {
        for path in self.out.iter().chain(&self.svg) {
            drop(OutFile::create(path, Existing::Replace)?);
        }
        Ok(self.compare.as_deref().map(Report::read).transpose()?)
    }

    /// Prints the rows (and, under a table, `remarks`) and writes what was asked for. `title` is the plot's.
    ///
    /// # Errors
    /// Standard output or a file can't be written.
    pub(super) fn finish<R: Row>(
        &self,
        rows: Vec<R>,
        old: Option<&Report<R>>,
        remarks: &[String],
        title: &str,
    ) -> anyhow::Result<()> {
        let print = |rows: &[R]| {
            let mut text = table(rows);
            for remark in remarks {
                text += "\n\n";
                text += remark;
            }
            text
        };
        self.finish_with(rows, old, print, title)
    }

    /// As [`Self::finish`], with a table of one's own.
    ///
    /// # Errors
    /// Standard output or a file can't be written.
    pub(super) fn finish_with<R: Row>(
        &self,
        rows: Vec<R>,
        old: Option<&Report<R>>,
        print: impl FnOnce(&[R]) -> String,
        title: &str,
    ) -> anyhow::Result<()> {
        let mut comparison = old.map(Comparison::new);
        let ratios: Vec<Option<Ratios>> = rows
            .iter()
            .map(|row| comparison.as_mut()?.ratios(row))
            .collect();
        let command = std::env::args().skip(1).collect();
        let report = Report::new(command, Machine::this(), rows);
        let mut out = io::stdout().lock();
        if self.json {
            for (row, ratios) in report.rows.iter().zip(&ratios) {
                let old_over_new = old.map(|_| as_object(ratios.as_ref()));
                let line = Line { row, old_over_new };
                writeln!(out, "{}", serde_json::to_string(&line)?)?;
            }
        } else {
            writeln!(out, "{}", print(&report.rows))?;
            if old.is_some() {
                writeln!(out, "\n{}", ratio_table(&report.rows, &ratios))?;
            }
        }
        out.flush()?;
        if let (Some(old), Some(comparison)) = (old, comparison) {
            if old.machine != report.machine {
                note("the older report is of another machine: the ratios compare machines, too");
            }
            for name in comparison.without_partner() {
                note(&format!("only in the older report: {name}"));
            }
        }
        if let Some(path) = &self.svg {
            write_plot(&report.rows, title, path)?;
        }
        if let Some(path) = &self.out {
            report.write(path)?;
        }
        Ok(())
    }
}

/// A row as JSON, its keys in the row's order.
#[derive(Serialize)]
struct Line<'a, R> {
    #[serde(flatten)]
    row: &'a R,
    /// Only with an older report to compare with.
    #[serde(skip_serializing_if = "Option::is_none")]
    old_over_new: Option<Value>,
}

/// Says something on standard error.
pub(super) fn note(text: &str) {
    // Standard error is gone: nobody to tell, but the figures are wanted all the same.
    let _ = writeln!(io::stderr(), "brickscope: {text}");
}

/// Ratios by name of the time; null for a row without partner.
fn as_object(ratios: Option<&Ratios>) -> Value {
    ratios.map_or(Value::Null, |r| {
        let pairs = r.ratios.iter();
        Value::Object(Map::from_iter(
            pairs.map(|&(name, ratio)| (name.to_owned(), Value::from(ratio))),
        ))
    })
}

/// Old ÷ new of each row.
fn ratio_table<R: Row>(rows: &[R], ratios: &[Option<Ratios>]) -> String {
    let times: Vec<&str> = rows.first().map_or_else(Vec::new, |r| {
        r.times().into_iter().map(|(n, _)| n).collect()
    });
    let columns = [&["old ÷ new"][..], &times].concat();
    let lines = rows.iter().zip(ratios).map(|(row, ratios)| {
        let cells = times.iter().enumerate().map(|(number, _)| match ratios {
            Some(ratios) => ratios.ratios[number]
                .1
                .map_or("–".into(), |ratio| format!("{ratio:.3}")),
            None => "no partner".into(),
        });
        [row.name()].into_iter().chain(cells).collect()
    });
    aligned(&columns, lines)
}
