//! OME-Zarr 0.5: a pyramid of the store's levels as Zarr v3 arrays, sharded, each chunk compressed by zstd.
//!
//! OME-Zarr has scale and translation, but no turned axes and no rescale. Where a volume has a rescale, its physical values are
//! written, in the smallest type that holds them exactly; the whole affine is written, too, as an attribute of our own
//! (`brickscope.world_from_index`, three rows of four), which our reader takes up again.
//!
//! Streams: a shard is in memory at a time, raw and compressed.

use std::fs;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::writer::ExportError;
use crate::geom::{Lod, VoxelBox};
use crate::outfile::{Existing, OutFolder};
use crate::store::{BrickReader, Store, StoreError};
use crate::volume::{Rescale, VolumeDesc, VoxelType};

/// Voxels along an edge of a chunk: two bricks.
const CHUNK_EDGE: u64 = 64;
/// Most chunks of a shard along an axis.
const SHARD_CHUNKS: u64 = 4;
/// Bytes of a shard, uncompressed, at most.
const SHARD_BYTES: u64 = 128 << 20;
const ZSTD_LEVEL: i32 = 3;
/// What every group and array has, and by which a folder is told that may be replaced.
pub(super) const MARK: &str = "zarr.json";

/// What `voxels` of level `lod` become: in which type, and from source values by which rescale.
pub(super) fn output(desc: &VolumeDesc, value_range: [f64; 2]) -> (VoxelType, Rescale) {
    let Rescale { slope, intercept } = desc.rescale;
    if desc.rescale == Rescale::IDENTITY {
        return (desc.voxel_type, Rescale::IDENTITY);
    }
    let is_whole = !desc.voxel_type.is_real() && slope.fract() == 0.0 && intercept.fract() == 0.0;
    let ends = value_range.map(|v| desc.rescale.physical(v));
    let holds = |low: f64, high: f64| is_whole && ends.iter().all(|&v| v >= low && v <= high);
    let voxel_type = if holds(f64::from(i16::MIN), f64::from(i16::MAX)) {
        VoxelType::I16
    } else if holds(f64::from(i32::MIN), f64::from(i32::MAX)) {
        VoxelType::I32
    } else {
        VoxelType::F64
    };
    (voxel_type, desc.rescale)
}

/// Has the affine axes along the world's, in their directions?
pub(super) fn is_upright(affine: &DAffine3) -> bool {
    let spacing = diagonal(affine);
    spacing.min_element() > 0.0 && affine.matrix3 == DMat3::from_diagonal(spacing)
}

fn diagonal(affine: &DAffine3) -> DVec3 {
    let m = affine.matrix3;
    DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z)
}

/// What is written of one level.
struct Level {
    lod: Lod,
    voxels: VoxelBox,
    desc: VolumeDesc,
}

/// Writes `voxels` of level `lod`, and what coarser levels have of them, as the group `path`.
///
/// # Errors
/// A brick is damaged, or a file can't be written. Nothing is left behind then.
pub(super) fn write(
    store: &Store,
    (lod, voxels): (Lod, VoxelBox),
    path: &Path,
    existing: Existing,
    advance: &mut dyn FnMut(u64),
) -> Result<(), ExportError> {
    let levels = levels(store, lod, voxels)?;
    let offset = f64::from(store.meta().conversion.offset);
    let meta = store.meta();
    let stored_range = [meta.value_min - offset, meta.value_max - offset];
    let (voxel_type, rescale) = output(&levels[0].desc, stored_range);
    let folder = OutFolder::create(path, existing, MARK)?;
    let failed = |error| ExportError::Write {
        path: path.to_owned(),
        error,
    };
    let put = |name: &str, value: &Value| {
        let text = format!("{value:#}\n");
        fs::write(folder.path().join(name).join(MARK), text).map_err(failed)
    };
    let mut reader = BrickReader::new().map_err(|error| {
        ExportError::Store(StoreError::Io {
            path: store.path().to_owned(),
            doing: "start decoding",
            error,
        })
    })?;
    let mut encoder = Encoder {
        voxel_type,
        rescale,
        offset,
        stored: Vec::new(),
        chunks: Vec::new(),
    };
    for (number, level) in levels.iter().enumerate() {
        let name = number.to_string();
        fs::create_dir(folder.path().join(&name)).map_err(failed)?;
        let shard = shard(level.voxels.size(), voxel_type);
        put(&name, &array(level.voxels.size(), shard, voxel_type))?;
        for at in places(level.voxels.size(), shard) {
            let low = level.voxels.min + at * shard;
            let part = VoxelBox::new(low, (low + shard).min(level.voxels.max));
            let bytes = encoder.shard(store, level.lod, part, shard, &mut reader)?;
            if let Some(bytes) = bytes {
                let of_z = folder.path().join(&name).join("c").join(at.z.to_string());
                let of_y = of_z.join(at.y.to_string());
                fs::create_dir_all(&of_y).map_err(failed)?;
                fs::write(of_y.join(at.x.to_string()), bytes).map_err(failed)?;
            }
            if number == 0 {
                let count = part.voxel_count().unwrap_or(0);
                advance(count * store.stored_type().size() as u64);
            }
        }
    }
    put("", &group(&levels))?;
    folder.commit()?;
    Ok(())
}

