//! Words and numbers of a text file, with the lines they stand in.

use super::problem::{Subject, quoted};
use crate::clip::MeshError;

/// Reads words one after the other.
pub(super) struct Words<'a> {
    subject: Subject<'a>,
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Words<'a> {
    /// The words of `bytes` from `at`, where `line` (from 1) goes on.
    pub(super) fn new(subject: Subject<'a>, bytes: &'a [u8], at: usize, line: usize) -> Self {
        Self {
            subject,
            bytes,
            at,
            line,
        }
    }

    /// Where the next byte lies.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// The line of the last word, from 1.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// The next word of this line. A backslash at its end joins the next line to it.
    pub(super) fn next_in_line(&mut self) -> Option<&'a [u8]> {
        loop {
            match self.bytes[self.at..] {
                [b'\\', b'\r', b'\n', ..] => {
                    self.at += 3;
                    self.line += 1;
                }
                [b'\\', b'\n' | b'\r', ..] => {
                    self.at += 2;
                    self.line += 1;
                }
                [b' ' | b'\t' | b'\x0b' | b'\x0c', ..] => self.at += 1,
                _ => break,
            }
        }
        let rest = &self.bytes[self.at..];
        let mut length = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        if rest[..length].ends_with(b"\\") && matches!(rest[length..], [b'\n' | b'\r', ..]) {
            length -= 1;
        }
        self.at += length;
        (length > 0).then_some(&rest[..length])
    }

    /// Goes to the next line; is there one?
    pub(super) fn next_line(&mut self) -> bool {
        let rest = &self.bytes[self.at..];
        let Some(end) = rest.iter().position(|b| matches!(b, b'\n' | b'\r')) else {
            self.at = self.bytes.len();
            return false;
        };
        let is_pair = rest[end..].starts_with(b"\r\n");
        self.at += end + 1 + usize::from(is_pair);
        self.line += 1;
        true
    }

    /// The next word of the file.
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        loop {
            let word = self.next_in_line();
            if word.is_some() {
                return word;
            }
            if !self.next_line() {
                return None;
            }
        }
    }

    /// An error at the last word.
    pub(super) fn malformed(&self, expected: impl Into<String>, found: Option<&[u8]>) -> MeshError {
        let found = found.map_or_else(|| "nothing more".to_owned(), quoted);
        self.subject
            .malformed(format!("line {}", self.line), expected, found)
    }

    /// An error at the last word: there are too few.
    pub(super) fn malformed_count(&self, expected: &str, count: usize) -> MeshError {
        self.subject
            .malformed(format!("line {}", self.line), expected, count.to_string())
    }

    /// The next word of the file, which must be `keyword` in any case.
    pub(super) fn expect(&mut self, keyword: &str) -> Result<(), MeshError> {
        match self.next() {
            Some(word) if word.eq_ignore_ascii_case(keyword.as_bytes()) => Ok(()),
            other => Err(self.malformed(format!("{keyword:?}"), other)),
        }
    }

    /// `word` as a number, not necessarily finite.
    pub(super) fn number(&self, word: Option<&[u8]>) -> Result<f64, MeshError> {
        word.and_then(|w| str::from_utf8(w).ok()?.parse().ok())
            .ok_or_else(|| self.malformed("a number", word))
    }

    /// `word` as a finite number.
    pub(super) fn coordinate(&self, word: Option<&[u8]>) -> Result<f64, MeshError> {
        let number = self.number(word)?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(self.malformed("a finite number", word))
        }
    }
}
