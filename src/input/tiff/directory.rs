//! The structure of a TIFF file: byte order, chain of directories, fields of a directory. What fields mean is not known here.
//!
//! Every offset and count is checked against the file's length before anything is read or allocated.

use std::collections::HashSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::input::problem::Subject;
use crate::input::raw::Endian;
use crate::input::voxel_file::read_exact_at;
use crate::volume::SourceError;

/// Directories that a file has at most.
const MOST_DIRECTORIES: usize = 1 << 20;

/// Fields that a directory has at most: as many as there are tags.
const MOST_FIELDS: u64 = 1 << 16;

/// The number and the name of a field.
#[derive(Clone, Copy)]
pub(super) struct Tag(pub(super) u16, pub(super) &'static str);

/// A TIFF file, open; read by position, by several threads at once.
pub(super) struct Tiff {
    path: PathBuf,
    file: File,
    len: u64,
    endian: Endian,
    is_big: bool,
    first: u64,
}

/// One directory: what is said of a page.
pub(super) struct Directory {
    /// Its number in the chain, from 0.
    pub(super) number: usize,
    /// Byte of the file where it begins.
    pub(super) at: u64,
    fields: Vec<Field>,
    next: u64,
    /// Its length in the file.
    pub(super) bytes: u64,
}

struct Field {
    tag: u16,
    kind: u16,
    count: u64,
    /// The values where they fit, else where they are; as in the file, filled up with zeros.
    inline: [u8; 8],
}

impl Tiff {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// It can't be read, or is no TIFF file.
    pub(super) fn open(path: &Path) -> Result<Self, SourceError> {
        let subject = Subject::new(path);
        let (file, len) = subject.open()?;
        let mut tiff = Self {
            path: path.to_owned(),
            file,
            len,
            endian: Endian::Little,
            is_big: false,
            first: 0,
        };
        let mut head = [0; 8];
        tiff.read_at("the header", 0, &mut head)?;
        (tiff.endian, tiff.is_big) = match &head[..4] {
            b"II*\0" => (Endian::Little, false),
            b"MM\0*" => (Endian::Big, false),
            b"II+\0" => (Endian::Little, true),
            b"MM\0+" => (Endian::Big, true),
            other => {
                return Err(subject.malformed(
                    "the first bytes",
                    "those of TIFF or BigTIFF",
                    format!("{other:02x?}"),
                ));
            }
        };
        tiff.first = if tiff.is_big {
            let widths = (tiff.unsigned(&head[4..6]), tiff.unsigned(&head[6..8]));
            if widths != (8, 0) {
                return Err(subject.malformed(
                    "bytes 4 to 7",
                    "offsets of 8 bytes, then 0",
                    format!("{widths:?}"),
                ));
            }
            tiff.read_at("the header", 8, &mut head)?;
            tiff.unsigned(&head)
        } else {
            tiff.unsigned(&head[4..])
        };
        Ok(tiff)
    }

    /// What errors about the file name.
    pub(super) fn subject(&self) -> Subject<'_> {
        Subject::new(&self.path)
    }

    /// Length of the file in bytes.
    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// The order of the bytes of numbers, voxels among them.
    pub(super) fn endian(&self) -> Endian {
        self.endian
    }

    /// Fills `out` with the bytes from `at` on, which are `what`.
    ///
    /// # Errors
    /// The file ends before them, or the system refuses.
    pub(super) fn read_at(&self, what: &str, at: u64, out: &mut [u8]) -> Result<(), SourceError> {
        self.check_range(what, at, out.len() as u64)?;
        read_exact_at(&self.file, out, at).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => self.subject().malformed(
                what,
                format!("{} bytes from byte {at} on", out.len()),
                "the end of the file, which has become shorter since it was opened",
            ),
            _ => self.subject().io(format!("read {what} at byte {at}"), e),
        })
    }

    /// Refuses `bytes` bytes from `at` on that do not lie in the file.
    ///
    /// # Errors
    /// They do not.
    pub(super) fn check_range(&self, what: &str, at: u64, bytes: u64) -> Result<(), SourceError> {
        if at.checked_add(bytes).is_some_and(|end| end <= self.len) {
            return Ok(());
        }
        Err(self.subject().malformed(
            what,
            format!("{bytes} bytes from byte {at} on"),
            format!("a file of {} bytes", self.len),
        ))
    }

    /// The directories in their order.
    pub(super) fn directories(&self) -> Directories<'_> {
        Directories {
            tiff: self,
            next: self.first,
            seen: HashSet::new(),
            bytes: 0,
        }
    }

    /// The directory that begins at byte `at`.
    ///
    /// # Errors
    /// It does not lie in the file.
    pub(super) fn directory(&self, number: usize, at: u64) -> Result<Directory, SourceError> {
        let what = format!("the directory of page {number}");
        let (count_bytes, field_bytes) = if self.is_big { (8, 20) } else { (2, 12) };
        let offset_bytes = self.offset_bytes();
        let mut buffer = [0; 8];
        self.read_at(&what, at, &mut buffer[..count_bytes])?;
        let count = self.unsigned(&buffer[..count_bytes]);
        if count > MOST_FIELDS {
            return Err(self.subject().malformed(
                what,
                format!("at most {MOST_FIELDS} fields"),
                count.to_string(),
            ));
        }
        let bytes = count * field_bytes + offset_bytes as u64;
        let start = at.saturating_add(count_bytes as u64);
        self.check_range(&what, start, bytes)?;
        let mut body = vec![0; bytes as usize];
        self.read_at(&what, start, &mut body)?;
        let (fields, next) = body.split_at(body.len() - offset_bytes);
        let fields = fields
            .chunks_exact(field_bytes as usize)
            .map(|f| {
                let mut inline = [0; 8];
                inline[..offset_bytes].copy_from_slice(&f[4 + offset_bytes..]);
                Field {
                    tag: self.unsigned(&f[..2]) as u16,
                    kind: self.unsigned(&f[2..4]) as u16,
                    count: self.unsigned(&f[4..4 + offset_bytes]),
                    inline,
                }
            })
            .collect();
        Ok(Directory {
            number,
            at,
            fields,
            next: self.unsigned(next),
            bytes: bytes + count_bytes as u64,
        })
    }

    /// Bytes of an offset and of a count.
    fn offset_bytes(&self) -> usize {
        if self.is_big { 8 } else { 4 }
    }

    /// A number of up to 8 bytes.
    fn unsigned(&self, bytes: &[u8]) -> u64 {
        let join = |n: u64, byte: &u8| n << 8 | u64::from(*byte);
        match self.endian {
            Endian::Little => bytes.iter().rev().fold(0, join),
            Endian::Big => bytes.iter().fold(0, join),
        }
    }
}

