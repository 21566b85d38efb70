//! Headers made here, in both versions and byte orders; damaged ones are refused without a panic.

use std::io::Write;

use flate2::write::GzEncoder;
use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use proptest::prelude::*;

use super::header::{Layout, NIFTI_1, NIFTI_2};
use super::*;
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, VoxelSource};

/// A file of 3 × 2 × 2 voxels of i16, counting up from −2.
struct Sample {
    bytes: Vec<u8>,
    layout: &'static Layout,
    big: bool,
}

impl Sample {
    fn new(layout: &'static Layout, big: bool) -> Self {
        let bytes = vec![0; layout.header_bytes + 4];
        let mut sample = Self { bytes, layout, big };
        sample.put(0, &(layout.header_bytes as u32).to_le_bytes());
        let magic: &[u8] = if layout.wide {
            b"n+2\0\r\n\x1a\n"
        } else {
            b"n+1\0"
        };
        sample.bytes[layout.magic..layout.magic + magic.len()].copy_from_slice(magic);
        for (i, n) in [3, 3, 2, 2, 1, 1, 1, 1].into_iter().enumerate() {
            sample.int(layout.dim, i, n);
        }
        sample.put(layout.datatype, &4i16.to_le_bytes());
        for (i, v) in [1.0, 2.0, 3.0, 4.0].into_iter().enumerate() {
            sample.real(layout.pixdim, i, v);
        }
        if layout.wide {
            sample.int(layout.vox_offset, 0, 544);
        } else {
            sample.real(layout.vox_offset, 0, 352.0);
        }
        for v in -2i16..10 {
            let v = if big {
                v.to_be_bytes()
            } else {
                v.to_le_bytes()
            };
            sample.bytes.extend(v);
        }
        sample
    }

    fn put(&mut self, at: usize, le: &[u8]) {
        let target = &mut self.bytes[at..at + le.len()];
        target.copy_from_slice(le);
        if self.big {
            target.reverse();
        }
    }

    fn int(&mut self, at: usize, i: usize, v: i64) {
        if self.layout.wide {
            self.put(at + 8 * i, &v.to_le_bytes());
        } else {
            self.put(at + 2 * i, &(v as i16).to_le_bytes());
        }
    }

    fn code(&mut self, i: usize, v: i16) {
        let at = self.layout.qform_code;
        if self.layout.wide {
            self.put(at + 4 * i, &i32::from(v).to_le_bytes());
        } else {
            self.put(at + 2 * i, &v.to_le_bytes());
        }
    }

    fn units(&mut self, v: u8) {
        if self.layout.wide {
            self.put(self.layout.xyzt_units, &u32::from(v).to_le_bytes());
        } else {
            self.bytes[self.layout.xyzt_units] = v;
        }
    }

    fn real(&mut self, at: usize, i: usize, v: f64) {
        if self.layout.wide {
            self.put(at + 8 * i, &v.to_le_bytes());
        } else {
            self.put(at + 4 * i, &(v as f32).to_le_bytes());
        }
    }

    fn open(&self, compressed: bool) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
        let bytes = if compressed {
            gzip(&self.bytes)
        } else {
            self.bytes.clone()
        };
        read(&bytes, compressed)
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    e.write_all(bytes).unwrap();
    e.finish().unwrap()
}

/// Opens and reads all of a file that holds `bytes`.
fn read(bytes: &[u8], compressed: bool) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    read_chosen(bytes, compressed, &OpenOptions::default())
}

/// As [`read`], of the volume that `options` choose.
fn read_chosen(
    bytes: &[u8],
    compressed: bool,
    options: &OpenOptions,
) -> Result<(VolumeDesc, Vec<u8>), SourceError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let mut source = open(file.path(), compressed, options)?;
    let desc = source.desc().clone();
    let mut out = vec![0; desc.byte_count().unwrap() as usize];
    let mut whole = VoxelBox::whole(desc.dims);
    let slice = out.len() / desc.dims.z as usize;
    for (z, bytes) in out.chunks_mut(slice).enumerate() {
        (whole.min.z, whole.max.z) = (z as u64, z as u64 + 1);
        source.read_box(whole, bytes)?;
    }
    let expected = if compressed {
        ReadOrder::ForwardZ
    } else {
        ReadOrder::Random
    };
    assert_eq!(source.order(), expected, "order");
    Ok((desc, out))
}

