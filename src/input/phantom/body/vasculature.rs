//! Vessels filled with contrast: aorta and its branches, caval veins, and the arteries of lungs, kidneys and liver.

use glam::DVec3;

use super::{Body, is};

pub(super) fn paint(body: &mut Body) {
    aorta(body);
    branches(body);
    veins(body);
    for side in [-1.0, 1.0] {
        lung(body, side);
    }
}

fn aorta(body: &mut Body) {
    // Up from the left ventricle, over the left main bronchus, down beside the spine to where it forks.
    body.vessel(
        is::VESSEL,
        &[
            [-0.04, 0.08, 0.26],
            [0.02, 0.11, 0.36],
            [0.035, 0.12, 0.46],
            [0.01, 0.08, 0.545],
            [-0.05, -0.01, 0.565],
            [-0.085, -0.11, 0.52],
            [-0.09, -0.15, 0.40],
            [-0.075, -0.15, 0.15],
            [-0.04, -0.12, -0.05],
            [-0.025, -0.085, -0.25],
            [-0.015, -0.075, -0.43],
        ],
        [0.047, 0.031],
    );
}

fn branches(body: &mut Body) {
    for side in [-1.0, 1.0] {
        let fork = [-0.015, -0.075, -0.43];
        body.vessel(
            is::VESSEL,
            &[
                fork,
                [0.08 * side, -0.08, -0.54],
                [0.17 * side, -0.03, -0.66],
                [0.24 * side, 0.10, -0.80],
                [0.29 * side, 0.16, -0.90],
                [0.31 * side, 0.14, -1.02],
            ],
            [0.023, 0.017],
        );
        body.vessel(
            is::VESSEL,
            &[
                [0.12 * side, -0.07, -0.58],
                [0.13 * side, -0.14, -0.68],
                [0.14 * side, -0.17, -0.78],
            ],
            [0.014, 0.008],
        );
        let z = if side > 0.0 { -0.33 } else { -0.27 };
        body.vessel(
            is::VESSEL,
            &[
                [-0.025, -0.09, -0.24],
                [0.09 * side, -0.115, z + 0.03],
                [0.175 * side, -0.14, z],
            ],
            [0.013, 0.011],
        );
        for (dy, dz) in [(0.02, 0.06), (-0.01, -0.06)] {
            body.vessel(
                is::VESSEL,
                &[[0.175 * side, -0.14, z], [0.205 * side, -0.14 + dy, z + dz]],
                [0.009, 0.007],
            );
        }
    }
    // Coeliac trunk with splenic (left) and hepatic (right) arteries, and the mesenteric artery.
    let trunk = [-0.03, -0.03, -0.135];
    body.vessel(is::VESSEL, &[[-0.033, -0.10, -0.12], trunk], [0.014, 0.014]);
    body.vessel(
        is::VESSEL,
        &[
            trunk,
            [-0.12, -0.07, -0.11],
            [-0.20, -0.08, -0.15],
            [-0.29, -0.12, -0.12],
        ],
        [0.011, 0.008],
    );
    body.vessel(
        is::VESSEL,
        &[
            trunk,
            [0.06, 0.0, -0.16],
            [0.14, 0.03, -0.12],
            [0.22, 0.06, -0.06],
        ],
        [0.011, 0.007],
    );
    body.vessel(
        is::VESSEL,
        &[[0.14, 0.03, -0.12], [0.24, -0.04, -0.16]],
        [0.008, 0.006],
    );
    body.vessel(
        is::VESSEL,
        &[
            [-0.027, -0.09, -0.19],
            [-0.01, 0.0, -0.26],
            [0.01, 0.05, -0.42],
            [0.07, 0.06, -0.58],
        ],
        [0.014, 0.008],
    );
    neck(body);
}

