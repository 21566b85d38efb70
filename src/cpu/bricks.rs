//! Decoded bricks in host memory, shared by all threads and kept from picture to picture, and what a thread has at hand.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lru::LruCache;
use rayon::prelude::*;

use super::intervals::{ActiveBrick, Intervals};
use super::simd::GatherBytes;
use super::skip::{Seen, far_away};
use crate::geom::{
    BLOCKS_PER_BRICK, BRICK_EDGE, BrickGrid, BrickId, Lod, STORED_EDGE, STORED_VOXELS,
};
use crate::scene::{Extreme, LevelFrame, RayFrame};
use crate::store::{BrickData, BrickReader, Store, StoreError};
use crate::volume::StoredType;

/// Bytes from a voxel to the farthest of the eight around a position, by type: how far behind a brick's voxels a tap can
/// reach whose weight is 0.
const fn reach(voxel_bytes: usize) -> usize {
    let edge = STORED_EDGE as usize;
    (edge * edge + edge + 1) * voxel_bytes
}

/// Bytes of a brick's voxels, and of zeros behind them.
fn voxels_len(stored_type: StoredType) -> usize {
    STORED_VOXELS * stored_type.size() + reach(stored_type.size())
}

/// What is read of a brick, whatever the classification.
#[derive(Debug)]
struct Decoded {
    /// 34³ voxels, little-endian, and zeros.
    voxels: Arc<GatherBytes>,
    block_ranges: Box<[[f32; 2]; BLOCKS_PER_BRICK]>,
    /// What the last classification made of it, and its number.
    classified: Mutex<Option<(u64, Arc<GatherBytes>)>>,
}

/// What the caster needs of a brick.
#[derive(Clone, Debug)]
pub(super) struct CastBrick {
    /// A byte per block ([`super::skip`]), or its bound, f32 ([`Purpose::Extreme`]).
    pub(super) blocks: Arc<GatherBytes>,
    /// Its voxels; something of the same length where they have not been read.
    pub(super) voxels: Arc<GatherBytes>,
    /// Are they its own?
    pub(super) has_voxels: bool,
    /// No sample in it is beyond this ([`Extreme::bound`]); the greatest number there is where nobody asks.
    pub(super) bound: f32,
}

/// How a brick's blocks are told.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Purpose {
    /// By what can be seen.
    Skip(Seen),
    /// By their extremes; voxels are not read before they are asked for.
    Extreme(Extreme),
    /// All are active, and every brick is read.
    Everything,
}

impl Purpose {
    /// Bytes of the blocks of a brick.
    pub(super) const fn blocks_len(&self) -> usize {
        match self {
            Self::Skip(_) | Self::Everything => BLOCKS_PER_BRICK,
            Self::Extreme(_) => BLOCKS_PER_BRICK * 4,
        }
    }
}

/// What a brick is found by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Key {
    Brick(BrickId),
    /// All bricks of one value, by its bits.
    Constant(u32),
}

/// What has been read, since the cache was made.
#[derive(Debug, Default)]
pub(super) struct Traffic {
    pub(super) bricks_read: AtomicU64,
    pub(super) bytes_read: AtomicU64,
    pub(super) bytes_decompressed: AtomicU64,
}

/// The bricks of a store that were decoded, as many as the budget holds, the least recently asked for dropped first.
#[derive(Debug)]
pub(super) struct BrickCache {
    store: Arc<Store>,
    decoded: Mutex<LruCache<Key, Arc<Decoded>>>,
    budget_bytes: u64,
    /// Where lanes point that read nothing.
    pub(super) no_voxels: Arc<GatherBytes>,
    pub(super) traffic: Traffic,
}

impl BrickCache {
    /// At most `budget_bytes` of bricks (some at least), without those that threads have at hand.
    pub(super) fn new(store: &Arc<Store>, budget_bytes: u64) -> Self {
        Self {
            store: Arc::clone(store),
            decoded: Mutex::new(LruCache::unbounded()),
            budget_bytes,
            no_voxels: Arc::new(GatherBytes::new(&[], voxels_len(store.stored_type()))),
            traffic: Traffic::default(),
        }
    }

