//! Encoding the bricks of a layer on all threads, in an order that does not depend on them.

use std::sync::{Mutex, PoisonError};

use glam::UVec3;
use rayon::prelude::*;

use super::border;
use super::error::BrickError;
use super::slab::Slab;
use super::stats::{Binned, SavedTotals, Summary, Tally, Totals};
use crate::geom::{BrickGrid, BrickId, Lod, STORED_VOXELS, morton};
use crate::store::codec::{BrickEncoder, EncodedBrick};
use crate::store::{StoreError, StoreWriter};

/// What a thread needs to encode a brick. Lent for one brick at a time.
struct Worker<T> {
    encoder: BrickEncoder<T>,
    voxels: Box<[T; STORED_VOXELS]>,
    tally: Tally<T>,
}

/// Encodes layers of bricks and hands them to the writer.
pub struct LayerEncoder<T> {
    workers: Mutex<Vec<Worker<T>>>,
    totals: Totals<T>,
    batch: usize,
}

/// A layer of a level: what is in it, and the order of its bricks.
pub struct Layer<'a, T> {
    /// The level.
    pub lod: Lod,
    /// Its grid.
    pub grid: &'a BrickGrid,
    /// The slab that holds the layer and its borders.
    pub slab: &'a Slab<T>,
    /// x and y of its bricks, in the order of the file.
    pub order: &'a [[u32; 2]],
}

/// x and y of a layer's bricks in Morton order.
pub fn layer_order(grid: &BrickGrid) -> Vec<[u32; 2]> {
    let mut order: Vec<[u32; 2]> = (0..grid.bricks.y)
        .flat_map(|y| (0..grid.bricks.x).map(move |x| [x, y]))
        .collect();
    order.sort_unstable_by_key(|&[x, y]| morton(UVec3::new(x, y, 0)));
    order
}

impl<T: Binned> LayerEncoder<T> {
    /// An encoder with `workers` sets of buffers, at zstd `level`, `batch` bricks at a time, which adds to `totals`.
    ///
    /// # Errors
    /// zstd has no memory or refuses the level.
    pub fn new(
        workers: usize,
        level: i32,
        batch: usize,
        totals: Totals<T>,
    ) -> Result<Self, BrickError> {
        let workers = (0..workers)
            .map(|_| {
                Ok(Worker {
                    encoder: BrickEncoder::new(level)?,
                    voxels: Box::new([T::default(); STORED_VOXELS]),
                    tally: Tally::new(),
                })
            })
            .collect::<Result<Vec<_>, _>>()
            .map_err(zstd_error)?;
        Ok(Self {
            workers: Mutex::new(workers),
            totals,
            batch: batch.max(1),
        })
    }

    /// Encodes a layer and writes it: while one batch is encoded the one before it is written.
    ///
    /// # Errors
    /// The disk is full or fails; zstd has no memory.
    pub fn layer(&self, layer: &Layer<'_, T>, writer: &mut StoreWriter) -> Result<u64, BrickError> {
        let mut kept = 0;
        let mut ready: Vec<(BrickId, EncodedBrick)> = Vec::new();
        for batch in layer.order.chunks(self.batch) {
            let (encoded, written) =
                rayon::join(|| self.encode(layer, batch), || write(&ready, writer));
            kept += written?;
            ready = encoded?;
        }
        Ok(kept + write(&ready, writer)?)
    }

    fn encode(
        &self,
        layer: &Layer<'_, T>,
        batch: &[[u32; 2]],
    ) -> Result<Vec<(BrickId, EncodedBrick)>, BrickError> {
        batch
            .par_iter()
            .map(|&[x, y]| {
                let id = BrickId::new(layer.lod, UVec3::new(x, y, layer.slab.layer()));
                let mut worker = self.lend();
                border::cut(&layer.slab.window(), id.xyz, &mut worker.voxels);
                if layer.lod == Lod(0) {
                    let size = layer.grid.brick_box(id.xyz).size();
                    let size = size.to_array().map(|n| n as usize);
                    let Worker { voxels, tally, .. } = &mut worker;
                    tally.add(layer.grid.index(id.xyz), size, voxels, &self.totals);
                }
                let encoded = worker.encoder.encode(&worker.voxels);
                self.give_back(worker);
                Ok((id, encoded.map_err(zstd_error)?))
            })
            .collect()
    }

    /// The totals so far, for a journal; the counts are appended to `counts`.
    pub fn save(&self, counts: &mut Vec<u8>) -> SavedTotals {
        let mut workers = self.workers.lock().unwrap_or_else(PoisonError::into_inner);
        for worker in workers.iter_mut() {
            worker.tally.give(&self.totals);
        }
        self.totals.save(counts)
    }

    /// The statistics of all bricks of level 0.
    pub fn summary(self) -> Summary {
        let workers = self.workers.into_inner();
        for mut worker in workers.unwrap_or_else(PoisonError::into_inner) {
            worker.tally.give(&self.totals);
        }
        self.totals.summary()
    }

    fn lend(&self) -> Worker<T> {
        let mut workers = self.workers.lock().unwrap_or_else(PoisonError::into_inner);
        workers
            .pop()
            .expect("invariant: as many workers as threads")
    }

    fn give_back(&self, worker: Worker<T>) {
        let mut workers = self.workers.lock().unwrap_or_else(PoisonError::into_inner);
        workers.push(worker);
    }
}

/// Writes encoded bricks; returns how many have a record.
fn write(bricks: &[(BrickId, EncodedBrick)], writer: &mut StoreWriter) -> Result<u64, StoreError> {
    let mut kept = 0;
    for (id, brick) in bricks {
        writer.push(*id, brick)?;
        kept += u64::from(brick.record.is_some());
    }
    Ok(kept)
}

fn zstd_error(error: std::io::Error) -> BrickError {
    BrickError::System {
        doing: "compress with zstd",
        error,
    }
}
