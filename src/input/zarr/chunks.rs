//! [`ZarrChunks`]: where the chunks of a Zarr array lie, each in an object of its own or in a part of a shard.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::input::chunked::{Array, Block, Chunks, Packing, Store, most_packed_bytes, unpack};
use crate::input::problem::Subject;
use crate::volume::SourceError;

/// Indices of shards that are kept, together; more are read again.
const KEPT_INDEX_BYTES: u64 = 64 << 20;

/// Where a shard's index says that a chunk is not stored.
const NOT_STORED: u64 = u64::MAX;

/// Bytes of an entry of a shard's index: place and length.
const ENTRY_BYTES: u64 = 16;

/// How an array lies in its store.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) array: Array,
    pub(super) keys: Keys,
    pub(super) pipeline: Pipeline,
}

/// How the key of a chunk is made of its index.
#[derive(Clone, Debug)]
pub(super) struct Keys {
    pub(super) prefix: &'static str,
    pub(super) separator: char,
}

/// What was done to the bytes of a chunk.
#[derive(Clone, Debug)]
pub(super) struct Pipeline {
    /// In the order of writing.
    pub(super) packings: Vec<Packing>,
    pub(super) shard: Option<Shard>,
}

/// Many chunks in one object, with an index of their places.
#[derive(Clone, Debug)]
pub(super) struct Shard {
    /// Chunks per axis.
    pub(super) per_shard: Vec<u64>,
    pub(super) index_at_end: bool,
    pub(super) index_has_checksum: bool,
}

impl Keys {
    fn key(&self, index: &[u64]) -> String {
        let names = index.iter().map(u64::to_string);
        let prefix = (!self.prefix.is_empty()).then(|| self.prefix.to_owned());
        let names: Vec<String> = prefix.into_iter().chain(names).collect();
        names.join(&self.separator.to_string())
    }
}

impl Shard {
    fn chunks(&self) -> u64 {
        self.per_shard.iter().product()
    }

    fn index_bytes(&self) -> u64 {
        self.chunks() * ENTRY_BYTES + if self.index_has_checksum { 4 } else { 0 }
    }

    /// Which shard the chunk at `index` is in, and its number there.
    fn place(&self, index: &[u64]) -> (Vec<u64>, usize) {
        let pairs = || index.iter().zip(&self.per_shard);
        let shard = pairs().map(|(i, p)| i / p).collect();
        let number = pairs().fold(0, |n, (i, p)| n * p + i % p);
        (shard, number as usize)
    }
}

/// A shard's index: for each chunk where it begins and how long it is. `None` where there is no such shard.
type Index = Option<Vec<[u64; 2]>>;

/// A shard's index, read by the first that needs it while others wait.
type Slot = Arc<Mutex<Option<Arc<Index>>>>;

/// The chunks of an array.
pub(super) struct ZarrChunks {
    pub(super) store: Store,
    pub(super) layout: Layout,
    pub(super) stamp: String,
    indices: Mutex<HashMap<Vec<u64>, Slot>>,
}

impl ZarrChunks {
    pub(super) fn new(store: Store, layout: Layout, stamp: String) -> Self {
        Self {
            store,
            layout,
            stamp,
            indices: Mutex::default(),
        }
    }

    /// The packed bytes of the chunk at `index`, with the key of the object that they are in and their place there.
    fn packed(&self, index: &[u64]) -> Result<Option<(Vec<u8>, String, String)>, SourceError> {
        let Layout {
            array,
            keys,
            pipeline,
        } = &self.layout;
        let most_bytes = most_packed_bytes(array.chunk_bytes());
        let Some(shard) = &pipeline.shard else {
            let key = keys.key(index);
            let bytes = self.store.whole(&key, most_bytes)?;
            return Ok(bytes.map(|b| (b, key, "the chunk".to_owned())));
        };
        let (shard_index, number) = shard.place(index);
        let key = keys.key(&shard_index);
        let table = self.index(shard, shard_index, &key)?;
        let entry = table.as_ref().as_ref().and_then(|t| t.get(number).copied());
        let Some([at, bytes]) = entry else {
            return Ok(None);
        };
        if at == NOT_STORED && bytes == NOT_STORED {
            return Ok(None);
        }
        let path = self.store.place(&key);
        let subject = Subject::new(&path);
        let place = format!("chunk {number} of the shard");
        if bytes > most_bytes || at.checked_add(bytes).is_none() {
            return Err(subject.malformed(
                place,
                format!("at most {most_bytes} bytes"),
                format!("{bytes} bytes from byte {at} on, by the shard's index"),
            ));
        }
        if bytes == 0 {
            return Ok(Some((Vec::new(), key, place)));
        }
        match self.store.range(&key, at, bytes)? {
            Some(bytes) => Ok(Some((bytes, key, place))),
            None => {
                Err(subject.malformed(place, "the shard whose index was read", "nothing any more"))
            }
        }
    }

    /// The index of a shard.
    fn index(
        &self,
        shard: &Shard,
        shard_index: Vec<u64>,
        key: &str,
    ) -> Result<Arc<Index>, SourceError> {
        let slot = {
            // A lock is poisoned by a panic elsewhere only: what it guards is whole at any time.
            let mut indices = self.indices.lock().unwrap_or_else(PoisonError::into_inner);
            let most = (KEPT_INDEX_BYTES / shard.index_bytes()).max(1) as usize;
            if indices.len() >= most && !indices.contains_key(&shard_index) {
                indices.clear();
            }
            Arc::clone(indices.entry(shard_index).or_default())
        };
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = &*slot {
            return Ok(Arc::clone(index));
        }
        let index = Arc::new(self.read_index(shard, key)?);
        *slot = Some(Arc::clone(&index));
        Ok(index)
    }

    fn read_index(&self, shard: &Shard, key: &str) -> Result<Index, SourceError> {
        let bytes = shard.index_bytes();
        let packed = if shard.index_at_end {
            self.store.tail(key, bytes)?
        } else {
            self.store.range(key, 0, bytes)?
        };
        let Some(packed) = packed else {
            return Ok(None);
        };
        let guard: &[Packing] = if shard.index_has_checksum {
            &[Packing::Crc32c]
        } else {
            &[]
        };
        let path = self.store.place(key);
        let entries = (shard.chunks() * ENTRY_BYTES) as usize;
        let bytes = unpack(
            &Subject::new(&path),
            "the shard's index",
            guard,
            packed,
            entries,
        )?;
        let number = |b: &[u8; 8]| u64::from_le_bytes(*b);
        let (pairs, _) = bytes.as_chunks::<8>().0.as_chunks::<2>();
        Ok(Some(
            pairs
                .iter()
                .map(|[at, len]| [number(at), number(len)])
                .collect(),
        ))
    }
}

impl Chunks for ZarrChunks {
    fn read(&self, index: &[u64]) -> Result<Option<Block>, SourceError> {
        let array = &self.layout.array;
        let Some((packed, key, place)) = self.packed(index)? else {
            return Ok(None);
        };
        let path = self.store.place(&key);
        let bytes = unpack(
            &Subject::new(&path),
            &place,
            &self.layout.pipeline.packings,
            packed,
            array.chunk_bytes() as usize,
        )?;
        Ok(Some(Block {
            bytes,
            extent: array.chunk.clone(),
        }))
    }

    fn held_bytes(&self) -> u64 {
        let index = self.layout.pipeline.shard.as_ref();
        index.map_or(0, |s| KEPT_INDEX_BYTES.max(s.index_bytes()))
    }

    fn stamp(&self) -> String {
        self.stamp.clone()
    }
}
