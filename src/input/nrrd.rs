//! NRRD: a text header, then the voxels (`.nrrd`) or the name of their file (`.nhdr`); raw or gzip.
//!
//! Axes that are not in space and have one sample are dropped. Not here: other encodings, lists of data files, more than
//! three axes, vector and colour voxels; each is refused by name.

mod axes;

use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::problem::{Subject, quoted};
use super::raw::Endian;
use super::stream::Compression;
use super::text_header::{Fields, read_lines};
use super::voxel_file::{VoxelFile, voxel_bytes};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

const SUPPORTED: &str = "supported are NRRD files of one 3-D volume of integers up to 32 bits, float or \
                         double, encoding raw or gzip, in the file itself or in one data file";

/// True when `bytes`, the first ones of a file, are NRRD's.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    bytes.starts_with(b"NRRD0")
}

/// Opens an NRRD file.
///
/// # Errors
/// The file or its data file can't be read, the header is wrong, or it holds something that is not built.
pub(super) fn open(path: &Path) -> Result<VoxelFile, SourceError> {
    let subject = Subject::new(path);
    let (file, _) = subject.open()?;
    let header = read_lines(&subject, &file, str::is_empty)?;
    let fields = parse_fields(subject, &header.lines)?;

    let voxel_type = voxel_type(&subject, &fields)?;
    let (dims, world_from_index) = axes::parse(&subject, &fields)?;
    let desc = VolumeDesc {
        dims,
        voxel_type,
        world_from_index,
        rescale: Rescale::IDENTITY,
        unit: fields
            .get(&["sample units", "sampleunits"])
            .map(|(_, v)| v.trim_matches('"').to_owned())
            .unwrap_or_default(),
        name: subject.name(),
    };
    let endian = endian(&fields, voxel_type)?;
    let place = Place {
        compression: compression(&subject, &fields)?,
        line_skip: skip(&fields, &["line skip", "lineskip"], false)?,
        byte_skip: skip(&fields, &["byte skip", "byteskip"], true)?,
    };
    match fields.get(&["data file", "datafile"]) {
        None => place.open(&subject, desc, endian, header.bytes),
        Some((name, value)) => {
            let first = value.split_whitespace().next().unwrap_or_default();
            if first.is_empty() {
                return Err(fields.malformed(name, "the name of a file", value));
            }
            if first == "LIST" || (value.contains('%') && value.split_whitespace().count() > 3) {
                let what = format!("several data files (data file: {})", quoted(value));
                return Err(subject.unsupported(what, SUPPORTED));
            }
            let data = path.parent().unwrap_or(Path::new("")).join(value);
            place.open(&Subject::new(&data), desc, endian, 0)
        }
    }
}

/// The header's fields by name; comments and key/value pairs are left out.
fn parse_fields<'a>(subject: Subject<'a>, lines: &[String]) -> Result<Fields<'a>, SourceError> {
    let mut fields = Fields::new(subject);
    let mut lines = lines.iter();
    let magic = lines.next().map_or("", String::as_str);
    if !matches!(
        magic.strip_prefix("NRRD000"),
        Some("1" | "2" | "3" | "4" | "5" | "6")
    ) {
        return Err(subject.malformed("line 1", "NRRD0001 to NRRD0006", quoted(magic)));
    }
    for (i, line) in lines.enumerate() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        match line.split_once(':') {
            Some((_, value)) if value.starts_with('=') => {}
            Some((name, value)) => {
                fields.insert(name, value)?;
                let name = name.trim().to_ascii_lowercase();
                if matches!(name.as_str(), "data file" | "datafile")
                    && value.trim_start().starts_with("LIST")
                {
                    // What follows are names of files.
                    break;
                }
            }
            None => {
                let place = format!("line {}", i + 2);
                return Err(subject.malformed(place, "'field: value'", quoted(line)));
            }
        }
    }
    Ok(fields)
}

fn voxel_type(subject: &Subject<'_>, fields: &Fields<'_>) -> Result<VoxelType, SourceError> {
    let (name, value) = fields.need(&["type"], "the type of a voxel")?;
    let lower = value.to_ascii_lowercase();
    Ok(match lower.as_str() {
        "signed char" | "int8" | "int8_t" => VoxelType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => VoxelType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            VoxelType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            VoxelType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => VoxelType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => VoxelType::U32,
        "float" => VoxelType::F32,
        "double" => VoxelType::F64,
        "block" => return Err(subject.unsupported("type block", SUPPORTED)),
        t if t.contains("long") || t.contains("int64") => {
            return Err(subject.unsupported(format!("64-bit integers (type {value})"), SUPPORTED));
        }
        _ => return Err(fields.malformed(name, "a type that NRRD knows", value)),
    })
}

