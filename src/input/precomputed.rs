//! Neuroglancer precomputed volumes: an `info` file and, for each scale, chunks named by the voxels that they hold.
//!
//! Chunks are raw, x fastest and channels slowest, little-endian; files packed by gzip are unpacked. Resolutions are in
//! nanometres, and voxel (i, j, k) fills the box from there to the next one, so that its centre lies half a voxel further.

use glam::{DVec3, U64Vec3};
use serde_json::Value;

use super::OpenOptions;
use super::chunked::{
    Array, Axes, Axis, Block, Chunks, Found, Packing, Store, json, most_packed_bytes, unpack,
};
use super::problem::{Subject, quoted};
use super::zarr::element;
use crate::volume::{SourceError, VoxelSource};

/// The key of metadata.
pub(super) const INFO: &str = "info";

/// Millimetres in the nanometres of resolutions.
const NANOMETRE: f64 = 1e-6;

/// What a gzip file begins with.
const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];

/// Whether `bytes` look like the `info` of such a volume, damaged or not: other things go by that name.
pub(super) fn is_info(bytes: &[u8]) -> bool {
    String::from_utf8_lossy(bytes).contains("\"scales\"")
}

/// Opens scale `level` of the volume at `location`, 0 the finest.
///
/// # Errors
/// There is none, it can't be fetched, is damaged, or of a kind that is not supported.
pub(super) fn open_level(
    location: &str,
    options: &OpenOptions,
    level: usize,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let volume = Volume::find(location, options)?;
    let place = volume.store.place(INFO);
    let subject = Subject::new(&place);
    let (scale, found) = volume.scale(&subject, level, options)?;
    found.open(&subject, Box::new(scale))
}

/// The sizes of all scales at `location`, the finest first.
///
/// # Errors
/// As [`open_level`], for any of them.
pub(super) fn levels(location: &str, options: &OpenOptions) -> Result<Vec<U64Vec3>, SourceError> {
    let volume = Volume::find(location, options)?;
    let place = volume.store.place(INFO);
    let subject = Subject::new(&place);
    (0..volume.scales(&subject)?.len())
        .map(|n| Ok(volume.scale(&subject, n, options)?.1.dims()))
        .collect()
}

struct Volume {
    store: Store,
    info: Value,
    stamp: String,
}

impl Volume {
    fn find(location: &str, options: &OpenOptions) -> Result<Self, SourceError> {
        let root = Store::open(location)?;
        let store = match &options.dataset {
            Some(path) => root.below(path)?,
            None => root,
        };
        let place = store.place(INFO);
        let subject = Subject::new(&place);
        let Some(bytes) = store.metadata(INFO)? else {
            return Err(subject.malformed("the folder", "an info file", "none"));
        };
        let hash = xxhash_rust::xxh3::xxh3_64(&bytes);
        Ok(Self {
            info: json::parse(&subject, &bytes)?,
            stamp: format!("metadata {hash:016x} {}", store.changed(INFO)),
            store,
        })
    }

    fn scales(&self, subject: &Subject<'_>) -> Result<&Vec<Value>, SourceError> {
        let scales = json::field(&self.info, "scales");
        scales
            .as_array()
            .filter(|list| (1..=64).contains(&list.len()))
            .ok_or_else(|| json::wrong(subject, "scales", "a list of 1 to 64 scales", scales))
    }

    fn scale(
        &self,
        subject: &Subject<'_>,
        level: usize,
        options: &OpenOptions,
    ) -> Result<(Scale, Found), SourceError> {
        let scales = self.scales(subject)?;
        let Some(scale) = scales.get(level) else {
            let levels = format!("0 to {}", scales.len() - 1);
            return Err(subject.malformed("the levels", levels, level.to_string()));
        };
        let key = json::text(subject, scale, "key")?;
        check_kind(subject, scale)?;
        let array = self.array(subject, scale)?;
        let axes = ["x", "y", "z", "c"].map(Axis::named);
        let chosen = Axes::choose(subject, &axes, &array.shape, &[], options)?;
        let resolution = DVec3::from_slice(&json::numbers(subject, scale, "resolution", 3)?);
        if resolution.min_element() <= 0.0 {
            let found = json::field(scale, "resolution");
            return Err(json::wrong(subject, "resolution", "numbers above 0", found));
        }
        let offset = offset(subject, scale, &array.shape)?;
        let place = DVec3::from_array(offset.map(|o| o as f64)) + 0.5;
        let notes = options
            .spacing
            .map(|_| "The input says its spacing: --spacing was not used.".to_owned());
        let found = Found {
            array: array.clone(),
            spacing: resolution * NANOMETRE,
            origin: place * resolution * NANOMETRE,
            world_from_index: None,
            unit: String::new(),
            name: self.store.name(),
            notes: notes.into_iter().collect(),
            is_remote: self.store.is_remote(),
            axes: chosen,
        };
        let channel = found.axes.fixed.first().map_or(0, |&(_, index)| index);
        Ok((
            Scale {
                // A key may lead to a scale of another volume beside this one: that is not followed.
                store: self.store.below(key)?,
                array,
                offset,
                stamp: format!("{}, channel {channel}", self.stamp),
            },
            found,
        ))
    }

