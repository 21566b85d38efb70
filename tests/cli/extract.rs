//! What goes in with `brick` comes out with `extract`: voxels, type, rescale and affine.

use std::fs;
use std::path::Path;

use brickscope::geom::{Lod, VoxelBox};
use brickscope::input;
use brickscope::store::{BrickReader, Store};
use brickscope::volume::{Rescale, VolumeDesc, VoxelType};
use glam::{DAffine3, DMat3, DVec3, U64Vec3};
use serde_json::Value;

use crate::data::data;
use crate::run::{Folder, gzip, nifti_header, noise, put};

/// Description and voxels of a volume.
fn read(spec: &str) -> (VolumeDesc, Vec<u8>) {
    let mut source = input::open(spec, &Default::default()).unwrap_or_else(|e| panic!("{e}"));
    let desc = source.desc().clone();
    let mut voxels = vec![0; desc.byte_count().expect("a small volume") as usize];
    source
        .read_box(VoxelBox::whole(desc.dims), &mut voxels)
        .unwrap_or_else(|e| panic!("{e}"));
    (desc, voxels)
}

fn read_file(path: &Path) -> (VolumeDesc, Vec<u8>) {
    read(path.to_str().expect("a plain path"))
}

fn same_place(a: &VolumeDesc, b: &VolumeDesc) {
    assert_eq!(a.dims, b.dims, "dims");
    assert_eq!(a.world_from_index, b.world_from_index, "affine");
}

/// The voxels of a box of a volume of `dims` voxels of `size` bytes.
fn cut(voxels: &[u8], dims: U64Vec3, size: u64, part: VoxelBox) -> Vec<u8> {
    let mut out = Vec::new();
    for z in part.min.z..part.max.z {
        for y in part.min.y..part.max.y {
            let at = |x: u64| (((z * dims.y + y) * dims.x + x) * size) as usize;
            out.extend(&voxels[at(part.min.x)..at(part.max.x)]);
        }
    }
    out
}

#[test]
fn phantoms_come_out_as_they_went_in() {
    for (name, voxel_type) in [
        ("u8", VoxelType::U8),
        ("u16", VoxelType::U16),
        ("f32", VoxelType::F32),
    ] {
        let folder = Folder::new();
        let spec = format!("phantom:body:45,37,70:{name}");
        let store = folder.brick(&spec, "s.bsk");
        let (desc, voxels) = read(&spec);
        for file in ["out.nii.gz", "out.nrrd", "out.raw"] {
            let run = folder.run(&["extract", store, "-o", file]).expect(0);
            assert!(
                run.stdout.contains(&format!("45,37,70 voxels of {name}")),
                "{}",
                run.stdout
            );
            if file == "out.raw" {
                assert!(
                    fs::read(folder.file(file)).expect("the file") == voxels,
                    "{name} {file}: voxels"
                );
                continue;
            }
            let (found, bytes) = read_file(&folder.file(file));
            same_place(&found, &desc);
            assert_eq!(
                (found.voxel_type, found.rescale),
                (voxel_type, desc.rescale),
                "{name} {file}"
            );
            assert!(bytes == voxels, "{name} {file}: voxels");
        }
    }
}

/// A NIfTI of i16 with slope, intercept and an oblique, sheared sform.
fn oblique(folder: &Folder) -> &'static str {
    let dims = [40i16, 36, 34];
    let mut bytes = nifti_header(dims, 4, 16);
    put(&mut bytes, 112, &2.5f32.to_le_bytes());
    put(&mut bytes, 116, &(-1024f32).to_le_bytes());
    put(&mut bytes, 254, &1i16.to_le_bytes());
    let rows = [
        [0.7f32, -0.3, 0.1, -90.5],
        [0.25, 0.65, -0.2, 12.25],
        [0.05, 0.15, 1.75, -300.0],
    ];
    for (i, v) in rows.as_flattened().iter().enumerate() {
        put(&mut bytes, 280 + 4 * i, &v.to_le_bytes());
    }
    bytes.extend(noise(2 * 40 * 36 * 34));
    // Both ends of the type.
    put(&mut bytes, 352, &i16::MIN.to_le_bytes());
    put(&mut bytes, 354, &i16::MAX.to_le_bytes());
    folder.write("oblique.nii.gz", &gzip(&bytes))
}

