//! `zarr.json`: the metadata of a group or an array of Zarr format 3, sharded or not.

use serde_json::Value;

use super::chunks::{Keys, Layout, Pipeline, Shard};
use super::element;
use super::node::{ArrayNode, Node, check_format};
use crate::input::chunked::{Array, Packing, json};
use crate::input::problem::{Subject, quoted};
use crate::volume::{SourceError, VoxelType};

/// Inner chunks that a shard has at most: its index is held whole.
const MOST_INNER_CHUNKS: u64 = 1 << 22;

/// Members of an array's metadata that are understood, or harmless.
const MEMBERS: &[&str] = &[
    "zarr_format",
    "node_type",
    "shape",
    "data_type",
    "chunk_grid",
    "chunk_key_encoding",
    "fill_value",
    "codecs",
    "attributes",
    "storage_transformers",
    "dimension_names",
    "consolidated_metadata",
];

/// The node that `metadata` describe.
///
/// # Errors
/// They are damaged, or the array is of a kind that is not supported.
pub(super) fn node(
    subject: &Subject<'_>,
    metadata: Value,
    stamp: String,
) -> Result<Node, SourceError> {
    check_format(subject, &metadata, 3)?;
    let attributes = json::field(&metadata, "attributes").clone();
    match json::text(subject, &metadata, "node_type")? {
        "group" => Ok(Node::Group {
            attributes,
            key: "zarr.json",
        }),
        "array" => Ok(Node::Array(Box::new(ArrayNode {
            layout: layout(subject, &metadata)?,
            names: names(&metadata),
            key: "zarr.json",
            stamp,
        }))),
        _ => {
            let found = json::field(&metadata, "node_type");
            Err(json::wrong(subject, "node_type", "group or array", found))
        }
    }
}

fn names(metadata: &Value) -> Option<Vec<String>> {
    let list = json::field(metadata, "dimension_names").as_array()?;
    list.iter().map(|v| v.as_str().map(str::to_owned)).collect()
}

fn layout(subject: &Subject<'_>, metadata: &Value) -> Result<Layout, SourceError> {
    for (name, value) in metadata.as_object().into_iter().flatten() {
        let may_be_ignored = json::field(value, "must_understand") == &Value::Bool(false);
        if !MEMBERS.contains(&name.as_str()) && !may_be_ignored {
            return Err(subject.unsupported(
                format!("the extension {}", quoted(name)),
                "write the array anew without it",
            ));
        }
    }
    if let Value::Array(list) = json::field(metadata, "storage_transformers")
        && !list.is_empty()
    {
        return Err(subject.unsupported("a storage transformer", "write the array anew without it"));
    }
    let voxel_type = match json::field(metadata, "data_type") {
        Value::String(name) => element::by_name(subject, name)?,
        other => return Err(element::unsupported(subject, &other.to_string())),
    };
    let shape = json::sizes(subject, metadata, "shape")?;
    let grid = json::field(metadata, "chunk_grid");
    if json::text(subject, grid, "name")? != "regular" {
        return Err(subject.unsupported(
            format!(
                "a grid of chunks {}",
                json::shown(json::field(grid, "name"))
            ),
            "supported are regular grids",
        ));
    }
    let outer = json::sizes(subject, json::field(grid, "configuration"), "chunk_shape")?;
    let codecs = Codecs::parse(
        subject,
        json::field(metadata, "codecs"),
        shape.len(),
        voxel_type,
    )?;
    let (chunk, packings, shard) = match codecs.sharding {
        None => (outer, codecs.packings, None),
        Some(sharding) => {
            let per_shard = per_shard(subject, &outer, &sharding.chunk)?;
            let shard = Shard {
                per_shard,
                index_at_end: sharding.index_at_end,
                index_has_checksum: sharding.index_has_checksum,
            };
            (sharding.chunk, sharding.packings, Some(shard))
        }
    };
    let array = Array {
        shape,
        chunk,
        order: codecs.order,
        voxel_type,
        is_big_endian: codecs.is_big_endian,
        fill: element::fill(subject, voxel_type, json::field(metadata, "fill_value"))?,
    };
    array.check(subject)?;
    Ok(Layout {
        array,
        keys: keys(subject, json::field(metadata, "chunk_key_encoding"))?,
        pipeline: Pipeline { packings, shard },
    })
}

