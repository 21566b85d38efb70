//! Files that are cut off, changed or made to deceive: an error each, never a panic, never more work than their length.

use proptest::prelude::*;

use super::build::{CODINGS, Page, file, plain};
use super::*;

fn sample(compression: u16, endian: Endian, is_big: bool) -> Vec<u8> {
    let pages = [1, 2].map(|seed| Page {
        compression,
        rows_per_strip: 2,
        tile: is_big.then_some((16, 16)),
        ..Page::new(7, 5, seed)
    });
    let [first, second] = pages;
    let text = match compression {
        8 => {
            "<OME xmlns=\"a\"><Image><Pixels DimensionOrder=\"XYZCT\" SizeX=\"7\" SizeY=\"5\" SizeZ=\"2\" \
             PhysicalSizeX=\"1\"><TiffData/></Pixels></Image></OME>"
        }
        _ => "ImageJ=1.54f\nimages=2\nslices=2\nunit=mm\nspacing=2\n",
    };
    let first = first.with_text(text).with(282, 5, &[4, 1]);
    file(&[first, second], endian, is_big)
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    for (n, compression) in CODINGS.into_iter().enumerate() {
        let bytes = sample(compression, BOTH[n % 2], n > 1);
        assert!(read(&bytes).is_ok(), "whole");
        for len in 0..bytes.len() {
            assert!(
                read(&bytes[..len]).is_err(),
                "compression {compression}, {len} bytes"
            );
        }
    }
}

#[test]
fn changed_bytes_do_no_harm() {
    for (n, compression) in CODINGS.into_iter().enumerate() {
        let bytes = sample(compression, BOTH[n % 2], n > 1);
        for at in 0..bytes.len() {
            for change in [0x01, 0x80, 0xff] {
                let mut changed = bytes.clone();
                changed[at] ^= change;
                // What matters is that it comes back.
                let _ = read(&changed);
            }
        }
    }
}

#[test]
fn chains_of_pages_end() {
    let bytes = plain(&[Page::new(4, 4, 1), Page::new(4, 4, 2)]);
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap());
    let mut ring = bytes.clone();
    let end = ring.len() - 4;
    ring[end..].copy_from_slice(&first.to_le_bytes());
    assert!(refused(&ring).contains("a ring"), "{}", refused(&ring));

    let mut none = bytes.clone();
    none[4..8].fill(0);
    assert!(
        refused(&none).contains("the place of a page"),
        "{}",
        refused(&none)
    );

    // Directories of many fields, each two bytes behind the other: read whole, they would take the square of the length.
    let mut nested = b"II*\0\x08\0\0\0".to_vec();
    nested.resize(7000, 2);
    let link = 8 + 2 + 12 * 0x0202;
    nested[link..link + 4].copy_from_slice(&10_u32.to_le_bytes());
    let error = refused(&nested);
    assert!(error.contains("overlap"), "{error}");
}

#[test]
fn sizes_that_lie_are_refused() {
    let page = Page {
        compression: 8,
        ..Page::new(4, 4, 1)
    };
    let huge = u64::from(u32::MAX);
    for (fields, word) in [
        (vec![(256, huge), (257, huge)], "strips of less than"),
        (vec![(256, huge), (257, 1 << 20)], "at least"),
        (vec![(256, 0)], "from 1 to"),
        (vec![(257, 1 << 30)], "StripOffsets"),
        (vec![(278, 0)], "RowsPerStrip"),
        (vec![(279, 1 << 31)], "a file of"),
        (vec![(279, 0)], "StripByteCounts"),
    ] {
        let mut page = page.clone();
        for (tag, value) in &fields {
            page = page.with(*tag, 4, &[*value]);
        }
        let page = match fields[0].0 {
            256 if fields.len() == 2 => page.with(278, 4, &[huge]),
            _ => page,
        };
        let error = refused(&plain(&[page]));
        assert!(error.contains(word), "{fields:?}: {error}");
    }
    let tiled = Page {
        tile: Some((16, 16)),
        ..page
    };
    let error = refused(&plain(&[tiled.with(322, 4, &[huge]).with(323, 4, &[huge])]));
    assert!(error.contains("tiles of less than"), "{error}");
}

#[test]
fn tables_shared_by_many_pages_are_refused() {
    // Every page names the same long tables of strips.
    let mut pages = vec![Page {
        rows_per_strip: 1,
        bits: 8,
        ..Page::new(1, 2000, 0)
    }];
    let bytes = plain(&pages);
    let offset = |tag: u16| {
        let at = bytes
            .windows(8)
            .position(|w| w == [&tag.to_le_bytes()[..], &[4, 0], &2000_u32.to_le_bytes()].concat())
            .unwrap();
        u64::from(u32::from_le_bytes(
            bytes[at + 8..at + 12].try_into().unwrap(),
        ))
    };
    let (offsets, counts) = (offset(273), offset(279));
    let mut many = bytes.clone();
    for _ in 0..100 {
        pages.push(pages[0].clone());
    }
    // A directory as the first one, again and again: only their links differ.
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let directory = bytes[first..].to_vec();
    for _ in 1..pages.len() {
        let at = (many.len() as u32).to_le_bytes();
        let link = many.len() - 4;
        many[link..].copy_from_slice(&at);
        many.extend(&directory);
    }
    assert!(offsets < first as u64 && counts < first as u64);
    let error = refused(&many);
    assert!(error.contains("tables that pages share"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn random_changes_do_no_harm(
        form in 0..4_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
    ) {
        let mut bytes = sample(CODINGS[form], BOTH[form % 2], form > 1);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let _ = read(&bytes);
    }
}
