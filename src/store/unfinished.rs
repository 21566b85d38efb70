//! A store that a killed process left unfinished: finding it, checking it against a checkpoint, going on with it, and
//! reading back what is written of it.
//!
//! Nothing in the folder is changed, and nothing is removed, until [`Unfinished::go_on`]; and from there on nothing is
//! removed until [`StoreWriter::own_unfinished`].

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::error::{Fault, Part, StoreError};
use super::index::{BrickEntry, ENTRY_LEN};
use super::journal::{self, Checkpoint, Journal};
use super::reader::BrickReader;
use super::voxel::Voxel;
use super::writer::{
    LevelMark, StoreWriter, index_file, layer_len, read_full, records_file, records_start,
};
use crate::geom::{BrickGrid, BrickId, STORED_VOXELS};
use crate::outfile::{Existing, PartialFolder};
use crate::volume::StoredType;

/// Bytes of an index that are read at once.
const PIECE_BYTES: usize = 256 << 10;

/// The unfinished parts of a store.
#[derive(Debug)]
pub struct Unfinished {
    folder: PartialFolder,
}

impl Unfinished {
    /// True when a run to `path` that was killed left something, or one is under way.
    pub fn exists(path: &Path) -> bool {
        PartialFolder::path_for(path).is_dir()
    }

    /// What a run to `path` that was killed left; `None` when there is nothing.
    ///
    /// # Errors
    /// `path` can't be written, exists and may not be replaced, or another process is writing it.
    pub fn open(path: &Path, existing: Existing) -> Result<Option<Self>, StoreError> {
        Ok(PartialFolder::reopen(path, existing)?.map(|folder| Self { folder }))
    }

    /// The checkpoints of its journal that are whole, newest first, each with its place in the journal.
    ///
    /// # Errors
    /// The journal can't be read, or is of another version.
    pub fn checkpoints(&self) -> Result<Vec<(usize, Checkpoint)>, StoreError> {
        journal::read(&self.folder)
    }

    /// Is all there that `checkpoint` speaks of? Lengths of all files, and every index entry by its checksum.
    ///
    /// # Errors
    /// It is not, or can't be read.
    pub fn check(&self, grids: &[BrickGrid], checkpoint: &Checkpoint) -> Result<(), StoreError> {
        let bad = |what: String| StoreError::NotResumable {
            path: self.folder.dest().to_owned(),
            what,
        };
        if checkpoint.mark.len() != grids.len() {
            return Err(bad(format!(
                "its journal speaks of {} levels, not of {}",
                checkpoint.mark.len(),
                grids.len()
            )));
        }
        for (l, (grid, mark)) in grids.iter().zip(&checkpoint.mark).enumerate() {
            if mark.layers > grid.bricks.z || mark.records_end < records_start(l) {
                return Err(bad(format!(
                    "its journal speaks of {} layers and {} bytes of level {l}",
                    mark.layers, mark.records_end
                )));
            }
            let (name, index_name) = (records_file(l), index_file(l));
            let len = self.len(&name)?;
            if len < mark.records_end {
                return Err(bad(format!(
                    "{name} has {len} bytes, its journal speaks of {}",
                    mark.records_end
                )));
            }
            let crc = self.index_crc(&index_name, index_len(grid, mark))?;
            if crc != Some(mark.index_crc) {
                return Err(bad(format!(
                    "{index_name} is not what its journal speaks of"
                )));
            }
        }
        Ok(())
    }

    /// Cuts the files to what `checkpoint` (in place `slot` of the journal, and checked) speaks of, and opens them to
    /// be written on, and to be read back.
    ///
    /// # Errors
    /// The system refused.
    pub fn go_on(
        self,
        stored_type: StoredType,
        grids: &[BrickGrid],
        (slot, checkpoint): (usize, &Checkpoint),
    ) -> Result<(StoreWriter, Journal, WrittenBricks), StoreError> {
        let folder = self.folder;
        let path = folder.dest().to_owned();
        let mut levels = Vec::with_capacity(grids.len());
        for (l, (&grid, mark)) in grids.iter().zip(&checkpoint.mark).enumerate() {
            let cut = |name: &str, len: u64| {
                let file = folder.open_file(name)?;
                file.set_len(len)?;
                Ok(file)
            };
            let failed = || StoreError::io(&path, "cut its unfinished parts");
            levels.push(WrittenLevel {
                grid,
                mark: *mark,
                start: records_start(l),
                records: cut(&records_file(l), mark.records_end).map_err(failed())?,
                index: cut(&index_file(l), index_len(&grid, mark)).map_err(failed())?,
            });
        }
        let writer = StoreWriter::go_on(folder, stored_type, grids, &checkpoint.mark)?;
        let journal = writer.resumed_journal((slot, checkpoint.number))?;
        let written = WrittenBricks {
            path,
            stored_type,
            levels,
        };
        Ok((writer, journal, written))
    }