fn keys(subject: &Subject<'_>, encoding: &Value) -> Result<Keys, SourceError> {
    // The name alone is allowed as a short form.
    let name = match encoding {
        Value::String(name) => name.as_str(),
        _ => json::text(subject, encoding, "name")?,
    };
    let (prefix, usual) = match name {
        "default" => ("c", '/'),
        "v2" => ("", '.'),
        _ => {
            return Err(subject.unsupported(
                format!("the chunk keys {}", quoted(name)),
                "supported are default and v2",
            ));
        }
    };
    let separator = match json::field(json::field(encoding, "configuration"), "separator") {
        Value::Null => usual,
        Value::String(text) if text == "/" => '/',
        Value::String(text) if text == "." => '.',
        other => return Err(json::wrong(subject, "separator", ". or /", other)),
    };
    Ok(Keys { prefix, separator })
}

/// Inner chunks of a shard per axis.
fn per_shard(subject: &Subject<'_>, shard: &[u64], chunk: &[u64]) -> Result<Vec<u64>, SourceError> {
    let fits = shard.len() == chunk.len() && shard.iter().zip(chunk).all(|(s, c)| s % c == 0);
    if !fits {
        return Err(subject.malformed(
            "the chunks of a shard",
            format!("sizes that divide the shard's, {shard:?}"),
            format!("{chunk:?}"),
        ));
    }
    let per_shard: Vec<u64> = shard.iter().zip(chunk).map(|(s, c)| s / c).collect();
    let number = per_shard.iter().try_fold(1u64, |n, &p| n.checked_mul(p));
    if number.is_none_or(|n| n > MOST_INNER_CHUNKS) {
        return Err(subject.unsupported(
            format!("a shard of {per_shard:?} chunks"),
            format!("a shard may have at most {MOST_INNER_CHUNKS}"),
        ));
    }
    Ok(per_shard)
}

/// A chain of codecs, understood.
struct Codecs {
    order: Vec<usize>,
    is_big_endian: bool,
    packings: Vec<Packing>,
    sharding: Option<Sharding>,
}

struct Sharding {
    chunk: Vec<u64>,
    packings: Vec<Packing>,
    index_at_end: bool,
    index_has_checksum: bool,
}

/// Name and configuration of a codec.
fn codec<'a>(subject: &Subject<'_>, value: &'a Value) -> Result<(&'a str, &'a Value), SourceError> {
    match value {
        Value::String(name) => Ok((name, &Value::Null)),
        _ => Ok((
            json::text(subject, value, "name")?,
            json::field(value, "configuration"),
        )),
    }
}

fn unsupported(subject: &Subject<'_>, name: &str) -> SourceError {
    subject.unsupported(
        format!("the codec {} at that place", quoted(name)),
        "supported are transpose, then bytes or sharding_indexed, then blosc, gzip, zlib, zstd and crc32c; write the \
         array anew with these",
    )
}

impl Codecs {
    fn parse(
        subject: &Subject<'_>,
        list: &Value,
        axes: usize,
        voxel_type: VoxelType,
    ) -> Result<Self, SourceError> {
        let Some(list) = list.as_array() else {
            return Err(json::wrong(subject, "codecs", "a list of codecs", list));
        };
        let mut order: Vec<usize> = (0..axes).collect();
        let mut packings = Vec::new();
        let mut is_big_endian = None;
        let mut sharding = None;
        for value in list {
            let (name, configuration) = codec(subject, value)?;
            let is_serialised = is_big_endian.is_some() || sharding.is_some();
            match name {
                "transpose" if !is_serialised => {
                    order = transposed(subject, configuration, &order)?;
                }
                "bytes" | "endian" if !is_serialised => {
                    is_big_endian = Some(endian(subject, configuration, voxel_type)?);
                }
                // A transposed shard would have its chunks in another order, too; nobody writes that.
                "sharding_indexed" if !is_serialised && order.is_sorted() => {
                    let (inner, found) = Self::sharding(subject, configuration, axes, voxel_type)?;
                    (order, is_big_endian) = (inner.order, Some(inner.is_big_endian));
                    sharding = Some(found);
                }
                _ => match Packing::of(name) {
                    // A packed shard could only be read whole.
                    Some(packing) if is_serialised && sharding.is_none() => packings.push(packing),
                    _ => return Err(unsupported(subject, name)),
                },
            }
        }
        let Some(is_big_endian) = is_big_endian else {
            let found = Value::Array(list.clone());
            let expected = "a codec that makes bytes of elements (bytes or sharding_indexed)";
            return Err(json::wrong(subject, "codecs", expected, &found));
        };
        Ok(Self {
            order,
            is_big_endian,
            packings,
            sharding,
        })
    }

