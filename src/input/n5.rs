//! N5: arrays whose blocks lie in folders named by their index, x first, each with a small header; voxels big-endian.
//!
//! A location is an array, or a group whose levels are the arrays `s0`, `s1`, … below. Spacing comes from what the common
//! viewers write there: `resolution`, `pixelResolution`, `transform`, `downsamplingFactors`.

mod place;

use glam::U64Vec3;
use serde_json::Value;

use self::place::Place;
use super::OpenOptions;
use super::chunked::{
    Array, Axes, Axis, Block, Chunks, Found, Packing, Store, json, most_packed_bytes, unpack,
};
use super::problem::{Subject, quoted};
use super::zarr::element;
use crate::volume::{SourceError, VoxelSource};

/// The key of metadata.
pub(super) const ATTRIBUTES: &str = "attributes.json";

/// Levels that are looked for.
const MOST_LEVELS: usize = 64;

/// Opens level `level` of the volume at `location`, 0 the finest; an array has that one only.
///
/// # Errors
/// There is none, it can't be fetched, is damaged, or of a kind that is not supported.
pub(super) fn open_level(
    location: &str,
    options: &OpenOptions,
    level: usize,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let volume = Volume::find(location, options)?;
    let (blocks, found) = volume.level(level, options)?;
    let place = blocks.store.place(ATTRIBUTES);
    found.open(&Subject::new(&place), Box::new(blocks))
}

/// The sizes of all levels at `location`, the finest first.
///
/// # Errors
/// As [`open_level`], for any of them.
pub(super) fn levels(location: &str, options: &OpenOptions) -> Result<Vec<U64Vec3>, SourceError> {
    let volume = Volume::find(location, options)?;
    (0..volume.levels.len())
        .map(|n| Ok(volume.level(n, options)?.1.dims()))
        .collect()
}

/// Metadata, with what tells them from others; `None` where there are none.
fn attributes(store: &Store) -> Result<Option<(Value, String)>, SourceError> {
    let Some(bytes) = store.metadata(ATTRIBUTES)? else {
        return Ok(None);
    };
    let place = store.place(ATTRIBUTES);
    let value = json::parse(&Subject::new(&place), &bytes)?;
    let hash = xxhash_rust::xxh3::xxh3_64(&bytes);
    let stamp = format!("metadata {hash:016x} {}", store.changed(ATTRIBUTES));
    Ok(Some((value, stamp)))
}

/// An array, or several of a group.
struct Volume {
    /// Attributes of the group; of nothing where it is an array.
    group: Value,
    levels: Vec<Level>,
    name: String,
}

struct Level {
    store: Store,
    attributes: Value,
    stamp: String,
}

impl Volume {
    fn find(location: &str, options: &OpenOptions) -> Result<Self, SourceError> {
        let root = Store::open(location)?;
        let store = match &options.dataset {
            Some(path) => root.below(path)?,
            None => root,
        };
        let name = store.name();
        let is_array = |value: &Value| value.get("dimensions").is_some();
        let own = attributes(&store)?;
        if let Some((attributes, stamp)) = own {
            if is_array(&attributes) {
                let level = Level {
                    store,
                    attributes,
                    stamp,
                };
                return Ok(Self {
                    group: Value::Null,
                    levels: vec![level],
                    name,
                });
            }
            return Self::group(store, attributes, name);
        }
        // A group needs no attributes of its own.
        Self::group(store, Value::Null, name)
    }

    fn group(store: Store, group: Value, name: String) -> Result<Self, SourceError> {
        let mut levels = Vec::new();
        while levels.len() < MOST_LEVELS {
            let below = store.below(&format!("s{}", levels.len()))?;
            match attributes(&below)? {
                Some((attributes, stamp)) if attributes.get("dimensions").is_some() => {
                    levels.push(Level {
                        store: below,
                        attributes,
                        stamp,
                    });
                }
                _ => break,
            }
        }
        if levels.is_empty() {
            let path = store.place("");
            let subject = Subject {
                path: &path,
                remedy: "name an array, or say which one below with --dataset PATH",
            };
            let children = store.children();
            let below = if children.is_empty() {
                String::new()
            } else {
                format!("; below are {}", quoted(&children.join(", ")))
            };
            return Err(subject.malformed(
                "the group",
                format!("an array of N5 ({ATTRIBUTES} with dimensions), or levels s0, s1, …"),
                format!("neither{below}"),
            ));
        }
        Ok(Self {
            group,
            levels,
            name,
        })
    }

    fn level(&self, number: usize, options: &OpenOptions) -> Result<(Blocks, Found), SourceError> {
        let Some(level) = self.levels.get(number) else {
            let path = self.levels[0].store.place("");
            return Err(Subject::new(&path).malformed(
                "the levels",
                format!("0 to {}", self.levels.len() - 1),
                number.to_string(),
            ));
        };
        let Level {
            store,
            attributes,
            stamp,
        } = level;
        let place = store.place(ATTRIBUTES);
        let subject = Subject::new(&place);
        let (array, packing) = array(&subject, attributes)?;
        let axes = axes(attributes, array.shape.len());
        let chosen = Axes::choose(&subject, &axes, &array.shape, &[], options)?;
        let place = Place::find(&subject, [attributes, &self.group], number, options.spacing)?;
        let indices: Vec<String> = chosen.fixed.iter().map(|(_, i)| i.to_string()).collect();
        let found = Found {
            array: array.clone(),
            axes: chosen,
            spacing: place.spacing,
            origin: place.origin,
            world_from_index: None,
            unit: String::new(),
            name: self.name.clone(),
            notes: place.notes,
            is_remote: store.is_remote(),
        };
        let blocks = Blocks {
            store: store.clone(),
            array,
            packing,
            stamp: format!("{stamp}, at [{}]", indices.join(", ")),
        };
        Ok((blocks, found))
    }
}

