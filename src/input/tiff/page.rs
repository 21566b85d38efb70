//! A page: size and type of its voxels, and where its strips or tiles lie. Everything is checked here, by name, before a
//! byte of a voxel is read.

use super::SUPPORTED;
use super::directory::{Directory, Tag, Tiff};
use crate::volume::{SourceError, VoxelType};

const SUBFILE: Tag = Tag(254, "NewSubfileType");
const OLD_SUBFILE: Tag = Tag(255, "SubfileType");
const WIDTH: Tag = Tag(256, "ImageWidth");
const HEIGHT: Tag = Tag(257, "ImageLength");
const BITS: Tag = Tag(258, "BitsPerSample");
const COMPRESSION: Tag = Tag(259, "Compression");
const PHOTOMETRIC: Tag = Tag(262, "PhotometricInterpretation");
const FILL_ORDER: Tag = Tag(266, "FillOrder");
const STRIP_OFFSETS: Tag = Tag(273, "StripOffsets");
const ORIENTATION: Tag = Tag(274, "Orientation");
const SAMPLES: Tag = Tag(277, "SamplesPerPixel");
const ROWS_PER_STRIP: Tag = Tag(278, "RowsPerStrip");
const STRIP_BYTES: Tag = Tag(279, "StripByteCounts");
const PREDICTOR: Tag = Tag(317, "Predictor");
const TILE_WIDTH: Tag = Tag(322, "TileWidth");
const TILE_HEIGHT: Tag = Tag(323, "TileLength");
const TILE_OFFSETS: Tag = Tag(324, "TileOffsets");
const TILE_BYTES: Tag = Tag(325, "TileByteCounts");
const SUB_DIRECTORIES: Tag = Tag(330, "SubIFDs");
const SAMPLE_FORMAT: Tag = Tag(339, "SampleFormat");
const JPEG_TABLES: Tag = Tag(347, "JPEGTables");
const METAMORPH_PLANES: Tag = Tag(33629, "UIC2Tag");

/// Bytes that the tables of JPEG strips and tiles have at most.
const MOST_TABLE_BYTES: u64 = 64 << 10;

/// What all pages of a volume have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) width: u64,
    pub(super) height: u64,
    pub(super) voxel_type: VoxelType,
}

/// How strips and tiles are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
    Jpeg,
}

/// A page, checked.
pub(super) struct Page {
    pub(super) number: usize,
    /// Byte of the file where its directory begins.
    pub(super) at: u64,
    pub(super) format: Format,
    pub(super) coding: Coding,
    /// As in the file: 1 none, 2 differences, 3 those of the bytes of floats.
    pub(super) predictor: u16,
    /// Voxels of a strip or tile along x and y; those at the right and lower edge hang over, strips do not.
    pub(super) chunk: [u64; 2],
    pub(super) is_tiled: bool,
    /// Byte of the file where each strip or tile begins.
    pub(super) offsets: Vec<u64>,
    /// Bytes of each.
    pub(super) byte_counts: Vec<u64>,
    pub(super) jpeg_tables: Option<Vec<u8>>,
    /// 0 is white.
    pub(super) is_inverted: bool,
    /// 1 where the first row is the top and the first column the left.
    pub(super) orientation: u64,
    /// It has reduced copies of itself.
    pub(super) has_pyramid: bool,
}

impl Format {
    /// Bytes of a row.
    pub(super) fn row_bytes(&self) -> usize {
        self.width as usize * self.voxel_type.size()
    }

    /// Its wording in messages.
    pub(super) fn name(&self) -> String {
        let Self {
            width,
            height,
            voxel_type,
        } = self;
        format!("{width} × {height} voxels of {voxel_type}")
    }
}

impl Coding {
    /// The most bytes that one byte of compressed data can stand for: what a lying header is measured by.
    const fn most_per_byte(self) -> u64 {
        match self {
            Self::None => 1,
            // A code has 9 bits at least, its string is no longer than the table of 4096.
            Self::Lzw => 4096,
            // A match of 258 bytes takes 2 bits.
            Self::Deflate => 1032,
            // Two bytes for 128.
            Self::PackBits => 64,
            // A block of 128 KiB takes 4 bytes.
            Self::Zstd => 32 << 10,
            // A block of 64 voxels takes a bit.
            Self::Jpeg => 512,
        }
    }
}

