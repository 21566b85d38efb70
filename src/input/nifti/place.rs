//! Where a NIfTI header puts its voxels: sform, qform, or `pixdim` alone.

use glam::{DAffine3, DMat3, DQuat, DVec3, U64Vec3};

use super::super::affine;
use super::super::problem::Subject;
use super::header::Fields;
use crate::volume::SourceError;

/// The place of the voxels: the sform, else the qform, else their spacing alone.
pub(super) fn world_from_index(
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
pub(in crate::input) fn pixdim(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    dims: U64Vec3,
) -> Result<DVec3, SourceError> {
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
