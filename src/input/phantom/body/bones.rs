//! The skeleton: spine, ribs and sternum, shoulder girdle, pelvis and the heads of the thighs.

use glam::DVec3;

use super::super::shapes::Shape;
use super::{Body, RIB_CAGE, frame, is};

/// Where the vertebral column lies, by height: centre of the body of a vertebra (y), half width, half height.
struct Vertebra {
    y: f64,
    z: f64,
    radius: f64,
    half_height: f64,
    /// 1 for the topmost thoracic vertebra to 12; `None` for those without ribs.
    rib: Option<usize>,
}

/// From L5 up to the neck. The column is bent: forward in the loins, back in the chest, forward in the neck.
fn column() -> Vec<Vertebra> {
    let curve = |z: f64| {
        let chest = 1.0 - ((z - 0.40) / 0.55) * ((z - 0.40) / 0.55);
        -0.185 - 0.06 * chest.max(-0.5)
    };
    let vertebra = |z: f64, radius: f64, half_height: f64, rib: Option<usize>| Vertebra {
        y: curve(z),
        z,
        radius,
        half_height,
        rib,
    };
    let lumbar = (0..5).map(|i| vertebra(-0.47 + 0.095 * f64::from(i), 0.078, 0.037, None));
    let thoracic = (0..12).map(|i| {
        let height = f64::from(i);
        let rib = Some(12 - i as usize);
        vertebra(
            -0.005 + 0.0705 * height,
            0.066 - 0.0016 * height,
            0.0275,
            rib,
        )
    });
    let neck = (0..4).map(|i| vertebra(0.84 + 0.055 * f64::from(i), 0.045, 0.021, None));
    lumbar.chain(thoracic).chain(neck).collect()
}

pub(super) fn paint(body: &mut Body) {
    let column = column();
    pelvis(body);
    for v in &column {
        if let Some(number) = v.rib {
            for side in [-1.0, 1.0] {
                rib(body, v, number, side);
            }
        }
    }
    sternum(body);
    shoulders(body);
    spine(body, &column);
}

fn spine(body: &mut Body, column: &[Vertebra]) {
    for pair in column.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        let center = [0.0, (a.y + b.y) * 0.5, (a.z + b.z) * 0.5];
        let half = (b.z - a.z) * 0.5 - (a.half_height + b.half_height) * 0.25;
        body.ball(is::BOWEL, center, [a.radius * 0.95, a.radius * 0.7, half]);
    }
    for v in column {
        let depth = v.radius * 0.75;
        let back = v.y - depth;
        // Processes first, the body over them.
        for side in [-1.0, 1.0] {
            let lamina = [
                DVec3::new(0.045 * side, back + 0.01, v.z),
                DVec3::new(0.035 * side, back - 0.05, v.z - 0.005),
                DVec3::new(0.0, back - 0.075, v.z - 0.01),
            ];
            body.tube(is::BONE, &lamina, [0.016, 0.016]);
            let transverse = [
                DVec3::new(0.04 * side, back - 0.02, v.z),
                DVec3::new(0.115 * side, back - 0.045, v.z + 0.005),
            ];
            body.tube(is::BONE, &transverse, [0.014, 0.014]);
        }
        let slope = if v.rib.is_some() { 0.055 } else { 0.012 };
        let tip = DVec3::new(0.0, back - 0.135, v.z - 0.01 - slope);
        let spinous = [DVec3::new(0.0, back - 0.07, v.z - 0.01), tip];
        body.tube(is::BONE, &spinous, [0.014, 0.014]);
        cylinder(body, is::CORTEX, v, 1.0);
        cylinder(body, is::MARROW, v, 0.86);
    }
    // Canal with fat round the cord, from the loins to the neck.
    let canal = |z: f64| {
        let near = column
            .iter()
            .min_by(|a, b| (a.z - z).abs().total_cmp(&(b.z - z).abs()));
        near.map_or(DVec3::ZERO, |v| {
            DVec3::new(0.0, v.y - v.radius * 0.75 - 0.03, z)
        })
    };
    let points: Vec<DVec3> = (0..=37)
        .map(|i| canal(-0.5 + 0.041 * f64::from(i)))
        .collect();
    body.tube(is::FAT, &points, [0.026, 0.026]);
    body.tube(is::MUSCLE, &points[10..], [0.015, 0.017]);
}

