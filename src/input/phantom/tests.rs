//! Phantoms are the same everywhere, in every way of reading them, and show what cli.md says.

use std::collections::BTreeSet;

use xxhash_rust::xxh3::xxh3_64;

use super::*;

fn voxels(spec: &str) -> Vec<u8> {
    let mut phantom = Phantom::from_spec(spec).unwrap();
    let whole = VoxelBox::whole(phantom.desc().dims);
    let size = phantom.desc().voxel_type.size();
    let mut out = vec![0xaa; whole.voxel_count().unwrap() as usize * size];
    phantom.read_box(whole, &mut out).unwrap();
    out
}

fn u16s(spec: &str) -> Vec<u16> {
    let bytes = voxels(spec);
    let (pairs, _) = bytes.as_chunks::<2>();
    pairs.iter().map(|&b| u16::from_le_bytes(b)).collect()
}

/// A change here changes what every user's `phantom:` spec means: it is a change of format.
#[test]
fn bytes_are_those_of_every_machine() {
    let expected: [(&str, u64); 12] = [
        ("body:48,40,56:u8", 0x76ff_27a5_b5f4_8e4f),
        ("body:48,40,56:u16", 0x62b9_4d0e_4cd3_b1b6),
        ("body:48,40,56:f32", 0x8543_8eeb_7038_3659),
        ("vessels:48,40,56:u8", 0x08e8_79e4_e3f3_2e29),
        ("vessels:48,40,56:u16", 0x016e_d224_7a19_4522),
        ("vessels:48,40,56:f32", 0xe69b_562c_439b_2039),
        ("sponge:48,40,56:u8", 0xcef5_b874_3995_f200),
        ("sponge:48,40,56:u16", 0xf8ba_b75e_90ec_31ac),
        ("sponge:48,40,56:f32", 0x735b_821e_0b30_9df4),
        ("marschner-lobb:48,40,56:u8", 0xc108_1203_1562_c35a),
        ("marschner-lobb:48,40,56:u16", 0x7098_66bf_2a3a_a0a7),
        ("marschner-lobb:48,40,56:f32", 0x7ed0_280e_d40f_4c9a),
    ];
    let mut wrong = Vec::new();
    for (spec, hash) in expected {
        let found = xxh3_64(&voxels(&format!("phantom:{spec}")));
        if found != hash {
            wrong.push(format!("        (\"{spec}\", {found:#018x}),"));
        }
    }
    assert!(wrong.is_empty(), "changed:\n{}", wrong.join("\n"));
}

#[test]
fn any_box_is_a_part_of_the_whole() {
    for name in ["body", "vessels", "sponge", "marschner-lobb"] {
        let spec = format!("phantom:{name}:41,38,70:u16");
        let whole = voxels(&spec);
        let mut phantom = Phantom::from_spec(&spec).unwrap();
        let (min, max) = ([7, 3, 33], [30, 38, 36]);
        let part = VoxelBox::new(U64Vec3::from_array(min), U64Vec3::from_array(max));
        let mut out = vec![0; part.voxel_count().unwrap() as usize * 2];
        phantom.read_box(part, &mut out).unwrap();
        let mut expected: Vec<u8> = Vec::new();
        for z in min[2]..max[2] {
            for y in min[1]..max[1] {
                let at = |x: u64| (((z * 38 + y) * 41 + x) * 2) as usize;
                expected.extend(&whole[at(min[0])..at(max[0])]);
            }
        }
        assert!(out == expected, "{name}: a box differs from the whole");
    }
}

#[test]
fn body_has_the_levels_of_the_contract() {
    let n = 96;
    let voxels = u16s("phantom:body:96,96,96:u16");
    let allowed = [80, 250, 350, 420, 440, 450, 460, 480, 500, 720, 820, 930];
    for &v in voxels.iter().collect::<BTreeSet<_>>() {
        let inside = allowed.iter().any(|&level: &u32| {
            let thousandths = u32::from(v) * 1000;
            (level - 20) * 4095 <= thousandths && thousandths <= (level + 20) * 4095
        });
        assert!(v == 0 || v == 2539 || inside, "{v} is in no tissue's range");
    }
    assert!(voxels.contains(&2539), "there are vessels");
    // Asymmetry: heart and its contrast left (−x), liver right (+x).
    let vessels_in = |x: std::ops::Range<usize>| {
        let z = 55..62;
        let mut count = 0;
        for k in z {
            for j in 48..60 {
                count += x
                    .clone()
                    .filter(|i| voxels[(k * n + j) * n + i] == 2539)
                    .count();
            }
        }
        count
    };
    assert!(
        vessels_in(36..48) > vessels_in(48..60),
        "the left ventricle is left"
    );
    let liver = |i: usize| {
        let v = voxels[(43 * n + 49) * n + i];
        (1802..=1966).contains(&v)
    };
    assert!(liver(59) && !liver(36), "the liver is right");
}

