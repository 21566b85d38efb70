//! What descriptions and resolutions make of pages: ImageJ, OME-XML, plain TIFF.

use glam::DVec3;

use super::build::{Page, file, plain};
use super::*;

fn chosen(channel: u64, time: u64) -> OpenOptions {
    OpenOptions {
        channel: Some(channel),
        time: Some(time),
        ..Default::default()
    }
}

fn pages(count: u64, text: &str) -> Vec<Page> {
    let mut pages: Vec<Page> = (0..count).map(|seed| Page::new(5, 3, seed)).collect();
    pages[0] = pages[0].clone().with_text(text);
    pages
}

fn voxels(pages: &[Page], chosen: &[usize]) -> Vec<u8> {
    chosen.iter().flat_map(|&n| pages[n].expected()).collect()
}

#[test]
fn imagej_hyperstacks() {
    // Channel fastest, then slice, then point in time.
    let text = "ImageJ=1.54f\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\n";
    let pages = pages(12, text);
    let bytes = file(&pages, Endian::Big, false);
    for (channel, time, planes) in [(0, 0, [0, 2, 4]), (1, 0, [1, 3, 5]), (1, 1, [7, 9, 11])] {
        let found = read_files(std::slice::from_ref(&bytes), &chosen(channel, time)).unwrap();
        assert_eq!(found.dims, [5, 3, 3], "channel {channel}, time {time}");
        assert_eq!(
            found.voxels,
            voxels(&pages, &planes),
            "channel {channel}, time {time}"
        );
        assert!(found.notes.contains("of 2 channels"), "{}", found.notes);
    }
    let error = refused(&bytes);
    assert!(
        error.contains("2 channels") && error.contains("--channel N, from 0 to 1"),
        "{error}"
    );
    let options = OpenOptions {
        channel: Some(0),
        ..Default::default()
    };
    let error = refused_with(&bytes, &options);
    assert!(
        error.contains("2 points in time") && error.contains("--time N"),
        "{error}"
    );
    let error = refused_with(&bytes, &chosen(2, 0));
    assert!(
        error.contains("--channel") && error.contains("from 0 to 1, found 2"),
        "{error}"
    );
    for text in [
        "images=7\nchannels=2\n",
        "images=6\nslices=5\n",
        "images=0\n",
        "images=x\n",
    ] {
        let pages = self::pages(6, &format!("ImageJ=1.54f\n{text}"));
        assert!(read(&plain(&pages)).is_err(), "{text}");
    }
}

#[test]
fn imagej_stacks_of_one_directory() {
    let planes: Vec<Page> = (0..6).map(|seed| Page::new(5, 3, seed)).collect();
    for (endian, big) in [(Endian::Big, false), (Endian::Little, true)] {
        // One page as high as all planes, said to be as high as one.
        let mut all =
            Page::new(5, 18, 0).with_text("ImageJ=1.54f\nimages=6\nchannels=2\nslices=3\n");
        all.voxels = planes.iter().flat_map(|p| p.voxels.clone()).collect();
        let all = all.with(257, 4, &[3]).with(278, 4, &[3]);
        let bytes = file(std::slice::from_ref(&all), endian, big);
        for (channel, wanted) in [(0, [0, 2, 4]), (1, [1, 3, 5])] {
            let found = read_files(std::slice::from_ref(&bytes), &chosen(channel, 0)).unwrap();
            assert_eq!(found.dims, [5, 3, 3], "{endian:?}, channel {channel}");
            assert_eq!(
                found.voxels,
                voxels(&planes, &wanted),
                "{endian:?}, channel {channel}"
            );
        }
        let more = all.with_text("ImageJ=1.54f\nimages=60\nslices=60\n");
        let error = refused(&file(&[more], endian, big));
        assert!(error.contains("60 planes"), "{error}");
    }
    let packed = Page {
        compression: 8,
        ..Page::new(5, 3, 0).with_text("ImageJ=1.54f\nimages=6\n")
    };
    let error = refused(&plain(&[packed]));
    assert!(error.contains("one page for 6 planes"), "{error}");
}

