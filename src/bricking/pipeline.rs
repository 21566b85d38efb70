//! The pass: slices in, bricks of all levels out.
//!
//! Threads: one reads the source a chunk of slices ahead; the pool's workers convert, filter and encode; one of them at a
//! time writes. The bytes of the store depend on the voxels and the options alone, never on threads or memory.

use std::path::Path;
use std::time::Instant;

use crossbeam_channel::{Receiver, Sender, bounded};
use glam::U64Vec3;
use rayon::prelude::*;

use super::convert::{self, FiniteRange, FromSource, Outcome};
use super::downsample::{FinePair, Mean};
use super::encode::{Layer, LayerEncoder, layer_order};
use super::error::BrickError;
use super::plan::{self, CHUNKS, LevelPlan, MemoryPlan, Needs};
use super::progress::Progress;
use super::slab::Slab;
use super::stats::Binned;
use crate::geom::{Lod, VoxelBox};
use crate::store::{Conversion, Existing, LevelMeta, StoreMeta, StoreWriter};
use crate::volume::{ReadOrder, Rescale, StoredType, VolumeDesc, VoxelSource};

/// How to brick.
#[derive(Clone, Copy, Debug)]
pub struct BrickOptions {
    /// Most levels; `None`: down to a level of one brick.
    pub levels: Option<u32>,
    /// zstd's level.
    pub zstd_level: i32,
    /// What the process may take, in bytes; at least 128 MiB.
    pub memory_bytes: u64,
    /// Threads that encode; `None`: as many as the machine has. Fewer are used when the memory does not hold their
    /// buffers.
    pub threads: Option<usize>,
    /// Type of the stored voxels; `None`: [`convert::default_type`].
    pub store_type: Option<StoredType>,
    /// May an existing output be replaced?
    pub existing: Existing,
    /// What replaces NaN and infinite values. `None`: found in a pass of its own when the first of them comes, which
    /// only [`ReadOrder::Random`] sources allow.
    pub finite_range: Option<FiniteRange>,
}

impl Default for BrickOptions {
    fn default() -> Self {
        Self {
            levels: None,
            zstd_level: 1,
            memory_bytes: 1 << 30,
            threads: None,
            store_type: None,
            existing: Existing::Refuse,
            finite_range: None,
        }
    }
}

/// What was done.
#[derive(Clone, Debug, PartialEq)]
pub struct BrickingReport {
    /// Voxels of the volume.
    pub voxels: u64,
    /// Bricks of all levels.
    pub bricks: u64,
    /// Bricks with a record: those that are not Constant.
    pub kept_bricks: u64,
    /// Bytes of the source's voxels.
    pub bytes_in: u64,
    /// Bytes of the store.
    pub bytes_out: u64,
    /// Wall-clock time.
    pub seconds: f64,
    /// Levels made.
    pub levels: u32,
    /// Type of the stored voxels.
    pub stored_type: StoredType,
    /// How source values became stored ones.
    pub conversion: Conversion,
    /// Threads that encoded.
    pub workers: usize,
    /// Bytes that the memory plan came to.
    pub planned_bytes: u64,
}

