//! Reading a store: the file is mapped; header and metadata are checked at open, each level's index once before its first
//! use, records when they are read.
//!
//! Opening touches nothing that grows with the volume. [`Store::check_level`] is one pass over a level's index (32 bytes
//! per brick: checksum and every entry by itself); afterwards its entries are used without further checks. The index stays
//! in the mapping and is never copied.
//!
//! **The file must not change while it is open.** It is mapped: another program that shortens it makes the next access
//! end this process with SIGBUS, and one that writes into it makes checked bytes wrong. Its length is checked at open.
//! Stores are written under another name and renamed, so replacing one with `brick --force` is safe.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glam::DVec3;
use memmap2::Mmap;

use super::StoreMeta;
use super::codec::{self, RANGES_LEN};
use super::error::{Fault, Part, StoreError};
use super::header::{HEADER_LEN, Header, MAGIC, UNFINISHED_MAGIC, VERSION};
use super::index::{BrickEntry, ENTRY_LEN};
use super::writer::STORE_FILE;
use crate::geom::{BLOCKS_PER_BRICK, BrickGrid, BrickId, Lod, STORED_VOXELS};
use crate::outfile::PartialFolder;
use crate::volume::StoredType;

/// Index entries that are checked at once: small enough to be in the cache for the second look.
const CHECKED_AT_ONCE: usize = 1024;

/// A level of an open store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Voxels and bricks of the level.
    pub grid: BrickGrid,
    /// Voxels of level 0 per voxel of this level, along each axis.
    pub scale: DVec3,
}

/// An open store. Reading takes `&self`: share it in an `Arc`.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    map: Mmap,
    header: Header,
    meta: StoreMeta,
    levels: Vec<Level>,
    /// What the check of each level's index found, once it was made.
    checked: Vec<OnceLock<Result<(), Fault>>>,
}

/// A decoded brick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BrickData {
    /// 34³ voxels of the stored type, little-endian, x fastest, border included.
    pub voxels: Vec<u8>,
    /// Range (low, high) of each 4³ block and the voxels around it in stored units, rounded outward; x fastest.
    pub block_ranges: Vec<[f32; 2]>,
}

/// What reading bricks needs again and again: a zstd context and a buffer. One per thread.
pub struct BrickReader {
    decompressor: zstd::bulk::Decompressor<'static>,
    plain: Vec<u8>,
}

impl BrickReader {
    /// A reader.
    ///
    /// # Errors
    /// zstd has no memory.
    pub fn new() -> io::Result<Self> {
        Ok(Self {
            decompressor: zstd::bulk::Decompressor::new()?,
            plain: Vec::new(),
        })
    }

    /// Decodes a record, after its checksum.
    pub(super) fn decode(
        &mut self,
        id: BrickId,
        entry: &BrickEntry,
        record: &[u8],
        stored_type: StoredType,
    ) -> Result<(), Fault> {
        let offset = entry.record.map_or(0, |r| r.offset);
        let crc = crc32c::crc32c(record);
        if crc != entry.crc {
            return Err(Fault::crc(Part::Brick(id), offset, entry.crc, crc));
        }
        let expected = codec::plain_len(stored_type);
        self.plain.resize(expected, 0);
        let found = self
            .decompressor
            .decompress_to_buffer(record, &mut self.plain[..]);
        let damaged = |found: String| {
            Fault::new(
                Part::Brick(id),
                offset,
                format!("a zstd frame of {expected} bytes"),
                found,
            )
        };
        match found {
            Ok(n) if n == expected => Ok(()),
            Ok(n) => Err(damaged(format!("one of {n}"))),
            Err(error) => Err(damaged(error.to_string())),
        }
    }

    /// The block ranges of the record decoded last, as they are stored.
    pub(super) fn quantised_ranges(&self) -> &[u8] {
        &self.plain[..RANGES_LEN]
    }

    /// The voxels of the record decoded last, as they are stored: byte-shuffled.
    pub(super) fn planes(&self) -> &[u8] {
        &self.plain[RANGES_LEN..]
    }
}

