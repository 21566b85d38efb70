//! Where an N5 volume lies, as the viewers that are in use write it into attributes; the format itself says nothing.

use glam::DVec3;
use serde_json::Value;

use crate::input::chunked::{json, millimetres};
use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// Spacing and origin in millimetres along x, y and z.
pub(super) struct Place {
    pub(super) spacing: DVec3,
    pub(super) origin: DVec3,
    pub(super) notes: Vec<String>,
}

/// Numbers along x, y and z with a unit.
struct Said {
    spacing: Vec<f64>,
    origin: Vec<f64>,
    unit: Option<String>,
    /// Whether this is level 0's, to be multiplied by how much coarser the level is.
    is_of_level_0: bool,
}

impl Place {
    /// The place of level `level` by its own attributes and its group's; `wished` is the user's spacing.
    ///
    /// # Errors
    /// What is written there is no spacing.
    pub(super) fn find(
        subject: &Subject<'_>,
        [own, group]: [&Value; 2],
        level: usize,
        wished: Option<DVec3>,
    ) -> Result<Self, SourceError> {
        let mut notes = Vec::new();
        let factors = factors(subject, [own, group], level)?;
        let said = match said(subject, own, false)? {
            Some(said) => Some(said),
            None => said_of_group(subject, group)?,
        };
        let unit = said.as_ref().and_then(|s| s.unit.clone());
        let unit_mm = unit.as_deref().and_then(millimetres);
        let Some(said) = said.filter(|_| unit_mm.is_some() || wished.is_none()) else {
            if wished.is_none() {
                notes.push(crate::input::zarr::NO_SPACING.to_owned());
            }
            let spacing = wished.unwrap_or(DVec3::ONE);
            return Ok(Self {
                spacing: spacing * factors,
                origin: spacing * (factors - DVec3::ONE) / 2.0,
                notes,
            });
        };
        if unit_mm.is_none() {
            let unit = unit.map_or("No unit".to_owned(), |u| format!("The unit {}", quoted(&u)));
            notes.push(format!(
                "{unit} is not known: distances are taken as millimetres."
            ));
        } else if wished.is_some() {
            notes.push("The input says its spacing: --spacing was not used.".to_owned());
        }
        let unit_mm = unit_mm.unwrap_or(1.0);
        let of = |list: &[f64], none: f64| {
            DVec3::from_array(std::array::from_fn(|n| {
                list.get(n).copied().unwrap_or(none)
            }))
        };
        let spacing = of(&said.spacing, said.spacing[0]) * unit_mm;
        let origin = of(&said.origin, 0.0) * unit_mm;
        if said.is_of_level_0 {
            return Ok(Self {
                spacing: spacing * factors,
                // A coarse voxel's centre is the mean of those that it stands for.
                origin: origin + spacing * (factors - DVec3::ONE) / 2.0,
                notes,
            });
        }
        Ok(Self {
            spacing,
            origin,
            notes,
        })
    }
}

/// What attributes say of the level that they belong to.
fn said(
    subject: &Subject<'_>,
    attributes: &Value,
    is_of_level_0: bool,
) -> Result<Option<Said>, SourceError> {
    let transform = json::field(attributes, "transform");
    if transform.is_object() && transform.get("scale").is_some() {
        return of_transform(subject, transform).map(Some);
    }
    let with_unit = json::field(attributes, "pixelResolution");
    let (object, name) = if with_unit.is_object() {
        (with_unit, "dimensions")
    } else if with_unit.is_array() {
        (attributes, "pixelResolution")
    } else if json::field(attributes, "resolution").is_array() {
        (attributes, "resolution")
    } else {
        return Ok(None);
    };
    let unit = match json::field(with_unit, "unit").as_str() {
        Some(unit) => Some(unit),
        None => json::field(attributes, "units")
            .get(0)
            .and_then(Value::as_str),
    };
    Ok(Some(Said {
        spacing: distances(subject, object, name)?,
        origin: Vec::new(),
        unit: unit.map(str::to_owned),
        // Those two are written once, and the levels' factors beside them.
        is_of_level_0: is_of_level_0 || attributes.get("downsamplingFactors").is_some(),
    }))
}

/// What a group says: of level 0.
fn said_of_group(subject: &Subject<'_>, group: &Value) -> Result<Option<Said>, SourceError> {
    let found = said(subject, group, true)?;
    Ok(found.map(|said| Said {
        is_of_level_0: true,
        ..said
    }))
}

/// `transform`, whose lists go from z to x or as its `axes` say.
fn of_transform(subject: &Subject<'_>, transform: &Value) -> Result<Said, SourceError> {
    let mut spacing = distances(subject, transform, "scale")?;
    let number = spacing.len();
    let mut origin = match json::field(transform, "translate") {
        Value::Null => vec![0.0; number],
        _ => json::numbers(subject, transform, "translate", number)?,
    };
    let axes = json::field(transform, "axes").as_array();
    let is_x_first = axes.and_then(|a| a.first()?.as_str()) == Some("x");
    if !is_x_first {
        spacing.reverse();
        origin.reverse();
    }
    let unit = json::field(transform, "units")
        .get(0)
        .and_then(Value::as_str);
    Ok(Said {
        spacing,
        origin,
        unit: unit.map(str::to_owned),
        is_of_level_0: false,
    })
}

/// One to three or more numbers above 0.
fn distances(subject: &Subject<'_>, object: &Value, name: &str) -> Result<Vec<f64>, SourceError> {
    let value = json::field(object, name);
    let number = value.as_array().map_or(0, Vec::len);
    let numbers = json::numbers(subject, object, name, number.clamp(1, 8))?;
    if numbers.iter().all(|&n| n > 0.0) {
        Ok(numbers)
    } else {
        Err(json::wrong(subject, name, "numbers above 0", value))
    }
}

/// How much coarser a level is than level 0.
fn factors(
    subject: &Subject<'_>,
    [own, group]: [&Value; 2],
    level: usize,
) -> Result<DVec3, SourceError> {
    let list = if own.get("downsamplingFactors").is_some() {
        distances(subject, own, "downsamplingFactors")?
    } else {
        // The group may list them for all levels.
        let lists = ["scales", "downsamplingFactors"].map(|n| json::field(group, n).get(level));
        let Some(Value::Array(list)) = lists.into_iter().flatten().next() else {
            return Ok(DVec3::ONE);
        };
        let numbers = list.iter().filter_map(Value::as_f64);
        numbers.filter(|&n| n.is_finite() && n > 0.0).collect()
    };
    Ok(DVec3::from_array(std::array::from_fn(|n| {
        list.get(n).copied().unwrap_or(1.0)
    })))
}
