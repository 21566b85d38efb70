//! Writing a store in one pass: records as they come, then metadata and index, the header last.
//!
//! Records of level 0 go straight to the file that will be the store. Records of the coarser levels come in between; each
//! level is spooled to a scratch file and appended at the end. Index entries are spooled too, a layer of bricks at a
//! time: the memory taken does not grow with the volume's depth.
//!
//! All these files lie in a [`PartialFolder`] and are only ever appended to. So what a killed process left can be gone on
//! with, given how long each file was when a layer of bricks was finished: a [`WriterMark`] says that, [`super::journal`]
//! keeps it, [`super::unfinished`] takes it up.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use glam::UVec3;

use super::codec::EncodedBrick;
use super::error::StoreError;
use super::header::{HEADER_LEN, Header, MAX_LEVELS, UNFINISHED_MAGIC, align_up};
use super::index::{BrickEntry, ByteRange, ENTRY_LEN};
use super::journal::Journal;
use super::meta::StoreMeta;
use crate::geom::{BrickGrid, BrickId};
use crate::outfile::{Existing, PartialFolder};
use crate::volume::StoredType;

/// Bytes of each level's buffers, records and index together, and of the output's: what a memory plan counts.
pub const BUFFER_BYTES: usize = 2 * SPOOL_BUFFER;
const SPOOL_BUFFER: usize = 128 << 10;
const COPY_BUFFER: usize = 256 << 10;

/// The file in the folder that becomes the store: the header's place, then records of level 0.
pub(super) const STORE_FILE: &str = "store";

/// The file with the records of a level: those of level 0 are in the store itself.
pub(super) fn records_file(level: usize) -> String {
    if level == 0 {
        STORE_FILE.to_owned()
    } else {
        format!("level-{level}.records")
    }
}

/// The file with the index entries of a level.
pub(super) fn index_file(level: usize) -> String {
    format!("level-{level}.index")
}

/// Where in its file a level's records begin.
pub(super) const fn records_start(level: usize) -> u64 {
    if level == 0 { HEADER_LEN as u64 } else { 0 }
}

/// How far a level of a store being written has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelMark {
    /// Finished layers of bricks.
    pub layers: u32,
    /// Length of the file that holds the level's records.
    pub records_end: u64,
    /// CRC32C of the index entries of all finished layers, as they are spooled.
    pub index_crc: u32,
}

/// How far a store being written has come: one mark per level, finest first.
pub type WriterMark = Vec<LevelMark>;

/// A store being written. Dropping it unfinished leaves nothing behind.
#[derive(Debug)]
pub struct StoreWriter {
    out: File,
    buffer: Vec<u8>,
    /// Bytes of the file so far, buffered ones included.
    position: u64,
    stored_type: StoredType,
    levels: Vec<LevelWriter>,
    /// Last, so that the files are closed before the folder is removed.
    folder: PartialFolder,
}

#[derive(Debug)]
struct LevelWriter {
    grid: BrickGrid,
    /// Records of a level above 0, and how many bytes they are.
    spool: Option<BufWriter<File>>,
    spooled: u64,
    index: BufWriter<File>,
    index_crc: u32,
    /// Entries of the current layer of bricks, x fastest.
    layer: Vec<[u8; ENTRY_LEN]>,
    layer_z: u32,
    missing: usize,
}

impl LevelWriter {
    /// A level of which `layers` layers are finished, whose files end where they do in `mark`.
    fn new(grid: BrickGrid, records: Option<File>, index: File, mark: &LevelMark) -> Self {
        let per_layer = layer_len(&grid);
        let buffered = |file| BufWriter::with_capacity(SPOOL_BUFFER, file);
        Self {
            grid,
            spooled: mark.records_end,
            spool: records.map(buffered),
            index: buffered(index),
            index_crc: mark.index_crc,
            layer: vec![[0; ENTRY_LEN]; per_layer],
            layer_z: mark.layers,
            missing: if mark.layers < grid.bricks.z {
                per_layer
            } else {
                0
            },
        }
    }
}