    /// The codecs of a shard's chunks, and how the shard is made.
    fn sharding(
        subject: &Subject<'_>,
        configuration: &Value,
        axes: usize,
        voxel_type: VoxelType,
    ) -> Result<(Self, Sharding), SourceError> {
        let list = json::field(configuration, "codecs");
        let is_nested = list
            .as_array()
            .into_iter()
            .flatten()
            .any(|c| codec(subject, c).is_ok_and(|(name, _)| name == "sharding_indexed"));
        if is_nested {
            return Err(subject.unsupported(
                "a shard of shards",
                "write the array anew with one level of shards",
            ));
        }
        let inner = Self::parse(subject, list, axes, voxel_type)?;
        let mut index_has_checksum = false;
        let index_codecs = json::field(configuration, "index_codecs");
        for value in index_codecs.as_array().into_iter().flatten() {
            match codec(subject, value)? {
                ("bytes", c) if !endian(subject, c, VoxelType::F64)? => {}
                ("crc32c", _) if !index_has_checksum => index_has_checksum = true,
                (name, _) => {
                    return Err(subject.unsupported(
                        format!("the codec {} of a shard's index", quoted(name)),
                        "supported are bytes (little-endian) and crc32c",
                    ));
                }
            }
        }
        let index_at_end = match json::field(configuration, "index_location") {
            Value::Null => true,
            Value::String(text) if text == "end" => true,
            Value::String(text) if text == "start" => false,
            other => {
                return Err(json::wrong(
                    subject,
                    "index_location",
                    "start or end",
                    other,
                ));
            }
        };
        let sharding = Sharding {
            chunk: json::sizes(subject, configuration, "chunk_shape")?,
            packings: inner.packings.clone(),
            index_at_end,
            index_has_checksum,
        };
        Ok((inner, sharding))
    }
}

/// Whether the codec `bytes` writes the most significant byte first.
fn endian(
    subject: &Subject<'_>,
    configuration: &Value,
    voxel_type: VoxelType,
) -> Result<bool, SourceError> {
    match json::field(configuration, "endian") {
        Value::String(text) if text == "little" => Ok(false),
        Value::String(text) if text == "big" => Ok(true),
        Value::Null if voxel_type.size() == 1 => Ok(false),
        other => Err(json::wrong(subject, "endian", "little or big", other)),
    }
}

/// The order of axes after another transposition.
fn transposed(
    subject: &Subject<'_>,
    configuration: &Value,
    before: &[usize],
) -> Result<Vec<usize>, SourceError> {
    let value = json::field(configuration, "order");
    let wrong = || {
        let expected = format!("the numbers 0 to {}, each once", before.len() - 1);
        json::wrong(subject, "order", &expected, value)
    };
    let list = value.as_array().ok_or_else(wrong)?;
    let order: Option<Vec<usize>> = list
        .iter()
        .map(|v| before.get(usize::try_from(v.as_u64()?).ok()?).copied())
        .collect();
    let order = order.ok_or_else(wrong)?;
    let mut sorted = order.clone();
    sorted.sort_unstable();
    if sorted.into_iter().eq(0..before.len()) {
        Ok(order)
    } else {
        Err(wrong())
    }
}
