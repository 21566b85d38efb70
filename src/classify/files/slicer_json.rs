//! 3D Slicer's volume property (`.vp.json`, schema volume-property 1.0.0).
//!
//! Points are sorted by x, as Slicer does; those that share an x make a step. Colours may have midpoints and sharpness
//! there, which our colour curves (and ParaView's files) don't know: knots are put between such points, as many as it takes
//! to be closer to the curve than an 8-bit display can show.

use serde_json::{Map, Value};

use super::error::{Place, TransferFileError, short};
use super::paraview::near_unit;
use super::slicer;
use crate::classify::curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
use crate::classify::transfer::TransferFunction;

const REMEDY: &str = "export the volume property again";
/// How far lines between knots may be from the curve, as a share of the way between two colours.
const KNOT_TOLERANCE: f64 = 1.0 / 4096.0;
/// Most halvings between two points.
const MAX_DEPTH: u32 = 12;

/// Is this a file of 3D Slicer's, not one of ParaView's?
pub(super) fn is_volume_property(value: &Value) -> bool {
    value.get("volumeProperties").is_some()
        || value
            .get("@schema")
            .and_then(Value::as_str)
            .is_some_and(|s| s.contains("volume-property-schema"))
}

/// The transfer functions of all components of all volume properties.
///
/// # Errors
/// Something is missing or of the wrong kind, or a curve is not valid.
pub(super) fn parse(
    value: &Value,
    top: &Place<'_>,
) -> Result<Vec<TransferFunction>, TransferFileError> {
    if let Some(schema) = value.get("@schema").and_then(Value::as_str) {
        let version = schema.split_once("volume-property-schema-v");
        if !version.is_some_and(|(_, v)| v.starts_with("1.")) {
            return Err(top.unsupported(
                &format!("the schema {}", short(&Value::from(schema))),
                "export it with a version of 3D Slicer that writes volume-property-schema-v1",
            ));
        }
    }
    let mut functions = Vec::new();
    let properties = items(value, "volumeProperties", top)?;
    for (i, property) in properties.iter().enumerate() {
        let place = top.at(format!("volume property {}", i + 1));
        let nearest = property.get("interpolationType").and_then(Value::as_str) == Some("nearest");
        let components = items(property, "components", &place)?;
        for (k, value) in components.iter().enumerate() {
            let place = place.within(&format!("component {}", k + 1));
            let mut name = top.stem();
            if properties.len() > 1 {
                name += &format!(" {}", i + 1);
            }
            if components.len() > 1 {
                name += &format!(", component {}", k + 1);
            }
            let function = component(value, name, &place)?;
            functions.push(TransferFunction {
                nearest,
                ..function
            });
        }
    }
    Ok(functions)
}

fn component(
    value: &Value,
    name: String,
    place: &Place<'_>,
) -> Result<TransferFunction, TransferFileError> {
    let fields = object(value, place)?;
    let gradient_opacity = match fields.get("gradientOpacity") {
        Some(value) if !switch(fields, "disableGradientOpacity", place)?.unwrap_or(false) => {
            let place = place.within("gradientOpacity");
            if points(value, &place)?.is_empty() {
                None
            } else {
                slicer::unless_one(opacity_curve(value, &place)?)
            }
        }
        _ => None,
    };
    let lighting = match fields.get("lighting") {
        None | Some(Value::Null) => None,
        Some(value) => {
            let place = place.within("lighting");
            let fields = object(value, &place)?;
            let factor = |name: &str| number(fields, name, &place);
            let factors = [
                factor("ambient")?,
                factor("diffuse")?,
                factor("specular")?,
                factor("specularPower")?,
            ];
            slicer::lighting(factors, &place)?
        }
    };
    let opacity_unit_mm = number(fields, "scalarOpacityUnitDistance", place)?;
    if let Some(unit) = opacity_unit_mm.filter(|v| *v <= 0.0) {
        return Err(place.malformed(
            "scalarOpacityUnitDistance",
            "a length above 0",
            &unit.to_string(),
            "correct the length",
        ));
    }
    let needed = |name: &str| {
        let missing = || place.malformed(name, "an object with points", "nothing", REMEDY);
        fields.get(name).ok_or_else(missing)
    };
    let color = color_curve(
        needed("rgbTransferFunction")?,
        &place.within("rgbTransferFunction"),
    )?;
    let opacity = opacity_curve(needed("scalarOpacity")?, &place.within("scalarOpacity"))?;
    Ok(TransferFunction {
        gradient_opacity,
        opacity_unit_mm,
        lighting,
        shade: switch(fields, "shade", place)?,
        ..TransferFunction::new(name, color, opacity)
    })
}

