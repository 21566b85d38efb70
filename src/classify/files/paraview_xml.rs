//! ParaView's colour maps of older versions: `<ColorMap name space><Point x o r g b/>…</ColorMap>`, alone or in
//! `<ColorMaps>`.
//!
//! x is taken as physical value, as it stands; points are sorted by it, as ParaView does. ParaView itself ignores `o`, and
//! writes a constant there; where it varies it was meant, and is the opacity. `<NaN>`, `<Section>` and annotations are
//! skipped.

use roxmltree::Node;

use super::error::{Place, TransferFileError, quoted};
use super::paraview::{SUPPORTED_SPACES, color_space, near_unit, ramp_over};
use super::xml;
use crate::classify::curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
use crate::classify::transfer::TransferFunction;

/// The colour map of a `<ColorMap>`.
///
/// # Errors
/// A point is not complete, the curves are not valid, or it is indexed or of another colour space.
pub(super) fn parse(
    element: Node<'_, '_>,
    top: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let line = element.document().text_pos_at(element.range().start).row;
    let name = element.attribute("name").unwrap_or_default();
    let mut place = top.at(format!("line {line}, ColorMap"));
    if !name.is_empty() {
        place.name(name);
    }
    if xml::switch(element, "indexedLookup", &place)? == Some(true) {
        return Err(place.unsupported(
            "an indexed look-up (categories)",
            "give it a colour for each value, and indexedLookup=\"false\"",
        ));
    }
    let space = match element.attribute("space") {
        None | Some("NoChange") => ColorSpace::Rgb,
        Some("Wrapped") => ColorSpace::HsvWrapped,
        Some(name) => color_space(name).ok_or_else(|| {
            place.unsupported(
                &format!("the colour space {}", quoted(name)),
                SUPPORTED_SPACES,
            )
        })?,
    };
    let is_point = |n: &Node<'_, '_>| n.is_element() && n.tag_name().name() == "Point";
    let elements = element.children().filter(is_point);
    let count = elements.clone().count();
    if count > MAX_POINTS {
        return Err(place.curve("Point", CurveError::TooMany(count)));
    }
    let mut points = Vec::with_capacity(count);
    for (i, point) in elements.enumerate() {
        points.push(read_point(
            point,
            &place.within(&format!("point {}", i + 1)),
        )?);
    }
    points.sort_by(|a, b| a.color.x.total_cmp(&b.color.x));
    let color = ColorCurve::new(points.iter().map(|p| p.color).collect(), space)
        .map_err(|e| place.curve("Point", e))?;
    let first = points[0].opacity;
    let opacities: Option<Vec<OpacityPoint>> = points
        .iter()
        .map(|p| Some(OpacityPoint::linear(p.color.x, near_unit(p.opacity?))))
        .collect();
    let varies = points.iter().any(|p| p.opacity != first);
    let opacity = match opacities {
        Some(opacities) if varies => opacities,
        None if varies => {
            return Err(place.malformed(
                "Point",
                "an opacity (o) at every point or at none",
                "some",
                "add the missing ones",
            ));
        }
        _ => ramp_over(&color),
    };
    let opacity = OpacityCurve::new(opacity).map_err(|e| place.curve("Point", e))?;
    Ok(TransferFunction::new(name, color, opacity))
}

struct Point {
    color: ColorPoint,
    opacity: Option<f64>,
}

fn read_point(element: Node<'_, '_>, place: &Place<'_>) -> Result<Point, TransferFileError> {
    let needed = |attribute: &str| {
        xml::number(element, attribute, place)?
            .ok_or_else(|| place.malformed(attribute, "a number", "nothing", "add the attribute"))
    };
    Ok(Point {
        color: ColorPoint {
            x: needed("x")?,
            rgb: [
                near_unit(needed("r")?),
                near_unit(needed("g")?),
                near_unit(needed("b")?),
            ],
        },
        opacity: xml::number(element, "o", place)?,
    })
}
