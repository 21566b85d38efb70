//! What a run writes down now and then, so that it can be gone on with when it is killed: how far it has come, the
//! statistics so far, and for which source and options. The voxels in the slabs are not among it: [`super::resume`] makes
//! them again from the source and from the bricks that are written.
//!
//! ```text
//! offset  bytes  content of a checkpoint's state
//!      0      4  length of the JSON, u32
//!      4      …  JSON: parameters, slices done, counts of changed values, hash, range
//!                level 0's histogram: per bin that is not empty its number, u32, and its count, u64
//! ```
//! Syncing and writing is done by a thread of its own, while the pass goes on. The pass only hands its buffers to the
//! system and copies the statistics; [`COST_SHARE`] bounds what that may cost.

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use glam::{DVec3, U64Vec3};
use serde::{Deserialize, Serialize};

use super::convert::{FiniteRange, Outcome};
use super::error::BrickError;
use super::progress::Progress;
use super::stats::SavedTotals;
use crate::store::writer::WriterMark;
use crate::store::{Journal, StoreWriter};
use crate::volume::{Rescale, StoredType, VolumeDesc, VoxelType};

/// The pass spends at most 1 / this of its time on checkpoints.
const COST_SHARE: u32 = 100;

/// All that the bytes of a store depend on, but the voxels themselves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Version of this program. First, and of this name in every version: see [`State::version`].
    brickscope: String,
    source_name: String,
    source_stamp: String,
    dims: U64Vec3,
    source_type: VoxelType,
    world_from_index: [DVec3; 4],
    rescale: Rescale,
    unit: String,
    levels: usize,
    zstd_level: i32,
    stored_type: StoredType,
}

impl Parameters {
    /// Those of a run.
    pub fn new(
        desc: &VolumeDesc,
        source_stamp: String,
        levels: usize,
        zstd_level: i32,
        stored_type: StoredType,
    ) -> Self {
        let m = desc.world_from_index.matrix3;
        Self {
            brickscope: version().to_owned(),
            source_name: desc.name.clone(),
            source_stamp,
            dims: desc.dims,
            source_type: desc.voxel_type,
            world_from_index: [
                m.x_axis,
                m.y_axis,
                m.z_axis,
                desc.world_from_index.translation,
            ],
            rescale: desc.rescale,
            unit: desc.unit.clone(),
            levels,
            zstd_level,
            stored_type,
        }
    }

    /// In what a run with these parameters differs from one that was begun with `begun`, in words.
    pub fn differences(&self, begun: &Self) -> Vec<String> {
        let affine = |p: &Self| format!("{:?}", p.world_from_index.map(|c| c.to_array()));
        let rows = |p: &Self| {
            [
                ("the version of brickscope", p.brickscope.clone()),
                ("the source", p.source_name.clone()),
                ("the size in voxels", p.dims.to_string()),
                ("the voxel type", p.source_type.to_string()),
                ("the affine", affine(p)),
                ("the rescale", format!("{:?}", p.rescale)),
                ("the unit", p.unit.clone()),
                ("the source's file", p.source_stamp.clone()),
                ("--levels", p.levels.to_string()),
                ("--zstd", p.zstd_level.to_string()),
                ("the stored type (--store-type)", p.stored_type.to_string()),
            ]
        };
        rows(begun)
            .into_iter()
            .zip(rows(self))
            .filter(|(was, is)| was != is)
            .map(|((what, was), (_, is))| format!("{what} was {was} and is {is}"))
            .collect()
    }
}

/// Version of this program.
pub fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// How far a pass has come, and what it has found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What it is a state of.
    pub parameters: Parameters,
    /// Slices of the source that came.
    pub slices: u64,
    /// Bricks with a record so far.
    pub kept: u64,
    lossy_values: u64,
    nan_values: u64,
    inf_values: u64,
    /// What replaces NaN and infinite values, once it had to be known.
    finite_range: Option<[f64; 2]>,
    /// The statistics, beside the counts.
    pub totals: SavedTotals,
}