#[test]
fn imagej_distances_and_values() {
    let spacing = |text: &str, unit: u64| {
        let mut pages = pages(2, &format!("ImageJ=1.54f\nimages=2\nslices=2\n{text}"));
        pages[0] = pages[0]
            .clone()
            .with(282, 5, &[4, 1])
            .with(283, 5, &[2, 1])
            .with(296, 3, &[unit]);
        read(&plain(&pages)).unwrap()
    };
    for (text, expected) in [
        ("unit=\\u00B5m\nspacing=2.5\n", [0.25e-3, 0.5e-3, 2.5e-3]),
        ("unit=micron\n", [0.25e-3, 0.5e-3, 1e-3]),
        ("unit=um\nspacing=-3\n", [0.25e-3, 0.5e-3, 3e-3]),
        ("unit=mm\nspacing=7\n", [0.25, 0.5, 7.0]),
        (
            "unit=cm\nyunit=mm\nzunit=inch\nspacing=1\n",
            [2.5, 0.5, 25.4],
        ),
        ("unit=pixel\nspacing=3\n", [1.0, 1.0, 3.0]),
        ("unit=pixel\n", [1.0, 1.0, 1.0]),
        ("", [1.0, 1.0, 1.0]),
    ] {
        let found = spacing(text, 1);
        assert!(
            close(found.spacing, expected),
            "{text}: {:?}",
            found.spacing
        );
        let is_told = !text.contains("unit=") || text.contains("pixel");
        assert_eq!(
            found.notes.contains("--spacing"),
            is_told,
            "{text}: {}",
            found.notes
        );
    }
    let found = spacing("cf=0\nc0=-32768.0\nc1=2.0\nvunit=HU\n", 1);
    assert_eq!(
        (found.desc.rescale.slope, found.desc.rescale.intercept),
        (2.0, -32768.0)
    );
    assert_eq!(found.desc.unit, "HU", "unit of the values");
    let found = spacing("cf=2\nc0=1\nc1=2\nc2=3\nvunit=OD\n", 1);
    assert_eq!(found.desc.rescale, crate::volume::Rescale::IDENTITY);
    assert!(found.notes.contains("calibration"), "{}", found.notes);
}

#[test]
fn resolutions_without_a_description() {
    let read_at = |resolution: u64, unit: u64, given: Option<DVec3>| {
        let page = Page::new(5, 3, 0)
            .with(282, 5, &[resolution, 1])
            .with(283, 5, &[resolution * 2, 1])
            .with(296, 3, &[unit]);
        let options = OpenOptions {
            spacing: given,
            ..Default::default()
        };
        read_files(&[plain(&[page, Page::new(5, 3, 1)])], &options).unwrap()
    };
    let cm = read_at(100, 3, None);
    assert!(close(cm.spacing, [0.1, 0.05, 0.1]), "{:?}", cm.spacing);
    assert!(cm.notes.contains("distance of slices"), "{}", cm.notes);
    let inch = read_at(254, 2, None);
    assert!(close(inch.spacing, [0.1, 0.05, 0.1]), "{:?}", inch.spacing);
    // 72 dpi along x is nobody's meaning; then what y says is not believed alone, but taken as all there is.
    let screen = read_at(36, 2, None);
    assert!(screen.notes.contains("rows, slices"), "{}", screen.notes);
    for (resolution, unit) in [(0, 2), (0, 3), (300, 1)] {
        let found = read_at(resolution, unit, None);
        assert_eq!(found.spacing, [1.0; 3], "{resolution}, {unit}");
    }
    let given = read_at(100, 3, Some(DVec3::new(1.0, 2.0, 3.0)));
    assert_eq!(given.spacing, [1.0, 2.0, 3.0], "the user is right");
    assert_eq!(given.notes, "", "nothing is assumed");
}

/// OME-XML of 2 channels, 3 slices and 2 points in time.
fn ome(order: &str, inner: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" \
         UUID=\"urn:uuid:a\"><Image ID=\"Image:0\"><Pixels DimensionOrder=\"{order}\" SizeX=\"5\" SizeY=\"3\" \
         SizeC=\"2\" SizeZ=\"3\" SizeT=\"2\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"500\" \
         PhysicalSizeYUnit=\"nm\" PhysicalSizeZ=\"2\" Type=\"uint16\">{inner}</Pixels></Image></OME>"
    )
}

