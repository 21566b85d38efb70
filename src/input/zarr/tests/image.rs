//! Images: axes, units, levels, and containers of them.

use glam::DVec3;

use super::*;

const MICROMETRES: &str = "micrometer";

/// Attributes of an image of axes t, c, z, y, x in two levels.
fn multiscales() -> Value {
    let axis = |name: &str, kind: &str| json!({"name": name, "type": kind});
    let space = |name: &str| json!({"name": name, "type": "space", "unit": MICROMETRES});
    let scale = |s: [f64; 3]| json!({"type": "scale", "scale": [1.0, 1.0, s[0], s[1], s[2]]});
    let move_by =
        |t: [f64; 3]| json!({"type": "translation", "translation": [0, 0, t[0], t[1], t[2]]});
    json!({
        "multiscales": [{
            "axes": [axis("t", "time"), axis("c", "channel"), space("z"), space("y"), space("x")],
            "datasets": [
                {"path": "fine", "coordinateTransformations": [scale([4.0, 2.0, 1.0])]},
                {"path": "deep/coarse", "coordinateTransformations": [
                    scale([4.0, 4.0, 2.0]), move_by([0.0, 1.0, 0.5])
                ]},
            ],
            "coordinateTransformations": [scale([10.0, 10.0, 10.0])],
        }],
        "omero": {"channels": [{"label": "nuclei"}, {"label": "membranes"}]},
    })
}

/// An array of `shape`, one element per chunk along the first two axes, filled with numbers that count on.
fn array(dir: &Path, path: &str, shape: [u64; 5]) {
    let [times, channels, z, y, x] = shape;
    let metadata = json!({
        "zarr_format": 2, "shape": shape, "chunks": [1, 2, z, y, x], "dtype": "<u2", "compressor": null,
        "fill_value": 0, "order": "C", "filters": null, "dimension_separator": "/",
    });
    put(
        dir,
        &format!("{path}/.zarray"),
        metadata.to_string().as_bytes(),
    );
    let volume = z * y * x;
    for t in 0..times {
        // Two channels are in a chunk: the last one may be half empty.
        for c in 0..channels.div_ceil(2) {
            let first = (t * channels + 2 * c) * volume;
            let bytes: Vec<u8> = (first..first + 2 * volume)
                .flat_map(|n| (n as u16).to_le_bytes())
                .collect();
            put(dir, &format!("{path}/{t}/{c}/0/0/0"), &bytes);
        }
    }
}