impl State {
    /// The bytes for the journal; `counts` are those of the histogram.
    fn encode(&self, counts: &[u8], out: &mut Vec<u8>) {
        let json =
            serde_json::to_vec(self).expect("invariant: plain numbers and strings become JSON");
        out.clear();
        out.extend((json.len() as u32).to_le_bytes());
        out.extend(json);
        out.extend_from_slice(counts);
    }

    /// The state and the counts in `bytes`; `None` when they hold none.
    pub fn decode(bytes: &[u8]) -> Option<(Self, &[u8])> {
        let (json, counts) = Self::split(bytes)?;
        Some((serde_json::from_slice(json).ok()?, counts))
    }

    /// The version of the program that wrote `bytes`, also where its state has other fields than ours.
    pub fn version(bytes: &[u8]) -> Option<String> {
        #[derive(Deserialize)]
        struct Any {
            parameters: Version,
        }
        #[derive(Deserialize)]
        struct Version {
            brickscope: String,
        }
        let (json, _) = Self::split(bytes)?;
        let any: Any = serde_json::from_slice(json).ok()?;
        Some(any.parameters.brickscope)
    }

    fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
        let (len, rest) = bytes.split_first_chunk()?;
        rest.split_at_checked(u32::from_le_bytes(*len) as usize)
    }

    /// What converting voxels found so far.
    pub fn outcome(&self) -> Outcome {
        Outcome {
            lossy: self.lossy_values,
            nan: self.nan_values,
            inf: self.inf_values,
            misfit: None,
        }
    }

    /// What replaces NaN and infinite values, once it had to be known.
    pub fn finite_range(&self) -> Option<FiniteRange> {
        self.finite_range.map(|[min, max]| FiniteRange { min, max })
    }
}

/// How far the pass has come, as it says itself.
#[derive(Clone, Copy, Debug)]
pub struct Reached {
    /// Slices of the source that came.
    pub slices: u64,
    /// Bricks with a record so far.
    pub kept: u64,
    /// What converting voxels found.
    pub outcome: Outcome,
    /// What replaces NaN and infinite values, once it had to be known.
    pub finite_range: Option<FiniteRange>,
}

/// A checkpoint on its way to the journal.
pub struct Order {
    mark: WriterMark,
    state: Vec<u8>,
}

/// The pass's side: decides when a checkpoint is due, and makes it.
pub struct Checkpointer<'a> {
    parameters: &'a Parameters,
    every: Duration,
    wait: Duration,
    last: Instant,
    counts: Vec<u8>,
    orders: Sender<Order>,
    /// The buffer that is not in use: there while the journal's thread has nothing to do.
    spare: Receiver<Vec<u8>>,
}

/// The thread's side.
pub struct JournalKeeper {
    orders: Receiver<Order>,
    spare: Sender<Vec<u8>>,
}

/// Both sides; a checkpoint is due when `every` has passed since the one before.
pub fn checkpoints(parameters: &Parameters, every: Duration) -> (Checkpointer<'_>, JournalKeeper) {
    let (orders_in, orders_out) = bounded(1);
    let (spare_in, spare_out) = bounded(1);
    // Both ends are alive.
    let _ = spare_in.send(Vec::new());
    let checkpointer = Checkpointer {
        parameters,
        every,
        wait: every,
        last: Instant::now(),
        counts: Vec::new(),
        orders: orders_in,
        spare: spare_out,
    };
    let keeper = JournalKeeper {
        orders: orders_out,
        spare: spare_in,
    };
    (checkpointer, keeper)
}

