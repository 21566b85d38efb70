//! How readers word what is wrong with a file: [`Subject`] makes [`SourceError`]s that name it.

use std::fs::File;
use std::io;
use std::path::Path;

use crate::volume::SourceError;

/// The file that is being read, and what a user can do when its header is wrong.
#[derive(Clone, Copy)]
pub(super) struct Subject<'a> {
    pub(super) path: &'a Path,
    pub(super) remedy: &'static str,
}

impl<'a> Subject<'a> {
    /// Errors about `path`, with the usual advice.
    pub(super) fn new(path: &'a Path) -> Self {
        Self {
            path,
            remedy: "get the file again, or export it anew with the program that made it",
        }
    }

    /// The bytes are not what the format demands.
    pub(super) fn malformed(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> SourceError {
        SourceError::Malformed {
            path: self.path.to_owned(),
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
            remedy: self.remedy.to_owned(),
        }
    }

    /// A valid file of a kind that is not built.
    pub(super) fn unsupported(
        &self,
        what: impl Into<String>,
        supported: impl Into<String>,
    ) -> SourceError {
        SourceError::Unsupported {
            path: self.path.to_owned(),
            what: what.into(),
            supported: supported.into(),
        }
    }

    /// The operating system refused.
    pub(super) fn io(&self, doing: impl Into<String>, error: io::Error) -> SourceError {
        SourceError::Io {
            path: self.path.to_owned(),
            doing: doing.into(),
            error,
        }
    }

    /// Opens the file and tells its length in bytes.
    pub(super) fn open(&self) -> Result<(File, u64), SourceError> {
        let file = File::open(self.path).map_err(|e| self.io("open", e))?;
        let meta = file.metadata().map_err(|e| self.io("read its length", e))?;
        if meta.is_dir() {
            return Err(self.malformed("the path", "a file", "a folder"));
        }
        Ok((file, meta.len()))
    }

    /// What to call the source in metadata: the file's name.
    pub(super) fn name(&self) -> String {
        self.path
            .file_name()
            .unwrap_or(self.path.as_os_str())
            .to_string_lossy()
            .into_owned()
    }
}

/// Text from a file as it may stand in a message: quoted, escaped, and cut to a length that fits a line.
pub(super) fn quoted(text: &str) -> String {
    const SHOWN: usize = 60;
    if text.chars().count() <= SHOWN {
        format!("{text:?}")
    } else {
        let head: String = text.chars().take(SHOWN).collect();
        format!("{head:?}…")
    }
}
