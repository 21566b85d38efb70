//! Collision: a camera that is moved by hand stays in the lumen, slides along its walls, and goes where nothing hinders it.
#![allow(clippy::unwrap_used, reason = "a test that can't go on has failed")]

#[path = "support/memory_source.rs"]
#[allow(dead_code, reason = "shared with the tests of bricking")]
mod memory_source;
#[path = "support/scenes.rs"]
#[allow(dead_code, reason = "shared with the tests of pictures")]
mod scenes;

use brickscope::geom::Lod;
use brickscope::path::Walls;
use brickscope::volume::VoxelType;
use glam::{DAffine3, DMat3, DVec3};
use memory_source::noise;
use scenes::{TestStore, field, store_of};

/// Voxels of 0.8 × 1.1 × 1.7 mm, turned.
fn world_from_index() -> DAffine3 {
    DAffine3::from_mat3_translation(
        DMat3::from_rotation_z(0.5) * DMat3::from_diagonal(DVec3::new(0.8, 1.1, 1.7)),
        DVec3::new(4.0, -7.0, 2.0),
    )
}

/// Physical values of the lumen: sources in memory have a slope of 2, so that 1 is 505.
const RANGE: (f64, f64) = (250.0, 600.0);

const DIMS: DVec3 = DVec3::new(90.0, 60.0, 40.0);

/// A tube along x of radius 10 mm, with 1 (lumen) in 0.
fn tube() -> TestStore {
    let spacing = DVec3::new(0.8, 1.1, 1.7);
    let mut source = field(DIMS.as_u64vec3().to_array(), VoxelType::U8, |p| {
        let off = (p - 0.5) * DIMS * spacing;
        f64::from(u8::from(off.y.hypot(off.z) < 10.0))
    });
    source.desc.world_from_index = world_from_index();
    store_of(&mut source)
}

/// In the tube: part of its length, and mm off its axis.
fn place(along: f64, off: [f64; 2]) -> DVec3 {
    let index = DVec3::new(along * DIMS.x, 0.5 * DIMS.y, 0.5 * DIMS.z) - 0.5;
    let m = world_from_index();
    m.transform_point3(index)
        + m.matrix3.y_axis.normalize() * off[0]
        + m.matrix3.z_axis.normalize() * off[1]
}

#[test]
fn a_camera_stops_before_a_wall_and_slides_along_it() {
    let store = tube();
    let mut walls = Walls::new(&store.store, Lod(0), RANGE);
    let clearance = 2.0;
    let start = place(0.3, [1.0, 0.0]);
    let clear = walls.clear_mm(start).unwrap();
    assert!(clear > 7.0, "in the middle: {clear} mm at {start}");

    let free = place(0.6, [0.0, 2.0]);
    let moved = walls.slide(start, free, clearance).unwrap();
    assert!(
        moved.distance(free) < 1e-9,
        "nothing hinders: {moved} for {free}"
    );

    // Straight at the wall.
    let stopped = walls
        .slide(start, place(0.3, [30.0, 0.0]), clearance)
        .unwrap();
    let clear = walls.clear_mm(stopped).unwrap();
    assert!(
        (clearance..clearance + 0.5).contains(&clear),
        "{clear} mm before it"
    );

    // At a slant: what is left of the way is along the wall.
    let slid = walls
        .slide(start, place(0.7, [30.0, 0.0]), clearance)
        .unwrap();
    let axis = world_from_index().matrix3.x_axis.normalize();
    let (wanted, got) = (
        (place(0.7, [0.0; 2]) - start).dot(axis),
        (slid - start).dot(axis),
    );
    assert!(got > 0.8 * wanted, "{got} of {wanted} mm along the tube");
    assert!(
        walls.clear_mm(slid).unwrap() >= clearance,
        "and clear of the wall"
    );

    // Nearer than allowed: it may leave the wall, and come no nearer.
    let near = place(0.5, [9.0, 0.0]);
    let before = walls.clear_mm(near).unwrap();
    assert!(before > 0.0 && before < clearance, "{before}");
    let pressed = walls
        .slide(near, place(0.5, [40.0, 0.0]), clearance)
        .unwrap();
    assert!(
        walls.clear_mm(pressed).unwrap() >= before - 1e-9,
        "no nearer"
    );
    let back = place(0.5, [2.0, 0.0]);
    assert!(
        walls.slide(near, back, clearance).unwrap().distance(back) < 1e-9,
        "away"
    );

    // Outside nothing holds it.
    let outside = place(0.5, [25.0, 0.0]);
    assert_eq!(walls.clear_mm(outside).unwrap(), 0.0);
    let to = outside + DVec3::X;
    assert_eq!(walls.slide(outside, to, clearance).unwrap(), to);
}

#[test]
fn no_walk_leaves_the_lumen() {
    let store = tube();
    let mut walls = Walls::new(&store.store, Lod(0), RANGE);
    let mut random = noise(3000, 11).map(|v| (v % 10_000) as f64 / 5000.0 - 1.0);
    let mut next = || DVec3::from_array(std::array::from_fn(|_| random.next().unwrap()));
    let (mut at, mut unheld) = (place(0.5, [0.0; 2]), place(0.5, [0.0; 2]));
    let mut left = 0;
    for step in 0..300 {
        let way = next() * 9.0;
        at = walls.slide(at, at + way, 1.5).unwrap();
        let clear = walls.clear_mm(at).unwrap();
        assert!(clear >= 1.5 - 1e-9, "step {step}: {clear} mm from a wall");
        unheld += way;
        left += u32::from(walls.clear_mm(unheld).unwrap() == 0.0);
    }
    // The control: the same walk with nothing to hold it.
    assert!(left > 100, "only {left} of 300 steps outside");
}