/// Bricks `source` into the store `out`.
///
/// # Errors
/// The source can't be read, the store can't be written, the memory is too small, or a value does not fit the type that
/// was asked for. `out` is then as it was, and no scratch file is left.
pub fn brick(
    source: &mut dyn VoxelSource,
    out: &Path,
    options: &BrickOptions,
    progress: &dyn Progress,
) -> Result<BrickingReport, BrickError> {
    let desc = source.desc().clone();
    let stored_type = options
        .store_type
        .unwrap_or_else(|| convert::default_type(desc.voxel_type));
    let levels = plan::levels(&desc.name, desc.dims, desc.spacing(), options.levels)?;
    let threads = options
        .threads
        .or_else(|| std::thread::available_parallelism().ok().map(Into::into))
        .unwrap_or(1);
    let needs = Needs {
        name: &desc.name,
        source_type: desc.voxel_type,
        stored_type,
        levels: &levels,
        threads,
        zstd_level: options.zstd_level,
    };
    let memory = needs.plan(options.memory_bytes)?;
    if options.threads.is_some_and(|asked| memory.workers < asked) {
        progress.note(&format!(
            "{} of {threads} threads encode: the memory does not hold the buffers of more",
            memory.workers
        ));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(memory.workers)
        .thread_name(|i| format!("brick {i}"))
        .build()
        .map_err(|e| BrickError::System {
            doing: "start threads",
            error: std::io::Error::other(e),
        })?;
    let job = Job {
        desc: &desc,
        levels: &levels,
        memory,
        options,
        progress,
    };
    let start = Instant::now();
    let mut report = match stored_type {
        StoredType::U8 => job.run::<u8>(source, out, &pool),
        StoredType::U16 => job.run::<u16>(source, out, &pool),
        StoredType::F32 => job.run::<f32>(source, out, &pool),
    }?;
    report.seconds = start.elapsed().as_secs_f64();
    Ok(report)
}

/// What stays the same during the pass.
struct Job<'a> {
    desc: &'a VolumeDesc,
    levels: &'a [LevelPlan],
    memory: MemoryPlan,
    options: &'a BrickOptions,
    progress: &'a dyn Progress,
}

/// Some slices of the source, on their way from the reading thread.
struct Chunk {
    bytes: Vec<u8>,
    range: FiniteRange,
}

