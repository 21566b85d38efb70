//! `multiscales` of OME-Zarr: the levels of an image, its axes, and where its voxels lie in the world.

use glam::{DAffine3, DVec3};
use serde_json::Value;

use crate::input::chunked::{Axes, Axis, AxisKind, json, millimetres};
use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// Levels that an image has at most.
const MOST_LEVELS: usize = 64;

/// An image in several resolutions.
#[derive(Debug)]
pub(super) struct Image {
    pub(super) axes: Vec<Axis>,
    pub(super) levels: Vec<Level>,
    /// Names of the channels, where they have some.
    pub(super) channels: Vec<String>,
    /// Images that the group holds; the first one is this.
    pub(super) images: usize,
    /// The whole affine of the first level, where this program wrote it: OME-Zarr has no turned axes.
    pub(super) world_from_first: Option<DAffine3>,
    /// The unit of physical values, from the same place.
    pub(super) unit: String,
}

/// One resolution.
#[derive(Debug)]
pub(super) struct Level {
    /// Of the array, from the group.
    pub(super) path: String,
    /// `None` where nothing is said.
    pub(super) place: Option<Place>,
}

/// Where elements lie along each axis, in the axis's unit.
#[derive(Debug)]
pub(super) struct Place {
    /// Distance of neighbours.
    scale: Vec<f64>,
    /// Of the first one.
    translation: Vec<f64>,
}

/// Where the OME metadata are among a group's attributes: a key of its own since version 0.5.
pub(super) fn ome(attributes: &Value) -> &Value {
    match attributes.get("ome") {
        Some(ome) => ome,
        None => attributes,
    }
}

impl Image {
    /// The first image of a group with `attributes`; `None` where it has none.
    ///
    /// # Errors
    /// The metadata are damaged, or of a kind that is not supported.
    pub(super) fn parse(
        subject: &Subject<'_>,
        attributes: &Value,
    ) -> Result<Option<Self>, SourceError> {
        let ome = ome(attributes);
        let list = match json::field(ome, "multiscales") {
            Value::Null => return Ok(None),
            Value::Array(list) if !list.is_empty() => list,
            other => {
                return Err(json::wrong(
                    subject,
                    "multiscales",
                    "a list of images",
                    other,
                ));
            }
        };
        let image = &list[0];
        let axes = axes(subject, json::field(image, "axes"))?;
        let after = json::field(image, "coordinateTransformations");
        let datasets = json::field(image, "datasets");
        let levels = datasets
            .as_array()
            .filter(|d| (1..=MOST_LEVELS).contains(&d.len()))
            .ok_or_else(|| {
                let expected = format!("a list of 1 to {MOST_LEVELS} levels");
                json::wrong(subject, "datasets", &expected, datasets)
            })?
            .iter()
            .map(|dataset| {
                let own = json::field(dataset, "coordinateTransformations");
                Ok(Level {
                    path: json::text(subject, dataset, "path")?.to_owned(),
                    place: place(subject, [own, after], axes.len())?,
                })
            })
            .collect::<Result<_, SourceError>>()?;
        let channels = json::field(json::field(ome, "omero"), "channels");
        let label = |c: &Value| json::field(c, "label").as_str().map(str::to_owned);
        Ok(Some(Self {
            axes,
            levels,
            channels: channels
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(label)
                .collect(),
            images: list.len(),
            world_from_first: own_affine(attributes),
            unit: json::field(json::field(attributes, OWN), "unit")
                .as_str()
                .unwrap_or_default()
                .to_owned(),
        }))
    }
}

/// Attributes that `extract` writes beside those of OME-Zarr.
const OWN: &str = "brickscope";

/// Three rows of four numbers, if they are an affine that can be used.
fn own_affine(attributes: &Value) -> Option<DAffine3> {
    let rows = json::field(json::field(attributes, OWN), "world_from_index");
    let rows: [[f64; 4]; 3] = serde_json::from_value(rows.clone()).ok()?;
    let column = |n: usize| DVec3::new(rows[0][n], rows[1][n], rows[2][n]);
    let affine = DAffine3::from_cols(column(0), column(1), column(2), column(3));
    let determinant = affine.matrix3.determinant();
    let is_sound = affine.is_finite() && determinant.is_finite() && determinant != 0.0;
    (is_sound && affine.inverse().is_finite()).then_some(affine)
}

