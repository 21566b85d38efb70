//! The unfinished parts of a long run, under a name that the next process can find again.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempPath;
use xxhash_rust::xxh3::xxh3_64;

use super::{Existing, OutFileError, check_dest, folder_of, rename_into_place, unfinished};

/// Held locked by the process that writes. The system lets go of it however that process ends.
const LOCK: &str = "lock";
/// A longer name of the destination stands as its hash, so that the folder's name is not too long for the system.
const LONGEST_NAME: usize = 200;

/// A hidden folder beside the destination with the files of a run: `.NAME.brickscope-partial`.
///
/// One process at a time has it. When it is dropped, or the process is interrupted ([`super::remove_unfinished`]), the
/// folder is removed with all that is in it, unless [`Self::preserve`] was called; a killed process leaves it.
#[derive(Debug)]
pub struct PartialFolder {
    path: PathBuf,
    dest: PathBuf,
    existing: Existing,
    lock: Option<File>,
    preserved: bool,
}

impl PartialFolder {
    /// Where the unfinished parts of `dest` are, whether there are any or not.
    pub fn path_for(dest: &Path) -> PathBuf {
        let name = dest.file_name().unwrap_or(OsStr::new("out"));
        let mut hidden = OsString::from(".");
        if name.len() <= LONGEST_NAME {
            hidden.push(name);
        } else {
            hidden.push(format!("{:016x}", xxh3_64(name.as_encoded_bytes())));
        }
        hidden.push(".brickscope-partial");
        folder_of(dest).join(hidden)
    }

    /// An empty folder; what an earlier run left in it is removed.
    ///
    /// # Errors
    /// `dest` is a folder, its folder is missing or can't be written, it exists and may not be replaced, or another
    /// process is writing it.
    pub fn create(dest: &Path, existing: Existing) -> Result<Self, OutFileError> {
        check_dest(dest, existing)?;
        let path = Self::path_for(dest);
        // Held until all is there: `remove_unfinished` sees all or nothing of it.
        let mut unfinished = unfinished();
        let failed = "make the folder of its unfinished parts";
        if !is_real_folder(&path) {
            fs::create_dir(&path).map_err(OutFileError::io(dest, failed))?;
        }
        let folder = Self::lock(path, dest, existing)?;
        unfinished.insert(folder.path.clone());
        drop(unfinished);
        for entry in fs::read_dir(&folder.path)
            .map_err(OutFileError::io(dest, failed))?
            .flatten()
            .filter(|e| e.file_name() != LOCK)
        {
            fs::remove_file(entry.path()).map_err(OutFileError::io(
                dest,
                "remove the unfinished parts of an earlier run",
            ))?;
        }
        Ok(folder)
    }

    /// The folder that a killed process left, preserved; `None` when there is none.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn reopen(dest: &Path, existing: Existing) -> Result<Option<Self>, OutFileError> {
        check_dest(dest, existing)?;
        let path = Self::path_for(dest);
        if !is_real_folder(&path) {
            return Ok(None);
        }
        let mut folder = Self::lock(path, dest, existing)?;
        folder.preserved = true;
        Ok(Some(folder))
    }

    fn lock(path: PathBuf, dest: &Path, existing: Existing) -> Result<Self, OutFileError> {
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path.join(LOCK))
            .map_err(OutFileError::io(dest, "lock its unfinished parts"))?;
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(OutFileError::Busy {
                dest: dest.to_owned(),
                folder: path,
            });
        }
        // A file system that knows no locks is no reason not to write to it.
        Ok(Self {
            path,
            dest: dest.to_owned(),
            existing,
            lock: Some(lock),
            preserved: false,
        })
    }

    /// From now on the folder stays when this is dropped or the process is interrupted.
    pub fn preserve(&mut self) {
        unfinished().remove(&self.path);
        self.preserved = true;
    }

    /// From now on the folder goes when this is dropped or the process is interrupted.
    pub fn own(&mut self) {
        unfinished().insert(self.path.clone());
        self.preserved = false;
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The name the finished file will have.
    pub fn dest(&self) -> &Path {
        &self.dest
    }

    /// A new file in the folder, empty, for reading and writing.
    ///
    /// # Errors
    /// The system refused.
    pub fn create_file(&self, name: &str) -> Result<File, OutFileError> {
        let _unfinished = unfinished();
        File::options()
            .create(true)
            .truncate(true)
            .read(true)
            .write(true)
            .open(self.path.join(name))
            .map_err(OutFileError::io(
                &self.dest,
                "create a scratch file in its folder",
            ))
    }

    /// A file that is in the folder already, for reading and writing.
    ///
    /// # Errors
    /// The system refused, or it is not there.
    pub fn open_file(&self, name: &str) -> io::Result<File> {
        File::options()
            .read(true)
            .write(true)
            .open(self.path.join(name))
    }

    /// Syncs `file`, which is called `name` in the folder, to disk, makes it the destination, and removes the folder.
    ///
    /// # Errors
    /// The disk is full, the rename fails, or the destination came into being meanwhile and may not be replaced. The
    /// folder is then removed, too.
    pub fn commit(self, name: &str, file: File) -> Result<(), OutFileError> {
        file.sync_all()
            .map_err(OutFileError::io(&self.dest, "sync"))?;
        drop(file);
        let from = TempPath::try_from_path(self.path.join(name))
            .map_err(OutFileError::io(&self.dest, "rename into place"))?;
        rename_into_place(from, &self.dest, self.existing)
        // Dropping `self` removes the rest.
    }
}

