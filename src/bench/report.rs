//! What a run of `bench` found, as a file: machine, command and rows.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::error::BenchError;
use super::machine::Machine;
use crate::outfile::{Existing, write_whole};

/// The form of report files that this program writes and reads.
const FORMAT: u64 = 1;
/// Longest report that is read, bytes: no run has so many rows.
const MOST_BYTES: u64 = 64 << 20;

/// A time of a row, ms: less is better. `None`: not measured.
pub type NamedTime = (&'static str, Option<f64>);

/// One configuration of a sub-command, measured.
pub trait Row: Serialize + DeserializeOwned {
    /// The sub-command.
    const BENCH: &'static str;
    /// What the plot's axis counts.
    const BARS_UNIT: &'static str = "ms";
    /// Heads of the table's columns.
    const COLUMNS: &'static [&'static str];

    /// What was measured, in words: equal for the rows of two reports that may be compared.
    fn name(&self) -> String;

    /// The times that are compared and plotted; the same names for every row.
    fn times(&self) -> Vec<NamedTime>;

    /// The bars of the plot, by default the times; the same names for every row. A row without any is left out.
    fn bars(&self) -> Vec<NamedTime> {
        self.times()
    }

    /// The row of the table, a cell for each of [`Self::COLUMNS`].
    fn cells(&self) -> Vec<String>;
}

/// A report file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report<R> {
    format: u64,
    bench: String,
    /// Of the program that measured.
    pub version: String,
    /// The command line, without the program's name.
    pub command: Vec<String>,
    /// Where it was measured.
    pub machine: Machine,
    /// What was measured.
    pub rows: Vec<R>,
}

impl<R: Row> Report<R> {
    /// The report of rows measured by this program on this machine.
    pub fn new(command: Vec<String>, machine: Machine, rows: Vec<R>) -> Self {
        Self {
            format: FORMAT,
            bench: R::BENCH.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            command,
            machine,
            rows,
        }
    }

    /// Writes it to `path`, which is replaced when the report is complete.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn write(&self, path: &Path) -> Result<(), BenchError> {
        let json = serde_json::to_string_pretty(self).map_err(|e| BenchError::NotJson {
            path: path.to_owned(),
            error: e,
        })?;
        write_whole(path, Existing::Replace, format!("{json}\n").as_bytes())?;
        Ok(())
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// The file can't be read, is no JSON, no report, or one of another sub-command or a newer program.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let mut text = String::new();
        File::open(path)
            .and_then(|file| file.take(MOST_BYTES + 1).read_to_string(&mut text))
            .map_err(BenchError::io(path, "read the report"))?;
        if text.len() as u64 > MOST_BYTES {
            return Err(BenchError::NotThisReport {
                path: path.to_owned(),
                place: "the file",
                expected: format!("at most {MOST_BYTES} bytes"),
                found: "more".into(),
            });
        }
        let not_json = |error| BenchError::NotJson {
            path: path.to_owned(),
            error,
        };
        let value: serde_json::Value = serde_json::from_str(&text).map_err(not_json)?;
        for (place, expected) in [
            ("format", serde_json::Value::from(FORMAT)),
            ("bench", serde_json::Value::from(R::BENCH)),
        ] {
            let found = value.get(place);
            if found != Some(&expected) {
                return Err(BenchError::NotThisReport {
                    path: path.to_owned(),
                    place,
                    expected: expected.to_string(),
                    found: found.map_or_else(|| "no such key".into(), ToString::to_string),
                });
            }
        }
        // Read once more from the text, so that an error names its line.
        serde_json::from_str(&text).map_err(not_json)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The least row there is.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub(in crate::bench) struct Plain {
        pub(in crate::bench) name: String,
        pub(in crate::bench) cpu_ms: Option<f64>,
    }

    impl Row for Plain {
        const BENCH: &'static str = "plain";
        const COLUMNS: &'static [&'static str] = &["name", "CPU ms"];

        fn name(&self) -> String {
            self.name.clone()
        }

        fn times(&self) -> Vec<NamedTime> {
            vec![("cpu_ms", self.cpu_ms)]
        }

        fn cells(&self) -> Vec<String> {
            vec![self.name.clone(), format!("{:?}", self.cpu_ms)]
        }
    }

    /// A report of rows by name and time.
    pub(in crate::bench) fn report(rows: &[(&str, Option<f64>)]) -> Report<Plain> {
        let rows = rows
            .iter()
            .map(|&(name, cpu_ms)| Plain {
                name: name.into(),
                cpu_ms,
            })
            .collect();
        Report::new(vec!["bench".into()], Machine::this(), rows)
    }

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.json");
        let written = report(&[("a", Some(1.5)), ("b", None)]);
        written.write(&path).unwrap();
        assert_eq!(Report::<Plain>::read(&path).unwrap(), written);
    }

    #[test]
    fn what_is_no_report_is_refused_by_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.json");
        let good = serde_json::to_string_pretty(&report(&[("a", Some(1.5))])).unwrap();
        let cases = [
            ("{", "line 1"),
            ("[]", "format"),
            (&good.replace("\"format\": 1", "\"format\": 2"), "found 2"),
            (&good.replace("\"plain\"", "\"page\""), "found \"page\""),
            (&good.replace("1.5", "\"soon\""), "line"),
            (&good.replace("\"name\"", "\"nom\""), "name"),
        ];
        for (text, expected) in cases {
            std::fs::write(&path, text).unwrap();
            let error = Report::<Plain>::read(&path).unwrap_err().to_string();
            assert!(
                error.contains("r.json") && error.contains(expected),
                "{text}: {error}"
            );
        }
        std::fs::remove_file(&path).unwrap();
        let error = Report::<Plain>::read(&path).unwrap_err().to_string();
        assert!(error.contains("r.json"), "{error}");
    }
}
