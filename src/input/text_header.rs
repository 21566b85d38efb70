//! Headers made of lines of text, as NRRD and MetaImage have them: read with a bound, fields by name, numbers parsed
//! with an error that names the field. Which fields there are is for the formats.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};

use super::problem::{Subject, quoted};
use crate::volume::SourceError;

/// The most bytes a header may have.
const MOST_BYTES: u64 = 1 << 20;

/// The lines of a text header, and how many bytes they take in the file.
pub(super) struct Lines {
    /// Without their line ends; bytes that are not UTF-8 are replaced.
    pub(super) lines: Vec<String>,
    /// Bytes up to and including the end of the last line.
    pub(super) bytes: u64,
}

/// Reads lines up to and including the first that `is_last`, or to the end of the file.
///
/// # Errors
/// The file can't be read, or the header does not end within 1 MiB.
pub(super) fn read_lines(
    subject: &Subject<'_>,
    file: impl Read,
    is_last: impl Fn(&str) -> bool,
) -> Result<Lines, SourceError> {
    let mut reader = BufReader::new(file.take(MOST_BYTES));
    let mut header = Lines {
        lines: Vec::new(),
        bytes: 0,
    };
    let mut line = Vec::new();
    loop {
        line.clear();
        let n = reader
            .read_until(b'\n', &mut line)
            .map_err(|e| subject.io("read the header", e))?;
        header.bytes += n as u64;
        if header.bytes >= MOST_BYTES {
            return Err(subject.malformed(
                "the header",
                format!("an end within {MOST_BYTES} bytes"),
                "more text",
            ));
        }
        if n == 0 {
            return Ok(header);
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.strip_suffix('\n').unwrap_or(&text);
        let text = text.strip_suffix('\r').unwrap_or(text).to_owned();
        let done = is_last(&text);
        header.lines.push(text);
        if done {
            return Ok(header);
        }
    }
}

/// Fields of a text header, by lower-case name.
pub(super) struct Fields<'a> {
    subject: Subject<'a>,
    by_name: BTreeMap<String, String>,
}

impl<'a> Fields<'a> {
    /// No fields yet.
    pub(super) fn new(subject: Subject<'a>) -> Self {
        Self {
            subject,
            by_name: BTreeMap::new(),
        }
    }

    /// Adds one field.
    ///
    /// # Errors
    /// It was there already.
    pub(super) fn insert(&mut self, name: &str, value: &str) -> Result<(), SourceError> {
        let name = name.trim().to_ascii_lowercase();
        let value = value.trim();
        match self.by_name.insert(name.clone(), value.to_owned()) {
            None => Ok(()),
            Some(before) => Err(self.malformed(
                &name,
                "the field once",
                &format!("{before} and again {value}"),
            )),
        }
    }

    /// The value of the first of `names` that is there, with that name.
    pub(super) fn get(&self, names: &[&'static str]) -> Option<(&'static str, &str)> {
        names
            .iter()
            .find_map(|&n| Some((n, self.by_name.get(n)?.as_str())))
    }

    /// As [`Self::get`], but the field must be there.
    pub(super) fn need(
        &self,
        names: &[&'static str],
        expected: &str,
    ) -> Result<(&'static str, &str), SourceError> {
        self.get(names).ok_or_else(|| {
            let name = names.first().copied().unwrap_or_default();
            self.subject
                .malformed(format!("field '{name}'"), expected, "no such field")
        })
    }

    /// An error about field `name`.
    pub(super) fn malformed(&self, name: &str, expected: &str, found: &str) -> SourceError {
        self.subject
            .malformed(format!("field '{name}'"), expected, quoted(found))
    }

    /// `value` of field `name` as `count` whole numbers of at least 1.
    pub(super) fn sizes(
        &self,
        name: &str,
        value: &str,
        count: usize,
    ) -> Result<Vec<u64>, SourceError> {
        let parsed: Option<Vec<u64>> = value
            .split_whitespace()
            .map(|p| p.parse().ok().filter(|&n| n > 0))
            .collect();
        parsed.filter(|v| v.len() == count).ok_or_else(|| {
            let expected = format!("{count} whole numbers of at least 1");
            self.malformed(name, &expected, value)
        })
    }

    /// `value` of field `name` as `count` numbers; NaN and infinity are let through.
    pub(super) fn reals(
        &self,
        name: &str,
        value: &str,
        count: usize,
    ) -> Result<Vec<f64>, SourceError> {
        let parsed: Option<Vec<f64>> = value.split_whitespace().map(|p| p.parse().ok()).collect();
        parsed
            .filter(|v| v.len() == count)
            .ok_or_else(|| self.malformed(name, &format!("{count} numbers"), value))
    }
}
