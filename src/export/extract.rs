//! Voxels of a store back into a file: a box of one level, in the source's type, place and rescale.
//!
//! Streams: memory is bounded whatever the box ([`PART_BYTES`] and a brick). Which level and box is the caller's choice.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3};

use super::writer::{ExportError, Format, create};
use super::zarr;
use crate::geom::{BRICK_EDGE, Lod, VoxelBox};
use crate::outfile::Existing;
use crate::store::{BrickReader, Store, StoreError};
use crate::volume::{StoredType, VolumeDesc, VoxelType};

/// Most bytes of stored voxels that are held at once. A layer of bricks of up to 2048² voxels of u16 fits, so that each
/// brick is decoded once; larger slices decode bricks again.
const PART_BYTES: u64 = 256 << 20;
/// Voxels converted at once.
const CHUNK_VOXELS: usize = 1 << 16;

/// What comes out of `voxels` of level `lod`: size, type, place and rescale.
///
/// The type is the source's, unless its values can't be had back: what was rounded to f32 stays f32, and so do the
/// averages of whole numbers that are stored as f32.
///
/// # Errors
/// There is no such level, or the box is empty or not inside it.
pub fn extracted(store: &Store, lod: Lod, voxels: VoxelBox) -> Result<VolumeDesc, ExportError> {
    if usize::from(lod.0) >= store.levels() {
        return Err(ExportError::NoSuchLevel {
            store: store.path().to_owned(),
            asked: lod.0,
            last: store.levels() - 1,
        });
    }
    let level = store.level(lod);
    if voxels.is_empty() || !VoxelBox::whole(level.grid.voxels).contains_box(&voxels) {
        return Err(ExportError::BoxOutside {
            store: store.path().to_owned(),
            asked: voxels,
            lod: lod.0,
            dims: level.grid.voxels,
        });
    }
    let meta = store.meta();
    // The centre of voxel i of the level is at scale · (i + ½) − ½ in indices of level 0.
    let first = level.scale * (voxels.min.as_dvec3() + 0.5) - 0.5;
    let world = meta.world_from_index;
    Ok(VolumeDesc {
        dims: voxels.size(),
        voxel_type: output_type(store, lod),
        world_from_index: DAffine3 {
            matrix3: world.matrix3 * DMat3::from_diagonal(level.scale),
            translation: world.transform_point3(first),
        },
        rescale: meta.source_rescale,
        unit: meta.unit.clone(),
        name: meta.source_name.clone(),
    })
}

/// Writes `voxels` of level `lod` to `path`, whose name says the format, and returns what was written. `advance` hears of
/// every part, in bytes of stored voxels.
///
/// # Errors
/// As [`extracted`]; a brick is damaged; or the file can't be written. Nothing is left behind then.
pub fn extract(
    store: &Store,
    (lod, voxels): (Lod, VoxelBox),
    path: &Path,
    existing: Existing,
    advance: &mut dyn FnMut(u64),
) -> Result<VolumeDesc, ExportError> {
    let desc = extracted(store, lod, voxels)?;
    if Format::of(path) == Some(Format::Zarr) {
        zarr::write(store, (lod, voxels), path, existing, advance)?;
        return Ok(desc);
    }
    let mut writer = create(path, &desc, existing)?;
    let stored_type = store.stored_type();
    let offset = f64::from(store.meta().conversion.offset);
    let as_is = offset == 0.0 && desc.voxel_type == stored_type.voxel_type();
    let mut reader = BrickReader::new().map_err(|error| {
        ExportError::Store(StoreError::Io {
            path: store.path().to_owned(),
            doing: "start decoding",
            error,
        })
    })?;
    let failed = |error| ExportError::Write {
        path: PathBuf::from(path),
        error,
    };
    let size = stored_type.size();
    let (mut bytes, mut converted) = (Vec::new(), Vec::new());
    for part in parts(voxels, size as u64, PART_BYTES) {
        let len = part.voxel_count().unwrap_or(0) as usize * size;
        bytes.resize(len, 0);
        store.read_box(lod, part, &mut reader, &mut bytes)?;
        if as_is {
            writer.write(&bytes).map_err(failed)?;
        } else {
            for chunk in bytes.chunks(CHUNK_VOXELS * size) {
                converted.clear();
                convert(stored_type, chunk, offset, desc.voxel_type, &mut converted);
                writer.write(&converted).map_err(failed)?;
            }
        }
        advance(len as u64);
    }
    writer.finish()?;
    Ok(desc)
}

