//! Series of small files that the tests write themselves.

use std::path::{Path, PathBuf};

use glam::{DVec3, U64Vec3};
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;
use crate::input::options::OpenOptions;
use crate::input::problem::Subject;
use crate::input::stack::Stack;
use crate::volume::{Rescale, SourceError, VoxelSource, VoxelType};

/// 14 × 10 pixels, some alike: [`pixel`] in JPEG-LS, lossless and with errors up to 2, and in JPEG 2000.
const JPEG_LS: &str = "ffd8ffe80020535049464600020000010000000a0000000e0a1006010000012c0000012cffe8000800000001ffd8fff7000b\
    10000a000e01011100fff8000d01ffff0012004301140040ffda000801010000000040d80100401008040201010101010101\
    003fff6146602c0f8662396cde8316631cdb3be071712a0341083d0aa1a47d2250a813e89512a2544a80a0c8391c93585b5a\
    595844889112224406150d474c515453525148d2348d2340e110c414758c17af5c912449124483888b45914ad5ab1628542a\
    10ffd9";
const JPEG_LS_NEAR: &str = "ffd8ffe80020535049464600020000010000000a0000000e0a1006010000012c0000012cffe8000800000001ffd8fff7000b\
    10000a000e01011100fff8000d01ffff0018004d01220040ffda0008010100020000406010101020408208208208403fff61\
    730083858f1e5db119395af66dc3a050286888543a3a3a74e99321d0e81122445155955555554848431491125146316b5a3a\
    64141248952d6a5ad4991d04148d0a5294a52938ffd9";
const JPEG_2000: &str = "ff4fff51002900000000000e0000000a00000000000000000000000e0000000a000000000000000000010f0101ff52000c00\
    000001000004040001ff5c00044080ff640025000143726561746564206279204f70656e4a5045472076657273696f6e2032\
    2e352e34ff90000a0000000000a10001ff93cffc323c115054af77da87f80884000037ace87c5158cf9809b08c62e92eb42d\
    275f2a30641a95aa657507e4a5ed7ae01c85edea2e157861b2ad85da9be1217a5207ac2c732dc71995b2a5ca2161ae2a3ef4\
    7a6f362722ccea7de9908f7da943880276283172dc04bf28625cb51deded04ab401cee1219c908c674a85c868969602d5e9d\
    e7508d7cd547d31fe75556088aaa7fffd9";

fn pixel(x: u16, y: u16) -> u16 {
    if y < 4 {
        7
    } else {
        (x * x * 3 + y * 37) % 4096
    }
}

fn hex(text: &str) -> Vec<u8> {
    (0..text.len() / 2)
        .map(|n| u8::from_str_radix(&text[2 * n..2 * n + 2], 16).unwrap())
        .collect()
}

/// An element in explicit VR, little-endian.
fn element(tag: (u16, u16), vr: &str, value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if matches!(vr, "OB" | "OW" | "UI") {
            0
        } else {
            b' '
        });
    }
    let mut bytes = Vec::new();
    bytes.extend(tag.0.to_le_bytes());
    bytes.extend(tag.1.to_le_bytes());
    bytes.extend(vr.bytes());
    if matches!(vr, "OB" | "OW" | "SQ" | "UN") {
        bytes.extend([0; 2]);
        bytes.extend((value.len() as u32).to_le_bytes());
    } else {
        bytes.extend((value.len() as u16).to_le_bytes());
    }
    bytes.extend(value);
    bytes
}

/// A sequence of items.
fn sequence(tag: (u16, u16), items: &[Vec<u8>]) -> Vec<u8> {
    let items: Vec<u8> = items.iter().flat_map(|i| item(i)).collect();
    element(tag, "SQ", &items)
}

fn item(bytes: &[u8]) -> Vec<u8> {
    let mut item = vec![0xfe, 0xff, 0x00, 0xe0];
    item.extend((bytes.len() as u32).to_le_bytes());
    item.extend(bytes);
    item
}

/// A slice that is to be written.
#[derive(Clone)]
struct Made {
    syntax: &'static str,
    class: &'static str,
    series: &'static str,
    size: [u16; 2],
    bits: [u16; 3],
    is_signed: bool,
    photometric: &'static str,
    samples: u16,
    position: String,
    orientation: &'static str,
    rescale: [f64; 2],
    instance: u32,
    time: Option<u32>,
    /// Elements of groups 0028 and above, behind those that all have.
    more: Vec<u8>,
    frames: Option<u32>,
    pixels: Vec<u8>,
}

