//! MetaImage: lines `Key = value`, then the voxels (`.mha`) or the name of their file (`.mhd`); raw or zlib.
//!
//! World is ITK's LPS. Not here: lists of data files, text voxels, several channels, more than three axes; each is refused
//! by name. `AnatomicalOrientation` is a remark, as in ITK: the matrix counts.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use glam::{DAffine3, DVec3, U64Vec3};

use super::affine;
use super::problem::{Subject, quoted};
use super::raw::Endian;
use super::stream::Compression;
use super::text_header::{Fields, read_lines};
use super::voxel_file::{VoxelFile, voxel_bytes};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

const SUPPORTED: &str = "supported are MetaImage files of one 3-D volume with one channel of integers up to \
                         32 bits, float or double, raw or zlib-compressed, in the file itself or in one data file";

/// What the first line of a header can set.
const FIRST_KEYS: [&str; 9] = [
    "objecttype",
    "objectsubtype",
    "comment",
    "transformtype",
    "ndims",
    "name",
    "id",
    "binarydata",
    "dimsize",
];

/// True when `bytes`, the first ones of a file, look like a MetaImage header.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    let line = bytes.split(|&b| b == b'\n').next().unwrap_or_default();
    let Ok(line) = std::str::from_utf8(line) else {
        return false;
    };
    line.split_once('=')
        .is_some_and(|(key, _)| FIRST_KEYS.contains(&key.trim().to_ascii_lowercase().as_str()))
}

/// Opens a MetaImage file.
///
/// # Errors
/// The file or its data file can't be read, the header is wrong, or it holds something that is not built.
pub(super) fn open(path: &Path) -> Result<VoxelFile, SourceError> {
    let subject = Subject::new(path);
    let (file, _) = subject.open()?;
    let header = read_lines(&subject, &file, |line| {
        line.split_once('=')
            .is_some_and(|(key, _)| key.trim().eq_ignore_ascii_case("ElementDataFile"))
    })?;
    let mut fields = Fields::new(subject);
    for (i, line) in header.lines.iter().enumerate() {
        match line.split_once('=') {
            Some((key, _)) if key.trim().eq_ignore_ascii_case("Comment") => {}
            Some((key, value)) => fields.insert(key, value)?,
            None if line.trim().is_empty() => {}
            None => {
                let place = format!("line {}", i + 1);
                return Err(subject.malformed(place, "'Key = value'", quoted(line)));
            }
        }
    }
    if let Some((_, kind)) = fields.get(&["objecttype"])
        && !kind.eq_ignore_ascii_case("Image")
    {
        return Err(subject.unsupported(format!("ObjectType {}", quoted(kind)), SUPPORTED));
    }
    let (dims, axes) = sizes(&subject, &fields)?;
    let desc = VolumeDesc {
        dims,
        voxel_type: voxel_type(&subject, &fields)?,
        world_from_index: world_from_index(&subject, &fields, axes)?,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    let (name, value) = fields.need(&["elementdatafile"], "LOCAL or the name of a file")?;
    if value.eq_ignore_ascii_case("LOCAL") {
        return voxels(&subject, &fields, desc, header.bytes);
    }
    let mut words = value.split_whitespace();
    match words.next() {
        None => return Err(fields.malformed(name, "LOCAL or the name of a file", value)),
        Some(first) if first == "LIST" || (value.contains('%') && words.count() > 2) => {
            let what = format!("several data files (ElementDataFile = {})", quoted(value));
            return Err(subject.unsupported(what, SUPPORTED));
        }
        Some(_) => {}
    }
    let data = path.parent().unwrap_or(Path::new("")).join(value);
    voxels(&Subject::new(&data), &fields, desc, 0)
}

/// Sizes of three axes, and how many the file has.
fn sizes(subject: &Subject<'_>, fields: &Fields<'_>) -> Result<(U64Vec3, usize), SourceError> {
    let (name, value) = fields.need(&["ndims"], "the number of axes")?;
    let axes = value
        .parse()
        .ok()
        .filter(|n| (2..=10).contains(n))
        .ok_or_else(|| fields.malformed(name, "2 to 10", value))?;
    let (name, value) = fields.need(&["dimsize"], "the size of each axis")?;
    let mut sizes = fields.sizes(name, value, axes)?;
    if sizes[2..].iter().skip(1).any(|&n| n > 1) {
        return Err(subject.unsupported(format!("{axes}-D data (DimSize {value})"), SUPPORTED));
    }
    sizes.resize(3, 1);
    Ok((U64Vec3::new(sizes[0], sizes[1], sizes[2]), axes))
}

fn voxel_type(subject: &Subject<'_>, fields: &Fields<'_>) -> Result<VoxelType, SourceError> {
    if let Some((name, value)) = fields.get(&["elementnumberofchannels"]) {
        match value.parse::<u32>() {
            Ok(1) => {}
            Ok(n) if n > 1 => {
                return Err(subject.unsupported(format!("{n} channels per voxel"), SUPPORTED));
            }
            _ => return Err(fields.malformed(name, "a whole number of at least 1", value)),
        }
    }
    let (name, value) = fields.need(&["elementtype"], "the type of a voxel")?;
    Ok(match value {
        "MET_CHAR" => VoxelType::I8,
        "MET_UCHAR" => VoxelType::U8,
        "MET_SHORT" => VoxelType::I16,
        "MET_USHORT" => VoxelType::U16,
        // MetaIO's long has 4 bytes on every machine.
        "MET_INT" | "MET_LONG" => VoxelType::I32,
        "MET_UINT" | "MET_ULONG" => VoxelType::U32,
        "MET_FLOAT" => VoxelType::F32,
        "MET_DOUBLE" => VoxelType::F64,
        "MET_LONG_LONG" | "MET_ULONG_LONG" => {
            return Err(subject.unsupported(format!("64-bit integers ({value})"), SUPPORTED));
        }
        v if v.starts_with("MET_") => {
            return Err(subject.unsupported(format!("ElementType {}", quoted(value)), SUPPORTED));
        }
        _ => return Err(fields.malformed(name, "a type that MetaImage knows", value)),
    })
}

/// `True` or `False`, by the first letter as MetaIO reads it; `None` when the field is missing.
fn flag(fields: &Fields<'_>, names: &[&'static str]) -> Result<Option<bool>, SourceError> {
    match fields.get(names) {
        None => Ok(None),
        Some((name, value)) => match value.bytes().next() {
            Some(b'T' | b't' | b'1') => Ok(Some(true)),
            Some(b'F' | b'f' | b'0') => Ok(Some(false)),
            _ => Err(fields.malformed(name, "True or False", value)),
        },
    }
}

