//! NIfTI in one gzip-compressed file: NIfTI-1, or NIfTI-2 where NIfTI-1 has no room for the sizes.
//!
//! NIfTI-1 keeps slope, intercept and affine in f32, so numbers that f32 lacks are rounded there. It is written
//! nevertheless: ITK, and with it 3D Slicer, does not read NIfTI-2.

use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::sink::{Header, Sink};
use super::writer::ExportError;
use crate::outfile::Existing;
use crate::volume::{VolumeDesc, VoxelType};

/// Millimetres and nothing about time, in `xyzt_units`.
const MILLIMETRES: u8 = 2;
/// "Scanner anatomical", in `qform_code` and `sform_code`.
const SCANNER: i16 = 1;
/// How far from orthogonal axes may be (cosine) and still count as a rotation.
const ORTHOGONAL: f64 = 1e-6;

/// Starts a `.nii.gz` file.
pub(super) fn create(
    path: &Path,
    desc: &VolumeDesc,
    existing: Existing,
) -> Result<Sink, ExportError> {
    let dims = desc.dims.to_array();
    if dims.iter().any(|&n| n > i64::MAX as u64) {
        return Err(ExportError::DoesNotFit {
            path: path.to_owned(),
            what: format!("NIfTI-2 has no room for {dims:?} voxels"),
        });
    }
    let header = if is_narrow(desc) {
        nifti_1(desc)
    } else {
        nifti_2(desc)
    };
    Sink::create(path, desc, existing, &Header::Inside(&header))
}

/// True when NIfTI-1 has room for the sizes.
fn is_narrow(desc: &VolumeDesc) -> bool {
    desc.dims.max_element() <= i16::MAX as u64
}

/// True when affine or rescale are written as f32 and f32 does not hold them.
pub(super) fn is_rounded(desc: &VolumeDesc) -> bool {
    let affine = desc.world_from_index.to_cols_array();
    let rescale = [desc.rescale.slope, desc.rescale.intercept];
    is_narrow(desc)
        && affine
            .iter()
            .chain(&rescale)
            .any(|&v| f64::from(v as f32) != v)
}

const fn datatype(voxel_type: VoxelType) -> i16 {
    match voxel_type {
        VoxelType::U8 => 2,
        VoxelType::I16 => 4,
        VoxelType::I32 => 8,
        VoxelType::F32 => 16,
        VoxelType::F64 => 64,
        VoxelType::I8 => 256,
        VoxelType::U16 => 512,
        VoxelType::U32 => 768,
    }
}

/// An affine as a quaternion, if it is a rotation (and a flip of z) times a spacing.
struct Qform {
    /// −1 when z is flipped.
    flip: f64,
    /// The quaternion's imaginary part; its real part is not negative.
    vector: DVec3,
}

fn qform(affine: &DAffine3) -> Option<Qform> {
    let m = affine.matrix3;
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::normalize_or_zero);
    let skew = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
    if skew > ORTHOGONAL {
        return None;
    }
    let flip = if x.cross(y).dot(z) < 0.0 { -1.0 } else { 1.0 };
    let q = DQuat::from_mat3(&DMat3::from_cols(x, y, z * flip)).normalize();
    let q = if q.w < 0.0 { -q } else { q };
    Some(Qform {
        flip,
        vector: DVec3::new(q.x, q.y, q.z),
    })
}

/// Little-endian numbers put at fixed places of a header, in the width of its version.
struct HeaderBytes {
    bytes: Vec<u8>,
    wide: bool,
}

