//! [`open`]: from what a user typed to a source. The format is found by content; names only help to word errors.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use super::problem::Subject;
use super::raw::{self, RawParams};
use super::{metaimage, nifti, nrrd, phantom};
use crate::volume::{SourceError, VoxelSource};

const BUILT: &str = "supported are NIfTI (.nii, .nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), .raw with \
                     --dims and --type, and phantom:NAME:X,Y,Z[:TYPE]";

/// Bytes of a file that are looked at to tell its format.
const PEEK_BYTES: u64 = 4096;
/// Entries of a folder that are looked at to tell what it holds.
const PEEK_ENTRIES: usize = 64;

/// What a file holds, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Nifti {
        compressed: bool,
    },
    Nrrd,
    MetaImage,
    /// Known by name, not built.
    Other(&'static str),
}

/// Opens the volume that `spec` names: a file, or `phantom:NAME:X,Y,Z[:TYPE]`. `raw` says what a headerless file holds.
///
/// # Errors
/// The file can't be read, is of no known format or of one that is not built, is damaged, or `raw` is given for a source
/// that describes itself.
pub fn open(spec: &str, raw: Option<RawParams>) -> Result<Box<dyn VoxelSource>, SourceError> {
    let path = Path::new(spec);
    let subject = Subject {
        path,
        remedy: BUILT,
    };
    if spec.starts_with("phantom:") {
        return match raw {
            None => Ok(Box::new(phantom::Phantom::from_spec(spec)?)),
            Some(_) => Err(raw_not_wanted(path, "a phantom")),
        };
    }
    let Some(first) = first_bytes(&subject, spec)? else {
        return Err(folder(&subject));
    };
    let format = format(&first);
    if let Some(params) = raw {
        // Voxels may look like any header by chance; only a name that says the same makes it a mistake.
        let named_raw = path
            .extension()
            .is_none_or(|e| e.eq_ignore_ascii_case("raw"));
        return match format {
            Some(f) if !named_raw => Err(raw_not_wanted(path, f.name())),
            _ => Ok(Box::new(raw::open(path, &params)?)),
        };
    }
    match format {
        Some(Format::Nifti { compressed }) => Ok(Box::new(nifti::open(path, compressed)?)),
        Some(Format::Nrrd) => Ok(Box::new(nrrd::open(path)?)),
        Some(Format::MetaImage) => Ok(Box::new(metaimage::open(path)?)),
        Some(Format::Other(name)) => Err(subject.unsupported(name, BUILT)),
        None => {
            let shown = &first[..first.len().min(8)];
            let subject = Subject {
                remedy: "if these are bare voxels, say what they are with --dims and --type",
                ..subject
            };
            Err(subject.malformed(
                "the first bytes",
                format!("a format that is known ({BUILT})"),
                format!("bytes {shown:02x?}"),
            ))
        }
    }
}

impl Format {
    const fn name(self) -> &'static str {
        match self {
            Self::Nifti { .. } => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Other(name) => name,
        }
    }
}

fn raw_not_wanted(path: &Path, what: &str) -> SourceError {
    let subject = Subject {
        path,
        remedy: "leave out --dims, --type, --endian, --spacing and --offset",
    };
    subject.malformed("the options for .raw", "a file of bare voxels", what)
}

/// The file's first bytes; `None` for a folder.
fn first_bytes(subject: &Subject<'_>, spec: &str) -> Result<Option<Vec<u8>>, SourceError> {
    let meta = match std::fs::metadata(subject.path) {
        Ok(meta) => meta,
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            if spec.starts_with("http://") || spec.starts_with("https://") {
                return Err(subject.unsupported("a volume behind a URL", BUILT));
            }
            if spec.contains(['*', '?']) {
                return Err(subject.unsupported("a glob of slices", BUILT));
            }
            return Err(subject.io("open", e));
        }
        Err(e) => return Err(subject.io("open", e)),
    };
    if meta.is_dir() {
        return Ok(None);
    }
    if !meta.is_file() {
        return Err(subject.malformed("the path", "a regular file", "a device or a pipe"));
    }
    let mut first = Vec::new();
    File::open(subject.path)
        .and_then(|f| f.take(PEEK_BYTES).read_to_end(&mut first))
        .map_err(|e| subject.io("open", e))?;
    if first.is_empty() {
        return Err(subject.malformed("the file", "a volume", "an empty file"));
    }
    Ok(Some(first))
}

/// The format of a file that begins with `bytes`.
fn format(bytes: &[u8]) -> Option<Format> {
    if nifti::is_header(bytes) {
        return Some(Format::Nifti { compressed: false });
    }
    if nrrd::is_header(bytes) {
        return Some(Format::Nrrd);
    }
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut inner = [0; 4];
        let is_nifti = flate2::bufread::GzDecoder::new(bytes)
            .read_exact(&mut inner)
            .is_ok()
            && nifti::is_header(&inner);
        return Some(if is_nifti {
            Format::Nifti { compressed: true }
        } else {
            Format::Other("gzip of something other than NIfTI")
        });
    }
    if metaimage::is_header(bytes) {
        return Some(Format::MetaImage);
    }
    let tiff = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];
    if tiff.iter().any(|magic| bytes.starts_with(*magic)) {
        return Some(Format::Other("TIFF"));
    }
    if bytes.get(128..132) == Some(b"DICM") {
        return Some(Format::Other("DICOM"));
    }
    if bytes.starts_with(b"\x89HDF\r\n\x1a\n") {
        return Some(Format::Other("HDF5"));
    }
    let text = String::from_utf8_lossy(bytes);
    if text.contains("<VTKFile") {
        return Some(Format::Other("VTK XML (.vti)"));
    }
    text.starts_with("# vtk DataFile")
        .then_some(Format::Other("VTK legacy"))
}

/// The error for a folder, naming what it seems to hold.
fn folder(subject: &Subject<'_>) -> SourceError {
    for mark in ["zarr.json", ".zattrs", ".zgroup", ".zarray"] {
        if subject.path.join(mark).exists() {
            return subject.unsupported("an OME-Zarr folder", BUILT);
        }
    }
    let entries = match std::fs::read_dir(subject.path) {
        Ok(entries) => entries,
        Err(e) => return subject.io("list the folder", e),
    };
    let mut found = "a folder without volumes";
    for entry in entries.flatten().take(PEEK_ENTRIES) {
        let mut first = Vec::new();
        let read =
            File::open(entry.path()).and_then(|f| f.take(PEEK_BYTES).read_to_end(&mut first));
        if read.is_err() {
            continue;
        }
        let named_dicom = entry
            .path()
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("dcm"));
        match format(&first) {
            Some(Format::Other("DICOM")) => {
                return subject.unsupported("a folder of DICOM slices", BUILT);
            }
            _ if named_dicom => return subject.unsupported("a folder of DICOM slices", BUILT),
            Some(Format::Other("TIFF")) => {
                return subject.unsupported("a folder of TIFF slices", BUILT);
            }
            Some(_) => found = "a folder; name the file in it",
            None => {}
        }
    }
    subject.malformed("the path", "the file of a volume", found)
}

#[cfg(test)]
mod tests;
