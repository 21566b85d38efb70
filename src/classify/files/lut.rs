//! ImageJ's look-up tables (`.lut`): colours of 256 places over a range that the file does not know.
//!
//! Three shapes: 256 bytes each of red, green and blue; the same, of 2 to 256 colours, behind the 32 bytes of NIH Image's
//! header; text of 256 rows of red, green and blue from 0 to 255, with or without an index before them and a line of names
//! above. The functions are relative, their opacity is a line from 0 to 1. Between places colours are joined linearly.

use super::error::{Place, TransferFileError, quoted};
use crate::classify::curve::{ColorCurve, ColorPoint, ColorSpace, OpacityCurve, OpacityPoint};
use crate::classify::transfer::TransferFunction;

/// Colours of a table.
const COLORS: usize = 256;
/// What NIH Image's header begins with, and how long it is.
const MAGIC: &[u8] = b"ICOL";
const HEADER_BYTES: usize = 32;
/// Where the header says how many colours there are.
const COUNT_AT: usize = 6;
/// How long tables without a header are; ImageJ takes those of the second length for such, too, and skips what is behind the colours.
const BARE_BYTES: [usize; 2] = [3 * COLORS, 970];

const REMEDY: &str = "save the table again with ImageJ";

/// Is there a header of NIH Image?
pub(super) fn has_header(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// Is it as long as a table without a header?
pub(super) fn is_bare(bytes: &[u8]) -> bool {
    BARE_BYTES.contains(&bytes.len())
}

/// Is this how a table as text begins? Three or four columns.
pub(super) fn is_first_line(line: &str) -> bool {
    matches!(words(line).count(), 3 | 4)
}

/// A table without a header.
pub(super) fn parse_bare(
    bytes: &[u8],
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    planes(bytes, COLORS, top)
}

/// A table behind NIH Image's header.
///
/// # Errors
/// The header says another number of colours than 2 to 256, or they are not all there.
pub(super) fn parse_with_header(
    bytes: &[u8],
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let Some((header, planes_bytes)) = bytes.split_at_checked(HEADER_BYTES) else {
        let expected = format!("a header of {HEADER_BYTES} bytes");
        let found = format!("{} bytes", bytes.len());
        return Err(top.malformed("", &expected, &found, REMEDY));
    };
    let count = usize::from(u16::from_be_bytes([header[COUNT_AT], header[COUNT_AT + 1]]));
    if !(2..=COLORS).contains(&count) {
        let place = top.at(format!("byte {COUNT_AT}"));
        return Err(place.malformed("", "2 to 256 colours", &count.to_string(), REMEDY));
    }
    planes(planes_bytes, count, top)
}

/// All reds, all greens, all blues.
fn planes(
    bytes: &[u8],
    count: usize,
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let Some(bytes) = bytes.get(..3 * count) else {
        let expected = format!("{} bytes of colours", 3 * count);
        let found = bytes.len().to_string();
        return Err(top.malformed("", &expected, &found, REMEDY));
    };
    let (reds, rest) = bytes.split_at(count);
    let (greens, blues) = rest.split_at(count);
    let unit = |v: u8| f64::from(v) / 255.0;
    // ImageJ spreads fewer colours over the 256 places, and the last one over those that are left.
    let spread = COLORS as f64 / count as f64;
    let points = (0..count).map(|i| ColorPoint {
        x: (i as f64 * spread / 255.0).min(1.0),
        rgb: [unit(reds[i]), unit(greens[i]), unit(blues[i])],
    });
    function(points.collect(), top)
}

/// A table as text.
///
/// # Errors
/// It has not 256 rows, a row has not the columns of the first, a colour is not from 0 to 255, or the index does not rise.
pub(super) fn parse_text(
    text: &str,
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let lines = text.lines().enumerate();
    let mut rows = lines.filter(|(_, l)| !l.trim().is_empty()).peekable();
    // Names of the columns.
    rows.next_if(|(_, line)| words(line).all(|w| w.parse::<f64>().is_err()));
    let columns = rows.peek().map_or(0, |(_, line)| words(line).count());
    if !matches!(columns, 3 | 4) {
        let found = format!("{columns} columns");
        return Err(top.malformed("first row", "3 or 4 columns", &found, REMEDY));
    }
    let mut points = Vec::with_capacity(COLORS);
    let mut previous = f64::NEG_INFINITY;
    for (line, row) in rows {
        let place = top.at(format!("line {}", line + 1));
        if points.len() == COLORS {
            return Err(place.malformed("", "the end after 256 rows", "more", REMEDY));
        }
        let numbers: Option<Vec<f64>> = words(row)
            .map(|w| w.parse::<f64>().ok())
            .take(columns + 1)
            .collect();
        let Some(numbers) = numbers.filter(|n| n.len() == columns) else {
            let expected = format!("{columns} numbers");
            return Err(place.malformed("", &expected, &quoted(row), REMEDY));
        };
        let (index, rgb) = numbers.split_at(columns - 3);
        if let Some(bad) = rgb.iter().find(|v| !(0.0..=255.0).contains(*v)) {
            let found = bad.to_string();
            return Err(place.malformed("", "colours from 0 to 255", &found, REMEDY));
        }
        if let &[index] = index {
            if index.is_nan() || index <= previous {
                let found = index.to_string();
                let expected = "an index that rises, and three colours";
                return Err(place.malformed("", expected, &found, REMEDY));
            }
            previous = index;
        }
        points.push(ColorPoint {
            x: points.len() as f64 / 255.0,
            rgb: std::array::from_fn(|c| rgb[c] / 255.0),
        });
    }
    if points.len() < COLORS {
        let found = format!("{} rows", points.len());
        return Err(top.malformed("", "256 rows of colours", &found, REMEDY));
    }
    function(points, top)
}

fn function(
    points: Vec<ColorPoint>,
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let color = ColorCurve::new(points, ColorSpace::Rgb).map_err(|e| top.curve("colours", e))?;
    let ramp = vec![
        OpacityPoint::linear(0.0, 0.0),
        OpacityPoint::linear(1.0, 1.0),
    ];
    let opacity = OpacityCurve::new(ramp).map_err(|e| top.curve("opacity", e))?;
    Ok(TransferFunction {
        relative: true,
        ..TransferFunction::new(top.stem(), color, opacity)
    })
}

/// What is between blanks, tabs and commas.
fn words(line: &str) -> impl Iterator<Item = &str> {
    let parts = line.split([' ', '\t', ',', '\r']);
    parts.filter(|w| !w.is_empty())
}
