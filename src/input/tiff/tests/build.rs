//! Makes TIFF files: any byte order, classic or big, any fields, compressed strips or tiles.

use std::io::Write;

use crate::input::raw::Endian;

/// How a strip or tile is compressed: the number that TIFF has for it.
pub(super) const CODINGS: [u16; 4] = [1, 8, 50000, 32773];

/// A page of unsigned or other voxels.
#[derive(Clone)]
pub(super) struct Page {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) bits: u64,
    pub(super) sample_format: u64,
    pub(super) compression: u16,
    pub(super) predictor: u64,
    /// Width and height of tiles.
    pub(super) tile: Option<(usize, usize)>,
    pub(super) rows_per_strip: usize,
    /// Further fields: tag, type, values (one each; of a rational two), or the bytes of a text.
    pub(super) fields: Vec<(u16, u16, Vec<u64>)>,
    /// The voxels as numbers.
    pub(super) voxels: Vec<u64>,
}

impl Page {
    /// A page of 16 bits whose voxels are told from those of others by `seed`.
    pub(super) fn new(width: usize, height: usize, seed: u64) -> Self {
        Self {
            width,
            height,
            bits: 16,
            sample_format: 1,
            compression: 1,
            predictor: 1,
            tile: None,
            rows_per_strip: height,
            fields: Vec::new(),
            voxels: (0..(width * height) as u64)
                .map(|n| seed * 1000 + n * n % 251 + n / 7)
                .collect(),
        }
    }

    pub(super) fn with(mut self, tag: u16, kind: u16, values: &[u64]) -> Self {
        self.fields.push((tag, kind, values.to_vec()));
        self
    }

    pub(super) fn with_text(self, text: &str) -> Self {
        let bytes: Vec<u64> = text.bytes().chain([0]).map(u64::from).collect();
        self.with(270, 2, &bytes)
    }

    /// The voxels as they should be read.
    pub(super) fn expected(&self) -> Vec<u8> {
        let size = self.bits as usize / 8;
        let bytes = self.voxels.iter().map(|v| v.to_le_bytes());
        bytes.flat_map(|v| v.into_iter().take(size)).collect()
    }

    /// The compressed strips or tiles.
    fn chunks(&self, endian: Endian) -> Vec<Vec<u8>> {
        let (chunk_width, chunk_height) = self.tile.unwrap_or((self.width, self.rows_per_strip));
        let mut chunks = Vec::new();
        for y in (0..self.height).step_by(chunk_height) {
            for x in (0..self.width).step_by(chunk_width) {
                let rows = match self.tile {
                    Some(_) => chunk_height,
                    None => chunk_height.min(self.height - y),
                };
                let mut bytes = Vec::new();
                for j in y..y + rows {
                    let row: Vec<u64> = (x..x + chunk_width)
                        .map(|i| match i < self.width && j < self.height {
                            true => self.voxels[j * self.width + i],
                            false => 99,
                        })
                        .collect();
                    bytes.extend(self.row(&row, endian));
                }
                chunks.push(pack(&bytes, self.compression));
            }
        }
        chunks
    }

    fn row(&self, row: &[u64], endian: Endian) -> Vec<u8> {
        let size = self.bits as usize / 8;
        if self.predictor == 3 {
            // The most significant bytes of all voxels first, then differences of bytes.
            let planes = (0..size).rev();
            let bytes: Vec<u8> = planes
                .flat_map(|byte| row.iter().map(move |v| v.to_le_bytes()[byte]))
                .collect();
            let before = std::iter::once(0).chain(bytes.iter().copied());
            return bytes
                .iter()
                .zip(before)
                .map(|(b, a)| b.wrapping_sub(a))
                .collect();
        }
        let mut before = 0;
        let mut out = Vec::new();
        for &v in row {
            let stored = match self.predictor {
                2 => v.wrapping_sub(before),
                _ => v,
            };
            before = v;
            put(&mut out, endian, stored, size);
        }
        out
    }
}

