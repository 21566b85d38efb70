//! What 3D Slicer's volume properties have in common, and their XML: `<VolumeProperty>` in its presets and scenes.
//!
//! A curve is a line of numbers, first how many follow: `x opacity x opacity …` or `x red green blue …`. x is a physical
//! value, that of gradient opacity the gradient's magnitude. Such curves have no midpoints and no sharpness.

use roxmltree::Node;

use super::error::{Place, TransferFileError, quoted};
use super::paraview::near_unit;
use super::xml;
use crate::classify::curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
use crate::classify::transfer::{Lighting, TransferFunction};

/// What VTK takes where a file is silent about one of the factors.
pub(super) const DEFAULT_LIGHTING: Lighting = Lighting {
    ambient: 0.1,
    diffuse: 0.7,
    specular: 0.2,
    shininess: 10.0,
};
/// Greatest factor of light that is taken for one.
const MAX_FACTOR: f64 = 1e6;

/// The volume property of a `<VolumeProperty>`.
///
/// # Errors
/// A curve is missing or not valid, or a number is none.
pub(super) fn parse_element(
    element: Node<'_, '_>,
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let line = element.document().text_pos_at(element.range().start).row;
    let name = element.attribute("name").unwrap_or_default();
    let mut place = top.at(format!("line {line}, VolumeProperty"));
    if !name.is_empty() {
        place.name(name);
    }
    let needed = |attribute: &str| {
        element.attribute(attribute).ok_or_else(|| {
            place.malformed(
                attribute,
                "a count and as many numbers",
                "nothing",
                "export the volume property again",
            )
        })
    };
    let gradient_opacity = match element.attribute("gradientOpacity") {
        Some(text) => gradient_curve(text, &place.within("gradientOpacity"))?,
        None => None,
    };
    let number = |attribute: &str| xml::number(element, attribute, &place);
    let factors = [
        number("ambient")?,
        number("diffuse")?,
        number("specular")?,
        number("specularPower")?,
    ];
    Ok(TransferFunction {
        gradient_opacity,
        lighting: lighting(factors, &place)?,
        shade: xml::switch(element, "shade", &place)?,
        nearest: number("interpolation")? == Some(0.0),
        ..TransferFunction::new(
            name,
            color_curve(needed("colorTransfer")?, &place.within("colorTransfer"))?,
            opacity_curve(needed("scalarOpacity")?, &place.within("scalarOpacity"))?,
        )
    })
}

/// Ambient, diffuse, specular and its power, of which some may be missing; `None` when all are.
///
/// # Errors
/// One is no factor.
pub(super) fn lighting(
    factors: [Option<f64>; 4],
    place: &Place<'_>,
) -> Result<Option<Lighting>, TransferFileError> {
    if factors.iter().all(Option::is_none) {
        return Ok(None);
    }
    let names = ["ambient", "diffuse", "specular", "specularPower"];
    for (name, factor) in names.into_iter().zip(factors) {
        if let Some(v) = factor.filter(|v| !(0.0..=MAX_FACTOR).contains(v)) {
            let expected = format!("a number from 0 to {MAX_FACTOR}");
            return Err(place.malformed(name, &expected, &v.to_string(), "correct the number"));
        }
    }
    let [ambient, diffuse, specular, shininess] = factors;
    Ok(Some(Lighting {
        ambient: ambient.unwrap_or(DEFAULT_LIGHTING.ambient),
        diffuse: diffuse.unwrap_or(DEFAULT_LIGHTING.diffuse),
        specular: specular.unwrap_or(DEFAULT_LIGHTING.specular),
        shininess: shininess.unwrap_or(DEFAULT_LIGHTING.shininess),
    }))
}

/// A curve that multiplies the opacity; `None` when that changes nothing.
pub(super) fn unless_one(curve: OpacityCurve) -> Option<OpacityCurve> {
    let is_one = curve.points().iter().all(|p| p.opacity == 1.0);
    (!is_one).then_some(curve)
}

/// A line of gradient opacity; `None` when it has no point, or is 1 everywhere.
///
/// # Errors
/// As [`opacity_curve`].
pub(super) fn gradient_curve(
    line: &str,
    place: &Place<'_>,
) -> Result<Option<OpacityCurve>, TransferFileError> {
    if matches!(line.trim(), "" | "0") {
        return Ok(None);
    }
    Ok(unless_one(opacity_curve(line, place)?))
}

/// A line of opacities.
///
/// # Errors
/// There are not as many numbers as it says, or they make no curve.
pub(super) fn opacity_curve(
    line: &str,
    place: &Place<'_>,
) -> Result<OpacityCurve, TransferFileError> {
    let points = groups::<2>(line, place)?.into_iter();
    let point = |[x, a]: [f64; 2]| OpacityPoint::linear(x, near_unit(a));
    OpacityCurve::new(points.map(point).collect()).map_err(|e| place.curve("", e))
}

/// A line of colours.
///
/// # Errors
/// As [`opacity_curve`].
pub(super) fn color_curve(line: &str, place: &Place<'_>) -> Result<ColorCurve, TransferFileError> {
    let points = groups::<4>(line, place)?.into_iter();
    let point = |[x, r, g, b]: [f64; 4]| ColorPoint {
        x,
        rgb: [r, g, b].map(near_unit),
    };
    ColorCurve::new(points.map(point).collect(), ColorSpace::Rgb).map_err(|e| place.curve("", e))
}

/// The numbers after their count, in groups of N.
fn groups<const N: usize>(
    line: &str,
    place: &Place<'_>,
) -> Result<Vec<[f64; N]>, TransferFileError> {
    let remedy = "export the volume property again";
    let mut words = line.split_ascii_whitespace();
    let first = words.next().unwrap_or_default();
    let count = first.parse::<usize>().ok().filter(|c| c % N == 0);
    let Some(count) = count else {
        let expected = format!("how many numbers follow, a multiple of {N}");
        return Err(place.malformed("", &expected, &quoted(first), remedy));
    };
    if count / N > MAX_POINTS {
        return Err(place.curve("", CurveError::TooMany(count / N)));
    }
    let mut numbers = Vec::with_capacity(count);
    for word in words {
        if numbers.len() == count {
            let expected = format!("{count} numbers after their count");
            return Err(place.malformed("", &expected, "more", remedy));
        }
        let number = word.parse::<f64>().map_err(|_| {
            let field = format!("number {}", numbers.len() + 1);
            place.malformed(&field, "a number", &quoted(word), remedy)
        })?;
        numbers.push(number);
    }
    if numbers.len() < count {
        let expected = format!("{count} numbers after their count");
        return Err(place.malformed("", &expected, &numbers.len().to_string(), remedy));
    }
    let (groups, _) = numbers.as_chunks::<N>();
    Ok(groups.to_vec())
}
