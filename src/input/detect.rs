//! [`open`]: from what a user typed to a source. The format is found by content; names only help to word errors.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::files::{self, first_bytes};
use super::options::OpenOptions;
use super::problem::Subject;
use super::{
    dicom, metaimage, mgh, mrc, nifti, nrrd, pair, phantom, picture, pyramid, raw, tiff, vti,
};
use crate::volume::{SourceError, VoxelSource};

const BUILT: &str = "supported are DICOM (a folder, files, DICOMDIR), NIfTI (.nii, .nii.gz, .hdr with .img), ANALYZE 7.5 \
                     (.hdr with .img), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), TIFF (.tif), folders and globs of \
                     TIFF, PNG or JPEG slices, MGH (.mgh, .mgz), MRC and CCP4 (.mrc, .map, .rec, .st), VTK XML images \
                     (.vti), folders and URLs of OME-Zarr, N5 and Neuroglancer precomputed, .raw with --dims and --type, and \
                     phantom:NAME:X,Y,Z[:TYPE]";

/// Files of a folder that are looked at to tell what it holds.
const PEEK_FILES: usize = 64;

/// Decompressed bytes of a gzip file that are looked at.
const PEEK_INSIDE_BYTES: u64 = 1024;

/// What a file holds, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Nifti {
        compressed: bool,
    },
    Nrrd,
    MetaImage,
    Dicom,
    Mgh {
        compressed: bool,
    },
    Mrc {
        compressed: bool,
    },
    Vti,
    Tiff,
    Png,
    Jpeg,
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