fn endian(fields: &Fields<'_>, voxel_type: VoxelType) -> Result<Endian, SourceError> {
    let expected = "'little' or 'big', for voxels of more than one byte";
    match fields.get(&["endian"]) {
        Some((_, "little")) => Ok(Endian::Little),
        Some((_, "big")) => Ok(Endian::Big),
        Some((name, other)) => Err(fields.malformed(name, expected, other)),
        None if voxel_type.size() == 1 => Ok(Endian::Little),
        None => fields.need(&["endian"], expected).map(|_| Endian::Little),
    }
}

fn compression(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
) -> Result<Option<Compression>, SourceError> {
    let (name, value) = fields.need(&["encoding"], "how the voxels are encoded")?;
    match value.to_ascii_lowercase().as_str() {
        "raw" => Ok(None),
        "gzip" | "gz" => Ok(Some(Compression::Gzip)),
        "bzip2" | "bz2" | "txt" | "text" | "ascii" | "hex" | "zrl" | "zstd" => {
            Err(subject.unsupported(format!("encoding {value}"), SUPPORTED))
        }
        _ => Err(fields.malformed(name, "raw or gzip", value)),
    }
}

/// A number of lines or bytes to skip; `None` for −1, which only bytes may have.
fn skip(
    fields: &Fields<'_>,
    names: &[&'static str],
    may_be_minus_one: bool,
) -> Result<Option<u64>, SourceError> {
    match fields.get(names) {
        None => Ok(Some(0)),
        Some((_, "-1")) if may_be_minus_one => Ok(None),
        Some((name, value)) => value
            .parse()
            .map(Some)
            .map_err(|_| fields.malformed(name, "a whole number of at least 0", value)),
    }
}

/// Where the voxels lie in their file.
struct Place {
    compression: Option<Compression>,
    /// Lines before them, never `None`.
    line_skip: Option<u64>,
    /// Bytes before them, after decompression; `None`: they are the file's last bytes.
    byte_skip: Option<u64>,
}

impl Place {
    /// The voxels of the file of `subject`, the part before byte `from` not counted.
    fn open(
        &self,
        subject: &Subject<'_>,
        desc: VolumeDesc,
        endian: Endian,
        from: u64,
    ) -> Result<VoxelFile, SourceError> {
        let (mut file, len) = subject.open()?;
        let mut start = from;
        if let Some(lines) = self.line_skip.filter(|&n| n > 0) {
            file.seek(SeekFrom::Start(from))
                .map_err(|e| subject.io("read", e))?;
            start += lines_bytes(subject, BufReader::new(&file), lines)?;
        }
        let Some(compression) = self.compression else {
            let start = match self.byte_skip {
                Some(n) => start.checked_add(n),
                None => len.checked_sub(voxel_bytes(subject, &desc)?),
            };
            // Beyond the end in either way: `plain` says how long the file is.
            return VoxelFile::plain(subject, desc, endian, file, start.unwrap_or(len));
        };
        let Some(skip) = self.byte_skip else {
            return Err(subject.malformed(
                "field 'byte skip'",
                "at least 0 for gzip",
                "-1, which is for raw",
            ));
        };
        let mut reader = compression
            .open(file, start)
            .map_err(|e| subject.io("read", e))?;
        let skipped = std::io::copy(&mut reader.by_ref().take(skip), &mut std::io::sink())
            .map_err(|e| {
                subject.malformed(
                    "the compressed voxels",
                    "a sound gzip stream",
                    e.to_string(),
                )
            })?;
        if skipped != skip {
            return Err(subject.malformed(
                "field 'byte skip'",
                format!("{skip} bytes before the voxels"),
                format!("a stream of {skipped} bytes"),
            ));
        }
        VoxelFile::stream(
            subject,
            desc,
            endian,
            len.saturating_sub(start),
            (reader, compression),
        )
    }
}

/// How many bytes the next `lines` lines take.
fn lines_bytes(
    subject: &Subject<'_>,
    mut reader: impl BufRead,
    lines: u64,
) -> Result<u64, SourceError> {
    let mut total = 0;
    for i in 0..lines {
        let n = reader
            .skip_until(b'\n')
            .map_err(|e| subject.io("read", e))?;
        if n == 0 {
            return Err(subject.malformed(
                "field 'line skip'",
                format!("{lines} lines before the voxels"),
                format!("the end of the file after {i}"),
            ));
        }
        total += n as u64;
    }
    Ok(total)
}

#[cfg(test)]
mod tests;
