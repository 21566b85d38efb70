//! The axes of an NRRD file: which of them are the volume's, and where they lie in the world.

use glam::{DAffine3, DVec3, U64Vec3};

use super::SUPPORTED;
use crate::input::affine;
use crate::input::problem::{Subject, quoted};
use crate::input::text_header::Fields;
use crate::volume::SourceError;

/// Most axes that an NRRD file can have.
const MOST_AXES: usize = 16;

/// One axis of the file that is in space.
struct Axis {
    size: u64,
    /// As read, in the file's space; may be missing.
    direction: Option<DVec3>,
    /// As read, in `units`; may be missing.
    spacing: Option<f64>,
}

/// Sizes and affine of the three axes in space.
pub(super) fn parse(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
) -> Result<(U64Vec3, DAffine3), SourceError> {
    let (name, value) = fields.need(&["dimension"], "the number of axes")?;
    let count = value
        .parse()
        .ok()
        .filter(|n| (1..=MOST_AXES).contains(n))
        .ok_or_else(|| fields.malformed(name, "1 to 16", value))?;
    let mut axes = spatial_axes(subject, fields, count)?;
    if axes.len() > 3 {
        axes.retain(|a| a.size > 1);
    }
    if axes.len() > 3 {
        let sizes: Vec<String> = axes.iter().map(|a| a.size.to_string()).collect();
        let what = format!("{}-D data (sizes {})", axes.len(), sizes.join(" × "));
        return Err(subject.unsupported(what, SUPPORTED));
    }
    let mut dims = [1; 3];
    for (dim, axis) in dims.iter_mut().zip(&axes) {
        *dim = axis.size;
    }
    Ok((U64Vec3::from_array(dims), place(subject, fields, &axes)?))
}

/// The axes that are in space; any other must have one sample.
fn spatial_axes(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
    count: usize,
) -> Result<Vec<Axis>, SourceError> {
    let (name, value) = fields.need(&["sizes"], "the size of each axis")?;
    let sizes = fields.sizes(name, value, count)?;
    let directions = directions(fields, count)?;
    let kinds = fields.get(&["kinds"]).map(|(_, v)| v.split_whitespace());
    let kinds: Vec<&str> = kinds.into_iter().flatten().collect();
    let spacings = match fields.get(&["spacings"]) {
        Some((name, value)) => Some(fields.reals(name, value, count)?),
        None => None,
    };
    let mut axes = Vec::new();
    for (i, &size) in sizes.iter().enumerate() {
        let kind = kinds.get(i).copied().unwrap_or("domain");
        let direction = directions.as_ref().map(|d| d[i]);
        let in_space = match direction {
            Some(direction) => direction.is_some(),
            None => matches!(
                kind.to_ascii_lowercase().as_str(),
                "domain" | "space" | "none" | "???"
            ),
        };
        if in_space {
            axes.push(Axis {
                size,
                direction: direction.flatten(),
                spacing: spacings.as_ref().map(|s| s[i]),
            });
        } else if size > 1 {
            let what = format!(
                "an axis of {size} samples that is not in space (kind {})",
                quoted(kind)
            );
            return Err(subject.unsupported(what, SUPPORTED));
        }
    }
    Ok(axes)
}

/// `space directions`: a vector or `none` per axis.
fn directions(
    fields: &Fields<'_>,
    count: usize,
) -> Result<Option<Vec<Option<DVec3>>>, SourceError> {
    let Some((name, value)) = fields.get(&["space directions"]) else {
        return Ok(None);
    };
    let bad = || fields.malformed(name, &format!("{count} vectors (x,y,z) or none"), value);
    let mut directions = Vec::new();
    let mut rest = value.trim_start();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            directions.push(None);
            rest = after.trim_start();
        } else {
            let end = rest.find(')').ok_or_else(bad)? + 1;
            directions.push(Some(vector(&rest[..end]).ok_or_else(bad)?));
            rest = rest[end..].trim_start();
        }
    }
    if directions.len() == count {
        Ok(Some(directions))
    } else {
        Err(bad())
    }
}

