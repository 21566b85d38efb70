//! [`Store`]: where chunks and metadata lie, a folder or a URL, and how they are fetched by key.
//!
//! A key is a path of names below the root, joined by `/`. What is longer than it may be is refused before it is read.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::http::Web;
use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// The longest metadata that is read.
const MOST_METADATA_BYTES: u64 = 64 << 20;

/// Names of a folder that a message lists.
const MOST_LISTED: usize = 8;

/// What of an object is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// All of it, refused when it is longer than that.
    Whole { most_bytes: u64 },
    /// Exactly so many bytes from a place on.
    Range { at: u64, bytes: u64 },
    /// Exactly so many bytes at its end.
    Tail { bytes: u64 },
}

/// A place with objects below it.
#[derive(Clone)]
pub(in crate::input) struct Store {
    root: Root,
    prefix: String,
}

#[derive(Clone)]
enum Root {
    Folder(PathBuf),
    Web(Arc<Web>),
}

impl Store {
    /// The folder or URL `location`; whether something is there shows at the first fetch.
    ///
    /// # Errors
    /// It is a URL of a kind that this build can't fetch.
    pub(in crate::input) fn open(location: &str) -> Result<Self, SourceError> {
        let root = if location.contains("://") {
            Root::Web(Arc::new(Web::open(location)?))
        } else {
            Root::Folder(PathBuf::from(location))
        };
        Ok(Self {
            root,
            prefix: String::new(),
        })
    }

    /// The store that begins at `path` below this one.
    ///
    /// # Errors
    /// The path leads out of the store.
    pub(in crate::input) fn below(&self, path: &str) -> Result<Self, SourceError> {
        let mut prefix = self.prefix.clone();
        for name in path.split('/').filter(|n| !n.is_empty() && *n != ".") {
            // A file may name any path: none may lead out of the folder that the user gave.
            if name == ".." || name.contains(['\\', '\0']) || (cfg!(windows) && name.contains(':'))
            {
                return Err(Subject::new(&self.place("")).malformed(
                    format!("the path {}", quoted(path)),
                    "a path of plain names below the store",
                    quoted(name),
                ));
            }
            if !prefix.is_empty() {
                prefix.push('/');
            }
            prefix.push_str(name);
        }
        Ok(Self {
            root: self.root.clone(),
            prefix,
        })
    }

    /// Whether it lies behind a network.
    pub(in crate::input) fn is_remote(&self) -> bool {
        matches!(self.root, Root::Web(_))
    }

    /// What messages call the object `key`; the store itself for an empty one.
    pub(in crate::input) fn place(&self, key: &str) -> PathBuf {
        let key = self.whole_key(key);
        match &self.root {
            Root::Folder(path) if key.is_empty() => path.clone(),
            Root::Folder(path) => path.join(key),
            Root::Web(web) => PathBuf::from(web.url(&key)),
        }
    }

    /// The last name of its place: what to call what lies there.
    pub(in crate::input) fn name(&self) -> String {
        let place = self.place("");
        let text = place.to_string_lossy();
        let text = text.split(['?', '#']).next().unwrap_or_default();
        let name = text.rsplit(['/', '\\']).find(|n| !n.is_empty());
        name.unwrap_or("volume").to_owned()
    }

    fn whole_key(&self, key: &str) -> String {
        match (self.prefix.is_empty(), key.is_empty()) {
            (true, _) => key.to_owned(),
            (_, true) => self.prefix.clone(),
            _ => format!("{}/{key}", self.prefix),
        }
    }

    /// The metadata object `key`, or `None` where there is none.
    ///
    /// # Errors
    /// It can't be fetched or is longer than metadata may be.
    pub(in crate::input) fn metadata(&self, key: &str) -> Result<Option<Vec<u8>>, SourceError> {
        let part = Part::Whole {
            most_bytes: MOST_METADATA_BYTES,
        };
        match &self.root {
            Root::Folder(_) => self.get(key, part),
            // Keys are tried one after another: some servers answer "forbidden" for what is not there.
            Root::Web(web) => web.probe(&self.whole_key(key), part),
        }
    }

    /// The whole object `key`, or `None` where there is none.
    ///
    /// # Errors
    /// It can't be fetched or is longer than `most_bytes`.
    pub(in crate::input) fn whole(
        &self,
        key: &str,
        most_bytes: u64,
    ) -> Result<Option<Vec<u8>>, SourceError> {
        self.get(key, Part::Whole { most_bytes })
    }

