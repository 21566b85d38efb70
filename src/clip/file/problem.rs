//! How readers word what is wrong with a file.

use std::path::Path;

use crate::clip::MeshError;

/// The file that is being read.
#[derive(Clone, Copy)]
pub(super) struct Subject<'a>(pub(super) &'a Path);

impl Subject<'_> {
    /// The bytes are not what the format demands.
    pub(super) fn malformed(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> MeshError {
        MeshError::Malformed {
            path: self.0.to_owned(),
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}

/// Bytes of a file as they may stand in a message: quoted, escaped, and cut to a length that fits a line.
pub(super) fn quoted(bytes: &[u8]) -> String {
    const SHOWN: usize = 40;
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(SHOWN)]);
    let more = if bytes.len() > SHOWN { "…" } else { "" };
    format!("{head:?}{more}")
}
