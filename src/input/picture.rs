//! Series of PNG or JPEG pictures, one slice each, in the order of the files. PNG of 8 or 16 bits, JPEG of 8.
//!
//! Voxel (i, j, k) is column i, row j of picture k; the values are those that are stored, without gamma or profile. Pictures
//! that are stored in colour are taken when every pixel is grey and opaque. Not here: other numbers of bits and animations.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::PathBuf;

use glam::U64Vec3;
use png::{BitDepth, ColorType, Transformations};
use rayon::prelude::*;

use super::options::OpenOptions;
use super::problem::Subject;
use super::stack::{Slices, Stack};
use super::voxel_file::{swap_bytes, voxel_bytes};
use super::{jpeg, spacing, stamp};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelSource, VoxelType};

const SUPPORTED: &str =
    "supported are PNG pictures of 8 or 16 bits and JPEG pictures of 8, in grey";

/// Bytes that a JPEG file has at most for a voxel, and beside its voxels: previews and the like.
const MOST_JPEG_BYTES: (u64, u64) = (8, 64 << 20);

/// Memory of the PNG decoder beside a few rows.
const PNG_BYTES: u64 = 512 << 10;

/// True when `bytes`, the first ones of a file, are PNG's.
pub(super) fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89PNG\r\n\x1a\n")
}

/// True when `bytes`, the first ones of a file, are JPEG's.
pub(super) fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8, 0xff])
}

/// Opens pictures as the slices of a volume in their order. `subject` is what the user named them by.
///
/// # Errors
/// A picture can't be read, is damaged, in colour, or not like the others.
pub(super) fn open(
    files: &[PathBuf],
    subject: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let Some(first) = files.first() else {
        return Err(subject.malformed("the path", "PNG or JPEG files", "none"));
    };
    let (format, _) = Format::read(&Subject::new(first))?;
    let pictures: Vec<Result<u64, SourceError>> = files
        .par_iter()
        .map(|file| {
            let subject = Subject::new(file);
            let (found, _) = Format::read(&subject)?;
            format.check(&subject, &found)?;
            Ok(found.working_bytes)
        })
        .collect();
    let mut working_bytes = 0;
    for bytes in pictures {
        working_bytes = working_bytes.max(bytes?);
    }
    let mut notes = Vec::new();
    if format.is_colour {
        notes.push(
            "The pictures are stored in colour; they are read as long as every pixel is grey."
                .to_owned(),
        );
    }
    let dims = U64Vec3::new(format.width, format.height, files.len() as u64);
    let desc = VolumeDesc {
        dims,
        voxel_type: format.voxel_type,
        world_from_index: spacing::world(subject, [None; 3], dims, options, &mut notes)?,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    let bytes = voxel_bytes(subject, &desc)?;
    let pictures = Pictures {
        files: files.to_vec(),
        format,
        working_bytes,
    };
    if pictures.format.is_colour {
        // So that true colour is refused now and not after half of the volume.
        pictures.read(0, &mut vec![0; (bytes / dims.z) as usize])?;
    }
    Ok(Box::new(
        Stack::new(desc, Box::new(pictures)).with_notes(notes),
    ))
}

/// Size and type of a picture.
struct Format {
    width: u64,
    height: u64,
    voxel_type: VoxelType,
    /// It is stored in colour, or with opacity.
    is_colour: bool,
    /// Bytes that decoding takes beside the voxels.
    working_bytes: u64,
}

/// A picture whose header has been read.
enum Picture {
    Png(Box<png::Reader<BufReader<File>>>),
    Jpeg(jpeg::Header),
}

impl Format {
    /// Reads the header of a picture.
    fn read(subject: &Subject<'_>) -> Result<(Self, Picture), SourceError> {
        let (mut file, len) = subject.open()?;
        let mut first = [0; 8];
        file.read_exact(&mut first)
            .and_then(|()| file.rewind())
            .map_err(|e| subject.io("read its first bytes", e))?;
        if is_png(&first) {
            let reader = png_reader(subject, file, len)?;
            let format = Self::of_png(subject, &reader, len)?;
            return Ok((format, Picture::Png(Box::new(reader))));
        }
        if is_jpeg(&first) {
            let header =
                jpeg::Header::read(BufReader::new(file)).map_err(|e| not_jpeg(subject, e))?;
            let format = Self::of_jpeg(subject, header, len)?;
            return Ok((format, Picture::Jpeg(header)));
        }
        Err(subject.malformed(
            "the first bytes",
            "those of PNG or JPEG",
            format!("{first:02x?}"),
        ))
    }

    fn of_png(
        subject: &Subject<'_>,
        reader: &png::Reader<BufReader<File>>,
        len: u64,
    ) -> Result<Self, SourceError> {
        let info = reader.info();
        if info.animation_control.is_some() {
            return Err(subject.unsupported("an animated PNG picture", SUPPORTED));
        }
        let (colour, depth) = reader.output_color_type();
        let voxel_type = match depth {
            BitDepth::Eight => VoxelType::U8,
            BitDepth::Sixteen => VoxelType::U16,
            bits => {
                let what = format!("a PNG picture of {} bits", bits as u8);
                return Err(subject.unsupported(what, SUPPORTED));
            }
        };
        let mut format = Self {
            width: info.width.into(),
            height: info.height.into(),
            voxel_type,
            is_colour: colour != ColorType::Grayscale,
            working_bytes: 0,
        };
        let decoded = reader.output_buffer_size().unwrap_or(usize::MAX) as u64;
        // One byte of deflate stands for 1032 at most, and a bit of a palette for a byte or four.
        let most = len.saturating_mul(1032 * 32);
        if decoded > most {
            return Err(subject.malformed(
                "the header",
                format!("a picture that {len} bytes can hold"),
                format!("{} × {} pixels", format.width, format.height),
            ));
        }
        let rows = reader.output_line_size(info.width).unwrap_or(0) as u64;
        format.working_bytes = PNG_BYTES
            .saturating_add(rows.saturating_mul(4))
            .saturating_add(if format.is_colour { decoded } else { 0 });
        Ok(format)
    }

    fn of_jpeg(subject: &Subject<'_>, header: jpeg::Header, len: u64) -> Result<Self, SourceError> {
        let (width, height) = (header.width as u64, header.height as u64);
        let (per_voxel, beside) = MOST_JPEG_BYTES;
        // A block of 64 voxels takes a bit at least.
        if len > width * height * per_voxel + beside || width * height > len.saturating_mul(512) {
            return Err(subject.malformed(
                "the header",
                format!("a picture for {len} bytes"),
                format!("{width} × {height} pixels"),
            ));
        }
        let decoded = header.decoded_bytes() as u64;
        Ok(Self {
            width,
            height,
            voxel_type: VoxelType::U8,
            is_colour: header.is_colour,
            // The file, coefficients of two bytes, and colours.
            working_bytes: len + 2 * decoded + if header.is_colour { decoded } else { 0 },
        })
    }

    /// Refuses a picture that is `other` than the first one.
    fn check(&self, subject: &Subject<'_>, other: &Self) -> Result<(), SourceError> {
        let same = (self.width, self.height, self.voxel_type)
            == (other.width, other.height, other.voxel_type);
        if same {
            return Ok(());
        }
        let name = |f: &Self| format!("{} × {} voxels of {}", f.width, f.height, f.voxel_type);
        Err(subject.malformed(
            "the picture",
            format!("{}, as the first one has", name(self)),
            name(other),
        ))
    }
}

struct Pictures {
    files: Vec<PathBuf>,
    format: Format,
    working_bytes: u64,
}

impl Slices for Pictures {
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let subject = Subject::new(&self.files[z as usize]);
        let (found, picture) = Format::read(&subject)?;
        self.format.check(&subject, &found)?;
        let mut coloured = Vec::new();
        let channels = match picture {
            Picture::Png(mut reader) => {
                let channels = reader.output_color_type().0.samples();
                let decoded = room(&mut coloured, out, channels);
                reader
                    .next_frame(decoded)
                    .map_err(|e| not_png(&subject, &e))?;
                swap_bytes(decoded, self.format.voxel_type.size());
                channels
            }
            Picture::Jpeg(header) => {
                let channels = if header.is_colour { 3 } else { 1 };
                let bytes = std::fs::read(subject.path).map_err(|e| subject.io("read", e))?;
                header
                    .decode(&bytes, room(&mut coloured, out, channels))
                    .map_err(|e| not_jpeg(&subject, e))?;
                channels
            }
        };
        if channels > 1 {
            self.take_grey(&subject, &coloured, channels, out)?;
        }
        Ok(())
    }

    fn working_bytes(&self) -> u64 {
        self.working_bytes
    }

    fn stamp(&self) -> String {
        stamp::of_files(&self.files)
    }
}