impl Drop for PartialFolder {
    fn drop(&mut self) {
        // Some systems don't remove a file that is open.
        self.lock = None;
        if !self.preserved {
            // Nobody is left to tell of a failure; the next run to the same destination clears the folder.
            let _ = fs::remove_dir_all(&self.path);
            unfinished().remove(&self.path);
        }
    }
}

/// A folder, and not a link to one: nothing is written or removed elsewhere.
fn is_real_folder(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|m| m.is_dir())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn goes_unless_preserved_and_is_found_again() {
        let dir = tempfile::tempdir().unwrap();
        let dest = dir.path().join("a.bin");
        let at = PartialFolder::path_for(&dest);
        let folder = PartialFolder::create(&dest, Existing::Refuse).unwrap();
        folder.create_file("part").unwrap().write_all(b"x").unwrap();
        assert!(
            matches!(
                PartialFolder::reopen(&dest, Existing::Refuse),
                Err(OutFileError::Busy { .. })
            ),
            "one process at a time"
        );
        drop(folder);
        assert!(!at.exists(), "a dropped one leaves nothing behind");
        assert!(
            PartialFolder::reopen(&dest, Existing::Refuse)
                .unwrap()
                .is_none(),
            "nothing to go on with"
        );

        let mut folder = PartialFolder::create(&dest, Existing::Refuse).unwrap();
        folder.create_file("part").unwrap().write_all(b"x").unwrap();
        folder.preserve();
        drop(folder);
        let mut again = PartialFolder::reopen(&dest, Existing::Refuse)
            .unwrap()
            .expect("what was left is found");
        assert!(again.open_file("part").is_ok(), "with its files");
        again.own();
        let part = again.open_file("part").unwrap();
        again.commit("part", part).unwrap();
        assert_eq!(fs::read(&dest).unwrap(), b"x", "complete after commit");
        assert_eq!(
            fs::read_dir(dir.path()).unwrap().count(),
            1,
            "nothing else is left"
        );
    }

    #[test]
    fn a_new_run_starts_empty_and_an_existing_file_stays() {
        let dir = tempfile::tempdir().unwrap();
        let dest = dir.path().join("a.bin");
        let mut left = PartialFolder::create(&dest, Existing::Refuse).unwrap();
        left.create_file("part").unwrap();
        left.preserve();
        drop(left);
        let folder = PartialFolder::create(&dest, Existing::Refuse).unwrap();
        assert!(folder.open_file("part").is_err(), "the old part is gone");
        let file = folder.create_file("new").unwrap();
        fs::write(&dest, b"there first").unwrap();
        assert!(
            matches!(
                folder.commit("new", file),
                Err(OutFileError::Exists(path)) if path == dest
            ),
            "not overwritten"
        );
        assert_eq!(fs::read(&dest).unwrap(), b"there first", "as it was");
        assert!(!PartialFolder::path_for(&dest).exists(), "nothing is left");
        let long = dir.path().join("n".repeat(255));
        PartialFolder::create(&long, Existing::Refuse).expect("a name as long as names can be");
    }
}