impl Store {
    /// Opens the store at `path` and checks header and metadata, whatever the number of bricks.
    ///
    /// # Errors
    /// It can't be read, is not a store, is not finished, is of another version or another length, or header or metadata
    /// are damaged.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let file = File::open(path).map_err(|error| {
            if error.kind() == io::ErrorKind::NotFound && PartialFolder::path_for(path).is_dir() {
                unfinished(path, path, "only its unfinished parts are there".into())
            } else {
                StoreError::io(path, "open")(error)
            }
        })?;
        let info = file.metadata().map_err(StoreError::io(path, "read"))?;
        if info.is_dir() {
            if path.join(STORE_FILE).is_file() {
                // The folder of unfinished parts itself.
                return Self::open(&path.join(STORE_FILE));
            }
            return Err(StoreError::NotAStore {
                path: path.to_owned(),
                found: "a folder".into(),
            });
        }
        let len = info.len();
        let header = read_header(path, &file, len)?;
        // SAFETY: the file is a regular one, mapped read-only; its length was just compared with the header. That no
        // other process shortens or changes it is the caller's part, stated in the module's documentation.
        let map = unsafe { Mmap::map(&file) }.map_err(StoreError::io(path, "map into memory"))?;
        if map.len() as u64 != header.file_len {
            return Err(StoreError::Length {
                path: path.to_owned(),
                expected: header.file_len,
                found: map.len() as u64,
            });
        }
        let text = section(&map, header.metadata_offset, header.metadata_len);
        let crc = crc32c::crc32c(text);
        if crc != header.metadata_crc {
            let fault = Fault::crc(
                Part::Metadata,
                header.metadata_offset,
                header.metadata_crc,
                crc,
            );
            return Err(fault.at(path));
        }
        let meta = StoreMeta::from_json(text, &header).map_err(|f| f.at(path))?;
        let levels: Vec<Level> = meta
            .levels
            .iter()
            .map(|level| Level {
                grid: BrickGrid::for_voxels(level.dims)
                    .expect("invariant: metadata was checked against the header's grids"),
                scale: level.scale,
            })
            .collect();
        let checked = levels.iter().map(|_| OnceLock::new()).collect();
        Ok(Self {
            path: path.to_owned(),
            map,
            header,
            meta,
            levels,
            checked,
        })
    }

    /// Checks the index of a level: its checksum, and every entry by itself. Only the first call does, the others tell
    /// what it found; from any thread. Panics when there is no such level.
    ///
    /// # Errors
    /// The index is damaged.
    pub fn check_level(&self, lod: Lod) -> Result<(), StoreError> {
        match self.index_fault(lod) {
            None => Ok(()),
            Some(fault) => Err(fault.clone().at(&self.path)),
        }
    }

    /// As [`Self::check_level`], of every level.
    ///
    /// # Errors
    /// The index of some level is damaged.
    pub fn check_all_levels(&self) -> Result<(), StoreError> {
        (0..self.levels.len()).try_for_each(|l| self.check_level(Lod(l as u8)))
    }

    /// What [`Self::check_level`] finds, as a fault.
    pub fn index_fault(&self, lod: Lod) -> Option<&Fault> {
        self.checked[usize::from(lod.0)]
            .get_or_init(|| self.check_index(lod))
            .as_ref()
            .err()
    }

    /// What the store says of its volume.
    pub fn meta(&self) -> &StoreMeta {
        &self.meta
    }

    /// The file, as it was given to [`Self::open`].
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of the file.
    pub fn file_len(&self) -> u64 {
        self.header.file_len
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Type of the voxels.
    pub fn stored_type(&self) -> StoredType {
        self.header.stored_type
    }

    /// Number of levels, at least 1.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// A level. Panics when there is no such level.
    pub fn level(&self, lod: Lod) -> &Level {
        &self.levels[usize::from(lod.0)]
    }

    /// All bricks of a level, in the order of the index.
    pub fn bricks(&self, lod: Lod) -> impl Iterator<Item = BrickId> + '_ {
        let grid = self.level(lod).grid;
        (0..grid.len()).map(move |i| BrickId::new(lod, grid.xyz(i)))
    }

    /// What the index says of a brick: a few loads from the mapping. [`Self::check_level`] must have found its level
    /// sound. Panics when there is no such brick.
    pub fn entry(&self, id: BrickId) -> BrickEntry {
        debug_assert!(
            matches!(self.checked[usize::from(id.lod.0)].get(), Some(Ok(()))),
            "invariant: the index of {} was checked before its first use",
            id.lod
        );
        let bytes = self.entry_bytes(id.lod, self.brick_index(id));
        BrickEntry::parse(bytes, self.header.stored_type, self.records_range())
            .expect("invariant: the index of the level was checked, and is sound")
    }

    /// Reads and decodes a brick into fresh buffers; a Constant one is filled in. Checks its level if nobody has.
    ///
    /// # Errors
    /// The record, or the index of its level, is damaged.
    pub fn read_brick(
        &self,
        id: BrickId,
        reader: &mut BrickReader,
    ) -> Result<BrickData, StoreError> {
        let mut data = BrickData::default();
        self.read_brick_into(id, reader, &mut data)?;
        Ok(data)
    }

    /// As [`Self::read_brick`], into buffers that are used again.
    ///
    /// # Errors
    /// The record, or the index of its level, is damaged; `data` then holds nothing of use.
    pub fn read_brick_into(
        &self,
        id: BrickId,
        reader: &mut BrickReader,
        data: &mut BrickData,
    ) -> Result<(), StoreError> {
        self.check_level(id.lod)?;
        let stored_type = self.header.stored_type;
        let entry = self.entry(id);
        data.voxels.resize(STORED_VOXELS * stored_type.size(), 0);
        if !self
            .decode(id, &entry, reader)
            .map_err(|f| f.at(&self.path))?
        {
            fill(&mut data.voxels, stored_type, entry.min);
            data.block_ranges.clear();
            data.block_ranges
                .resize(BLOCKS_PER_BRICK, [entry.min, entry.min]);
            return Ok(());
        }
        data.block_ranges.clear();
        let pairs = reader.quantised_ranges().as_chunks::<2>().0;
        data.block_ranges.extend(pairs.iter().map(|&[low, high]| {
            [
                codec::range_low(stored_type, entry.min, entry.max, low),
                codec::range_high(stored_type, entry.min, entry.max, high),
            ]
        }));
        unshuffle_le(stored_type, reader.planes(), &mut data.voxels);
        Ok(())
    }

    /// Tells the system that the records of these bricks will be read soon; records that lie side by side in one hint.
    /// Best effort: no answer, no error.
    pub fn advise_will_need(&self, ids: &[BrickId]) {
        #[cfg(unix)]
        {
            let mut records: Vec<(u64, u64)> = ids
                .iter()
                .filter_map(|&id| self.entry(id).record)
                .map(|r| (r.offset, r.offset + u64::from(r.len)))
                .collect();
            records.sort_unstable();
            for run in records.chunk_by(|a, b| a.1 == b.0) {
                let (start, end) = (run[0].0, run[run.len() - 1].1);
                // A refused hint costs only time.
                let _ = self.map.advise_range(
                    memmap2::Advice::WillNeed,
                    start as usize,
                    (end - start) as usize,
                );
            }
        }
        #[cfg(not(unix))]
        let _ = ids;
    }

    /// Decodes the record of a brick into `reader`; `false` when it is Constant and there is none.
    pub(super) fn decode(
        &self,
        id: BrickId,
        entry: &BrickEntry,
        reader: &mut BrickReader,
    ) -> Result<bool, Fault> {
        let Some(place) = entry.record else {
            return Ok(false);
        };
        let record = section(&self.map, place.offset, u64::from(place.len));
        reader.decode(id, entry, record, self.header.stored_type)?;
        Ok(true)
    }

    /// The bytes of a part of the file, which must lie inside it.
    pub(super) fn bytes(&self, offset: u64, len: u64) -> &[u8] {
        section(&self.map, offset, len)
    }

    /// Where records may be: (start, end) offsets.
    pub(super) fn records_range(&self) -> (u64, u64) {
        let start = HEADER_LEN as u64;
        (start, start + self.header.records_len)
    }

    fn brick_index(&self, id: BrickId) -> u64 {
        let grid = &self.level(id.lod).grid;
        assert!(
            id.xyz.cmplt(grid.bricks).all(),
            "invariant: {id} is inside its grid of {} bricks",
            grid.bricks
        );
        grid.index(id.xyz)
    }

    fn entry_bytes(&self, lod: Lod, index: u64) -> &[u8; ENTRY_LEN] {
        let place = self.header.level(lod);
        let offset = place.offset + index * ENTRY_LEN as u64;
        section(&self.map, offset, ENTRY_LEN as u64)
            .try_into()
            .expect("invariant: a section has the length that was asked for")
    }

    /// Checksum of a level's index, and every entry by itself.
    fn check_index(&self, lod: Lod) -> Result<(), Fault> {
        let place = self.header.level(lod);
        let (entries, _) = section(&self.map, place.offset, place.len).as_chunks::<ENTRY_LEN>();
        let mut crc = 0;
        // Told only if the checksum holds: else that is what is wrong.
        let mut first_bad = None;
        for (piece, entries) in entries.chunks(CHECKED_AT_ONCE).enumerate() {
            crc = crc32c::crc32c_append(crc, entries.as_flattened());
            if first_bad.is_some() {
                continue;
            }
            first_bad = entries.iter().enumerate().find_map(|(i, entry)| {
                let parsed =
                    BrickEntry::parse(entry, self.header.stored_type, self.records_range());
                let at = place.offset + ((piece * CHECKED_AT_ONCE + i) * ENTRY_LEN) as u64;
                parsed
                    .err()
                    .map(|(expected, found)| Fault::new(Part::Index(lod), at, expected, found))
            });
        }
        if crc != place.crc {
            return Err(Fault::crc(Part::Index(lod), place.offset, place.crc, crc));
        }
        first_bad.map_or(Ok(()), Err)
    }
}

