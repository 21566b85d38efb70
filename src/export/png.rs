//! Pictures as PNG: 8 bits per channel, written as they are. No gamma or sRGB chunk: values are display values (cli.md).

use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::writer::ExportError;
use crate::outfile::{Existing, OutFile};

/// Writes a picture of `width` × `height` pixels: `rgba` in rows, row 0 at the top, straight alpha. With `opaque` the
/// alpha is left out and the file is RGB.
///
/// # Errors
/// `rgba` is not `4 · width · height` bytes, a size is 0, or the file can't be written.
pub fn write_png(
    path: &Path,
    width: u32,
    height: u32,
    rgba: &[u8],
    opaque: bool,
    existing: Existing,
) -> Result<(), ExportError> {
    let expected = u64::from(width) * u64::from(height) * 4;
    if rgba.len() as u64 != expected {
        return Err(ExportError::Length {
            path: path.to_owned(),
            expected,
            found: rgba.len() as u64,
        });
    }
    let mut out = OutFile::create(path, existing)?;
    encode(out.file(), (width, height), rgba, opaque).map_err(|error| ExportError::Write {
        path: path.to_owned(),
        error,
    })?;
    Ok(out.commit()?)
}

fn encode(
    file: &mut std::fs::File,
    (width, height): (u32, u32),
    rgba: &[u8],
    opaque: bool,
) -> io::Result<()> {
    let mut buffered = BufWriter::new(file);
    let mut encoder = png::Encoder::new(&mut buffered, width, height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(if opaque {
        png::ColorType::Rgb
    } else {
        png::ColorType::Rgba
    });
    let mut writer = encoder.write_header()?;
    if opaque {
        let (pixels, _) = rgba.as_chunks::<4>();
        let rgb: Vec<u8> = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        writer.write_image_data(&rgb)?;
    } else {
        writer.write_image_data(rgba)?;
    }
    writer.finish()?;
    buffered.flush()
}