fn samples() -> impl Iterator<Item = Sample> {
    [
        (&NIFTI_1, false),
        (&NIFTI_1, true),
        (&NIFTI_2, false),
        (&NIFTI_2, true),
    ]
    .into_iter()
    .map(|(layout, big)| Sample::new(layout, big))
}

#[test]
fn both_versions_in_both_byte_orders() {
    let expected: Vec<u8> = (-2i16..10).flat_map(i16::to_le_bytes).collect();
    for mut sample in samples() {
        let scl = sample.layout.scl;
        sample.real(scl, 0, 0.5);
        sample.real(scl, 1, -7.0);
        for compressed in [false, true] {
            let (desc, voxels) = sample.open(compressed).unwrap();
            assert_eq!(voxels, expected, "voxels");
            assert_eq!(desc.dims, U64Vec3::new(3, 2, 2), "dims");
            assert_eq!(desc.voxel_type, VoxelType::I16, "type");
            let rescale = Rescale {
                slope: 0.5,
                intercept: -7.0,
            };
            assert_eq!(desc.rescale, rescale, "rescale");
            assert_eq!(
                desc.world_from_index,
                DAffine3::from_scale(DVec3::new(2.0, 3.0, 4.0)),
                "no form: spacing alone"
            );
        }
    }
}

#[test]
fn sform_wins_over_qform_and_units_become_millimetres() {
    for mut sample in samples() {
        let layout = sample.layout;
        // A quarter turn about z, z flipped, origin 10, 20, 30.
        sample.code(0, 1);
        sample.real(layout.pixdim, 0, -1.0);
        for (i, v) in [0.0, 0.0, 0.5f64.sqrt(), 10.0, 20.0, 30.0]
            .into_iter()
            .enumerate()
        {
            sample.real(layout.quatern, i, v);
        }
        let (desc, _) = sample.open(false).unwrap();
        let expected = DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::new(0.0, 2.0, 0.0),
                DVec3::new(-3.0, 0.0, 0.0),
                DVec3::new(0.0, 0.0, -4.0),
            ),
            DVec3::new(10.0, 20.0, 30.0),
        );
        assert!(
            desc.world_from_index.abs_diff_eq(expected, 1e-5),
            "qform: {}",
            desc.world_from_index
        );

        sample.code(1, 2);
        let rows = [0.0, 0.0, 8.0, 1.0, 4.0, 0.0, 0.0, 2.0, 0.0, -2.0, 0.0, 3.0];
        for (i, v) in rows.into_iter().enumerate() {
            sample.real(layout.srow, i, v);
        }
        for (unit, mm) in [(0, 1.0), (1, 1000.0), (2, 1.0), (3, 0.001), (10, 1.0)] {
            sample.units(unit);
            let (desc, _) = sample.open(true).unwrap();
            let expected = DAffine3::from_mat3_translation(
                DMat3::from_cols(DVec3::Y * 4.0, DVec3::Z * -2.0, DVec3::X * 8.0) * mm,
                DVec3::new(1.0, 2.0, 3.0) * mm,
            );
            assert_eq!(desc.world_from_index, expected, "sform in unit {unit}");
        }
    }
}

#[test]
fn what_is_not_built_is_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Sample), word: &str| {
        for mut sample in samples() {
            change(&mut sample);
            let error = sample.open(false).err().map(|e| e.to_string());
            assert!(
                error
                    .as_ref()
                    .is_some_and(|e| e.contains(word) && e.contains("supported")),
                "{word}: {error:?}"
            );
        }
    };
    refused(
        &|s| {
            let dim = s.layout.dim;
            s.int(dim, 0, 6);
            s.int(dim, 6, 5);
        },
        "6-D data",
    );
    refused(&|s| s.put(s.layout.datatype, &128i16.to_le_bytes()), "RGB");
    refused(
        &|s| s.put(s.layout.datatype, &32i16.to_le_bytes()),
        "complex",
    );
}