#[test]
fn ome_orders() {
    for (order, planes) in [
        ("XYZCT", [9, 10, 11]),
        ("XYZTC", [9, 10, 11]),
        ("XYCZT", [7, 9, 11]),
        ("XYCTZ", [3, 7, 11]),
        ("XYTZC", [7, 9, 11]),
        ("XYTCZ", [3, 7, 11]),
    ] {
        let pages = pages(12, &ome(order, ""));
        let found = read_files(&[plain(&pages)], &chosen(1, 1)).unwrap();
        assert_eq!(found.voxels, voxels(&pages, &planes), "{order}");
        assert!(
            close(found.spacing, [5e-4, 5e-4, 2e-3]),
            "{:?}",
            found.spacing
        );
    }
    let error = refused(&plain(&pages(12, &ome("XYZCT", ""))));
    assert!(error.contains("--channel N"), "{error}");
    let error = refused_with(&plain(&pages(11, &ome("XYZCT", ""))), &chosen(1, 1));
    assert!(error.contains("page 11"), "{error}");
    for wrong in ["XYZC", "ZCT", "XYZZT"] {
        let error = refused_with(&plain(&pages(12, &ome(wrong, ""))), &chosen(1, 1));
        assert!(error.contains("DimensionOrder"), "{error}");
    }
}

#[test]
fn ome_says_where_planes_are() {
    let blocks: String = (0..12)
        .map(|n| {
            let (z, c, t) = (n % 3, n / 3 % 2, n / 6);
            format!(
                "<TiffData IFD=\"{}\" FirstZ=\"{z}\" FirstC=\"{c}\" FirstT=\"{t}\"/>",
                11 - n
            )
        })
        .collect();
    let pages = pages(12, &ome("XYCZT", &blocks));
    let found = read_files(&[plain(&pages)], &chosen(1, 0)).unwrap();
    assert_eq!(
        found.voxels,
        voxels(&pages, &[8, 7, 6]),
        "the pages backwards"
    );

    let text = |inner: &str| {
        let pages = self::pages(12, &ome("XYZCT", inner));
        match read_files(&[plain(&pages)], &chosen(0, 0)) {
            Ok(found) if found.voxels == voxels(&pages, &[0, 1, 2]) => "the first".to_owned(),
            Ok(_) => "others".to_owned(),
            Err(e) => e.to_string(),
        }
    };
    let uuid = |name: &str, id: &str| format!("<UUID FileName=\"{name}\">urn:uuid:{id}</UUID>");
    let in_file = |ifd: u64, uuid: &str| {
        format!("<TiffData IFD=\"{ifd}\" FirstT=\"{ifd}\" PlaneCount=\"6\">{uuid}</TiffData>")
    };
    assert_eq!(text("<TiffData/>"), "the first", "one block for all");
    let here = in_file(0, &uuid("old-name.tif", "a")) + &in_file(1, &uuid("b.tif", "b"));
    assert_eq!(text(&here), "the first", "what is needed is here");
    let away = in_file(0, &uuid("c.tif", "c")) + &in_file(1, &uuid("b.tif", "b"));
    assert!(
        text(&away).contains("several files") && text(&away).contains("c.tif"),
        "{}",
        text(&away)
    );
    let renamed = format!("<TiffData>{}</TiffData>", uuid("old-name.tif", "x"));
    assert_eq!(text(&renamed), "the first", "a renamed file");
    assert!(
        text("<TiffData IFD=\"0\"/>").contains("slice 1"),
        "{}",
        text("<TiffData IFD=\"0\"/>")
    );
    assert!(text("<TiffData FirstZ=\"9\"/>").contains("below 3"));
    assert!(text("<TiffData IFD=\"-1\"/>").contains("a number"));
    assert!(text("<TiffData IFD=\"18446744073709551615\" PlaneCount=\"9\"/>").contains("page"));
}

