//! Where an MRC header puts its voxels: the crystal's cell, cut into intervals, and the first voxel's place in it.

use glam::{DAffine3, DMat3, DVec3};

use super::super::affine;
use super::super::options::OpenOptions;
use super::super::problem::Subject;
use super::{ANGLES, CELL, Header, INTERVALS, ORIGIN, START};
use crate::volume::SourceError;

/// Lengths in the file are ångströms.
const MM_PER_ANGSTROM: f64 = 1e-7;

/// World millimetres of the file's indices. A cell of no size leaves the spacing to the user.
pub(super) fn world_from_index(
    subject: &Subject<'_>,
    header: &Header<'_>,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<DAffine3, SourceError> {
    let lengths = header.reals(CELL);
    if lengths == [0.0; 3] {
        let (spacing, whose) = match options.spacing {
            Some(spacing) => (spacing, "that of --spacing is taken"),
            None => (DVec3::ONE, "1 mm is taken; --spacing x,y,z says another"),
        };
        notes.push(format!(
            "The header does not say how far the voxels are apart (its cell has no size): {whose}."
        ));
        return affine::checked(subject, "--spacing", affine::from_spacing(spacing));
    }
    let directions = directions(subject, header.reals(ANGLES))?;
    let intervals = header.ints(INTERVALS);
    let mut per_axis = [DVec3::ZERO; 3];
    for (i, column) in per_axis.iter_mut().enumerate() {
        let name = ["CELLA x ÷ MX", "CELLA y ÷ MY", "CELLA z ÷ MZ"][i];
        let spacing = lengths[i] / f64::from(intervals[i]);
        *column = directions[i] * affine::spacing(subject, name, spacing)?;
    }
    // Columns, rows and sections of the file run along these axes of the cell.
    let axes = header.axes().unwrap_or([0, 1, 2]);
    let columns = axes.map(|a| per_axis[a]);
    let spacing = columns.map(DVec3::length);

    let stated = DVec3::from_array(header.reals(ORIGIN));
    let origin = if stated != DVec3::ZERO {
        stated
    } else {
        let [x, y, z] = header.ints(START).map(f64::from);
        columns[0] * x + columns[1] * y + columns[2] * z
    };
    notes.push(format!(
        "Voxels are {:.6} × {:.6} × {:.6} Å apart; the world is in millimetres (1 Å = 1e-7 mm), its axes are those of the \
         map.",
        spacing[0], spacing[1], spacing[2]
    ));
    let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let affine =
        DAffine3::from_mat3_translation(matrix * MM_PER_ANGSTROM, origin * MM_PER_ANGSTROM);
    affine::checked(subject, "CELLA, CELLB and ORIGIN", affine)
}

/// Unit vectors along the cell's axes a, b and c: a along x, b in the plane of x and y.
fn directions(subject: &Subject<'_>, angles: [f64; 3]) -> Result<[DVec3; 3], SourceError> {
    // Left out by the writer.
    if angles == [0.0; 3] || angles == [90.0; 3] {
        return Ok([DVec3::X, DVec3::Y, DVec3::Z]);
    }
    let wrong = || {
        subject.malformed(
            "CELLB",
            "three angles in degrees that a cell can have",
            format!("{angles:?}"),
        )
    };
    if !angles.iter().all(|&a| a > 0.0 && a < 180.0) {
        return Err(wrong());
    }
    let [cos_alpha, cos_beta, cos_gamma] = angles.map(|a| libm::cos(a.to_radians()));
    let sin_gamma = libm::sin(angles[2].to_radians());
    let b = DVec3::new(cos_gamma, sin_gamma, 0.0);
    let c_y = (cos_alpha - cos_beta * cos_gamma) / sin_gamma;
    let c_z_squared = 1.0 - cos_beta * cos_beta - c_y * c_y;
    if c_z_squared <= 0.0 {
        return Err(wrong());
    }
    Ok([DVec3::X, b, DVec3::new(cos_beta, c_y, c_z_squared.sqrt())])
}