/// The axes; those of versions before 0.4 have names only, or are always the same five.
fn axes(subject: &Subject<'_>, list: &Value) -> Result<Vec<Axis>, SourceError> {
    let list = match list {
        Value::Null => return Ok(["t", "c", "z", "y", "x"].map(Axis::named).into()),
        Value::Array(list) => list,
        other => return Err(json::wrong(subject, "axes", "a list of axes", other)),
    };
    list.iter()
        .map(|value| {
            if let Some(name) = value.as_str() {
                return Ok(Axis::named(name));
            }
            let mut axis = Axis::named(json::text(subject, value, "name")?);
            axis.kind = match json::field(value, "type").as_str() {
                Some("space") => AxisKind::Space,
                Some("time") => AxisKind::Time,
                Some("channel") => AxisKind::Channel,
                Some(_) => AxisKind::Other,
                None => axis.kind,
            };
            axis.unit = json::field(value, "unit")
                .as_str()
                .unwrap_or_default()
                .to_owned();
            Ok(axis)
        })
        .collect()
}

/// Scale and translation of all transformations, those of the level first, then those of the image.
fn place(
    subject: &Subject<'_>,
    lists: [&Value; 2],
    axes: usize,
) -> Result<Option<Place>, SourceError> {
    let mut found: Option<Place> = None;
    for list in lists {
        let list = match list {
            Value::Null => continue,
            Value::Array(list) => list,
            other => {
                let expected = "a list of transformations";
                return Err(json::wrong(
                    subject,
                    "coordinateTransformations",
                    expected,
                    other,
                ));
            }
        };
        for transformation in list {
            let kind = json::text(subject, transformation, "type")?;
            let Place { scale, translation } = found.get_or_insert_with(|| Place {
                scale: vec![1.0; axes],
                translation: vec![0.0; axes],
            });
            match kind {
                "identity" => {}
                "scale" => {
                    let by = json::numbers(subject, transformation, "scale", axes)?;
                    for (n, by) in by.into_iter().enumerate() {
                        scale[n] *= by;
                        translation[n] *= by;
                    }
                }
                "translation" => {
                    let by = json::numbers(subject, transformation, "translation", axes)?;
                    for (n, by) in by.into_iter().enumerate() {
                        translation[n] += by;
                    }
                }
                _ => {
                    return Err(subject.unsupported(
                        format!("the transformation {}", quoted(kind)),
                        "supported are scale and translation, written as numbers",
                    ));
                }
            }
        }
    }
    Ok(found)
}

/// What an input says of its place, in millimetres along x, y and z, and what a user should know of it.
pub(super) struct World {
    pub(super) spacing: DVec3,
    pub(super) origin: DVec3,
    pub(super) notes: Vec<String>,
}

impl World {
    /// The place of a volume that takes `xyz` of the axes; `wished` is the user's spacing.
    ///
    /// # Errors
    /// A scale is not above 0.
    pub(super) fn of(
        subject: &Subject<'_>,
        axes: &[Axis],
        chosen: &Axes,
        place: Option<&Place>,
        wished: Option<DVec3>,
    ) -> Result<Self, SourceError> {
        let mut notes = Vec::new();
        let Some(Place { scale, translation }) = place else {
            if wished.is_none() {
                notes.push(NO_SPACING.to_owned());
            }
            return Ok(Self {
                spacing: wished.unwrap_or(DVec3::ONE),
                origin: DVec3::ZERO,
                notes,
            });
        };
        let mut spacing = [None; 3];
        let mut origin = DVec3::ZERO;
        let mut without_unit = Vec::new();
        for (d, axis) in chosen.xyz.iter().enumerate() {
            let Some(n) = *axis else { continue };
            let Axis { name, unit, .. } = &axes[n];
            let unit_mm = millimetres(unit).unwrap_or_else(|| {
                without_unit.push(if unit.is_empty() {
                    name.clone()
                } else {
                    format!("{name} ({})", quoted(unit))
                });
                1.0
            });
            let step = scale[n] * unit_mm;
            if !(step.is_finite() && step > 0.0) {
                return Err(subject.malformed(
                    format!("the scale of axis {}", quoted(name)),
                    "a number above 0",
                    scale[n].to_string(),
                ));
            }
            spacing[d] = Some(step);
            origin[d] = translation[n] * unit_mm;
        }
        // A picture is as thick as its pixels are wide: nothing is said of it.
        let thinnest = spacing
            .iter()
            .flatten()
            .copied()
            .fold(f64::INFINITY, f64::min);
        let mut spacing = DVec3::from_array(spacing.map(|s| s.unwrap_or(thinnest)));
        match (without_unit.is_empty(), wished) {
            (true, Some(_)) => {
                notes.push("The input says its spacing: --spacing was not used.".to_owned())
            }
            (false, Some(wished)) => {
                origin *= wished / spacing;
                spacing = wished;
            }
            (false, None) => notes.push(format!(
                "No unit that is known is given for {}: its numbers are taken as millimetres.",
                without_unit.join(", ")
            )),
            (true, None) => {}
        }
        Ok(Self {
            spacing,
            origin,
            notes,
        })
    }
}

/// Said where nothing tells how far voxels are apart.
pub(in crate::input) const NO_SPACING: &str =
    "The input does not say how far voxels are apart: 1 mm is taken; --spacing sets it.";
