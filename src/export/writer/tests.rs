//! What is written reads back the same.

use glam::{DAffine3, DMat3, DQuat, DVec3, U64Vec3};

use super::*;
use crate::export::write_png;
use crate::geom::VoxelBox;
use crate::input::{self, Endian, OpenOptions, RawParams};
use crate::volume::{Rescale, VoxelType};

fn desc(voxel_type: VoxelType) -> VolumeDesc {
    VolumeDesc {
        dims: U64Vec3::new(5, 4, 3),
        voxel_type,
        // Numbers that f32 holds, so that NIfTI-1 keeps them; sheared, so that there is no qform.
        world_from_index: DAffine3::from_mat3_translation(
            DMat3::from_cols(
                DVec3::new(-0.5, 0.25, 0.0),
                DVec3::new(0.125, 2.0, 0.0),
                DVec3::new(0.0, 0.75, 1.5),
            ),
            DVec3::new(-10.5, 20.25, 3.0),
        ),
        rescale: Rescale::IDENTITY,
        unit: "HU".to_owned(),
        name: "test".to_owned(),
    }
}

fn voxels(desc: &VolumeDesc) -> Vec<u8> {
    // Bytes below 64: no NaN among floats.
    (0..desc.byte_count().unwrap())
        .map(|i| (i * 37 % 61) as u8)
        .collect()
}

/// Writes `voxels` slice by slice and reads the file.
fn round_trip(name: &str, desc: &VolumeDesc, voxels: &[u8]) -> (VolumeDesc, Vec<u8>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    let mut writer = create(&path, desc, Existing::Refuse).unwrap();
    for slice in voxels.chunks(voxels.len() / desc.dims.z as usize) {
        writer.write(slice).unwrap();
    }
    assert!(!path.exists(), "not there before it is finished");
    writer.finish().unwrap();
    let raw = name.ends_with(".raw").then_some(RawParams {
        dims: desc.dims,
        voxel_type: desc.voxel_type,
        endian: Endian::Little,
        spacing: DVec3::ONE,
        offset: 0,
    });
    let options = OpenOptions {
        raw,
        ..OpenOptions::default()
    };
    let mut source = input::open(path.to_str().unwrap(), &options).unwrap();
    let found = source.desc().clone();
    let mut out = vec![0; found.byte_count().unwrap() as usize];
    source
        .read_box(VoxelBox::whole(found.dims), &mut out)
        .unwrap();
    (found, out)
}

#[test]
fn every_type_comes_back_exactly() {
    for voxel_type in VoxelType::ALL {
        let desc = desc(voxel_type);
        let voxels = voxels(&desc);
        for name in ["a.nii.gz", "a.nrrd", "a.raw"] {
            let (found, out) = round_trip(name, &desc, &voxels);
            assert_eq!(out, voxels, "{name} {voxel_type}: voxels");
            assert_eq!(found.dims, desc.dims, "{name} {voxel_type}: dims");
            assert_eq!(found.voxel_type, voxel_type, "{name}: type");
            assert_eq!(found.rescale, desc.rescale, "{name} {voxel_type}: rescale");
            if name != "a.raw" {
                let (a, b) = (found.world_from_index, desc.world_from_index);
                assert_eq!(a, b, "{name} {voxel_type}: affine");
            }
        }
    }
}

#[test]
fn rescale_is_kept_by_nifti_and_applied_by_nrrd() {
    let mut desc = desc(VoxelType::I16);
    let voxels = voxels(&desc);
    for (slope, intercept) in [(2.0, -1024.0), (0.1, 0.3)] {
        desc.rescale = Rescale { slope, intercept };
        let (found, out) = round_trip("a.nii.gz", &desc, &voxels);
        let rounded = |v: f64| f64::from(v as f32);
        let expected = Rescale {
            slope: rounded(slope),
            intercept: rounded(intercept),
        };
        assert_eq!(found.rescale, expected, "to the precision of NIfTI-1");
        assert_eq!(out, voxels, "stored values");

        let (found, out) = round_trip("a.nrrd", &desc, &voxels);
        assert_eq!(found.voxel_type, VoxelType::F64, "physical values");
        assert_eq!(found.unit, "HU", "unit");
        let expected: Vec<u8> = voxels
            .chunks_exact(2)
            .map(|b| f64::from(i16::from_le_bytes([b[0], b[1]])))
            .flat_map(|v| desc.rescale.physical(v).to_le_bytes())
            .collect();
        assert_eq!(out, expected, "physical values");
    }
}

