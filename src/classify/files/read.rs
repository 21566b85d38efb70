//! A file's transfer functions, whichever format it has.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde_json::Value;

use super::error::{Place, TransferFileError, quoted};
use super::{lut, paraview, paraview_xml, slicer, slicer_json, slicer_text, xml};
use crate::classify::transfer::TransferFunction;

/// Largest file that is read; the collections that ParaView and 3D Slicer bring are below 1 MiB.
const MAX_BYTES: u64 = 32 << 20;

const KNOWN: &str = "a ParaView preset (.json, .xml), a 3D Slicer volume property (.vp.json, .vp, .xml, .mrml) or an \
                     ImageJ look-up table (.lut)";
const REMEDY: &str = "give a file of one of these formats, text in UTF-8";

/// Reads the transfer functions of a file, at least one.
///
/// The format is told by content: ParaView's JSON or XML presets, 3D Slicer's volume properties (`.vp.json`, `.vp`) and
/// preset or scene XML, ImageJ's look-up tables (768 bytes, with a header of NIH Image, or text). Those of ImageJ are
/// [relative](TransferFunction::relative).
///
/// # Errors
/// The file can't be read or is larger than 32 MiB, is of no such format, its curves are not valid (x decreasing, NaN, no
/// point, values outside 0…1), or it asks for what is not built (indexed colours, logarithmic scale).
pub fn read_transfer_functions(path: &Path) -> Result<Vec<TransferFunction>, TransferFileError> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|f| f.take(MAX_BYTES + 1).read_to_end(&mut bytes))
        .map_err(|error| TransferFileError::Io {
            path: path.to_owned(),
            error,
        })?;
    parse_transfer_functions(&bytes, path)
}

/// The transfer functions in `bytes`; `path` is for messages and for names.
///
/// # Errors
/// As [`read_transfer_functions`].
pub fn parse_transfer_functions(
    bytes: &[u8],
    path: &Path,
) -> Result<Vec<TransferFunction>, TransferFileError> {
    let top = Place::top(path);
    if bytes.len() as u64 > MAX_BYTES {
        return Err(top.malformed("", "at most 32 MiB", "more", "is this a preset file?"));
    }
    if lut::has_header(bytes) {
        return Ok(vec![lut::parse_with_header(bytes, &top)?]);
    }
    let bare = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bare).ok().filter(|t| is_text(t));
    let is_table = lut::is_bare(bytes);
    if is_table && text.is_none() {
        return Ok(vec![lut::parse_bare(bytes, &top)?]);
    }
    match (bare.trim_ascii_start().first(), text) {
        (Some(b'{' | b'['), _) => json(bare, &top),
        (Some(b'<'), Some(text)) => markup(text, &top),
        // A table whose every byte happens to be a printable character.
        (_, Some(text)) if is_table && !text.contains('\n') => {
            Ok(vec![lut::parse_bare(bytes, &top)?])
        }
        (Some(_), Some(text)) => match text.lines().find(|l| !l.trim().is_empty()) {
            Some(first) if slicer_text::is_first_line(first) => {
                Ok(vec![slicer_text::parse(text, &top)?])
            }
            Some(first) if lut::is_first_line(first) => Ok(vec![lut::parse_text(text, &top)?]),
            first => Err(top.malformed("", KNOWN, &quoted(first.unwrap_or_default()), REMEDY)),
        },
        (None, _) => Err(top.malformed("", KNOWN, "nothing", REMEDY)),
        (_, None) => {
            let found = format!("{} bytes that are no text", bytes.len());
            Err(top.malformed("", KNOWN, &found, REMEDY))
        }
    }
}

/// Are there no control characters but those that divide lines and columns?
fn is_text(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes.all(|b| b >= b' ' || matches!(b, b'\t' | b'\n' | b'\r' | 0x0c))
}

fn json(bytes: &[u8], top: &Place<'_>) -> Result<Vec<TransferFunction>, TransferFileError> {
    let value: Value = serde_json::from_slice(bytes).map_err(|e| {
        let place = top.at(format!("line {}, column {}", e.line(), e.column()));
        place.malformed("", "JSON", &e.to_string(), "export the preset again")
    })?;
    if slicer_json::is_volume_property(&value) {
        slicer_json::parse(&value, top)
    } else {
        paraview::parse(&value, top)
    }
}

fn markup(text: &str, top: &Place<'_>) -> Result<Vec<TransferFunction>, TransferFileError> {
    let document = xml::parse(text, top)?;
    let elements = |name: &'static str| {
        let all = document.descendants();
        all.filter(move |n| n.is_element() && n.tag_name().name() == name)
    };
    if elements("ColorMap").next().is_some() {
        let maps = elements("ColorMap");
        return maps.map(|e| paraview_xml::parse(e, top)).collect();
    }
    if elements("VolumeProperty").next().is_some() {
        let properties = elements("VolumeProperty");
        return properties.map(|e| slicer::parse_element(e, top)).collect();
    }
    let root = document.root_element().tag_name().name();
    Err(top.malformed(
        "",
        "XML with <ColorMap> (ParaView) or <VolumeProperty> (3D Slicer)",
        &format!("<{}> without", quoted(root).trim_matches('"')),
        "export the colour map or the volume property",
    ))
}
