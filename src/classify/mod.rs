//! What a value looks like: transfer functions, presets, the table that shaders read, and which values can be seen.
//!
//! Pure maths on plain arrays, and the files that transfer functions come in: no textures, no files of volumes, no bricks
//! beyond the 512 bits of an [`Occupancy`].
//! Curves are in *physical* units (HU for CT); tables and ranges are in *stored* values, the ones in bricks.
//!
//! Colours are display values, as VTK and ParaView treat them: no gamma or sRGB conversion anywhere. Opacity holds per
//! opacity unit of length and is corrected when a table is baked (cli.md, "Colour").
//!
//! Visibility is judged on the very table that is rendered with, outward by rounding, so that skipping what is
//! invisible never changes a picture (design.md §2, invariant 4).

mod color;
mod colormaps;
mod curve;
mod files;
mod lut;
mod occupancy;
mod preintegrated;
mod presets;
mod range_table;
mod transfer;
mod visibility;

pub use curve::{
    ColorCurve, ColorPoint, ColorSpace, CurveError, MAX_POINTS, OpacityCurve, OpacityPoint,
};
pub use files::{
    TransferFileError, beyond_paraview, parse_transfer_functions, read_transfer_functions,
    to_paraview,
};
pub use lut::{LUT_ENTRIES, Lut, OpacityCorrection};
pub use occupancy::Occupancy;
pub use preintegrated::{PreintegratedTable, SegmentTables, TransferIntegrals};
pub use presets::{Preset, PresetScale};
pub use transfer::{Lighting, TransferFunction, grey_ramp, window_range};
pub use visibility::{IsoValues, OpacityTable, Visibility};