    /// Bytes that a brick takes.
    pub(super) fn brick_bytes(&self) -> u64 {
        (voxels_len(self.store.stored_type()) + BLOCKS_PER_BRICK * 12) as u64
    }

    /// The store that they are of.
    pub(super) fn store(&self) -> &Arc<Store> {
        &self.store
    }

    /// The blocks of a brick under the classification of this number, if it is decoded and they are known.
    fn known_blocks(
        decoded: &LruCache<Key, Arc<Decoded>>,
        key: Key,
        generation: u64,
    ) -> Option<Arc<GatherBytes>> {
        let brick = decoded.peek(&key)?;
        let last = brick
            .classified
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        last.as_ref()
            .filter(|(of, _)| *of == generation)
            .map(|(_, blocks)| Arc::clone(blocks))
    }

    /// Drops all.
    pub(super) fn clear(&self) {
        self.lock().clear();
    }

    /// How many fit.
    fn capacity(&self) -> usize {
        usize::try_from(self.budget_bytes / self.brick_bytes())
            .unwrap_or(usize::MAX)
            .max(8)
    }

    fn lock(&self) -> MutexGuard<'_, LruCache<Key, Arc<Decoded>>> {
        self.decoded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The brick, decoded; `reader` and `buffer` are this thread's.
    fn get(
        &self,
        key: Key,
        id: BrickId,
        reader: &mut Option<BrickReader>,
        buffer: &mut BrickData,
    ) -> Result<Arc<Decoded>, StoreError> {
        if let Some(found) = self.lock().get(&key) {
            return Ok(Arc::clone(found));
        }
        // Not locked while decoding: two threads may decode one brick, which costs time but no correctness.
        let reader = match reader {
            Some(reader) => reader,
            None => reader.insert(BrickReader::new().map_err(|error| StoreError::Io {
                path: self.store.path().to_owned(),
                doing: "start a decoder for it",
                error,
            })?),
        };
        self.store.read_brick_into(id, reader, buffer)?;
        if let Some(record) = self.store.entry(id).record {
            let add = |to: &AtomicU64, n| to.fetch_add(n, Ordering::Relaxed);
            add(&self.traffic.bricks_read, 1);
            add(&self.traffic.bytes_read, u64::from(record.len));
            add(&self.traffic.bytes_decompressed, buffer.voxels.len() as u64);
        }
        let len = voxels_len(self.store.stored_type());
        let ranges = buffer.block_ranges.clone().into_boxed_slice();
        let decoded = Arc::new(Decoded {
            voxels: Arc::new(GatherBytes::new(&buffer.voxels, len)),
            block_ranges: ranges
                .try_into()
                .expect("invariant: a brick has a range per block"),
            classified: Mutex::new(None),
        });
        let mut cache = self.lock();
        cache.put(key, Arc::clone(&decoded));
        while cache.len() > self.capacity() {
            cache.pop_lru();
        }
        Ok(decoded)
    }
}

/// How a level's blocks are told.
#[derive(Debug)]
pub(super) struct LevelClassification {
    lod: Lod,
    pub(super) purpose: Purpose,
    /// Tells this from other classifications of this and other levels.
    generation: u64,
    /// The bricks in which, by the index, something can be seen: their numbers, in order.
    pub(super) visible: Vec<u64>,
}

impl LevelClassification {
    /// One scan of the index of the level, which was checked.
    pub(super) fn new(store: &Store, lod: Lod, purpose: Purpose, generation: u64) -> Self {
        let grid = store.level(lod).grid;
        let is_visible = |&index: &u64| {
            let entry = store.entry(BrickId::new(lod, grid.xyz(index)));
            match &purpose {
                Purpose::Skip(seen) => seen.is_visible([entry.min, entry.max]),
                Purpose::Extreme(_) | Purpose::Everything => true,
            }
        };
        let visible = (0..grid.len()).into_par_iter().filter(is_visible).collect();
        Self {
            lod,
            purpose,
            generation,
            visible,
        }
    }
}

