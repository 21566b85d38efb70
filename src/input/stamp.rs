//! What tells files from a later state of them: lengths and times of the last change, in words.

use std::hash::Hasher;
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use xxhash_rust::xxh3::Xxh3Default;

/// The state of one file.
pub(super) fn of_file(path: &Path) -> String {
    state(path).map_or_else(
        || "gone".to_owned(),
        |(bytes, changed)| {
            format!(
                "{bytes} bytes, changed at {}.{:09} (Unix time)",
                changed.as_secs(),
                changed.subsec_nanos(),
            )
        },
    )
}

/// The state of several files in their order: how many they are, and a hash of their names, lengths and times.
pub(super) fn of_files(files: &[PathBuf]) -> String {
    let mut hash = Xxh3Default::new();
    for path in files {
        hash.write(path.as_os_str().as_encoded_bytes());
        let (bytes, changed) = state(path).unwrap_or_default();
        hash.write_u64(bytes);
        hash.write_u64(changed.as_secs());
        hash.write_u32(changed.subsec_nanos());
    }
    format!("{} files in the state {:016x}", files.len(), hash.finish())
}

/// Length and time of the last change, `None` for a file that is gone.
fn state(path: &Path) -> Option<(u64, Duration)> {
    let info = std::fs::metadata(path).ok()?;
    let changed = info
        .modified()
        .ok()
        .and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    Some((info.len(), changed.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_file_changes_the_stamp() {
        let dir = tempfile::tempdir().unwrap();
        let files = ["a", "b"].map(|name| dir.path().join(name));
        for file in &files {
            std::fs::write(file, "12").unwrap();
        }
        let before = (of_file(&files[1]), of_files(&files));
        assert_eq!(before, (of_file(&files[1]), of_files(&files)), "same state");
        std::fs::write(&files[1], "123").unwrap();
        assert_ne!(before.0, of_file(&files[1]), "one file");
        assert_ne!(before.1, of_files(&files), "several files");
        std::fs::remove_file(&files[1]).unwrap();
        assert_eq!(of_file(&files[1]), "gone", "no file");
    }
}
