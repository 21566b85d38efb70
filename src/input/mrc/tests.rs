//! Files made here, in both byte orders; damaged ones are refused without a panic.

use std::io::Write;

use flate2::write::GzEncoder;
use glam::{DAffine3, DVec3};
use half::f16;
use proptest::prelude::*;

use super::*;
use crate::geom::VoxelBox;

/// A file of 3 × 2 × 4 voxels of i16, counting up from −2.
#[derive(Clone)]
struct Sample {
    bytes: Vec<u8>,
    big: bool,
}

impl Sample {
    fn new(big: bool) -> Self {
        let mut sample = Self {
            bytes: vec![0; HEADER_BYTES],
            big,
        };
        for (i, n) in [3, 2, 4, 1, 0, 0, 0, 3, 2, 4].into_iter().enumerate() {
            sample.int(i, n);
        }
        for (i, v) in [6.0, 6.0, 16.0, 90.0, 90.0, 90.0].into_iter().enumerate() {
            sample.real(CELL + i, v);
        }
        for (i, n) in [1, 2, 3].into_iter().enumerate() {
            sample.int(AXES + i, n);
        }
        sample.int(SPACE_GROUP, 1);
        sample.bytes[4 * MAP..4 * MAP + 4].copy_from_slice(b"MAP ");
        let stamp = if big { [0x11, 0x11] } else { [0x44, 0x44] };
        sample.bytes[4 * MACHINE..4 * MACHINE + 2].copy_from_slice(&stamp);
        for v in -2i16..22 {
            sample.voxel(v.to_le_bytes());
        }
        sample
    }

    fn voxel(&mut self, mut le: [u8; 2]) {
        if self.big {
            le.reverse();
        }
        self.bytes.extend(le);
    }

    fn word(&mut self, word: usize, mut le: [u8; 4]) {
        if self.big {
            le.reverse();
        }
        self.bytes[4 * word..4 * word + 4].copy_from_slice(&le);
    }

    fn int(&mut self, word: usize, v: i32) {
        self.word(word, v.to_le_bytes());
    }

    fn real(&mut self, word: usize, v: f32) {
        self.word(word, v.to_le_bytes());
    }

    fn open(&self, compressed: bool, time: Option<u64>) -> Result<Read, SourceError> {
        let bytes = if compressed {
            gzip(&self.bytes)
        } else {
            self.bytes.clone()
        };
        read(&bytes, compressed, time)
    }

    fn refused(&self) -> String {
        let error = self.open(false, Some(0)).err();
        error.map(|e| e.to_string()).unwrap_or_default()
    }
}

type Read = (VolumeDesc, Vec<u8>, Vec<String>);

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

fn source(
    bytes: &[u8],
    compressed: bool,
    time: Option<u64>,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let options = OpenOptions {
        time,
        ..OpenOptions::default()
    };
    open(file.path(), compressed, &options)
}

fn read(bytes: &[u8], compressed: bool, time: Option<u64>) -> Result<Read, SourceError> {
    let mut source = source(bytes, compressed, time)?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
    Ok((desc, out, source.notes()))
}

fn counted(from: i16, n: i16) -> Vec<u8> {
    (from..from + n).flat_map(i16::to_le_bytes).collect()
}

#[test]
fn both_byte_orders_in_millimetres() {
    for big in [false, true] {
        let mut sample = Sample::new(big);
        for compressed in [false, true] {
            let (desc, voxels, notes) = sample.open(compressed, None).unwrap();
            assert_eq!(voxels, counted(-2, 24), "voxels");
            assert_eq!(desc.voxel_type, VoxelType::I16, "type");
            let expected = DAffine3::from_scale(DVec3::new(2e-7, 3e-7, 4e-7));
            assert!(desc.world_from_index.abs_diff_eq(expected, 1e-15), "place");
            assert!(
                notes[0].contains("2.000000 × 3.000000 × 4.000000 Å"),
                "{notes:?}"
            );
        }
        // A wrong stamp: only the right order makes sense.
        sample.bytes[4 * MACHINE..4 * MACHINE + 2].copy_from_slice(&[0, 0]);
        assert_eq!(
            sample.open(false, None).unwrap().1,
            counted(-2, 24),
            "no stamp"
        );
        sample.int(EXTENDED_BYTES, 4);
        sample.bytes.extend([0, 0]);
        assert!(
            sample.open(false, None).is_err(),
            "an extended header too long"
        );
        sample.int(EXTENDED_BYTES, 2);
        assert_eq!(
            sample.open(false, None).unwrap().1[..44],
            counted(-1, 22),
            "behind it"
        );
    }
}

