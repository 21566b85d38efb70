//! What the first page says of the whole file: its description in words, and its resolution.

use serde::Deserialize;

use super::directory::{Directory, Tag, Tiff};
use super::imagej::ImageJ;
use crate::input::spacing::INCH;
use crate::volume::SourceError;

const DESCRIPTION: Tag = Tag(270, "ImageDescription");
const X_RESOLUTION: Tag = Tag(282, "XResolution");
const Y_RESOLUTION: Tag = Tag(283, "YResolution");
const RESOLUTION_UNIT: Tag = Tag(296, "ResolutionUnit");

/// Bytes that a description has at most: an OME-XML block of a few hundred thousand planes.
const MOST_TEXT_BYTES: u64 = 64 << 20;

/// Resolutions in dots per inch that programs write when they know none.
const MEANINGLESS_DPI: [f64; 3] = [1.0, 72.0, 96.0];

/// A description that is understood.
pub(super) enum Description {
    /// ImageJ's lines of names and values.
    ImageJ(ImageJ),
    /// OME-XML, not parsed yet.
    Ome(String),
    /// The shape of an array, as tifffile writes it: columns last.
    Shape(Vec<u64>),
    /// None, or anything else.
    Other,
}

/// Voxels per unit of length along x and y, and the unit as TIFF numbers it: 1 none, 2 inch, 3 centimetre.
pub(super) struct Resolution {
    pub(super) per_unit: [Option<f64>; 2],
    unit: u64,
}

impl Description {
    /// The description in a directory.
    ///
    /// # Errors
    /// It is damaged.
    pub(super) fn read(tiff: &Tiff, directory: &Directory) -> Result<Self, SourceError> {
        let bytes = directory.bytes(tiff, DESCRIPTION, MOST_TEXT_BYTES)?;
        let text = text(bytes.unwrap_or_default());
        if text.starts_with("ImageJ=") {
            return Ok(Self::ImageJ(ImageJ::parse(&tiff.subject(), &text)?));
        }
        let is_ome =
            text.trim_start().starts_with('<') && (text.contains("<OME") || text.contains(":OME"));
        if is_ome {
            return Ok(Self::Ome(text));
        }
        // Any other JSON, or what begins like it, is somebody else's.
        let shaped: Option<Shaped> = serde_json::from_str(&text).ok();
        Ok(shaped.map_or(Self::Other, |shaped| Self::Shape(shaped.shape)))
    }
}

#[derive(Deserialize)]
struct Shaped {
    shape: Vec<u64>,
}

impl Resolution {
    /// The resolution in a directory.
    ///
    /// # Errors
    /// Its fields are damaged.
    pub(super) fn read(tiff: &Tiff, directory: &Directory) -> Result<Self, SourceError> {
        let positive = |value: Option<f64>| value.filter(|v| *v > 0.0);
        Ok(Self {
            per_unit: [
                positive(directory.real(tiff, X_RESOLUTION)?),
                positive(directory.real(tiff, Y_RESOLUTION)?),
            ],
            unit: directory.number(tiff, RESOLUTION_UNIT)?.unwrap_or(2),
        })
    }

    /// Distance of voxels along x, y and z as far as it is said, for a file without other metadata.
    pub(super) fn spacing(&self) -> [Option<f64>; 3] {
        let unit = match self.unit {
            2 => INCH,
            3 => 10.0,
            _ => return [None; 3],
        };
        let [x, y] = self.per_unit.map(|per_unit| {
            let spacing = unit / per_unit?;
            let dpi = INCH / spacing;
            let is_meant = MEANINGLESS_DPI
                .iter()
                .all(|known| (dpi - known).abs() > 0.05);
            is_meant.then_some(spacing)
        });
        [x, y, None]
    }
}

/// Text up to its end mark: UTF-8, or Latin-1 as old programs write the micro sign.
fn text(mut bytes: Vec<u8>) -> String {
    if let Some(end) = bytes.iter().position(|&b| b == 0) {
        bytes.truncate(end);
    }
    String::from_utf8(bytes)
        .unwrap_or_else(|e| e.into_bytes().into_iter().map(char::from).collect())
}