/// A level of the store under one classification, as a picture reads it.
#[derive(Debug)]
pub(super) struct CastLevel<'a> {
    cache: &'a BrickCache,
    grid: BrickGrid,
    pub(super) of: Arc<LevelClassification>,
    /// Blocks of a brick of which nothing is known: all may be seen.
    unknown: Arc<GatherBytes>,
    /// Blocks of a brick in which nothing can be seen, by zone.
    unseen: Vec<Arc<GatherBytes>>,
}

impl<'a> CastLevel<'a> {
    pub(super) fn new(cache: &'a BrickCache, of: &Arc<LevelClassification>) -> Self {
        let len = of.purpose.blocks_len();
        let blocks = |bytes: &[u8]| Arc::new(GatherBytes::new(bytes, len));
        let unknown = match of.purpose {
            Purpose::Skip(_) | Purpose::Everything => vec![0; len],
            Purpose::Extreme(_) => f32::INFINITY.to_le_bytes().repeat(BLOCKS_PER_BRICK),
        };
        let zones = match &of.purpose {
            Purpose::Skip(seen) => seen.surfaces.len() + 1,
            Purpose::Extreme(_) | Purpose::Everything => 1,
        };
        Self {
            cache,
            grid: cache.store.level(of.lod).grid,
            unknown: blocks(&unknown),
            unseen: (0..zones)
                .map(|zone| blocks(&[far_away(zone); BLOCKS_PER_BRICK]))
                .collect(),
            of: Arc::clone(of),
        }
    }

    /// Bricks and voxels along each axis.
    pub(super) fn grid(&self) -> BrickGrid {
        self.grid
    }

    /// Where along the rays something may be seen, as far as is known now.
    pub(super) fn intervals(&self, frame: &RayFrame, level: &LevelFrame) -> Intervals {
        if !matches!(self.of.purpose, Purpose::Skip(_)) {
            return Intervals::everywhere(frame);
        }
        let bricks: Vec<_> = {
            let decoded = self.cache.lock();
            let visible = self.of.visible.iter();
            visible
                .map(|&index| {
                    let id = BrickId::new(self.of.lod, self.grid.xyz(index));
                    let key = self.key(id);
                    ActiveBrick {
                        first_voxel: id.xyz.as_dvec3() * f64::from(BRICK_EDGE),
                        blocks: BrickCache::known_blocks(&decoded, key, self.of.generation),
                    }
                })
                .collect()
        };
        Intervals::new(frame, level, &bricks)
    }

    /// What the brick is found by.
    fn key(&self, id: BrickId) -> Key {
        let entry = self.cache.store.entry(id);
        if entry.constant {
            Key::Constant(entry.min.to_bits())
        } else {
            Key::Brick(id)
        }
    }

    /// What stands for no brick at all.
    pub(super) fn nothing(&self) -> CastBrick {
        CastBrick {
            blocks: Arc::clone(&self.unseen[0]),
            voxels: Arc::clone(&self.cache.no_voxels),
            has_voxels: false,
            bound: f32::MIN,
        }
    }

