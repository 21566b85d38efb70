//! DICOMDIR: the table of contents of a medium, which names its files (PS3.3 F, PS3.10 8).

use std::path::PathBuf;

use dicom_core::Tag;

use super::super::problem::Subject;
use super::dataset::DataSet;
use crate::volume::SourceError;

const DIRECTORY_RECORDS: Tag = Tag(0x0004, 0x1220);
const FILE_ID: Tag = Tag(0x0004, 0x1500);
const RECORD_TYPE: Tag = Tag(0x0004, 0x1430);

/// The picture files that a DICOMDIR names; `None` for a file that is none.
///
/// # Errors
/// It can't be read, or names no picture, or one that is not there or outside of its folder.
pub(in super::super) fn files_of(
    subject: &Subject<'_>,
) -> Result<Option<Vec<PathBuf>>, SourceError> {
    let set = DataSet::read(subject)?;
    let records = set.item.items(DIRECTORY_RECORDS);
    if records.is_empty() {
        return Ok(None);
    }
    let folder = subject.path.parent().unwrap_or_else(|| "".as_ref());
    let mut files = Vec::new();
    for record in records {
        if record.text(RECORD_TYPE).as_deref() != Some("IMAGE") {
            continue;
        }
        let parts = record.texts(FILE_ID);
        let is_sound = |p: &String| !p.is_empty() && p != ".." && !p.contains(['/', '\\']);
        if parts.is_empty() || !parts.iter().all(is_sound) {
            return Err(subject.malformed(
                "ReferencedFileID",
                "names of folders and a file",
                format!("{parts:?}"),
            ));
        }
        let mut path = folder.to_owned();
        path.extend(&parts);
        // Media were written in capitals; what was copied from them often is not.
        if !path.exists() {
            let lower: PathBuf = parts.iter().map(|p| p.to_lowercase()).collect();
            path = folder.join(lower);
        }
        if !path.is_file() {
            return Err(subject.malformed(
                "ReferencedFileID",
                "a file that is there",
                parts.join("/"),
            ));
        }
        files.push(path);
    }
    if files.is_empty() {
        return Err(subject.malformed("the directory", "records of pictures", "none"));
    }
    Ok(Some(files))
}
