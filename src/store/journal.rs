//! The journal of a store being written: how far it has come, so that a run that was killed can be gone on with.
//!
//! Two files take turns, each with one checkpoint; the older one is overwritten. A torn write spoils that one alone, and
//! the store's own files, which are only appended to, still hold what the other one speaks of. A checkpoint is written
//! after the bytes that it counts are on the disk.
//!
//! ```text
//! offset  bytes  content
//!      0      8  signature 89 42 53 4a 0d 0a 1a 0a ("\x89BSJ\r\n\x1a\n")
//!      8      4  version of the journal, u32: 1
//!     12      4  CRC32C of all bytes from 16 on
//!     16      8  length of the file, u64
//!     24      8  number of the checkpoint, u64: from 1, rising
//!     32      4  levels, u32: 1 … 32
//!     36      4  zero
//!     40     16  level 0 ─┬─  0  4  finished layers of bricks, u32
//!     56     16  level 1  ├─  4  4  CRC32C of their index entries, u32
//!      …                  └─  8  8  length of the file with the level's records, u64
//!                state of the pass: what `bricking` needs to go on; opaque here
//! ```

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::error::StoreError;
use super::header::MAX_LEVELS;
use super::writer::{LevelMark, WriterMark};
use crate::outfile::PartialFolder;

const FILES: [&str; 2] = ["journal-0", "journal-1"];
const MAGIC: [u8; 8] = *b"\x89BSJ\r\n\x1a\n";
/// The version of the journal that this program reads and writes.
pub const JOURNAL_VERSION: u32 = 1;
const CRC_FROM: usize = 16;
const LEVELS_AT: usize = 40;
const LEVEL_LEN: usize = 16;
/// More is no journal: statistics of f32 take the most, 12 MiB.
const MAX_LEN: u64 = 64 << 20;

/// What a checkpoint holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Which one of the run, and of the runs that it goes on with: from 1.
    pub number: u64,
    /// How far the files have come.
    pub mark: WriterMark,
    /// What the pass needs to go on.
    pub state: Vec<u8>,
}

/// The journal's files, and handles to the files that it speaks of.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    slots: [File; 2],
    next_slot: usize,
    next_number: u64,
    data: Vec<File>,
}

impl Journal {
    /// An empty journal in `folder`.
    pub(super) fn create(folder: &PartialFolder, data: Vec<File>) -> Result<Self, StoreError> {
        Ok(Self {
            path: folder.dest().to_owned(),
            slots: [folder.create_file(FILES[0])?, folder.create_file(FILES[1])?],
            next_slot: 0,
            next_number: 1,
            data,
        })
    }

    /// The journal in `folder`, gone on with after the checkpoint `last` in the file `slot`.
    pub(super) fn go_on(
        folder: &PartialFolder,
        data: Vec<File>,
        (slot, last): (usize, u64),
    ) -> Result<Self, StoreError> {
        let path = folder.dest().to_owned();
        let open = |name| {
            folder
                .open_file(name)
                .map_err(StoreError::io(&path, "open its journal"))
        };
        Ok(Self {
            slots: [open(FILES[0])?, open(FILES[1])?],
            next_slot: 1 - slot,
            next_number: last + 1,
            data,
            path,
        })
    }

    /// Writes a checkpoint, after all that it counts is on the disk.
    ///
    /// # Errors
    /// The disk is full or fails. The checkpoint before it stays.
    pub fn write(&mut self, mark: &WriterMark, state: &[u8]) -> Result<(), StoreError> {
        for file in &self.data {
            file.sync_data()
                .map_err(StoreError::io(&self.path, "sync its unfinished parts"))?;
        }
        let head = head(self.next_number, mark, state);
        let slot = &mut self.slots[self.next_slot];
        slot.seek(SeekFrom::Start(0))
            .and_then(|_| slot.write_all(&head))
            .and_then(|()| slot.write_all(state))
            .and_then(|()| slot.set_len((head.len() + state.len()) as u64))
            .and_then(|()| slot.sync_data())
            .map_err(StoreError::io(&self.path, "write its journal"))?;
        self.next_slot = 1 - self.next_slot;
        self.next_number += 1;
        Ok(())
    }
}

/// All bytes of a checkpoint but its state, which follows.
fn head(number: u64, mark: &WriterMark, state: &[u8]) -> Vec<u8> {
    let len = LEVELS_AT + mark.len() * LEVEL_LEN;
    let mut out = Vec::with_capacity(len);
    out.extend(MAGIC);
    out.extend(JOURNAL_VERSION.to_le_bytes());
    out.extend([0; 4]);
    out.extend(((len + state.len()) as u64).to_le_bytes());
    out.extend(number.to_le_bytes());
    out.extend((mark.len() as u32).to_le_bytes());
    out.extend([0; 4]);
    for level in mark {
        out.extend(level.layers.to_le_bytes());
        out.extend(level.index_crc.to_le_bytes());
        out.extend(level.records_end.to_le_bytes());
    }
    let crc = crc32c::crc32c_append(crc32c::crc32c(&out[CRC_FROM..]), state);
    out[12..CRC_FROM].copy_from_slice(&crc.to_le_bytes());
    out
}

/// What a journal file is found to be.
#[derive(Debug, PartialEq, Eq)]
enum Slot {
    /// Never written, torn or damaged: as if it were not there.
    Unusable,
    /// Of another version of the journal.
    Version(u32),
    /// A checkpoint.
    Valid(Checkpoint),
}

