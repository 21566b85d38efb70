//! The fixed header: what the file is, and where its parts are.
//!
//! ```text
//! offset  bytes  content
//!      0      8  signature 89 42 53 4b 0d 0a 1a 0a ("\x89BSK\r\n\x1a\n": text-mode copies break it)
//!      8      4  version of the format, u32: 1
//!     12      4  byte order mark, u32 0x01020304 (little-endian: 04 03 02 01)
//!     16      4  length of this header, u32: 1280
//!     20      4  levels, u32: 1 … 32
//!     24      8  length of the file, u64
//!     32      8  records: offset, u64 (always 1280)
//!     40      8  records: length, u64
//!     48      8  metadata: offset, u64
//!     56      8  metadata: length, u64 (at most 16 MiB)
//!     64      4  metadata: CRC32C
//!     68      1  voxel type: 0 u8, 1 u16, 2 f32
//!     69      1  codec: 1 zstd
//!     70      1  filter: 0 none (u8), 1 byte-shuffle (u16, f32)
//!     71      1  zero
//!     72      4  brick edge in voxels, u32: 32
//!     76      4  border in voxels, u32: 1
//!     80     48  zero
//!    128     32  level 0 ─┬─  0  8  index: offset, u64
//!    160     32  level 1  ├─  8  8  index: length, u64 (32 × bricks)
//!      …                  ├─ 16 12  bricks along x, y, z, u32 each
//!                         └─ 28  4  index: CRC32C
//!   1152    124  zero (as are the rows of levels that are not there)
//!   1276      4  CRC32C of bytes 0 … 1275
//! ```
//! Places are redundant on purpose: the layout of the file follows from the lengths alone, and [`Header::parse`]
//! refuses a header that says otherwise, so no two sections can overlap and nothing lies between them but padding.

use glam::UVec3;

use super::error::{Fault, Part};
use super::index::ENTRY_LEN;
use crate::geom::Lod;
use crate::volume::StoredType;

/// Bytes of the header.
pub const HEADER_LEN: usize = 1280;
/// First bytes of every store.
pub const MAGIC: [u8; 8] = *b"\x89BSK\r\n\x1a\n";
/// First bytes of a store that is being written: the header is written last.
pub const UNFINISHED_MAGIC: [u8; 8] = *b"\x89BSU\r\n\x1a\n";
/// The version of the format that this program reads and writes.
pub const VERSION: u32 = 1;
/// Most levels that a store can have.
pub const MAX_LEVELS: usize = 32;
/// Most bytes of metadata.
pub const MAX_METADATA_LEN: u64 = 16 << 20;
/// Sections after the records start at multiples of this.
pub const SECTION_ALIGN: u64 = 64;

const ORDER_MARK: u32 = 0x0102_0304;
const CODEC_ZSTD: u8 = 1;
const LEVELS_AT: usize = 128;
const LEVEL_LEN: usize = 32;
const CRC_AT: usize = HEADER_LEN - 4;

/// Where a level's index is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelPlace {
    /// Offset of the index in the file.
    pub offset: u64,
    /// Bytes of the index.
    pub len: u64,
    /// Bricks along each axis.
    pub bricks: UVec3,
    /// CRC32C of the index.
    pub crc: u32,
}

/// The header, parsed and checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Type of the voxels.
    pub stored_type: StoredType,
    /// Bytes of the whole file.
    pub file_len: u64,
    /// Bytes of all records; they start at [`HEADER_LEN`].
    pub records_len: u64,
    /// Offset of the metadata.
    pub metadata_offset: u64,
    /// Bytes of the metadata.
    pub metadata_len: u64,
    /// CRC32C of the metadata.
    pub metadata_crc: u32,
    /// The levels, finest first.
    pub levels: Vec<LevelPlace>,
}

/// The next multiple of [`SECTION_ALIGN`], or `None` beyond `u64`.
pub fn align_up(offset: u64) -> Option<u64> {
    offset.checked_next_multiple_of(SECTION_ALIGN)
}

