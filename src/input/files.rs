//! Which files a name stands for: itself, the files of a folder, those of a glob. Names with numbers come in the order of these.

use std::cmp::Ordering;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::problem::Subject;
use crate::volume::SourceError;

/// Bytes of a file that are looked at to tell its format.
const PEEK_BYTES: u64 = 4096;

/// Files that one volume has at most.
pub(super) const MOST_FILES: usize = 1 << 20;

/// Folders in folders.
const MOST_DEPTH: u32 = 8;

/// The first bytes of a file; empty where it can't be read.
pub(super) fn first_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut first = Vec::new();
    File::open(path)?.take(PEEK_BYTES).read_to_end(&mut first)?;
    Ok(first)
}

/// The files that lie in a folder, hidden ones apart, in natural order.
///
/// # Errors
/// The folder can't be read, or holds more than a volume can have.
pub(super) fn in_folder(subject: &Subject<'_>) -> Result<Vec<PathBuf>, SourceError> {
    let failed = |e| subject.io("list the folder", e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(subject.path).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let is_hidden = entry.file_name().as_encoded_bytes().first() == Some(&b'.');
        // Through links: a folder of links to slices is a folder of slices.
        if !is_hidden && entry.path().is_file() {
            files.push(entry.path());
            check_number(subject, files.len())?;
        }
    }
    files.sort_by(|a, b| natural(a, b));
    Ok(files)
}

/// The files that a glob matches, in natural order.
///
/// # Errors
/// It is no glob, matches no file, or more than a volume can have.
pub(super) fn of_glob(subject: &Subject<'_>, pattern: &str) -> Result<Vec<PathBuf>, SourceError> {
    let paths = glob::glob(pattern)
        .map_err(|e| subject.malformed("the glob", "a pattern of *, ? and [...]", e.to_string()))?;
    let mut files = Vec::new();
    for path in paths {
        let path = path.map_err(|e| {
            let error = io::Error::new(e.error().kind(), e.to_string());
            subject.io("list what it matches", error)
        })?;
        if path.is_file() {
            files.push(path);
            check_number(subject, files.len())?;
        }
    }
    if files.is_empty() {
        return Err(subject.malformed("the glob", "files that it matches", "none"));
    }
    files.sort_by(|a, b| natural(a, b));
    Ok(files)
}

/// The files of a folder and of the folders in it, each folder's in natural order, hidden ones apart.
///
/// # Errors
/// As [`in_folder`]; or folders lie too deep in each other.
pub(super) fn below(subject: &Subject<'_>) -> Result<Vec<PathBuf>, SourceError> {
    let failed = |e| subject.io("list the folder", e);
    let mut files = Vec::new();
    let mut folders = vec![(subject.path.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        files.extend(in_folder(&Subject {
            path: &folder,
            ..*subject
        })?);
        check_number(subject, files.len())?;
        let mut inner = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let is_hidden = entry.file_name().as_encoded_bytes().first() == Some(&b'.');
            // Not through links: these may lead back.
            if !is_hidden && entry.file_type().map_err(failed)?.is_dir() {
                inner.push((entry.path(), depth + 1));
            }
        }
        if depth < MOST_DEPTH {
            inner.sort_by(|a, b| natural(&b.0, &a.0));
            folders.extend(inner);
        }
    }
    Ok(files)
}

fn check_number(subject: &Subject<'_>, files: usize) -> Result<(), SourceError> {
    if files <= MOST_FILES {
        return Ok(());
    }
    Err(subject.malformed(
        "the number of files",
        format!("at most {MOST_FILES}"),
        "more",
    ))
}

/// Names in the order of the numbers in them: slice-9 before slice-10. Equal ones by their bytes.
pub(super) fn natural(a: &Path, b: &Path) -> Ordering {
    let (a_text, b_text) = (a.to_string_lossy(), b.to_string_lossy());
    natural_text(&a_text, &b_text).then_with(|| a.cmp(b))
}

fn natural_text(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a.as_bytes(), b.as_bytes());
    loop {
        let (Some(&x), Some(&y)) = (a.first(), b.first()) else {
            return a.len().cmp(&b.len());
        };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let (m, rest_a) = number(a);
            let (n, rest_b) = number(b);
            // Without leading zeros the longer one is the greater one, however long they are.
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
            if order != Ordering::Equal {
                return order;
            }
            (a, b) = (rest_a, rest_b);
        } else if x != y {
            return x.cmp(&y);
        } else {
            (a, b) = (&a[1..], &b[1..]);
        }
    }
}

/// The digits at the beginning, without leading zeros, and what follows.
fn number(text: &[u8]) -> (&[u8], &[u8]) {
    let digits = text.iter().take_while(|c| c.is_ascii_digit()).count();
    let (number, rest) = text.split_at(digits);
    let zeros = number.iter().take_while(|&&c| c == b'0').count();
    (&number[zeros..], rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_in_the_order_of_their_numbers() {
        let mut names = [
            "s10.tif",
            "s9.tif",
            "s009b.tif",
            "s1.tif",
            "t.tif",
            "s",
            "s99999999999999999999999.tif",
        ]
        .map(PathBuf::from);
        names.sort_by(|a, b| natural(a, b));
        let sorted = names.map(|n| n.to_string_lossy().into_owned());
        assert_eq!(
            sorted,
            [
                "s",
                "s1.tif",
                "s9.tif",
                "s009b.tif",
                "s10.tif",
                "s99999999999999999999999.tif",
                "t.tif"
            ]
        );
    }

    #[test]
    fn folders_and_globs_name_their_files() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b10", "b9", ".hidden", "a1"] {
            std::fs::write(dir.path().join(name), "x").unwrap();
        }
        std::fs::create_dir(dir.path().join("b1")).unwrap();
        let names = |files: Vec<PathBuf>| -> Vec<String> {
            let name = |f: &PathBuf| f.file_name().unwrap().to_string_lossy().into_owned();
            files.iter().map(name).collect()
        };
        let subject = Subject::new(dir.path());
        assert_eq!(names(in_folder(&subject).unwrap()), ["a1", "b9", "b10"]);
        let pattern = format!("{}/b*", dir.path().display());
        assert_eq!(names(of_glob(&subject, &pattern).unwrap()), ["b9", "b10"]);
        let none = format!("{}/c*", dir.path().display());
        assert!(of_glob(&subject, &none).is_err());
    }
}