#[test]
fn signed_rescaled_and_oblique_comes_out_as_it_went_in() {
    let folder = Folder::new();
    let input = oblique(&folder);
    let store = folder.brick(input, "s.bsk");
    let (desc, voxels) = read_file(&folder.file(input));
    assert_eq!(
        desc.rescale,
        Rescale {
            slope: 2.5,
            intercept: -1024.0
        },
        "the sample has a rescale"
    );

    let run = folder
        .run(&["extract", store, "-o", "out.nii.gz"])
        .expect(0);
    assert_eq!(run.stderr, "", "nothing is lost, nothing to say");
    let (found, bytes) = read_file(&folder.file("out.nii.gz"));
    same_place(&found, &desc);
    assert_eq!(
        (found.voxel_type, found.rescale),
        (VoxelType::I16, desc.rescale),
        "type and rescale"
    );
    assert!(bytes == voxels, "voxels");

    folder.run(&["extract", store, "-o", "out.raw"]).expect(0);
    assert!(
        fs::read(folder.file("out.raw")).expect("the file") == voxels,
        "raw voxels, in the source's type"
    );

    // NRRD has no rescale: physical values, as double.
    folder.run(&["extract", store, "-o", "out.nrrd"]).expect(0);
    let (found, bytes) = read_file(&folder.file("out.nrrd"));
    same_place(&found, &desc);
    assert_eq!(
        (found.voxel_type, found.rescale),
        (VoxelType::F64, Rescale::IDENTITY),
        "physical values"
    );
    let physical: Vec<u8> = voxels
        .as_chunks::<2>()
        .0
        .iter()
        .flat_map(|b| {
            desc.rescale
                .physical(f64::from(i16::from_le_bytes(*b)))
                .to_le_bytes()
        })
        .collect();
    assert!(bytes == physical, "physical values");
}

/// No silent downgrade: what a format can't keep is said.
#[test]
fn what_a_format_does_not_keep_is_said() {
    let folder = Folder::new();
    let store = folder.brick(oblique(&folder), "s.bsk");
    let boxed = "1,1,1,9,9,9";
    for (file, wanted) in [
        ("box.nii.gz", "as f32, so they are rounded"),
        ("box.nrrd", "physical values are written, as double"),
        ("box.raw", "neither affine nor rescale"),
    ] {
        let run = folder
            .run(&["extract", store, "-o", file, "--box", boxed])
            .expect(0);
        assert!(run.stderr.contains(wanted), "{file}: {}", run.stderr);
    }
    let store = folder.brick("phantom:sponge:32,32,32", "plain.bsk");
    for file in ["out.nii.gz", "out.nrrd", "out.raw"] {
        let run = folder.run(&["extract", store, "-o", file]).expect(0);
        assert_eq!(run.stderr, "", "{file}: nothing is lost");
    }
}

#[test]
fn a_box_has_its_voxels_and_its_place() {
    let folder = Folder::new();
    let input = oblique(&folder);
    let store = folder.brick(input, "s.bsk");
    let (desc, voxels) = read_file(&folder.file(input));
    // Across the border between bricks on every axis, and up to the end.
    for part in [
        [3, 5, 7, 36, 34, 33],
        [0, 0, 31, 40, 1, 34],
        [39, 35, 33, 40, 36, 34],
    ] {
        let [x0, y0, z0, x1, y1, z1] = part;
        let part = VoxelBox::new(U64Vec3::new(x0, y0, z0), U64Vec3::new(x1, y1, z1));
        let typed = format!("{x0},{y0},{z0},{x1},{y1},{z1}");
        folder
            .run(&["extract", store, "-o", "box.nii.gz", "--box", &typed])
            .expect(0);
        let (found, bytes) = read_file(&folder.file("box.nii.gz"));
        assert_eq!(found.dims, part.size(), "{typed}: dims");
        assert!(bytes == cut(&voxels, desc.dims, 2, part), "{typed}: voxels");
        let first = desc.world_from_index.transform_point3(part.min.as_dvec3());
        let off = (found.world_from_index.translation - first).length();
        // NIfTI-1 keeps f32.
        assert!(off < 1e-4, "{typed}: its first voxel is {off} mm off");
        assert_eq!(
            found.world_from_index.matrix3, desc.world_from_index.matrix3,
            "{typed}: axes"
        );
    }
}