/// The body of a vertebra: a drum, as two flat ellipsoids and the waist between them.
fn cylinder(body: &mut Body, material: u8, v: &Vertebra, scale: f64) {
    let (r, d, h) = (
        v.radius * scale,
        v.radius * 0.75 * scale,
        v.half_height * scale,
    );
    for shift in [-0.35, 0.35] {
        body.ball(material, [0.0, v.y, v.z + shift * h], [r, d, h * 0.65]);
    }
    body.ball(material, [0.0, v.y, v.z], [r * 0.93, d * 0.93, h]);
}

/// One rib: round the cage from its vertebra, sinking on its way to the front; cartilage from its end to the sternum.
fn rib(body: &mut Body, v: &Vertebra, number: usize, side: f64) {
    /// Degrees round the cage at which bone ends, per rib.
    const ENDS: [f64; 12] = [
        138.0, 145.0, 148.0, 150.0, 150.0, 147.0, 143.0, 136.0, 128.0, 118.0, 84.0, 62.0,
    ];
    let end = ENDS[number - 1];
    let drop = 0.11 + 0.021 * number.min(8) as f64;
    let at = |degrees: f64| {
        let angle = degrees.to_radians();
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let t = degrees / 150.0;
        // Up a little from the joint, then down; below the chest the cage no longer follows.
        let z = v.z + 0.01 - drop * t * t * (2.0 - t) * 1.1;
        let k = RIB_CAGE
            .at(z.clamp(-0.42, 0.90))
            .expect("invariant: z is within the profile's keys");
        // Squarer than an ellipse, as the cavity is.
        let rounder = |v: f64| v * (1.12 - 0.12 * v * v);
        DVec3::new(side * k.a * rounder(sin), k.cy - k.b * rounder(cos), z)
    };
    let joint = DVec3::new(side * v.radius * 0.8, v.y - v.radius * 0.45, v.z);
    let mut points = vec![joint];
    let first = 22.0;
    points.extend((0..=16).map(|i| at(first + (end - first) * f64::from(i) / 16.0)));
    let thickness = if number == 1 { 0.019 } else { 0.021 };
    body.tube(is::CORTEX, &points, [thickness, thickness]);
    body.tube(is::MARROW, &points[1..], [thickness * 0.5, thickness * 0.5]);
    if number <= 10 {
        let from = points[points.len() - 1];
        let level = number.min(7) as f64;
        let joint = DVec3::new(side * 0.035, 0.315 + 0.005 * level, 0.60 - 0.062 * level);
        let middle = (from + joint) * 0.5 + DVec3::new(0.0, 0.015, -0.03);
        let cartilage = super::smooth(&[from, middle, joint].map(|p| p.to_array()));
        body.tube(is::CARTILAGE, &cartilage, [0.019, 0.017]);
    }
}

fn sternum(body: &mut Body) {
    let plate = frame([0.0, 0.10, -1.0], [1.0, 0.0, 0.0]);
    for (scale, material) in [(1.0, is::BONE), (0.6, is::MARROW)] {
        body.tilted(
            material,
            [0.0, 0.29, 0.57],
            [0.085 * scale, 0.024 * scale, 0.075 * scale],
            plate,
        );
        body.tilted(
            material,
            [0.0, 0.335, 0.36],
            [0.05 * scale, 0.022 * scale, 0.18 * scale],
            plate,
        );
    }
    body.ball(is::CARTILAGE, [0.0, 0.345, 0.15], [0.018, 0.012, 0.05]);
}

fn shoulders(body: &mut Body) {
    for side in [-1.0, 1.0] {
        body.vessel(
            is::CORTEX,
            &[
                [0.07 * side, 0.27, 0.63],
                [0.20 * side, 0.24, 0.685],
                [0.34 * side, 0.09, 0.71],
                [0.50 * side, -0.03, 0.72],
            ],
            [0.027, 0.022],
        );
        // Scapula: a thin plate on the back of the ribs, its spine and its socket.
        let plate = frame([0.16 * side, -0.10, 1.0], [0.62 * side, 0.45, 0.0]);
        body.tilted(
            is::BONE,
            [0.36 * side, -0.325, 0.46],
            [0.115, 0.016, 0.215],
            plate,
        );
        body.vessel(
            is::BONE,
            &[
                [0.27 * side, -0.37, 0.53],
                [0.40 * side, -0.34, 0.62],
                [0.52 * side, -0.16, 0.72],
                [0.52 * side, -0.05, 0.735],
            ],
            [0.016, 0.024],
        );
        body.ball(is::BONE, [0.475 * side, -0.14, 0.62], [0.03, 0.05, 0.06]);
        body.ball(
            is::CORTEX,
            [0.555 * side, -0.07, 0.625],
            [0.072, 0.072, 0.072],
        );
        body.ball(is::MARROW, [0.555 * side, -0.07, 0.625], [0.06, 0.06, 0.06]);
    }
}