/// The level, and those coarser ones, with the part of each that covers the box.
fn levels(store: &Store, lod: Lod, voxels: VoxelBox) -> Result<Vec<Level>, ExportError> {
    let finest = store.level(lod).scale;
    (usize::from(lod.0)..store.levels())
        .map(|n| {
            let lod = Lod(n as u8);
            let level = store.level(lod);
            let scale = level.scale / finest;
            let low = (voxels.min.as_dvec3() / scale).floor().as_u64vec3();
            let high = (voxels.max.as_dvec3() / scale).ceil().as_u64vec3();
            let voxels = VoxelBox::new(low, high.min(level.grid.voxels));
            let desc = super::extract::extracted(store, lod, voxels)?;
            Ok(Level { lod, voxels, desc })
        })
        .collect()
}

/// Voxels of a shard: whole chunks, no more than the volume needs.
fn shard(dims: U64Vec3, voxel_type: VoxelType) -> U64Vec3 {
    let chunks = dims.map(|d| d.div_ceil(CHUNK_EDGE).min(SHARD_CHUNKS));
    let mut shard = chunks * CHUNK_EDGE;
    while shard.element_product() * voxel_type.size() as u64 > SHARD_BYTES && shard.z > CHUNK_EDGE {
        shard.z -= CHUNK_EDGE;
    }
    shard
}

/// Numbers of the parts of `dims` that are `part` large, x fastest.
fn places(dims: U64Vec3, part: U64Vec3) -> impl Iterator<Item = U64Vec3> {
    let count = U64Vec3::new(
        dims.x.div_ceil(part.x),
        dims.y.div_ceil(part.y),
        dims.z.div_ceil(part.z),
    );
    (0..count.z).flat_map(move |z| {
        (0..count.y).flat_map(move |y| (0..count.x).map(move |x| U64Vec3::new(x, y, z)))
    })
}

/// z, y, x: the order of Zarr's axes here.
fn zyx<T: Copy>([x, y, z]: [T; 3]) -> [T; 3] {
    [z, y, x]
}

/// The metadata of an array (Zarr core specification v3; codec sharding_indexed 1.0).
fn array(dims: U64Vec3, shard: U64Vec3, voxel_type: VoxelType) -> Value {
    let data_type = match voxel_type {
        VoxelType::U8 => "uint8",
        VoxelType::I8 => "int8",
        VoxelType::U16 => "uint16",
        VoxelType::I16 => "int16",
        VoxelType::U32 => "uint32",
        VoxelType::I32 => "int32",
        VoxelType::F32 => "float32",
        VoxelType::F64 => "float64",
    };
    let fill: Value = match voxel_type.is_real() {
        true => json!(0.0),
        false => json!(0),
    };
    let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": zyx(dims.to_array()),
        "data_type": data_type,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": zyx(shard.to_array())}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": fill,
        "codecs": [{"name": "sharding_indexed", "configuration": {
            "chunk_shape": vec![CHUNK_EDGE; 3],
            "codecs": [bytes, {"name": "zstd", "configuration": {"level": ZSTD_LEVEL, "checksum": true}}],
            "index_codecs": [bytes, {"name": "crc32c"}],
            "index_location": "end",
        }}],
        "dimension_names": ["z", "y", "x"],
        "attributes": {},
    })
}

/// The metadata of the group (OME-Zarr 0.5, multiscales).
fn group(levels: &[Level]) -> Value {
    let axis = |name: &str| json!({"name": name, "type": "space", "unit": "millimeter"});
    let first = &levels[0].desc.world_from_index;
    let upright = is_upright(first);
    let datasets: Vec<Value> = levels
        .iter()
        .enumerate()
        .map(|(n, level)| {
            let desc = &level.desc;
            let begin = desc.world_from_index.translation;
            // Of turned volumes: how far along their own axes.
            let begin = match upright {
                true => begin,
                false => {
                    let index = first.inverse().transform_point3(begin);
                    index * levels[0].desc.spacing()
                }
            };
            json!({
                "path": n.to_string(),
                "coordinateTransformations": [
                    {"type": "scale", "scale": zyx(desc.spacing().to_array())},
                    {"type": "translation", "translation": zyx(begin.to_array())},
                ],
            })
        })
        .collect();
    let m = first.matrix3;
    let rows: Vec<[f64; 4]> = (0..3)
        .map(|r| [m.x_axis[r], m.y_axis[r], m.z_axis[r], first.translation[r]])
        .collect();
    json!({
        "zarr_format": 3,
        "node_type": "group",
        "attributes": {
            "ome": {
                "version": "0.5",
                "multiscales": [{
                    "name": levels[0].desc.name,
                    "axes": [axis("z"), axis("y"), axis("x")],
                    "datasets": datasets,
                    "type": "mean",
                }],
            },
            "brickscope": {
                "writer": concat!("brickscope ", env!("CARGO_PKG_VERSION")),
                "world_from_index": rows,
                "unit": levels[0].desc.unit,
            },
        },
    })
}