#[test]
fn vessels_are_hollow_round_their_centre_lines() {
    let n = 128;
    let voxels = voxels("phantom:vessels:128,128,128");
    let tree = vessel_tree();
    assert_eq!(tree.len(), 5 * 127, "127 branches of 5 pieces");
    for (i, s) in tree.iter().enumerate() {
        let joined = s.parent.map(|p| (p < i, tree[p].to));
        assert!(
            joined.is_none_or(|(before, end)| before && end == s.from),
            "segment {i} begins where its parent ends"
        );
        let middle = (s.from + s.to) * 0.5;
        let inside = middle.min_element() > 0.0 && middle.max_element() < 1.0;
        assert!(inside, "segment {i} is inside the box: {middle}");
        if s.lumen_radius * n as f64 > 1.0 {
            let v = (middle * n as f64).as_u64vec3();
            let at = voxels[((v.z * n + v.y) * n + v.x) as usize];
            assert_eq!(at, 153, "segment {i} holds lumen at {v}");
        }
    }
    let values: BTreeSet<u8> = voxels.into_iter().collect();
    assert_eq!(values, BTreeSet::from([0, 89, 153]), "air, wall and lumen");
}

#[test]
fn the_sponge_is_one_piece() {
    let n = 60usize;
    let voxels = voxels("phantom:sponge:60,60,60");
    let solid = voxels.iter().filter(|&&v| v == 128).count();
    assert!(voxels.iter().all(|&v| v == 0 || v == 128), "solid or not");
    let start = voxels.iter().position(|&v| v == 128).unwrap();
    let mut seen = vec![false; voxels.len()];
    seen[start] = true;
    let mut open = vec![start];
    let mut reached = 0;
    while let Some(i) = open.pop() {
        reached += 1;
        for (stride, place) in [(1, i % n), (n, i / n % n), (n * n, i / n / n)] {
            let mut go = |j: usize| {
                if voxels[j] == 128 && !seen[j] {
                    seen[j] = true;
                    open.push(j);
                }
            };
            if place > 0 {
                go(i - stride);
            }
            if place + 1 < n {
                go(i + stride);
            }
        }
    }
    assert_eq!(reached, solid, "all of the solid is connected");
}

#[test]
fn marschner_lobb_follows_its_formula() {
    let n = 40;
    let bytes = voxels("phantom:marschner-lobb:40,40,40:f32");
    let (floats, _) = bytes.as_chunks::<4>();
    let at = |i: usize| (i as f64 + 0.5) / 20.0 - 1.0;
    for [i, j, k] in [[0, 0, 0], [20, 20, 20], [3, 31, 17], [39, 0, 39]] {
        let (x, y, z) = (at(i), at(j), at(k));
        let r = (x * x + y * y).sqrt();
        let rho = (12.0 * std::f64::consts::PI * (std::f64::consts::FRAC_PI_2 * r).cos()).cos();
        let expected = (1.0 - (std::f64::consts::FRAC_PI_2 * z).sin() + 0.25 * (1.0 + rho)) / 2.5;
        let found = f64::from(f32::from_le_bytes(floats[(k * n + j) * n + i]));
        assert!(
            (found - expected).abs() < 1e-6,
            "({i}, {j}, {k}): {found} for {expected}"
        );
    }
}

#[test]
fn any_size_works() {
    for name in ["body", "vessels", "sponge", "marschner-lobb"] {
        for dims in ["1,1,1", "1,200,1", "3,1,77"] {
            voxels(&format!("phantom:{name}:{dims}:f32"));
        }
    }
    let huge = Phantom::from_spec("phantom:body:4096,4096,4096:u16").unwrap();
    assert_eq!(huge.desc().byte_count(), Some(1 << 37), "nothing is stored");
}

#[test]
fn bad_specs_are_refused() {
    for spec in [
        "phantom:",
        "phantom:body",
        "phantom:body:1,2",
        "phantom:body:0,2,3",
        "phantom:body:1,2,3:i16",
        "phantom:body:1,2,3:u8:more",
        "phantom:head:1,2,3",
        "phantom:body:4294967296,4294967296,4294967296",
    ] {
        let error = Phantom::from_spec(spec).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.starts_with(spec)), "{spec}");
    }
}
