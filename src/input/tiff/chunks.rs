//! From the strips and tiles of a page to its voxels, little-endian.
//!
//! Uncompressed strips are read to where they belong. Of the others each is handed to the crate `tiff` as a file of its own
//! with one strip: so its directory is one that was checked, no byte of another strip is within reach, and 0 stays 0 where
//! the page says that 0 is white. JPEG has no predictor and is decoded as any picture.

use std::io::Cursor;

use tiff::decoder::{Decoder, Limits};

use super::directory::Tiff;
use super::page::{Coding, Page};
use crate::input::jpeg;
use crate::input::raw::Endian;
use crate::input::voxel_file::swap_bytes;
use crate::volume::{SourceError, VoxelType};

/// How much of a strip or tile is read beyond twice the bytes that it decodes to, which no encoder exceeds.
const SLACK_BYTES: u64 = 64 << 10;

/// Room for the directory that is made for a strip or tile, and for the tables of a decompressor.
const TABLE_BYTES: u64 = 256 << 10;

/// The largest window that the zstd decoder takes.
const ZSTD_WINDOW_BYTES: u64 = 128 << 20;

impl Page {
    /// Fills `out` with the voxels of the page.
    ///
    /// # Errors
    /// They can't be read, or a strip or tile is damaged.
    pub(super) fn read(&self, tiff: &Tiff, out: &mut [u8]) -> Result<(), SourceError> {
        match (self.coding, self.is_tiled) {
            (Coding::None, false) => self.read_strips(tiff, out),
            (_, false) => {
                let mut rest = out;
                for n in 0..self.offsets.len() {
                    let (strip, tail) = rest.split_at_mut(self.chunk_bytes(n) as usize);
                    self.decode(tiff, n, strip)?;
                    rest = tail;
                }
                Ok(())
            }
            (_, true) => self.read_tiles(tiff, out),
        }
    }

    /// Most bytes that reading takes beside the voxels of the page.
    pub(super) fn working_bytes(&self) -> u64 {
        let arrays = (self.offsets.len() as u64) * 16;
        let largest = (0..self.offsets.len())
            .map(|n| {
                let decoded = self.chunk_bytes(n);
                let tile = if self.is_tiled { decoded } else { 0 };
                tile + match self.coding {
                    Coding::None => 0,
                    // The coefficients, in two bytes each, and the whole tile where only a part is in the page.
                    Coding::Jpeg => self.stored_bytes(n) + self.whole_bytes().saturating_mul(3),
                    Coding::Zstd => self.stored_bytes(n) + decoded.min(ZSTD_WINDOW_BYTES),
                    _ => self.stored_bytes(n),
                }
            })
            .max();
        arrays + largest.unwrap_or(0) + TABLE_BYTES
    }

    /// Reads uncompressed strips, those that lie one after another at once.
    fn read_strips(&self, tiff: &Tiff, out: &mut [u8]) -> Result<(), SourceError> {
        let mut rest = out;
        let mut n = 0;
        while n < self.offsets.len() {
            let at = self.offsets[n];
            let what = format!("page {}, strip {n}", self.number);
            let mut bytes = 0;
            while self.offsets.get(n) == Some(&(at + bytes)) {
                bytes += self.chunk_bytes(n);
                n += 1;
            }
            let (run, tail) = rest.split_at_mut(bytes as usize);
            tiff.read_at(&what, at, run)?;
            rest = tail;
            self.to_little_endian(tiff, run);
        }
        Ok(())
    }

    fn read_tiles(&self, tiff: &Tiff, out: &mut [u8]) -> Result<(), SourceError> {
        let size = self.format.voxel_type.size();
        let row_bytes = self.format.row_bytes();
        let tile_row_bytes = self.chunk[0] as usize * size;
        let across = self.chunks()[0];
        let mut tile = Vec::new();
        for n in 0..self.offsets.len() {
            tile.resize(self.chunk_bytes(n) as usize, 0);
            if self.coding == Coding::None {
                let what = format!("page {}, tile {n}", self.number);
                tiff.read_at(&what, self.offsets[n], &mut tile)?;
                self.to_little_endian(tiff, &mut tile);
            } else {
                self.decode(tiff, n, &mut tile)?;
            }
            let x = (n as u64 % across) as usize * tile_row_bytes;
            let y = (n as u64 / across * self.chunk[1]) as usize;
            let len = tile_row_bytes.min(row_bytes - x);
            let rows = out.chunks_exact_mut(row_bytes).skip(y);
            for (row, tile_row) in rows.zip(tile.chunks_exact(tile_row_bytes)) {
                row[x..x + len].copy_from_slice(&tile_row[..len]);
            }
        }
        Ok(())
    }

    fn to_little_endian(&self, tiff: &Tiff, voxels: &mut [u8]) {
        if tiff.endian() == Endian::Big {
            swap_bytes(voxels, self.format.voxel_type.size());
        }
    }

    /// Bytes of a strip or tile, what hangs over included.
    fn whole_bytes(&self) -> u64 {
        // Checked when the page was parsed.
        self.chunk[0] * self.chunk[1] * self.format.voxel_type.size() as u64
    }

    /// Bytes of strip or tile `n` that are read. Its own word for it is not believed beyond what makes sense.
    fn stored_bytes(&self, n: usize) -> u64 {
        let tables = self.jpeg_tables.as_ref().map_or(0, Vec::len) as u64;
        let most = self
            .whole_bytes()
            .saturating_mul(2)
            .saturating_add(SLACK_BYTES);
        tables + self.byte_counts[n].min(most)
    }

