//! Output files that appear only when they are complete.
//!
//! Every file that a command writes goes through [`OutFile`]: it is written under a temporary name in the destination's
//! folder, synced, and renamed. Dropping it unfinished removes the temporary file; so does [`remove_unfinished`], which
//! the signal handler calls.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::NamedTempFile;
use thiserror::Error;

/// Why an output file can't be made.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum OutFileError {
    #[error("{}: already exists; give --force to replace it", .0.display())]
    Exists(PathBuf),
    #[error("{}: is a folder; expected the name of a file to write", .0.display())]
    IsFolder(PathBuf),
    #[error("{}: the folder {} does not exist; make it first", path.display(), folder.display())]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        path: PathBuf,
        doing: &'static str,
        error: io::Error,
    },
}

/// May an existing file be replaced?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// No: refuse with [`OutFileError::Exists`].
    Refuse,
    /// Yes, at the moment the new one is complete.
    Replace,
}

/// A file being written under a temporary name.
#[derive(Debug)]
pub struct OutFile {
    temp: NamedTempFile,
    dest: PathBuf,
    existing: Existing,
}

impl OutFile {
    /// Starts a file that will become `dest`.
    ///
    /// # Errors
    /// `dest` is a folder, its folder is missing or can't be written, or it exists and may not be replaced.
    pub fn create(dest: &Path, existing: Existing) -> Result<Self, OutFileError> {
        if dest.is_dir() {
            return Err(OutFileError::IsFolder(dest.to_owned()));
        }
        if existing == Existing::Refuse && dest.symlink_metadata().is_ok() {
            return Err(OutFileError::Exists(dest.to_owned()));
        }
        let folder = match dest.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            return Err(OutFileError::NoFolder {
                path: dest.to_owned(),
                folder: folder.to_owned(),
            });
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(".brickscope-").suffix(".partial");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // What `File::create` asks for; the umask applies. The default of tempfile is 0600.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let temp = builder
            .tempfile_in(folder)
            .map_err(|error| OutFileError::Io {
                path: dest.to_owned(),
                doing: "create a file in its folder",
                error,
            })?;
        unfinished().insert(temp.path().to_owned());
        Ok(Self {
            temp,
            dest: dest.to_owned(),
            existing,
        })
    }

    /// The open file, for writing and reading.
    pub fn file(&mut self) -> &mut File {
        self.temp.as_file_mut()
    }

    /// The name the file will have.
    pub fn dest(&self) -> &Path {
        &self.dest
    }

    /// Syncs the bytes to disk and gives the file its name.
    ///
    /// # Errors
    /// The disk is full or the rename fails; the temporary file is then removed.
    pub fn commit(self) -> Result<(), OutFileError> {
        let Self {
            temp,
            dest,
            existing,
        } = self;
        let temp_path = temp.path().to_owned();
        let result = (|| {
            let io = |doing| {
                let path = dest.clone();
                move |error| OutFileError::Io { path, doing, error }
            };
            temp.as_file().sync_all().map_err(io("sync"))?;
            match existing {
                Existing::Replace => temp
                    .persist(&dest)
                    .map_err(|e| io("rename into place")(e.error))?,
                Existing::Refuse => temp.persist_noclobber(&dest).map_err(|e| {
                    if e.error.kind() == io::ErrorKind::AlreadyExists {
                        OutFileError::Exists(dest.clone())
                    } else {
                        io("rename into place")(e.error)
                    }
                })?,
            };
            Ok(())
        })();
        unfinished().remove(&temp_path);
        result
    }
}

/// Writes `bytes` as the whole of `dest`, by way of an [`OutFile`].
///
/// # Errors
/// As [`OutFile::create`] and [`OutFile::commit`].
pub fn write_whole(dest: &Path, existing: Existing, bytes: &[u8]) -> Result<(), OutFileError> {
    let mut out = OutFile::create(dest, existing)?;
    io::Write::write_all(out.file(), bytes).map_err(|error| OutFileError::Io {
        path: dest.to_owned(),
        doing: "write",
        error,
    })?;
    out.commit()
}

/// Removes the temporary files of every [`OutFile`] that is not finished. For signal handlers' threads.
pub fn remove_unfinished() {
    for path in std::mem::take(&mut *unfinished()) {
        // Nothing can be done about a failure on the way out.
        let _ = std::fs::remove_file(path);
    }
}

/// The temporary files in being. A name left here after its file was dropped is harmless: it no longer exists.
fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    static PATHS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    PATHS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn appears_only_when_committed() {
        let dir = tempfile::tempdir().unwrap();
        let dest = dir.path().join("a.bin");
        let mut out = OutFile::create(&dest, Existing::Refuse).unwrap();
        out.file().write_all(b"x").unwrap();
        assert!(!dest.exists(), "not there before commit");
        out.commit().unwrap();
        assert_eq!(std::fs::read(&dest).unwrap(), b"x", "complete after commit");
        assert!(
            matches!(
                OutFile::create(&dest, Existing::Refuse),
                Err(OutFileError::Exists(_))
            ),
            "not overwritten"
        );
        drop(OutFile::create(&dest, Existing::Replace).unwrap());
        assert_eq!(
            std::fs::read_dir(dir.path()).unwrap().count(),
            1,
            "a dropped one leaves nothing behind"
        );
        let missing = dir.path().join("no/such.bin");
        assert!(
            matches!(
                OutFile::create(&missing, Existing::Refuse),
                Err(OutFileError::NoFolder { .. })
            ),
            "folders are never made"
        );
    }
}