#[test]
fn ome_images_are_chosen() {
    let image = |id: u64, ifd: u64| {
        format!(
            "<Image ID=\"Image:{id}\"><Pixels DimensionOrder=\"XYZCT\" SizeX=\"5\" SizeY=\"3\" SizeZ=\"2\">\
             <TiffData IFD=\"{ifd}\" PlaneCount=\"2\"/></Pixels></Image>"
        )
    };
    let text = format!(
        "<ome:OME xmlns:ome=\"o\">{}{}</ome:OME>",
        image(0, 0),
        image(1, 2)
    );
    let pages = pages(4, &text);
    let bytes = plain(&pages);
    let error = refused(&bytes);
    assert!(
        error.contains("2 images") && error.contains("--dataset"),
        "{error}"
    );
    let of = |dataset: &str| OpenOptions {
        dataset: Some(dataset.to_owned()),
        ..Default::default()
    };
    let found = read_files(std::slice::from_ref(&bytes), &of("Image:1")).unwrap();
    assert_eq!(found.voxels, voxels(&pages, &[2, 3]), "the second image");
    assert!(refused_with(&bytes, &of("x")).contains("Image:0, Image:1"));
}

#[test]
fn broken_ome_is_refused() {
    for (text, word) in [
        ("<OME xmlns=\"a\"><Image>", "sound XML"),
        ("<OME xmlns=\"a\"></OME>", "an Image element"),
        ("<OME xmlns=\"a\"><Image/></OME>", "a Pixels element"),
        (
            "<OME xmlns=\"a\"><BinaryOnly MetadataFile=\"m.ome\"/></OME>",
            "m.ome",
        ),
        (
            "<!DOCTYPE a [<!ENTITY a \"b\">]><OME xmlns=\"a\"/>",
            "sound XML",
        ),
        (
            "<OME xmlns=\"a\"><Image><Pixels SizeX=\"5\" SizeY=\"3\" SizeZ=\"99999999\"/></Image></OME>",
            "1048576 planes",
        ),
        (
            "<OME xmlns=\"a\"><Image><Pixels SizeX=\"5\" SizeY=\"4\" SizeZ=\"1\"/></Image></OME>",
            "5 × 4",
        ),
        (
            "<OME xmlns=\"a\"><Image><Pixels SizeX=\"5\" SizeY=\"3\" PhysicalSizeX=\"wide\"/></Image></OME>",
            "PhysicalSizeX",
        ),
    ] {
        let error = refused(&plain(&pages(1, text)));
        assert!(error.contains(word), "{text}: {error}");
    }
    let deep = format!("<OME xmlns=\"a\">{}", "<a>".repeat(200_000));
    assert!(
        refused(&plain(&pages(1, &deep))).contains("sound XML"),
        "deep"
    );
    let other = read(&plain(&pages(2, "<svg><a/></svg>"))).unwrap();
    assert_eq!(other.dims, [5, 3, 2], "other XML is no matter");
}

#[test]
fn slices_of_an_ome_set() {
    let files: Vec<Vec<u8>> = (0..3)
        .map(|seed| plain(&[Page::new(5, 3, seed).with_text(&ome("XYZCT", ""))]))
        .collect();
    let found = read_files(&files, &OpenOptions::default()).unwrap();
    assert!(
        close(found.spacing, [5e-4, 5e-4, 2e-3]),
        "{:?}",
        found.spacing
    );
    // Two channels would be stacked on each other.
    let error = read_files(&files[..2], &OpenOptions::default());
    let error = error.err().unwrap().to_string();
    assert!(error.contains("2 channels"), "{error}");
}

#[test]
fn arrays_of_several_axes() {
    let pages = pages(6, "{\"shape\": [2, 3, 3, 5], \"axes\": \"CZYX\"}");
    let found = read(&plain(&pages)).unwrap();
    assert_eq!(found.dims, [5, 3, 6], "all planes");
    assert!(found.notes.contains("[2, 3, 3, 5]"), "{}", found.notes);
    let found = read(&plain(&self::pages(6, "{\"shape\": [6, 3, 5]}"))).unwrap();
    assert!(!found.notes.contains("axes"), "{}", found.notes);

    let mut all = Page::new(5, 6, 0).with_text("{\"shape\": [2, 3, 5]}");
    all.voxels = pages[..2].iter().flat_map(|p| p.voxels.clone()).collect();
    let all = all.with(257, 4, &[3]).with(278, 4, &[3]);
    let found = read(&plain(std::slice::from_ref(&all))).unwrap();
    assert_eq!(
        found.voxels,
        voxels(&pages, &[0, 1]),
        "planes behind the first"
    );
    let error = refused(&plain(&[all.with_text("{\"shape\": [999999, 3, 5]}")]));
    assert!(error.contains("999999 planes"), "{error}");
}
