//! Checks of a store by itself: what lies between the sections, whether records overlap, and each brick's voxels against
//! its record, its entry and its block ranges.
//!
//! Opening has already checked header and metadata; every level's index must have been checked and be sound
//! ([`Store::check_all_levels`]). Borders and levels are checked in `bricking::verify`, which
//! knows how they are made; so is the work divided among threads.

use super::codec::{self, BlockRanges, RANGES_LEN};
use super::error::{Fault, Part, StoreError};
use super::reader::{BrickReader, Store};
use super::voxel::Voxel;
use crate::geom::{BrickId, Lod, STORED_VOXELS};

/// Faults of the file's layout: padding that is not zero, records that overlap, bytes in no record. At most `limit`.
///
/// Takes 16 bytes of memory per brick that has a record.
pub fn layout(store: &Store, limit: usize) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (offset, len) in store.header().padding() {
        let bytes = store.bytes(offset, len);
        if let Some(at) = bytes.iter().position(|&b| b != 0) {
            let found = format!("{:#04x}", bytes[at]);
            faults.push(Fault::new(Part::Padding, offset + at as u64, "zero", found));
        }
    }
    let mut records: Vec<(u64, u32, Lod)> = (0..store.levels())
        .map(|l| Lod(l as u8))
        .flat_map(|lod| store.bricks(lod))
        .filter_map(|id| store.entry(id).record.map(|r| (r.offset, r.len, id.lod)))
        .collect();
    records.sort_unstable_by_key(|r| r.0);
    let (start, end) = store.records_range();
    let mut next = start;
    for (offset, len, lod) in records {
        if offset != next {
            faults.push(Fault::new(
                Part::Index(lod),
                offset.min(next),
                format!("a record at offset {next}, where the one before it ends"),
                format!("the next one at {offset}"),
            ));
        }
        next = offset + u64::from(len);
        if faults.len() >= limit {
            return faults;
        }
    }
    if next != end {
        faults.push(Fault::new(
            Part::Header,
            next,
            format!("records up to offset {end}"),
            format!("the last one ends at {next}"),
        ));
    }
    faults
}

/// Checks bricks one by one, with buffers that are used again. One per thread.
pub struct BrickChecker<T> {
    reader: BrickReader,
    ranges: BlockRanges<T>,
    quantised: Box<[u8; RANGES_LEN]>,
}

impl<T: Voxel> BrickChecker<T> {
    /// A checker of stores whose voxels are of type `T`.
    ///
    /// # Errors
    /// zstd has no memory.
    pub fn new() -> std::io::Result<Self> {
        Ok(Self {
            reader: BrickReader::new()?,
            ranges: BlockRanges::default(),
            quantised: Box::new([0; RANGES_LEN]),
        })
    }

    /// The voxels of a brick, nothing checked but the record's checksum and length.
    ///
    /// # Errors
    /// The record is damaged.
    pub fn read(
        &mut self,
        store: &Store,
        id: BrickId,
        voxels: &mut [T; STORED_VOXELS],
    ) -> Result<(), Fault> {
        let entry = store.entry(id);
        if store.decode(id, &entry, &mut self.reader)? {
            T::unshuffle(self.reader.planes(), voxels);
        } else {
            voxels.fill(T::from_f32(entry.min));
        }
        Ok(())
    }

    /// Reads a brick, and checks its entry and its block ranges against its voxels.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(
        &mut self,
        store: &Store,
        id: BrickId,
        voxels: &mut [T; STORED_VOXELS],
    ) -> Result<(), Fault> {
        self.read(store, id, voxels)?;
        let entry = store.entry(id);
        let Some(record) = entry.record else {
            return Ok(());
        };
        let bad = |expected: String, found: String| {
            Err(Fault::new(Part::Brick(id), record.offset, expected, found))
        };
        if let Some(v) = voxels.iter().find(|v| !v.to_f32().is_finite()) {
            return bad("finite voxels".into(), v.to_string());
        }
        if codec::is_constant(voxels) {
            return bad(
                "an entry marked Constant, since all voxels are equal".into(),
                "a record".into(),
            );
        }
        self.ranges.measure(voxels);
        let (low, high) = self.ranges.whole();
        if (low.to_f32(), high.to_f32()) != (entry.min, entry.max) {
            return bad(
                format!(
                    "voxels from {} to {}, as the index says",
                    entry.min, entry.max
                ),
                format!("{low} to {high}"),
            );
        }
        self.ranges.quantise(&mut self.quantised[..]);
        let stored = self.reader.quantised_ranges();
        if let Some(at) = (0..RANGES_LEN).find(|&i| stored[i] != self.quantised[i]) {
            return bad(
                format!(
                    "range byte {at} (block {}) to be {}",
                    at / 2,
                    self.quantised[at]
                ),
                stored[at].to_string(),
            );
        }
        Ok(())
    }
}

impl StoreError {
    /// True when the file is a store, whole, and something in it other than the header fails its check.
    pub fn is_damage_inside(&self) -> bool {
        matches!(self, Self::Damaged { part, .. } if *part != Part::Header)
    }
}
