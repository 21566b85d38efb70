//! Pictures and depths as OpenEXR: 32-bit floats, written as they are.

use std::io::BufWriter;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};

use super::writer::ExportError;
use crate::outfile::{Existing, OutFile};

/// Writes channels of `width` × `height` values each, row 0 at the top.
///
/// # Errors
/// A channel has another number of values, or the file can't be written.
pub fn write_exr(
    path: &Path,
    [width, height]: [u32; 2],
    channels: Vec<(&str, Vec<f32>)>,
    existing: Existing,
) -> Result<(), ExportError> {
    let expected = u64::from(width) * u64::from(height);
    if let Some((_, values)) = channels.iter().find(|(_, v)| v.len() as u64 != expected) {
        return Err(ExportError::Length {
            path: path.to_owned(),
            expected: expected * 4,
            found: values.len() as u64 * 4,
        });
    }
    let channels = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)))
        .collect();
    let layer = Layer::new(
        (width as usize, height as usize),
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut out = OutFile::create(path, existing)?;
    Image::from_layer(layer)
        .write()
        .to_buffered(BufWriter::new(out.file()))
        .map_err(|error| ExportError::Write {
            path: path.to_owned(),
            error: match error {
                exr::error::Error::Io(error) => error,
                other => std::io::Error::other(other.to_string()),
            },
        })?;
    Ok(out.commit()?)
}

#[cfg(test)]
mod tests {
    use exr::prelude::read_first_flat_layer_from_file;

    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("z.exr");
        let z = vec![1.5, f32::INFINITY, -0.25, 1e-30, 7.0, 9.0];
        let a: Vec<f32> = (0..6).map(|n| n as f32).collect();
        write_exr(
            &path,
            [3, 2],
            vec![("Z", z.clone()), ("A", a.clone())],
            Existing::Refuse,
        )
        .unwrap();
        let image = read_first_flat_layer_from_file(&path).unwrap();
        assert_eq!(image.layer_data.size.0, 3);
        let channels = &image.layer_data.channel_data.list;
        let of = |name: &str| {
            let channel = channels.iter().find(|c| c.name == *name).unwrap();
            channel.sample_data.values_as_f32().collect::<Vec<f32>>()
        };
        assert_eq!((of("Z"), of("A")), (z, a));
        let short = write_exr(&path, [3, 3], vec![("Z", vec![0.0; 6])], Existing::Replace);
        assert!(
            matches!(short, Err(ExportError::Length { .. })),
            "{short:?}"
        );
    }
}