    /// Decompresses strip or tile `n` into `out`: its rows that lie in the page, in full width.
    fn decode(&self, tiff: &Tiff, n: usize, out: &mut [u8]) -> Result<(), SourceError> {
        let kind = if self.is_tiled { "tile" } else { "strip" };
        let what = format!("page {}, {kind} {n}", self.number);
        let wanted = out.len();
        let malformed = |found: String| {
            let expected = format!("{wanted} bytes, compressed by {:?}", self.coding);
            tiff.subject().malformed(what.as_str(), expected, found)
        };
        let head = match self.coding {
            // The tables are a picture of their own without voxels, which goes on with the strip after its first marker.
            Coding::Jpeg => match self.jpeg_tables.as_deref() {
                Some([tables @ .., 0xff, 0xd9]) => tables.to_vec(),
                Some(_) => return Err(malformed("tables without an end".to_owned())),
                None => Vec::new(),
            },
            _ => self.small_file(tiff, n),
        };
        let skip = if self.coding == Coding::Jpeg && !head.is_empty() {
            2
        } else {
            0
        };
        let stored = self.byte_counts[n].min(self.stored_bytes(n));
        let at = self.offsets[n] + skip;
        let mut bytes = head;
        let start = bytes.len();
        bytes.resize(start + stored.saturating_sub(skip) as usize, 0);
        tiff.read_at(&what, at, &mut bytes[start..])?;
        let decoded = match self.coding {
            Coding::Jpeg => self.decode_jpeg(&bytes, out),
            _ => decode_file(&bytes, out),
        };
        decoded.map_err(malformed)
    }

    fn decode_jpeg(&self, bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
        let picture = jpeg::Header::read(Cursor::new(bytes))?;
        let width = self.chunk[0] as usize;
        let rows = out.len() / width;
        let size_fits =
            picture.width == width && (rows..=self.chunk[1] as usize).contains(&picture.height);
        if picture.is_colour || !size_fits {
            let colour = if picture.is_colour { "colour" } else { "grey" };
            return Err(format!(
                "a picture of {} × {} voxels in {colour}",
                picture.width, picture.height
            ));
        }
        if picture.height == rows {
            return picture.decode(bytes, out);
        }
        let mut whole = vec![0; picture.decoded_bytes()];
        picture.decode(bytes, &mut whole)?;
        out.copy_from_slice(&whole[..out.len()]);
        Ok(())
    }

    /// The begin of a BigTIFF file whose one strip is strip or tile `n`; the compressed bytes come next.
    fn small_file(&self, tiff: &Tiff, n: usize) -> Vec<u8> {
        const HEADER_BYTES: u64 = 16;
        let (sample_format, bits) = match self.format.voxel_type {
            VoxelType::U8 => (1, 8),
            VoxelType::U16 => (1, 16),
            VoxelType::U32 => (1, 32),
            VoxelType::I8 => (2, 8),
            VoxelType::I16 => (2, 16),
            VoxelType::I32 => (2, 32),
            VoxelType::F32 => (3, 32),
            VoxelType::F64 => (3, 64),
        };
        let compression = match self.coding {
            Coding::None | Coding::Jpeg => 1,
            Coding::Lzw => 5,
            Coding::Deflate => 8,
            Coding::PackBits => 32773,
            Coding::Zstd => 50000,
        };
        let rows = self.chunk_rows(n);
        let mut fields = [
            (256, self.chunk[0]),
            (257, rows),
            (258, bits),
            (259, compression),
            // Black is zero, whatever the page says.
            (262, 1),
            (273, 0),
            (277, 1),
            (278, rows),
            (279, self.byte_counts[n].min(self.stored_bytes(n))),
            (317, u64::from(self.predictor)),
            (339, sample_format),
        ];
        let directory_bytes = 8 + 20 * fields.len() as u64 + 8;
        fields[5].1 = HEADER_BYTES + directory_bytes;
        let endian = tiff.endian();
        let mut bytes = Vec::new();
        let mut put = |value: u64, width: usize| match endian {
            Endian::Little => bytes.extend(&value.to_le_bytes()[..width]),
            Endian::Big => bytes.extend(&value.to_be_bytes()[8 - width..]),
        };
        let mark = match endian {
            Endian::Little => u64::from(u16::from_le_bytes(*b"II")),
            Endian::Big => u64::from(u16::from_be_bytes(*b"MM")),
        };
        for (value, width) in [(mark, 2), (43, 2), (8, 2), (0, 2), (HEADER_BYTES, 8)] {
            put(value, width);
        }
        put(fields.len() as u64, 8);
        for (tag, value) in fields {
            put(tag, 2);
            // A number of 8 bytes.
            put(16, 2);
            put(1, 8);
            put(value, 8);
        }
        put(0, 8);
        bytes
    }
}

/// Decodes the one strip of a file that [`Page::small_file`] began.
fn decode_file(bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = out.len();
    limits.intermediate_buffer_size = bytes.len();
    decoder = decoder.with_limits(limits);
    decoder.read_image_bytes(out).map_err(|e| e.to_string())?;
    if cfg!(target_endian = "big") {
        let size = usize::from(decoder.colortype().map_err(|e| e.to_string())?.bit_depth()) / 8;
        swap_bytes(out, size);
    }
    Ok(())
}