/// `(x,y,z)`.
fn vector(text: &str) -> Option<DVec3> {
    let inner = text.trim().strip_prefix('(')?.strip_suffix(')')?;
    let parts: Option<Vec<f64>> = inner.split(',').map(|p| p.trim().parse().ok()).collect();
    <[f64; 3]>::try_from(parts?).ok().map(DVec3::from_array)
}

/// What multiplies the coordinates of the file's space to give RAS; `None`: the file names no space.
fn ras_from_space(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
) -> Result<Option<DVec3>, SourceError> {
    let Some((name, value)) = fields.get(&["space"]) else {
        return Ok(None);
    };
    Ok(Some(match value.to_ascii_lowercase().as_str() {
        "right-anterior-superior" | "ras" | "scanner-xyz" | "3d-right-handed" => DVec3::ONE,
        // A left-handed frame of no anatomy: one axis is turned, so that objects are not mirrored.
        "left-anterior-superior" | "las" | "3d-left-handed" => DVec3::new(-1.0, 1.0, 1.0),
        "left-posterior-superior" | "lps" => affine::RAS_FROM_LPS,
        v if v.ends_with("-time") || matches!(v, "rast" | "last" | "lpst") => {
            return Err(subject.unsupported(format!("space {value} (4-D)"), SUPPORTED));
        }
        _ => return Err(fields.malformed(name, "a space that NRRD knows, such as LPS", value)),
    }))
}

/// Millimetres per unit of the field `name`, whose first quoted unit counts; unknown units are taken for millimetres.
fn mm_per_unit(fields: &Fields<'_>, name: &'static str) -> f64 {
    let unit = fields.get(&[name]).and_then(|(_, v)| {
        v.split('"')
            .skip(1)
            .step_by(2)
            .find(|u| !u.trim().is_empty())
    });
    match unit.map(str::trim) {
        Some("m" | "meter" | "metre" | "meters" | "metres") => 1000.0,
        Some("cm") => 10.0,
        Some("um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometre") => 0.001,
        Some("nm") => 1e-6,
        _ => 1.0,
    }
}

/// The affine of up to three axes in space.
fn place(
    subject: &Subject<'_>,
    fields: &Fields<'_>,
    axes: &[Axis],
) -> Result<DAffine3, SourceError> {
    let space = ras_from_space(subject, fields)?;
    let directions: Vec<DVec3> = axes.iter().filter_map(|a| a.direction).collect();
    if directions.is_empty() {
        let mm = mm_per_unit(fields, "units");
        return without_orientation(subject, "spacings", axes.iter().map(|a| a.spacing), mm);
    }
    let mm = mm_per_unit(fields, "space units");
    let Some(signs) = space else {
        let lengths = directions.iter().map(|d| Some(d.length()));
        return without_orientation(subject, "space directions", lengths, mm);
    };
    let origin = match fields.get(&["space origin"]) {
        Some((name, value)) => {
            vector(value).ok_or_else(|| fields.malformed(name, "a vector (x,y,z)", value))?
        }
        None => DVec3::ZERO,
    };
    let columns = match directions[..] {
        [x, y, z] => [x, y, z],
        [x, y] => [x, y, x.cross(y).normalize_or_zero() * x.length()],
        _ => {
            let what = format!("{}-D data", directions.len());
            return Err(subject.unsupported(what, SUPPORTED));
        }
    };
    let affine = affine::from_axes(columns, origin, signs * mm);
    affine::checked(
        subject,
        "fields 'space directions' and 'space origin'",
        affine,
    )
}

/// Identity with a spacing per axis; 1 where there is none.
fn without_orientation(
    subject: &Subject<'_>,
    name: &str,
    spacings: impl Iterator<Item = Option<f64>>,
    mm: f64,
) -> Result<DAffine3, SourceError> {
    let place = format!("field '{name}'");
    let mut spacing = [mm; 3];
    for (out, value) in spacing.iter_mut().zip(spacings) {
        if let Some(value) = value {
            *out = affine::spacing(subject, &place, value)? * mm;
        }
    }
    affine::checked(
        subject,
        &place,
        affine::from_spacing(DVec3::from_array(spacing)),
    )
}