#[test]
fn one_of_several_volumes_is_chosen() {
    for mut sample in samples() {
        let dim = sample.layout.dim;
        sample.int(dim, 0, 5);
        sample.int(dim, 3, 1);
        sample.int(dim, 4, 2);
        // Two slices become two points in time; two channels need as many voxels again.
        sample.int(dim, 5, 2);
        let first = sample.bytes.len() - 24;
        let more: Vec<u8> = sample.bytes[first..].iter().map(|b| !b).collect();
        sample.bytes.extend(more);
        for compressed in [false, true] {
            let bytes = if compressed {
                gzip(&sample.bytes)
            } else {
                sample.bytes.clone()
            };
            let chosen = |time, channel| {
                let options = OpenOptions {
                    time,
                    channel,
                    ..OpenOptions::default()
                };
                read_chosen(&bytes, compressed, &options)
                    .map(|(_, voxels)| voxels)
                    .map_err(|e| e.to_string())
            };
            let of = |from: i16| -> Vec<u8> {
                let voxels = from..from + 6;
                voxels.flat_map(i16::to_le_bytes).collect()
            };
            let inverted = |from| -> Vec<u8> { of(from).iter().map(|b| !b).collect() };
            assert_eq!(chosen(Some(0), Some(0)), Ok(of(-2)), "the first volume");
            assert_eq!(
                chosen(Some(1), Some(0)),
                Ok(of(4)),
                "the second point in time"
            );
            assert_eq!(
                chosen(Some(0), Some(1)),
                Ok(inverted(-2)),
                "the second channel"
            );
            assert_eq!(chosen(Some(1), Some(1)), Ok(inverted(4)), "the last volume");
            for (time, channel, word) in [
                (None, Some(0), "--time N"),
                (Some(0), None, "--channel N"),
                (Some(2), Some(0), "0 to 1, found 2"),
            ] {
                let error = chosen(time, channel).unwrap_err();
                assert!(error.contains(word), "{word}: {error}");
            }
        }
        sample.int(
            dim,
            4,
            if sample.layout.wide {
                i64::MAX
            } else {
                i64::from(i16::MAX)
            },
        );
        let options = OpenOptions {
            time: Some(30_000),
            channel: Some(1),
            ..OpenOptions::default()
        };
        for compressed in [false, true] {
            let bytes = if compressed {
                gzip(&sample.bytes)
            } else {
                sample.bytes.clone()
            };
            assert!(
                read_chosen(&bytes, compressed, &options).is_err(),
                "a volume beyond the end"
            );
        }
    }
}

#[test]
fn pairs_have_their_voxels_in_another_file() {
    let dir = tempfile::tempdir().unwrap();
    for mut sample in samples() {
        let layout = sample.layout;
        sample.bytes[layout.magic + 1] = b'i';
        let voxels = sample.bytes.split_off(layout.header_bytes + 4);
        if layout.wide {
            sample.int(layout.vox_offset, 0, 16);
        } else {
            sample.real(layout.vox_offset, 0, 16.0);
        }
        let image: Vec<u8> = [7; 16].into_iter().chain(voxels).collect();
        let header = dir.path().join("a.hdr");
        std::fs::write(&header, &sample.bytes).unwrap();
        let options = OpenOptions::default();
        let error = open(&header, false, &options).err().unwrap().to_string();
        assert!(error.contains("a.img"), "missing: {error}");

        std::fs::write(dir.path().join("a.img"), &image).unwrap();
        let mut source = open(&header, false, &options).unwrap();
        let mut out = vec![0; 24];
        source
            .read_box(VoxelBox::whole(source.desc().dims), &mut out)
            .unwrap();
        let expected: Vec<u8> = (-2i16..10).flat_map(i16::to_le_bytes).collect();
        assert_eq!(out, expected, "voxels");

        std::fs::write(dir.path().join("a.img"), &image[..30]).unwrap();
        let error = open(&header, false, &options).err().unwrap().to_string();
        assert!(
            error.contains("a.img") && error.contains("30 bytes"),
            "short: {error}"
        );
        std::fs::remove_file(dir.path().join("a.img")).unwrap();
    }
}

