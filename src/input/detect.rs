//! [`open`]: from what a user typed to a source. The format is found by content; names only help to word errors.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::files::{self, first_bytes};
use super::options::OpenOptions;
use super::problem::Subject;
use super::{metaimage, nifti, nrrd, phantom, pyramid, raw};
use crate::volume::{SourceError, VoxelSource};

const BUILT: &str = "supported are NIfTI (.nii, .nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), .raw with \
                     --dims and --type, folders and URLs of OME-Zarr, N5 and Neuroglancer precomputed, and phantom:NAME:X,Y,Z[:TYPE]";

/// Files of a folder that are looked at to tell what it holds.
const PEEK_FILES: usize = 64;

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

/// Opens the volume that `spec` names: a file, a folder or a glob of slices, or `phantom:NAME:X,Y,Z[:TYPE]`.
///
/// # Errors
/// It can't be read, is of no known format or of one that is not built, is damaged, or `options` do not go with it.
pub fn open(spec: &str, options: &OpenOptions) -> Result<Box<dyn VoxelSource>, SourceError> {
    let path = Path::new(spec);
    let subject = Subject {
        path,
        remedy: BUILT,
    };
    if spec.starts_with("phantom:") {
        return match options.raw {
            None => Ok(Box::new(phantom::Phantom::from_spec(spec)?)),
            Some(_) => Err(raw_not_wanted(path, "a phantom")),
        };
    }
    if pyramid::is_url(spec) {
        return open_url(&subject, spec, options);
    }
    if path.is_dir() {
        return open_folder(&subject, options);
    }
    if spec.contains(['*', '?', '[']) && !path.exists() {
        let files = files::of_glob(&subject, spec)?;
        return open_slices(&subject, files, options);
    }
    open_file(&subject, options)
}

/// Opens a file that is a volume by itself.
fn open_file(
    subject: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let path = subject.path;
    let meta = std::fs::metadata(path).map_err(|e| subject.io("open", e))?;
    if !meta.is_file() {
        return Err(subject.malformed("the path", "a regular file", "a device or a pipe"));
    }
    let first = first_bytes(path).map_err(|e| subject.io("open", e))?;
    if first.is_empty() {
        return Err(subject.malformed("the file", "a volume", "an empty file"));
    }
    let format = format(&first);
    if let Some(params) = &options.raw {
        // Voxels may look like any header by chance; only a name that says the same makes it a mistake.
        let named_raw = path
            .extension()
            .is_none_or(|e| e.eq_ignore_ascii_case("raw"));
        return match format {
            Some(f) if !named_raw => Err(raw_not_wanted(path, f.name())),
            _ => Ok(Box::new(raw::open(path, params)?)),
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
                ..*subject
            };
            Err(subject.malformed(
                "the first bytes",
                format!("a format that is known ({BUILT})"),
                format!("bytes {shown:02x?}"),
            ))
        }
    }
}

/// Opens a folder: a volume in a format that is one, or slices.
fn open_folder(
    subject: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    if let Some(location) = subject.path.to_str()
        && let Some(kind) = pyramid::Kind::of(location, options)?
    {
        return match options.raw {
            None => kind.open(location, options, 0),
            Some(_) => Err(raw_not_wanted(subject.path, "a folder of chunks")),
        };
    }
    let files = files::in_folder(subject)?;
    if files.is_empty() {
        return Err(subject.malformed(
            "the path",
            "the file of a volume",
            "a folder without files",
        ));
    }
    open_slices(subject, files, options)
}

/// Opens what lies behind a URL.
fn open_url(
    subject: &Subject<'_>,
    url: &str,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    if options.raw.is_some() {
        return Err(raw_not_wanted(subject.path, "a URL"));
    }
    match pyramid::Kind::of(url, options)? {
        Some(kind) => kind.open(url, options, 0),
        None => Err(subject.malformed(
            "the URL",
            "a folder of OME-Zarr, N5 or Neuroglancer precomputed",
            "no metadata of any of them",
        )),
    }
}

/// Opens several files that are the slices of a volume, in their order. `subject` is what they were named by.
fn open_slices(
    subject: &Subject<'_>,
    files: Vec<PathBuf>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    if options.raw.is_some() {
        return Err(raw_not_wanted(subject.path, "several files"));
    }
    let mut found = "files that are no slices; name the file of a volume";
    for file in files.iter().take(PEEK_FILES) {
        let Ok(first) = first_bytes(file) else {
            continue;
        };
        match format(&first) {
            Some(Format::Other("DICOM")) => {
                return Err(subject.unsupported("a folder of DICOM slices", BUILT));
            }
            Some(Format::Other("TIFF")) => {
                return Err(subject.unsupported("a folder of TIFF slices", BUILT));
            }
            Some(_) => found = "a folder of volumes; name the file of one",
            None => {}
        }
    }
    Err(subject.malformed("the path", "the file of a volume", found))
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

#[cfg(test)]
mod tests;