/// Reads, converts and compresses shards.
struct Encoder {
    voxel_type: VoxelType,
    rescale: Rescale,
    /// Stored less source values.
    offset: f64,
    stored: Vec<u8>,
    chunks: Vec<u8>,
}

impl Encoder {
    /// The bytes of a shard whose first voxel is `part`'s; `None` where all of it is the fill value.
    fn shard(
        &mut self,
        store: &Store,
        lod: Lod,
        part: VoxelBox,
        shard: U64Vec3,
        reader: &mut BrickReader,
    ) -> Result<Option<Vec<u8>>, ExportError> {
        let stored_type = store.stored_type().voxel_type();
        let count = part.voxel_count().unwrap_or(0) as usize;
        self.stored.resize(count * stored_type.size(), 0);
        store.read_box(lod, part, reader, &mut self.stored)?;
        let per_axis = shard / CHUNK_EDGE;
        let of_chunk = CHUNK_EDGE.pow(3) as usize * self.voxel_type.size();
        let chunks = per_axis.element_product() as usize;
        self.chunks.resize(chunks * of_chunk, 0);
        let (stored, size) = (&self.stored, part.size());
        let encoded: Vec<Option<Vec<u8>>> = self
            .chunks
            .par_chunks_exact_mut(of_chunk)
            .enumerate()
            .map(|(n, out)| {
                let n = n as u64;
                let at = U64Vec3::new(
                    n % per_axis.x,
                    n / per_axis.x % per_axis.y,
                    n / (per_axis.x * per_axis.y),
                );
                let convert = Converting {
                    from: stored_type,
                    to: self.voxel_type,
                    rescale: self.rescale,
                    offset: self.offset,
                };
                convert.chunk(stored, size, at * CHUNK_EDGE, out);
                let is_empty = out.iter().all(|&b| b == 0);
                (!is_empty).then(|| compressed(out)).transpose()
            })
            .collect::<std::io::Result<_>>()
            .map_err(|error| ExportError::Write {
                path: store.path().to_owned(),
                error,
            })?;
        Ok(assembled(&encoded))
    }
}

fn compressed(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), ZSTD_LEVEL)?;
    encoder.include_checksum(true)?;
    encoder.set_pledged_src_size(Some(bytes.len() as u64))?;
    encoder.include_contentsize(true)?;
    std::io::Write::write_all(&mut encoder, bytes)?;
    encoder.finish()
}

/// Chunks, their index and its checksum, behind each other; `None` where no chunk is there.
fn assembled(chunks: &[Option<Vec<u8>>]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut index = Vec::with_capacity(chunks.len() * 16);
    for chunk in chunks {
        let (at, len) = match chunk {
            Some(chunk) => (bytes.len() as u64, chunk.len() as u64),
            None => (u64::MAX, u64::MAX),
        };
        index.extend(at.to_le_bytes());
        index.extend(len.to_le_bytes());
        bytes.extend(chunk.iter().flatten());
    }
    if bytes.is_empty() {
        return None;
    }
    bytes.extend(&index);
    bytes.extend(crc32c::crc32c(&index).to_le_bytes());
    Some(bytes)
}

/// How stored voxels become written ones.
#[derive(Clone, Copy)]
struct Converting {
    from: VoxelType,
    to: VoxelType,
    rescale: Rescale,
    offset: f64,
}

impl Converting {
    /// Fills a chunk that begins at `at` of a part of `size` voxels; what lies beyond is the fill value.
    fn chunk(self, stored: &[u8], size: U64Vec3, at: U64Vec3, out: &mut [u8]) {
        let (from, to) = (self.from.size(), self.to.size());
        let as_is = self.from == self.to && self.offset == 0.0 && self.rescale == Rescale::IDENTITY;
        out.fill(0);
        if at.cmpge(size).any() {
            return;
        }
        let end = (at + CHUNK_EDGE).min(size);
        let width = (end.x - at.x) as usize;
        for z in at.z..end.z {
            for y in at.y..end.y {
                let first = ((z * size.y + y) * size.x + at.x) as usize * from;
                let row = &stored[first..first + width * from];
                let place = ((z - at.z) * CHUNK_EDGE + (y - at.y)) * CHUNK_EDGE;
                let begin = place as usize * to;
                let out = &mut out[begin..begin + width * to];
                if as_is {
                    out.copy_from_slice(row);
                    continue;
                }
                for (voxel, out) in row.chunks_exact(from).zip(out.chunks_exact_mut(to)) {
                    let source = self.from.value(voxel) - self.offset;
                    self.to.put(self.rescale.physical(source), out);
                }
            }
        }
    }
}
