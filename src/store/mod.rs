//! The brick store (`.bsk`): one memory-mapped file of compressed bricks at all levels of detail.
//!
//! What is here: the layout of the file ([`header`], [`index`], [`meta`], [`codec`]), a [`StoreWriter`] that appends
//! records in one pass, its [`journal`] and what a killed process leaves ([`unfinished`]), and a [`Store`] that reads
//! them. What is not: threads, caches and policy (those are in
//! `bricking` and `pager`), and how the levels are made (`bricking::downsample`).
//!
//! ```text
//! 0             header                      1280 bytes: header.rs
//! 1280          records of level 0          in the order of the pass, Morton inside a layer of bricks: codec.rs
//!               records of level 1, 2, …    one contiguous range each: the tail of the file is the preview
//!   ↑64         metadata                    JSON, at most 16 MiB: meta.rs
//!   ↑64         index of level 0            32 bytes per brick, x fastest: index.rs
//!   ↑64         index of level 1, 2, …      the last one ends the file
//! ```
//! `↑64`: the section starts at the next multiple of 64; the padding is zero. Everything is little-endian. No byte is
//! outside a checksum: header, metadata, each level's index and each record carry a CRC32C, and the padding is checked
//! by [`verify`].
//!
//! Files are untrusted: lengths and places are checked before they are used, counts before anything is allocated.

pub mod assemble;
pub mod codec;
pub mod error;
pub mod header;
pub mod index;
pub mod journal;
pub mod meta;
pub mod reader;
pub mod unfinished;
pub mod verify;
pub mod voxel;
pub mod writer;

pub use error::{Part, StoreError};
pub use index::{BrickEntry, ByteRange};
pub use journal::{Checkpoint, Journal};
pub use meta::{Conversion, Histogram, LevelMeta, Percentiles, StoreMeta};
pub use reader::{BrickData, BrickReader, Level, Store};
pub use unfinished::{Unfinished, WrittenBricks};
pub use voxel::Voxel;
pub use writer::StoreWriter;

pub use crate::outfile::Existing;