/// As [`open`], for several files that are the slices of one volume, or all its files.
///
/// # Errors
/// As [`open`].
pub fn open_files(
    files: Vec<PathBuf>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let first = files.first().cloned().unwrap_or_default();
    let subject = Subject {
        path: &first,
        remedy: BUILT,
    };
    open_slices(&subject, files, options)
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
    if let Some((header, compressed)) = header_of_pair(path) {
        return Ok(Box::new(nifti::open(&header, compressed, options)?));
    }
    match format {
        Some(Format::Nifti { compressed }) => Ok(Box::new(nifti::open(path, compressed, options)?)),
        Some(Format::Nrrd) => Ok(Box::new(nrrd::open(path)?)),
        Some(Format::MetaImage) => Ok(Box::new(metaimage::open(path)?)),
        Some(Format::Dicom) => {
            let subject = Subject::new(path);
            let files =
                dicom::files_of_dicomdir(&subject)?.unwrap_or_else(|| vec![path.to_owned()]);
            Ok(Box::new(dicom::open(&files, &subject, options)?))
        }
        Some(Format::Mgh { compressed }) => Ok(Box::new(mgh::open(path, compressed, options)?)),
        Some(Format::Mrc { compressed }) => mrc::open(path, compressed, options),
        Some(Format::Vti) => vti::open(path, options),
        Some(Format::Tiff) => tiff::open(&[path.to_owned()], subject, options),
        Some(Format::Png | Format::Jpeg) => picture::open(&[path.to_owned()], subject, options),
        Some(Format::Other(name)) => Err(subject.unsupported(name, BUILT)),
        None if pair::is_image(path) => {
            let subject = Subject {
                remedy: "put the header beside it, or if these are bare voxels, say what they are with --dims and --type",
                ..*subject
            };
            Err(subject.malformed(
                "the header of these voxels",
                "a NIfTI or ANALYZE header of the same name that ends in .hdr",
                "none",
            ))
        }
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

/// The NIfTI or ANALYZE header that stands beside the file of voxels `path`, and whether it is gzip.
fn header_of_pair(path: &Path) -> Option<(PathBuf, bool)> {
    let header = pair::header_of(path)?;
    match format(&first_bytes(&header).ok()?) {
        Some(Format::Nifti { compressed }) => Some((header, compressed)),
        _ => None,
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
    if !files.is_empty() {
        let contents = files.iter().find(|f| {
            let name = f.file_name().unwrap_or_default();
            name.eq_ignore_ascii_case("DICOMDIR")
        });
        if let Some(contents) = contents {
            return open_file(
                &Subject {
                    path: contents,
                    ..*subject
                },
                options,
            );
        }
        return open_slices(subject, files, options);
    }
    // Media have folders of patients and studies.
    let mut files = files::below(subject)?;
    files.retain(|f| first_bytes(f).is_ok_and(|b| dicom::is_header(&b)));
    if files.is_empty() {
        return Err(subject.malformed(
            "the path",
            "the file of a volume",
            "a folder without volumes",
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
            Some(Format::Dicom) => {
                let subject = Subject::new(subject.path);
                return Ok(Box::new(dicom::open(&files, &subject, options)?));
            }
            Some(Format::Tiff) => {
                let slices = slices_among(subject, &files, Format::Tiff)?;
                return tiff::open(&slices, subject, options);
            }
            Some(kind @ (Format::Png | Format::Jpeg)) => {
                let slices = slices_among(subject, &files, kind)?;
                return picture::open(&slices, subject, options);
            }
            Some(_) => found = "a folder of volumes; name the file of one",
            None => {}
        }
    }
    Err(subject.malformed("the path", "the file of a volume", found))
}

/// The files that hold `kind`. In a folder others may lie beside them, unless their names or formats say that they belong
/// to a volume: a damaged slice is not to be left out unseen.
fn slices_among(
    subject: &Subject<'_>,
    files: &[PathBuf],
    kind: Format,
) -> Result<Vec<PathBuf>, SourceError> {
    let mut slices = Vec::new();
    let mut others = Vec::new();
    for file in files {
        let first = first_bytes(file).map_err(|e| Subject::new(file).io("open", e))?;
        match format(&first) {
            Some(found) if found == kind => slices.push(file.clone()),
            found => others.push((file, found)),
        }
    }
    let ending = |file: &Path| file.extension().map(|e| e.to_ascii_lowercase());
    for (file, found) in others {
        let is_apart = found.is_none()
            && subject.path.is_dir()
            && slices.iter().all(|slice| ending(slice) != ending(file));
        if !is_apart {
            let subject = Subject {
                remedy: "name the slices of one volume by a glob",
                ..Subject::new(file)
            };
            return Err(subject.malformed(
                "the first bytes",
                format!("a {} slice, as beside it", kind.name()),
                found.map_or("no format that is known", Format::name),
            ));
        }
    }
    Ok(slices)
}

impl Format {
    const fn name(self) -> &'static str {
        match self {
            Self::Nifti { .. } => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Dicom => "DICOM",
            Self::Mgh { .. } => "MGH",
            Self::Mrc { .. } => "MRC",
            Self::Vti => "VTK XML",
            Self::Tiff => "TIFF",
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
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
        return Some(format_in_gzip(bytes));
    }
    // Before MGH, which has no magic.
    if mrc::is_header(bytes) {
        return Some(Format::Mrc { compressed: false });
    }
    if mgh::is_header(bytes) {
        return Some(Format::Mgh { compressed: false });
    }
    if metaimage::is_header(bytes) {
        return Some(Format::MetaImage);
    }
    // Before TIFF: a DICOM file may begin as one.
    if dicom::is_header(bytes) {
        return Some(Format::Dicom);
    }
    if tiff::is_header(bytes) {
        return Some(Format::Tiff);
    }
    if picture::is_png(bytes) {
        return Some(Format::Png);
    }
    if picture::is_jpeg(bytes) {
        return Some(Format::Jpeg);
    }
    if bytes.starts_with(b"\x89HDF\r\n\x1a\n") {
        return Some(Format::Other("HDF5"));
    }
    if vti::is_header(bytes) {
        return Some(Format::Vti);
    }
    bytes
        .starts_with(b"# vtk DataFile")
        .then_some(Format::Other("VTK legacy"))
}

/// The format of a gzip file that begins with `bytes`.
fn format_in_gzip(bytes: &[u8]) -> Format {
    let mut inner = Vec::new();
    // The stream is cut where `bytes` end: what came before counts.
    let _ = flate2::bufread::GzDecoder::new(bytes)
        .take(PEEK_INSIDE_BYTES)
        .read_to_end(&mut inner);
    let compressed = true;
    if nifti::is_header(&inner) {
        Format::Nifti { compressed }
    } else if mrc::is_header(&inner) {
        Format::Mrc { compressed }
    } else if mgh::is_header(&inner) {
        Format::Mgh { compressed }
    } else {
        Format::Other("gzip of something other than NIfTI, MGH or MRC")
    }
}

#[cfg(test)]
mod tests;