#[test]
fn a_coarser_level_is_the_average_and_lies_between_the_voxels() {
    let folder = Folder::new();
    let spec = "phantom:body:41,36,64:u16";
    let store = folder.brick(spec, "s.bsk");
    let (_, fine) = read(spec);
    let fine = |x: u64, y: u64, z: u64| {
        let at = 2 * ((z * 36 + y) * 41 + x) as usize;
        f64::from(u16::from_le_bytes([fine[at], fine[at + 1]]))
    };
    folder
        .run(&["extract", store, "-o", "level.nrrd", "--level", "1"])
        .expect(0);
    let (found, bytes) = read_file(&folder.file("level.nrrd"));
    assert_eq!(found.dims, U64Vec3::new(21, 18, 32), "dims");
    assert_eq!(found.voxel_type, VoxelType::U16, "type");
    let expected =
        DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(2.0)), DVec3::splat(0.5));
    assert_eq!(
        found.world_from_index, expected,
        "centres of 2³ voxels: 2 · (i + ½) − ½"
    );
    for (i, b) in bytes.as_chunks::<2>().0.iter().enumerate() {
        let i = i as u64;
        let (x, y, z) = (i % 21, i / 21 % 18, i / 21 / 18);
        let (mut sum, mut n) = (0.0, 0.0);
        for (dx, dy, dz) in (0..8).map(|k| (k & 1, k >> 1 & 1, k >> 2)) {
            let (x, y, z) = (2 * x + dx, 2 * y + dy, 2 * z + dz);
            if x < 41 && y < 36 && z < 64 {
                sum += fine(x, y, z);
                n += 1.0;
            }
        }
        let value = f64::from(u16::from_le_bytes(*b));
        assert!(
            (value - sum / n).abs() <= 0.5,
            "voxel {x},{y},{z}: {value}, the average is {}",
            sum / n
        );
    }
}

