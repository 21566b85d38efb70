//! FreeSurfer's MGH (`.mgh`) and the same in gzip (`.mgz`): 284 bytes of header, big-endian, then the frames one after
//! another.
//!
//! World is RAS millimetres as in the file. Of several frames `--time` chooses one. Not here: what may follow the voxels
//! (echo times, tags), and volumes of bits and tensors, which are refused by name.

use std::path::Path;

use glam::{DAffine3, DMat3, DVec3, U64Vec3};

use super::contents::Contents;
use super::options::OpenOptions;
use super::problem::Subject;
use super::raw::Endian;
use super::voxel_file::{VoxelFile, voxel_bytes};
use super::{affine, choice};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

const SUPPORTED: &str =
    "supported are MGH and MGZ files of u8 (type 0), i32 (1), f32 (3), i16 (4) and u16 (10) voxels";

const HEADER_BYTES: usize = 284;

/// Where the fields are.
const VERSION: usize = 0;
const DIMS: usize = 4;
const FRAMES: usize = 16;
const TYPE: usize = 20;
const GOOD_RAS: usize = 28;
const SPACING: usize = 30;
const COSINES: usize = 42;
const CENTER: usize = 78;

/// Codes of voxel types that FreeSurfer knows.
const TYPES: std::ops::RangeInclusive<i32> = 0..=10;

/// True when `bytes`, the first ones of a (decompressed) file, are MGH's: it has no magic, so sizes and type must make sense.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    let int = |at| Some(i32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
    int(VERSION) == Some(1)
        && (0..4).all(|i| int(DIMS + 4 * i).is_some_and(|n| n > 0))
        && int(TYPE).is_some_and(|t| TYPES.contains(&t))
}

/// A whole header.
struct Header([u8; HEADER_BYTES]);

impl Header {
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut out = [0; N];
        out.copy_from_slice(&self.0[at..at + N]);
        out
    }

    fn int(&self, at: usize) -> i32 {
        i32::from_be_bytes(self.array(at))
    }

    fn reals(&self, at: usize) -> DVec3 {
        let real = |i: usize| f64::from(f32::from_be_bytes(self.array(at + 4 * i)));
        DVec3::new(real(0), real(1), real(2))
    }
}

/// Opens an MGH file; `compressed` when it is gzip.
///
/// # Errors
/// The file can't be read, its header is wrong, it holds something that is not built, or several frames of which `options`
/// choose none.
pub(super) fn open(
    path: &Path,
    compressed: bool,
    options: &OpenOptions,
) -> Result<VoxelFile, SourceError> {
    let subject = Subject::new(path);
    let mut contents = Contents::open(&subject, compressed)?;
    let mut bytes = Vec::with_capacity(HEADER_BYTES);
    contents.extend(&mut bytes, HEADER_BYTES)?;
    let mut header = Header([0; HEADER_BYTES]);
    header.0.copy_from_slice(&bytes);

    let version = header.int(VERSION);
    if version != 1 {
        return Err(subject.malformed("the version", "1", version.to_string()));
    }
    let size = |at: usize, name: &str| {
        let n = header.int(at);
        u64::try_from(n)
            .ok()
            .filter(|&n| n > 0)
            .ok_or_else(|| subject.malformed(name, "a size of at least 1", n.to_string()))
    };
    let dims = U64Vec3::new(
        size(DIMS, "width")?,
        size(DIMS + 4, "height")?,
        size(DIMS + 8, "depth")?,
    );
    let frames = size(FRAMES, "nframes")?;
    let mut notes = Vec::new();
    let desc = VolumeDesc {
        dims,
        voxel_type: voxel_type(&subject, header.int(TYPE))?,
        world_from_index: world_from_index(&subject, &header, dims, &mut notes)?,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    choice::channel(&subject, options, 1)?;
    let frame = choice::time(&subject, options, frames)?;
    let bytes = voxel_bytes(&subject, &desc)?;
    let start = bytes
        .checked_mul(frame)
        .and_then(|n| n.checked_add(HEADER_BYTES as u64))
        .ok_or_else(|| {
            subject.malformed(
                "nframes",
                "frames that end before byte 2^64",
                format!("frame {frame} of {bytes} bytes each"),
            )
        })?;
    Ok(contents.voxels(desc, Endian::Big, start)?.with_notes(notes))
}

fn voxel_type(subject: &Subject<'_>, code: i32) -> Result<VoxelType, SourceError> {
    let refused = match code {
        0 => return Ok(VoxelType::U8),
        1 => return Ok(VoxelType::I32),
        3 => return Ok(VoxelType::F32),
        4 => return Ok(VoxelType::I16),
        10 => return Ok(VoxelType::U16),
        2 => "voxels of long integers",
        5 => "voxels of 1 bit",
        6 => "tensors",
        7..=9 => "voxels of a kind that FreeSurfer does not write to volumes",
        _ => {
            return Err(subject.malformed("the type", "0, 1, 3, 4 or 10", code.to_string()));
        }
    };
    Err(subject.unsupported(format!("{refused} (type {code})"), SUPPORTED))
}

/// The header's axes about the volume's centre, which is the corner of voxel dims ÷ 2, not the middle of the voxels' centres.
fn world_from_index(
    subject: &Subject<'_>,
    header: &Header,
    dims: U64Vec3,
    notes: &mut Vec<String>,
) -> Result<DAffine3, SourceError> {
    let (matrix, center) = if i16::from_be_bytes(header.array(GOOD_RAS)) > 0 {
        let mut columns = [DVec3::ZERO; 3];
        for (i, column) in columns.iter_mut().enumerate() {
            let name = ["xsize", "ysize", "zsize"][i];
            let size = affine::spacing(subject, name, header.reals(SPACING)[i])?;
            *column = header.reals(COSINES + 12 * i) * size;
        }
        let [x, y, z] = columns;
        (DMat3::from_cols(x, y, z), header.reals(CENTER))
    } else {
        notes.push(
            "The header does not say how the volume lies in the patient (goodRASflag is 0): it is taken as coronal, with \
             voxels 1 mm apart, as FreeSurfer does."
                .to_owned(),
        );
        (
            DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y),
            DVec3::ZERO,
        )
    };
    let origin = center - matrix * (dims.as_dvec3() / 2.0);
    affine::checked(
        subject,
        "x_ras, y_ras, z_ras and c_ras",
        DAffine3::from_mat3_translation(matrix, origin),
    )
}

#[cfg(test)]
mod tests;