impl Pictures {
    /// The grey values of pixels in colour (3 channels) or with opacity (2, 4), if that is what they are.
    fn take_grey(
        &self,
        subject: &Subject<'_>,
        pixels: &[u8],
        channels: usize,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let size = self.format.voxel_type.size();
        let colours = if channels > 2 { 3 } else { 1 };
        let pixels = pixels.chunks_exact(size * channels);
        for (n, (pixel, out)) in pixels.zip(out.chunks_exact_mut(size)).enumerate() {
            let (colour, opacity) = pixel.split_at(size * colours);
            let is_grey = colour.chunks_exact(size).all(|c| c == &colour[..size]);
            if !is_grey || opacity.iter().any(|&byte| byte != 0xff) {
                let (x, y) = (n as u64 % self.format.width, n as u64 / self.format.width);
                let what = if is_grey { "transparency" } else { "colour" };
                return Err(subject.unsupported(format!("{what} (pixel {x}, {y})"), SUPPORTED));
            }
            out.copy_from_slice(&colour[..size]);
        }
        Ok(())
    }
}

/// Where a picture of `channels` is decoded to: to `out` itself when it is grey, else to `coloured`.
fn room<'a>(coloured: &'a mut Vec<u8>, out: &'a mut [u8], channels: usize) -> &'a mut [u8] {
    if channels == 1 {
        return out;
    }
    coloured.resize(out.len() * channels, 0);
    coloured
}

/// A decoder whose header has been read. Palettes become colours.
fn png_reader(
    subject: &Subject<'_>,
    file: File,
    len: u64,
) -> Result<png::Reader<BufReader<File>>, SourceError> {
    let limits = png::Limits {
        // What is not voxels is no longer than the file but for compressed text, which is not kept.
        bytes: usize::try_from(len.saturating_mul(2))
            .unwrap_or(usize::MAX)
            .max(PNG_BYTES as usize),
    };
    let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let is_palette = {
        let info = decoder
            .read_header_info()
            .map_err(|e| not_png(subject, &e))?;
        info.color_type == ColorType::Indexed
    };
    decoder.set_transformations(if is_palette {
        Transformations::EXPAND
    } else {
        Transformations::IDENTITY
    });
    decoder.read_info().map_err(|e| not_png(subject, &e))
}

fn not_png(subject: &Subject<'_>, error: &png::DecodingError) -> SourceError {
    subject.malformed("the picture", "a sound PNG picture", error.to_string())
}

fn not_jpeg(subject: &Subject<'_>, error: String) -> SourceError {
    subject.malformed("the picture", "a sound JPEG picture in grey", error)
}

#[cfg(test)]
mod tests;
