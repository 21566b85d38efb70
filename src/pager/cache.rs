//! Decoded bricks in host memory, least recently used out first, within a budget of bytes.

use std::sync::Arc;

use lru::LruCache;

use crate::geom::BrickId;
use crate::store::BrickData;

/// The cache. Bricks in use elsewhere (by `Arc`) don't count once they have left it.
#[derive(Debug)]
pub struct BrickCache {
    bricks: LruCache<BrickId, Arc<BrickData>>,
    budget_bytes: u64,
    bytes: u64,
}

/// Host bytes of one decoded brick.
fn size_of_brick(data: &BrickData) -> u64 {
    (data.voxels.len() + size_of_val(data.block_ranges.as_slice())) as u64
}

impl BrickCache {
    /// An empty cache of at most `budget_bytes`.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            bricks: LruCache::unbounded(),
            budget_bytes,
            bytes: 0,
        }
    }

    /// The brick, if it is here; marks it as used.
    pub fn get(&mut self, brick: BrickId) -> Option<Arc<BrickData>> {
        self.bricks.get(&brick).cloned()
    }

    /// Puts a brick in and throws out what no longer fits.
    pub fn put(&mut self, brick: BrickId, data: Arc<BrickData>) {
        self.bytes += size_of_brick(&data);
        if let Some(old) = self.bricks.put(brick, data) {
            self.bytes -= size_of_brick(&old);
        }
        while self.bytes > self.budget_bytes {
            let Some((_, gone)) = self.bricks.pop_lru() else {
                break;
            };
            self.bytes -= size_of_brick(&gone);
        }
    }
}
