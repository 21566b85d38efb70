//! `.zarray`: the metadata of an array of Zarr format 2.

use serde_json::Value;

use super::chunks::{Keys, Layout, Pipeline};
use super::element;
use super::node::{ArrayNode, check_format};
use crate::input::chunked::{Array, Packing, json};
use crate::input::problem::{Subject, quoted};
use crate::volume::SourceError;

/// The array that `metadata` describe.
///
/// # Errors
/// They are damaged, or the array is of a kind that is not supported.
pub(super) fn array(
    subject: &Subject<'_>,
    metadata: &Value,
    attributes: &Value,
    stamp: String,
) -> Result<ArrayNode, SourceError> {
    check_format(subject, metadata, 2)?;
    let dtype = json::field(metadata, "dtype");
    let (voxel_type, is_big_endian) = match dtype {
        Value::String(text) => element::by_numpy(subject, text)?,
        other => return Err(element::unsupported(subject, &other.to_string())),
    };
    let shape = json::sizes(subject, metadata, "shape")?;
    let mut order: Vec<usize> = (0..shape.len()).collect();
    match json::field(metadata, "order").as_str() {
        Some("C") | None => {}
        Some("F") => order.reverse(),
        Some(_) => {
            let found = json::field(metadata, "order");
            return Err(json::wrong(subject, "order", "C or F", found));
        }
    }
    match json::field(metadata, "filters") {
        Value::Null => {}
        Value::Array(list) if list.is_empty() => {}
        Value::Array(list) => {
            let names: Vec<&str> = list.iter().filter_map(|f| f.get("id")?.as_str()).collect();
            return Err(subject.unsupported(
                format!("the filter {}", quoted(&names.join(", "))),
                "write the array anew without filters",
            ));
        }
        other => return Err(json::wrong(subject, "filters", "a list", other)),
    }
    let separator = match json::field(metadata, "dimension_separator") {
        Value::Null => '.',
        Value::String(text) if text == "." || text == "/" => {
            if text == "." {
                '.'
            } else {
                '/'
            }
        }
        other => return Err(json::wrong(subject, "dimension_separator", ". or /", other)),
    };
    let array = Array {
        chunk: json::sizes(subject, metadata, "chunks")?,
        shape,
        order,
        voxel_type,
        is_big_endian,
        fill: element::fill(subject, voxel_type, json::field(metadata, "fill_value"))?,
    };
    array.check(subject)?;
    Ok(ArrayNode {
        layout: Layout {
            keys: Keys {
                prefix: "",
                separator,
            },
            pipeline: Pipeline {
                packings: compressor(subject, json::field(metadata, "compressor"))?,
                shard: None,
            },
            array,
        },
        names: names(attributes),
        key: ".zarray",
        stamp,
    })
}

fn compressor(subject: &Subject<'_>, value: &Value) -> Result<Vec<Packing>, SourceError> {
    if value.is_null() {
        return Ok(Vec::new());
    }
    let name = json::text(subject, value, "id")?;
    Packing::of(name).map(|p| vec![p]).ok_or_else(|| {
        subject.unsupported(
            format!("the compressor {}", quoted(name)),
            Packing::SUPPORTED,
        )
    })
}

/// The names that xarray gives to axes.
fn names(attributes: &Value) -> Option<Vec<String>> {
    let list = json::field(attributes, "_ARRAY_DIMENSIONS").as_array()?;
    list.iter().map(|v| v.as_str().map(str::to_owned)).collect()
}