fn opacity_curve(value: &Value, place: &Place<'_>) -> Result<OpacityCurve, TransferFileError> {
    let mut curve = Vec::new();
    for (i, value) in points(value, place)?.iter().enumerate() {
        let place = place.within(&format!("point {}", i + 1));
        let fields = object(value, &place)?;
        let [midpoint, sharpness] = shape(fields, &place)?;
        curve.push(OpacityPoint {
            x: needed(fields, "x", &place)?,
            opacity: near_unit(needed(fields, "y", &place)?),
            midpoint,
            sharpness,
        });
    }
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    OpacityCurve::new(curve).map_err(|e| place.curve("", e))
}

fn color_curve(value: &Value, place: &Place<'_>) -> Result<ColorCurve, TransferFileError> {
    let mut shaped = Vec::new();
    for (i, value) in points(value, place)?.iter().enumerate() {
        let place = place.within(&format!("point {}", i + 1));
        let fields = object(value, &place)?;
        let color = fields.get("color").and_then(Value::as_array);
        let rgb: Option<Vec<f64>> = color.and_then(|c| c.iter().map(Value::as_f64).collect());
        let rgb = rgb.and_then(|c| <[f64; 3]>::try_from(c).ok());
        let Some(rgb) = rgb else {
            let found = fields.get("color").map_or("nothing".to_owned(), short);
            return Err(place.malformed("color", "red, green, blue", &found, REMEDY));
        };
        let point = ColorPoint {
            x: needed(fields, "x", &place)?,
            rgb: rgb.map(near_unit),
        };
        shaped.push((point, shape(fields, &place)?));
    }
    shaped.sort_by(|(a, _), (b, _)| a.x.total_cmp(&b.x));
    // Checked before knots are worked out from them.
    let plain = shaped.iter().map(|(p, _)| *p).collect();
    ColorCurve::new(plain, ColorSpace::Rgb).map_err(|e| place.curve("", e))?;
    let points = with_knots(&shaped).map_err(|e| place.curve("", e))?;
    ColorCurve::new(points, ColorSpace::Rgb).map_err(|e| place.curve("", e))
}

/// The points, and between those with a midpoint or a sharpness as many as it takes to follow the curve by lines.
fn with_knots(shaped: &[(ColorPoint, [f64; 2])]) -> Result<Vec<ColorPoint>, CurveError> {
    let mut points = Vec::with_capacity(shaped.len());
    for (i, &(a, [midpoint, sharpness])) in shaped.iter().enumerate() {
        points.push(a);
        let next = shaped.get(i + 1).map(|(b, _)| *b);
        let Some(b) = next.filter(|b| b.x > a.x && b.rgb != a.rgb) else {
            continue;
        };
        // The joint of all three channels is that of an opacity from 0 to 1: the share of `b` in the colour.
        let share = OpacityCurve::new(vec![
            OpacityPoint {
                x: 0.0,
                opacity: 0.0,
                midpoint,
                sharpness,
            },
            OpacityPoint::linear(1.0, 1.0),
        ])?;
        let middle = midpoint.clamp(1e-5, 1.0 - 1e-5);
        let mut knots = Vec::new();
        if sharpness > 0.99 {
            knots.extend([(middle, 0.0), (middle, 1.0)]);
        } else {
            let half = (middle, share.eval(middle));
            halve(&share, (0.0, 0.0), half, MAX_DEPTH, &mut knots);
            // A line needs no knot in its middle.
            if sharpness >= 0.01 || middle != 0.5 {
                knots.push(half);
            }
            halve(&share, half, (1.0, 1.0), MAX_DEPTH, &mut knots);
        }
        if points.len() + knots.len() > MAX_POINTS {
            return Err(CurveError::TooMany(points.len() + knots.len()));
        }
        points.extend(knots.into_iter().map(|(t, w)| ColorPoint {
            x: ((1.0 - t) * a.x + t * b.x).clamp(a.x, b.x),
            rgb: std::array::from_fn(|c| (1.0 - w) * a.rgb[c] + w * b.rgb[c]).map(near_unit),
        }));
    }
    Ok(points)
}