impl Header {
    /// The header of a store with these sections, places filled in; `None` when the file would be longer than `u64`
    /// can say. `levels` gives bricks and CRC of each level's index.
    pub fn lay_out(
        stored_type: StoredType,
        records_len: u64,
        metadata_len: u64,
        metadata_crc: u32,
        levels: &[(UVec3, u32)],
    ) -> Option<Self> {
        let metadata_offset = align_up((HEADER_LEN as u64).checked_add(records_len)?)?;
        let mut end = metadata_offset.checked_add(metadata_len)?;
        let mut places = Vec::with_capacity(levels.len());
        for &(bricks, crc) in levels {
            let offset = align_up(end)?;
            let len = u64::from(bricks.x)
                .checked_mul(u64::from(bricks.y))?
                .checked_mul(u64::from(bricks.z))?
                .checked_mul(ENTRY_LEN as u64)?;
            end = offset.checked_add(len)?;
            places.push(LevelPlace {
                offset,
                len,
                bricks,
                crc,
            });
        }
        Some(Self {
            stored_type,
            file_len: end,
            records_len,
            metadata_offset,
            metadata_len,
            metadata_crc,
            levels: places,
        })
    }

    /// The bytes of the header.
    pub fn to_bytes(&self) -> [u8; HEADER_LEN] {
        let mut b = [0; HEADER_LEN];
        let mut put = |at: usize, bytes: &[u8]| b[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &MAGIC);
        put(8, &VERSION.to_le_bytes());
        put(12, &ORDER_MARK.to_le_bytes());
        put(16, &(HEADER_LEN as u32).to_le_bytes());
        put(20, &(self.levels.len() as u32).to_le_bytes());
        put(24, &self.file_len.to_le_bytes());
        put(32, &(HEADER_LEN as u64).to_le_bytes());
        put(40, &self.records_len.to_le_bytes());
        put(48, &self.metadata_offset.to_le_bytes());
        put(56, &self.metadata_len.to_le_bytes());
        put(64, &self.metadata_crc.to_le_bytes());
        put(
            68,
            &[
                type_code(self.stored_type),
                CODEC_ZSTD,
                filter_code(self.stored_type),
            ],
        );
        put(72, &crate::geom::BRICK_EDGE.to_le_bytes());
        put(76, &crate::geom::BRICK_BORDER.to_le_bytes());
        for (i, level) in self.levels.iter().enumerate() {
            let at = LEVELS_AT + i * LEVEL_LEN;
            put(at, &level.offset.to_le_bytes());
            put(at + 8, &level.len.to_le_bytes());
            put(at + 16, &level.bricks.x.to_le_bytes());
            put(at + 20, &level.bricks.y.to_le_bytes());
            put(at + 24, &level.bricks.z.to_le_bytes());
            put(at + 28, &level.crc.to_le_bytes());
        }
        let crc = crc32c::crc32c(&b[..CRC_AT]);
        b[CRC_AT..].copy_from_slice(&crc.to_le_bytes());
        b
    }

    /// The version that `bytes` claim. Signature and version are looked at before anything else: another version may
    /// have another header.
    pub fn version(bytes: &[u8; HEADER_LEN]) -> u32 {
        u32_at(bytes, 8)
    }

