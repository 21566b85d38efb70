//! NIfTI-1 and NIfTI-2 in one file, plain or gzip-compressed, in either byte order.
//!
//! Orientation is the sform, else the qform, else none (identity with `pixdim`). Not here: `.hdr`/`.img` pairs, ANALYZE,
//! time series, vectors, RGB and complex voxels; each is refused by name.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3, U64Vec3};

use super::affine;
use super::problem::Subject;
use super::raw::Endian;
use super::stream::Compression;
use super::voxel_file::VoxelFile;
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

const SINGLE_FILES: &str = "supported are NIfTI-1 and NIfTI-2 in one file (.nii, .nii.gz) with one 3-D volume of integers \
     up to 32 bits, f32 or f64";

/// A version of the header: where its fields are. Everything else is the same in both.
struct Layout {
    header_bytes: usize,
    wide: bool,
    magic: usize,
    dim: usize,
    datatype: usize,
    pixdim: usize,
    vox_offset: usize,
    scl: usize,
    xyzt_units: usize,
    qform_code: usize,
    quatern: usize,
    srow: usize,
}

const NIFTI_1: Layout = Layout {
    header_bytes: 348,
    wide: false,
    magic: 344,
    dim: 40,
    datatype: 70,
    pixdim: 76,
    vox_offset: 108,
    scl: 112,
    xyzt_units: 123,
    qform_code: 252,
    quatern: 256,
    srow: 280,
};

const NIFTI_2: Layout = Layout {
    header_bytes: 540,
    wide: true,
    magic: 4,
    dim: 16,
    datatype: 12,
    pixdim: 104,
    vox_offset: 168,
    scl: 176,
    xyzt_units: 500,
    qform_code: 344,
    quatern: 352,
    srow: 400,
};

/// Which layout and byte order a header of at least 4 bytes has.
fn version(bytes: &[u8]) -> Option<(&'static Layout, Endian)> {
    let &first = bytes.first_chunk::<4>()?;
    for layout in [&NIFTI_1, &NIFTI_2] {
        let size = layout.header_bytes as u32;
        if u32::from_le_bytes(first) == size {
            return Some((layout, Endian::Little));
        }
        if u32::from_be_bytes(first) == size {
            return Some((layout, Endian::Big));
        }
    }
    None
}

/// True when `bytes`, the first ones of a (decompressed) file, can only be NIfTI or ANALYZE.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    version(bytes).is_some()
}

/// A header's bytes with the layout and order to read them in.
struct Fields<'a> {
    bytes: &'a [u8],
    layout: &'static Layout,
    endian: Endian,
}

impl Fields<'_> {
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut out = [0; N];
        out.copy_from_slice(&self.bytes[at..at + N]);
        if self.endian == Endian::Big {
            out.reverse();
        }
        out
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.array(at))
    }

    /// Element `i` of the integers at `at`: i16 in version 1, i64 in version 2.
    fn int(&self, at: usize, i: usize) -> i64 {
        if self.layout.wide {
            i64::from_le_bytes(self.array(at + 8 * i))
        } else {
            i64::from(self.i16(at + 2 * i))
        }
    }

    /// Element `i` of the codes at `at`: i16 in version 1, i32 in version 2.
    fn code(&self, at: usize, i: usize) -> i64 {
        if self.layout.wide {
            i64::from(i32::from_le_bytes(self.array(at + 4 * i)))
        } else {
            i64::from(self.i16(at + 2 * i))
        }
    }

    /// Element `i` of the numbers at `at`: f32 in version 1, f64 in version 2.
    fn real(&self, at: usize, i: usize) -> f64 {
        if self.layout.wide {
            f64::from_le_bytes(self.array(at + 8 * i))
        } else {
            f64::from(f32::from_le_bytes(self.array(at + 4 * i)))
        }
    }

    fn reals(&self, at: usize) -> DVec3 {
        DVec3::new(self.real(at, 0), self.real(at, 1), self.real(at, 2))
    }
}

/// Opens a NIfTI file; `compressed` when it is inside gzip.
///
/// # Errors
/// The file can't be read, its header is wrong, or it holds something that is not built.
pub(super) fn open(path: &Path, compressed: bool) -> Result<VoxelFile, SourceError> {
    let subject = Subject::new(path);
    let (file, len) = subject.open()?;
    let mut reader: Box<dyn Read + Send> = if compressed {
        let file = file.try_clone().map_err(|e| subject.io("open", e))?;
        Compression::Gzip
            .open(file, 0)
            .map_err(|e| subject.io("read", e))?
    } else {
        Box::new(file.try_clone().map_err(|e| subject.io("open", e))?)
    };
    let header = read_header(&subject, &mut reader)?;
    let (layout, endian) =
        version(&header).expect("invariant: read_header returns a header of a known version");
    let fields = Fields {
        bytes: &header,
        layout,
        endian,
    };
    let (desc, start) = parse(&subject, &fields)?;
    finish(
        &subject,
        desc,
        endian,
        Body {
            file,
            len,
            reader,
            start,
            read: header.len() as u64,
            compressed,
        },
    )
}

