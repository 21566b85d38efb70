//! Depths as 16-bit PNG: a line from the least to the greatest, told in the file.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::writer::ExportError;
use crate::outfile::{Existing, OutFile};

/// What stands where nothing was met.
const NOTHING: u16 = u16::MAX;

/// Writes `depths_mm` of `width` × `height` pixels, row 0 at the top, as grey values from 0 (the least) to 65534 (the greatest),
/// 65535 where they are infinite. Text entries `depth-low-mm` and `depth-high-mm` hold both ends:
/// depth = low + value · (high − low) / 65534.
///
/// # Errors
/// Another number of values, a size of 0, or the file can't be written.
pub fn write_depth_png(
    path: &Path,
    [width, height]: [u32; 2],
    depths_mm: &[f32],
    existing: Existing,
) -> Result<(), ExportError> {
    let expected = u64::from(width) * u64::from(height);
    if depths_mm.len() as u64 != expected {
        return Err(ExportError::Length {
            path: path.to_owned(),
            expected: expected * 2,
            found: depths_mm.len() as u64 * 2,
        });
    }
    let mut out = OutFile::create(path, existing)?;
    encode(out.file(), [width, height], depths_mm).map_err(|error| ExportError::Write {
        path: path.to_owned(),
        error,
    })?;
    Ok(out.commit()?)
}

fn encode(file: &mut std::fs::File, [width, height]: [u32; 2], depths: &[f32]) -> io::Result<()> {
    let met = || depths.iter().copied().filter(|d| d.is_finite());
    let low = met().fold(f32::INFINITY, f32::min);
    let high = met().fold(f32::NEG_INFINITY, f32::max);
    let [low, high] = if low <= high { [low, high] } else { [0.0; 2] };
    let last = f64::from(NOTHING - 1);
    let scale = if high > low {
        last / (f64::from(high) - f64::from(low))
    } else {
        0.0
    };
    let mut buffered = BufWriter::new(file);
    let mut encoder = png::Encoder::new(&mut buffered, width, height);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_color(png::ColorType::Grayscale);
    for (name, value) in [("depth-low-mm", low), ("depth-high-mm", high)] {
        encoder.add_text_chunk(name.into(), value.to_string())?;
    }
    let mut writer = encoder.write_header()?;
    let bytes: Vec<u8> = depths
        .iter()
        .flat_map(|&d| {
            let value = if d.is_finite() {
                ((f64::from(d) - f64::from(low)) * scale).round() as u16
            } else {
                NOTHING
            };
            value.to_be_bytes()
        })
        .collect();
    writer.write_image_data(&bytes)?;
    writer.finish()?;
    buffered.flush()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::BufReader;

    use super::*;

    #[test]
    fn depths_come_back_by_their_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.png");
        let depths = [12.5, 80.0, f32::INFINITY, 33.25, 12.5, f32::INFINITY];
        write_depth_png(&path, [3, 2], &depths, Existing::Refuse).unwrap();
        let mut reader = png::Decoder::new(BufReader::new(File::open(&path).unwrap()))
            .read_info()
            .unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let text = &reader.info().uncompressed_latin1_text;
        let end = |name: &str| -> f64 {
            let entry = text.iter().find(|t| t.keyword == name).unwrap();
            entry.text.parse().unwrap()
        };
        let (low, high) = (end("depth-low-mm"), end("depth-high-mm"));
        assert_eq!((low, high), (12.5, 80.0));
        let (pairs, _) = bytes.as_chunks::<2>();
        for (pair, depth) in pairs.iter().zip(depths) {
            let value = u16::from_be_bytes(*pair);
            if depth.is_infinite() {
                assert_eq!(value, NOTHING);
            } else {
                let back = low + f64::from(value) * (high - low) / 65534.0;
                assert!((back - f64::from(depth)).abs() < 1e-3, "{back} for {depth}");
            }
        }
        // Nothing at all is a picture, too.
        write_depth_png(&path, [1, 1], &[f32::INFINITY], Existing::Replace).unwrap();
    }
}
