//! The forms in which voxels are stored: byte orders, sizes, strips, tiles, compressions, predictors, series.

use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype};

use super::build::{CODINGS, Page, file, plain};
use super::*;
use crate::volume::VoxelType;

/// Bits, TIFF's number of the format, and what comes out.
const TYPES: [(u64, u64, VoxelType); 9] = [
    (8, 1, VoxelType::U8),
    (8, 2, VoxelType::I8),
    (16, 1, VoxelType::U16),
    (16, 2, VoxelType::I16),
    (32, 1, VoxelType::U32),
    (32, 2, VoxelType::I32),
    (32, 3, VoxelType::F32),
    (64, 3, VoxelType::F64),
    (16, 4, VoxelType::U16),
];

fn typed(bits: u64, sample_format: u64, seed: u64) -> Page {
    let mut page = Page::new(13, 9, seed);
    (page.bits, page.sample_format) = (bits, sample_format);
    for v in &mut page.voxels {
        *v = match (sample_format, bits) {
            (3, 32) => u64::from((*v as f32 - 100.5).to_bits()),
            (3, _) => (*v as f64 - 100.5).to_bits(),
            _ => v.wrapping_mul(0x0102_0304_0506_0701) & (u64::MAX >> (64 - bits)),
        };
    }
    page
}

#[test]
fn every_form_gives_the_same_voxels() {
    for (bits, sample_format, voxel_type) in TYPES {
        let pages = [1, 2, 3].map(|seed| typed(bits, sample_format, seed));
        let expected: Vec<u8> = pages.iter().flat_map(Page::expected).collect();
        for (n, endian) in BOTH.into_iter().cycle().take(4).enumerate() {
            for compression in CODINGS {
                for tile in [None, Some((16, 16)), Some((8, 4))] {
                    for predictor in [1, 2, 3] {
                        let is_packed = matches!(compression, 8 | 50000);
                        if predictor > 1 && !is_packed || predictor == 3 && sample_format != 3 {
                            continue;
                        }
                        let pages = pages.clone().map(|page| Page {
                            compression,
                            tile,
                            predictor,
                            rows_per_strip: 2 + n * 4,
                            ..page
                        });
                        let form = format!(
                            "{voxel_type}, {endian:?}, big {}, compression {compression}, {tile:?}, predictor \
                             {predictor}",
                            n > 1
                        );
                        let found = read(&file(&pages, endian, n > 1))
                            .unwrap_or_else(|e| panic!("{form}: {e}"));
                        assert_eq!(found.dims, [13, 9, 3], "{form}");
                        assert_eq!(found.desc.voxel_type, voxel_type, "{form}");
                        assert!(found.voxels == expected, "{form}: other voxels");
                    }
                }
            }
        }
    }
}

#[test]
fn files_of_another_writer() {
    let voxels: Vec<u16> = (0..40 * 30_u32).map(|n| (n * n % 977) as u16).collect();
    let compressions = [
        Compression::Uncompressed,
        Compression::Lzw,
        Compression::Deflate(DeflateLevel::Fast),
        Compression::Packbits,
    ];
    for (n, compression) in compressions.into_iter().enumerate() {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            let is_plain = matches!(
                compression,
                Compression::Uncompressed | Compression::Packbits
            );
            if is_plain && predictor == Predictor::Horizontal {
                continue;
            }
            let mut bytes = std::io::Cursor::new(Vec::new());
            let mut encoder = TiffEncoder::new(&mut bytes)
                .unwrap()
                .with_compression(compression)
                .with_predictor(predictor);
            for _ in 0..2 {
                encoder
                    .write_image::<colortype::Gray16>(40, 30, &voxels)
                    .unwrap();
            }
            let found = read(bytes.get_ref()).unwrap();
            let expected: Vec<u8> = voxels
                .iter()
                .chain(&voxels)
                .flat_map(|v| v.to_le_bytes())
                .collect();
            assert_eq!(found.dims, [40, 30, 2], "{predictor:?}");
            assert!(found.voxels == expected, "number {n}, {predictor:?}");
        }
    }
}

#[test]
fn jpeg_tiles() {
    let picture = crate::input::jpeg::tests::GREY_8X8;
    let mut page = Page::new(8, 8, 0);
    (page.bits, page.compression) = (8, 7);
    page.voxels = picture.iter().map(|&b| u64::from(b)).collect();
    // The picture takes the place of the voxels: the writer leaves it as it is.
    (page.width, page.height) = (picture.len(), 1);
    page.tile = Some((picture.len(), 1));
    let bytes = |width: u64, height: u64| {
        let page = page.clone();
        let page = page.with(256, 4, &[width]).with(257, 4, &[height]);
        plain(&[page.with(322, 4, &[width]).with(323, 4, &[8])])
    };
    let found = read(&bytes(8, 8)).unwrap();
    assert_eq!(found.voxels, [77; 64], "a grey picture");
    assert_eq!(
        read(&bytes(8, 5)).unwrap().voxels,
        [77; 40],
        "its first rows"
    );
    let error = refused(&bytes(16, 8));
    assert!(error.contains("a picture of 8 × 8"), "{error}");
    let at = bytes(8, 8)
        .windows(2)
        .rposition(|w| w == [0xff, 0xd9])
        .unwrap();
    let mut cut = bytes(8, 8);
    cut[at] = 0;
    assert!(refused(&cut).contains("no end"), "{}", refused(&cut));
}