#[test]
fn sizes_beyond_nifti_1_become_nifti_2() {
    let mut desc = desc(VoxelType::U8);
    desc.dims = U64Vec3::new(40_000, 2, 1);
    let voxels = voxels(&desc);
    let (found, out) = round_trip("a.nii.gz", &desc, &voxels);
    assert_eq!(found.dims, desc.dims, "dims");
    assert!(out == voxels, "voxels");
}

#[test]
fn qform_and_sform_of_a_rotation_agree() {
    use std::io::Read;
    let mut desc = desc(VoxelType::U8);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -2.0, 1.1);
    for flip in [1.0, -1.0] {
        desc.world_from_index = DAffine3::from_scale_rotation_translation(
            DVec3::new(0.5, 0.75, 2.0 * flip),
            turn,
            DVec3::new(1.0, -2.0, 3.0),
        );
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.nii.gz");
        let mut writer = create(&path, &desc, Existing::Refuse).unwrap();
        writer.write(&voxels(&desc)).unwrap();
        writer.finish().unwrap();
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(std::fs::File::open(&path).unwrap())
            .read_to_end(&mut bytes)
            .unwrap();
        // Without its sform_code the file has the qform alone.
        assert_eq!(bytes[252..256], [1, 0, 1, 0], "both codes are set");
        bytes[254] = 0;
        let plain = dir.path().join("b.nii");
        std::fs::write(&plain, bytes).unwrap();
        let source = input::open(plain.to_str().unwrap(), &Default::default()).unwrap();
        let found = source.desc().world_from_index;
        assert!(
            found.abs_diff_eq(desc.world_from_index, 1e-5),
            "flip {flip}: {found}"
        );
    }
}

#[test]
fn wrong_use_leaves_nothing_behind() {
    let dir = tempfile::tempdir().unwrap();
    let desc = desc(VoxelType::U16);
    let path = dir.path().join("a.nrrd");
    let mut writer = create(&path, &desc, Existing::Refuse).unwrap();
    assert!(writer.write(&[1]).is_err(), "half a voxel");
    writer.write(&[1, 2]).unwrap();
    let error = writer.finish().unwrap_err().to_string();
    assert!(error.contains("expected 120 bytes, got 2"), "{error}");
    for name in ["a.nii", "a.zarr", "a.tif", "a"] {
        let made = create(&dir.path().join(name), &desc, Existing::Refuse);
        assert!(matches!(made, Err(ExportError::UnknownFormat(_))), "{name}");
    }
    assert_eq!(
        std::fs::read_dir(dir.path()).unwrap().count(),
        0,
        "no files"
    );
}

#[test]
fn pictures_keep_their_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let rgba: Vec<u8> = (0..24).map(|i| i * 10).collect();
    for opaque in [true, false] {
        write_png(&path, 3, 2, &rgba, opaque, Existing::Replace).unwrap();
        let file = io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut out = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut out).unwrap();
        let info = reader.info();
        assert!(
            info.gama_chunk.is_none() && info.srgb.is_none(),
            "no colour space is claimed"
        );
        let expected: Vec<u8> = rgba
            .chunks(4)
            .flat_map(|p| if opaque { &p[..3] } else { p })
            .copied()
            .collect();
        assert_eq!(out, expected, "opaque: {opaque}");
    }
    assert!(
        write_png(&path, 3, 3, &rgba, true, Existing::Replace).is_err(),
        "too few pixels"
    );
}