/// The error for something that is to become the store `out`.
fn unfinished(path: &Path, out: &Path, found: String) -> StoreError {
    StoreError::Unfinished {
        path: path.to_owned(),
        out: out.to_owned(),
        found,
    }
}

/// Reads and checks the header without mapping anything.
fn read_header(path: &Path, file: &File, len: u64) -> Result<Header, StoreError> {
    use std::io::Read;
    let mut start = Vec::with_capacity(HEADER_LEN);
    file.take(HEADER_LEN as u64)
        .read_to_end(&mut start)
        .map_err(StoreError::io(path, "read the header"))?;
    let shared = start.len().min(MAGIC.len());
    if start.starts_with(&UNFINISHED_MAGIC) {
        let found = "its header is not written yet".into();
        return Err(unfinished(path, Path::new("OUT.bsk"), found));
    }
    if start.is_empty() || start[..shared] != MAGIC[..shared] {
        return Err(StoreError::NotAStore {
            path: path.to_owned(),
            found: format!("{:02x?}", &start[..shared]),
        });
    }
    let Ok(bytes) = <&[u8; HEADER_LEN]>::try_from(&start[..]) else {
        return Err(StoreError::Length {
            path: path.to_owned(),
            expected: HEADER_LEN as u64,
            found: len,
        });
    };
    let version = Header::version(bytes);
    if version != VERSION {
        return Err(StoreError::Version {
            path: path.to_owned(),
            found: version,
            supported: VERSION,
        });
    }
    let header = Header::parse(bytes).map_err(|f| f.at(path))?;
    if header.file_len != len {
        return Err(StoreError::Length {
            path: path.to_owned(),
            expected: header.file_len,
            found: len,
        });
    }
    Ok(header)
}