/// True when a directory is a reduced copy of another page or a mask, no page of its own.
///
/// # Errors
/// The fields that say it are damaged.
pub(super) fn is_side_page(tiff: &Tiff, directory: &Directory) -> Result<bool, SourceError> {
    let bits = directory.number(tiff, SUBFILE)?.unwrap_or(0);
    let old = directory.number(tiff, OLD_SUBFILE)?.unwrap_or(1);
    Ok(bits & 0b101 != 0 || old == 2)
}

impl Page {
    /// Understands a directory.
    ///
    /// # Errors
    /// A field is missing or wrong, voxels lie outside the file, or the page is of a kind that is not built.
    pub(super) fn parse(tiff: &Tiff, directory: &Directory) -> Result<Self, SourceError> {
        let d = Reader { tiff, directory };
        let format = Format {
            width: d.size(WIDTH)?,
            height: d.size(HEIGHT)?,
            voxel_type: d.voxel_type()?,
        };
        let is_inverted = d.is_inverted()?;
        let coding = d.coding()?;
        if coding == Coding::Jpeg && format.voxel_type != VoxelType::U8 {
            return Err(d.unsupported(format!("JPEG of {} voxels", format.voxel_type)));
        }
        let predictor = d.predictor(coding, format.voxel_type)?;
        let is_tiled = directory.contains(TILE_OFFSETS);
        let chunk = if is_tiled {
            [d.size(TILE_WIDTH)?, d.size(TILE_HEIGHT)?]
        } else {
            let rows = d.number(ROWS_PER_STRIP, u64::MAX)?;
            if rows == 0 {
                return Err(d.malformed(ROWS_PER_STRIP, "at least 1", "0"));
            }
            [format.width, rows.min(format.height)]
        };
        let mut page = Self {
            number: directory.number,
            at: directory.at,
            format,
            coding,
            predictor,
            chunk,
            is_tiled,
            offsets: Vec::new(),
            byte_counts: Vec::new(),
            jpeg_tables: match coding {
                Coding::Jpeg => directory.bytes(tiff, JPEG_TABLES, MOST_TABLE_BYTES)?,
                _ => None,
            },
            is_inverted,
            orientation: d.number(ORIENTATION, 1)?,
            has_pyramid: directory.contains(SUB_DIRECTORIES),
        };
        d.chunks(&mut page)?;
        Ok(page)
    }

    /// Strips or tiles along x and y.
    pub(super) fn chunks(&self) -> [u64; 2] {
        let Format { width, height, .. } = self.format;
        [
            width.div_ceil(self.chunk[0]),
            height.div_ceil(self.chunk[1]),
        ]
    }

    /// Rows of strip or tile `n` that lie in the page.
    pub(super) fn chunk_rows(&self, n: usize) -> u64 {
        let first = n as u64 / self.chunks()[0] * self.chunk[1];
        self.chunk[1].min(self.format.height - first)
    }

    /// Bytes of the rows of strip or tile `n` that lie in the page, in full width.
    pub(super) fn chunk_bytes(&self, n: usize) -> u64 {
        // No more than the bytes of a chunk, which were checked when the page was read.
        self.chunk_rows(n) * self.chunk[0] * self.format.voxel_type.size() as u64
    }

    /// Where the voxels begin when all of the page lie uncompressed one after another.
    pub(super) fn contiguous_start(&self) -> Option<u64> {
        if self.coding != Coding::None || self.is_tiled {
            return None;
        }
        let start = *self.offsets.first()?;
        let mut end = start;
        for (n, &at) in self.offsets.iter().enumerate() {
            if at != end {
                return None;
            }
            end += self.chunk_bytes(n);
        }
        Some(start)
    }
}

