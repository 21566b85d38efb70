//! Pictures made by the encoder of PNG and two JPEG pictures in bytes.

use std::path::Path;

use super::*;
use crate::geom::VoxelBox;
use crate::input::jpeg::tests::{COLOUR_8X8, GREY_8X8};

/// A PNG picture of 8 × 8 pixels.
fn png(colour: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 8, 8);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette([[1, 1, 1], [50, 50, 50], [2, 3, 4]].concat());
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

fn grey(seed: u8) -> Vec<u8> {
    let data: Vec<u8> = (0..64).map(|n| n * 3 + seed).collect();
    png(ColorType::Grayscale, BitDepth::Eight, &data)
}

fn read(files: &[Vec<u8>]) -> Result<(VolumeDesc, Vec<u8>, String), SourceError> {
    let dir = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for (n, bytes) in files.iter().enumerate() {
        let path = dir.path().join(n.to_string());
        std::fs::write(&path, bytes).unwrap();
        paths.push(path);
    }
    let subject = Subject::new(Path::new("named"));
    let mut source = open(&paths, &subject, &OpenOptions::default())?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
    Ok((desc, out, source.notes().join("\n")))
}

fn refused(files: &[Vec<u8>]) -> String {
    match read(files) {
        Ok(_) => panic!("they were read"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn png_of_8_and_16_bits() {
    let (desc, voxels, notes) = read(&[grey(0), grey(7)]).unwrap();
    assert_eq!(desc.dims.to_array(), [8, 8, 2], "two slices");
    let expected: Vec<u8> = [0, 7]
        .iter()
        .flat_map(|s| (0..64).map(move |n| n * 3 + s))
        .collect();
    assert_eq!(voxels, expected, "in the order of the files");
    assert!(notes.contains("1 mm is taken"), "{notes}");

    let data: Vec<u8> = (0..64_u16).flat_map(|n| (n * 1000).to_be_bytes()).collect();
    let bytes = png(ColorType::Grayscale, BitDepth::Sixteen, &data);
    let (desc, voxels, _) = read(&[bytes]).unwrap();
    assert_eq!(
        (desc.voxel_type, desc.dims.z),
        (VoxelType::U16, 1),
        "one slice"
    );
    let expected: Vec<u8> = (0..64_u16).flat_map(|n| (n * 1000).to_le_bytes()).collect();
    assert_eq!(voxels, expected, "little-endian");
}

#[test]
fn colour_is_taken_where_it_is_grey() {
    let rgb: Vec<u8> = (0..64).flat_map(|n| [n, n, n]).collect();
    let opaque: Vec<u8> = (0..64).flat_map(|n| [n, 255]).collect();
    let expected: Vec<u8> = (0..64).collect();
    for (colour, data) in [(ColorType::Rgb, &rgb), (ColorType::GrayscaleAlpha, &opaque)] {
        let (_, voxels, notes) = read(&[png(colour, BitDepth::Eight, data)]).unwrap();
        assert_eq!(voxels, expected, "{colour:?}");
        assert!(notes.contains("stored in colour"), "{notes}");
    }
    let mut spot = rgb.clone();
    spot[3 * 13 + 1] = 200;
    let coloured = png(ColorType::Rgb, BitDepth::Eight, &spot);
    assert!(
        refused(std::slice::from_ref(&coloured)).contains("colour (pixel 5, 1)"),
        "one pixel"
    );
    let first = png(ColorType::Rgb, BitDepth::Eight, &rgb);
    assert!(
        refused(&[first, coloured]).contains("/1: colour"),
        "in the second picture"
    );
    let mut clear = opaque.clone();
    clear[1] = 0;
    let clear = png(ColorType::GrayscaleAlpha, BitDepth::Eight, &clear);
    assert!(refused(&[clear]).contains("transparency"), "an open pixel");

    let indices: Vec<u8> = (0..64).map(|n| n % 2).collect();
    let palette = png(ColorType::Indexed, BitDepth::Eight, &indices);
    let (_, voxels, _) = read(&[palette]).unwrap();
    assert_eq!(voxels[..4], [1, 50, 1, 50], "a palette of greys");
    let palette = png(ColorType::Indexed, BitDepth::Eight, &[2; 64]);
    assert!(
        refused(&[palette]).contains("colour"),
        "a palette of colours"
    );
}

#[test]
fn jpeg_and_mixed_series() {
    let (desc, voxels, _) = read(&[GREY_8X8.to_vec(), grey(0)]).unwrap();
    assert_eq!(desc.dims.to_array(), [8, 8, 2], "JPEG, then PNG");
    assert_eq!(voxels[..64], [77; 64], "the JPEG picture");
    assert_eq!(voxels[64..67], [0, 3, 6], "the PNG picture");
    let (_, voxels, notes) = read(&[COLOUR_8X8.to_vec(), grey(0)]).unwrap();
    assert_eq!(voxels[..64], [77; 64], "stored in colour");
    assert_eq!(voxels[64..67], [0, 3, 6], "grey beside it");
    assert!(notes.contains("stored in colour"), "{notes}");
}

#[test]
fn what_is_not_built_is_named() {
    let bits = png(ColorType::Grayscale, BitDepth::One, &[0x55; 8]);
    assert!(refused(&[bits]).contains("1 bit"), "bits");
    let wide = png(ColorType::Grayscale, BitDepth::Sixteen, &[0; 128]);
    let error = refused(&[grey(0), wide]);
    assert!(
        error.contains("voxels of u16") && error.contains("/1: "),
        "{error}"
    );
    assert!(
        refused(&[b"GIF89a..".to_vec()]).contains("PNG or JPEG"),
        "GIF"
    );
    assert!(refused(&[]).contains("none"), "no files");
}

#[test]
fn damaged_pictures_are_refused() {
    let bytes = grey(5);
    // The last 16 bytes are the checksum of the voxels and the end, which no voxel depends on.
    for len in 0..bytes.len() - 16 {
        assert!(read(&[bytes[..len].to_vec()]).is_err(), "{len} bytes");
    }
    for at in 0..bytes.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut changed = bytes.clone();
            changed[at] ^= change;
            let _ = read(&[changed]);
        }
    }
    for len in 0..GREY_8X8.len() {
        assert!(
            read(&[GREY_8X8[..len].to_vec()]).is_err(),
            "JPEG, {len} bytes"
        );
    }
}
