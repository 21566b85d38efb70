//! Writing a store in one pass: records as they come, then metadata and index, the header last.
//!
//! Records of level 0 go straight to the file. Records of the coarser levels come in between; each level is spooled to a
//! scratch file in the same folder (already unlinked where the system allows it, so that nothing can be left behind) and
//! appended at the end. Index entries are spooled too, a layer of bricks at a time: the memory taken does not grow with
//! the volume's depth.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use glam::UVec3;

use super::codec::EncodedBrick;
use super::error::StoreError;
use super::header::{HEADER_LEN, Header, MAX_LEVELS, align_up};
use super::index::{BrickEntry, ByteRange, ENTRY_LEN};
use super::meta::StoreMeta;
use crate::geom::{BrickGrid, BrickId};
use crate::outfile::{Existing, OutFile};
use crate::volume::StoredType;

/// Bytes of each level's buffers, records and index together, and of the output's: what a memory plan counts.
pub const BUFFER_BYTES: usize = 2 * SPOOL_BUFFER;
const SPOOL_BUFFER: usize = 128 << 10;
const COPY_BUFFER: usize = 256 << 10;

/// A store being written. Dropping it unfinished leaves nothing behind.
#[derive(Debug)]
pub struct StoreWriter {
    out: OutFile,
    buffer: Vec<u8>,
    /// Bytes of the file so far, buffered ones included.
    position: u64,
    stored_type: StoredType,
    levels: Vec<LevelWriter>,
}

#[derive(Debug)]
struct LevelWriter {
    grid: BrickGrid,
    /// Records of a level above 0, and how many bytes they are.
    spool: Option<BufWriter<File>>,
    spooled: u64,
    index: BufWriter<File>,
    /// Entries of the current layer of bricks, x fastest.
    layer: Vec<[u8; ENTRY_LEN]>,
    layer_z: u32,
    missing: usize,
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
        let out = OutFile::create(path, existing)?;
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        let scratch = || {
            tempfile::tempfile_in(&folder)
                .map(|file| BufWriter::with_capacity(SPOOL_BUFFER, file))
                .map_err(StoreError::io(path, "create a scratch file in its folder"))
        };
        let mut levels = Vec::with_capacity(grids.len());
        for (l, &grid) in grids.iter().enumerate() {
            let per_layer = layer_len(&grid);
            levels.push(LevelWriter {
                grid,
                spool: if l == 0 { None } else { Some(scratch()?) },
                spooled: 0,
                index: scratch()?,
                layer: vec![[0; ENTRY_LEN]; per_layer],
                layer_z: 0,
                missing: per_layer,
            });
        }
        let mut writer = Self {
            out,
            buffer: Vec::with_capacity(2 * SPOOL_BUFFER),
            position: 0,
            stored_type,
            levels,
        };
        // The place of the header; it is written when everything else is.
        writer.append(&[0; HEADER_LEN])?;
        Ok(writer)
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
        let path = self.out.dest();
        if level.missing == 0 {
            level
                .index
                .write_all(level.layer.as_flattened())
                .map_err(StoreError::io(path, "write a scratch file"))?;
            level.layer_z += 1;
            if level.layer_z < level.grid.bricks.z {
                level.missing = level.layer.len();
            }
        }
        let Some(record) = record else { return Ok(()) };
        match &mut level.spool {
            Some(spool) => {
                level.spooled += u64::from(len);
                spool
                    .write_all(record)
                    .map_err(StoreError::io(path, "write a scratch file"))
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
                let mut spool = self.rewind(spool)?;
                self.copy(&mut spool, |_| {})?;
            }
        }
        let records_len = self.position - HEADER_LEN as u64;
        let json = meta.to_json();
        self.pad()?;
        self.append(&json)?;
        let mut places = Vec::with_capacity(levels.len());
        for (level, base) in levels.into_iter().zip(bases) {
            self.pad()?;
            let mut index = self.rewind(level.index)?;
            let mut crc = 0;
            self.copy(&mut index, |bytes| {
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
        let path = self.out.dest().to_owned();
        let file = self.out.file();
        file.seek(SeekFrom::Start(0))
            .and_then(|_| file.write_all(&header.to_bytes()))
            .map_err(StoreError::io(&path, "write the header"))?;
        self.out.commit()?;
        Ok(header.file_len)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        if self.buffer.len() + bytes.len() > self.buffer.capacity() {
            self.flush()?;
        }
        self.position += bytes.len() as u64;
        if bytes.len() >= self.buffer.capacity() {
            let path = self.out.dest().to_owned();
            return self
                .out
                .file()
                .write_all(bytes)
                .map_err(StoreError::io(&path, "write"));
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    fn flush(&mut self) -> Result<(), StoreError> {
        let path = self.out.dest().to_owned();
        self.out
            .file()
            .write_all(&self.buffer)
            .map_err(StoreError::io(&path, "write"))?;
        self.buffer.clear();
        Ok(())
    }

    fn pad(&mut self) -> Result<(), StoreError> {
        let next = align_up(self.position).expect("invariant: far below 2⁶⁴");
        let zeros = [0; super::header::SECTION_ALIGN as usize];
        self.append(&zeros[..(next - self.position) as usize])
    }

    fn rewind(&self, spool: BufWriter<File>) -> Result<File, StoreError> {
        let io = |error| StoreError::Io {
            path: self.out.dest().to_owned(),
            doing: "write a scratch file",
            error,
        };
        let mut file = spool.into_inner().map_err(|e| io(e.into_error()))?;
        file.rewind().map_err(io)?;
        Ok(file)
    }

    /// Appends all of `from`, each piece (a multiple of the entry's length, but for a last one that ends short) after
    /// `change`.
    fn copy(
        &mut self,
        from: &mut File,
        mut change: impl FnMut(&mut [u8]),
    ) -> Result<(), StoreError> {
        let mut piece = vec![0; COPY_BUFFER];
        loop {
            let n = read_full(from, &mut piece)
                .map_err(StoreError::io(self.out.dest(), "read a scratch file back"))?;
            if n == 0 {
                return Ok(());
            }
            change(&mut piece[..n]);
            self.append(&piece[..n])?;
        }
    }
}

/// Reads until `out` is full or the file ends.
fn read_full(from: &mut File, out: &mut [u8]) -> io::Result<usize> {
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
fn layer_len(grid: &BrickGrid) -> usize {
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