    /// Parses a header whose signature and version have been checked.
    ///
    /// # Errors
    /// The checksum does not match, or the parts contradict each other.
    pub fn parse(bytes: &[u8; HEADER_LEN]) -> Result<Self, Fault> {
        let crc = crc32c::crc32c(&bytes[..CRC_AT]);
        let stated = u32_at(bytes, CRC_AT);
        if crc != stated {
            return Err(Fault::crc(Part::Header, 0, stated, crc));
        }
        let bad = |offset: u64, expected: &str, found: u64| {
            Fault::new(Part::Header, offset, expected, found.to_string())
        };
        let count = u32_at(bytes, 20) as usize;
        if !(1..=MAX_LEVELS).contains(&count) {
            return Err(bad(20, "1 to 32 levels", count as u64));
        }
        let stored_type = match bytes[68] {
            0 => StoredType::U8,
            1 => StoredType::U16,
            2 => StoredType::F32,
            other => return Err(bad(68, "voxel type 0, 1 or 2", other.into())),
        };
        let metadata_len = u64_at(bytes, 56);
        if metadata_len > MAX_METADATA_LEN {
            return Err(bad(56, "at most 16 MiB of metadata", metadata_len));
        }
        let levels: Vec<(UVec3, u32)> = (0..count)
            .map(|i| LEVELS_AT + i * LEVEL_LEN)
            .map(|at| {
                let bricks = UVec3::new(
                    u32_at(bytes, at + 16),
                    u32_at(bytes, at + 20),
                    u32_at(bytes, at + 24),
                );
                (bricks, u32_at(bytes, at + 28))
            })
            .collect();
        if let Some(i) = levels.iter().position(|(b, _)| b.min_element() == 0) {
            let at = LEVELS_AT + i * LEVEL_LEN + 16;
            return Err(bad(at as u64, "at least one brick along each axis", 0));
        }
        let header = Self::lay_out(
            stored_type,
            u64_at(bytes, 40),
            metadata_len,
            u32_at(bytes, 64),
            &levels,
        )
        .ok_or_else(|| {
            bad(
                40,
                "sections that fit a file of 2⁶⁴ bytes",
                u64_at(bytes, 40),
            )
        })?;
        // Everything else (places, codec, brick size, zeros) follows from what was read: compare with what is there.
        let canonical = header.to_bytes();
        if let Some(at) = (0..HEADER_LEN).find(|&i| canonical[i] != bytes[i]) {
            return Err(bad(
                at as u64,
                &format!("byte {}", canonical[at]),
                bytes[at].into(),
            ));
        }
        Ok(header)
    }

    /// Padding between sections, as (offset, length) in the order of the file.
    pub fn padding(&self) -> Vec<(u64, u64)> {
        let mut end = HEADER_LEN as u64 + self.records_len;
        let mut gaps = vec![(end, self.metadata_offset - end)];
        end = self.metadata_offset + self.metadata_len;
        for level in &self.levels {
            gaps.push((end, level.offset - end));
            end = level.offset + level.len;
        }
        gaps.retain(|&(_, len)| len > 0);
        gaps
    }

    /// The level's place; `lod` must be below the number of levels.
    pub fn level(&self, lod: Lod) -> &LevelPlace {
        &self.levels[usize::from(lod.0)]
    }
}

fn type_code(stored_type: StoredType) -> u8 {
    match stored_type {
        StoredType::U8 => 0,
        StoredType::U16 => 1,
        StoredType::F32 => 2,
    }
}

fn filter_code(stored_type: StoredType) -> u8 {
    u8::from(stored_type.size() > 1)
}

fn u32_at(b: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(b[at..at + 4].try_into().expect("invariant: four bytes"))
}

fn u64_at(b: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(b[at..at + 8].try_into().expect("invariant: eight bytes"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Header {
        let levels = [(UVec3::new(3, 2, 1), 7), (UVec3::ONE, 9)];
        Header::lay_out(StoredType::U16, 1000, 321, 5, &levels).unwrap()
    }

    #[test]
    fn round_trip_and_layout() {
        let header = sample();
        assert_eq!(
            Header::parse(&header.to_bytes()),
            Ok(header.clone()),
            "round trip"
        );
        assert_eq!(
            header.metadata_offset, 2304,
            "1280 + 1000, up to a multiple of 64"
        );
        assert_eq!(
            header.levels[0].offset, 2688,
            "2304 + 321, up to a multiple of 64"
        );
        assert_eq!(
            header.file_len,
            2688 + 6 * 32 + 32,
            "192 is a multiple of 64"
        );
        assert_eq!(header.padding(), [(2280, 24), (2625, 63)], "two gaps");
    }

    #[test]
    fn every_flipped_bit_is_found() {
        let bytes = sample().to_bytes();
        for bit in 0..HEADER_LEN * 8 {
            let mut bad = bytes;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(Header::parse(&bad).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn contradictions_are_refused_even_with_a_right_checksum() {
        for at in [
            12usize, 16, 20, 24, 32, 40, 48, 56, 68, 69, 70, 71, 72, 76, 80, 128, 136, 144, 1152,
        ] {
            let mut bad = sample().to_bytes();
            bad[at] ^= 0x40;
            let crc = crc32c::crc32c(&bad[..CRC_AT]);
            bad[CRC_AT..].copy_from_slice(&crc.to_le_bytes());
            assert!(Header::parse(&bad).is_err(), "byte {at}");
        }
    }
}