impl Checkpointer<'_> {
    /// Makes a checkpoint if one is due and the one before is on the disk. Every level must be between two layers.
    ///
    /// # Errors
    /// The store can't be written.
    pub fn offer(
        &mut self,
        writer: &mut StoreWriter,
        reached: Reached,
        save_totals: impl FnOnce(&mut Vec<u8>) -> SavedTotals,
    ) -> Result<(), BrickError> {
        let begin = Instant::now();
        if begin.duration_since(self.last) < self.wait {
            return Ok(());
        }
        let Ok(mut state) = self.spare.try_recv() else {
            return Ok(());
        };
        let mark = writer.mark()?;
        self.counts.clear();
        let totals = save_totals(&mut self.counts);
        let Outcome {
            lossy, nan, inf, ..
        } = reached.outcome;
        State {
            parameters: self.parameters.clone(),
            slices: reached.slices,
            kept: reached.kept,
            lossy_values: lossy,
            nan_values: nan,
            inf_values: inf,
            finite_range: reached.finite_range.map(|r| [r.min, r.max]),
            totals,
        }
        .encode(&self.counts, &mut state);
        // The thread waits for orders as long as we live.
        let _ = self.orders.send(Order { mark, state });
        self.last = Instant::now();
        self.wait = self.every.max(self.last.duration_since(begin) * COST_SHARE);
        Ok(())
    }
}

impl JournalKeeper {
    /// Writes what is ordered until there are no more orders. A journal that can't be written is told and given up; the
    /// store itself is no worse for it.
    pub fn run(self, mut journal: Journal, progress: &dyn Progress) {
        for order in self.orders {
            if let Err(error) = journal.write(&order.mark, &order.state) {
                progress.note(&format!(
                    "note: {error}; the work goes on, but could not be resumed from here if it were killed"
                ));
                return;
            }
            if self.spare.send(order.state).is_err() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::super::stats::Totals;
    use super::*;

    fn parameters() -> Parameters {
        let desc = VolumeDesc {
            dims: U64Vec3::new(5, 6, 7),
            voxel_type: VoxelType::I16,
            world_from_index: DAffine3::from_scale(DVec3::new(0.1, 0.2, 1.0 / 3.0)),
            rescale: Rescale::IDENTITY,
            unit: "HU".into(),
            name: "a.nii".into(),
        };
        Parameters::new(&desc, "9 bytes".into(), 3, 1, StoredType::U16)
    }

    #[test]
    fn states_come_back_and_rubbish_does_not() {
        let state = State {
            parameters: parameters(),
            slices: 33,
            kept: 4,
            lossy_values: 1,
            nan_values: 2,
            inf_values: u64::MAX,
            finite_range: Some([-0.1, f64::MAX]),
            totals: Totals::<u16>::new().save(&mut Vec::new()),
        };
        let mut bytes = Vec::new();
        state.encode(&[1, 2, 3], &mut bytes);
        assert_eq!(
            State::decode(&bytes),
            Some((state, &[1, 2, 3][..])),
            "to the bit"
        );
        assert_eq!(State::version(&bytes).as_deref(), Some(version()));
        let json_end = bytes.len() - 3;
        for len in 0..json_end {
            assert_eq!(State::decode(&bytes[..len]), None, "cut at {len}");
        }
        bytes[0..4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(State::decode(&bytes), None, "a length beyond the bytes");
        let future = br#"{"parameters":{"brickscope":"9.0.0","what":1},"more":2}"#;
        let mut bytes = (future.len() as u32).to_le_bytes().to_vec();
        bytes.extend(future);
        assert_eq!(
            State::version(&bytes).as_deref(),
            Some("9.0.0"),
            "another version can be named"
        );
    }

    #[test]
    fn differences_are_named() {
        let begun = parameters();
        assert_eq!(begun.differences(&begun), [""; 0], "none");
        let now = Parameters {
            zstd_level: 3,
            source_stamp: "10 bytes".into(),
            ..begun.clone()
        };
        assert_eq!(
            now.differences(&begun),
            [
                "the source's file was 9 bytes and is 10 bytes",
                "--zstd was 1 and is 3"
            ]
        );
    }
}