    fn array(&self, subject: &Subject<'_>, scale: &Value) -> Result<Array, SourceError> {
        let three = |object: &Value, name: &str| -> Result<Vec<u64>, SourceError> {
            let sizes = json::sizes(subject, object, name)?;
            if sizes.len() == 3 {
                Ok(sizes)
            } else {
                let found = json::field(object, name);
                Err(json::wrong(subject, name, "three numbers", found))
            }
        };
        let channels = match json::field(&self.info, "num_channels") {
            Value::Null => 1,
            value => value.as_u64().filter(|&n| n > 0).ok_or_else(|| {
                json::wrong(subject, "num_channels", "a whole number above 0", value)
            })?,
        };
        let mut shape = three(scale, "size")?;
        shape.push(channels);
        // Several cuts into chunks may be offered, each whole.
        let cuts = json::field(scale, "chunk_sizes");
        let first = serde_json::json!({ "chunk_sizes": cuts.get(0) });
        let mut chunk = three(&first, "chunk_sizes")?;
        chunk.push(channels);
        let name = json::text(subject, &self.info, "data_type")?;
        let array = Array {
            order: (0..shape.len()).rev().collect(),
            shape,
            chunk,
            voxel_type: element::by_name(subject, name)?,
            is_big_endian: false,
            fill: [0; 8],
        };
        array.check(subject)?;
        Ok(array)
    }
}

/// Refuses shards and encodings that are not built.
fn check_kind(subject: &Subject<'_>, scale: &Value) -> Result<(), SourceError> {
    let remedy =
        "supported are unsharded volumes of encoding raw; write the volume anew so, or as OME-Zarr";
    if !json::field(scale, "sharding").is_null() {
        return Err(subject.unsupported("a sharded precomputed volume", remedy));
    }
    match json::text(subject, scale, "encoding")? {
        "raw" => Ok(()),
        name => Err(subject.unsupported(format!("the encoding {}", quoted(name)), remedy)),
    }
}

/// Where the first voxel lies, in voxels; the last one must be countable, too.
fn offset(subject: &Subject<'_>, scale: &Value, shape: &[u64]) -> Result<[i64; 3], SourceError> {
    let value = json::field(scale, "voxel_offset");
    if value.is_null() {
        return Ok([0; 3]);
    }
    let list: Option<Vec<i64>> = value
        .as_array()
        .and_then(|list| list.iter().map(Value::as_i64).collect());
    list.and_then(|list| <[i64; 3]>::try_from(list).ok())
        .filter(|o| {
            o.iter()
                .zip(shape)
                .all(|(o, &s)| o.checked_add_unsigned(s).is_some())
        })
        .ok_or_else(|| json::wrong(subject, "voxel_offset", "three whole numbers", value))
}

/// The chunks of a scale.
struct Scale {
    store: Store,
    array: Array,
    offset: [i64; 3],
    stamp: String,
}

impl Chunks for Scale {
    fn read(&self, index: &[u64]) -> Result<Option<Block>, SourceError> {
        let mut extent = self.array.chunk.clone();
        let mut names = Vec::with_capacity(3);
        for axis in 0..3 {
            // Inside the volume, whose last voxel can be counted: no overflow.
            let begin = index[axis] * self.array.chunk[axis];
            extent[axis] = extent[axis].min(self.array.shape[axis] - begin);
            let first = self.offset[axis].saturating_add_unsigned(begin);
            names.push(format!(
                "{first}-{}",
                first.saturating_add_unsigned(extent[axis])
            ));
        }
        let mut key = names.join("_");
        let bytes = extent.iter().product::<u64>() * self.array.voxel_type.size() as u64;
        let most_bytes = most_packed_bytes(bytes);
        let mut packed = self.store.whole(&key, most_bytes)?;
        if packed.is_none() && !self.store.is_remote() {
            // So some writers name on disk what a server would send with an encoding.
            key += ".gz";
            packed = self.store.whole(&key, most_bytes)?;
        }
        let Some(packed) = packed else {
            return Ok(None);
        };
        let is_gzip = packed.len() as u64 != bytes && packed.starts_with(GZIP_MAGIC);
        let packings: &[Packing] = if is_gzip || key.ends_with(".gz") {
            &[Packing::Gzip]
        } else {
            &[]
        };
        let path = self.store.place(&key);
        let bytes = unpack(
            &Subject::new(&path),
            "the chunk",
            packings,
            packed,
            bytes as usize,
        )?;
        Ok(Some(Block { bytes, extent }))
    }

    fn stamp(&self) -> String {
        self.stamp.clone()
    }
}

#[cfg(test)]
mod tests;