/// Types that are stored as f32, or as something they were asked to be.
#[test]
fn other_types_come_back_when_nothing_was_lost() {
    let exact: Vec<f64> = (0..20 * 12 * 40).map(|i| f64::from(i % 4096)).collect();
    let bytes = |voxel_type: &str, add: f64| -> Vec<u8> {
        let voxels = exact.iter().map(|v| v + add);
        match voxel_type {
            "i8" => voxels
                .flat_map(|v| ((v % 200.0 - 128.0) as i8).to_le_bytes())
                .collect(),
            "u32" => voxels.flat_map(|v| (v as u32).to_le_bytes()).collect(),
            "i32" => voxels
                .flat_map(|v| ((v - 2000.0) as i32).to_le_bytes())
                .collect(),
            "f64" => voxels.flat_map(f64::to_le_bytes).collect(),
            other => panic!("{other}"),
        }
    };
    // Type, what is added, store type asked for, type that comes out.
    for (voxel_type, add, store_type, comes_out) in [
        ("i8", 0.0, "auto", "i8"),
        ("u32", 0.0, "auto", "u32"),
        ("i32", 0.0, "auto", "i32"),
        ("i32", 0.0, "u16", "i32"),
        ("f64", 0.0, "auto", "f64"),
        ("f64", 0.5, "auto", "f64"),
        // More than f32 holds: what is stored comes out, and it is said.
        ("f64", 1e-9, "auto", "f32"),
        ("u32", 4e9, "auto", "f32"),
    ] {
        let name = format!("{voxel_type} + {add} as {store_type}");
        let folder = Folder::new();
        let source = bytes(voxel_type, add);
        let input = folder.write("in.raw", &source);
        let args = [
            "brick",
            input,
            "-o",
            "s.bsk",
            "--dims",
            "20,12,40",
            "--type",
            voxel_type,
            "--store-type",
            store_type,
        ];
        folder.run(&args).expect(0);
        let run = folder.run(&["extract", "s.bsk", "-o", "out.raw"]).expect(0);
        assert!(
            run.stdout.contains(&format!("voxels of {comes_out},")),
            "{name}: {}",
            run.stdout
        );
        assert_eq!(
            run.stderr.contains("rounded"),
            comes_out != voxel_type,
            "{name}: {}",
            run.stderr
        );
        let out = fs::read(folder.file("out.raw")).expect("the file");
        if comes_out == voxel_type {
            assert!(out == source, "{name}: voxels");
        } else {
            let stored = Store::open(&folder.file("s.bsk")).expect("the store");
            let mut voxels = vec![0; out.len()];
            let whole = VoxelBox::whole(U64Vec3::new(20, 12, 40));
            let mut reader = BrickReader::new().expect("a reader");
            stored
                .read_box(Lod(0), whole, &mut reader, &mut voxels)
                .expect("sound bricks");
            assert!(out == voxels, "{name}: the stored f32");
        }
        // Averages of whole numbers are not whole.
        let coarse = folder
            .run(&["extract", "s.bsk", "-o", "coarse.raw", "--level", "1"])
            .expect(0);
        let is_f32 =
            store_type == "auto" && ["u32", "i32"].contains(&voxel_type) || comes_out == "f32";
        let expected = if is_f32 { "f32" } else { voxel_type };
        assert!(
            coarse.stdout.contains(&format!("voxels of {expected},")),
            "{name}, level 1: {}",
            coarse.stdout
        );
    }
}

#[test]
fn an_existing_file_is_replaced_and_refusals_leave_it_alone() {
    let folder = Folder::new();
    let store = folder.brick("phantom:body:40,40,40", "s.bsk");
    folder.write("out.raw", b"old");
    for (args, message) in [
        (&["--level", "9"][..], "no level 9; the levels are 0 to 1"),
        (&["--box", "0,0,0,41,40,40"], "not inside level 0"),
        (
            &["--box", "0,0,0,21,20,20", "--level", "1"],
            "not inside level 1",
        ),
        (
            &["--box", "18446744073709551614,0,0,18446744073709551615,1,1"],
            "not inside level 0",
        ),
        (&["--box", "5,0,0,5,9,9"], "expected x0,y0,z0,x1,y1,z1"),
        (&["--box", "-1,0,0,5,9,9"], "expected x0,y0,z0,x1,y1,z1"),
        (&["--box", "0,0,0,5,9"], "expected x0,y0,z0,x1,y1,z1"),
    ] {
        let run = folder
            .run(&[&["extract", store, "-o", "out.raw"], args].concat())
            .expect(2);
        assert!(run.stderr.contains(message), "{args:?}: {}", run.stderr);
        assert_eq!(
            fs::read(folder.file("out.raw")).expect("the file"),
            b"old",
            "{args:?}: the file is as it was"
        );
    }
    for (name, message) in [
        ("no/out.zarr", "does not exist"),
        ("out.tif", "supported are .nii.gz, .nrrd, .zarr and .raw"),
    ] {
        let run = folder.run(&["extract", store, "-o", name]).expect(2);
        assert!(
            run.stderr.contains(message) && run.stderr.contains(name),
            "{name}: {}",
            run.stderr
        );
    }
    folder.run(&["extract", store, "-o", "out.raw"]).expect(0);
    assert_eq!(
        fs::read(folder.file("out.raw")).expect("the file").len(),
        64_000,
        "replaced"
    );
    assert_eq!(folder.names(), ["out.raw", "s.bsk"], "nothing else is left");
}

