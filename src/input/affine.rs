//! From a header's axes to the one world there is: millimetres, RAS+.

use glam::{DAffine3, DMat3, DVec3};

use super::problem::Subject;
use crate::volume::SourceError;

/// How flat the cell of three axes may be (volume ÷ product of the edges) before they count as dependent.
const LEAST_CELL: f64 = 1e-6;

/// RAS from LPS: x and y change sign.
pub(super) const RAS_FROM_LPS: DVec3 = DVec3::new(-1.0, -1.0, 1.0);

/// The affine without orientation: index axes are world axes, `spacing` in millimetres.
pub(super) fn from_spacing(spacing: DVec3) -> DAffine3 {
    DAffine3::from_scale(spacing)
}

/// The affine with index axes `columns` (millimetres per voxel) and the first voxel's centre at `origin`, each world
/// coordinate then multiplied by `signs_and_scale`.
pub(super) fn from_axes(columns: [DVec3; 3], origin: DVec3, signs_and_scale: DVec3) -> DAffine3 {
    let [x, y, z] = columns.map(|c| c * signs_and_scale);
    DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), origin * signs_and_scale)
}

/// `affine` if it is finite and invertible, else an error about header field `place`.
pub(super) fn checked(
    subject: &Subject<'_>,
    place: &str,
    affine: DAffine3,
) -> Result<DAffine3, SourceError> {
    let m = affine.matrix3;
    let unit = DMat3::from_cols(
        m.x_axis.normalize_or_zero(),
        m.y_axis.normalize_or_zero(),
        m.z_axis.normalize_or_zero(),
    );
    let sound =
        affine.is_finite() && unit.determinant().abs() > LEAST_CELL && affine.inverse().is_finite();
    if sound {
        Ok(affine)
    } else {
        Err(subject.malformed(
            place,
            "three independent axes of finite, non-zero length and a finite origin",
            format!(
                "axes {}, {}, {}, origin {}",
                m.x_axis, m.y_axis, m.z_axis, affine.translation
            ),
        ))
    }
}

/// `value` if it can be a distance between voxels, else an error about header field `place`.
pub(super) fn spacing(subject: &Subject<'_>, place: &str, value: f64) -> Result<f64, SourceError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(subject.malformed(place, "a finite spacing above 0", value.to_string()))
    }
}
