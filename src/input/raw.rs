//! Headerless voxels: everything that a header would say is given by the user.

use std::path::Path;
use std::str::FromStr;

use glam::{DVec3, U64Vec3};

use super::affine;
use super::problem::Subject;
use super::voxel_file::{VoxelFile, voxel_bytes};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelType};

/// Order of the bytes of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl FromStr for Endian {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        match s {
            "le" => Ok(Self::Little),
            "be" => Ok(Self::Big),
            _ => Err(format!(
                "unknown byte order '{s}'; expected le (little-endian) or be (big-endian)"
            )),
        }
    }
}

/// What a user says of a `.raw` file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawParams {
    /// Voxels per axis, x fastest; none may be 0.
    pub dims: U64Vec3,
    /// Type of a voxel.
    pub voxel_type: VoxelType,
    /// Byte order of a voxel.
    pub endian: Endian,
    /// Distance of voxel centres in millimetres, each finite and above 0.
    pub spacing: DVec3,
    /// Bytes before the first voxel.
    pub offset: u64,
}

/// Opens headerless voxels.
///
/// # Errors
/// The file can't be read, or its length is not exactly what `params` ask for.
pub(super) fn open(path: &Path, params: &RawParams) -> Result<VoxelFile, SourceError> {
    let subject = Subject {
        path,
        remedy: "correct --dims, --type or --offset",
    };
    if params.dims.min_element() == 0 {
        return Err(subject.malformed("--dims", "at least 1 on every axis", "0"));
    }
    for value in params.spacing.to_array() {
        affine::spacing(&subject, "--spacing", value)?;
    }
    let desc = VolumeDesc {
        dims: params.dims,
        voxel_type: params.voxel_type,
        world_from_index: affine::checked(
            &subject,
            "--spacing",
            affine::from_spacing(params.spacing),
        )?,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    let (file, len) = subject.open()?;
    let wanted = voxel_bytes(&subject, &desc)?.checked_add(params.offset);
    if wanted != Some(len) {
        let wanted = wanted.map_or("more than 2^64".to_owned(), |n| n.to_string());
        let d = params.dims;
        return Err(subject.malformed(
            "the file's length",
            format!(
                "{wanted} bytes ({} × {} × {} voxels of {}, after {} bytes)",
                d.x, d.y, d.z, params.voxel_type, params.offset
            ),
            format!("{len} bytes"),
        ));
    }
    VoxelFile::plain(&subject, desc, params.endian, file, params.offset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::VoxelBox;
    use crate::volume::VoxelSource;

    fn params() -> RawParams {
        RawParams {
            dims: U64Vec3::new(5, 4, 3),
            voxel_type: VoxelType::U16,
            endian: Endian::Big,
            spacing: DVec3::new(1.0, 2.0, 3.0),
            offset: 7,
        }
    }

    fn file(bytes: usize) -> tempfile::NamedTempFile {
        let file = tempfile::Builder::new().suffix(".raw").tempfile().unwrap();
        let data: Vec<u8> = [0; 7]
            .into_iter()
            .chain((0..60u16).flat_map(u16::to_be_bytes))
            .chain([0; 9])
            .take(bytes)
            .collect();
        std::fs::write(file.path(), data).unwrap();
        file
    }

    #[test]
    fn any_box_comes_out_little_endian() {
        let file = file(127);
        let mut source = open(file.path(), &params()).unwrap();
        let boxes = [
            ([0, 0, 0], [5, 4, 3]),
            ([0, 1, 1], [5, 3, 3]),
            ([2, 1, 0], [4, 4, 2]),
            ([4, 3, 2], [5, 4, 3]),
        ];
        for (min, max) in boxes {
            let voxels = VoxelBox::new(U64Vec3::from_array(min), U64Vec3::from_array(max));
            let mut out = vec![0; voxels.voxel_count().unwrap() as usize * 2];
            source.read_box(voxels, &mut out).unwrap();
            let mut expected = Vec::new();
            for z in min[2]..max[2] {
                for y in min[1]..max[1] {
                    for x in min[0]..max[0] {
                        expected.extend((((z * 4 + y) * 5 + x) as u16).to_le_bytes());
                    }
                }
            }
            assert_eq!(out, expected, "box {min:?}..{max:?}");
        }
        assert_eq!(
            source.desc().spacing(),
            DVec3::new(1.0, 2.0, 3.0),
            "spacing"
        );
    }

    #[test]
    fn a_wrong_length_names_both_numbers() {
        for bytes in [126, 128] {
            let file = file(bytes);
            let error = open(file.path(), &params()).err().unwrap().to_string();
            assert!(
                error.contains("127") && error.contains(&bytes.to_string()),
                "{error}"
            );
        }
        let mut huge = params();
        huge.dims = U64Vec3::splat(u64::MAX);
        assert!(open(file(127).path(), &huge).is_err(), "2^192 voxels");
        let mut flat = params();
        flat.spacing.y = 0.0;
        assert!(open(file(127).path(), &flat).is_err(), "no spacing");
    }
}