/// A sheared scan of the collection of real volumes.
#[test]
#[cfg_attr(no_brickscope_data, ignore = "no BRICKSCOPE_DATA")]
fn a_real_sheared_scan_comes_out_as_it_went_in() {
    let folder = Folder::new();
    let path = data("nifti/shear.nii.gz");
    let store = folder.brick(path.to_str().expect("a plain path"), "s.bsk");
    folder
        .run(&["extract", store, "-o", "out.nii.gz"])
        .expect(0);
    let ((desc, voxels), (found, bytes)) =
        (read_file(&path), read_file(&folder.file("out.nii.gz")));
    same_place(&found, &desc);
    assert_eq!(
        (found.voxel_type, found.rescale),
        (desc.voxel_type, desc.rescale),
        "type and rescale"
    );
    assert!(bytes == voxels, "voxels");
}

#[test]
fn an_ome_zarr_comes_back_as_it_was() {
    let folder = Folder::new();
    // Turned, in part one way, in part another; two of its levels; more than a shard along x.
    let header = "NRRD0004\ntype: short\ndimension: 3\nspace: right-anterior-superior\nsizes: 300 70 40\n\
        space directions: (0.5,0.1,0) (-0.1,0.5,0) (0,0,-2)\nspace origin: (10,-20,30)\nendian: little\nencoding: raw\n\n";
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend((0..300 * 70 * 40_i64).flat_map(|n| {
        let (x, y, z) = (n % 300, n / 300 % 70, n / 21_000);
        let value = if x < 64 { 0 } else { x * y - 300 * z };
        (value as i16).to_le_bytes()
    }));
    folder.write("t.nrrd", &bytes);
    folder.run(&["brick", "t.nrrd", "-o", "a.bsk"]).expect(0);
    let told = folder
        .run(&["extract", "a.bsk", "-o", "t.zarr"])
        .expect(0)
        .stderr;
    assert!(
        told.contains("affine"),
        "what the format has no room for: {told}"
    );
    let info = |store: &str| -> Value {
        let json = folder.run(&["info", store, "--json"]).expect(0).stdout;
        serde_json::from_str(&json).expect("JSON")
    };
    folder.run(&["brick", "t.zarr", "-o", "b.bsk"]).expect(0);
    let (a, b) = (info("a.bsk"), info("b.bsk"));
    for key in [
        "dims",
        "source_type",
        "source_hash",
        "affine",
        "value_range",
        "levels",
    ] {
        assert_eq!(a[key], b[key], "{key}");
    }
    assert!(
        !folder.file("t.zarr/0/c/0/0/2").exists() && folder.file("t.zarr/0/c/0/0/1").exists(),
        "two shards"
    );

    // A part of a level, over what is there; the coarser levels come with it.
    let part = ["--level", "1", "--box", "10,3,5,141,30,19"];
    let extract = ["extract", "a.bsk", "-o", "t.zarr"];
    folder.run(&[&extract[..], &part].concat()).expect(0);
    folder.run(&["brick", "t.zarr", "-o", "c.bsk"]).expect(0);
    folder
        .run(&[&["extract", "a.bsk", "-o", "t.nrrd"][..], &part].concat())
        .expect(0);
    folder.run(&["brick", "t.nrrd", "-o", "d.bsk"]).expect(0);
    let (c, d) = (info("c.bsk"), info("d.bsk"));
    for key in ["dims", "source_type", "source_hash"] {
        assert_eq!(c[key], d[key], "{key}");
    }
    let numbers = |v: &Value| -> Vec<f64> {
        let rows = v["affine"].as_array().expect("rows");
        let row = |r: &Value| r.as_array().expect("a row").clone();
        rows.iter()
            .flat_map(row)
            .filter_map(|n| n.as_f64())
            .collect()
    };
    for (x, y) in numbers(&c).iter().zip(numbers(&d)) {
        assert!((x - y).abs() < 1e-9, "{c} and {d}");
    }

    // What is something else is not replaced.
    fs::create_dir(folder.file("mine.zarr")).expect("a folder");
    let refused = folder
        .run(&["extract", "a.bsk", "-o", "mine.zarr"])
        .expect(2);
    assert!(
        refused.stderr.contains("something else"),
        "{}",
        refused.stderr
    );
}
