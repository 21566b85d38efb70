//! A folder of files that appears only when it is complete.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::{Existing, OutFileError, folder_of, unfinished};

/// A folder being written under a temporary name beside its destination. Dropping it unfinished removes it; so does
/// [`super::remove_unfinished`].
#[derive(Debug)]
pub struct OutFolder {
    temp: Option<TempDir>,
    dest: PathBuf,
    existing: Existing,
    mark: &'static str,
}

impl OutFolder {
    /// Starts a folder that will become `dest`. A folder that is there already is replaced only if it has a file called
    /// `mark`, as all have that are written so: no other folder is ever removed.
    ///
    /// # Errors
    /// `dest` is a file or a folder of something else, its folder is missing or can't be written, or it exists and may not be
    /// replaced.
    pub fn create(
        dest: &Path,
        existing: Existing,
        mark: &'static str,
    ) -> Result<Self, OutFileError> {
        check(dest, existing, mark)?;
        let around = folder_of(dest);
        if !around.is_dir() {
            return Err(OutFileError::NoFolder {
                path: dest.to_owned(),
                folder: around.to_owned(),
            });
        }
        let mut unfinished = unfinished();
        let temp = tempfile::Builder::new()
            .prefix(".brickscope-")
            .suffix(".partial")
            .tempdir_in(around)
            .map_err(OutFileError::io(dest, "make a folder beside it"))?;
        unfinished.insert(temp.path().to_owned());
        drop(unfinished);
        #[cfg(unix)]
        open_to_others(temp.path(), dest)?;
        Ok(Self {
            temp: Some(temp),
            dest: dest.to_owned(),
            existing,
            mark,
        })
    }

    /// Where it is until then.
    pub fn path(&self) -> &Path {
        self.temp.as_ref().map_or(&self.dest, |t| t.path())
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// The rename fails, or something came into being there meanwhile; the temporary folder is then removed.
    pub fn commit(mut self) -> Result<(), OutFileError> {
        check(&self.dest, self.existing, self.mark)?;
        let failed = OutFileError::io(&self.dest, "rename into place");
        let Some(temp) = self.temp.take() else {
            return Ok(());
        };
        // Taken out first: from here on what has that name is not unfinished.
        unfinished().remove(temp.path());
        let mut before = None;
        if self.dest.is_dir() {
            let aside = tempfile::Builder::new()
                .prefix(".brickscope-")
                .suffix(".replaced")
                .tempdir_in(folder_of(&self.dest))
                .map_err(OutFileError::io(&self.dest, "make a folder beside it"))?;
            fs::rename(&self.dest, aside.path().join("before"))
                .map_err(OutFileError::io(&self.dest, "move the one that is there"))?;
            before = Some(aside);
        }
        match fs::rename(temp.path(), &self.dest) {
            Ok(()) => {
                let _ = temp.keep();
                Ok(())
            }
            Err(error) => {
                if let Some(aside) = before {
                    // What was there comes back; where even that fails it stays beside.
                    let aside = aside.keep();
                    let _ = fs::rename(aside.join("before"), &self.dest);
                    let _ = fs::remove_dir(&aside);
                }
                Err(failed(error))
            }
        }
    }
}

impl Drop for OutFolder {
    fn drop(&mut self) {
        if let Some(temp) = self.temp.take() {
            let path = temp.path().to_owned();
            drop(temp);
            unfinished().remove(&path);
        }
    }
}

fn check(dest: &Path, existing: Existing, mark: &'static str) -> Result<(), OutFileError> {
    if dest.symlink_metadata().is_err() {
        return Ok(());
    }
    if existing == Existing::Refuse {
        return Err(OutFileError::Exists(dest.to_owned()));
    }
    match dest.is_dir() && dest.join(mark).is_file() {
        true => Ok(()),
        false => Err(OutFileError::Other {
            path: dest.to_owned(),
            mark,
        }),
    }
}

/// The permissions of a folder that was made the usual way: temporary ones are their owner's alone.
#[cfg(unix)]
fn open_to_others(path: &Path, dest: &Path) -> Result<(), OutFileError> {
    let failed = |doing| OutFileError::io(dest, doing);
    let inner = path.join("permissions");
    fs::create_dir(&inner).map_err(failed("make a folder beside it"))?;
    let usual = fs::metadata(&inner).map(|m| m.permissions());
    fs::remove_dir(&inner).map_err(failed("make a folder beside it"))?;
    let usual = usual.map_err(failed("read permissions"))?;
    fs::set_permissions(path, usual).map_err(failed("set permissions"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn appears_when_committed_and_replaces_only_its_kind() {
        let dir = tempfile::tempdir().unwrap();
        let dest = dir.path().join("a.zarr");
        let make = |text: &str| {
            let folder = OutFolder::create(&dest, Existing::Replace, "mark.json")?;
            fs::create_dir(folder.path().join("in")).unwrap();
            fs::write(folder.path().join("mark.json"), text).unwrap();
            assert_ne!(folder.path(), dest);
            Ok::<_, OutFileError>(folder)
        };
        drop(make("dropped").unwrap());
        assert_eq!(
            fs::read_dir(dir.path()).unwrap().count(),
            0,
            "nothing is left behind"
        );
        for text in ["first", "second"] {
            make(text).unwrap().commit().unwrap();
            assert_eq!(fs::read_to_string(dest.join("mark.json")).unwrap(), text);
            assert_eq!(
                fs::read_dir(dir.path()).unwrap().count(),
                1,
                "nothing beside it"
            );
        }
        let refused = OutFolder::create(&dest, Existing::Refuse, "mark.json");
        assert!(matches!(refused, Err(OutFileError::Exists(_))));
        fs::remove_file(dest.join("mark.json")).unwrap();
        assert!(
            matches!(make("third"), Err(OutFileError::Other { .. })),
            "of something else"
        );
        assert!(dest.join("in").is_dir(), "which stays");
    }
}
