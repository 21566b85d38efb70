//! Centre-lines against known ones, and what is refused.
//!
//! The truth is that of the `vessels` phantom, and of a tube along a helix in oblique, anisotropic voxels. Negative controls:
//! a line shifted by two voxels, and the shortest way instead of the middle one, fail the same check.
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;

use brickscope::bricking::{self, BrickOptions, NoProgress};
use brickscope::camera::{Curve, Flight};
use brickscope::geom::Lod;
use brickscope::input::phantom::vessel_tree;
use brickscope::path::{Centerline, CenterlineError, CenterlineRequest, Destination, centerline};
use brickscope::store::Store;
use brickscope::volume::{Rescale, VoxelSource, VoxelType};
use glam::{DAffine3, DMat3, DVec3};
use memory_source::MemorySource;

struct Bricked {
    _folder: tempfile::TempDir,
    store: Store,
}

fn bricked(source: &mut dyn VoxelSource) -> Bricked {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.bsk");
    bricking::brick(source, &path, &BrickOptions::default(), &NoProgress).unwrap();
    Bricked {
        store: Store::open(&path).unwrap(),
        _folder: folder,
    }
}

const GIB: u64 = 1 << 30;

fn find(
    store: &Store,
    from: DVec3,
    to: Destination,
    lumen: [f64; 2],
    memory_bytes: u64,
) -> Result<Centerline, CenterlineError> {
    centerline(
        store,
        &CenterlineRequest {
            from,
            to,
            low: lumen[0],
            high: lumen[1],
            memory_bytes,
        },
    )
}

/// Mean and greatest distance of the points of `line` (every quarter of `unit`) from a broken line, in units.
fn off(line: &[DVec3], truth: &[DVec3], unit: f64) -> [f64; 2] {
    let curve = Curve::through(line);
    let n = (curve.length_mm() / (0.25 * unit)).ceil() as u32;
    let all: Vec<f64> = (0..=n)
        .map(|k| {
            let p = curve.at(curve.length_mm() * f64::from(k) / f64::from(n));
            let to_piece = |pair: &[DVec3]| {
                let (a, way) = (pair[0], pair[1] - pair[0]);
                let t = ((p - a).dot(way) / way.length_squared()).clamp(0.0, 1.0);
                p.distance(a + way * t)
            };
            truth.windows(2).map(to_piece).fold(f64::INFINITY, f64::min) / unit
        })
        .collect();
    [
        all.iter().sum::<f64>() / all.len() as f64,
        all.iter().copied().fold(0.0, f64::max),
    ]
}

/// The bound of the check that the controls must fail.
const MEAN_BOUND_VOXELS: f64 = 1.0;

/// From the root to a tip: what the phantom says, in world mm of a cube of `n` voxels.
fn vessel_truth(n: u32, forks: usize) -> Vec<DVec3> {
    let tree = vessel_tree();
    let world = |p: DVec3| p * f64::from(n) - 0.5;
    let depth = |mut i: usize| {
        let mut pieces = 1;
        while let Some(parent) = tree[i].parent {
            (i, pieces) = (parent, pieces + 1);
        }
        pieces
    };
    // Five pieces between two forks.
    let mut at = (0..tree.len()).rfind(|&i| depth(i) == 5 * forks).unwrap();
    let mut line = vec![world(tree[at].to)];
    loop {
        line.push(world(tree[at].from));
        match tree[at].parent {
            Some(parent) => at = parent,
            None => break,
        }
    }
    line.reverse();
    line
}

#[test]
fn the_vessels_phantom_has_the_centre_line_that_it_was_made_from() {
    let n = 144;
    let mut source =
        brickscope::input::open(&format!("phantom:vessels:{n},{n},{n}"), &Default::default())
            .unwrap();
    let v = bricked(source.as_mut());
    let truth = vessel_truth(n, 4);
    let (from, to) = (truth[0] + DVec3::Z * 2.0, truth[truth.len() - 1]);
    let lumen = [140.0, 170.0];
    let line = find(&v.store, from, Destination::At(to), lumen, GIB).unwrap();
    assert_eq!(line.lod, Lod(0), "at full resolution");
    assert_eq!(line.inside_share, 1.0, "never leaves the lumen");
    let [mean, most] = off(&line.positions(), &truth, line.voxel_mm);
    println!("vessels: mean {mean:.2}, greatest {most:.2} voxels from the truth");
    assert!(
        mean < 0.6 && most < 2.5,
        "mean {mean:.2} and greatest {most:.2} voxels from the truth"
    );
    let ends = line.points[0].position.distance(from)
        + line.points[line.points.len() - 1].position.distance(to);
    assert!(
        ends < 8.0,
        "it goes from one seed to the other: {ends} mm off"
    );
    // Radii: the root's is .04 of the edge.
    let root = line.points[2].radius_mm;
    let wanted = 0.04 * f64::from(n);
    assert!((root - wanted).abs() < 1.0, "{root} mm for {wanted}");
    // Negative control: the same line two voxels aside.
    let aside: Vec<DVec3> = line
        .positions()
        .iter()
        .map(|p| p + DVec3::X * 2.0)
        .collect();
    let [mean, _] = off(&aside, &truth, line.voxel_mm);
    assert!(
        mean > MEAN_BOUND_VOXELS,
        "a shifted line is found out: {mean:.2}"
    );
    let path = line.flight(&Flight::default()).unwrap();
    assert!(
        (path.length_mm() - line.length_mm()).abs() < 1e-9,
        "its length"
    );
}