fn world_from_index(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
    axes: usize,
) -> Result<DAffine3, SourceError> {
    let mut spacing = DVec3::ONE;
    let mm = match fields.get(&["distanceunits"]) {
        Some((_, "um")) => 0.001,
        Some((_, "cm")) => 10.0,
        _ => 1.0,
    };
    if let Some((name, value)) = fields.get(&["elementspacing", "elementsize"]) {
        for (i, v) in fields
            .reals(name, value, axes)?
            .into_iter()
            .take(3)
            .enumerate()
        {
            spacing[i] = affine::spacing(subject, &format!("field '{name}'"), v)?;
        }
    }
    let matrix = fields.get(&["transformmatrix", "rotation", "orientation"]);
    let offset = fields.get(&["offset", "position", "origin"]);
    if matrix.is_none() && offset.is_none() {
        let affine = affine::from_spacing(spacing * mm);
        return affine::checked(subject, "field 'elementspacing'", affine);
    }
    // Row i of the matrix is the direction of axis i.
    let mut directions = [DVec3::X, DVec3::Y, DVec3::Z];
    if let Some((name, value)) = matrix {
        let numbers = fields.reals(name, value, axes * axes)?;
        for (direction, row) in directions.iter_mut().zip(numbers.chunks_exact(axes)) {
            let at = |i: usize| row.get(i).copied().unwrap_or(0.0);
            *direction = DVec3::new(at(0), at(1), at(2));
        }
    }
    let mut origin = DVec3::ZERO;
    if let Some((name, value)) = offset {
        for (i, v) in fields
            .reals(name, value, axes)?
            .into_iter()
            .take(3)
            .enumerate()
        {
            origin[i] = v;
        }
    }
    let [x, y, z] = directions;
    let columns = [x * spacing.x, y * spacing.y, z * spacing.z];
    let affine = affine::from_axes(columns, origin, affine::RAS_FROM_LPS * mm);
    affine::checked(subject, "fields 'transformmatrix' and 'offset'", affine)
}

/// The voxels of the file of `subject`, the part before byte `from` not counted.
fn voxels(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
    desc: VolumeDesc,
    from: u64,
) -> Result<VoxelFile, SourceError> {
    if flag(fields, &["binarydata"])? == Some(false) {
        return Err(subject.unsupported("voxels written as text (BinaryData = False)", SUPPORTED));
    }
    let msb = flag(fields, &["binarydatabyteordermsb", "elementbyteordermsb"])?;
    let endian = if msb == Some(true) {
        Endian::Big
    } else {
        Endian::Little
    };
    let compressed = flag(fields, &["compresseddata"])? == Some(true);
    let (mut file, len) = subject.open()?;
    let start = match fields.get(&["headersize"]) {
        None => from,
        Some((name, "-1")) => {
            if compressed {
                return Err(fields.malformed(name, "at least 0 for compressed data", "-1"));
            }
            // Beyond the end when the file is too short: `plain` says so.
            len.checked_sub(voxel_bytes(subject, &desc)?).unwrap_or(len)
        }
        Some((name, value)) => value
            .parse::<u64>()
            .ok()
            .and_then(|n| from.checked_add(n))
            .ok_or_else(|| fields.malformed(name, "-1 or a whole number of at least 0", value))?,
    };
    if !compressed {
        return VoxelFile::plain(subject, desc, endian, file, start);
    }
    // MetaIO lets zlib find out which of the two it is.
    let mut first = [0; 2];
    file.seek(SeekFrom::Start(start))
        .and_then(|_| file.by_ref().read_exact(&mut first))
        .map_err(|_| {
            subject.malformed(
                "the voxels",
                format!("a zlib stream from byte {start} on"),
                format!("a file of {len} bytes"),
            )
        })?;
    let compression = if first == [0x1f, 0x8b] {
        Compression::Gzip
    } else {
        Compression::Zlib
    };
    let reader = compression
        .open(file, start)
        .map_err(|e| subject.io("read", e))?;
    VoxelFile::stream(
        subject,
        desc,
        endian,
        len.saturating_sub(start),
        (reader, compression),
    )
}

#[cfg(test)]
mod tests;
