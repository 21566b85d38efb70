//! The description that ImageJ writes into the first page: lines `name=value` that tell slices, channels, points in time,
//! distances and the calibration of values.

use super::description::Resolution;
use crate::input::problem::{Subject, quoted};
use crate::input::spacing::unit_mm;
use crate::volume::{Rescale, SourceError};

/// What ImageJ says of a stack.
pub(super) struct ImageJ {
    /// Planes, all channels and points in time together.
    pub(super) images: u64,
    pub(super) channels: u64,
    pub(super) slices: u64,
    pub(super) frames: u64,
    /// Units of x, y and z.
    units: [String; 3],
    /// Distance of slices, in the unit of z.
    spacing: Option<f64>,
    pub(super) rescale: Rescale,
    /// Unit of the physical value.
    pub(super) value_unit: String,
    /// Values have a calibration that is no straight line.
    pub(super) is_curved: bool,
}

impl ImageJ {
    /// Understands the description.
    ///
    /// # Errors
    /// A number in it is none, or the numbers of planes contradict each other.
    pub(super) fn parse(subject: &Subject<'_>, text: &str) -> Result<Self, SourceError> {
        let value = |name: &str| {
            text.lines()
                .filter_map(|line| line.split_once('='))
                .find(|(n, _)| *n == name)
                .map(|(_, value)| value.trim())
        };
        let malformed = |name: &str, expected: &str, found: &str| {
            let place = format!("the ImageJ description, {name}");
            subject.malformed(place, expected, quoted(found))
        };
        let count = |name: &str| match value(name) {
            None => Ok(None),
            Some(text) => match text.parse::<u64>() {
                Ok(n) if n > 0 => Ok(Some(n)),
                _ => Err(malformed(name, "a number of at least 1", text)),
            },
        };
        let real = |name: &str| match value(name) {
            None => Ok(None),
            Some(text) => match text.parse::<f64>() {
                Ok(n) if n.is_finite() => Ok(Some(n)),
                _ => Err(malformed(name, "a finite number", text)),
            },
        };
        let channels = count("channels")?.unwrap_or(1);
        let frames = count("frames")?.unwrap_or(1);
        let stated = count("slices")?;
        let others = channels.checked_mul(frames);
        let product = others.and_then(|n| n.checked_mul(stated.unwrap_or(1)));
        let images = count("images")?;
        let (slices, images) = match (stated, images, others, product) {
            (Some(slices), None, _, Some(product)) => (slices, product),
            (Some(slices), Some(images), _, Some(product)) if product == images => (slices, images),
            (None, images, Some(others), _) if images.unwrap_or(others) % others == 0 => {
                let images = images.unwrap_or(others);
                (images / others, images)
            }
            _ => {
                let found = format!(
                    "{} channels, {} slices, {frames} frames",
                    channels,
                    stated.unwrap_or(1)
                );
                let images = images.map_or("less than 2^64".to_owned(), |n| n.to_string());
                return Err(malformed("images", &format!("{images} planes"), &found));
            }
        };
        let unit = value("unit").unwrap_or_default();
        let is_line = value("cf") == Some("0");
        let rescale = Rescale {
            slope: real("c1")?.unwrap_or(1.0),
            intercept: real("c0")?.unwrap_or(0.0),
        };
        let is_calibrated = is_line && rescale.slope != 0.0;
        Ok(Self {
            images,
            channels,
            slices,
            frames,
            units: ["xunit", "yunit", "zunit"].map(|name| value(name).unwrap_or(unit).to_owned()),
            // A negative one was written for stacks that go down.
            spacing: real("spacing")?.map(f64::abs),
            rescale: if is_calibrated {
                rescale
            } else {
                Rescale::IDENTITY
            },
            value_unit: match value("vunit") {
                Some(unit) if is_calibrated && unit != "Gray Value" => unit.to_owned(),
                _ => String::new(),
            },
            // 20 is no calibration, 21 stands for uncalibrated optical densities of 8 bits.
            is_curved: !is_line && value("cf").is_some_and(|cf| cf != "20"),
        })
    }

    /// Distance of voxels along x, y and z, with a remark where it is in no unit of length. A slice in a file of its own
    /// (`is_slice`) says nothing of the distance to the next unless it is named.
    pub(super) fn spacing(
        &self,
        resolution: &Resolution,
        is_slice: bool,
    ) -> ([Option<f64>; 3], Option<String>) {
        let [x_unit, y_unit, z_unit] = self.units.each_ref().map(|unit| unit_mm(unit));
        let Some(x_unit) = x_unit else {
            return match self.spacing {
                Some(spacing) if spacing > 0.0 && spacing != 1.0 => {
                    let note = "ImageJ's distances are in voxels: a voxel is taken to be 1 mm wide; give --spacing \
                                x,y,z if it is not.";
                    ([Some(1.0), Some(1.0), Some(spacing)], Some(note.to_owned()))
                }
                _ => (resolution.spacing(), None),
            };
        };
        let [x, y] = resolution.per_unit;
        // ImageJ leaves out a distance of 1.
        let z = self.spacing.or((!is_slice).then_some(1.0));
        let spacing = [
            x.map(|n| x_unit / n),
            y.map(|n| y_unit.unwrap_or(x_unit) / n),
            z.filter(|z| *z > 0.0).map(|z| z_unit.unwrap_or(x_unit) * z),
        ];
        (spacing, None)
    }
}