/// Walks the chain of directories, once each.
pub(super) struct Directories<'a> {
    tiff: &'a Tiff,
    next: u64,
    seen: HashSet<u64>,
    bytes: u64,
}

impl Directories<'_> {
    fn step(&mut self) -> Result<Directory, SourceError> {
        let number = self.seen.len();
        let refused = |expected: String, found: &str| {
            let place = format!("the directory of page {number}, byte {}", self.next);
            Err(self.tiff.subject().malformed(place, expected, found))
        };
        if self.seen.contains(&self.next) {
            return refused(
                "a directory that comes once".to_owned(),
                "one that came before: the chain of pages is a ring",
            );
        }
        if number >= MOST_DIRECTORIES {
            return refused(format!("at most {MOST_DIRECTORIES} pages"), "more");
        }
        let directory = self.tiff.directory(number, self.next)?;
        // Directories that lie in each other could make the walk as long as the square of the file's length.
        self.bytes += directory.bytes;
        if self.bytes > self.tiff.len {
            return refused(
                "directories beside each other".to_owned(),
                "directories that overlap",
            );
        }
        self.seen.insert(self.next);
        self.next = directory.next;
        Ok(directory)
    }
}

impl Iterator for Directories<'_> {
    type Item = Result<Directory, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == 0 {
            return None;
        }
        let step = self.step();
        if step.is_err() {
            self.next = 0;
        }
        Some(step)
    }
}

impl Directory {
    /// True when the field is there.
    pub(super) fn contains(&self, tag: Tag) -> bool {
        self.field(tag).is_some()
    }

    /// How many values the field has, 0 without it.
    pub(super) fn count(&self, tag: Tag) -> u64 {
        self.field(tag).map_or(0, |f| f.count)
    }

    /// Bytes of the field's values, 0 without it.
    pub(super) fn value_bytes(&self, tag: Tag) -> u64 {
        self.field(tag)
            .map_or(0, |f| f.count.saturating_mul(value_bytes(f.kind) as u64))
    }

