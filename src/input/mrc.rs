//! MRC 2014 and CCP4 maps (`.mrc`, `.map`, `.rec`, `.st`), plain or gzip: 1024 bytes of header, an extended header, then
//! the voxels.
//!
//! Axes stay in the file's order; where they point is in the affine ([`cell`]). Of a stack of volumes `--time` chooses one.
//! Not here: complex, colour and 4-bit voxels, each refused by name, and what the extended header says.

mod cell;
mod half_float;

use std::path::Path;

use glam::U64Vec3;

use self::half_float::HalfFloats;
use super::choice;
use super::contents::Contents;
use super::options::OpenOptions;
use super::problem::Subject;
use super::raw::Endian;
use super::voxel_file::voxel_bytes;
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelSource, VoxelType};

const SUPPORTED: &str =
    "supported are MRC and CCP4 maps of mode 0 (8 bits), 1 (i16), 2 (f32), 6 (u16) and 12 (f16)";

const HEADER_BYTES: usize = 1024;

/// Where fields are, in words of 4 bytes.
const SIZE: usize = 0;
const MODE: usize = 3;
const START: usize = 4;
const INTERVALS: usize = 7;
const CELL: usize = 10;
const ANGLES: usize = 13;
const AXES: usize = 16;
const SPACE_GROUP: usize = 22;
const EXTENDED_BYTES: usize = 23;
const IMOD_STAMP: usize = 38;
const IMOD_FLAGS: usize = 39;
const ORIGIN: usize = 49;
const MAP: usize = 52;
const MACHINE: usize = 53;

/// What IMOD writes at [`IMOD_STAMP`]: then bit 0 of its flags tells whether bytes have a sign.
const IMOD: i32 = 1_146_047_817;

/// Space groups that stand for a stack of volumes.
const STACKS: std::ops::RangeInclusive<i32> = 401..=630;

/// Modes that the format and IMOD know.
const MODES: [i32; 10] = [0, 1, 2, 3, 4, 6, 7, 12, 16, 101];

/// The bytes of a header, up to [`MACHINE`] at least, with an order to read them in.
#[derive(Clone, Copy)]
struct Header<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

impl Header<'_> {
    fn word(&self, word: usize) -> [u8; 4] {
        let mut out = [0; 4];
        out.copy_from_slice(&self.bytes[4 * word..4 * word + 4]);
        if self.endian == Endian::Big {
            out.reverse();
        }
        out
    }

    fn int(&self, word: usize) -> i32 {
        i32::from_le_bytes(self.word(word))
    }

    fn ints(&self, word: usize) -> [i32; 3] {
        [0, 1, 2].map(|i| self.int(word + i))
    }

    fn reals(&self, word: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(f32::from_le_bytes(self.word(word + i))))
    }

    fn has_map_mark(&self) -> bool {
        self.bytes[4 * MAP..].starts_with(b"MAP")
    }

    /// The cell's axis (0 to 2) of each of the file's; `None` when MAPC, MAPR and MAPS do not name each once.
    fn axes(&self) -> Option<[usize; 3]> {
        let axes = self.ints(AXES);
        if axes == [0; 3] && self.has_map_mark() {
            // Left out by the writer.
            return Some([0, 1, 2]);
        }
        let mut sorted = axes;
        sorted.sort_unstable();
        (sorted == [1, 2, 3]).then(|| axes.map(|a| a as usize - 1))
    }

    /// True when sizes, mode and axes make sense, which those of the other byte order can't.
    fn is_plausible(&self) -> bool {
        self.ints(SIZE).into_iter().all(|n| n > 0)
            && MODES.contains(&self.int(MODE))
            && self.axes().is_some()
    }
}

/// The byte order in which `bytes` are a plausible header, that of the machine stamp first.
fn endian(bytes: &[u8]) -> Option<Endian> {
    let stamp = bytes.get(4 * MACHINE..4 * MACHINE + 2)?;
    let (first, second) = if stamp == [0x11, 0x11] {
        (Endian::Big, Endian::Little)
    } else {
        (Endian::Little, Endian::Big)
    };
    [first, second]
        .into_iter()
        .find(|&endian| Header { bytes, endian }.is_plausible())
}

/// True when `bytes`, the first ones of a (decompressed) file, are MRC's. Old files have no mark: their axes give them away.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    let has_mark = bytes
        .get(4 * MAP..)
        .is_some_and(|rest| rest.starts_with(b"MAP "));
    has_mark || endian(bytes).is_some()
}