impl HeaderBytes {
    fn new(wide: bool) -> Self {
        // The header and four bytes that say that no extension follows.
        let bytes = vec![0; if wide { 544 } else { 352 }];
        Self { bytes, wide }
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    /// f32 in version 1, f64 in version 2.
    fn reals(&mut self, at: usize, values: &[f64]) {
        for (i, &v) in values.iter().enumerate() {
            if self.wide {
                self.put(at + 8 * i, &v.to_le_bytes());
            } else {
                self.put(at + 4 * i, &(v as f32).to_le_bytes());
            }
        }
    }

    /// i16 in version 1, i32 in version 2.
    fn code(&mut self, at: usize, value: i16) {
        if self.wide {
            self.put(at, &i32::from(value).to_le_bytes());
        } else {
            self.put(at, &value.to_le_bytes());
        }
    }

    /// The fields about space, which both versions have in the same order: `pixdim` at `pixdim`, the codes at `codes`,
    /// quaternion and offsets from `quatern`, rows from `srow`.
    fn place(&mut self, affine: &DAffine3, spacing: DVec3, at: &Places) {
        let q = qform(affine);
        let flip = q.as_ref().map_or(1.0, |q| q.flip);
        let t = affine.translation;
        self.reals(
            at.pixdim,
            &[flip, spacing.x, spacing.y, spacing.z, 1.0, 1.0, 1.0, 1.0],
        );
        let code_bytes = if self.wide { 4 } else { 2 };
        self.code(at.codes, if q.is_some() { SCANNER } else { 0 });
        self.code(at.codes + code_bytes, SCANNER);
        let v = q.map_or(DVec3::ZERO, |q| q.vector);
        self.reals(at.quatern, &[v.x, v.y, v.z, t.x, t.y, t.z]);
        let m = affine.matrix3;
        let mut rows = [0.0; 12];
        for r in 0..3 {
            rows[4 * r..4 * r + 4].copy_from_slice(&[m.x_axis[r], m.y_axis[r], m.z_axis[r], t[r]]);
        }
        self.reals(at.srow, &rows);
    }
}

struct Places {
    pixdim: usize,
    codes: usize,
    quatern: usize,
    srow: usize,
}

fn nifti_1(desc: &VolumeDesc) -> Vec<u8> {
    let mut h = HeaderBytes::new(false);
    h.put(0, &348i32.to_le_bytes());
    h.put(40, &3i16.to_le_bytes());
    let dims = desc.dims.to_array().map(|n| n as i16);
    for (i, n) in dims.into_iter().chain([1; 4]).enumerate() {
        h.put(42 + 2 * i, &n.to_le_bytes());
    }
    h.put(70, &datatype(desc.voxel_type).to_le_bytes());
    h.put(72, &(8 * desc.voxel_type.size() as i16).to_le_bytes());
    h.reals(108, &[352.0, desc.rescale.slope, desc.rescale.intercept]);
    h.put(123, &[MILLIMETRES]);
    let places = Places {
        pixdim: 76,
        codes: 252,
        quatern: 256,
        srow: 280,
    };
    h.place(&desc.world_from_index, desc.spacing(), &places);
    h.put(344, b"n+1\0");
    h.bytes
}

fn nifti_2(desc: &VolumeDesc) -> Vec<u8> {
    let mut h = HeaderBytes::new(true);
    h.put(0, &540i32.to_le_bytes());
    h.put(4, b"n+2\0\r\n\x1a\n");
    h.put(12, &datatype(desc.voxel_type).to_le_bytes());
    h.put(14, &(8 * desc.voxel_type.size() as i16).to_le_bytes());
    h.put(16, &3i64.to_le_bytes());
    let dims = desc.dims.to_array().map(|n| n as i64);
    for (i, n) in dims.into_iter().chain([1; 4]).enumerate() {
        h.put(24 + 8 * i, &n.to_le_bytes());
    }
    h.put(168, &544i64.to_le_bytes());
    h.reals(176, &[desc.rescale.slope, desc.rescale.intercept]);
    h.put(500, &i32::from(MILLIMETRES).to_le_bytes());
    let places = Places {
        pixdim: 104,
        codes: 344,
        quatern: 352,
        srow: 400,
    };
    h.place(&desc.world_from_index, desc.spacing(), &places);
    h.bytes
}