    /// A thread's view.
    pub(super) fn near(&self, threads: usize) -> NearBricks<'_> {
        let share = self.cache.capacity() / (2 * threads.max(1));
        // Rounded down to a power of two, for the hash.
        let count = 1 << share.clamp(16, 256).ilog2();
        NearBricks {
            level: self,
            near: std::iter::repeat_with(|| None).take(count).collect(),
            reader: None,
            buffer: BrickData::default(),
            error: None,
        }
    }

    fn load(
        &self,
        index: u64,
        needs_voxels: bool,
        reader: &mut Option<BrickReader>,
        buffer: &mut BrickData,
    ) -> Result<CastBrick, StoreError> {
        let id = BrickId::new(self.of.lod, self.grid.xyz(index));
        let entry = self.cache.store.entry(id);
        let range = [entry.min, entry.max];
        let (mut bound, mut known) = (f32::MAX, None);
        match &self.of.purpose {
            Purpose::Everything => (),
            Purpose::Extreme(extreme) => {
                bound = extreme.bound(self.cache.store.stored_type(), range);
                known = Some(&self.unknown);
            }
            Purpose::Skip(seen) if seen.is_visible(range) => (),
            Purpose::Skip(seen) => known = Some(&self.unseen[seen.zone(range)]),
        }
        if let Some(blocks) = known
            && !needs_voxels
        {
            return Ok(CastBrick {
                blocks: Arc::clone(blocks),
                voxels: Arc::clone(&self.cache.no_voxels),
                has_voxels: false,
                bound,
            });
        }
        let decoded = self.cache.get(self.key(id), id, reader, buffer)?;
        Ok(CastBrick {
            blocks: self.classified(&decoded),
            voxels: Arc::clone(&decoded.voxels),
            has_voxels: true,
            bound,
        })
    }

    /// The blocks of a brick whose ranges are known.
    fn classified(&self, decoded: &Decoded) -> Arc<GatherBytes> {
        let mut last = decoded
            .classified
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some((generation, blocks)) = &*last
            && *generation == self.of.generation
        {
            return Arc::clone(blocks);
        }
        let len = self.of.purpose.blocks_len();
        let blocks = match &self.of.purpose {
            Purpose::Everything => Arc::clone(&self.unknown),
            Purpose::Skip(seen) => {
                let bytes = seen.of_blocks(&decoded.block_ranges);
                Arc::new(GatherBytes::new(&bytes, len))
            }
            Purpose::Extreme(extreme) => {
                let stored_type = self.cache.store.stored_type();
                let ranges = decoded.block_ranges.iter();
                let bounds = ranges.flat_map(|&r| extreme.bound(stored_type, r).to_le_bytes());
                Arc::new(GatherBytes::new(&bounds.collect::<Vec<u8>>(), len))
            }
        };
        *last = Some((self.of.generation, Arc::clone(&blocks)));
        blocks
    }
}

/// The bricks of a level that a thread has at hand: found without a lock.
pub(super) struct NearBricks<'a> {
    level: &'a CastLevel<'a>,
    /// By a hash of the brick's index; as many as a power of two.
    near: Vec<Option<(u64, CastBrick)>>,
    reader: Option<BrickReader>,
    buffer: BrickData,
    /// What went wrong first. Bricks that can't be read are empty.
    pub(super) error: Option<StoreError>,
}

impl<'a> NearBricks<'a> {
    /// The level that they are of.
    pub(super) fn level(&self) -> &'a CastLevel<'a> {
        self.level
    }

    /// The brick of this index; with its voxels, if they are needed although nothing in it can be seen.
    #[inline]
    pub(super) fn get(&mut self, index: u64, needs_voxels: bool) -> &CastBrick {
        // Fibonacci hashing: neighbours along every axis spread.
        let hash = index.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
        let place = hash as usize & (self.near.len() - 1);
        let is_here = self.near[place]
            .as_ref()
            .is_some_and(|(i, brick)| *i == index && (brick.has_voxels || !needs_voxels));
        if !is_here {
            let loaded = self
                .level
                .load(index, needs_voxels, &mut self.reader, &mut self.buffer);
            let brick = loaded.unwrap_or_else(|error| {
                self.error.get_or_insert(error);
                self.level.nothing()
            });
            self.near[place] = Some((index, brick));
        }
        match &self.near[place] {
            Some((_, brick)) => brick,
            None => unreachable!("invariant: it was just put there"),
        }
    }
}