/// Part of the mapping. The header's places were checked against the length of the file.
fn section(map: &[u8], offset: u64, len: u64) -> &[u8] {
    &map[offset as usize..(offset + len) as usize]
}

/// Fills `out` with one value of the type.
pub(super) fn fill(out: &mut [u8], stored_type: StoredType, value: f32) {
    match stored_type {
        StoredType::U8 => out.fill(value as u8),
        StoredType::U16 => out
            .as_chunks_mut::<2>()
            .0
            .fill((value as u16).to_le_bytes()),
        StoredType::F32 => out.as_chunks_mut::<4>().0.fill(value.to_le_bytes()),
    }
}

/// Undoes the byte-shuffle into little-endian voxels.
fn unshuffle_le(stored_type: StoredType, planes: &[u8], out: &mut [u8]) {
    let n = STORED_VOXELS;
    match stored_type {
        StoredType::U8 => out.copy_from_slice(planes),
        StoredType::U16 => {
            let (low, high) = planes.split_at(n);
            for ((b, &low), &high) in out.as_chunks_mut::<2>().0.iter_mut().zip(low).zip(high) {
                *b = [low, high];
            }
        }
        StoredType::F32 => {
            let (a, rest) = planes.split_at(n);
            let (b, rest) = rest.split_at(n);
            let (c, d) = rest.split_at(n);
            let planes = a.iter().zip(b).zip(c).zip(d);
            for (v, (((&a, &b), &c), &d)) in out.as_chunks_mut::<4>().0.iter_mut().zip(planes) {
                *v = [a, b, c, d];
            }
        }
    }
}
