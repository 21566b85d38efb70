//! NIfTI-1 and NIfTI-2, in one file or as a pair `.hdr` and `.img`, plain or gzip-compressed, in either byte order.
//!
//! Orientation is the sform, else the qform, else none (identity with `pixdim`). Of several points in time (axis 4) or
//! channels (axis 5) one is read. Not here: more axes, RGB and complex voxels, each refused by name; ANALYZE, which has the
//! same header's size and is handed on.

pub(super) mod header;
pub(super) mod place;

use std::path::Path;

use self::header::{Fields, Sizes};
use super::contents::Contents;
use super::options::OpenOptions;
use super::problem::Subject;
use super::voxel_file::{VoxelFile, voxel_bytes};
use super::{analyze, choice, pair};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

pub(super) use self::header::is_header;

const SUPPORTED: &str = "supported are NIfTI-1 and NIfTI-2 (.nii, .nii.gz, .hdr with .img) of volumes of integers up to 32 \
                         bits, f32 or f64, of which --time and --channel choose one";

/// Opens a NIfTI or ANALYZE file, or the pair of header `path`; `compressed` when that file is gzip.
///
/// # Errors
/// A file can't be read, the header is wrong, it holds something that is not built, or leaves a choice that `options` do not
/// make.
pub(super) fn open(
    path: &Path,
    compressed: bool,
    options: &OpenOptions,
) -> Result<VoxelFile, SourceError> {
    let subject = Subject::new(path);
    let mut contents = Contents::open(&subject, compressed)?;
    let bytes = header::read(&subject, &mut contents)?;
    let fields =
        Fields::of(&bytes).expect("invariant: read returns the whole header of a known version");
    match kind(&subject, &fields)? {
        Kind::OneFile => read(&subject, &fields, contents, options),
        Kind::Pair => {
            let image = pair::image_of(&subject)?;
            let image = Subject::new(&image);
            read(&subject, &fields, pair::open(&image)?, options)
        }
        Kind::Analyze => analyze::open(&subject, &fields, options),
    }
}

/// What the magic bytes tell of a header.
enum Kind {
    OneFile,
    Pair,
    Analyze,
}

fn kind(subject: &Subject<'_>, f: &Fields<'_>) -> Result<Kind, SourceError> {
    let at = f.layout.magic;
    let version = if f.layout.wide { b'2' } else { b'1' };
    match f.bytes[at..at + 4] {
        [b'n', b'+', v, 0] if v == version => Ok(Kind::OneFile),
        [b'n', b'i', v, 0] if v == version => Ok(Kind::Pair),
        _ if analyze::is_header(f) => Ok(Kind::Analyze),
        ref other => Err(subject.malformed(
            "magic",
            format!("\"n+{0}\" or \"ni{0}\"", char::from(version)),
            format!("bytes {other:?}"),
        )),
    }
}

/// The volume of header `f` whose voxels are in `contents`.
fn read(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    contents: Contents<'_>,
    options: &OpenOptions,
) -> Result<VoxelFile, SourceError> {
    let sizes = header::sizes(subject, f, SUPPORTED)?;
    let desc = VolumeDesc {
        dims: sizes.dims,
        voxel_type: voxel_type(subject, f.i16(f.layout.datatype))?,
        world_from_index: place::world_from_index(subject, f, sizes.dims)?,
        rescale: rescale(subject, f)?,
        unit: String::new(),
        name: subject.name(),
    };
    let least = if matches!(kind(subject, f)?, Kind::OneFile) {
        f.layout.header_bytes as u64 + 4
    } else {
        0
    };
    let start = start(subject, f, least)?;
    let start = volume_start(subject, &sizes, &desc, start, options)?;
    contents.voxels(desc, f.endian, start)
}

/// The byte at which the chosen volume starts, when the first one starts at byte `start`.
pub(super) fn volume_start(
    subject: &Subject<'_>,
    sizes: &Sizes,
    desc: &VolumeDesc,
    start: u64,
    options: &OpenOptions,
) -> Result<u64, SourceError> {
    let time = choice::time(subject, options, sizes.times)?;
    let channel = choice::channel(subject, options, sizes.channels)?;
    let bytes = voxel_bytes(subject, desc)?;
    sizes
        .volume_start(start, (time, channel), bytes)
        .ok_or_else(|| {
            subject.malformed(
                "dim",
                "volumes that end before byte 2^64",
                format!("volume {time} of channel {channel} of {bytes} bytes each"),
            )
        })
}

fn voxel_type(subject: &Subject<'_>, code: i16) -> Result<VoxelType, SourceError> {
    let refused = match code {
        2 => return Ok(VoxelType::U8),
        4 => return Ok(VoxelType::I16),
        8 => return Ok(VoxelType::I32),
        16 => return Ok(VoxelType::F32),
        64 => return Ok(VoxelType::F64),
        256 => return Ok(VoxelType::I8),
        512 => return Ok(VoxelType::U16),
        768 => return Ok(VoxelType::U32),
        1 => "voxels of 1 bit",
        32 | 1792 | 2048 => "complex voxels",
        128 => "RGB voxels",
        2304 => "RGBA voxels",
        1024 | 1280 => "64-bit integer voxels",
        1536 => "128-bit float voxels",
        _ => {
            let expected = "2, 4, 8, 16, 64, 256, 512 or 768";
            return Err(subject.malformed("datatype", expected, code.to_string()));
        }
    };
    Err(subject.unsupported(format!("{refused} (datatype {code})"), SUPPORTED))
}

fn rescale(subject: &Subject<'_>, f: &Fields<'_>) -> Result<Rescale, SourceError> {
    let (slope, intercept) = (f.real(f.layout.scl, 0), f.real(f.layout.scl, 1));
    // 0 means "none" by the standard; NaN is what some writers put for it.
    if slope == 0.0 || slope.is_nan() {
        return Ok(Rescale::IDENTITY);
    }
    for (place, value) in [("scl_slope", slope), ("scl_inter", intercept)] {
        if !value.is_finite() {
            return Err(subject.malformed(place, "a finite number", value.to_string()));
        }
    }
    Ok(Rescale { slope, intercept })
}

/// The byte (of the decompressed file) at which the first voxel is, from `least` on.
pub(super) fn start(subject: &Subject<'_>, f: &Fields<'_>, least: u64) -> Result<u64, SourceError> {
    let at = f.layout.vox_offset;
    let (value, found) = if f.layout.wide {
        let v = f.int(at, 0);
        (u64::try_from(v).ok(), v.to_string())
    } else {
        let v = f.real(at, 0);
        // f32 holds every whole number up to 2^24; larger ones are what they are.
        let whole = v >= 0.0 && v < 2f64.powi(63) && v.fract() == 0.0;
        (whole.then_some(v as u64), v.to_string())
    };
    match value {
        // "Not set": the voxels come first, behind the header and its four extension bytes if it is there.
        Some(0) => Ok(least),
        Some(v) if v >= least => Ok(v),
        _ => Err(subject.malformed("vox_offset", format!("a whole number from {least}"), found)),
    }
}

#[cfg(test)]
mod tests;
