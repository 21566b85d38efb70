//! Pairs made here, in both byte orders; damaged ones are refused without a panic.

use std::path::PathBuf;

use proptest::prelude::*;

use crate::geom::VoxelBox;
use crate::input::OpenOptions;
use crate::input::nifti;
use crate::volume::{SourceError, VolumeDesc, VoxelSource, VoxelType};

/// A pair of 3 × 2 × 2 voxels of i16 at two points in time, counting up from −2.
struct Sample {
    dir: tempfile::TempDir,
    header: Vec<u8>,
    image: Vec<u8>,
    big: bool,
}

impl Sample {
    fn new(big: bool) -> Self {
        let mut sample = Self {
            dir: tempfile::tempdir().unwrap(),
            header: vec![0; 348],
            image: Vec::new(),
            big,
        };
        sample.put(0, &348u32.to_le_bytes());
        sample.put(32, &16384u32.to_le_bytes());
        sample.header[38] = b'r';
        for (i, n) in [4i16, 3, 2, 2, 2].into_iter().enumerate() {
            sample.put(40 + 2 * i, &n.to_le_bytes());
        }
        sample.put(70, &4i16.to_le_bytes());
        for (i, v) in [1.0, 2.0, 3.0, 4.0].into_iter().enumerate() {
            sample.real(76 + 4 * i, v);
        }
        // The greatest value, where NIfTI has its magic.
        sample.put(344, &9i32.to_le_bytes());
        for v in -2i16..22 {
            let v = if big {
                v.to_be_bytes()
            } else {
                v.to_le_bytes()
            };
            sample.image.extend(v);
        }
        sample
    }

    fn put(&mut self, at: usize, le: &[u8]) {
        let target = &mut self.header[at..at + le.len()];
        target.copy_from_slice(le);
        if self.big {
            target.reverse();
        }
    }

    fn real(&mut self, at: usize, v: f32) {
        self.put(at, &v.to_le_bytes());
    }

    fn write(&self) -> PathBuf {
        let path = self.dir.path().join("a.hdr");
        std::fs::write(&path, &self.header).unwrap();
        std::fs::write(path.with_extension("img"), &self.image).unwrap();
        path
    }

    fn read(&self, time: u64) -> Result<(VolumeDesc, Vec<u8>, Vec<String>), SourceError> {
        let options = OpenOptions {
            time: Some(time),
            ..OpenOptions::default()
        };
        let mut source = nifti::open(&self.write(), false, &options)?;
        let desc = source.desc().clone();
        let mut out = vec![0; desc.byte_count().unwrap() as usize];
        source.read_box(VoxelBox::whole(desc.dims), &mut out)?;
        Ok((desc, out, source.notes()))
    }

    fn refused(&self) -> String {
        self.read(0)
            .err()
            .map(|e| e.to_string())
            .unwrap_or_default()
    }
}

#[test]
fn both_byte_orders_without_orientation() {
    for big in [false, true] {
        let mut sample = Sample::new(big);
        let (desc, voxels, notes) = sample.read(1).unwrap();
        let expected: Vec<u8> = (10i16..22).flat_map(i16::to_le_bytes).collect();
        assert_eq!(voxels, expected, "voxels of the second volume");
        assert_eq!(desc.voxel_type, VoxelType::I16, "type");
        assert_eq!(
            desc.world_from_index,
            glam::DAffine3::from_scale(glam::DVec3::new(2.0, 3.0, 4.0)),
            "spacing alone"
        );
        assert_eq!(notes.len(), 1, "orientation: {notes:?}");

        sample.real(112, 0.25);
        let (_, _, notes) = sample.read(1).unwrap();
        assert!(notes[1].contains("funused1 is 0.25"), "{notes:?}");
        for i in 1..4 {
            sample.real(76 + 4 * i, 0.0);
        }
        let (desc, _, notes) = sample.read(0).unwrap();
        assert_eq!(desc.spacing(), glam::DVec3::ONE, "no spacing");
        assert!(notes[1].contains("--spacing"), "{notes:?}");
    }
}

#[test]
fn marks_tell_it_from_damaged_nifti() {
    let mut sample = Sample::new(false);
    sample.put(32, &0u32.to_le_bytes());
    assert!(sample.read(0).is_ok(), "regular alone");
    sample.header[38] = 0;
    assert!(sample.refused().contains("magic"), "{}", sample.refused());
    sample.put(344, &[0; 4]);
    assert!(sample.read(0).is_ok(), "nothing where the magic would be");
}

#[test]
fn what_is_not_built_or_wrong_is_named() {
    type Change = fn(&mut Sample);
    let cases: [(&str, Change); 6] = [
        ("RGB voxels", |s| s.put(70, &128i16.to_le_bytes())),
        ("complex voxels", |s| s.put(70, &32i16.to_le_bytes())),
        ("datatype", |s| s.put(70, &3i16.to_le_bytes())),
        ("dim[2]", |s| s.put(44, &0i16.to_le_bytes())),
        ("pixdim[1]", |s| s.real(80, f32::NAN)),
        ("vox_offset", |s| s.real(108, -1.0)),
    ];
    for (word, change) in cases {
        for big in [false, true] {
            let mut sample = Sample::new(big);
            change(&mut sample);
            let error = sample.refused();
            assert!(error.contains(word), "{word}: {error}");
        }
    }
}

#[test]
fn too_few_voxels_are_refused_at_every_length() {
    let whole = Sample::new(false);
    for n in 0..48 {
        let mut sample = Sample::new(false);
        sample.image.truncate(n);
        assert!(sample.read(1).is_err(), "{n} bytes of voxels");
    }
    for n in 0..348 {
        let path = whole.write();
        std::fs::write(&path, &whole.header[..n]).unwrap();
        let options = OpenOptions::default();
        assert!(
            nifti::open(&path, false, &options).is_err(),
            "{n} bytes of header"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::input::MUTATIONS))]

    #[test]
    fn damaged_bytes_never_panic(
        big: bool,
        changes in prop::collection::vec((4usize..348, any::<u8>()), 1..6),
    ) {
        let mut sample = Sample::new(big);
        for (at, value) in changes {
            sample.header[at] = value;
        }
        let _ = nifti::open(&sample.write(), false, &OpenOptions::default());
    }
}
