//! Is what was filled an organ, or has it run out of one?
//!
//! Tubes may end at the volume's faces: a scan cuts a trachea, an aorta. The lumen has leaked when it covers more than a
//! quarter of some face, or more than a twentieth of each of three: then it is the air around the body, or a whole tissue.

use glam::U64Vec3;

use super::error::CenterlineError;
use super::fill::Component;

const MOST_OF_ONE: f64 = 0.25;
const MOST_OF_THREE: f64 = 0.05;

/// Refuses a component that covers too much of the volume's faces.
///
/// # Errors
/// [`CenterlineError::Leak`], with the faces.
pub(super) fn check(component: &Component, dims: U64Vec3) -> Result<(), CenterlineError> {
    let mut counts = [0u64; 6];
    for (start, row) in component.rows() {
        let n = u64::from(row.count_ones());
        for (axis, faces) in [(1, 2..4), (2, 4..6)] {
            let faces: Vec<usize> = faces.collect();
            counts[faces[0]] += if start[axis] == 0 { n } else { 0 };
            counts[faces[1]] += if start[axis] + 1 == dims[axis] { n } else { 0 };
        }
        counts[0] += u64::from(start.x == 0 && row & 1 == 1);
        let last = dims.x - 1;
        counts[1] += u64::from(last - start.x < 32 && row >> (last - start.x).min(31) & 1 == 1);
    }
    let area = |axis: usize| dims.as_dvec3().element_product() / dims[axis] as f64;
    let names = ["low x", "high x", "low y", "high y", "low z", "high z"];
    let faces: Vec<(&'static str, f64)> = (0..6)
        // A volume that is one voxel thin has nothing but faces there.
        .filter(|f| dims[f / 2] > 1)
        .map(|f| (names[f], counts[f] as f64 / area(f / 2)))
        .filter(|(_, share)| *share > MOST_OF_THREE)
        .collect();
    if faces.len() >= 3 || faces.iter().any(|(_, share)| *share > MOST_OF_ONE) {
        return Err(CenterlineError::Leak { faces });
    }
    Ok(())
}
