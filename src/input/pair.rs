//! Volumes in two files of one name: `NAME.hdr` with the header, `NAME.img` with the voxels, each plain or gzip (`.gz`).
//! Only names are known here.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::contents::Contents;
use super::problem::Subject;
use crate::volume::SourceError;

/// Endings of the file of the voxels: plain ones, then gzip.
const IMAGE_ENDINGS: [[&str; 2]; 2] = [["img", "IMG"], ["img.gz", "IMG.GZ"]];

/// Endings of the file of the header: plain ones, then gzip.
const HEADER_ENDINGS: [[&str; 2]; 2] = [["hdr", "HDR"], ["hdr.gz", "HDR.GZ"]];

/// The file of the voxels that belongs to the header `subject`.
///
/// # Errors
/// The header's name does not end in `.hdr`, or there is no such file.
pub(super) fn image_of(subject: &Subject<'_>) -> Result<PathBuf, SourceError> {
    let subject = Subject {
        remedy: "put NAME.hdr and NAME.img into the same folder",
        ..*subject
    };
    let Some(base) = without_gz(subject.path, "hdr") else {
        return Err(subject.malformed(
            "the file's name",
            "NAME.hdr, since the header says that the voxels are in NAME.img",
            subject.name(),
        ));
    };
    partner(subject.path, &base, IMAGE_ENDINGS).ok_or_else(|| {
        let image = base.with_extension("img");
        subject.malformed(
            "the file of the voxels",
            format!("{} or the same with .gz", image.display()),
            "neither",
        )
    })
}

/// Opens the file of the voxels, whether it is gzip or not.
pub(super) fn open<'a>(image: &Subject<'a>) -> Result<Contents<'a>, SourceError> {
    let (file, _) = image.open()?;
    let mut first = Vec::new();
    file.take(2)
        .read_to_end(&mut first)
        .map_err(|e| image.io("read", e))?;
    // Voxels may look like gzip by chance; a name that says so, too, makes it sure.
    Contents::open(image, ends_in(image.path, "gz") && first == [0x1f, 0x8b])
}

/// True when `path` is named like the file of the voxels of a pair.
pub(super) fn is_image(path: &Path) -> bool {
    without_gz(path, "img").is_some()
}

/// The file of the header that belongs to the file of voxels `path`, if it is named like one and there is such a file.
pub(super) fn header_of(path: &Path) -> Option<PathBuf> {
    partner(path, &without_gz(path, "img")?, HEADER_ENDINGS)
}

/// `path` without `.gz`, if it then ends in `ending`.
fn without_gz(path: &Path, ending: &str) -> Option<PathBuf> {
    let path = if ends_in(path, "gz") {
        path.with_extension("")
    } else {
        path.to_owned()
    };
    ends_in(&path, ending).then_some(path)
}

fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(ending))
}

/// The file called as `base`, but ending in one of `endings`. That which is gzip or plain as `given` goes before.
fn partner(given: &Path, base: &Path, endings: [[&str; 2]; 2]) -> Option<PathBuf> {
    let [plain, gzip] = endings;
    let order = if ends_in(given, "gz") {
        [gzip, plain]
    } else {
        [plain, gzip]
    };
    order
        .as_flattened()
        .iter()
        .map(|ending| base.with_extension(ending))
        .find(|p| p.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partners_are_found_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in [
            "a.b.hdr", "a.b.img", "c.HDR", "c.IMG", "d.hdr.gz", "d.img.gz", "e.hdr",
        ] {
            std::fs::write(at(name), "").unwrap();
        }
        for (header, image) in [
            ("a.b.hdr", "a.b.img"),
            ("c.HDR", "c.IMG"),
            ("d.hdr.gz", "d.img.gz"),
        ] {
            let (header, image) = (at(header), at(image));
            assert_eq!(image_of(&Subject::new(&header)).unwrap(), image, "image");
            assert_eq!(header_of(&image), Some(header), "header");
        }
        let error = image_of(&Subject::new(&at("e.hdr")))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("e.img") && error.contains("neither"),
            "{error}"
        );
        let error = image_of(&Subject::new(&at("e.nii")))
            .unwrap_err()
            .to_string();
        assert!(error.contains("NAME.hdr"), "{error}");
        assert_eq!(header_of(&at("f.img")), None, "no header");
        assert_eq!(header_of(&at("e.hdr")), None, "no image");
    }
}