impl StoreWriter {
    /// Starts the store `path` with these levels, finest first (1 to 32 of them).
    ///
    /// # Errors
    /// The file or its scratch files can't be made.
    pub fn create(
        path: &Path,
        existing: Existing,
        stored_type: StoredType,
        grids: &[BrickGrid],
    ) -> Result<Self, StoreError> {
        assert!(
            (1..=MAX_LEVELS).contains(&grids.len()),
            "invariant: a plan has 1 to {MAX_LEVELS} levels"
        );
        let folder = PartialFolder::create(path, existing)?;
        let mut levels = Vec::with_capacity(grids.len());
        let out = folder.create_file(STORE_FILE)?;
        for (l, &grid) in grids.iter().enumerate() {
            let records = match l {
                0 => None,
                _ => Some(folder.create_file(&records_file(l))?),
            };
            let index = folder.create_file(&index_file(l))?;
            let nothing = LevelMark {
                layers: 0,
                records_end: records_start(l),
                index_crc: 0,
            };
            levels.push(LevelWriter::new(grid, records, index, &nothing));
        }
        let mut writer = Self {
            out,
            buffer: Vec::with_capacity(2 * SPOOL_BUFFER),
            position: 0,
            stored_type,
            levels,
            folder,
        };
        writer.append(&unfinished_header())?;
        Ok(writer)
    }

    /// Goes on with the files of `folder`, which end where `mark` says: [`super::unfinished`] has seen to that.
    pub(super) fn go_on(
        folder: PartialFolder,
        stored_type: StoredType,
        grids: &[BrickGrid],
        mark: &WriterMark,
    ) -> Result<Self, StoreError> {
        let dest = folder.dest().to_owned();
        let open = |name: String| {
            let mut file = folder.open_file(&name)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        };
        let failed = || StoreError::io(&dest, "open its unfinished parts");
        let mut levels = Vec::with_capacity(grids.len());
        for ((l, &grid), mark) in grids.iter().enumerate().zip(mark) {
            let records = match l {
                0 => None,
                _ => Some(open(records_file(l)).map_err(failed())?),
            };
            let index = open(index_file(l)).map_err(failed())?;
            levels.push(LevelWriter::new(grid, records, index, mark));
        }
        let mut out = open(records_file(0)).map_err(failed())?;
        // The killed run may have come as far as writing the header.
        out.rewind()
            .and_then(|()| out.write_all(&unfinished_header()))
            .and_then(|()| out.seek(SeekFrom::End(0)))
            .map_err(failed())?;
        Ok(Self {
            out,
            buffer: Vec::with_capacity(2 * SPOOL_BUFFER),
            position: mark[0].records_end,
            stored_type,
            levels,
            folder,
        })
    }

    /// From now on the unfinished files go when this is dropped, as they do from the start in a store that was not gone
    /// on with.
    pub fn own_unfinished(&mut self) {
        self.folder.own();
    }

    /// A new journal beside the unfinished files.
    ///
    /// # Errors
    /// The system refused.
    pub fn journal(&self) -> Result<Journal, StoreError> {
        Journal::create(&self.folder, self.files()?)
    }

    /// The journal beside the unfinished files, gone on with after checkpoint `last.1` in place `last.0`.
    pub(super) fn resumed_journal(&self, last: (usize, u64)) -> Result<Journal, StoreError> {
        Journal::go_on(&self.folder, self.files()?, last)
    }

    /// All files that are written, by handles of their own.
    fn files(&self) -> Result<Vec<File>, StoreError> {
        let spools = self.levels.iter().filter_map(|l| l.spool.as_ref());
        let buffered = spools.chain(self.levels.iter().map(|l| &l.index));
        std::iter::once(&self.out)
            .chain(buffered.map(BufWriter::get_ref))
            .map(File::try_clone)
            .collect::<io::Result<_>>()
            .map_err(StoreError::io(self.folder.dest(), "share its files"))
    }

