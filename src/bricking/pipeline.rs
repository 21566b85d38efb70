//! The pass: slices in, bricks of all levels out.
//!
//! Threads: one reads the source a chunk of slices ahead; the pool's workers convert, filter and encode; one of them at a
//! time writes; one more syncs and writes the journal. The bytes of the store depend on the voxels and the options alone,
//! never on threads or memory, nor on whether the run was killed and resumed in between.

use std::path::Path;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use glam::U64Vec3;
use rayon::prelude::*;

use super::checkpoint::{Checkpointer, Parameters, Reached, checkpoints};
use super::convert::{self, FiniteRange, FromSource, Outcome};
use super::downsample::{FinePair, Mean};
use super::encode::{Layer, LayerEncoder, layer_order};
use super::error::BrickError;
use super::plan::{self, CHUNKS, LevelPlan, MemoryPlan, Needs};
use super::progress::Progress;
use super::resume::{self, Resumed, Wanted};
use super::slab::{self, Slab};
use super::stats::{Binned, Totals};
use crate::geom::{Lod, VoxelBox};
use crate::store::{
    Conversion, Existing, Journal, LevelMeta, StoreMeta, StoreWriter, Unfinished, WrittenBricks,
};
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
    /// Go on with a run to the same output that was killed, from its last checkpoint; without one, start from the
    /// beginning and say so. `false`: what such a run left is removed.
    pub resume: bool,
    /// Least time between checkpoints; they are made when a layer of bricks of level 0 is finished.
    pub checkpoint_every: Duration,
}

/// What a killed run loses is at most the work of this time and of one layer of bricks.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(1);

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
            resume: false,
            checkpoint_every: CHECKPOINT_EVERY,
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
    /// How many of them a run that was resumed had done before.
    pub bytes_resumed: u64,
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
/// was asked for: `out` is then as it was, and no scratch file is left. Or a run that was killed can't be resumed: what it
/// left stays.
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
        source_bytes: source.held_bytes(),
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
    let parameters = Parameters::new(
        &desc,
        source.stamp(),
        levels.len(),
        options.zstd_level,
        stored_type,
    );
    let job = Job {
        desc: &desc,
        levels: &levels,
        memory,
        options,
        parameters,
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
    parameters: Parameters,
    progress: &'a dyn Progress,
}

/// Some slices of the source, on their way from the reading thread.
struct Chunk {
    bytes: Vec<u8>,
    /// What replaces NaN and infinite values; there when there are any.
    range: Option<FiniteRange>,
}

/// Where the pass begins.
struct Beginning<'a, T> {
    pass: Pass<'a, T>,
    journal: Journal,
    /// Slices that came before.
    slices: u64,
    outcome: Outcome,
    range: Option<FiniteRange>,
}