/// Adds the knots between `from` and `to` that the curve needs.
fn halve(
    share: &OpacityCurve,
    from: (f64, f64),
    to: (f64, f64),
    depth: u32,
    knots: &mut Vec<(f64, f64)>,
) {
    let is_off = |part: f64| {
        let t = from.0 + part * (to.0 - from.0);
        (share.eval(t) - (from.1 + part * (to.1 - from.1))).abs() > KNOT_TOLERANCE
    };
    if depth == 0 || ![0.25, 0.5, 0.75].into_iter().any(is_off) {
        return;
    }
    let t = 0.5 * (from.0 + to.0);
    let middle = (t, share.eval(t));
    halve(share, from, middle, depth - 1, knots);
    knots.push(middle);
    halve(share, middle, to, depth - 1, knots);
}

/// Midpoint and sharpness; the middle and a line where they are not said.
fn shape(fields: &Map<String, Value>, place: &Place<'_>) -> Result<[f64; 2], TransferFileError> {
    let of = |name: &'static str, default: f64| {
        let value = near_unit(number(fields, name, place)?.unwrap_or(default));
        if (0.0..=1.0).contains(&value) {
            Ok(value)
        } else {
            let found = value.to_string();
            Err(place.malformed(name, "a number from 0 to 1", &found, "correct the point"))
        }
    };
    Ok([of("midpoint", 0.5)?, of("sharpness", 0.0)?])
}

/// The points of a function, no more than are read.
fn points<'v>(value: &'v Value, place: &Place<'_>) -> Result<&'v [Value], TransferFileError> {
    match value.get("points") {
        Some(Value::Array(points)) if points.len() > MAX_POINTS => {
            Err(place.curve("points", CurveError::TooMany(points.len())))
        }
        Some(Value::Array(points)) => Ok(points),
        other => {
            let found = other.map_or("nothing".to_owned(), short);
            Err(place.malformed("points", "a list", &found, REMEDY))
        }
    }
}

/// A list with something in it.
fn items<'v>(
    value: &'v Value,
    field: &str,
    place: &Place<'_>,
) -> Result<&'v [Value], TransferFileError> {
    match value.get(field) {
        Some(Value::Array(items)) if !items.is_empty() => Ok(items),
        other => {
            let found = other.map_or("nothing".to_owned(), short);
            Err(place.malformed(field, "a list with at least one object", &found, REMEDY))
        }
    }
}

fn object<'v>(
    value: &'v Value,
    place: &Place<'_>,
) -> Result<&'v Map<String, Value>, TransferFileError> {
    let wrong = || place.malformed("", "an object", &short(value), REMEDY);
    value.as_object().ok_or_else(wrong)
}

fn needed(
    fields: &Map<String, Value>,
    name: &str,
    place: &Place<'_>,
) -> Result<f64, TransferFileError> {
    let missing = || place.malformed(name, "a number", "nothing", REMEDY);
    number(fields, name, place)?.ok_or_else(missing)
}

fn number(
    fields: &Map<String, Value>,
    name: &str,
    place: &Place<'_>,
) -> Result<Option<f64>, TransferFileError> {
    match fields.get(name) {
        None => Ok(None),
        Some(value) => match value.as_f64() {
            Some(number) => Ok(Some(number)),
            None => Err(place.malformed(name, "a number", &short(value), REMEDY)),
        },
    }
}

fn switch(
    fields: &Map<String, Value>,
    name: &str,
    place: &Place<'_>,
) -> Result<Option<bool>, TransferFileError> {
    match fields.get(name) {
        None => Ok(None),
        Some(Value::Bool(on)) => Ok(Some(*on)),
        Some(other) => Err(place.malformed(name, "true or false", &short(other), REMEDY)),
    }
}