#[test]
fn parts_are_cut_from_slices() {
    let pages = [1, 2, 3].map(|seed| Page {
        tile: Some((16, 16)),
        ..Page::new(20, 18, seed)
    });
    let (_dir, paths) = saved(&[plain(&pages)]);
    let subject = Subject::new(Path::new("named"));
    let mut source = open(&paths, &subject, &OpenOptions::default()).unwrap();
    let part = VoxelBox::new(glam::U64Vec3::new(15, 3, 1), glam::U64Vec3::new(18, 17, 3));
    let mut out = vec![0; part.voxel_count().unwrap() as usize * 2];
    source.read_box(part, &mut out).unwrap();
    let mut expected = Vec::new();
    for page in &pages[1..] {
        for y in 3..17 {
            for x in 15..18 {
                expected.extend((page.voxels[y * 20 + x] as u16).to_le_bytes());
            }
        }
    }
    assert_eq!(out, expected, "a box over the edge of tiles");
    assert!(source.held_bytes() >= 16 * 16 * 2, "a tile is held");
    assert!(
        source.stamp().contains("bytes, changed"),
        "{}",
        source.stamp()
    );
}

#[test]
fn kinds_that_are_not_built_are_named() {
    let page = Page::new(4, 4, 1);
    for (tag, kind, values, word) in [
        (277, 3, vec![3], "3 samples per voxel"),
        (262, 3, vec![2], "colour"),
        (262, 3, vec![3], "palette"),
        (262, 3, vec![77], "PhotometricInterpretation 77"),
        (258, 3, vec![1], "1-bit"),
        (258, 3, vec![12], "12-bit"),
        (258, 3, vec![64], "64-bit"),
        (266, 3, vec![2], "FillOrder"),
        (259, 3, vec![4], "fax"),
        (259, 3, vec![34712], "JPEG 2000"),
        (259, 3, vec![7], "JPEG of u16"),
        (259, 3, vec![4711], "compression 4711"),
        (317, 3, vec![2], "predictor 2"),
        (317, 3, vec![9], "predictor 9"),
        (33629, 5, vec![1; 20], "MetaMorph stack of 10"),
    ] {
        let error = refused(&plain(&[page.clone().with(tag, kind, &values)]));
        assert!(
            error.contains(word) && error.contains("page 0"),
            "{tag}: {error}"
        );
    }
    let half = page.clone().with(339, 3, &[3]);
    assert!(refused(&plain(&[half])).contains("16-bit floats"));
    let complex = page.clone().with(339, 3, &[5]).with(258, 3, &[64]);
    assert!(refused(&plain(&[complex])).contains("complex"));
    let inverted = read(&plain(&[page.clone().with(262, 3, &[0])])).unwrap();
    assert_eq!(inverted.voxels, page.expected(), "0 is white");
    assert!(inverted.notes.contains("WhiteIsZero"), "{}", inverted.notes);
    let packed = Page {
        compression: 8,
        ..page.clone()
    };
    let inverted = read(&plain(&[packed.with(262, 3, &[0]).with(274, 3, &[4])])).unwrap();
    assert_eq!(inverted.voxels, page.expected(), "0 is white, compressed");
    assert!(inverted.notes.contains("orientation"), "{}", inverted.notes);
}

#[test]
fn pages_must_be_alike() {
    let other = [Page::new(4, 4, 1), Page::new(4, 5, 2)];
    let error = refused(&plain(&other));
    assert!(
        error.contains("page 1") && error.contains("4 × 5"),
        "{error}"
    );
    let mut pages = [Page::new(4, 4, 1), Page::new(4, 4, 2)];
    pages[1].sample_format = 2;
    assert!(refused(&plain(&pages)).contains("i16"), "another type");
}

#[test]
fn reduced_copies_are_left_out() {
    let small = Page::new(2, 2, 9).with(254, 4, &[1]);
    let pages = [
        Page::new(4, 4, 1),
        small.clone(),
        Page::new(4, 4, 2).with(330, 4, &[8]),
        small.clone(),
    ];
    let found = read(&plain(&pages)).unwrap();
    assert_eq!(found.dims, [4, 4, 2], "two pages and two copies");
    assert_eq!(
        found.voxels,
        [pages[0].expected(), pages[2].expected()].concat()
    );
    assert!(
        found.notes.contains("2 pages of reduced"),
        "{}",
        found.notes
    );
    assert!(found.notes.contains("SubIFDs"), "{}", found.notes);
    assert!(refused(&plain(&[small])).contains("only reduced"));
}

#[test]
fn files_of_one_page_each_are_slices() {
    let pages: Vec<Page> = (0..5).map(|seed| Page::new(6, 4, seed)).collect();
    let files: Vec<Vec<u8>> = pages
        .iter()
        .enumerate()
        .map(|(n, page)| file(std::slice::from_ref(page), BOTH[n % 2], n > 2))
        .collect();
    let found = read_files(&files, &OpenOptions::default()).unwrap();
    assert_eq!(found.dims, [6, 4, 5], "one slice per file");
    let expected: Vec<u8> = pages.iter().flat_map(Page::expected).collect();
    assert_eq!(found.voxels, expected, "in the order of the files");
    assert_eq!(found.desc.name, "named", "as the user called them");

    let text = |files: &[Vec<u8>]| match read_files(files, &OpenOptions::default()) {
        Ok(_) => panic!("it was read"),
        Err(e) => e.to_string(),
    };
    let mut several = files.clone();
    several[3] = plain(&pages[..2]);
    let error = text(&several);
    assert!(
        error.contains("several pages") && error.contains("3.tif"),
        "{error}"
    );
    several[3] = plain(&[Page::new(6, 5, 1)]);
    let error = text(&several);
    assert!(
        error.contains("6 × 5") && error.contains("3.tif"),
        "{error}"
    );
    assert!(text(&[]).contains("none"), "no files");
    let options = OpenOptions {
        channel: Some(1),
        ..Default::default()
    };
    assert!(
        read_files(&files, &options).is_err(),
        "files have no channels"
    );
}
