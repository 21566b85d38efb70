//! [`Blocks`]: voxels in compressed blocks of one size, or in base64, as a [`VoxelSource`] of any box.
//!
//! Blocks that are wanted whole are decoded several at once, straight to where they belong; of the others the last one is kept.
//! All lengths are checked against the file before anything is allocated by them.

use std::path::PathBuf;

use flate2::{Decompress, FlushDecompress, Status};
use rayon::prelude::*;

use super::super::problem::Subject;
use super::super::raw::Endian;
use super::super::stream::most_inflated_bytes;
use super::super::voxel_file::{file_stamp, swap_bytes};
use super::regions::Region;
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, SourceError, VolumeDesc, VoxelSource, check_read};

/// Bytes of a block of data that has none: a multiple of base64's 3.
const PLAIN_BLOCK_BYTES: u64 = 48 << 10;

/// The most that one byte of an LZ4 block can stand for.
const MOST_PER_LZ4_BYTE: u64 = 255;

/// How each block is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    None,
    Zlib,
    Lz4,
}

/// Where the blocks are in the data.
pub(super) struct Table {
    codec: Codec,
    /// Bytes of every block but the last, decompressed.
    block_bytes: u64,
    /// Of all blocks.
    total_bytes: u64,
    /// Byte of the data where the first block starts.
    first: u64,
    /// Where the compressed blocks end, counted from `first`; empty where nothing is compressed.
    ends: Vec<u64>,
}

impl Table {
    /// `total_bytes` bytes that are not compressed, from byte `first` of the data on.
    pub(super) fn plain(first: u64, total_bytes: u64) -> Self {
        Self {
            codec: Codec::None,
            block_bytes: PLAIN_BLOCK_BYTES,
            total_bytes,
            first,
            ends: Vec::new(),
        }
    }

    /// Blocks of the compressed sizes `sizes`, one after another.
    ///
    /// # Errors
    /// A block can't decompress to what it should, or together they are longer than `u64` counts.
    pub(super) fn compressed(
        subject: &Subject<'_>,
        codec: Codec,
        (block_bytes, total_bytes): (u64, u64),
        sizes: impl Iterator<Item = u64>,
    ) -> Result<Self, SourceError> {
        let mut table = Self {
            codec,
            block_bytes: block_bytes.min(total_bytes),
            total_bytes,
            first: 0,
            ends: Vec::new(),
        };
        let mut end = 0u64;
        for (i, size) in sizes.enumerate() {
            let bytes = table.block_len(i as u64);
            let most = match codec {
                Codec::Lz4 => size.saturating_mul(MOST_PER_LZ4_BYTE),
                Codec::None | Codec::Zlib => most_inflated_bytes(size),
            };
            let sum = end.checked_add(size);
            let (Some(sum), true) = (sum, bytes <= most) else {
                return Err(subject.malformed(
                    format!("the size of compressed block {i}"),
                    format!("what {bytes} bytes of voxels compress to"),
                    format!("{size} bytes"),
                ));
            };
            end = sum;
            table.ends.push(end);
        }
        Ok(table)
    }

    /// Bytes that the data have at least.
    pub(super) fn end(&self) -> Option<u64> {
        let length = match self.codec {
            Codec::None => self.total_bytes,
            Codec::Zlib | Codec::Lz4 => self.ends.last().copied().unwrap_or(0),
        };
        self.first.checked_add(length)
    }

    /// Decompressed bytes of block `i`.
    fn block_len(&self, i: u64) -> u64 {
        let before = i.saturating_mul(self.block_bytes);
        self.total_bytes
            .saturating_sub(before)
            .min(self.block_bytes)
    }

    /// First byte in the data, and bytes there, of block `i`.
    fn stored(&self, i: u64) -> (u64, u64) {
        if self.codec == Codec::None {
            return (self.first + i * self.block_bytes, self.block_len(i));
        }
        let i = i as usize;
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        (self.first + start, self.ends[i] - start)
    }

    /// The most bytes that a block takes in the file.
    fn most_stored(&self) -> u64 {
        let starts = std::iter::once(&0).chain(&self.ends);
        let sizes = self.ends.iter().zip(starts).map(|(end, start)| end - start);
        sizes.max().unwrap_or(PLAIN_BLOCK_BYTES)
    }
}

/// A volume whose bytes lie in blocks.
pub(super) struct Blocks {
    desc: VolumeDesc,
    path: PathBuf,
    endian: Endian,
    data: Region,
    table: Table,
    /// The block that was decoded last for a part of it.
    last: Option<(u64, Vec<u8>)>,
    notes: Vec<String>,
}

