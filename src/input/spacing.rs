//! Distances of voxels in formats that may say them in part or not at all: what is missing is assumed, and the user told so.

use glam::{DAffine3, DVec3, U64Vec3};

use super::affine;
use super::options::OpenOptions;
use super::problem::Subject;
use crate::volume::SourceError;

/// Millimetres of an inch.
pub(super) const INCH: f64 = 25.4;

/// Millimetres of a unit of length by any of its usual names; `None` for what is none, such as `pixel`.
pub(super) fn unit_mm(name: &str) -> Option<f64> {
    // Some write the micro sign as an escape, some as the Greek letter.
    let name = name
        .trim()
        .replace("\\u00B5", "\u{b5}")
        .replace("\\u00b5", "\u{b5}")
        .replace('\u{3bc}', "\u{b5}");
    let name = if name.len() > 2 {
        name.to_lowercase()
    } else {
        name
    };
    Some(match name.as_str() {
        "\u{c5}" | "\u{212b}" | "a" | "angstrom" | "angstroms" => 1e-7,
        "pm" | "picometer" | "picometre" => 1e-9,
        "nm" | "nanometer" | "nanometre" | "nanometers" | "nanometres" => 1e-6,
        "um" | "\u{b5}m" | "micron" | "microns" | "micrometer" | "micrometre" | "micrometers"
        | "micrometres" => 1e-3,
        "mm" | "millimeter" | "millimetre" | "millimeters" | "millimetres" => 1.0,
        "cm" | "centimeter" | "centimetre" | "centimeters" | "centimetres" => 10.0,
        "m" | "meter" | "metre" | "meters" | "metres" => 1000.0,
        "in" | "inch" | "inches" => INCH,
        _ => return None,
    })
}

/// The affine of an image without orientation, from the distances in millimetres that were `found`, or from the user's,
/// who always is right. What is assumed goes to `notes`.
///
/// # Errors
/// A distance is not finite and above 0.
pub(super) fn world(
    subject: &Subject<'_>,
    found: [Option<f64>; 3],
    dims: U64Vec3,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<DAffine3, SourceError> {
    if let Some(spacing) = options.spacing {
        for value in spacing.to_array() {
            affine::spacing(subject, "--spacing", value)?;
        }
        return affine::checked(subject, "--spacing", affine::from_spacing(spacing));
    }
    let place = "the distance of voxels";
    for value in found.into_iter().flatten() {
        affine::spacing(subject, place, value)?;
    }
    let assumed = found.into_iter().flatten().next().unwrap_or(1.0);
    let missing: Vec<&str> = ["columns", "rows", "slices"]
        .into_iter()
        .zip(found)
        .zip(dims.to_array())
        .filter(|((_, found), n)| found.is_none() && *n > 1)
        .map(|((axis, _), _)| axis)
        .collect();
    if !missing.is_empty() {
        notes.push(format!(
            "The input does not say the distance of {}: {assumed} mm is taken; give --spacing x,y,z if it is another.",
            missing.join(", ")
        ));
    }
    let spacing = DVec3::from_array(found.map(|value| value.unwrap_or(assumed)));
    affine::checked(subject, place, affine::from_spacing(spacing))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn units_have_many_names() {
        for (name, mm) in [
            ("\\u00B5m", 1e-3),
            ("\u{b5}m", 1e-3),
            ("\u{3bc}m", 1e-3),
            ("Micron", 1e-3),
            ("um", 1e-3),
            ("mm", 1.0),
            ("inch", 25.4),
            ("nm", 1e-6),
            (" cm ", 10.0),
        ] {
            assert_eq!(unit_mm(name), Some(mm), "{name}");
        }
        for name in ["pixel", "", "sec", "reference frame", "Mm"] {
            assert_eq!(unit_mm(name), None, "{name}");
        }
    }

    #[test]
    fn what_is_missing_is_assumed_and_said() {
        let subject = Subject::new(Path::new("a.tif"));
        let read = |found, spacing| {
            let mut notes = Vec::new();
            let options = OpenOptions {
                spacing,
                ..Default::default()
            };
            let world = world(&subject, found, U64Vec3::splat(2), &options, &mut notes);
            (world.map(|w| w.matrix3.diagonal()).ok(), notes)
        };
        let (given, notes) = read([None; 3], Some(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!((given, notes.len()), (Some(DVec3::new(1.0, 2.0, 3.0)), 0));
        let (none, notes) = read([None; 3], None);
        assert_eq!((none, notes.len()), (Some(DVec3::ONE), 1), "nothing found");
        let (flat, notes) = read([Some(0.5), Some(0.25), None], None);
        assert_eq!(
            flat,
            Some(DVec3::new(0.5, 0.25, 0.5)),
            "no distance of slices"
        );
        assert!(notes[0].contains("of slices: 0.5 mm"), "{notes:?}");
        assert_eq!(read([Some(0.0), None, None], None).0, None, "no distance");
        assert_eq!(read([None; 3], Some(DVec3::NAN)).0, None, "not a number");
    }
}