/// Where the voxels come from once the header is read.
struct Body {
    file: File,
    len: u64,
    reader: Box<dyn Read + Send>,
    start: u64,
    read: u64,
    compressed: bool,
}

fn finish(
    subject: &Subject<'_>,
    desc: VolumeDesc,
    endian: Endian,
    mut body: Body,
) -> Result<VoxelFile, SourceError> {
    if !body.compressed {
        return VoxelFile::plain(subject, desc, endian, body.file, body.start);
    }
    let source_bytes = body.len;
    let gap = body.start - body.read;
    let skipped = io::copy(&mut body.reader.by_ref().take(gap), &mut io::sink()).map_err(|e| {
        subject.malformed(
            "the header's extensions",
            "a sound gzip stream",
            e.to_string(),
        )
    })?;
    if skipped != gap {
        return Err(subject.malformed(
            "vox_offset",
            format!("voxels from byte {} on", body.start),
            format!("a stream of {} bytes", body.read + skipped),
        ));
    }
    VoxelFile::stream(
        subject,
        desc,
        endian,
        source_bytes,
        (body.reader, Compression::Gzip),
    )
}

/// The header's bytes; their length is that of a known version.
fn read_header(
    subject: &Subject<'_>,
    reader: &mut (dyn Read + Send),
) -> Result<Vec<u8>, SourceError> {
    let mut header = Vec::with_capacity(NIFTI_2.header_bytes);
    let mut upto = |bytes: usize, header: &mut Vec<u8>| {
        let missing = (bytes - header.len()) as u64;
        reader
            .take(missing)
            .read_to_end(header)
            .map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof
                | io::ErrorKind::InvalidInput
                | io::ErrorKind::InvalidData => subject.malformed(
                    format!("byte {} of the header", header.len()),
                    "a sound gzip stream",
                    e.to_string(),
                ),
                _ => subject.io("read the header", e),
            })
    };
    upto(4, &mut header)?;
    let Some((layout, _)) = version(&header) else {
        return Err(subject.malformed(
            "sizeof_hdr",
            "348 (NIfTI-1) or 540 (NIfTI-2)",
            format!("bytes {header:?}"),
        ));
    };
    upto(layout.header_bytes, &mut header)?;
    if header.len() < layout.header_bytes {
        return Err(subject.malformed(
            "the header",
            format!("{} bytes", layout.header_bytes),
            format!("the end of the file after {}", header.len()),
        ));
    }
    Ok(header)
}

/// The description and the byte at which the voxels start.
fn parse(subject: &Subject<'_>, f: &Fields<'_>) -> Result<(VolumeDesc, u64), SourceError> {
    let layout = f.layout;
    let version = if layout.wide { b'2' } else { b'1' };
    match f.bytes[layout.magic..layout.magic + 4] {
        [b'n', b'+', v, 0] if v == version => {}
        [b'n', b'i', v, 0] if v == version => {
            return Err(subject.unsupported("a NIfTI .hdr/.img pair", SINGLE_FILES));
        }
        [0, 0, 0, 0] if !layout.wide => {
            return Err(subject.unsupported("ANALYZE 7.5", SINGLE_FILES));
        }
        ref other => {
            return Err(subject.malformed(
                "magic",
                format!("\"n+{}\"", char::from(version)),
                format!("bytes {other:?}"),
            ));
        }
    }
    let dims = dims(subject, f)?;
    let desc = VolumeDesc {
        dims,
        voxel_type: voxel_type(subject, f.i16(layout.datatype))?,
        world_from_index: world_from_index(subject, f, dims)?,
        rescale: rescale(subject, f)?,
        unit: String::new(),
        name: subject.name(),
    };
    Ok((desc, start(subject, f)?))
}