/// Bytes that parsing a directory reads at most: its own and those of its tables, whose size the file chooses.
pub(super) fn parse_bytes(directory: &Directory) -> u64 {
    [STRIP_OFFSETS, STRIP_BYTES, TILE_OFFSETS, TILE_BYTES]
        .into_iter()
        .fold(directory.bytes, |sum, tag| {
            sum.saturating_add(directory.value_bytes(tag))
        })
}

struct Reader<'a> {
    tiff: &'a Tiff,
    directory: &'a Directory,
}

impl Reader<'_> {
    fn malformed(
        &self,
        tag: Tag,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> SourceError {
        self.directory.malformed(self.tiff, tag, expected, found)
    }

    fn unsupported(&self, what: impl std::fmt::Display) -> SourceError {
        let what = format!("{what} on page {}", self.directory.number);
        self.tiff.subject().unsupported(what, SUPPORTED)
    }

    fn number(&self, tag: Tag, default: u64) -> Result<u64, SourceError> {
        Ok(self.directory.number(self.tiff, tag)?.unwrap_or(default))
    }

    /// A number of voxels, of 32 bits as TIFF has it.
    fn size(&self, tag: Tag) -> Result<u64, SourceError> {
        match self.directory.number(self.tiff, tag)? {
            Some(n) if n >= 1 && n <= u64::from(u32::MAX) => Ok(n),
            Some(n) => Err(self.malformed(tag, "from 1 to 2^32 - 1", n.to_string())),
            None => Err(self.malformed(tag, "a number of voxels", "no such tag")),
        }
    }

    fn voxel_type(&self) -> Result<VoxelType, SourceError> {
        let samples = self.number(SAMPLES, 1)?;
        match self.directory.number(self.tiff, PHOTOMETRIC)? {
            Some(0 | 1) | None => {}
            Some(2 | 5 | 6 | 8 | 9 | 10 | 32844 | 32845) => {
                return Err(self.unsupported("colour"));
            }
            Some(3) => return Err(self.unsupported("colour from a palette")),
            Some(4) => return Err(self.unsupported("a transparency mask")),
            Some(n) => return Err(self.unsupported(format!("PhotometricInterpretation {n}"))),
        }
        if samples != 1 {
            return Err(
                self.unsupported(format!("colour or channels, {samples} samples per voxel"))
            );
        }
        if self.number(FILL_ORDER, 1)? != 1 {
            return Err(self.unsupported("the reversed order of bits (FillOrder 2)"));
        }
        let planes = self.directory.count(METAMORPH_PLANES);
        if planes > 1 {
            return Err(self.unsupported(format!("a MetaMorph stack of {planes} planes")));
        }
        let bits = self.number(BITS, 1)?;
        // Undefined data (4) are numbers of which nothing is said.
        let format = self.number(SAMPLE_FORMAT, 1)?;
        Ok(match (format, bits) {
            (1 | 4, 8) => VoxelType::U8,
            (1 | 4, 16) => VoxelType::U16,
            (1 | 4, 32) => VoxelType::U32,
            (2, 8) => VoxelType::I8,
            (2, 16) => VoxelType::I16,
            (2, 32) => VoxelType::I32,
            (3, 32) => VoxelType::F32,
            (3, 64) => VoxelType::F64,
            (1 | 2 | 4, _) => {
                return Err(self.unsupported(format!("{bits}-bit integers")));
            }
            (3, _) => return Err(self.unsupported(format!("{bits}-bit floats"))),
            (5 | 6, _) => return Err(self.unsupported("complex numbers")),
            _ => {
                return Err(self.malformed(SAMPLE_FORMAT, "from 1 to 6", format.to_string()));
            }
        })
    }

    fn is_inverted(&self) -> Result<bool, SourceError> {
        Ok(self.number(PHOTOMETRIC, 1)? == 0)
    }

    fn coding(&self) -> Result<Coding, SourceError> {
        let number = self.number(COMPRESSION, 1)?;
        let name = match number {
            1 => return Ok(Coding::None),
            5 => return Ok(Coding::Lzw),
            7 => return Ok(Coding::Jpeg),
            8 | 32946 => return Ok(Coding::Deflate),
            32773 => return Ok(Coding::PackBits),
            50000 => return Ok(Coding::Zstd),
            2..=4 => "fax compression",
            6 => "old-style JPEG",
            33003 | 33004 | 33005 | 34712 => "JPEG 2000",
            34887 => "LERC",
            34892 => "lossy DNG JPEG",
            34925 => "LZMA",
            50001 | 34927 => "WebP",
            50002 | 52546 => "JPEG XL",
            22610 | 34934 => "JPEG XR",
            _ => "an unknown compression",
        };
        Err(self.unsupported(format!("{name} (compression {number})")))
    }

    fn predictor(&self, coding: Coding, voxel_type: VoxelType) -> Result<u16, SourceError> {
        let number = self.number(PREDICTOR, 1)?;
        let is_float = matches!(voxel_type, VoxelType::F32 | VoxelType::F64);
        match (number, coding) {
            (1, _) => Ok(1),
            (2 | 3, Coding::None | Coding::PackBits | Coding::Jpeg) => {
                let what = format!("predictor {number} with {coding:?} as compression");
                Err(self.unsupported(what))
            }
            (2, _) => Ok(2),
            (3, _) if is_float => Ok(3),
            (3, _) => Err(self.malformed(PREDICTOR, "1 or 2 for integers", "3")),
            _ => Err(self.unsupported(format!("predictor {number}"))),
        }
    }

    /// Fills in where strips or tiles lie, after a check that they can hold the page.
    fn chunks(&self, page: &mut Page) -> Result<(), SourceError> {
        let (offsets, bytes, kind) = if page.is_tiled {
            (TILE_OFFSETS, TILE_BYTES, "tiles")
        } else {
            (STRIP_OFFSETS, STRIP_BYTES, "strips")
        };
        let chunk = page.chunk[0]
            .checked_mul(page.chunk[1])
            .and_then(|n| n.checked_mul(page.format.voxel_type.size() as u64));
        if chunk.is_none() {
            let found = format!("{} × {} voxels", page.chunk[0], page.chunk[1]);
            return Err(self.malformed(offsets, format!("{kind} of less than 2^64 bytes"), found));
        }
        // Below 2^64, as the sizes are below 2^32.
        let [across, down] = page.chunks();
        let count = across * down;
        let there = self.directory.count(offsets);
        if there < count {
            let expected = format!("{count} {kind} of {} × {}", page.chunk[0], page.chunk[1]);
            return Err(self.malformed(offsets, expected, there.to_string()));
        }
        let (d, tiff) = (self.directory, self.tiff);
        page.offsets = d.numbers(tiff, offsets, count)?.unwrap_or_default();
        page.byte_counts = match d.numbers(tiff, bytes, count)? {
            Some(bytes) if bytes.len() as u64 == count => bytes,
            // Without compression the sizes say nothing new, and some writers leave them out.
            None if page.coding == Coding::None => {
                (0..count as usize).map(|n| page.chunk_bytes(n)).collect()
            }
            other => {
                let found = other.map_or("no such tag".to_owned(), |b| b.len().to_string());
                return Err(self.malformed(bytes, format!("the bytes of {count} {kind}"), found));
            }
        };
        for (n, (&at, &stored)) in page.offsets.iter().zip(&page.byte_counts).enumerate() {
            let wanted = page.chunk_bytes(n);
            let least = wanted.div_ceil(page.coding.most_per_byte());
            if stored < least {
                return Err(self.malformed(
                    bytes,
                    format!("at least {least} bytes for number {n} of the {kind}"),
                    stored.to_string(),
                ));
            }
            // Of uncompressed ones only what is needed has to be there.
            let read = match page.coding {
                Coding::None => wanted,
                _ => stored,
            };
            let what = format!("page {}, number {n} of the {kind}", page.number);
            tiff.check_range(&what, at, read)?;
        }
        Ok(())
    }
}