    /// The unsigned numbers of a field, the first `most` of them.
    ///
    /// # Errors
    /// They are of another type, or do not lie in the file.
    pub(super) fn numbers(
        &self,
        tiff: &Tiff,
        tag: Tag,
        most: u64,
    ) -> Result<Option<Vec<u64>>, SourceError> {
        let Some(field) = self.field(tag) else {
            return Ok(None);
        };
        if !matches!(field.kind, 1 | 3 | 4 | 13 | 16 | 18) {
            let found = format!("values of type {}", field.kind);
            return Err(self.malformed(tiff, tag, "unsigned integers", found));
        }
        let bytes = self.values(tiff, tag, field, field.count.min(most))?;
        let numbers = bytes.chunks_exact(value_bytes(field.kind));
        Ok(Some(numbers.map(|n| tiff.unsigned(n)).collect()))
    }

    /// The first unsigned number of a field.
    ///
    /// # Errors
    /// As [`Self::numbers`], or it has none.
    pub(super) fn number(&self, tiff: &Tiff, tag: Tag) -> Result<Option<u64>, SourceError> {
        let Some(numbers) = self.numbers(tiff, tag, 1)? else {
            return Ok(None);
        };
        match numbers.first() {
            Some(&number) => Ok(Some(number)),
            None => Err(self.malformed(tiff, tag, "a number", "none")),
        }
    }

    /// A field of one real number, such as a resolution; `None` too where it is no number (0/0).
    ///
    /// # Errors
    /// It is of another type, or does not lie in the file.
    pub(super) fn real(&self, tiff: &Tiff, tag: Tag) -> Result<Option<f64>, SourceError> {
        let Some(field) = self.field(tag) else {
            return Ok(None);
        };
        if !matches!(field.kind, 5 | 11 | 12) {
            return Ok(self.number(tiff, tag)?.map(|n| n as f64));
        }
        let bytes = self.values(tiff, tag, field, 1)?;
        let value = match (field.kind, bytes.len()) {
            (5, 8..) => tiff.unsigned(&bytes[..4]) as f64 / tiff.unsigned(&bytes[4..8]) as f64,
            (11, 4..) => f64::from(f32::from_bits(tiff.unsigned(&bytes[..4]) as u32)),
            (12, 8..) => f64::from_bits(tiff.unsigned(&bytes[..8])),
            _ => return Err(self.malformed(tiff, tag, "a number", "none")),
        };
        Ok(value.is_finite().then_some(value))
    }

    /// The bytes of a field of at most `most` bytes.
    ///
    /// # Errors
    /// It has more, or they do not lie in the file.
    pub(super) fn bytes(
        &self,
        tiff: &Tiff,
        tag: Tag,
        most: u64,
    ) -> Result<Option<Vec<u8>>, SourceError> {
        let Some(field) = self.field(tag) else {
            return Ok(None);
        };
        if field.count > most {
            let found = format!("{} bytes", field.count);
            return Err(self.malformed(tiff, tag, format!("at most {most} bytes"), found));
        }
        self.values(tiff, tag, field, field.count).map(Some)
    }

    /// An error about a field.
    pub(super) fn malformed(
        &self,
        tiff: &Tiff,
        tag: Tag,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> SourceError {
        tiff.subject().malformed(self.place(tag), expected, found)
    }

    fn field(&self, tag: Tag) -> Option<&Field> {
        self.fields.iter().find(|f| f.tag == tag.0)
    }

    fn place(&self, Tag(tag, name): Tag) -> String {
        format!("page {}, tag {tag} ({name})", self.number)
    }

    /// The bytes of the first `count` values of a field.
    fn values(
        &self,
        tiff: &Tiff,
        tag: Tag,
        field: &Field,
        count: u64,
    ) -> Result<Vec<u8>, SourceError> {
        let width = value_bytes(field.kind) as u64;
        let inline = tiff.offset_bytes() as u64;
        let whole = field.count.checked_mul(width);
        // No more than `whole`, so it cannot overflow where that does not.
        let bytes = count.saturating_mul(width);
        if whole.is_some_and(|whole| whole <= inline) {
            return Ok(field.inline[..bytes as usize].to_vec());
        }
        let what = self.place(tag);
        let at = tiff.unsigned(&field.inline[..inline as usize]);
        tiff.check_range(&what, at, whole.unwrap_or(u64::MAX))?;
        let mut out = vec![0; bytes as usize];
        tiff.read_at(&what, at, &mut out)?;
        Ok(out)
    }
}

/// Bytes of a value; of unknown types 1, as nobody asks for them.
fn value_bytes(kind: u16) -> usize {
    match kind {
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 1,
    }
}
