//! Flights through key frames: what is met, how even the speed is, how smoothly the camera turns.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use crate::camera::pose::Basis;

fn key(t: f64, eye: [f64; 3], target: [f64; 3], up: [f64; 3]) -> KeyFrame {
    KeyFrame {
        t,
        eye: DVec3::from_array(eye),
        target: DVec3::from_array(target),
        up: DVec3::from_array(up),
        fov_y_degrees: 40.0 + t,
    }
}

fn path(keys: Vec<KeyFrame>) -> CameraPath {
    CameraPath::new(keys, Projection::Perspective, 0.0).unwrap()
}

fn basis_at(path: &CameraPath, t: f64) -> Basis {
    path.camera_at(t).basis().unwrap()
}

/// Keys whose cameras turn in all ways, unevenly, by up to 130° from one to the next.
fn tumbling() -> Vec<KeyFrame> {
    vec![
        key(0.0, [0.0, -90.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        key(1.0, [60.0, -40.0, 10.0], [0.0, 0.0, 0.0], [0.0, 0.3, 1.0]),
        key(1.7, [80.0, 30.0, 40.0], [20.0, 90.0, 0.0], [0.0, -0.5, 1.0]),
        key(3.2, [20.0, 60.0, 10.0], [90.0, -20.0, 5.0], [1.0, 0.4, 0.2]),
        key(4.0, [-50.0, 50.0, 0.0], [0.0, 0.0, -90.0], [0.0, 1.0, 0.0]),
        key(6.0, [-90.0, 0.0, -30.0], [0.0, 10.0, 0.0], [0.1, 0.0, 1.0]),
    ]
}

/// Angle between two orientations, radians.
fn angle(a: &Basis, b: &Basis) -> f64 {
    let q = |b: &Basis| {
        DQuat::from_mat3(&glam::DMat3::from_cols(b.right, b.up, -b.forward)).normalize()
    };
    2.0 * q(a).dot(q(b)).abs().min(1.0).acos()
}

#[track_caller]
fn assert_keys_are_met(path: &CameraPath) {
    for (i, k) in path.keys().iter().enumerate() {
        let c = path.camera_at(k.t);
        assert!(c.eye.distance(k.eye) < 1e-9, "key {i}: eye {}", c.eye);
        let scale = 1.0 + k.eye.distance(k.target);
        assert!(
            c.target.distance(k.target) < 1e-9 * scale,
            "key {i}: target {} for {}",
            c.target,
            k.target
        );
        let (found, wanted) = (
            c.basis().unwrap(),
            k.camera(path.projection, 0.0).basis().unwrap(),
        );
        assert!(
            found.up.distance(wanted.up) < 1e-9 && found.forward.distance(wanted.forward) < 1e-9,
            "key {i}: {found:?} for {wanted:?}"
        );
        assert_eq!(c.fov_y_degrees, k.fov_y_degrees, "key {i}: fov");
    }
}

#[test]
fn keys_are_met_and_before_and_after_the_camera_stands() {
    let p = path(tumbling());
    assert_keys_are_met(&p);
    assert_eq!(p.camera_at(-5.0), p.camera_at(0.0), "before the first");
    assert_eq!(p.camera_at(99.0), p.camera_at(6.0), "after the last");
    let (slow, d) = (p.with_duration(12.0).unwrap(), p.duration());
    assert_eq!(slow.duration(), 12.0, "twice as long");
    for k in 0..=60 {
        let t = d * f64::from(k) / 60.0;
        let (a, b) = (p.camera_at(t), slow.camera_at(2.0 * t));
        assert!(
            a.eye.distance(b.eye) < 1e-9 && a.target.distance(b.target) < 1e-9,
            "the same way at half the speed, at {t}"
        );
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(p.with_duration(bad).is_err(), "a duration of {bad}");
    }
}

#[test]
fn speed_on_a_helix_is_even() {
    // Keys at uneven angles, up to 23° apart, their times by the angle: constant speed.
    let angles = [0.0, 0.15, 0.25, 0.55, 0.7, 1.0, 1.1, 1.5, 1.85, 2.0];
    let keys = angles
        .iter()
        .map(|&a: &f64| {
            let eye = [30.0 * a.cos(), 30.0 * a.sin(), 8.0 * a];
            key(a, eye, [0.0, 0.0, 8.0 * a], [0.0, 0.0, 1.0])
        })
        .collect();
    let p = path(keys);
    for pair in angles.windows(2) {
        let n = 100;
        let step = (pair[1] - pair[0]) / f64::from(n);
        let speeds: Vec<f64> = (0..n)
            .map(|k| {
                let t = pair[0] + step * f64::from(k);
                p.camera_at(t).eye.distance(p.camera_at(t + step).eye) / step
            })
            .collect();
        let (low, high) = speeds
            .iter()
            .fold((f64::MAX, 0.0_f64), |(l, h), &s| (l.min(s), h.max(s)));
        assert!(
            high / low < 1.01,
            "between {} and {} s the speed goes from {low} to {high} mm/s",
            pair[0],
            pair[1]
        );
    }
    // Negative control: without arc length, u as it is, one piece of uneven keys is far from even.
    let points = [[0.0, 0.0], [1.0, 0.0], [100.0, 0.0], [101.0, 0.0]];
    let naive = |u: f64| {
        let [a, b, c, d] = points.map(|p| p[0]);
        0.5 * ((2.0 * b)
            + (c - a) * u
            + (2.0 * a - 5.0 * b + 4.0 * c - d) * u * u
            + (3.0 * b - a - 3.0 * c + d) * u * u * u)
    };
    let (slow, fast) = (naive(0.01) - naive(0.0), naive(0.51) - naive(0.5));
    assert!(fast / slow > 1.01, "uniform Catmull-Rom: {slow}, {fast}");
}

/// The greatest change of angular velocity from one of `n` frames to the next, radians per frame².
fn jerkiness(n: u32, orientation: &dyn Fn(f64) -> DQuat) -> f64 {
    let step = 6.0 / f64::from(n);
    let turns: Vec<DVec3> = (0..n)
        .map(|k| {
            let (a, b) = (
                orientation(step * f64::from(k)),
                orientation(step * f64::from(k + 1)),
            );
            let turn = b * a.conjugate();
            let turn = if turn.w < 0.0 { -turn } else { turn };
            turn.to_scaled_axis()
        })
        .collect();
    turns
        .windows(2)
        .map(|w| w[0].distance(w[1]))
        .fold(0.0, f64::max)
}

fn quat(b: &Basis) -> DQuat {
    DQuat::from_mat3(&glam::DMat3::from_cols(b.right, b.up, -b.forward)).normalize()
}

#[test]
fn the_camera_turns_without_jerks() {
    let p = path(tumbling());
    let ours = |t: f64| quat(&basis_at(&p, t));
    // What simpler programs do: slerp between keys.
    let slerp = |t: f64| {
        let keys = p.keys();
        let i = keys.partition_point(|k| k.t <= t).clamp(1, keys.len() - 1);
        let (a, b) = (&keys[i - 1], &keys[i]);
        let of = |k: &KeyFrame| quat(&k.camera(Projection::Perspective, 0.0).basis().unwrap());
        of(a).slerp(of(b), (t - a.t) / (b.t - a.t))
    };
    // With 300 frames over 6 s, greatest change of angular velocity per frame: 15 rad/s² is .006 rad per frame².
    const BOUND: f64 = 15.0 * (6.0 / 300.0) * (6.0 / 300.0);
    let (found, control) = (jerkiness(300, &ours), jerkiness(300, &slerp));
    assert!(found < BOUND, "{found} rad per frame² is below {BOUND}");
    assert!(
        control > 3.0 * BOUND,
        "plain slerp jerks by {control} rad per frame²"
    );
    // Acceleration is bounded: half the step, a quarter of the change; at a jump of velocity it would be half.
    let finer = jerkiness(1200, &ours);
    assert!(
        finer < found / 8.0,
        "{finer} at four times the frames, {found}"
    );
    let finer = jerkiness(1200, &slerp);
    assert!(finer > control / 8.0, "slerp: {finer} for {control}");
    let most = (0..300)
        .map(|k| {
            let t = 0.02 * f64::from(k);
            angle(&basis_at(&p, t), &basis_at(&p, t + 0.02)) / 0.02
        })
        .fold(0.0, f64::max);
    assert!(most < 6.0, "angular velocity of {most} rad/s");
}

#[test]
fn half_turns_and_flips_of_up() {
    let there = [0.0, 100.0, 0.0];
    let back = [0.0, -100.0, 0.0];
    let (up, down) = ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
    let p = path(vec![
        key(0.0, [0.0; 3], there, up),
        key(1.0, [1.0, 0.0, 0.0], back, up),
        key(2.0, [2.0, 0.0, 0.0], there, up),
        key(3.0, [3.0, 0.0, 0.0], there, down),
        key(4.0, [4.0, 0.0, 0.0], back, up),
    ]);
    assert_keys_are_met(&p);
    let mut turned = 0.0;
    for k in 0..400 {
        let t = 0.01 * f64::from(k);
        let a = angle(&basis_at(&p, t), &basis_at(&p, t + 0.01));
        assert!(a < 0.2, "a jump of {a} rad at {t} s");
        turned += a;
    }
    let least = 2.0 * TAU;
    assert!(
        (least - 1e-6..1.6 * least).contains(&turned),
        "four half turns, {least} rad, and little more: {turned}"
    );
}

#[test]
fn rests_stay_at_rest() {
    let (a, b) = ([0.0, 0.0, 0.0], [10.0, 0.0, 0.0]);
    let p = path(vec![
        key(0.0, a, [0.0, 9.0, 0.0], [0.0, 0.0, 1.0]),
        key(1.0, b, [10.0, 9.0, 0.0], [0.0, 0.0, 1.0]),
        // Stands and turns.
        key(2.0, b, [19.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        // Stands.
        key(3.0, b, [19.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        key(4.0, [30.0, 5.0, 0.0], [39.0, 9.0, 0.0], [0.0, 0.0, 1.0]),
    ]);
    assert_keys_are_met(&p);
    for k in 0..=100 {
        let t = 1.0 + 0.02 * f64::from(k);
        let c = p.camera_at(t);
        assert!(
            c.eye.distance(DVec3::from_array(b)) < 1e-9,
            "the eye stands at {t}"
        );
        if t >= 2.0 {
            let f = c.basis().unwrap().forward;
            assert!(f.distance(DVec3::X) < 1e-9, "and does not turn at {t}: {f}");
        }
    }
}

#[test]
fn one_key_is_a_path() {
    let p = path(vec![key(
        3.0,
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
        [0.0, 0.0, 1.0],
    )]);
    assert_keys_are_met(&p);
    assert_eq!((p.duration(), p.start(), p.length_mm()), (0.0, 3.0, 0.0));
    assert_eq!(p.camera_at(-1.0), p.camera_at(8.0), "always the same");
    assert_eq!(
        p.with_duration(5.0).unwrap().duration(),
        0.0,
        "stays one key"
    );
}

#[test]
fn what_is_no_path_is_refused() {
    let make = |keys| CameraPath::new(keys, Projection::Perspective, 0.0);
    assert_eq!(make(vec![]), Err(CameraPathError::NoKeys));
    let k = |t| key(t, [0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    for times in [
        [0.0, 0.0],
        [1.0, 0.5],
        [0.0, 1e-9],
        [0.0, f64::NAN],
        [0.0, 1e10],
    ] {
        let found = make(vec![k(times[0]), k(times[1])]);
        assert!(
            matches!(found, Err(CameraPathError::Time { key: 1, .. })),
            "times {times:?}: {found:?}"
        );
    }
    let mut far = k(1.0);
    far.eye.y = 2e9;
    assert!(
        matches!(
            make(vec![k(0.0), far]),
            Err(CameraPathError::TooFar {
                key: 1,
                field: "eye",
                ..
            })
        ),
        "too far"
    );
    let mut blind = k(1.0);
    blind.target = blind.eye;
    assert!(
        matches!(
            make(vec![k(0.0), blind]),
            Err(CameraPathError::Unusable { key: 1, .. })
        ),
        "eye and target are one"
    );
}

fn any_key() -> impl Strategy<Value = (f64, [f64; 3], [f64; 3], [f64; 3])> {
    let v = || prop::array::uniform3(-100.0..100.0f64);
    (0.001..3.0f64, v(), v(), v())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_keys_are_met_and_nothing_jumps(
        raw in prop::collection::vec(any_key(), 1..7),
        repeats in prop::collection::vec(any::<bool>(), 7),
    ) {
        let (mut t, mut keys) = (0.0, Vec::new());
        for ((step, eye, toward, up), again) in raw.into_iter().zip(repeats) {
            t += step;
            let k = key(t, eye, toward, up);
            prop_assume!(k.camera(Projection::Perspective, 0.0).basis().is_ok());
            keys.push(k);
            if again {
                t += 0.5;
                keys.push(KeyFrame { t, ..k });
            }
        }
        let p = path(keys);
        assert_keys_are_met(&p);
        let n = 4000;
        let step = p.duration() / f64::from(n);
        let mut before = p.camera_at(p.start());
        for k in 1..=n {
            let now = p.camera_at(p.start() + step * f64::from(k));
            prop_assert!(now.basis().is_ok(), "a camera that can be used");
            let (a, b) = (before.basis().unwrap(), now.basis().unwrap());
            // Keys are at least a millisecond apart: half a turn in the shortest of them is the fastest there is.
            let most = 3.0 * 3.0 * TAU / 0.001 * step;
            prop_assert!(angle(&a, &b) <= most.max(1e-7), "a jump at frame {}", k);
            before = now;
        }
    }
}