    /// `bytes` bytes of the object `key` from byte `at` on, or `None` where there is no such object.
    ///
    /// # Errors
    /// It can't be fetched or is too short.
    pub(in crate::input) fn range(
        &self,
        key: &str,
        at: u64,
        bytes: u64,
    ) -> Result<Option<Vec<u8>>, SourceError> {
        self.get(key, Part::Range { at, bytes })
    }

    /// The last `bytes` bytes of the object `key`, or `None` where there is no such object.
    ///
    /// # Errors
    /// It can't be fetched or is too short.
    pub(in crate::input) fn tail(
        &self,
        key: &str,
        bytes: u64,
    ) -> Result<Option<Vec<u8>>, SourceError> {
        self.get(key, Part::Tail { bytes })
    }

    fn get(&self, key: &str, part: Part) -> Result<Option<Vec<u8>>, SourceError> {
        let key = self.whole_key(key);
        match &self.root {
            Root::Folder(folder) => {
                let found = read_file(&folder.join(key), part)?;
                if found.is_none() && !folder.is_dir() {
                    // What is not stored has a value of its own: a drive that went away must not pass for that.
                    let error = io::Error::from(io::ErrorKind::NotFound);
                    return Err(Subject::new(folder).io("find the folder", error));
                }
                Ok(found)
            }
            Root::Web(web) => web.get(&key, part),
        }
    }

    /// Whether a server said "forbidden" where metadata was looked for.
    pub(in crate::input) fn was_forbidden(&self) -> bool {
        match &self.root {
            Root::Folder(_) => false,
            Root::Web(web) => web.was_forbidden(),
        }
    }

    /// Some names of folders below, for messages; empty where they can't be listed.
    pub(in crate::input) fn children(&self) -> Vec<String> {
        if self.is_remote() {
            return Vec::new();
        }
        let Ok(entries) = std::fs::read_dir(self.place("")) else {
            return Vec::new();
        };
        let mut names: Vec<String> = entries
            .filter_map(|e| e.ok())
            .filter(|e| e.path().is_dir())
            .map(|e| e.file_name().to_string_lossy().into_owned())
            .take(MOST_LISTED)
            .collect();
        names.sort();
        names
    }

    /// When the object `key` was last changed, in words; empty where that is not known.
    pub(in crate::input) fn changed(&self, key: &str) -> String {
        if self.is_remote() {
            return String::new();
        }
        let since_epoch = std::fs::metadata(self.place(key))
            .and_then(|m| m.modified())
            .ok()
            .and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        since_epoch.map_or(String::new(), |t| {
            format!(
                "changed at {}.{:09} (Unix time)",
                t.as_secs(),
                t.subsec_nanos()
            )
        })
    }
}

/// A part of a file, or `None` where there is no file.
fn read_file(path: &Path, part: Part) -> Result<Option<Vec<u8>>, SourceError> {
    let subject = Subject::new(path);
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(e) if is_missing(&e) => return Ok(None),
        Err(e) => return Err(subject.io("open", e)),
    };
    let info = file
        .metadata()
        .map_err(|e| subject.io("read its length", e))?;
    if !info.is_file() {
        return Err(subject.malformed("the path", "a regular file", "a folder or a device"));
    }
    let len = info.len();
    let (at, bytes) = match part {
        Part::Whole { most_bytes } if len > most_bytes => {
            return Err(too_long(&subject, most_bytes, &format!("{len} bytes")));
        }
        Part::Whole { .. } => (0, len),
        Part::Range { at, bytes } => (at, bytes),
        Part::Tail { bytes } => (len.saturating_sub(bytes), bytes),
    };
    if at.checked_add(bytes).is_none_or(|end| end > len) {
        return Err(subject.malformed(
            format!("byte {at}"),
            format!("{bytes} bytes"),
            format!("a file of {len} bytes"),
        ));
    }
    // Not more than the file's length, which was found on disk.
    let mut out = Vec::with_capacity(bytes as usize);
    file.seek(SeekFrom::Start(at))
        .and_then(|_| file.take(bytes).read_to_end(&mut out))
        .map_err(|e| subject.io(format!("read at byte {at}"), e))?;
    if out.len() as u64 != bytes {
        return Err(subject.malformed(
            format!("byte {at}"),
            format!("{bytes} bytes"),
            format!("{}, as the file has become shorter", out.len()),
        ));
    }
    Ok(Some(out))
}

fn is_missing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
    )
}

/// An object is longer than what it stands for can be.
pub(super) fn too_long(subject: &Subject<'_>, most_bytes: u64, found: &str) -> SourceError {
    subject.malformed("its length", format!("at most {most_bytes} bytes"), found)
}