fn neck(body: &mut Body) {
    // Brachiocephalic trunk to the right; left carotid and left subclavian from the arch itself.
    let right_fork = [0.065, 0.04, 0.67];
    body.vessel(
        is::VESSEL,
        &[[0.015, 0.075, 0.56], [0.045, 0.06, 0.62], right_fork],
        [0.021, 0.018],
    );
    body.vessel(
        is::VESSEL,
        &[
            right_fork,
            [0.085, -0.01, 0.82],
            [0.095, -0.03, 0.92],
            [0.10, -0.03, 1.02],
        ],
        [0.014, 0.013],
    );
    body.vessel(
        is::VESSEL,
        &[
            right_fork,
            [0.17, 0.0, 0.715],
            [0.30, -0.02, 0.69],
            [0.45, -0.05, 0.62],
        ],
        [0.016, 0.012],
    );
    body.vessel(
        is::VESSEL,
        &[
            [-0.03, 0.03, 0.57],
            [-0.06, 0.03, 0.68],
            [-0.085, -0.01, 0.82],
            [-0.10, -0.03, 1.02],
        ],
        [0.015, 0.013],
    );
    body.vessel(
        is::VESSEL,
        &[
            [-0.065, -0.04, 0.56],
            [-0.10, -0.03, 0.67],
            [-0.18, -0.01, 0.715],
            [-0.30, -0.02, 0.69],
            [-0.45, -0.05, 0.62],
        ],
        [0.016, 0.012],
    );
}

fn veins(body: &mut Body) {
    // Inferior vena cava on the right of the spine, from its fork to the right atrium; superior above it.
    body.vessel(
        is::VESSEL,
        &[
            [0.055, -0.085, -0.46],
            [0.06, -0.085, -0.25],
            [0.065, -0.05, -0.05],
            [0.07, 0.03, 0.08],
            [0.068, 0.08, 0.18],
        ],
        [0.036, 0.04],
    );
    for side in [-1.0, 1.0] {
        body.vessel(
            is::VESSEL,
            &[
                [0.055, -0.085, -0.46],
                [0.055 + 0.065 * side, -0.115, -0.56],
                [0.20 * side, -0.06, -0.68],
                [0.265 * side, 0.09, -0.84],
                [0.275 * side, 0.10, -1.02],
            ],
            [0.026, 0.019],
        );
    }
    body.vessel(
        is::VESSEL,
        &[[0.068, 0.09, 0.27], [0.085, 0.08, 0.42], [0.09, 0.07, 0.56]],
        [0.032, 0.028],
    );
}

/// The pulmonary artery of one side: a tree that forks three times.
fn lung(body: &mut Body, side: f64) {
    let trunk = DVec3::new(-0.055, 0.10, 0.31);
    let hilum = DVec3::new(0.13 * side, -0.035, 0.32);
    let over = DVec3::new(-0.045, 0.03, 0.39);
    let stem = [trunk, over, hilum].map(|p| p.to_array());
    body.vessel(is::VESSEL, &stem, [0.038, 0.026]);
    let lobes = [
        DVec3::new(0.24 * side, 0.06, 0.52),
        DVec3::new(0.29 * side, 0.14, 0.30),
        DVec3::new(0.27 * side, -0.12, 0.14),
        DVec3::new(0.22 * side, -0.16, 0.47),
    ];
    for (n, lobe) in lobes.into_iter().enumerate() {
        body.tube(
            is::VESSEL,
            &[hilum, (hilum + lobe) * 0.5, lobe],
            [0.016, 0.012],
        );
        fork(body, hilum, lobe, (0.010, 3), n as u32);
    }
}

/// Two branches from `at`, going on from `before`, and so on `left` times.
fn fork(body: &mut Body, before: DVec3, at: DVec3, (radius, left): (f64, u32), turn: u32) {
    let ahead = (at - before) * 0.55;
    let helper = [DVec3::X, DVec3::Y, DVec3::Z][(turn % 3) as usize];
    let across = ahead.cross(helper);
    for sign in [-1.0, 1.0] {
        let tip = at + ahead * 0.8 + across * (0.75 * sign);
        // The chest wall ends it.
        if (tip.x / 0.44) * (tip.x / 0.44) + (tip.y / 0.28) * (tip.y / 0.28) > 1.0
            || tip.x.abs() < 0.1
        {
            continue;
        }
        body.tube(is::VESSEL, &[at, tip], [radius, radius]);
        if left > 1 {
            fork(body, at, tip, (radius * 0.75, left - 1), turn + 1);
        }
    }
}