/// Opens an MRC or CCP4 file; `compressed` when it is gzip.
///
/// # Errors
/// The file can't be read, its header is wrong, it holds something that is not built, or several volumes of which `options`
/// choose none.
pub(super) fn open(
    path: &Path,
    compressed: bool,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let subject = Subject::new(path);
    let mut contents = Contents::open(&subject, compressed)?;
    let mut bytes = Vec::with_capacity(HEADER_BYTES);
    contents.extend(&mut bytes, HEADER_BYTES)?;
    let Some(endian) = endian(&bytes) else {
        return Err(implausible(&subject, &bytes));
    };
    let header = Header {
        bytes: &bytes,
        endian,
    };
    let mut notes = Vec::new();
    let (voxel_type, is_half) = voxel_type(&subject, &header, &mut notes)?;
    let (dims, volumes) = sizes(&subject, &header, &mut notes)?;
    let world_from_index = cell::world_from_index(&subject, &header, options, &mut notes)?;
    let desc = VolumeDesc {
        dims,
        voxel_type,
        world_from_index,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    choice::channel(&subject, options, 1)?;
    let volume = choice::time(&subject, options, volumes)?;
    let extended = header.int(EXTENDED_BYTES);
    let start = u64::try_from(extended)
        .map_err(|_| {
            subject.malformed(
                "NSYMBT",
                "the extended header's length, at least 0",
                extended.to_string(),
            )
        })?
        .checked_add(HEADER_BYTES as u64)
        .zip(voxel_bytes(&subject, &desc)?.checked_mul(volume))
        .and_then(|(first, skipped)| first.checked_add(skipped))
        .ok_or_else(|| {
            subject.malformed(
                "NX, NY, NZ",
                "volumes that end before byte 2^64",
                format!("{dims}, volume {volume}"),
            )
        })?;
    let voxels = contents.voxels(desc, endian, start)?.with_notes(notes);
    Ok(if is_half {
        Box::new(HalfFloats::new(voxels))
    } else {
        Box::new(voxels)
    })
}

/// The error for a header that makes sense in neither byte order, read in the one that its stamp says.
fn implausible(subject: &Subject<'_>, bytes: &[u8]) -> SourceError {
    let is_big = bytes.get(4 * MACHINE) == Some(&0x11);
    let header = Header {
        bytes,
        endian: if is_big { Endian::Big } else { Endian::Little },
    };
    let size = header.ints(SIZE);
    if size.into_iter().any(|n| n <= 0) {
        subject.malformed("NX, NY, NZ", "sizes of at least 1", format!("{size:?}"))
    } else if header.axes().is_none() {
        subject.malformed(
            "MAPC, MAPR, MAPS",
            "1, 2 and 3 in some order",
            format!("{:?}", header.ints(AXES)),
        )
    } else {
        subject.malformed("MODE", "0, 1, 2, 6 or 12", header.int(MODE).to_string())
    }
}

/// The type of the voxels in the file, and whether a u16 stands for the bits of an f16.
fn voxel_type(
    subject: &Subject<'_>,
    header: &Header<'_>,
    notes: &mut Vec<String>,
) -> Result<(VoxelType, bool), SourceError> {
    let mode = header.int(MODE);
    let refused = match mode {
        0 if header.int(IMOD_STAMP) == IMOD && header.int(IMOD_FLAGS) & 1 == 0 => {
            notes
                .push("Bytes are taken as unsigned, as IMOD's mark in the header says.".to_owned());
            return Ok((VoxelType::U8, false));
        }
        0 => return Ok((VoxelType::I8, false)),
        1 => return Ok((VoxelType::I16, false)),
        2 => return Ok((VoxelType::F32, false)),
        6 => return Ok((VoxelType::U16, false)),
        12 => return Ok((VoxelType::U16, true)),
        3 | 4 => "complex voxels",
        16 => "RGB voxels",
        101 => "voxels of 4 bits",
        _ => "voxels of another kind",
    };
    Err(subject.unsupported(format!("{refused} (mode {mode})"), SUPPORTED))
}

/// Voxels of one volume, and how many volumes there are.
fn sizes(
    subject: &Subject<'_>,
    header: &Header<'_>,
    notes: &mut Vec<String>,
) -> Result<(U64Vec3, u64), SourceError> {
    // Above 0, or the header would not be plausible.
    let [x, y, z] = header.ints(SIZE).map(|n| u64::from(n.unsigned_abs()));
    let space_group = header.int(SPACE_GROUP);
    if !STACKS.contains(&space_group) {
        if space_group == 0 && z > 1 && header.int(INTERVALS + 2) == 1 {
            notes.push(format!(
                "The file is a stack of {z} images, not a volume: they are taken as its slices."
            ));
        }
        return Ok((U64Vec3::new(x, y, z), 1));
    }
    let mz = header.int(INTERVALS + 2);
    match u64::try_from(mz) {
        Ok(per_volume) if per_volume > 0 && z.is_multiple_of(per_volume) => {
            Ok((U64Vec3::new(x, y, per_volume), z / per_volume))
        }
        _ => Err(subject.malformed(
            "MZ",
            format!("the slices of each volume of the stack, a divisor of NZ = {z}"),
            mz.to_string(),
        )),
    }
}

#[cfg(test)]
mod tests;