impl Blocks {
    /// The voxels that `table` finds in `data`, which holds them all (checked by the caller).
    pub(super) fn new(
        subject: &Subject<'_>,
        (desc, endian): (VolumeDesc, Endian),
        data: Region,
        table: Table,
        notes: Vec<String>,
    ) -> Self {
        Self {
            desc,
            path: subject.path.to_owned(),
            endian,
            data,
            table,
            last: None,
            notes,
        }
    }

    /// Fills `out`, which is as long as block `i`.
    fn decode(&self, i: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let subject = Subject::new(&self.path);
        let (at, len) = self.table.stored(i);
        if self.table.codec == Codec::None {
            return self.data.read(&subject, at, out);
        }
        // No more than the file has: the table was checked against it.
        let mut packed = vec![0; len as usize];
        self.data.read(&subject, at, &mut packed)?;
        let wanted = out.len();
        let malformed = |found: String| {
            subject.malformed(
                format!("compressed block {i}, {len} bytes from byte {at} of the data on"),
                format!("{wanted} bytes of voxels"),
                found,
            )
        };
        let unpacked = match self.table.codec {
            Codec::Lz4 => lz4_flex::block::decompress_into(&packed, out)
                .map_err(|e| malformed(e.to_string()))?,
            Codec::None | Codec::Zlib => {
                let mut zlib = Decompress::new(true);
                let status = zlib
                    .decompress(&packed, out, FlushDecompress::Finish)
                    .map_err(|e| malformed(e.to_string()))?;
                if status != Status::StreamEnd {
                    return Err(malformed("a zlib stream that is longer or cut".to_owned()));
                }
                zlib.total_out() as usize
            }
        };
        if unpacked == wanted {
            Ok(())
        } else {
            Err(malformed(format!("{unpacked} bytes")))
        }
    }

    /// Fills `out` with the voxels' bytes from `at` on.
    fn read_run(&mut self, mut at: u64, mut out: &mut [u8]) -> Result<(), SourceError> {
        let size = self.table.block_bytes;
        while !out.is_empty() {
            let (block, inside) = (at / size, (at % size) as usize);
            let len = self.table.block_len(block) as usize;
            let is_at_end = at + out.len() as u64 == self.table.total_bytes;
            let whole = if inside > 0 {
                0
            } else if is_at_end {
                out.len()
            } else {
                out.len() - out.len() % size as usize
            };
            let done = if whole > 0 {
                // Whole blocks go straight to their place, several at once.
                out[..whole]
                    .par_chunks_mut(size as usize)
                    .enumerate()
                    .try_for_each(|(n, out)| self.decode(block + n as u64, out))?;
                whole
            } else {
                let bytes = match self.last.take() {
                    Some((i, bytes)) if i == block => bytes,
                    old => {
                        let mut bytes = old.map(|(_, bytes)| bytes).unwrap_or_default();
                        bytes.resize(len, 0);
                        self.decode(block, &mut bytes)?;
                        bytes
                    }
                };
                let n = out.len().min(len - inside);
                out[..n].copy_from_slice(&bytes[inside..inside + n]);
                self.last = Some((block, bytes));
                n
            };
            at += done as u64;
            out = &mut out[done..];
        }
        Ok(())
    }
}

impl VoxelSource for Blocks {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::Random
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let dims = self.desc.dims;
        let part = voxels.size();
        let voxel_bytes = self.desc.voxel_type.size();
        if part.truncate() == dims.truncate() {
            let at = voxels.min.z * dims.y * dims.x * voxel_bytes as u64;
            self.read_run(at, out)?;
        } else {
            let rows = out.chunks_exact_mut(part.x as usize * voxel_bytes);
            for (n, row) in rows.enumerate() {
                let y = voxels.min.y + n as u64 % part.y;
                let z = voxels.min.z + n as u64 / part.y;
                let at = ((z * dims.y + y) * dims.x + voxels.min.x) * voxel_bytes as u64;
                self.read_run(at, row)?;
            }
        }
        if self.endian == Endian::Big {
            swap_bytes(out, voxel_bytes);
        }
        Ok(())
    }

    fn stamp(&self) -> String {
        let Region {
            start, encoding, ..
        } = self.data;
        format!(
            "{}, {encoding:?} from byte {start} on, {:?} in blocks of {} bytes, {:?}",
            file_stamp(&self.path),
            self.table.codec,
            self.table.block_bytes,
            self.endian,
        )
    }

    fn held_bytes(&self) -> u64 {
        let table = size_of_val(self.table.ends.as_slice()) as u64;
        let packed = self.table.most_stored() * rayon::current_num_threads() as u64;
        table + self.table.block_bytes + packed
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}