#[test]
fn axes_and_angles_and_origins() {
    let mut sample = Sample::new(true);
    for (i, n) in [3, 1, 2].into_iter().enumerate() {
        sample.int(AXES + i, n);
        sample.int(START + i, i as i32 + 1);
    }
    let (desc, _, _) = sample.open(false, None).unwrap();
    let m = desc.world_from_index;
    assert!(
        m.matrix3.x_axis.abs_diff_eq(DVec3::Z * 4e-7, 1e-15),
        "columns along z"
    );
    assert!(
        m.matrix3.y_axis.abs_diff_eq(DVec3::X * 2e-7, 1e-15),
        "rows along x"
    );
    assert!(
        m.translation
            .abs_diff_eq(DVec3::new(4e-7, 9e-7, 4e-7), 1e-15),
        "starts count along the file's axes"
    );
    sample.real(ORIGIN + 1, -5.0);
    let (desc, _, _) = sample.open(false, None).unwrap();
    assert!(
        desc.world_from_index
            .translation
            .abs_diff_eq(DVec3::Y * -5e-7, 1e-15),
        "an origin goes before"
    );
    for (i, v) in [80.0, 95.0, 110.0].into_iter().enumerate() {
        sample.real(ANGLES + i, v);
    }
    let (desc, _, _) = sample.open(false, None).unwrap();
    let m = desc.world_from_index.matrix3;
    // Columns, rows and sections run along c, a and b.
    for (a, b, degrees) in [
        (m.z_axis, m.x_axis, 80.0f64),
        (m.y_axis, m.x_axis, 95.0),
        (m.y_axis, m.z_axis, 110.0),
    ] {
        let angle = a.angle_between(b).to_degrees();
        assert!((angle - degrees).abs() < 1e-6, "{angle} is not {degrees}");
    }
    sample.real(ANGLES, 10.0);
    assert!(sample.refused().contains("CELLB"), "{}", sample.refused());
}

#[test]
fn a_cell_without_size_leaves_the_spacing_open() {
    let mut sample = Sample::new(false);
    for i in 0..3 {
        sample.real(CELL + i, 0.0);
    }
    let (desc, _, notes) = sample.open(false, None).unwrap();
    assert_eq!(desc.spacing(), DVec3::ONE, "1 mm");
    assert!(notes[0].contains("--spacing"), "{notes:?}");
}

#[test]
fn modes() {
    let mut sample = Sample::new(false);
    sample.int(0, 6);
    sample.int(INTERVALS, 6);
    sample.int(MODE, 0);
    assert_eq!(
        sample.open(false, None).unwrap().0.voxel_type,
        VoxelType::I8,
        "mode 0"
    );
    sample.int(IMOD_STAMP, IMOD);
    assert_eq!(
        sample.open(false, None).unwrap().0.voxel_type,
        VoxelType::U8,
        "IMOD"
    );
    sample.int(IMOD_FLAGS, 1);
    assert_eq!(
        sample.open(false, None).unwrap().0.voxel_type,
        VoxelType::I8,
        "signed"
    );
    for (mode, word) in [(4, "complex"), (101, "4 bits"), (16, "RGB"), (55, "MODE")] {
        sample.int(MODE, mode);
        assert!(sample.refused().contains(word), "{}", sample.refused());
    }
}