fn dims(subject: &Subject<'_>, f: &Fields<'_>) -> Result<U64Vec3, SourceError> {
    let at = f.layout.dim;
    let count = f.int(at, 0);
    if !(1..=7).contains(&count) {
        return Err(subject.malformed("dim[0]", "1 to 7 dimensions", count.to_string()));
    }
    let mut dims = [1u64; 8];
    for (i, dim) in dims.iter_mut().enumerate().skip(1).take(count as usize) {
        let n = f.int(at, i);
        *dim = u64::try_from(n).ok().filter(|&n| n > 0).ok_or_else(|| {
            subject.malformed(format!("dim[{i}]"), "a size of at least 1", n.to_string())
        })?;
    }
    if dims[4] > 1 {
        let what = format!("4-D data ({} time points)", dims[4]);
        return Err(subject.unsupported(what, SINGLE_FILES));
    }
    if let Some(i) = (5..8).find(|&i| dims[i] > 1) {
        let what = format!("{i}-D data ({} values per voxel)", dims[i]);
        return Err(subject.unsupported(what, SINGLE_FILES));
    }
    Ok(U64Vec3::new(dims[1], dims[2], dims[3]))
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
    Err(subject.unsupported(format!("{refused} (datatype {code})"), SINGLE_FILES))
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

/// The byte (of the decompressed file) at which the voxels start.
fn start(subject: &Subject<'_>, f: &Fields<'_>) -> Result<u64, SourceError> {
    let at = f.layout.vox_offset;
    let least = f.layout.header_bytes as u64 + 4;
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
        // "Not set": the voxels follow the header and its four extension bytes.
        Some(0) => Ok(least),
        Some(v) if v >= least => Ok(v),
        _ => Err(subject.malformed("vox_offset", format!("a whole number from {least}"), found)),
    }
}

fn world_from_index(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    dims: U64Vec3,
) -> Result<DAffine3, SourceError> {
    let layout = f.layout;
    let units = if layout.wide {
        f.code(layout.xyzt_units, 0)
    } else {
        i64::from(f.bytes[layout.xyzt_units])
    };
    let mm_per_unit = match units & 7 {
        1 => 1000.0,
        3 => 0.001,
        _ => 1.0,
    };
    let (place, affine) = if f.code(layout.qform_code, 1) > 0 {
        let row_bytes = if layout.wide { 32 } else { 16 };
        let rows = [0, 1, 2].map(|r| f.reals(layout.srow + r * row_bytes));
        let origin = [0, 1, 2].map(|r| f.real(layout.srow + r * row_bytes, 3));
        let matrix = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
        let origin = DVec3::from_array(origin);
        (
            "srow_x, srow_y, srow_z",
            DAffine3::from_mat3_translation(matrix, origin),
        )
    } else {
        let spacing = pixdim(subject, f, dims)?;
        if f.code(layout.qform_code, 0) > 0 {
            let (rotation, origin) = qform(f);
            let matrix = rotation * DMat3::from_diagonal(spacing);
            (
                "quatern_b, c, d and qoffset",
                DAffine3::from_mat3_translation(matrix, origin),
            )
        } else {
            ("pixdim", affine::from_spacing(spacing))
        }
    };
    let scaled = DAffine3::from_scale(DVec3::splat(mm_per_unit)) * affine;
    affine::checked(subject, place, scaled)
}

/// Spacing from `pixdim`; a sign has no meaning there, and an axis of one voxel may leave it at 0.
fn pixdim(subject: &Subject<'_>, f: &Fields<'_>, dims: U64Vec3) -> Result<DVec3, SourceError> {
    let mut spacing = [1.0; 3];
    for (i, n) in dims.to_array().into_iter().enumerate() {
        let value = f.real(f.layout.pixdim, i + 1).abs();
        if !(n == 1 && value == 0.0) {
            spacing[i] = affine::spacing(subject, &format!("pixdim[{}]", i + 1), value)?;
        }
    }
    Ok(DVec3::from_array(spacing))
}

/// Rotation (z flipped when `pixdim[0]` is negative) and origin of the qform.
fn qform(f: &Fields<'_>) -> (DMat3, DVec3) {
    let size = if f.layout.wide { 8 } else { 4 };
    let q = f.reals(f.layout.quatern);
    let origin = f.reals(f.layout.quatern + 3 * size);
    let w = (1.0 - q.length_squared()).max(0.0).sqrt();
    let rotation = DMat3::from_quat(DQuat::from_xyzw(q.x, q.y, q.z, w).normalize());
    let flip = if f.real(f.layout.pixdim, 0) < 0.0 {
        -1.0
    } else {
        1.0
    };
    (
        rotation * DMat3::from_diagonal(DVec3::new(1.0, 1.0, flip)),
        origin,
    )
}

#[cfg(test)]
mod tests;