impl Made {
    /// Slice `k` of 3 × 2 pixels, 2.5 mm from the next; its pixels are 10 k to 10 k + 5.
    fn slice(k: i32) -> Self {
        Self::at(k, 2.5 * f64::from(k))
    }

    fn at(k: i32, z: f64) -> Self {
        let pixels = (0..6).flat_map(|n| (10 * k + n).to_le_bytes()[..2].to_vec());
        Self {
            syntax: "1.2.840.10008.1.2.1",
            class: "1.2.840.10008.5.1.4.1.1.2",
            series: "1.2.3",
            size: [3, 2],
            bits: [16, 16, 15],
            is_signed: true,
            photometric: "MONOCHROME2",
            samples: 1,
            position: format!("10\\-20\\{z}"),
            orientation: "1\\0\\0\\0\\1\\0",
            rescale: [1.0, -1024.0],
            instance: (500 - k) as u32,
            time: None,
            more: Vec::new(),
            frames: None,
            pixels: pixels.collect(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let syntax = element((2, 0x10), "UI", self.syntax.as_bytes());
        let mut bytes = vec![0; 128];
        bytes.extend(b"DICM");
        bytes.extend(element((2, 0), "UL", &(syntax.len() as u32).to_le_bytes()));
        bytes.extend(syntax);
        let mut add = |tag, vr: &str, value: &[u8]| bytes.extend(element(tag, vr, value));
        let text = |n: f64| n.to_string().into_bytes();
        add((8, 0x16), "UI", self.class.as_bytes());
        add((8, 0x60), "CS", b"CT");
        add((0x10, 0x10), "PN", b"Doe^Jane");
        add((0x18, 0x50), "DS", b"2");
        add((0x20, 0x0e), "UI", self.series.as_bytes());
        add((0x20, 0x13), "IS", self.instance.to_string().as_bytes());
        add((0x20, 0x32), "DS", self.position.as_bytes());
        add((0x20, 0x37), "DS", self.orientation.as_bytes());
        if let Some(time) = self.time {
            add((0x20, 0x100), "IS", time.to_string().as_bytes());
        }
        let [columns, rows] = self.size;
        add((0x28, 2), "US", &self.samples.to_le_bytes());
        add((0x28, 4), "CS", self.photometric.as_bytes());
        if let Some(frames) = self.frames {
            add((0x28, 8), "IS", frames.to_string().as_bytes());
        }
        add((0x28, 0x10), "US", &rows.to_le_bytes());
        add((0x28, 0x11), "US", &columns.to_le_bytes());
        add((0x28, 0x30), "DS", b"0.7\\0.9");
        for (tag, bits) in (0x100..).zip(self.bits) {
            add((0x28, tag), "US", &bits.to_le_bytes());
        }
        add(
            (0x28, 0x103),
            "US",
            &u16::from(self.is_signed).to_le_bytes(),
        );
        add((0x28, 0x1052), "DS", &text(self.rescale[1]));
        add((0x28, 0x1053), "DS", &text(self.rescale[0]));
        bytes.extend(&self.more);
        if self.syntax == "1.2.840.10008.1.2.1" {
            bytes.extend(element((0x7fe0, 0x10), "OW", &self.pixels));
        } else {
            bytes.extend([
                0xe0, 0x7f, 0x10, 0x00, b'O', b'B', 0, 0, 0xff, 0xff, 0xff, 0xff,
            ]);
            bytes.extend(item(&[]));
            bytes.extend(item(&self.pixels));
            bytes.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
        }
        bytes
    }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn of(slices: impl IntoIterator<Item = Made>) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (n, slice) in slices.into_iter().enumerate() {
            std::fs::write(folder.0.path().join(format!("f{n}")), slice.bytes()).unwrap();
        }
        folder
    }

    fn files(&self) -> Vec<PathBuf> {
        crate::input::files::in_folder(&Subject::new(self.0.path())).unwrap()
    }

    fn open(&self, options: &OpenOptions) -> Result<Stack, SourceError> {
        open(&self.files(), &Subject::new(self.0.path()), options)
    }

    fn refused(&self, options: &OpenOptions) -> String {
        self.open(options).err().expect("a refusal").to_string()
    }
}

fn voxels(stack: &mut Stack) -> Vec<f64> {
    let desc = stack.desc().clone();
    let mut bytes = vec![0; desc.byte_count().unwrap() as usize];
    stack
        .read_box(VoxelBox::whole(desc.dims), &mut bytes)
        .unwrap();
    let values = bytes.chunks_exact(desc.voxel_type.size());
    values.map(|v| desc.voxel_type.value(v)).collect()
}

fn plain() -> OpenOptions {
    OpenOptions::default()
}

#[test]
fn slices_come_in_the_order_of_their_places() {
    let folder = Folder::of([3, 0, 2, 1].map(Made::slice));
    let mut stack = folder.open(&plain()).unwrap();
    let desc = stack.desc().clone();
    assert_eq!(desc.dims, U64Vec3::new(3, 2, 4));
    assert_eq!(desc.voxel_type, VoxelType::I16);
    assert_eq!(desc.unit, "HU");
    let rescale = Rescale {
        slope: 1.0,
        intercept: -1024.0,
    };
    assert_eq!(desc.rescale, rescale);
    let expected: Vec<f64> = (0..4)
        .flat_map(|k| (0..6).map(move |n| f64::from(10 * k + n)))
        .collect();
    assert_eq!(voxels(&mut stack), expected);
    let m = desc.world_from_index;
    assert!(
        m.matrix3.x_axis.distance(DVec3::new(-0.9, 0.0, 0.0)) < 1e-12,
        "LPS to RAS"
    );
    assert!(m.matrix3.y_axis.distance(DVec3::new(0.0, -0.7, 0.0)) < 1e-12);
    assert!(m.matrix3.z_axis.distance(DVec3::new(0.0, 0.0, 2.5)) < 1e-12);
    assert_eq!(m.translation, DVec3::new(-10.0, 20.0, 0.0));
    assert!(stack.notes().is_empty() && stack.tags().is_empty());
    // A part of a slice.
    let part = VoxelBox::new(U64Vec3::new(1, 1, 1), U64Vec3::new(3, 2, 3));
    let mut bytes = vec![0; 8];
    stack.read_box(part, &mut bytes).unwrap();
    assert_eq!(bytes, [14, 0, 15, 0, 24, 0, 25, 0]);
}

#[test]
fn nothing_of_the_patient_is_kept_unless_asked() {
    let folder = Folder::of([0, 1].map(Made::slice));
    let silent = folder.open(&plain()).unwrap();
    assert!(silent.tags().is_empty() && !silent.desc().name.contains("Doe"));
    let keep = OpenOptions {
        keep_tags: true,
        ..plain()
    };
    let tags = folder.open(&keep).unwrap().tags();
    assert!(
        tags.contains(&("PatientName".into(), "Doe^Jane".into())),
        "{tags:?}"
    );
}

#[test]
fn uneven_gaps_are_refused_with_their_lengths_or_resampled() {
    let places = [0.0, 1.0, 2.0, 4.0, 5.0, 8.5];
    let slices = || (0..).zip(places).map(|(k, z)| Made::at(k, z));
    let folder = Folder::of(slices());
    let refused = folder.refused(&plain());
    for word in [
        "1.00 mm from slice 0 to 2",
        "2.00 mm from slice 2 to 3 (1 missing",
        "3.50 mm from slice 4 to 5",
        "--resample-gaps",
    ] {
        assert!(refused.contains(word), "{word} in {refused}");
    }
    let resample = OpenOptions {
        resample_gaps: true,
        ..plain()
    };
    // 8.5 steps of the least gap are nine, or eight: whole ones.
    let mut stack = folder.open(&resample).unwrap();
    let count = stack.desc().dims.z;
    let step = 8.5 / (count - 1) as f64;
    assert!((stack.desc().spacing().z - step).abs() < 1e-12 && (0.9..1.1).contains(&step));
    let found = voxels(&mut stack);
    for z in 0..count {
        let mm = step * z as f64;
        let k = places.iter().rposition(|&p| p <= mm + 1e-9).unwrap().min(4);
        let share = (mm - places[k]) / (places[k + 1] - places[k]);
        let expected = (10.0 * (k as f64 + share)).round();
        assert!((found[6 * z as usize] - expected).abs() <= 1.0, "slice {z}");
    }
    assert!(
        stack.notes().iter().any(|n| n.contains("resampled to")),
        "{:?}",
        stack.notes()
    );
}

#[test]
fn a_tilted_gantry_shears_the_affine() {
    let slices = (0..4).map(|k| Made {
        position: format!("10\\{}\\{}", -20.0 + f64::from(k), 3.0 * f64::from(k)),
        ..Made::slice(k)
    });
    let stack = Folder::of(slices).open(&plain()).unwrap();
    let z = stack.desc().world_from_index.matrix3.z_axis;
    assert!(z.distance(DVec3::new(0.0, -1.0, 3.0)) < 1e-9, "{z}");
    assert!(
        stack.notes()[0].contains("18.43 degrees"),
        "{:?}",
        stack.notes()
    );
    let crooked = (0..4).map(|k| Made {
        position: format!("{}\\0\\{}", (k * k) as f64, 3.0 * f64::from(k)),
        ..Made::slice(k)
    });
    assert!(Folder::of(crooked).refused(&plain()).contains("on a line"));
}

#[test]
fn double_slices_and_several_volumes_are_told() {
    let mut slices: Vec<Made> = (0..3).map(Made::slice).collect();
    slices.push(Made::slice(1));
    let refused = Folder::of(slices).refused(&plain());
    assert!(refused.contains("f1, f3"), "{refused}");
    let timed = (0..3).flat_map(|k| {
        [2, 0, 1].map(|t| Made {
            time: Some(t + 1),
            pixels: vec![t as u8; 12],
            ..Made::slice(k)
        })
    });
    let folder = Folder::of(timed);
    let refused = folder.refused(&plain());
    assert!(
        refused.contains("3 volumes") && refused.contains("--time"),
        "{refused}"
    );
    for time in 0..3 {
        let options = OpenOptions {
            time: Some(time),
            ..plain()
        };
        let mut stack = folder.open(&options).unwrap();
        let value = f64::from(time as u32 * 257);
        assert!(
            voxels(&mut stack).iter().all(|&v| v == value),
            "volume {time}"
        );
    }
    let options = OpenOptions {
        time: Some(3),
        ..plain()
    };
    assert!(folder.refused(&options).contains("from 0 to 2"));
}

#[test]
fn series_are_listed_and_chosen_and_scouts_left_out() {
    let of = |series, k| Made {
        series,
        ..Made::slice(k)
    };
    let folder = Folder::of(
        (0..3)
            .map(|k| of("1.2.3", k))
            .chain((0..2).map(|k| of("1.2.44", k))),
    );
    let refused = folder.refused(&plain());
    assert!(
        refused.contains("1.2.3 (CT, 3 pictures") && refused.contains("1.2.44 (CT, 2"),
        "{refused}"
    );
    let chosen = |series: &str| OpenOptions {
        series: Some(series.into()),
        ..plain()
    };
    for (series, slices) in [("1.2.44", 2), ("44", 2), ("1.2.3", 3)] {
        let stack = folder.open(&chosen(series)).unwrap();
        assert_eq!(stack.desc().dims.z, slices, "{series}");
    }
    assert!(
        folder.refused(&chosen("4")).contains("1.2.44"),
        "no part of a number"
    );
    let scout = Made {
        orientation: "0\\1\\0\\0\\0\\-1",
        ..Made::slice(9)
    };
    let folder = Folder::of((0..3).map(Made::slice).chain([scout.clone()]));
    let stack = folder.open(&plain()).unwrap();
    assert_eq!(stack.desc().dims.z, 3);
    assert!(stack.notes()[0].contains("left out"), "{:?}", stack.notes());
    let mixed = Folder::of([Made::slice(0), scout]);
    assert!(mixed.refused(&plain()).contains("several kinds"));
}

#[test]
fn each_slice_may_have_its_own_rescale() {
    let slices = (0..3).map(|k| Made {
        rescale: [1.0 + f64::from(k), 0.5],
        ..Made::slice(k)
    });
    let folder = Folder::of(slices);
    let mut stack = folder.open(&plain()).unwrap();
    assert_eq!(stack.desc().voxel_type, VoxelType::F32);
    assert_eq!(stack.desc().rescale, Rescale::IDENTITY);
    let found = voxels(&mut stack);
    assert_eq!([found[0], found[7], found[17]], [0.5, 22.5, 75.5]);
}

#[test]
fn unused_bits_are_cut_off_and_signs_carried_on() {
    for (is_signed, stored, expected) in [
        (true, 0xf7ff_u16, 0x07ff_i32),
        (true, 0x0800, -2048),
        (false, 0xf801, 0x0801),
    ] {
        let slice = Made {
            bits: [16, 12, 11],
            is_signed,
            pixels: stored.to_le_bytes().repeat(6),
            ..Made::slice(0)
        };
        let folder = Folder::of([slice]);
        let mut stack = folder.open(&plain()).unwrap();
        assert_eq!(voxels(&mut stack), [f64::from(expected); 6], "{stored:x}");
    }
}

#[test]
fn compressed_pictures_come_out_exact() {
    let made = |syntax, pixels| Made {
        syntax,
        size: [14, 10],
        is_signed: false,
        pixels,
        ..Made::slice(0)
    };
    let expected: Vec<f64> = (0..10)
        .flat_map(|y| (0..14).map(move |x| f64::from(pixel(x, y))))
        .collect();
    for (syntax, text, most) in [
        ("1.2.840.10008.1.2.4.80", JPEG_LS, 0.0),
        ("1.2.840.10008.1.2.4.81", JPEG_LS_NEAR, 2.0),
        ("1.2.840.10008.1.2.4.90", JPEG_2000, 0.0),
    ] {
        let folder = Folder::of([made(syntax, hex(text))]);
        let mut stack = folder.open(&plain()).unwrap();
        let found = voxels(&mut stack);
        let worst = found
            .iter()
            .zip(&expected)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(worst <= most, "{syntax}: {worst}");
    }
    // Two segments, of the high and the low bytes: runs, and literal bytes.
    let mut rle = vec![0; 64];
    rle[..12].copy_from_slice(&[2, 0, 0, 0, 64, 0, 0, 0, 66, 0, 0, 0]);
    rle.extend([251, 1, 5, 0, 1, 2, 3, 4, 5, 0]);
    let slice = Made {
        syntax: "1.2.840.10008.1.2.5",
        pixels: rle,
        ..Made::slice(0)
    };
    let folder = Folder::of([slice]);
    let mut stack = folder.open(&plain()).unwrap();
    assert_eq!(
        voxels(&mut stack),
        [256.0, 257.0, 258.0, 259.0, 260.0, 261.0]
    );
}

/// Four frames in a file, from the head downwards.
fn enhanced() -> Made {
    let frames: Vec<Vec<u8>> = (0..4)
        .map(|k| {
            let position = element(
                (0x20, 0x32),
                "DS",
                format!("1\\2\\{}", 9 - 3 * k).as_bytes(),
            );
            sequence((0x20, 0x9113), &[position])
        })
        .collect();
    let orientation = element((0x20, 0x37), "DS", b"1\\0\\0\\0\\1\\0");
    let values = [
        element((0x28, 0x1052), "DS", b"-7"),
        element((0x28, 0x1053), "DS", b"2"),
    ];
    let shared = [
        sequence((0x20, 0x9116), &[orientation]),
        sequence((0x28, 0x9110), &[element((0x28, 0x30), "DS", b"0.5\\0.25")]),
        sequence((0x28, 0x9145), &[values.concat()]),
    ];
    let more = [
        sequence((0x5200, 0x9229), &[shared.concat()]),
        sequence((0x5200, 0x9230), &frames),
    ];
    Made {
        frames: Some(4),
        more: more.concat(),
        pixels: (0..24_u16).flat_map(u16::to_le_bytes).collect(),
        ..Made::slice(0)
    }
}

#[test]
fn frames_of_one_file_are_slices() {
    let folder = Folder::of([enhanced()]);
    let mut stack = folder.open(&plain()).unwrap();
    let desc = stack.desc().clone();
    assert_eq!(desc.dims.z, 4);
    assert_eq!((desc.rescale.slope, desc.rescale.intercept), (2.0, -7.0));
    let found = voxels(&mut stack);
    assert_eq!(
        [found[0], found[6], found[23]],
        [18.0, 12.0, 5.0],
        "from the feet upwards"
    );
    let m = desc.world_from_index;
    assert_eq!(m.translation, DVec3::new(-1.0, -2.0, 0.0));
    assert_eq!(desc.spacing(), DVec3::new(0.25, 0.5, 3.0));
}

#[test]
fn what_is_no_grey_picture_is_refused_by_name() {
    for (made, word) in [
        (
            Made {
                class: "1.2.840.10008.5.1.4.1.1.66.4",
                ..Made::slice(0)
            },
            "DICOM-SEG",
        ),
        (
            Made {
                samples: 3,
                photometric: "RGB",
                ..Made::slice(0)
            },
            "colour",
        ),
        (
            Made {
                photometric: "PALETTE COLOR",
                ..Made::slice(0)
            },
            "colour",
        ),
        (
            Made {
                bits: [1, 1, 0],
                ..Made::slice(0)
            },
            "pixels of 1 bits",
        ),
        (
            Made {
                pixels: vec![0; 8],
                ..Made::slice(0)
            },
            "12 bytes",
        ),
        (
            Made {
                syntax: "1.2.3.4",
                ..Made::slice(0)
            },
            "transfer syntax 1.2.3.4",
        ),
    ] {
        let refused = Folder::of([made]).refused(&plain());
        assert!(refused.contains(word), "{word} in {refused}");
    }
    // Beside pictures they are left out.
    let report = Made {
        class: "1.2.840.10008.5.1.4.1.1.88.11",
        ..Made::slice(0)
    };
    let stack = Folder::of([Made::slice(0), report, Made::slice(1)])
        .open(&plain())
        .unwrap();
    assert_eq!(stack.desc().dims.z, 2);
    assert!(
        stack.notes()[0].contains("structured report"),
        "{:?}",
        stack.notes()
    );
}

#[test]
fn a_directory_names_its_files() {
    let folder = Folder::of([Made::slice(0), Made::slice(1), Made::slice(2)]);
    let record = |name: &str| {
        [
            element((4, 0x1430), "CS", b"IMAGE"),
            element((4, 0x1500), "CS", name.as_bytes()),
        ]
        .concat()
    };
    let directory = |names: &[&str]| {
        let records: Vec<Vec<u8>> = names.iter().map(|n| record(n)).collect();
        let mut bytes = vec![0; 128];
        bytes.extend(b"DICM");
        let syntax = element((2, 0x10), "UI", b"1.2.840.10008.1.2.1");
        bytes.extend(element((2, 0), "UL", &(syntax.len() as u32).to_le_bytes()));
        bytes.extend(syntax);
        bytes.extend(sequence((4, 0x1220), &records));
        let path = folder.0.path().join("DICOMDIR");
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let read = |path: &Path| files_of_dicomdir(&Subject::new(path));
    let files = read(&directory(&["F0", "F2"])).unwrap().unwrap();
    assert_eq!(
        files,
        ["f0", "f2"].map(|n| folder.0.path().join(n)),
        "in small letters, too"
    );
    for wrong in ["F9", "..\\F0", "a/b"] {
        assert!(read(&directory(&[wrong])).is_err(), "{wrong}");
    }
    assert!(read(&folder.files()[0]).is_ok_and(|f| f.is_none()) || folder.files().len() == 4);
}

/// Opens and reads whatever the bytes are: nothing but an error may come of it.
fn survives(files: &[Vec<u8>]) {
    let dir = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for (n, bytes) in files.iter().enumerate() {
        let path = dir.path().join(n.to_string());
        std::fs::write(&path, bytes).unwrap();
        paths.push(path);
    }
    if let Ok(mut stack) = open(&paths, &Subject::new(dir.path()), &plain()) {
        let desc = stack.desc().clone();
        let bytes = desc.byte_count().unwrap_or(u64::MAX);
        if bytes <= 1 << 24 {
            let mut out = vec![0; bytes as usize];
            let _ = stack.read_box(VoxelBox::whole(desc.dims), &mut out);
        }
    }
}

fn samples() -> Vec<Vec<u8>> {
    let compressed = |syntax, text| Made {
        syntax,
        size: [14, 10],
        is_signed: false,
        pixels: hex(text),
        ..Made::slice(0)
    };
    vec![
        Made::slice(0).bytes(),
        enhanced().bytes(),
        compressed("1.2.840.10008.1.2.4.80", JPEG_LS).bytes(),
        compressed("1.2.840.10008.1.2.4.90", JPEG_2000).bytes(),
    ]
}

#[test]
fn files_cut_anywhere_are_refused_or_read() {
    for bytes in samples() {
        for end in (128..bytes.len()).step_by(3) {
            survives(&[bytes[..end].to_vec()]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        which in 0_usize..4,
        changes in prop::collection::vec((128_usize..1200, any::<u8>()), 1..6),
    ) {
        let mut bytes = samples().swap_remove(which);
        for (at, byte) in changes {
            let at = at % bytes.len();
            bytes[at] = byte;
        }
        survives(&[bytes]);
    }
}
