//! Voxels of one level, fetched one by one from the bricks that own them.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{IVec3, UVec3, Vec3};
use lru::LruCache;

use crate::geom::{BRICK_BORDER, BRICK_EDGE, BrickGrid, BrickId, Lod, STORED_EDGE, STORED_VOXELS};
use crate::store::{BrickReader, Store, StoreError};
use crate::volume::StoredType;

/// A decoded brick: one value, or 34³ of them.
#[derive(Debug)]
enum Voxels {
    Constant(f32),
    Dense(Vec<u8>),
}

/// One level of a store as a field of voxels, decoded on demand into a cache shared by all threads.
#[derive(Debug)]
pub struct VoxelField<'a> {
    store: &'a Store,
    lod: Lod,
    grid: BrickGrid,
    stored_type: StoredType,
    cache: Mutex<LruCache<u64, Arc<Voxels>>>,
    /// Bricks decoded so far.
    pub(super) bricks_read: AtomicU64,
}

impl<'a> VoxelField<'a> {
    /// The field of level `lod`, keeping at most `ram_bytes` of decoded bricks (at least 64 of them).
    pub fn new(store: &'a Store, lod: Lod, ram_bytes: u64) -> Self {
        let stored_type = store.meta().stored_type;
        let brick_bytes = (STORED_VOXELS * stored_type.size()) as u64;
        let capacity = usize::try_from(ram_bytes / brick_bytes)
            .unwrap_or(usize::MAX)
            .max(64);
        Self {
            store,
            lod,
            grid: store.level(lod).grid,
            stored_type,
            cache: Mutex::new(LruCache::new(
                NonZeroUsize::new(capacity).unwrap_or(NonZeroUsize::MIN),
            )),
            bricks_read: AtomicU64::new(0),
        }
    }

    /// A reader for one thread.
    pub fn reader(&self) -> FieldReader<'_> {
        FieldReader {
            field: self,
            near: std::array::from_fn(|_| None),
            decoder: None,
            error: None,
        }
    }

    fn brick(
        &self,
        xyz: UVec3,
        decoder: &mut Option<BrickReader>,
    ) -> Result<Arc<Voxels>, StoreError> {
        let index = self.grid.index(xyz);
        // Not held while decoding: two threads may decode one brick, which costs time but no correctness.
        if let Some(found) = self.lock().get(&index) {
            return Ok(Arc::clone(found));
        }
        let id = BrickId::new(self.lod, xyz);
        let entry = self.store.entry(id);
        let voxels = if entry.constant {
            Voxels::Constant(entry.min)
        } else {
            self.bricks_read.fetch_add(1, Ordering::Relaxed);
            let reader = match decoder {
                Some(reader) => reader,
                None => decoder.insert(BrickReader::new().map_err(|error| StoreError::Io {
                    path: self.store.path().to_owned(),
                    doing: "start a decoder for it",
                    error,
                })?),
            };
            Voxels::Dense(self.store.read_brick(id, reader)?.voxels)
        };
        let voxels = Arc::new(voxels);
        self.lock().put(index, Arc::clone(&voxels));
        Ok(voxels)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, LruCache<u64, Arc<Voxels>>> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One thread's view of a [`VoxelField`]. The first failure is kept in `error`; values are 0 from then on.
pub struct FieldReader<'a> {
    field: &'a VoxelField<'a>,
    /// The bricks met last, by the lowest bit of each brick coordinate: the eight taps of a position never collide.
    near: [Option<(UVec3, Arc<Voxels>)>; 8],
    /// Made with the first brick that is decoded.
    decoder: Option<BrickReader>,
    /// What went wrong first.
    pub error: Option<StoreError>,
}

impl FieldReader<'_> {
    /// The voxel at `xyz` of the level, in stored units; outside the level the edge voxel repeats.
    pub fn voxel(&mut self, xyz: IVec3) -> f32 {
        let last = (self.field.grid.voxels - 1).as_ivec3();
        let voxel = xyz.clamp(IVec3::ZERO, last).as_uvec3();
        let brick = voxel / BRICK_EDGE;
        let place = ((brick.x & 1) | (brick.y & 1) << 1 | (brick.z & 1) << 2) as usize;
        if self.near[place].as_ref().is_none_or(|(at, _)| *at != brick) {
            match self.field.brick(brick, &mut self.decoder) {
                Ok(voxels) => self.near[place] = Some((brick, voxels)),
                Err(error) => {
                    self.error.get_or_insert(error);
                    return 0.0;
                }
            }
        }
        let bytes = match self.near[place].as_ref().map(|(_, voxels)| voxels.as_ref()) {
            Some(Voxels::Dense(bytes)) => bytes,
            Some(Voxels::Constant(value)) => return *value,
            None => return 0.0,
        };
        let local = voxel % BRICK_EDGE + BRICK_BORDER;
        let i = ((local.z * STORED_EDGE + local.y) * STORED_EDGE + local.x) as usize;
        match self.field.stored_type {
            StoredType::U8 => f32::from(bytes[i]),
            StoredType::U16 => f32::from(u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])),
            StoredType::F32 => f32::from_le_bytes([
                bytes[4 * i],
                bytes[4 * i + 1],
                bytes[4 * i + 2],
                bytes[4 * i + 3],
            ]),
        }
    }

    /// The trilinear value at `anchor + offset` in continuous level voxels (voxel i's centre at i + ½), stored units.
    pub fn trilinear(&mut self, anchor: IVec3, offset: Vec3) -> f32 {
        let shifted = offset - 0.5;
        let floor = shifted.floor();
        let f = shifted - floor;
        let base = anchor + floor.as_ivec3();
        let mut tap = |x, y, z| self.voxel(base + IVec3::new(x, y, z));
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let y0z0 = lerp(tap(0, 0, 0), tap(1, 0, 0), f.x);
        let y1z0 = lerp(tap(0, 1, 0), tap(1, 1, 0), f.x);
        let y0z1 = lerp(tap(0, 0, 1), tap(1, 0, 1), f.x);
        let y1z1 = lerp(tap(0, 1, 1), tap(1, 1, 1), f.x);
        lerp(lerp(y0z0, y1z0, f.y), lerp(y0z1, y1z1, f.y), f.z)
    }

    /// The value of the voxel that contains `anchor + offset`, stored units.
    pub fn nearest(&mut self, anchor: IVec3, offset: Vec3) -> f32 {
        self.voxel(anchor + offset.floor().as_ivec3())
    }
}