/// The type in which voxels of a level come out.
fn output_type(store: &Store, lod: Lod) -> VoxelType {
    let meta = store.meta();
    let is_real = matches!(meta.source_type, VoxelType::F32 | VoxelType::F64);
    let comes_back = match meta.stored_type {
        StoredType::U8 | StoredType::U16 => true,
        StoredType::F32 => meta.conversion.is_exact() && (is_real || lod.0 == 0),
    };
    if comes_back {
        meta.source_type
    } else {
        VoxelType::F32
    }
}

/// `whole` in parts of at most `most_bytes` (one row at least), in the order of a file: x fastest, then y, then z. Parts
/// end where bricks do, when they can.
fn parts(whole: VoxelBox, voxel_bytes: u64, most_bytes: u64) -> Vec<VoxelBox> {
    let size = whole.size();
    let row_bytes = size.x * voxel_bytes;
    let slice_bytes = row_bytes * size.y;
    let mut parts = Vec::new();
    for [z0, z1] in runs([whole.min.z, whole.max.z], most_bytes / slice_bytes) {
        let rows = if slice_bytes <= most_bytes {
            size.y
        } else {
            most_bytes / row_bytes
        };
        let tiles = if rows == size.y {
            vec![[whole.min.y, whole.max.y]]
        } else {
            runs([whole.min.y, whole.max.y], rows)
        };
        for [y0, y1] in tiles {
            let mut part = whole;
            [part.min.y, part.min.z] = [y0, z0];
            [part.max.y, part.max.z] = [y1, z1];
            parts.push(part);
        }
    }
    parts
}

/// `[start, end)` in runs of at most `most` (at least 1), none reaching over a border between bricks.
fn runs([start, end]: [u64; 2], most: u64) -> Vec<[u64; 2]> {
    let edge = u64::from(BRICK_EDGE);
    let mut runs = Vec::new();
    let mut at = start;
    while at < end {
        let next = end
            .min((at / edge + 1) * edge)
            .min(at.saturating_add(most.max(1)));
        runs.push([at, next]);
        at = next;
    }
    runs
}

/// Appends stored voxels less `offset` to `out`, as little-endian voxels of `target`, which can hold them.
fn convert(stored: StoredType, bytes: &[u8], offset: f64, target: VoxelType, out: &mut Vec<u8>) {
    let size = target.size();
    for voxel in bytes.chunks_exact(stored.size()) {
        let value = stored.voxel_type().value(voxel) - offset;
        let at = out.len();
        out.resize(at + size, 0);
        target.put(value, &mut out[at..]);
    }
}

#[cfg(test)]
mod tests {
    use glam::U64Vec3;

    use super::*;

    #[test]
    fn parts_cover_the_box_in_file_order_and_keep_to_the_memory() {
        let whole = VoxelBox::new(U64Vec3::new(3, 5, 20), U64Vec3::new(40, 77, 130));
        let size = whole.size();
        for most_bytes in [1, 2 * size.x * 2, 2 * size.x * size.y * 3, 1 << 30] {
            let parts = parts(whole, 2, most_bytes);
            // Rows in file order, each exactly once.
            let rows: Vec<_> = parts
                .iter()
                .flat_map(|p| {
                    (p.min.z..p.max.z).flat_map(|z| (p.min.y..p.max.y).map(move |y| (z, y)))
                })
                .collect();
            let expected: Vec<_> = (20..130)
                .flat_map(|z| (5..77).map(move |y| (z, y)))
                .collect();
            assert!(
                rows == expected,
                "{most_bytes} bytes: every row once, in order"
            );
            let bound = most_bytes.max(2 * size.x);
            let largest = parts.iter().filter_map(VoxelBox::voxel_count).max();
            assert!(
                largest <= Some(bound / 2),
                "{most_bytes} bytes: a part of {largest:?} voxels"
            );
        }
        assert_eq!(
            parts(whole, 2, 1 << 30).len(),
            5,
            "brick layers 0 to 4, each decoded once"
        );
    }
}
