//! The index of a level: one fixed-size entry per brick, x fastest, then y, then z.
//!
//! ```text
//! offset  bytes  content
//!      0      8  record: offset in the file, u64 (0 when Constant)
//!      8      4  record: length, u32 (0 when Constant)
//!     12      4  least stored value of the 34³ voxels, f32
//!     16      4  greatest stored value of the 34³ voxels, f32
//!     20      4  flags, u32: bit 0 Constant (all 34³ voxels equal, no record)
//!     24      4  CRC32C of the record, u32 (0 when Constant)
//!     28      4  zero
//! ```
//! Values are in stored units; u8 and u16 are exact in f32.

use super::codec;
use crate::volume::StoredType;

/// Bytes of an entry.
pub const ENTRY_LEN: usize = 32;

const FLAG_CONSTANT: u32 = 1;

/// A range of bytes of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ByteRange {
    /// Offset in the file.
    pub offset: u64,
    /// Length in bytes.
    pub len: u32,
}

/// What the index says of a brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrickEntry {
    /// Least stored value, border included. Finite.
    pub min: f32,
    /// Greatest stored value, border included. Finite, not below `min`.
    pub max: f32,
    /// All voxels equal, border included; the value is `min`. Then there is no record.
    pub constant: bool,
    /// Where the record is, unless `constant`.
    pub record: Option<ByteRange>,
    /// CRC32C of the record; 0 when `constant`.
    pub crc: u32,
}

impl BrickEntry {
    /// The entry's bytes.
    pub fn to_bytes(&self) -> [u8; ENTRY_LEN] {
        let mut b = [0; ENTRY_LEN];
        if let Some(record) = self.record {
            b[0..8].copy_from_slice(&record.offset.to_le_bytes());
            b[8..12].copy_from_slice(&record.len.to_le_bytes());
        }
        b[12..16].copy_from_slice(&self.min.to_le_bytes());
        b[16..20].copy_from_slice(&self.max.to_le_bytes());
        let flags = if self.constant { FLAG_CONSTANT } else { 0 };
        b[20..24].copy_from_slice(&flags.to_le_bytes());
        b[24..28].copy_from_slice(&self.crc.to_le_bytes());
        b
    }

    /// Parses an entry and checks it by itself: `records` is the range of the file (start, end) where records may be.
    ///
    /// # Errors
    /// What is wrong, as (expected, found).
    pub fn parse(
        b: &[u8; ENTRY_LEN],
        stored_type: StoredType,
        records: (u64, u64),
    ) -> Result<Self, (String, String)> {
        let u32_at =
            |at: usize| u32::from_le_bytes(b[at..at + 4].try_into().expect("invariant: 4 bytes"));
        let offset = u64::from_le_bytes(b[0..8].try_into().expect("invariant: 8 bytes"));
        let len = u32_at(8);
        let (min, max) = (f32::from_bits(u32_at(12)), f32::from_bits(u32_at(16)));
        let flags = u32_at(20);
        let crc = u32_at(24);
        if flags & !FLAG_CONSTANT != 0 || u32_at(28) != 0 {
            return Err((
                "known flags and a zero".into(),
                format!("flags {flags:#x}, {:#x}", u32_at(28)),
            ));
        }
        let is_range = min.is_finite() && max.is_finite() && min <= max;
        if !is_range || !fits(min, max, stored_type) {
            return Err((
                format!("a range of finite {stored_type} values"),
                format!("{min} to {max}"),
            ));
        }
        let constant = flags == FLAG_CONSTANT;
        if constant {
            if (offset, len, crc) != (0, 0, 0) || min.to_bits() != max.to_bits() {
                return Err((
                    "a Constant brick with one value and no record".into(),
                    format!("{min} to {max}, a record of {len} bytes at {offset}"),
                ));
            }
            return Ok(Self {
                min,
                max,
                constant,
                record: None,
                crc,
            });
        }
        let end = offset.checked_add(u64::from(len));
        if offset < records.0
            || end.is_none_or(|end| end > records.1)
            || len == 0
            || len as usize > codec::max_record_len(stored_type)
        {
            return Err((
                format!(
                    "a record of 1 to {} bytes between offsets {} and {}",
                    codec::max_record_len(stored_type),
                    records.0,
                    records.1
                ),
                format!("{len} bytes at offset {offset}"),
            ));
        }
        Ok(Self {
            min,
            max,
            constant,
            record: Some(ByteRange { offset, len }),
            crc,
        })
    }
}

/// True when both ends are values that the type can hold.
fn fits(min: f32, max: f32, stored_type: StoredType) -> bool {
    let greatest = match stored_type {
        StoredType::U8 => 255.0,
        StoredType::U16 => 65535.0,
        StoredType::F32 => return true,
    };
    min >= 0.0 && max <= greatest && min.fract() == 0.0 && max.fract() == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_and_refusals() {
        let entry = BrickEntry {
            min: 3.0,
            max: 9.0,
            constant: false,
            record: Some(ByteRange {
                offset: 1300,
                len: 20,
            }),
            crc: 77,
        };
        let parse = |e: &BrickEntry| BrickEntry::parse(&e.to_bytes(), StoredType::U8, (1280, 1400));
        assert_eq!(parse(&entry), Ok(entry), "round trip");
        let constant = BrickEntry {
            max: 3.0,
            constant: true,
            record: None,
            crc: 0,
            ..entry
        };
        assert_eq!(parse(&constant), Ok(constant), "Constant round trip");
        let record = |offset, len| BrickEntry {
            record: Some(ByteRange { offset, len }),
            ..entry
        };
        for bad in [
            BrickEntry {
                min: f32::NAN,
                ..entry
            },
            BrickEntry { min: 10.0, ..entry },
            BrickEntry {
                max: 256.0,
                ..entry
            },
            BrickEntry { max: 8.5, ..entry },
            BrickEntry {
                constant: true,
                ..entry
            },
            record(1200, 20),
            record(1390, 20),
            record(u64::MAX, 20),
            record(1300, 0),
        ] {
            assert!(parse(&bad).is_err(), "{bad:?} is refused");
        }
    }
}
