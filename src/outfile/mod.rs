//! Output files that appear only when they are complete.
//!
//! Every file that a command writes goes through [`OutFile`]: it is written under a temporary name in the destination's
//! folder, synced, and renamed. Dropping it unfinished removes the temporary file; so does [`remove_unfinished`], which
//! the signal handler calls. What takes hours goes through a [`PartialFolder`] instead, whose name is known: what a killed
//! process left in it can be found and gone on with.

mod folder;
mod partial;

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::{NamedTempFile, TempPath};
use thiserror::Error;

pub use folder::OutFolder;
pub use partial::PartialFolder;

/// Why an output file can't be made.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum OutFileError {
    #[error("{}: already exists; give --force to replace it", .0.display())]
    Exists(PathBuf),
    #[error("{}: is a folder; expected the name of a file to write", .0.display())]
    IsFolder(PathBuf),
    #[error(
        "{}: is there and has no {mark}, so that it is something else; expected a name that is free, or that of a folder of \
         this kind",
        path.display()
    )]
    Other { path: PathBuf, mark: &'static str },
    #[error("{}: the folder {} does not exist; make it first", path.display(), folder.display())]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("{}: is being written by another process (it holds {}); wait for it, or end it", dest.display(), folder.display())]
    Busy { dest: PathBuf, folder: PathBuf },
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        path: PathBuf,
        doing: &'static str,
        error: io::Error,
    },
}

impl OutFileError {
    /// An [`OutFileError::Io`] maker for `map_err`.
    fn io(path: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |error| Self::Io {
            path: path.to_owned(),
            doing,
            error,
        }
    }
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
        let folder = check_dest(dest, existing)?;
        let mut builder = tempfile::Builder::new();
        builder.prefix(".brickscope-").suffix(".partial");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // What `File::create` asks for; the umask applies. The default of tempfile is 0600.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        // Held from before the file is there: `remove_unfinished` sees all or nothing of it.
        let mut unfinished = unfinished();
        let temp = builder
            .tempfile_in(folder)
            .map_err(OutFileError::io(dest, "create a file in its folder"))?;
        unfinished.insert(temp.path().to_owned());
        drop(unfinished);
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

    /// Where the file is until then: for another program that is to write it. It must not be replaced, only written.
    pub fn temp_path(&self) -> &Path {
        self.temp.path()
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
            temp.as_file()
                .sync_all()
                .map_err(OutFileError::io(&dest, "sync"))?;
            rename_into_place(temp.into_temp_path(), &dest, existing)
        })();
        unfinished().remove(&temp_path);
        result
    }
}

/// The folder of `dest`, which must be there.
fn folder_of(dest: &Path) -> &Path {
    match dest.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// Are both names of one place, be it there yet or not?
pub fn is_same_place(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| {
        let whole = path.canonicalize().ok();
        whole.or_else(|| Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?)))
    };
    a == b || place(a).is_some_and(|a| Some(a) == place(b))
}

/// The first two of `paths` that are one place.
pub fn find_same<'a>(paths: &[&'a Path]) -> Option<[&'a Path; 2]> {
    let pairs = paths.iter().enumerate();
    let mut pairs = pairs.flat_map(|(n, &a)| paths[n + 1..].iter().map(move |&b| [a, b]));
    pairs.find(|[a, b]| is_same_place(a, b))
}

/// May a file be written at `dest`? Its folder.
fn check_dest(dest: &Path, existing: Existing) -> Result<&Path, OutFileError> {
    if dest.is_dir() {
        return Err(OutFileError::IsFolder(dest.to_owned()));
    }
    if existing == Existing::Refuse && dest.symlink_metadata().is_ok() {
        return Err(OutFileError::Exists(dest.to_owned()));
    }
    let folder = folder_of(dest);
    if !folder.is_dir() {
        return Err(OutFileError::NoFolder {
            path: dest.to_owned(),
            folder: folder.to_owned(),
        });
    }
    Ok(folder)
}

fn rename_into_place(from: TempPath, dest: &Path, existing: Existing) -> Result<(), OutFileError> {
    let renamed = match existing {
        Existing::Replace => from.persist(dest),
        Existing::Refuse => from.persist_noclobber(dest),
    };
    renamed.map_err(|e| {
        if existing == Existing::Refuse && e.error.kind() == io::ErrorKind::AlreadyExists {
            OutFileError::Exists(dest.to_owned())
        } else {
            OutFileError::io(dest, "rename into place")(e.error)
        }
    })
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

/// Removes what every [`OutFile`] and [`PartialFolder`] that is not finished has on disk. For the thread that handles
/// signals, which must end the process next: from here on no output can be begun or finished, the attempt waits forever.
pub fn remove_unfinished() {
    let mut paths = unfinished();
    for path in std::mem::take(&mut *paths) {
        // Nothing can be done about a failure on the way out.
        let _ = if path.is_dir() {
            std::fs::remove_dir_all(path)
        } else {
            std::fs::remove_file(path)
        };
    }
    // Else a file begun now would be left behind.
    std::mem::forget(paths);
}

/// The temporary files and folders in being. A name left here after its file was dropped is harmless: it no longer exists.
fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    static PATHS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    PATHS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn one_place_has_many_names() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("there.png"), "").unwrap();
        for [a, b] in [["there.png", "./there.png"], ["new.png", "./new.png"]] {
            assert!(is_same_place(&path(a), &path(b)), "{a} and {b}");
        }
        for [a, b] in [["there.png", "new.png"], ["no/new.png", "new.png"]] {
            assert!(!is_same_place(&path(a), &path(b)), "{a} and {b}");
        }
        let [a, b, c] = ["x.png", "y.png", "./x.png"].map(path);
        assert_eq!(find_same(&[&a, &b, &c]), Some([&*a, &*c]));
        assert_eq!(find_same(&[&a, &b]), None);
    }

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