    /// Hands all buffered bytes to the system and says how far the store has come. Every level must be between two
    /// layers of bricks.
    ///
    /// # Errors
    /// The disk is full or fails.
    pub fn mark(&mut self) -> Result<WriterMark, StoreError> {
        self.flush()?;
        let position = self.position;
        let path = self.folder.dest();
        self.levels
            .iter_mut()
            .map(|level| {
                assert!(
                    level.missing == 0 || level.missing == level.layer.len(),
                    "invariant: marks are between layers of bricks"
                );
                if let Some(spool) = &mut level.spool {
                    spool.flush().map_err(spool_failed(path))?;
                }
                level.index.flush().map_err(spool_failed(path))?;
                Ok(LevelMark {
                    layers: level.layer_z,
                    records_end: if level.spool.is_some() {
                        level.spooled
                    } else {
                        position
                    },
                    index_crc: level.index_crc,
                })
            })
            .collect()
    }

    /// Appends a brick. All bricks of a layer (one z) must come before those of the next; inside it any order goes.
    ///
    /// # Errors
    /// The disk is full or fails.
    pub fn push(&mut self, id: BrickId, brick: &EncodedBrick) -> Result<(), StoreError> {
        let record = brick.record.as_deref();
        let len = record.map_or(0, <[u8]>::len) as u32;
        let level = &mut self.levels[usize::from(id.lod.0)];
        assert!(
            id.xyz.z == level.layer_z && level.missing > 0,
            "invariant: bricks come layer by layer"
        );
        let offset = if level.spool.is_some() {
            level.spooled
        } else {
            self.position
        };
        let entry = BrickEntry {
            min: brick.min,
            max: brick.max,
            constant: record.is_none(),
            record: record.map(|_| ByteRange { offset, len }),
            crc: brick.crc,
        };
        level.layer[level.grid.index(UVec3::new(id.xyz.x, id.xyz.y, 0)) as usize] =
            entry.to_bytes();
        level.missing -= 1;
        let path = self.folder.dest();
        if level.missing == 0 {
            let entries = level.layer.as_flattened();
            level.index.write_all(entries).map_err(spool_failed(path))?;
            level.index_crc = crc32c::crc32c_append(level.index_crc, entries);
            level.layer_z += 1;
            if level.layer_z < level.grid.bricks.z {
                level.missing = level.layer.len();
            }
        }
        let Some(record) = record else { return Ok(()) };
        match &mut level.spool {
            Some(spool) => {
                level.spooled += u64::from(len);
                spool.write_all(record).map_err(spool_failed(path))
            }
            None => self.append(record),
        }
    }