#[test]
fn stamps_tell_the_volumes_of_a_file_apart() {
    let mut sample = Sample::new(&NIFTI_1, false);
    sample.int(NIFTI_1.dim, 0, 4);
    sample.int(NIFTI_1.dim, 3, 1);
    sample.int(NIFTI_1.dim, 4, 2);
    let file = tempfile::NamedTempFile::new().unwrap();
    for (compressed, bytes) in [(false, sample.bytes.clone()), (true, gzip(&sample.bytes))] {
        std::fs::write(file.path(), bytes).unwrap();
        let stamp = |time| {
            let options = OpenOptions {
                time: Some(time),
                ..OpenOptions::default()
            };
            open(file.path(), compressed, &options).unwrap().stamp()
        };
        assert_ne!(
            stamp(0),
            stamp(1),
            "a store begun with one is not gone on with the other"
        );
    }
}

#[test]
fn a_cut_file_is_refused_at_every_length() {
    for sample in samples() {
        for n in 0..sample.bytes.len() {
            assert!(read(&sample.bytes[..n], false).is_err(), "{n} bytes");
        }
        let packed = gzip(&sample.bytes);
        for n in 0..packed.len() {
            assert!(read(&packed[..n], true).is_err(), "{n} bytes of gzip");
        }
    }
}

#[test]
fn wrong_fields_are_named() {
    type Change = fn(&mut Sample);
    let cases: [(&str, Change); 8] = [
        ("dim[2]", |s| s.int(s.layout.dim, 2, -3)),
        ("dim[0]", |s| s.int(s.layout.dim, 0, 9)),
        ("datatype", |s| {
            s.put(s.layout.datatype, &77i16.to_le_bytes())
        }),
        ("pixdim[1]", |s| s.real(s.layout.pixdim, 1, f64::NAN)),
        ("pixdim[3]", |s| s.real(s.layout.pixdim, 3, 0.0)),
        ("srow", |s| s.code(1, 1)),
        ("scl_slope", |s| s.real(s.layout.scl, 0, f64::INFINITY)),
        ("magic", |s| s.bytes[s.layout.magic] = b'x'),
    ];
    for (field, change) in cases {
        for mut sample in samples() {
            change(&mut sample);
            let error = sample.open(false).err().map(|e| e.to_string());
            assert!(
                error.as_ref().is_some_and(|e| e.contains(field)),
                "{field}: {error:?}"
            );
        }
    }
}

#[test]
fn too_few_voxels_are_refused_at_once() {
    for compressed in [false, true] {
        let mut sample = Sample::new(&NIFTI_2, false);
        for i in 1..4 {
            sample.int(NIFTI_2.dim, i, 10_000);
        }
        let bytes = if compressed {
            gzip(&sample.bytes)
        } else {
            sample.bytes
        };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &bytes).unwrap();
        let error = open(file.path(), compressed, &OpenOptions::default())
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("2000000000000 bytes"), "{error}");
    }
}

#[test]
fn a_cut_or_damaged_stream_names_the_place() {
    let mut sample = Sample::new(&NIFTI_1, false);
    sample.bytes.truncate(352 + 14);
    let error = sample.open(true).err().unwrap().to_string();
    assert!(error.contains("slice 1 of 2, byte 14"), "{error}");

    let mut whole = gzip(&Sample::new(&NIFTI_1, false).bytes);
    let n = whole.len();
    whole[n - 6] ^= 1;
    let error = read(&whole, true).err().unwrap().to_string();
    assert!(
        error.contains("end of the compressed voxels"),
        "checksum: {error}"
    );
    whole[n - 6] ^= 1;
    assert!(read(&whole[..n - 3], true).is_err(), "a cut checksum");
    assert!(read(&whole, true).is_ok(), "the file itself is sound");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        wide: bool,
        big: bool,
        compressed: bool,
        changes in prop::collection::vec((0usize..600, any::<u8>()), 1..6),
        cut in 0usize..700,
    ) {
        let mut sample = Sample::new(if wide { &NIFTI_2 } else { &NIFTI_1 }, big);
        for (at, value) in changes {
            let n = sample.bytes.len();
            sample.bytes[at % n] = value;
        }
        sample.bytes.truncate(cut.max(20));
        // Only opening: a header that passes may ask for more voxels than a test should hold.
        let bytes = if compressed { gzip(&sample.bytes) } else { sample.bytes };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let _ = open(file.path(), compressed, &OpenOptions::default());
    }
}