/// A tube of 5 mm along one and a half turns of a helix, in voxels of .7 × 1 × 1.6 mm that are turned and shifted. One voxel in
/// fifty inside is noise when `noisy`; axes are up to 8° from perpendicular when `sheared`.
fn helix_tube(noisy: bool, sheared: bool) -> (MemorySource, Vec<DVec3>) {
    let dims = [90_u64, 64, 40];
    let turn = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.4);
    let shear = if sheared {
        DMat3::from_cols(
            DVec3::X,
            DVec3::new(0.1, 1.0, 0.0),
            DVec3::new(0.0, 0.14, 1.0),
        )
    } else {
        DMat3::IDENTITY
    };
    let affine = DAffine3::from_mat3_translation(
        turn * shear * DMat3::from_diagonal(DVec3::new(0.7, 1.0, 1.6)),
        DVec3::new(-100.0, 20.0, 300.0),
    );
    let middle = affine.transform_point3(DVec3::new(44.5, 31.5, 19.5));
    let (turn_x, turn_y, along) = (turn.x_axis, turn.y_axis, turn.z_axis);
    let truth: Vec<DVec3> = (0..=300)
        .map(|i| {
            let a = 3.0 * std::f64::consts::PI * f64::from(i) / 300.0;
            middle
                + turn_x * (18.0 * a.cos())
                + turn_y * (18.0 * a.sin())
                + along * (4.5 * a - 21.0)
        })
        .collect();
    let mut bytes = Vec::new();
    let mut noise = memory_source::noise(90 * 64 * 40, 3);
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let p = affine.transform_point3(DVec3::new(x as f64, y as f64, z as f64));
                let d = truth
                    .iter()
                    .map(|t| t.distance(p))
                    .fold(f64::INFINITY, f64::min);
                let speck = noisy && d < 4.0 && noise.next().unwrap().is_multiple_of(50);
                bytes.push(if d <= 5.0 && !speck { 100 } else { 10 });
            }
        }
    }
    let mut source = MemorySource::new(dims, VoxelType::U8, bytes);
    source.desc.world_from_index = affine;
    source.desc.rescale = Rescale {
        slope: -2.0,
        intercept: 0.0,
    };
    (source, truth)
}

/// The lumen of [`helix_tube`] in physical values: the slope is negative.
const HELIX: [f64; 2] = [-210.0, -190.0];

#[test]
fn a_tube_in_oblique_voxels_with_noise_and_shear() {
    for (noisy, sheared) in [(false, false), (true, false), (false, true)] {
        let (mut source, truth) = helix_tube(noisy, sheared);
        let v = bricked(&mut source);
        let ends = [truth[20], truth[280]];
        let ends = if noisy {
            ends.map(|e| nearest_lumen(&v.store, e))
        } else {
            ends
        };
        let line = find(&v.store, ends[0], Destination::At(ends[1]), HELIX, GIB).unwrap();
        assert_eq!(line.inside_share, 1.0, "noisy {noisy}: inside");
        let [mean, most] = off(&line.positions(), &truth, line.voxel_mm);
        println!(
            "helix, noisy {noisy}, sheared {sheared}: mean {mean:.2}, greatest {most:.2} voxels of .7 mm"
        );
        assert!(
            mean < MEAN_BOUND_VOXELS && most < 2.5,
            "noisy {noisy}: mean {mean:.2}, greatest {most:.2} voxels of .7 mm"
        );
        // Negative control: the chord.
        let [mean, _] = off(&[ends[0], ends[1]], &truth, line.voxel_mm);
        assert!(mean > MEAN_BOUND_VOXELS, "the straight way is found out");
        let far = find(&v.store, ends[0], Destination::Farthest, HELIX, GIB).unwrap();
        let end = far.points[far.points.len() - 1].position;
        assert!(
            end.distance(truth[300]) < 7.0,
            "noisy {noisy}: the farthest point is the other end: {end}, {}",
            truth[300]
        );
    }
}

/// A seed that is surely lumen: the error names it.
fn nearest_lumen(store: &Store, at: DVec3) -> DVec3 {
    match find(store, at, Destination::Farthest, HELIX, GIB) {
        Err(CenterlineError::NotLumen { nearest, .. }) => nearest.unwrap().at,
        _ => at,
    }
}