impl Job<'_> {
    fn run<T: Mean + Binned + FromSource>(
        &self,
        source: &mut dyn VoxelSource,
        out: &Path,
        pool: &rayon::ThreadPool,
    ) -> Result<BrickingReport, BrickError> {
        let grids: Vec<_> = self.levels.iter().map(|l| l.grid).collect();
        let writer = StoreWriter::create(out, self.options.existing, T::TYPE, &grids)?;
        let mut pass = Pass::<T>::new(self.levels, writer, self.memory, self.options.zstd_level)?;
        let total = self.desc.byte_count().unwrap_or(u64::MAX);
        self.progress.begin("bricking", total);
        let outcome = std::thread::scope(|scope| {
            let (full_in, full_out) = bounded(CHUNKS as usize);
            let (empty_in, empty_out) = bounded(CHUNKS as usize);
            for _ in 0..CHUNKS {
                let _ = empty_in.send(Vec::new());
            }
            scope.spawn(move || self.read(source, &empty_out, &full_in));
            pool.install(|| self.consume(&mut pass, &full_out, &empty_in))
        });
        self.progress.end();
        let outcome = outcome?;
        let Pass {
            encoder,
            writer,
            kept,
            ..
        } = pass;
        let summary = encoder.summary();
        let offset = convert::offset(self.desc.voxel_type, T::TYPE);
        let conversion = Conversion {
            offset,
            lossy_values: outcome.lossy,
            nan_values: outcome.nan,
            inf_values: outcome.inf,
        };
        let source_rescale = self.desc.rescale;
        let meta = StoreMeta {
            dims: self.desc.dims,
            source_type: self.desc.voxel_type,
            stored_type: T::TYPE,
            conversion,
            rescale: Rescale {
                slope: source_rescale.slope,
                intercept: source_rescale.intercept - source_rescale.slope * f64::from(offset),
            },
            source_rescale,
            world_from_index: self.desc.world_from_index,
            unit: self.desc.unit.clone(),
            value_min: summary.min,
            value_max: summary.max,
            histogram: summary.histogram,
            percentiles: summary.percentiles,
            levels: self
                .levels
                .iter()
                .map(|l| LevelMeta {
                    dims: l.grid.voxels,
                    scale: l.scale,
                })
                .collect(),
            source_name: self.desc.name.clone(),
            source_hash: summary.hash,
            writer: concat!("brickscope ", env!("CARGO_PKG_VERSION")).to_owned(),
        };
        let bytes_out = writer.finish(&meta)?;
        Ok(BrickingReport {
            voxels: VoxelBox::whole(self.desc.dims)
                .voxel_count()
                .unwrap_or(u64::MAX),
            bricks: grids.iter().map(|g| g.len()).sum(),
            kept_bricks: kept,
            bytes_in: total,
            bytes_out,
            seconds: 0.0,
            levels: grids.len() as u32,
            stored_type: T::TYPE,
            conversion,
            workers: self.memory.workers,
            planned_bytes: self.memory.total_bytes,
        })
    }

    /// The reading thread: fills buffers until the source or the other side ends.
    fn read(
        &self,
        source: &mut dyn VoxelSource,
        empty: &Receiver<Vec<u8>>,
        full: &Sender<Result<Chunk, BrickError>>,
    ) {
        let dims = self.desc.dims;
        let voxel_type = self.desc.voxel_type;
        let mut range = self.options.finite_range;
        let mut z = 0;
        while z < dims.z {
            let Ok(mut bytes) = empty.recv() else { return };
            let end = dims.z.min(z + self.memory.chunk_slices);
            let len = dims.x * dims.y * (end - z) * voxel_type.size() as u64;
            bytes.resize(len as usize, 0);
            let slices = VoxelBox::new(U64Vec3::new(0, 0, z), U64Vec3::new(dims.x, dims.y, end));
            let read = source
                .read_box(slices, &mut bytes)
                .map_err(BrickError::from)
                .and_then(|()| {
                    if range.is_none() && !convert::all_finite(voxel_type, &bytes) {
                        range = Some(self.find_range(source)?);
                    }
                    Ok(Chunk {
                        bytes,
                        range: range.unwrap_or(FiniteRange { min: 0.0, max: 0.0 }),
                    })
                });
            let failed = read.is_err();
            if full.send(read).is_err() || failed {
                return;
            }
            z = end;
        }
    }

    fn find_range(&self, source: &mut dyn VoxelSource) -> Result<FiniteRange, BrickError> {
        if source.order() != ReadOrder::Random {
            return Err(BrickError::FiniteRangeNeeded {
                name: self.desc.name.clone(),
            });
        }
        self.progress.note(
            "NaN or infinite values found: reading the whole source once more for its finite range",
        );
        Ok(convert::finite_range(source, self.memory.chunk_slices)?)
    }

    /// Takes chunks until all slices came.
    fn consume<T: Mean + Binned + FromSource>(
        &self,
        pass: &mut Pass<'_, T>,
        full: &Receiver<Result<Chunk, BrickError>>,
        empty: &Sender<Vec<u8>>,
    ) -> Result<Outcome, BrickError> {
        let dims = self.desc.dims;
        let slice_len = (dims.x * dims.y) as usize;
        let slice_bytes = slice_len * self.desc.voxel_type.size();
        let mut outcome = Outcome::default();
        let mut z = 0;
        while z < dims.z {
            let chunk = full
                .recv()
                .expect("invariant: the reading thread sends every slice, or an error")?;
            for bytes in chunk.bytes.chunks_exact(slice_bytes) {
                let found = convert_slice(self.desc, bytes, chunk.range, pass.slabs[0].room());
                if let Some((at, value)) = found.misfit {
                    return Err(self.misfit::<T>(U64Vec3::new(at % dims.x, at / dims.x, z), value));
                }
                outcome = outcome.then(found, slice_len as u64);
                pass.slabs[0].push();
                pass.slice_came(0)?;
                z += 1;
            }
            self.progress.advance(chunk.bytes.len() as u64);
            // The reading thread may have ended already.
            let _ = empty.send(chunk.bytes);
        }
        Ok(outcome)
    }

    fn misfit<T: FromSource>(&self, voxel: U64Vec3, value: f64) -> BrickError {
        let offset = i64::from(convert::offset(self.desc.voxel_type, T::TYPE));
        let greatest: i64 = match T::TYPE {
            StoredType::U8 => 255,
            _ => 65535,
        };
        BrickError::Value {
            name: self.desc.name.clone(),
            voxel,
            value,
            source_type: self.desc.voxel_type,
            store_type: T::TYPE,
            range: format!("whole numbers from {} to {}", -offset, greatest - offset),
        }
    }
}