#[test]
fn half_floats_become_floats() {
    for big in [false, true] {
        let mut sample = Sample::new(big);
        sample.int(MODE, 12);
        sample.bytes.truncate(HEADER_BYTES);
        let values: Vec<f32> = (0..24).map(|i| i as f32 * 0.375 - 3.0).collect();
        for &v in &values {
            sample.voxel(f16::from_f32(v).to_le_bytes());
        }
        for compressed in [false, true] {
            let (desc, voxels, _) = sample.open(compressed, None).unwrap();
            assert_eq!(desc.voxel_type, VoxelType::F32, "type");
            let expected: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            assert_eq!(voxels, expected, "values");
        }
        let mut source = source(&sample.bytes, false, None).unwrap();
        let one = VoxelBox::new(U64Vec3::new(2, 1, 3), U64Vec3::new(3, 2, 4));
        let mut out = [0; 4];
        source.read_box(one, &mut out).unwrap();
        assert_eq!(f32::from_le_bytes(out), values[23], "one voxel alone");
    }
}

#[test]
fn stacks_of_volumes_and_images() {
    let mut sample = Sample::new(false);
    sample.int(SPACE_GROUP, 401);
    sample.int(INTERVALS + 2, 2);
    for compressed in [false, true] {
        for (time, from) in [(0, -2), (1, 10)] {
            let (desc, voxels, _) = sample.open(compressed, Some(time)).unwrap();
            assert_eq!(desc.dims, U64Vec3::new(3, 2, 2), "dims");
            assert_eq!(voxels, counted(from, 12), "volume {time}");
        }
        let error = sample.open(compressed, None).err().unwrap().to_string();
        assert!(error.contains("--time N"), "{error}");
    }
    sample.int(INTERVALS + 2, 3);
    assert!(sample.refused().contains("MZ"), "{}", sample.refused());
    sample.int(SPACE_GROUP, 0);
    sample.int(INTERVALS + 2, 1);
    let (_, _, notes) = sample.open(false, None).unwrap();
    assert!(notes[0].contains("stack of 4 images"), "{notes:?}");
}

#[test]
fn wrong_fields_are_named() {
    type Change = fn(&mut Sample);
    let cases: [(&str, Change); 6] = [
        ("NX, NY, NZ", |s| s.int(1, 0)),
        ("MAPC, MAPR, MAPS", |s| s.int(AXES, 2)),
        ("NSYMBT", |s| s.int(EXTENDED_BYTES, -1)),
        ("CELLA y ÷ MY", |s| s.int(INTERVALS + 1, 0)),
        ("CELLA x ÷ MX", |s| s.real(CELL, f32::NAN)),
        ("the voxels", |s| s.int(2, i32::MAX)),
    ];
    for (word, change) in cases {
        for big in [false, true] {
            let mut sample = Sample::new(big);
            change(&mut sample);
            assert!(
                sample.refused().contains(word),
                "{word}: {}",
                sample.refused()
            );
        }
    }
}

#[test]
fn a_cut_file_is_refused_at_every_length() {
    let sample = Sample::new(true);
    let packed = gzip(&sample.bytes);
    for n in 0..sample.bytes.len() {
        assert!(read(&sample.bytes[..n], false, None).is_err(), "{n} bytes");
    }
    for n in 0..packed.len() {
        assert!(read(&packed[..n], true, None).is_err(), "{n} bytes of gzip");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        big: bool,
        compressed: bool,
        changes in prop::collection::vec((0usize..224, any::<u8>()), 1..6),
        cut in 0usize..1100,
    ) {
        let mut sample = Sample::new(big);
        for (at, value) in changes {
            sample.bytes[at] = value;
        }
        sample.bytes.truncate(cut.max(20));
        let _ = is_header(&sample.bytes);
        let bytes = if compressed { gzip(&sample.bytes) } else { sample.bytes };
        let _ = source(&bytes, compressed, Some(0));
    }
}
