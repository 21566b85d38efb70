//! Why a transfer-function file can't be used, in words that name file, place, what was expected and found, and what to do.

use std::io;
use std::path::{Path, PathBuf};

use serde_json::Value;
use thiserror::Error;

use crate::classify::curve::CurveError;

/// Why a transfer-function file can't be used.
#[derive(Debug, Error)]
pub enum TransferFileError {
    /// The operating system refused.
    #[error("{}: cannot read the transfer function: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: io::Error,
    },
    /// Not what the format demands.
    #[error("{}: {place}: expected {expected}, found {found}; {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it: line and column, or object and field.
        place: String,
        /// What belongs there.
        expected: String,
        /// What is there.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A valid file with something that is not built.
    #[error("{}: {place}: {what} is not supported; {supported}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Which object.
        place: String,
        /// What it has.
        what: String,
        /// What to do.
        supported: &'static str,
    },
}

/// A place in a file, for messages.
#[derive(Clone, Debug)]
pub(super) struct Place<'a> {
    path: &'a Path,
    place: String,
}

impl<'a> Place<'a> {
    pub(super) fn top(path: &'a Path) -> Self {
        Self {
            path,
            place: "top level".to_owned(),
        }
    }

    /// Another place in the same file.
    pub(super) fn at(&self, place: String) -> Self {
        Self {
            path: self.path,
            place,
        }
    }

    /// A place within this one.
    pub(super) fn within(&self, field: &str) -> Self {
        self.at(format!("{}, {field}", self.place))
    }

    /// Adds the name of what is there.
    pub(super) fn name(&mut self, name: &str) {
        self.place = format!("{} {}", self.place, quoted(name));
    }

    /// The file's name without the ending that tells the format: what a function is called where the file says nothing.
    pub(super) fn stem(&self) -> String {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let lower = name.to_ascii_lowercase();
        let end = match lower.strip_suffix(".vp.json") {
            Some(stem) => stem.len(),
            None => name.rfind('.').filter(|&at| at > 0).unwrap_or(name.len()),
        };
        name[..end].to_owned()
    }

    pub(super) fn curve(&self, field: &str, error: CurveError) -> TransferFileError {
        self.malformed(field, "a curve", &error.to_string(), "correct the points")
    }

    pub(super) fn malformed(
        &self,
        field: &str,
        expected: &str,
        found: &str,
        remedy: &'static str,
    ) -> TransferFileError {
        let separator = if field.is_empty() { "" } else { ", " };
        TransferFileError::Malformed {
            path: self.path.to_owned(),
            place: format!("{}{separator}{field}", self.place),
            expected: expected.to_owned(),
            found: found.to_owned(),
            remedy,
        }
    }

    pub(super) fn unsupported(&self, what: &str, supported: &'static str) -> TransferFileError {
        TransferFileError::Unsupported {
            path: self.path.to_owned(),
            place: self.place.clone(),
            what: what.to_owned(),
            supported,
        }
    }
}

/// The start of a JSON value, for messages.
pub(super) fn short(value: &Value) -> String {
    cut(value.to_string())
}

/// The start of a text in quotes, with control characters spelt out, for messages.
pub(super) fn quoted(text: &str) -> String {
    cut(format!(
        "{:?}",
        text.get(..text.floor_char_boundary(400)).unwrap_or(text)
    ))
}

fn cut(text: String) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