/// Voxels that a thread converts or filters at once.
const BLOCK_VOXELS: usize = 1 << 16;

/// Converts a slice on all threads.
fn convert_slice<T: FromSource>(
    desc: &VolumeDesc,
    bytes: &[u8],
    range: FiniteRange,
    out: &mut [T],
) -> Outcome {
    let size = desc.voxel_type.size();
    let (outcome, _) = out
        .par_chunks_mut(BLOCK_VOXELS)
        .zip(bytes.par_chunks(BLOCK_VOXELS * size))
        .map(|(out, bytes)| {
            let found = T::convert(desc.voxel_type, bytes, range, out);
            (found, out.len() as u64)
        })
        .reduce(
            || (Outcome::default(), 0),
            |(a, n), (b, m)| (a.then(b, n), n + m),
        );
    outcome
}

/// What moves during the pass.
struct Pass<'a, T> {
    levels: &'a [LevelPlan],
    slabs: Vec<Slab<T>>,
    orders: Vec<Vec<[u32; 2]>>,
    encoder: LayerEncoder<T>,
    writer: StoreWriter,
    kept: u64,
}

impl<'a, T: Mean + Binned> Pass<'a, T> {
    fn new(
        levels: &'a [LevelPlan],
        writer: StoreWriter,
        memory: MemoryPlan,
        zstd_level: i32,
    ) -> Result<Self, BrickError> {
        Ok(Self {
            levels,
            slabs: levels.iter().map(|l| Slab::new(l.grid.voxels)).collect(),
            orders: levels.iter().map(|l| layer_order(&l.grid)).collect(),
            encoder: LayerEncoder::new(memory.workers, zstd_level, memory.batch)?,
            writer,
            kept: 0,
        })
    }

    /// A slice was pushed to level `l`: makes the slice of the level above that is now complete, and writes the layer of
    /// bricks that is.
    fn slice_came(&mut self, l: usize) -> Result<(), BrickError> {
        let z = self.slabs[l].next_z() - 1;
        if let Some(coarser) = self.levels.get(l + 1) {
            let halve_z = coarser.halved.z;
            if !halve_z || z % 2 == 1 || z + 1 == self.slabs[l].dims().z {
                let (fine, coarse) = self.slabs.split_at_mut(l + 1);
                downsample(&fine[l], z, coarser, &mut coarse[0]);
                self.slice_came(l + 1)?;
            }
        }
        // A last slice that alone begins a layer of bricks completes two.
        while self.slabs[l].is_layer_complete() {
            let layer = Layer {
                lod: Lod(l as u8),
                grid: &self.levels[l].grid,
                slab: &self.slabs[l],
                order: &self.orders[l],
            };
            self.kept += self.encoder.layer(&layer, &mut self.writer)?;
            self.slabs[l].roll();
        }
        Ok(())
    }
}

/// Makes the slice of `coarse` whose last fine slice is `z`.
fn downsample<T: Mean>(fine: &Slab<T>, z: u64, plan: &LevelPlan, coarse: &mut Slab<T>) {
    let paired = plan.halved.z && z % 2 == 1;
    let pair = FinePair {
        lower: fine.slice(if paired { z - 1 } else { z }),
        upper: paired.then(|| fine.slice(z)),
        width: fine.dims().x as usize,
        halve: [plan.halved.x, plan.halved.y],
    };
    let width = pair.coarse_width();
    let rows = (BLOCK_VOXELS / 4 / width).max(1);
    coarse
        .room()
        .par_chunks_mut(rows * width)
        .enumerate()
        .for_each_init(Vec::new, |sums, (i, out)| pair.rows(i * rows, out, sums));
    coarse.push();
}