fn pelvis(body: &mut Body) {
    for side in [-1.0, 1.0] {
        // The wing of the ilium: a thick shell, hollowed by the muscle that lies in it.
        let wing = frame([0.32 * side, -0.10, 1.0], [0.85 * side, 0.5, -0.2]);
        body.tilted(
            is::BONE,
            [0.305 * side, -0.09, -0.62],
            [0.045, 0.20, 0.20],
            wing,
        );
        body.tilted(
            is::MUSCLE,
            [0.270 * side, -0.055, -0.60],
            [0.045, 0.185, 0.185],
            wing,
        );
        body.vessel(
            is::CORTEX,
            &[
                [0.12 * side, -0.25, -0.53],
                [0.25 * side, -0.22, -0.44],
                [0.37 * side, -0.08, -0.43],
                [0.415 * side, 0.07, -0.51],
                [0.37 * side, 0.14, -0.61],
            ],
            [0.026, 0.022],
        );
        // The ring: from the sacrum past the hip joint to the symphysis, and down round the seat.
        let ring = [
            [0.10 * side, -0.22, -0.60],
            [0.24 * side, -0.12, -0.70],
            [0.29 * side, 0.02, -0.79],
            [0.17 * side, 0.14, -0.85],
            [0.02 * side, 0.19, -0.89],
        ];
        body.vessel(is::CORTEX, &ring, [0.045, 0.032]);
        body.vessel(is::MARROW, &ring, [0.030, 0.018]);
        body.vessel(
            is::BONE,
            &[
                [0.02 * side, 0.18, -0.91],
                [0.11 * side, 0.08, -0.985],
                [0.20 * side, -0.10, -0.985],
                [0.25 * side, -0.12, -0.90],
                [0.29 * side, -0.03, -0.82],
            ],
            [0.027, 0.036],
        );
        thigh(body, side);
    }
    sacrum(body);
    body.ball(is::CARTILAGE, [0.0, 0.195, -0.90], [0.02, 0.03, 0.05]);
}

fn thigh(body: &mut Body, side: f64) {
    body.ball(is::BONE, [0.315 * side, 0.01, -0.82], [0.10, 0.095, 0.10]);
    body.ball(
        is::CARTILAGE,
        [0.335 * side, 0.01, -0.835],
        [0.085, 0.083, 0.085],
    );
    let neck = [
        DVec3::new(0.345 * side, 0.01, -0.84),
        DVec3::new(0.465 * side, -0.01, -0.905),
    ];
    let shaft = [
        DVec3::new(0.465 * side, -0.01, -0.905),
        DVec3::new(0.45 * side, 0.0, -1.1),
    ];
    for (material, less) in [(is::CORTEX, 0.0), (is::MARROW, 0.014)] {
        let center = DVec3::new(0.345 * side, 0.01, -0.84);
        let r = 0.075 - less;
        body.ball(material, center.to_array(), [r, r, r]);
        body.tube(material, &neck, [0.045 - less, 0.045 - less]);
        body.tube(material, &shaft, [0.055 - less, 0.055 - less]);
    }
}

/// A wedge that narrows downward and back, with the holes of its nerves.
fn sacrum(body: &mut Body) {
    let axes = frame([0.0, 0.45, 1.0], [1.0, 0.0, 0.0]);
    for (material, scale) in [(is::CORTEX, 1.0), (is::MARROW, 0.85)] {
        for (width, y, z, height) in [
            (0.15, -0.22, -0.57, 0.06),
            (0.12, -0.25, -0.65, 0.055),
            (0.085, -0.28, -0.73, 0.05),
            (0.05, -0.29, -0.80, 0.045),
        ] {
            let radii = [width * scale, 0.055 * scale, height * scale];
            body.tilted(material, [0.0, y, z], radii, axes);
        }
    }
    for side in [-1.0, 1.0] {
        for (x, y, z) in [(0.065, -0.24, -0.61), (0.055, -0.27, -0.69)] {
            let a = DVec3::new(x * side, y - 0.08, z);
            let b = DVec3::new(x * side, y + 0.08, z);
            body.scene.paint(is::FAT, Shape::capsule(a, b, 0.014));
        }
    }
    let coccyx = [
        [0.0, -0.29, -0.84],
        [0.0, -0.27, -0.90],
        [0.0, -0.235, -0.93],
    ];
    body.vessel(is::BONE, &coccyx, [0.02, 0.012]);
}