impl Job<'_> {
    fn run<T: Mean + Binned + FromSource>(
        &self,
        source: &mut dyn VoxelSource,
        out: &Path,
        pool: &rayon::ThreadPool,
    ) -> Result<BrickingReport, BrickError> {
        let grids: Vec<_> = self.levels.iter().map(|l| l.grid).collect();
        let Beginning {
            mut pass,
            journal,
            slices,
            outcome,
            range,
        } = self.begin::<T>(source, out, pool)?;
        let source_tags = source.tags().into_iter().collect();
        let total = self.desc.byte_count().unwrap_or(u64::MAX);
        let dims = self.desc.dims;
        let bytes_resumed = dims.x * dims.y * slices * self.desc.voxel_type.size() as u64;
        self.progress.begin("bricking", total);
        self.progress.advance(bytes_resumed);
        let outcome = std::thread::scope(|scope| {
            let (full_in, full_out) = bounded(CHUNKS as usize);
            let (empty_in, empty_out) = bounded(CHUNKS as usize);
            for _ in 0..CHUNKS {
                let _ = empty_in.send(Vec::new());
            }
            let (checkpointer, keeper) =
                checkpoints(&self.parameters, self.options.checkpoint_every);
            scope.spawn(move || self.read(source, (slices, range), &empty_out, &full_in));
            scope.spawn(move || keeper.run(journal, self.progress));
            let chunks = Chunks {
                full: full_out,
                empty: empty_in,
            };
            pool.install(|| self.consume(&mut pass, (slices, outcome), &chunks, checkpointer))
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
            tags: source_tags,
        };
        let bytes_out = writer.finish(&meta)?;
        Ok(BrickingReport {
            voxels: VoxelBox::whole(self.desc.dims)
                .voxel_count()
                .unwrap_or(u64::MAX),
            bricks: grids.iter().map(|g| g.len()).sum(),
            kept_bricks: kept,
            bytes_in: total,
            bytes_resumed,
            bytes_out,
            seconds: 0.0,
            levels: grids.len() as u32,
            stored_type: T::TYPE,
            conversion,
            workers: self.memory.workers,
            planned_bytes: self.memory.total_bytes,
        })
    }

    /// A pass at its start, or where a killed one is gone on with.
    fn begin<T: Mean + Binned + FromSource>(
        &self,
        source: &mut dyn VoxelSource,
        out: &Path,
        pool: &rayon::ThreadPool,
    ) -> Result<Beginning<'_, T>, BrickError> {
        let left = Unfinished::exists(out);
        if self.options.resume {
            let wanted = Wanted {
                out,
                existing: self.options.existing,
                desc: self.desc,
                levels: self.levels,
                parameters: &self.parameters,
            };
            if let Some(resumed) = wanted.find::<T>()? {
                return self.go_on(source, out, resumed, pool);
            }
        }
        let grids: Vec<_> = self.levels.iter().map(|l| l.grid).collect();
        let writer = StoreWriter::create(out, self.options.existing, T::TYPE, &grids)?;
        let journal = writer.journal()?;
        let said = match (self.options.resume, left) {
            (true, true) => Some(
                "nothing to resume: the run before was killed too early; starting from the beginning",
            ),
            (true, false) => {
                Some("nothing to resume: no unfinished run is there; starting from the beginning")
            }
            (false, true) => Some(
                "note: what a killed run left is removed; starting from the beginning (without --resume)",
            ),
            (false, false) => None,
        };
        if let Some(said) = said {
            self.progress.note(said);
        }
        Ok(Beginning {
            pass: self.pass(writer, Totals::new())?,
            journal,
            slices: 0,
            outcome: Outcome::default(),
            range: self.options.finite_range,
        })
    }

    fn pass<T: Mean + Binned>(
        &self,
        writer: StoreWriter,
        totals: Totals<T>,
    ) -> Result<Pass<'_, T>, BrickError> {
        let MemoryPlan { workers, batch, .. } = self.memory;
        let zstd_level = self.options.zstd_level;
        Ok(Pass {
            levels: self.levels,
            slabs: self
                .levels
                .iter()
                .map(|l| Slab::new(l.grid.voxels))
                .collect(),
            orders: self.levels.iter().map(|l| layer_order(&l.grid)).collect(),
            encoder: LayerEncoder::new(workers, zstd_level, batch, totals)?,
            writer,
            kept: 0,
        })
    }

    /// The pass as it was at a checkpoint.
    fn go_on<T: Mean + Binned + FromSource>(
        &self,
        source: &mut dyn VoxelSource,
        out: &Path,
        resumed: Resumed<T>,
        pool: &rayon::ThreadPool,
    ) -> Result<Beginning<'_, T>, BrickError> {
        let Resumed {
            state,
            totals,
            writer,
            journal,
            mut written,
        } = resumed;
        let depth = self.desc.dims.z;
        self.progress.note(&format!(
            "resuming after slice {} of {depth} ({:.0} %)",
            state.slices,
            state.slices as f64 / depth as f64 * 100.0
        ));
        let range = state.finite_range().or(self.options.finite_range);
        let mut pass = self.pass(writer, totals)?;
        pass.kept = state.kept;
        let slab = &mut pass.slabs[0];
        slab.go_on(slab::complete_layers(depth, state.slices), state.slices);
        self.refill(source, slab, range)?;
        pool.install(|| {
            let same = self.source_is_the_same(&pass.slabs[0], &mut written)?;
            if !same {
                return Err(BrickError::SourceChanged {
                    out: out.to_owned(),
                    name: self.desc.name.clone(),
                    slice: pass.slabs[0].first_z(),
                });
            }
            let batch = self.memory.batch;
            resume::rebuild_slabs(self.levels, &mut pass.slabs, &mut written, batch)
        })?;
        pass.writer.own_unfinished();
        Ok(Beginning {
            pass,
            journal,
            slices: state.slices,
            outcome: state.outcome(),
            range,
        })
    }

    fn source_is_the_same<T: Binned>(
        &self,
        slab: &Slab<T>,
        written: &mut WrittenBricks,
    ) -> Result<bool, BrickError> {
        // Of the last layer nothing is held: nothing is left to be read either.
        if written.layers(0) == 0 || slab.first_z() == slab.next_z() {
            return Ok(true);
        }
        let slice = slab.slice(slab.first_z());
        resume::source_is_the_same(slice, &self.levels[0], written, self.memory.batch)
    }

    /// Reads the slices of the source that the slab of level 0 holds; a stream from its start.
    fn refill<T: FromSource>(
        &self,
        source: &mut dyn VoxelSource,
        slab: &mut Slab<T>,
        range: Option<FiniteRange>,
    ) -> Result<(), BrickError> {
        let dims = self.desc.dims;
        let slice_bytes = dims.x * dims.y * self.desc.voxel_type.size() as u64;
        let (first, next) = (slab.first_z(), slab.next_z());
        let is_stream = source.order() == ReadOrder::ForwardZ;
        if is_stream {
            self.progress
                .note("a compressed stream has to be read again from its start up to there");
        }
        let from = if is_stream { 0 } else { first };
        let mut bytes = vec![0; slice_bytes as usize];
        self.progress
            .begin("reading again", (next - from) * slice_bytes);
        for z in from..next {
            let slice = VoxelBox::new(U64Vec3::new(0, 0, z), U64Vec3::new(dims.x, dims.y, z + 1));
            source.read_box(slice, &mut bytes)?;
            if z >= first {
                // Counted when it came first.
                let _ = convert_slice(self.desc, &bytes, range, slab.slice_mut(z));
            }
            self.progress.advance(slice_bytes);
        }
        self.progress.end();
        Ok(())
    }

    /// The reading thread: fills buffers, from slice `z` on, until the source or the other side ends.
    fn read(
        &self,
        source: &mut dyn VoxelSource,
        (mut z, mut range): (u64, Option<FiniteRange>),
        empty: &Receiver<Vec<u8>>,
        full: &Sender<Result<Chunk, BrickError>>,
    ) {
        let dims = self.desc.dims;
        let voxel_type = self.desc.voxel_type;
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
                    Ok(Chunk { bytes, range })
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

    /// Takes chunks until all slices came; `z` of them came before.
    fn consume<T: Mean + Binned + FromSource>(
        &self,
        pass: &mut Pass<'_, T>,
        (mut z, mut outcome): (u64, Outcome),
        chunks: &Chunks,
        mut checkpointer: Checkpointer<'_>,
    ) -> Result<Outcome, BrickError> {
        let dims = self.desc.dims;
        let slice_len = (dims.x * dims.y) as usize;
        let slice_bytes = slice_len * self.desc.voxel_type.size();
        while z < dims.z {
            let chunk = chunks
                .full
                .recv()
                .expect("invariant: the reading thread sends every slice, or an error")?;
            for bytes in chunk.bytes.chunks_exact(slice_bytes) {
                let found = convert_slice(self.desc, bytes, chunk.range, pass.slabs[0].room());
                if let Some((at, value)) = found.misfit {
                    return Err(self.misfit::<T>(U64Vec3::new(at % dims.x, at / dims.x, z), value));
                }
                outcome = outcome.then(found, slice_len as u64);
                let layer = pass.slabs[0].layer();
                pass.slabs[0].push();
                pass.slice_came(0)?;
                z += 1;
                if pass.slabs[0].layer() != layer {
                    let reached = Reached {
                        slices: z,
                        kept: pass.kept,
                        outcome,
                        finite_range: chunk.range,
                    };
                    let encoder = &pass.encoder;
                    checkpointer.offer(&mut pass.writer, reached, |counts| encoder.save(counts))?;
                }
            }
            self.progress.advance(chunk.bytes.len() as u64);
            // The reading thread may have ended already.
            let _ = chunks.empty.send(chunk.bytes);
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

/// The other side of the reading thread: full buffers from it, empty ones to it.
struct Chunks {
    full: Receiver<Result<Chunk, BrickError>>,
    empty: Sender<Vec<u8>>,
}

/// Voxels that a thread converts or filters at once.
const BLOCK_VOXELS: usize = 1 << 16;

/// Converts a slice on all threads.
fn convert_slice<T: FromSource>(
    desc: &VolumeDesc,
    bytes: &[u8],
    range: Option<FiniteRange>,
    out: &mut [T],
) -> Outcome {
    // Not looked at unless there is something to replace.
    let range = range.unwrap_or(FiniteRange { min: 0.0, max: 0.0 });
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

impl<T: Mean + Binned> Pass<'_, T> {
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
pub(super) fn downsample<T: Mean>(fine: &Slab<T>, z: u64, plan: &LevelPlan, coarse: &mut Slab<T>) {
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
