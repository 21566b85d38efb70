//! 3D Slicer's volume property of older versions (`.vp`): nine lines of numbers.
//!
//! Interpolation (0: nearest), shade, diffuse, ambient, specular, its power, opacity, gradient opacity, colours; the last
//! three as in [`super::slicer`]. An empty line says nothing of its matter.

use super::error::{Place, TransferFileError, quoted};
use super::slicer;
use crate::classify::transfer::TransferFunction;

/// What the lines hold.
const LINES: [&str; 9] = [
    "interpolation",
    "shade",
    "diffuse",
    "ambient",
    "specular",
    "specular power",
    "scalar opacity",
    "gradient opacity",
    "colours",
];

/// Is this how such a file begins? One number and nothing else.
pub(super) fn is_first_line(line: &str) -> bool {
    line.trim().parse::<f64>().is_ok()
}

/// The volume property in `text`.
///
/// # Errors
/// A line is missing or not valid.
pub(super) fn parse(text: &str, top: &Place<'_>) -> Result<TransferFunction, TransferFileError> {
    let mut all = text.lines();
    let mut lines = [""; LINES.len()];
    let mut found = 0;
    for (line, text) in lines.iter_mut().zip(&mut all) {
        *line = text.trim();
        found += 1;
    }
    let extra = all.any(|l| !l.trim().is_empty());
    if found < LINES.len() || extra {
        let expected = format!("{} lines ({})", LINES.len(), LINES.join(", "));
        let found = if extra {
            "more".to_owned()
        } else {
            found.to_string()
        };
        return Err(top.malformed("", &expected, &found, "export the volume property again"));
    }
    let place = |at: usize| top.at(format!("line {}, {}", at + 1, LINES[at]));
    let number = |at: usize| match lines[at] {
        "" => Ok(None),
        text => match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(Some(v)),
            _ => Err(place(at).malformed(
                "",
                "a number",
                &quoted(text),
                "export the volume property again",
            )),
        },
    };
    let shade = match number(1)? {
        None => None,
        Some(v) if v == 0.0 || v == 1.0 => Some(v == 1.0),
        Some(v) => {
            return Err(place(1).malformed("", "1 or 0", &v.to_string(), "correct the number"));
        }
    };
    let factors = [number(3)?, number(2)?, number(4)?, number(5)?];
    Ok(TransferFunction {
        gradient_opacity: slicer::gradient_curve(lines[7], &place(7))?,
        lighting: slicer::lighting(factors, &top.at("lines 3 to 6".to_owned()))?,
        shade,
        nearest: number(0)? == Some(0.0),
        ..TransferFunction::new(
            top.stem(),
            slicer::color_curve(lines[8], &place(8))?,
            slicer::opacity_curve(lines[6], &place(6))?,
        )
    })
}
