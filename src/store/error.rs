//! What can go wrong with a store, by kind: each names the file, the place, and what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::geom::{BrickId, Lod};
use crate::outfile::OutFileError;

/// A part of the file, as errors name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The fixed header at the start.
    Header,
    /// The JSON metadata.
    Metadata,
    /// The index of one level.
    Index(Lod),
    /// The record of one brick.
    Brick(BrickId),
    /// Bytes between two sections: always zero.
    Padding,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header => f.write_str("header"),
            Self::Metadata => f.write_str("metadata"),
            Self::Index(lod) => write!(f, "index of {lod}"),
            Self::Brick(id) => id.fmt(f),
            Self::Padding => f.write_str("padding"),
        }
    }
}

/// Why a store can't be read or written.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// What the system said.
        error: io::Error,
    },
    /// The file starts like no store does.
    #[error("{}: not a brick store: at offset 0, expected the signature of a .bsk file, found {found}; \
             make a store with 'brickscope brick INPUT -o OUT.bsk'", path.display())]
    NotAStore {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: String,
    },
    /// A store of another version of the format.
    #[error("{}: at offset 8, expected format version {supported}, found {found}; \
             brick the source again, or use the brickscope that made this store", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Version in the file.
        found: u32,
        /// The version that this program reads.
        supported: u32,
    },
    /// The store is still being written, or its bricking was killed.
    #[error("{}: not finished: {found}; finish it with 'brickscope brick INPUT -o {} --resume' and the options that it \
             was begun with, unless it is being written right now", path.display(), out.display())]
    Unfinished {
        /// The file that was to be opened.
        path: PathBuf,
        /// The store that it is to become.
        out: PathBuf,
        /// What shows it.
        found: String,
    },
    /// What a killed run left is not what its journal speaks of.
    #[error("{}: cannot be resumed: {what}; leave out --resume to start from the beginning", path.display())]
    NotResumable {
        /// The store that was to become of it.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The journal of an unfinished store is of another version.
    #[error("{}: cannot be resumed: expected a journal of version {supported}, found {found}; resume with the brickscope \
             that began it, or leave out --resume to start from the beginning", path.display())]
    JournalVersion {
        /// The store that was to become of it.
        path: PathBuf,
        /// Version in the journal.
        found: u32,
        /// The version that this program reads.
        supported: u32,
    },
    /// The file is shorter or longer than its header says.
    #[error("{}: expected a file of {expected} bytes, found {found}: it was cut or added to (an unfinished copy?); \
             copy it again or brick the source again", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes that the header asks for.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// Some bytes are not what was written.
    #[error("{}: {part} damaged, at offset {offset}: expected {expected}, found {found}; \
             restore the file from a copy or brick the source again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Which part.
        part: Part,
        /// Where in the file that part, or the bytes in question, begin.
        offset: u64,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The output file can't be made.
    #[error(transparent)]
    Out(#[from] OutFileError),
}

impl StoreError {
    /// An [`StoreError::Io`] maker for `map_err`.
    pub(crate) fn io(path: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |error| Self::Io {
            path: path.to_owned(),
            doing,
            error,
        }
    }
}

/// A fault found in a section before the path is known: becomes [`StoreError::Damaged`] in the reader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Which part.
    pub part: Part,
    /// Where in the file.
    pub offset: u64,
    /// What should be there.
    pub expected: String,
    /// What is there.
    pub found: String,
}

impl Fault {
    /// A fault in `part` at `offset`.
    pub fn new(
        part: Part,
        offset: u64,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self {
            part,
            offset,
            expected: expected.into(),
            found: found.into(),
        }
    }

    /// A checksum that does not match.
    pub fn crc(part: Part, offset: u64, expected: u32, found: u32) -> Self {
        Self::new(
            part,
            offset,
            format!("CRC32C {expected:08x}"),
            format!("{found:08x}"),
        )
    }

    /// The error when it is found in what was to be gone on with, for the store at `path`.
    pub(super) fn not_resumable(self, path: &Path) -> StoreError {
        StoreError::NotResumable {
            path: path.to_owned(),
            what: self.to_string(),
        }
    }

    /// The error for the file at `path`.
    pub fn at(self, path: &Path) -> StoreError {
        StoreError::Damaged {
            path: path.to_owned(),
            part: self.part,
            offset: self.offset,
            expected: self.expected,
            found: self.found,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}, at offset {}: expected {}, found {}",
            self.part, self.offset, self.expected, self.found
        )
    }
}