fn decode(bytes: &[u8]) -> Slot {
    let u32_at = |at: usize| {
        let bytes = bytes.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(bytes))
    };
    let u64_at = |at: usize| {
        let bytes = bytes.get(at..at + 8)?.try_into().ok()?;
        Some(u64::from_le_bytes(bytes))
    };
    if bytes.get(..8) != Some(&MAGIC) {
        return Slot::Unusable;
    }
    match u32_at(8) {
        None => return Slot::Unusable,
        Some(JOURNAL_VERSION) => {}
        Some(other) => return Slot::Version(other),
    }
    let valid = || {
        let is_whole = u64_at(16)? == bytes.len() as u64
            && u32_at(12)? == crc32c::crc32c(bytes.get(CRC_FROM..)?);
        let levels = u32_at(32)? as usize;
        if !is_whole || !(1..=MAX_LEVELS).contains(&levels) {
            return None;
        }
        let mark = (0..levels)
            .map(|l| LEVELS_AT + l * LEVEL_LEN)
            .map(|at| {
                Some(LevelMark {
                    layers: u32_at(at)?,
                    index_crc: u32_at(at + 4)?,
                    records_end: u64_at(at + 8)?,
                })
            })
            .collect::<Option<_>>()?;
        Some(Checkpoint {
            number: u64_at(24)?,
            mark,
            state: bytes.get(LEVELS_AT + levels * LEVEL_LEN..)?.to_vec(),
        })
    };
    valid().map_or(Slot::Unusable, Slot::Valid)
}

/// The checkpoints in `folder` with the number of the file that each is in, newest first.
pub(super) fn read(folder: &PartialFolder) -> Result<Vec<(usize, Checkpoint)>, StoreError> {
    let mut found = Vec::new();
    let mut other_version = None;
    for (slot, name) in FILES.into_iter().enumerate() {
        match decode(&read_file(&folder.path().join(name), folder.dest())?) {
            Slot::Unusable => {}
            Slot::Version(version) => other_version = Some(version),
            Slot::Valid(checkpoint) => found.push((slot, checkpoint)),
        }
    }
    found.sort_by_key(|(_, c)| std::cmp::Reverse(c.number));
    match other_version {
        // Beside a checkpoint that can be used it is damage.
        Some(version) if found.is_empty() => Err(StoreError::JournalVersion {
            path: folder.dest().to_owned(),
            found: version,
            supported: JOURNAL_VERSION,
        }),
        _ => Ok(found),
    }
}

/// All bytes of a journal file; none when it is not there or too long to be one.
fn read_file(path: &Path, dest: &Path) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    match File::open(path) {
        Ok(file) => {
            file.take(MAX_LEN + 1)
                .read_to_end(&mut bytes)
                .map_err(StoreError::io(dest, "read its journal"))?;
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
        Err(e) => return Err(StoreError::io(dest, "open its journal")(e)),
    }
    if bytes.len() as u64 > MAX_LEN {
        bytes.clear();
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outfile::Existing;

    fn mark(n: u64) -> WriterMark {
        (0..3)
            .map(|l| LevelMark {
                layers: n as u32 + l,
                records_end: n * 1000 + u64::from(l),
                index_crc: 77 * l,
            })
            .collect()
    }

    #[test]
    fn the_newest_whole_checkpoint_counts() {
        let dir = tempfile::tempdir().unwrap();
        let folder = PartialFolder::create(&dir.path().join("a"), Existing::Refuse).unwrap();
        let mut journal = Journal::create(&folder, Vec::new()).unwrap();
        assert_eq!(read(&folder).unwrap(), [], "nothing yet");
        // Each state is shorter than the one before: what is left of it must not count.
        for n in 1..=3u64 {
            journal
                .write(&mark(n), &vec![n as u8; 40 - 10 * n as usize])
                .unwrap();
        }
        let at = |n: u64| Checkpoint {
            number: n,
            mark: mark(n),
            state: vec![n as u8; 40 - 10 * n as usize],
        };
        assert_eq!(
            read(&folder).unwrap(),
            [(0, at(3)), (1, at(2))],
            "the last two"
        );
        // Whatever happens to the newest, it is either as it was or not there.
        let path = folder.path().join(FILES[0]);
        let whole = std::fs::read(&path).unwrap();
        for at_byte in 0..whole.len() {
            let mut bad = whole.clone();
            bad[at_byte] ^= 1 << (at_byte % 8);
            std::fs::write(&path, &bad).unwrap();
            assert_eq!(
                read(&folder).unwrap(),
                [(1, at(2))],
                "byte {at_byte} flipped"
            );
            std::fs::write(&path, &whole[..at_byte]).unwrap();
            assert_eq!(
                read(&folder).unwrap(),
                [(1, at(2))],
                "cut at byte {at_byte}"
            );
        }
        // The one that goes on overwrites the damaged one.
        let mut journal = Journal::go_on(&folder, Vec::new(), (1, 2)).unwrap();
        journal.write(&mark(3), &[3; 10]).unwrap();
        assert_eq!(read(&folder).unwrap(), [(0, at(3)), (1, at(2))], "again");
    }

    #[test]
    fn another_version_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let folder = PartialFolder::create(&dir.path().join("a"), Existing::Refuse).unwrap();
        let mut bytes = head(1, &mark(1), &[]);
        bytes[8] = 9;
        std::fs::write(folder.path().join(FILES[0]), &bytes).unwrap();
        assert!(
            matches!(
                read(&folder),
                Err(StoreError::JournalVersion {
                    found: 9,
                    supported: 1,
                    ..
                })
            ),
            "version 9"
        );
    }
}