/// The axes: by their names where they have some, else x, y, z and then others without a name.
fn axes(attributes: &Value, number: usize) -> Vec<Axis> {
    let names: Option<Vec<&str>> = json::field(attributes, "axes")
        .as_array()
        .and_then(|list| list.iter().map(Value::as_str).collect());
    match names {
        Some(names) if names.len() == number => names.iter().map(|n| Axis::named(n)).collect(),
        _ => (0..number)
            .map(|n| match ["x", "y", "z"].get(n) {
                Some(name) => Axis::named(name),
                None => Axis::named(&format!("axis {n}")),
            })
            .collect(),
    }
}

/// The array that `attributes` describe, and how its blocks are packed.
fn array(subject: &Subject<'_>, attributes: &Value) -> Result<(Array, Vec<Packing>), SourceError> {
    let shape = json::sizes(subject, attributes, "dimensions")?;
    let array = Array {
        chunk: json::sizes(subject, attributes, "blockSize")?,
        order: (0..shape.len()).rev().collect(),
        shape,
        voxel_type: element::by_name(subject, json::text(subject, attributes, "dataType")?)?,
        is_big_endian: true,
        fill: [0; 8],
    };
    array.check(subject)?;
    // Before version 2 the compression was a text.
    let compression = json::field(attributes, "compression");
    let name = match json::field(attributes, "compressionType").as_str() {
        Some(name) => name,
        None => json::text(subject, compression, "type")?,
    };
    let uses_zlib = json::field(compression, "useZlib") == &Value::Bool(true);
    let packing = match name {
        "raw" => Vec::new(),
        "gzip" if uses_zlib => vec![Packing::Zlib],
        "gzip" => vec![Packing::Gzip],
        "zstd" => vec![Packing::Zstd],
        "blosc" => vec![Packing::Blosc],
        _ => {
            return Err(subject.unsupported(
                format!("the compression {}", quoted(name)),
                "supported are raw, gzip, zstd and blosc; write the array anew with one of these",
            ));
        }
    };
    Ok((array, packing))
}

/// The blocks of an array.
struct Blocks {
    store: Store,
    array: Array,
    packing: Vec<Packing>,
    stamp: String,
}

impl Blocks {
    /// Elements per axis of a block, by its header; what follows is left in `bytes`.
    fn extent(&self, subject: &Subject<'_>, bytes: &mut Vec<u8>) -> Result<Vec<u64>, SourceError> {
        let axes = self.array.shape.len();
        let header = 4 + 4 * axes;
        let Some(head) = bytes.get(..header) else {
            return Err(subject.malformed(
                "the block",
                format!("a header of {header} bytes"),
                format!("{} bytes", bytes.len()),
            ));
        };
        let (start, sizes) = head.as_chunks::<4>().0.split_at(1);
        let [m0, m1, a0, a1] = start[0];
        let (mode, found_axes) = (u16::from_be_bytes([m0, m1]), u16::from_be_bytes([a0, a1]));
        if mode != 0 {
            return Err(subject.unsupported(
                format!("a block of mode {mode}"),
                "supported are blocks of mode 0, with one value per voxel",
            ));
        }
        let extent: Vec<u64> = sizes
            .iter()
            .map(|b| u32::from_be_bytes(*b).into())
            .collect();
        // Blocks at the end of the volume are smaller, none is larger: this bounds what is unpacked.
        let fits = extent.iter().zip(&self.array.chunk).all(|(e, c)| e <= c);
        if usize::from(found_axes) != axes || !fits {
            return Err(subject.malformed(
                "the block's header",
                format!("{axes} sizes up to {:?}", self.array.chunk),
                format!("{found_axes} sizes, {extent:?}"),
            ));
        }
        bytes.drain(..header);
        Ok(extent)
    }
}

impl Chunks for Blocks {
    fn read(&self, index: &[u64]) -> Result<Option<Block>, SourceError> {
        let names: Vec<String> = index.iter().map(u64::to_string).collect();
        let key = names.join("/");
        let most_bytes = most_packed_bytes(self.array.chunk_bytes());
        let Some(mut packed) = self.store.whole(&key, most_bytes)? else {
            return Ok(None);
        };
        let path = self.store.place(&key);
        let subject = Subject::new(&path);
        let extent = self.extent(&subject, &mut packed)?;
        let size = self.array.voxel_type.size() as u64;
        // Not above the chunk's bytes, which were checked.
        let bytes = extent.iter().product::<u64>() * size;
        let bytes = unpack(&subject, "the block", &self.packing, packed, bytes as usize)?;
        Ok(Some(Block { bytes, extent }))
    }

    fn stamp(&self) -> String {
        self.stamp.clone()
    }
}

#[cfg(test)]
mod tests;
