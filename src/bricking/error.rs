//! What can go wrong while bricking.

use std::path::PathBuf;

use glam::U64Vec3;
use thiserror::Error;

use crate::store::StoreError;
use crate::volume::{SourceError, StoredType, VoxelType};

/// Why a volume can't be bricked. No output file is left behind; what a killed run left is kept when it can't be resumed.
#[derive(Debug, Error)]
pub enum BrickError {
    /// The input can't be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The output can't be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A slab of this volume does not fit the memory.
    #[error(
        "{name}: slabs of 34 slices of {} × {} voxels, for all levels, need --memory {needed_mib}MiB, \
             given were {given_mib}MiB; give --memory {needed_mib}MiB or more",
        dims.x, dims.y
    )]
    Memory {
        /// The source.
        name: String,
        /// Voxels of the volume.
        dims: U64Vec3,
        /// The smallest number of MiB that works.
        needed_mib: u64,
        /// What was allowed.
        given_mib: u64,
    },
    /// The memory asked for is below what any volume needs.
    #[error("--memory {given_mib}MiB is too small; give 128MiB or more")]
    MemoryFloor {
        /// What was allowed.
        given_mib: u64,
    },
    /// More levels than a store can have, or a volume beyond its grid.
    #[error("{name}: {} × {} × {} voxels need {what}; {remedy}", dims.x, dims.y, dims.z)]
    TooLarge {
        /// The source.
        name: String,
        /// Voxels of the volume.
        dims: U64Vec3,
        /// What is too much.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A value does not fit the stored type that was asked for.
    #[error(
        "{name}: voxel ({}, {}, {}) is {value}, which {store_type} can't hold: {source_type} values are kept as \
             {store_type} only if all are {range}; use --store-type auto",
        voxel.x, voxel.y, voxel.z
    )]
    Value {
        /// The source.
        name: String,
        /// The first such voxel.
        voxel: U64Vec3,
        /// Its value.
        value: f64,
        /// Type of the source.
        source_type: VoxelType,
        /// Type that was asked for.
        store_type: StoredType,
        /// What it can hold.
        range: String,
    },
    /// The run that is to be gone on with was begun with another input or other options.
    #[error(
        "{}: cannot be resumed: {differences}; give the input and options that it was begun with, or leave out --resume \
             to start from the beginning",
        out.display()
    )]
    OtherRun {
        /// The store to be written.
        out: PathBuf,
        /// What was and is, in words.
        differences: String,
    },
    /// The source has other voxels than when the run that is to be gone on with was begun.
    #[error(
        "{}: cannot be resumed: slice {slice} of {name} is not what it was when the bricking began; bring the old input \
             back, or leave out --resume to start from the beginning",
        out.display()
    )]
    SourceChanged {
        /// The store to be written.
        out: PathBuf,
        /// The source.
        name: String,
        /// The slice that differs.
        slice: u64,
    },
    /// NaN or infinite values in a source that can be read only once: the finite range must be known beforehand.
    #[error(
        "{name}: NaN or infinite values in a source that can be read only once; find its finite range in a pass \
             of its own first"
    )]
    FiniteRangeNeeded {
        /// The source.
        name: String,
    },
    /// The system refused a thread or a buffer.
    #[error("cannot {doing}: {error}")]
    System {
        /// What was tried.
        doing: &'static str,
        /// What it said.
        error: std::io::Error,
    },
}
