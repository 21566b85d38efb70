//! Transfer functions from files: ParaView's presets (JSON, and the XML of older versions), 3D Slicer's volume properties
//! (`.vp.json`, `.vp`, and the XML of its presets and scenes), ImageJ's look-up tables (`.lut`).
//!
//! The format is told by content, not by name. What is not known and changes no picture is skipped; what would change the
//! picture and can't be done is refused by name. Files are untrusted: sizes are bounded before anything is allocated.

mod error;
mod lut;
mod paraview;
mod paraview_xml;
mod read;
mod slicer;
mod slicer_json;
mod slicer_text;
mod xml;

#[cfg(test)]
mod tests;

pub use error::TransferFileError;
pub use paraview::{beyond_paraview, to_paraview};
pub use read::{parse_transfer_functions, read_transfer_functions};