    fn len(&self, name: &str) -> Result<u64, StoreError> {
        match self.folder.path().join(name).metadata() {
            Ok(info) => Ok(info.len()),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(0),
            Err(e) => Err(self.failed(e)),
        }
    }

    /// CRC32C of the first `len` bytes of a file; `None` when there are fewer.
    fn index_crc(&self, name: &str, mut len: u64) -> Result<Option<u32>, StoreError> {
        if self.len(name)? < len {
            return Ok(None);
        }
        let mut crc = 0;
        if len == 0 {
            return Ok(Some(crc));
        }
        let mut file = self.folder.open_file(name).map_err(|e| self.failed(e))?;
        let mut piece = vec![0; PIECE_BYTES];
        while len > 0 {
            let want = len.min(PIECE_BYTES as u64) as usize;
            let n = read_full(&mut file, &mut piece[..want]).map_err(|e| self.failed(e))?;
            if n < want {
                return Ok(None);
            }
            crc = crc32c::crc32c_append(crc, &piece[..n]);
            len -= n as u64;
        }
        Ok(Some(crc))
    }

    fn failed(&self, error: std::io::Error) -> StoreError {
        StoreError::io(self.folder.dest(), "read its unfinished parts")(error)
    }
}

/// Bytes of the index entries of a level's finished layers. Both factors come from a checked grid and a file's length
/// is compared with the product: saturating is enough.
fn index_len(grid: &BrickGrid, mark: &LevelMark) -> u64 {
    (layer_len(grid) as u64)
        .saturating_mul(ENTRY_LEN as u64)
        .saturating_mul(mark.layers.into())
}

/// The bricks that an unfinished store has already.
#[derive(Debug)]
pub struct WrittenBricks {
    path: PathBuf,
    stored_type: StoredType,
    levels: Vec<WrittenLevel>,
}

#[derive(Debug)]
struct WrittenLevel {
    grid: BrickGrid,
    mark: LevelMark,
    /// Where records begin.
    start: u64,
    records: File,
    index: File,
}

/// A brick as it is written.
#[derive(Debug)]
pub struct WrittenBrick {
    id: BrickId,
    stored_type: StoredType,
    entry: BrickEntry,
    record: Vec<u8>,
}

impl WrittenBricks {
    /// Finished layers of bricks of a level.
    pub fn layers(&self, level: usize) -> u32 {
        self.levels[level].mark.layers
    }

    /// Reads a brick of a finished layer.
    ///
    /// # Errors
    /// Its entry or record is damaged, or can't be read.
    pub fn fetch(&mut self, id: BrickId) -> Result<WrittenBrick, StoreError> {
        let level = &mut self.levels[usize::from(id.lod.0)];
        assert!(
            id.xyz.z < level.mark.layers,
            "invariant: {id} is in a finished layer"
        );
        let failed = || StoreError::io(&self.path, "read its unfinished parts back");
        let at = level.grid.index(id.xyz) * ENTRY_LEN as u64;
        let mut bytes = [0; ENTRY_LEN];
        read_at(&mut level.index, at, &mut bytes).map_err(failed())?;
        let records = (level.start, level.mark.records_end);
        let entry =
            BrickEntry::parse(&bytes, self.stored_type, records).map_err(|(expected, found)| {
                Fault::new(Part::Index(id.lod), at, expected, found).not_resumable(&self.path)
            })?;
        let mut record = Vec::new();
        if let Some(place) = entry.record {
            // `parse` has bounded the length.
            record.resize(place.len as usize, 0);
            read_at(&mut level.records, place.offset, &mut record).map_err(failed())?;
        }
        Ok(WrittenBrick {
            id,
            stored_type: self.stored_type,
            entry,
            record,
        })
    }

    /// The error for a fault in what is written.
    pub fn fault(&self, fault: Fault) -> StoreError {
        fault.not_resumable(&self.path)
    }
}

impl WrittenBrick {
    /// Which brick it is.
    pub fn id(&self) -> BrickId {
        self.id
    }

    /// Its voxels.
    ///
    /// # Errors
    /// The record is damaged.
    pub fn decode<T: Voxel>(
        &self,
        reader: &mut BrickReader,
        voxels: &mut [T; STORED_VOXELS],
    ) -> Result<(), Fault> {
        if self.entry.constant {
            voxels.fill(T::from_f32(self.entry.min));
            return Ok(());
        }
        reader.decode(self.id, &self.entry, &self.record, self.stored_type)?;
        T::unshuffle(reader.planes(), voxels);
        Ok(())
    }
}

fn read_at(file: &mut File, at: u64, out: &mut [u8]) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(out)
}
