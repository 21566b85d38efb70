//! ANALYZE 7.5: a pair `.hdr` and `.img`, told from NIfTI by its magic bytes, which ANALYZE does not have.
//!
//! What its header says of orientation is not to be trusted (programs disagree on which side x begins), so there is none: the
//! axes are the world's, with the spacing of `pixdim`. Not here: bits, RGB and complex voxels, each refused by name.

use glam::DVec3;

use super::nifti::header::{self, Fields};
use super::nifti::{place, start, volume_start};
use super::options::OpenOptions;
use super::problem::Subject;
use super::voxel_file::VoxelFile;
use super::{affine, pair};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

const SUPPORTED: &str = "supported are ANALYZE 7.5 pairs (.hdr with .img) of volumes of integers up to 32 bits, f32 or f64, \
                         of which --time and --channel choose one";

/// Where `extents` (32-bit) and `regular` are, and what most writers put there.
const EXTENTS: (usize, i64) = (32, 16384);
const REGULAR: (usize, u8) = (38, b'r');

/// True when a header that is not NIfTI's is ANALYZE's: one of its marks is set, or nothing is where the magic would be.
pub(super) fn is_header(f: &Fields<'_>) -> bool {
    !f.layout.wide
        && (f.i32(EXTENTS.0) == EXTENTS.1
            || f.bytes.get(REGULAR.0) == Some(&REGULAR.1)
            || f.bytes.get(f.layout.magic..) == Some(&[0; 4]))
}

/// Opens the pair of header `subject` with the fields `f`.
///
/// # Errors
/// There is no file of voxels, the header is wrong, it holds something that is not built, or leaves a choice that `options` do
/// not make.
pub(super) fn open(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    options: &OpenOptions,
) -> Result<VoxelFile, SourceError> {
    let sizes = header::sizes(subject, f, SUPPORTED)?;
    let mut notes = vec![
        "ANALYZE 7.5 does not say reliably how the volume lies in the patient: its axes are taken as x, y and z of the \
         world, so left and right may be swapped."
            .to_owned(),
    ];
    let spacing = spacing(subject, f, &sizes, options, &mut notes)?;
    let scale = f.real(f.layout.scl, 0);
    if scale != 0.0 && scale != 1.0 {
        notes.push(format!(
            "The header's field funused1 is {scale}, which SPM takes for a factor of all values; it is left out."
        ));
    }
    let desc = VolumeDesc {
        dims: sizes.dims,
        voxel_type: voxel_type(subject, f.i16(f.layout.datatype))?,
        world_from_index: affine::checked(subject, "pixdim", affine::from_spacing(spacing))?,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    let start = start(subject, f, 0)?;
    let start = volume_start(subject, &sizes, &desc, start, options)?;
    let image = pair::image_of(subject)?;
    let contents = pair::open(&Subject::new(&image))?;
    Ok(contents.voxels(desc, f.endian, start)?.with_notes(notes))
}

/// The spacing of `pixdim`, or the user's where the header has none.
fn spacing(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    sizes: &header::Sizes,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<DVec3, SourceError> {
    let is_unset = (1..4).all(|i| f.real(f.layout.pixdim, i) == 0.0);
    if !is_unset {
        return place::pixdim(subject, f, sizes.dims);
    }
    let (spacing, whose) = match options.spacing {
        Some(spacing) => (spacing, "that of --spacing is taken"),
        None => (DVec3::ONE, "1 mm is taken; --spacing x,y,z says another"),
    };
    notes.push(format!(
        "The header does not say how far the voxels are apart (pixdim is 0): {whose}."
    ));
    Ok(spacing)
}

fn voxel_type(subject: &Subject<'_>, code: i16) -> Result<VoxelType, SourceError> {
    let refused = match code {
        2 => return Ok(VoxelType::U8),
        4 => return Ok(VoxelType::I16),
        8 => return Ok(VoxelType::I32),
        16 => return Ok(VoxelType::F32),
        64 => return Ok(VoxelType::F64),
        // SPM's additions: the standard's codes with the other sign.
        130 => return Ok(VoxelType::I8),
        132 => return Ok(VoxelType::U16),
        136 => return Ok(VoxelType::U32),
        1 => "voxels of 1 bit",
        32 => "complex voxels",
        128 => "RGB voxels",
        _ => {
            let expected = "2, 4, 8, 16 or 64 (130, 132 or 136 of SPM)";
            return Err(subject.malformed("datatype", expected, code.to_string()));
        }
    };
    Err(subject.unsupported(format!("{refused} (datatype {code})"), SUPPORTED))
}

#[cfg(test)]
mod tests;