fn image(dir: &Path, channels: u64) {
    put(dir, ".zgroup", br#"{"zarr_format": 2}"#);
    put(dir, ".zattrs", multiscales().to_string().as_bytes());
    array(dir, "fine", [2, channels, 3, 4, 6]);
    array(dir, "deep/coarse", [2, channels, 3, 2, 3]);
}

fn chosen(time: u64, channel: u64) -> OpenOptions {
    OpenOptions {
        time: Some(time),
        channel: Some(channel),
        ..Default::default()
    }
}

#[test]
fn channels_times_units_and_levels() {
    let dir = tempfile::tempdir().unwrap();
    image(dir.path(), 3);
    let location = dir.path().to_str().unwrap();
    let options = chosen(1, 2);
    let sizes = [U64Vec3::new(6, 4, 3), U64Vec3::new(3, 2, 3)];
    assert_eq!(levels(location, &options).unwrap(), sizes);
    let places = [
        (DVec3::new(0.01, 0.02, 0.04), DVec3::ZERO),
        (DVec3::new(0.02, 0.04, 0.04), DVec3::new(0.005, 0.01, 0.0)),
    ];
    for (n, (spacing, origin)) in places.into_iter().enumerate() {
        let mut source = open_level(location, &options, n).unwrap();
        let count = sizes[n].element_product();
        assert!(
            source.desc().spacing().abs_diff_eq(spacing, 1e-12),
            "spacing of level {n}"
        );
        let place = source.desc().world_from_index.translation;
        assert!(place.abs_diff_eq(origin, 1e-12), "origin of level {n}");
        // The third channel of the second time.
        let expected: Vec<u8> = (5 * count..6 * count)
            .flat_map(|n| (n as u16).to_le_bytes())
            .collect();
        assert_eq!(
            voxels(&mut *source).unwrap(),
            expected,
            "voxels of level {n}"
        );
        assert!(source.notes().is_empty(), "{:?}", source.notes());
    }
    assert!(
        open_level(location, &options, 2).is_err(),
        "a level that is not there"
    );
    let other = open_level(location, &chosen(0, 2), 0).unwrap().stamp();
    assert_ne!(
        other,
        open_level(location, &options, 0).unwrap().stamp(),
        "another time"
    );
    // A level keeps its place when it is named.
    let options = OpenOptions {
        dataset: Some("deep/coarse".to_owned()),
        ..options
    };
    let source = open(&dir, &options).unwrap();
    assert!(
        source.desc().spacing().abs_diff_eq(places[1].0, 1e-12),
        "a level by its path"
    );
}

#[test]
fn a_choice_that_is_left_is_refused_with_what_there_is() {
    let dir = tempfile::tempdir().unwrap();
    image(dir.path(), 2);
    for (options, words) in [
        (
            OpenOptions::default(),
            &["2 points in time", "--time 0 to 1"][..],
        ),
        (
            OpenOptions {
                time: Some(0),
                ..Default::default()
            },
            &["2 channels", "--channel 0 to 1", "nuclei"],
        ),
        (chosen(2, 0), &["--time", "0 to 1"]),
        (chosen(0, 9), &["--channel", "0 to 1"]),
    ] {
        let error = error(&dir, &options);
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    }
}

#[test]
fn version_0_5_and_axes_in_another_order() {
    let attributes = json!({"ome": {"version": "0.5", "multiscales": [{
        "axes": [
            {"name": "x", "type": "space", "unit": "millimeter"}, {"name": "y", "type": "space"},
            {"name": "z", "type": "space", "unit": "furlong"},
        ],
        "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 2, 3]}]}],
    }]}});
    let group = json!({"zarr_format": 3, "node_type": "group", "attributes": attributes});
    let dir = folder(&[("zarr.json", group.to_string().as_bytes())]);
    let inner = array_v3(json!({}), |at| chunk(at, C, u16::to_le_bytes));
    for at in indices(grid()) {
        let name = format!("c/{}", at.map(|i| i.to_string()).join("/"));
        let bytes = std::fs::read(inner.path().join(&name)).unwrap();
        put(dir.path(), &format!("0/{name}"), &bytes);
    }
    put(
        dir.path(),
        "0/zarr.json",
        zarr_json(json!({})).to_string().as_bytes(),
    );
    let mut source = open(&dir, &OpenOptions::default()).unwrap();
    assert_eq!(source.desc().dims, U64Vec3::from_array(SHAPE));
    assert_eq!(source.desc().spacing(), DVec3::new(1.0, 2.0, 3.0));
    let notes = source.notes().join(" ");
    assert!(notes.contains("y, z (\"furlong\")"), "{notes}");
    let [nx, ny, nz] = SHAPE;
    let expected: Vec<u8> = indices([nz, ny, nx])
        .flat_map(|[z, y, x]| value([x, y, z]).to_le_bytes())
        .collect();
    assert_eq!(voxels(&mut *source).unwrap(), expected);
    let wished = OpenOptions {
        spacing: Some(DVec3::splat(0.5)),
        ..Default::default()
    };
    assert_eq!(
        open(&dir, &wished).unwrap().desc().spacing(),
        DVec3::splat(0.5)
    );
}

#[test]
fn pictures_have_one_slice() {
    let metadata = zarray(json!({"shape": [4, 7], "chunks": [4, 7], "dtype": "|u1"})).to_string();
    let bytes: Vec<u8> = (0..28).collect();
    let dir = folder(&[(".zarray", metadata.as_bytes()), ("0.0", &bytes)]);
    let mut source = open(&dir, &OpenOptions::default()).unwrap();
    assert_eq!(source.desc().dims, U64Vec3::new(7, 4, 1));
    assert_eq!(voxels(&mut *source).unwrap(), bytes);
    assert!(source.notes()[0].contains("1 mm"), "{:?}", source.notes());
}

#[test]
fn containers_plates_and_groups() {
    let dir = folder(&[(".zgroup", br#"{"zarr_format": 2}"#)]);
    put(dir.path(), ".zattrs", br#"{"bioformats2raw.layout": 3}"#);
    image(&dir.path().join("0"), 1);
    image(&dir.path().join("1"), 2);
    let options = chosen(0, 0);
    let source = open(&dir, &options).unwrap();
    assert!(
        source.notes()[0].contains("--dataset"),
        "{:?}",
        source.notes()
    );
    let second = OpenOptions {
        dataset: Some("1".to_owned()),
        ..chosen(0, 1)
    };
    assert!(open(&dir, &second).unwrap().notes().is_empty());
    put(dir.path(), "OME/.zattrs", br#"{"series": ["1", "0"]}"#);
    let source = open(&dir, &chosen(0, 1)).unwrap();
    assert!(
        source.notes()[0].contains("2 images"),
        "{:?}",
        source.notes()
    );
    for (attributes, word) in [
        (r#"{"plate": {}}"#, "a plate of wells"),
        (r#"{"well": {}}"#, "a well of a plate"),
        ("{}", "neither; below are"),
        (r#"{"multiscales": []}"#, "multiscales"),
        (
            r#"{"multiscales": [{"datasets": [{"path": "../.."}]}]}"#,
            "below the store",
        ),
        (
            r#"{"multiscales": [{"datasets": [{"path": "none"}]}]}"#,
            "level 0",
        ),
        (
            r#"{"multiscales": [{"axes": ["y", "y", "x"], "datasets": [{"path": "0/fine"}]}]}"#,
            "axes",
        ),
        (
            r#"{"multiscales": [{"datasets": [{"path": "0", "coordinateTransformations": [{"type": "affine"}]}]}]}"#,
            "affine",
        ),
        (
            r#"{"multiscales": [{"datasets": [{"path": "0/fine", "coordinateTransformations":
                [{"type": "scale", "scale": [1, 1, 1, 0, 1]}]}]}]}"#,
            "above 0",
        ),
    ] {
        put(dir.path(), ".zattrs", attributes.as_bytes());
        let error = error(&dir, &options);
        assert!(error.contains(word), "{attributes}: {error}");
    }
    let nothing = tempfile::tempdir().unwrap();
    assert!(error(&nothing, &options).contains("none of them"));
}