/// A file of these pages.
pub(super) fn file(pages: &[Page], endian: Endian, is_big: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let (offset, count_bytes) = if is_big { (8, 8) } else { (4, 2) };
    out.extend(match endian {
        Endian::Little => b"II",
        Endian::Big => b"MM",
    });
    put(&mut out, endian, if is_big { 43 } else { 42 }, 2);
    if is_big {
        put(&mut out, endian, 8, 2);
        put(&mut out, endian, 0, 2);
    }
    let mut link = out.len();
    put(&mut out, endian, 0, offset);
    for page in pages {
        let chunks = page.chunks(endian);
        let mut offsets = Vec::new();
        for chunk in &chunks {
            offsets.push(out.len() as u64);
            out.extend(chunk);
        }
        let sizes: Vec<u64> = chunks.iter().map(|c| c.len() as u64).collect();
        let wide = if is_big { 16 } else { 4 };
        let mut fields = vec![
            (256, 3, vec![page.width as u64]),
            (257, 4, vec![page.height as u64]),
            (258, 3, vec![page.bits]),
            (259, 3, vec![u64::from(page.compression)]),
            (262, 3, vec![1]),
            (317, 3, vec![page.predictor]),
            (339, 3, vec![page.sample_format]),
        ];
        match page.tile {
            Some((width, height)) => fields.extend([
                (322, 4, vec![width as u64]),
                (323, 4, vec![height as u64]),
                (324, wide, offsets),
                (325, wide, sizes),
            ]),
            None => fields.extend([
                (273, wide, offsets),
                (278, 4, vec![page.rows_per_strip as u64]),
                (279, wide, sizes),
            ]),
        }
        for field in &page.fields {
            fields.retain(|(tag, ..)| *tag != field.0);
            fields.push(field.clone());
        }
        fields.sort_by_key(|(tag, ..)| *tag);
        let mut heads = Vec::new();
        for (tag, kind, values) in &fields {
            let (width, per_value) = match kind {
                3 => (2, 1),
                4 => (4, 1),
                5 => (4, 2),
                16 => (8, 1),
                _ => (1, 1),
            };
            let mut bytes = Vec::new();
            for value in values {
                put(&mut bytes, endian, *value, width);
            }
            put(&mut heads, endian, u64::from(*tag), 2);
            put(&mut heads, endian, u64::from(*kind), 2);
            put(
                &mut heads,
                endian,
                (values.len() / per_value) as u64,
                offset,
            );
            if bytes.len() > offset {
                put(&mut heads, endian, out.len() as u64, offset);
                out.extend(bytes);
            } else {
                bytes.resize(offset, 0);
                heads.extend(bytes);
            }
        }
        let at = out.len() as u64;
        let mut bytes = Vec::new();
        put(&mut bytes, endian, at, offset);
        out[link..link + offset].copy_from_slice(&bytes);
        put(&mut out, endian, fields.len() as u64, count_bytes);
        out.extend(heads);
        link = out.len();
        put(&mut out, endian, 0, offset);
    }
    out
}

/// A little-endian classic file.
pub(super) fn plain(pages: &[Page]) -> Vec<u8> {
    file(pages, Endian::Little, false)
}

fn put(out: &mut Vec<u8>, endian: Endian, value: u64, width: usize) {
    match endian {
        Endian::Little => out.extend(&value.to_le_bytes()[..width]),
        Endian::Big => out.extend(&value.to_be_bytes()[8 - width..]),
    }
}

fn pack(bytes: &[u8], compression: u16) -> Vec<u8> {
    match compression {
        8 | 32946 => {
            let level = flate2::Compression::fast();
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        }
        50000 => zstd::encode_all(bytes, 3).unwrap(),
        32773 => bytes
            .chunks(2)
            .flat_map(|pair| match pair {
                [a, b] if a == b => vec![0xff, *a],
                pair => [&[pair.len() as u8 - 1], pair].concat(),
            })
            .collect(),
        _ => bytes.to_vec(),
    }
}
