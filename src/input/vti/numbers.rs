//! [`Numbers`]: voxels written as decimal numbers, as a [`VoxelSource`] that is read once, slice after slice.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;

use super::super::problem::{Subject, quoted};
use super::super::voxel_file::file_stamp;
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, SourceError, VolumeDesc, VoxelSource, VoxelType, check_read};

/// Characters at which a word is no number any more.
const MOST_CHARACTERS: usize = 400;

/// A volume in text.
pub(super) struct Numbers {
    desc: VolumeDesc,
    path: PathBuf,
    /// Where the text starts in the file.
    start: u64,
    text: BufReader<io::Take<File>>,
    /// Numbers read so far.
    count: u64,
    word: String,
    next_z: u64,
    notes: Vec<String>,
}

impl Numbers {
    /// The numbers in the bytes `place` of `file`.
    ///
    /// # Errors
    /// The text is too short for the voxels of `desc`, or can't be read.
    pub(super) fn open(
        subject: &Subject<'_>,
        desc: VolumeDesc,
        mut file: File,
        place: Range<u64>,
        notes: Vec<String>,
    ) -> Result<Self, SourceError> {
        let len = place.end.saturating_sub(place.start);
        let voxels = VoxelBox::whole(desc.dims).voxel_count();
        // Each takes a digit, and a space to the next.
        if voxels.is_none_or(|n| n > len / 2 + 1) {
            let d = desc.dims;
            return Err(subject.malformed(
                "the numbers",
                format!("{} × {} × {} of them", d.x, d.y, d.z),
                format!("a text of {len} characters"),
            ));
        }
        file.seek(SeekFrom::Start(place.start))
            .map_err(|e| subject.io("read", e))?;
        Ok(Self {
            desc,
            path: subject.path.to_owned(),
            start: place.start,
            text: BufReader::with_capacity(256 << 10, file.take(len)),
            count: 0,
            word: String::new(),
            next_z: 0,
            notes,
        })
    }

    /// Reads the next number into `word`, which stays empty at the end of the text.
    fn next_word(&mut self) -> Result<(), SourceError> {
        self.word.clear();
        loop {
            let bytes = match self.text.fill_buf() {
                Ok(bytes) => bytes,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(Subject::new(&self.path).io("read the numbers", e)),
            };
            let mut used = 0;
            let mut is_done = bytes.is_empty();
            for &b in bytes {
                if !b.is_ascii_whitespace() && self.word.len() < MOST_CHARACTERS {
                    self.word.push(char::from(b));
                } else if !self.word.is_empty() {
                    is_done = true;
                    break;
                }
                used += 1;
            }
            self.text.consume(used);
            if is_done {
                return Ok(());
            }
        }
    }

    fn malformed(&self, expected: &str) -> SourceError {
        let found = if self.word.is_empty() {
            "the end of the numbers".to_owned()
        } else {
            quoted(&self.word)
        };
        Subject::new(&self.path).malformed(format!("number {}", self.count), expected, found)
    }
}

impl VoxelSource for Numbers {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::ForwardZ
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let dims = self.desc.dims;
        assert!(
            voxels.size().truncate() == dims.truncate() && voxels.min.z == self.next_z,
            "numbers are read in whole slices, each once, in order"
        );
        let voxel_type = self.desc.voxel_type;
        for voxel in out.chunks_exact_mut(voxel_type.size()) {
            self.next_word()?;
            if !write(voxel_type, &self.word, voxel) {
                return Err(self.malformed(&format!("a number of type {voxel_type}")));
            }
            self.count += 1;
        }
        self.next_z = voxels.max.z;
        if self.next_z == dims.z {
            self.next_word()?;
            if !self.word.is_empty() {
                return Err(self.malformed("the end of the numbers"));
            }
        }
        Ok(())
    }

    fn stamp(&self) -> String {
        format!(
            "{}, text from byte {} on",
            file_stamp(&self.path),
            self.start
        )
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}

/// Puts the number `word` into `out`; false when it is none of that type.
fn write(voxel_type: VoxelType, word: &str, out: &mut [u8]) -> bool {
    // What C++ streams print for NaN with a sign, which Rust does not read.
    let word = if word == "-nan" { "nan" } else { word };
    if word.len() >= MOST_CHARACTERS {
        return false;
    }
    macro_rules! put {
        ($t:ty) => {
            word.parse::<$t>()
                .map(|v| out.copy_from_slice(&v.to_le_bytes()))
                .is_ok()
        };
    }
    match voxel_type {
        VoxelType::U8 => put!(u8),
        VoxelType::I8 => put!(i8),
        VoxelType::U16 => put!(u16),
        VoxelType::I16 => put!(i16),
        VoxelType::U32 => put!(u32),
        VoxelType::I32 => put!(i32),
        VoxelType::F32 => put!(f32),
        VoxelType::F64 => put!(f64),
    }
}