#[test]
fn with_little_memory_it_is_found_coarsely_and_followed_finely() {
    let n = 144;
    let mut source =
        brickscope::input::open(&format!("phantom:vessels:{n},{n},{n}"), &Default::default())
            .unwrap();
    let v = bricked(source.as_mut());
    let truth = vessel_truth(n, 3);
    let (from, to) = (truth[0] + DVec3::Z * 2.0, truth[truth.len() - 1]);
    // The tree fills the cube: 45 MB at level 0, an eighth at level 1.
    let lumen = [130.0, 180.0];
    let line = find(&v.store, from, Destination::At(to), lumen, 10 << 20).unwrap();
    assert_eq!(
        (line.first_lod, line.lod),
        (Lod(1), Lod(0)),
        "coarse, then fine"
    );
    assert_eq!(line.inside_share, 1.0, "inside at level 0");
    let [mean, most] = off(&line.positions(), &truth, line.voxel_mm);
    println!("in pieces: mean {mean:.2}, greatest {most:.2} voxels");
    assert!(
        mean < 0.6 && most < 2.5,
        "mean {mean:.2} and greatest {most:.2} voxels from the truth"
    );
    // So little that the tree falls apart: the error names what is enough, and it is.
    let error = find(&v.store, from, Destination::At(to), lumen, 1000).expect_err("too little");
    let message = error.to_string();
    let enough: u64 = message
        .split_once("more --memory: ")
        .and_then(|(_, rest)| rest.split_once("MiB")?.0.parse().ok())
        .unwrap_or_else(|| panic!("{message:?} names the memory that is enough"));
    let line = find(&v.store, from, Destination::At(to), lumen, enough << 20).unwrap();
    assert_eq!(line.first_lod, Lod(0), "with {enough} MiB");
}

/// Two rooms in a solid, 48³: open where `is_open`.
fn solid(is_open: impl Fn(u64, u64, u64) -> bool) -> Bricked {
    let n = 48;
    let mut bytes = Vec::new();
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                bytes.push(u8::from(is_open(x, y, z)));
            }
        }
    }
    let mut source = MemorySource::new([n; 3], VoxelType::U8, bytes);
    source.desc.rescale = Rescale::IDENTITY;
    bricked(&mut source)
}

#[test]
fn what_is_no_way_is_refused_with_what_helps() {
    let room = |low: u64, high: u64, v: u64| (low..high).contains(&v);
    let rooms = solid(|x, y, z| {
        room(10, 20, x) && room(10, 20, y) && room(5, 15, z)
            || room(10, 20, x) && room(10, 20, y) && room(18, 40, z)
    });
    let refused = |v: &Bricked, from: [f64; 3], to: [f64; 3], lumen: [f64; 2]| {
        let to = Destination::At(to.into());
        let error = find(&v.store, from.into(), to, lumen, GIB).expect_err("no way");
        error.to_string()
    };
    let lumen = [0.5, 1.5];
    let (a, b) = ([15.0, 15.0, 8.0], [15.0, 15.0, 30.0]);
    for (message, words) in [
        (
            refused(&rooms, a, b, lumen),
            &["not connected", "1000 voxels", "2200 voxels", "16.0 mm"][..],
        ),
        (
            refused(&rooms, [15.0, 15.0, 2.0], b, lumen),
            &["--from", "found 0", "15,15,5", "(value 1)", "3.0 mm"],
        ),
        (
            refused(&rooms, b, [15.0, 44.0, 30.0], lumen),
            &["--to", "found 0", "15,19,30", "25.0 mm"],
        ),
        (
            refused(&rooms, a, [15.0, 15.0, 99.0], lumen),
            &["--to", "outside"],
        ),
        (
            refused(&rooms, [1.0, 1.0, 1.0], [40.0, 40.0, 40.0], [-0.5, 0.5]),
            &["leaks out", "low x face", "--lumen"],
        ),
        (refused(&rooms, a, b, [2.0, 1.0]), &["LOW not above HIGH"]),
        (
            refused(&rooms, a, b, [7.0, 9.0]),
            &["no voxel of the lumen"],
        ),
        (refused(&rooms, a, a, lumen), &["same place"]),
    ] {
        for word in words {
            assert!(message.contains(word), "{message:?} says {word:?}");
        }
    }
    // A tube that ends at two faces is no leak.
    let tube = solid(|x, y, _| (x as f64 - 20.0).hypot(y as f64 - 24.0) < 6.0);
    let to = Destination::At(DVec3::new(20.0, 24.0, 46.0));
    let line = find(&tube.store, DVec3::new(23.0, 24.0, 1.0), to, lumen, GIB).unwrap();
    for p in &line.points {
        let off = p.position.truncate().distance(glam::DVec2::new(20.0, 24.0));
        assert!(off < 0.7, "{off} off the axis at {}", p.position);
    }
    assert!(
        line.length_mm() > 44.0,
        "from face to face: {}",
        line.length_mm()
    );
}

#[test]
fn ways_one_voxel_wide_stay_inside() {
    // A staircase, one voxel wide, connected over faces.
    let v = solid(|x, y, z| {
        let (i, j) = (x.wrapping_sub(5), y.wrapping_sub(5));
        z == 20 && i < 30 && (i == j || i == j.wrapping_add(1))
    });
    let to = Destination::At(DVec3::new(34.0, 34.0, 20.0));
    let line = find(&v.store, DVec3::new(5.0, 5.0, 20.0), to, [0.5, 1.5], GIB).unwrap();
    assert_eq!(line.inside_share, 1.0, "on the stairs");
}