    /// Appends the coarser levels, metadata and index, writes the header, syncs, and gives the file its name. Returns
    /// the bytes of the file. Every brick must have been pushed.
    ///
    /// # Errors
    /// The disk is full or fails, or the file came into being meanwhile and may not be replaced.
    pub fn finish(mut self, meta: &StoreMeta) -> Result<u64, StoreError> {
        assert!(
            self.levels.iter().all(|l| l.layer_z == l.grid.bricks.z),
            "invariant: every brick was pushed"
        );
        let mut levels = std::mem::take(&mut self.levels);
        let mut bases = vec![0; levels.len()];
        for (level, base) in levels.iter_mut().zip(&mut bases) {
            if let Some(spool) = level.spool.take() {
                *base = self.position;
                self.copy(spool, |_| {})?;
            }
        }
        let records_len = self.position - HEADER_LEN as u64;
        let json = meta.to_json();
        self.pad()?;
        self.append(&json)?;
        let mut places = Vec::with_capacity(levels.len());
        for (level, base) in levels.into_iter().zip(bases) {
            self.pad()?;
            let mut crc = 0;
            self.copy(level.index, |bytes| {
                for entry in bytes.as_chunks_mut::<ENTRY_LEN>().0 {
                    rebase(entry, base);
                }
                crc = crc32c::crc32c_append(crc, bytes);
            })?;
            places.push((level.grid.bricks, crc));
        }
        let header = Header::lay_out(
            self.stored_type,
            records_len,
            json.len() as u64,
            crc32c::crc32c(&json),
            &places,
        )
        .expect("invariant: the file on disk is shorter than 2⁶⁴ bytes");
        assert_eq!(
            header.file_len, self.position,
            "invariant: sections lie where the header says"
        );
        self.flush()?;
        let Self {
            mut out, folder, ..
        } = self;
        out.seek(SeekFrom::Start(0))
            .and_then(|_| out.write_all(&header.to_bytes()))
            .map_err(StoreError::io(folder.dest(), "write the header"))?;
        folder.commit(STORE_FILE, out)?;
        Ok(header.file_len)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        if self.buffer.len() + bytes.len() > self.buffer.capacity() {
            self.flush()?;
        }
        self.position += bytes.len() as u64;
        if bytes.len() >= self.buffer.capacity() {
            return self
                .out
                .write_all(bytes)
                .map_err(StoreError::io(self.folder.dest(), "write"));
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    fn flush(&mut self) -> Result<(), StoreError> {
        self.out
            .write_all(&self.buffer)
            .map_err(StoreError::io(self.folder.dest(), "write"))?;
        self.buffer.clear();
        Ok(())
    }

    fn pad(&mut self) -> Result<(), StoreError> {
        let next = align_up(self.position).expect("invariant: far below 2⁶⁴");
        let zeros = [0; super::header::SECTION_ALIGN as usize];
        self.append(&zeros[..(next - self.position) as usize])
    }

    /// Appends all of `spool`, each piece (a multiple of the entry's length, but for a last one that ends short) after
    /// `change`.
    fn copy(
        &mut self,
        spool: BufWriter<File>,
        mut change: impl FnMut(&mut [u8]),
    ) -> Result<(), StoreError> {
        let path = self.folder.dest();
        let mut from = spool
            .into_inner()
            .map_err(|e| spool_failed(path)(e.into_error()))?;
        from.rewind().map_err(spool_failed(path))?;
        let mut piece = vec![0; COPY_BUFFER];
        loop {
            let n = read_full(&mut from, &mut piece).map_err(StoreError::io(
                self.folder.dest(),
                "read a scratch file back",
            ))?;
            if n == 0 {
                return Ok(());
            }
            change(&mut piece[..n]);
            self.append(&piece[..n])?;
        }
    }
}

/// What stands in the header's place until everything else is written.
fn unfinished_header() -> [u8; HEADER_LEN] {
    let mut bytes = [0; HEADER_LEN];
    bytes[..UNFINISHED_MAGIC.len()].copy_from_slice(&UNFINISHED_MAGIC);
    bytes
}

fn spool_failed(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    StoreError::io(path, "write a scratch file")
}

/// Reads until `out` is full or the file ends.
pub(super) fn read_full(from: &mut File, out: &mut [u8]) -> io::Result<usize> {
    let mut n = 0;
    while n < out.len() {
        match from.read(&mut out[n..]) {
            Ok(0) => break,
            Ok(more) => n += more,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(n)
}

/// Bricks of one layer.
pub(super) fn layer_len(grid: &BrickGrid) -> usize {
    grid.bricks.x as usize * grid.bricks.y as usize
}

/// Adds `base` to the offset of an entry's record, if it has one.
fn rebase(entry: &mut [u8; ENTRY_LEN], base: u64) {
    let len = u32::from_le_bytes(entry[8..12].try_into().expect("invariant: 4 bytes"));
    if len > 0 {
        let offset = u64::from_le_bytes(entry[0..8].try_into().expect("invariant: 8 bytes"));
        entry[0..8].copy_from_slice(&(offset + base).to_le_bytes());
    }
}

/// The bytes that a writer of these levels keeps in memory: buffers and one layer of entries each.
pub fn memory_bytes(grids: &[BrickGrid]) -> u64 {
    let entries: u64 = grids
        .iter()
        .map(|g| (layer_len(g) * ENTRY_LEN) as u64)
        .sum();
    entries + ((grids.len() + 1) * BUFFER_BYTES + COPY_BUFFER) as u64
}
