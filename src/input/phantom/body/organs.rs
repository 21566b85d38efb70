//! Soft parts: lungs, mediastinum, heart, the organs of the abdomen, bowel, and the airways.

use glam::DVec3;

use super::super::shapes::{Profile, Shape, key};
use super::{Body, frame, is};

static RIGHT_LUNG: Profile = Profile {
    keys: &[
        key([-0.20, 0.24, -0.10, 0.19, 0.14]),
        key([-0.05, 0.25, -0.05, 0.20, 0.22]),
        key([0.15, 0.25, -0.01, 0.205, 0.29]),
        key([0.38, 0.24, 0.0, 0.21, 0.30]),
        key([0.58, 0.20, -0.03, 0.175, 0.25]),
        key([0.72, 0.14, -0.07, 0.11, 0.15]),
        key([0.79, 0.11, -0.09, 0.02, 0.03]),
    ],
};

static LEFT_LUNG: Profile = Profile {
    keys: &[
        key([-0.22, -0.26, -0.11, 0.16, 0.14]),
        key([-0.05, -0.27, -0.05, 0.17, 0.22]),
        key([0.15, -0.27, -0.01, 0.18, 0.29]),
        key([0.38, -0.25, 0.0, 0.195, 0.30]),
        key([0.58, -0.20, -0.03, 0.17, 0.25]),
        key([0.72, -0.14, -0.07, 0.11, 0.15]),
        key([0.79, -0.11, -0.09, 0.02, 0.03]),
    ],
};

/// The space of the abdomen and pelvis, filled with fat before the organs.
static ABDOMEN: Profile = Profile {
    keys: &[
        key([-0.92, 0.0, 0.0, 0.12, 0.12]),
        key([-0.75, 0.0, 0.02, 0.26, 0.20]),
        key([-0.50, 0.0, 0.03, 0.38, 0.26]),
        key([-0.20, 0.0, 0.03, 0.41, 0.27]),
        key([0.02, 0.0, 0.02, 0.43, 0.28]),
        key([0.12, 0.0, 0.02, 0.20, 0.14]),
    ],
};

/// What lies between the lungs.
static MEDIASTINUM: Profile = Profile {
    keys: &[
        key([0.0, -0.02, 0.02, 0.14, 0.28]),
        key([0.25, -0.02, 0.02, 0.11, 0.30]),
        key([0.45, 0.0, 0.0, 0.075, 0.30]),
        key([0.62, 0.0, -0.03, 0.075, 0.26]),
        key([0.80, 0.0, -0.07, 0.08, 0.16]),
    ],
};

pub(super) fn paint(body: &mut Body) {
    body.scene.paint(is::FAT, Shape::Profile(&ABDOMEN));
    body.scene.paint(is::LUNG, Shape::Profile(&RIGHT_LUNG));
    body.scene.paint(is::LUNG, Shape::Profile(&LEFT_LUNG));
    body.scene.paint(is::FAT, Shape::Profile(&MEDIASTINUM));
    abdomen(body);
    heart(body);
}

fn abdomen(body: &mut Body) {
    // The diaphragm's domes, the right one higher, lie under the lungs as a rind of muscle.
    body.ball(is::MUSCLE, [0.23, 0.02, -0.10], [0.225, 0.285, 0.235]);
    body.ball(is::MUSCLE, [-0.24, 0.02, -0.13], [0.195, 0.265, 0.205]);
    body.ball(is::FAT, [-0.24, 0.02, -0.14], [0.18, 0.25, 0.195]);

    let down_left = frame([0.35, 0.0, 1.0], [1.0, 0.0, 0.0]);
    body.ball(is::LIVER, [0.23, 0.02, -0.11], [0.21, 0.27, 0.225]);
    body.tilted(
        is::LIVER,
        [0.03, 0.13, -0.03],
        [0.22, 0.13, 0.085],
        down_left,
    );
    body.ball(is::BOWEL, [0.17, 0.17, -0.30], [0.04, 0.06, 0.06]);

    body.tilted(
        is::SPLEEN,
        [-0.31, -0.13, -0.12],
        [0.075, 0.115, 0.15],
        frame([-0.3, 0.5, 1.0], [1.0, 0.0, 0.0]),
    );
    let stomach: Vec<DVec3> = super::smooth(&[
        [-0.19, 0.04, -0.04],
        [-0.24, 0.10, -0.16],
        [-0.17, 0.18, -0.29],
        [-0.02, 0.19, -0.31],
        [0.07, 0.14, -0.26],
    ]);
    body.tube(is::BOWEL, &stomach, [0.105, 0.045]);
    body.ball(is::AIR, [-0.19, 0.11, -0.06], [0.06, 0.05, 0.04]);

    for side in [-1.0, 1.0] {
        // The right kidney lies a little lower, below the liver.
        let z = if side > 0.0 { -0.33 } else { -0.27 };
        let axes = frame([-0.25 * side, -0.15, 1.0], [1.0, 0.0, 0.0]);
        body.tilted(
            is::KIDNEY,
            [0.215 * side, -0.15, z],
            [0.075, 0.06, 0.135],
            axes,
        );
        body.ball(is::FAT, [0.165 * side, -0.125, z], [0.035, 0.025, 0.05]);
        let psoas = super::smooth(&[
            [0.10 * side, -0.17, -0.22],
            [0.14 * side, -0.12, -0.50],
            [0.24 * side, 0.02, -0.80],
        ]);
        body.tube(is::MUSCLE, &psoas, [0.04, 0.065]);
    }
    bowel(body);
}

/// A frame of colon with gas in its bends, small bowel inside, and the bladder.
fn bowel(body: &mut Body) {
    body.vessel(
        is::BOWEL,
        &[
            [0.31, 0.07, -0.62],
            [0.34, 0.06, -0.48],
            [0.33, 0.09, -0.38],
            [0.16, 0.23, -0.40],
            [-0.10, 0.235, -0.42],
            [-0.31, 0.12, -0.36],
            [-0.345, 0.03, -0.50],
            [-0.32, 0.06, -0.64],
            [-0.17, 0.06, -0.70],
            [-0.02, -0.06, -0.72],
            [0.0, -0.13, -0.84],
        ],
        [0.062, 0.042],
    );
    body.vessel(
        is::AIR,
        &[
            [0.22, 0.205, -0.395],
            [0.03, 0.243, -0.405],
            [-0.16, 0.225, -0.41],
        ],
        [0.022, 0.03],
    );
    for (row, z) in [-0.50, -0.58, -0.66].into_iter().enumerate() {
        let shift = if row % 2 == 0 { 0.03 } else { -0.03 };
        body.vessel(
            is::BOWEL,
            &[
                [-0.20 + shift, 0.06, z],
                [-0.10 + shift, 0.17, z + 0.02],
                [0.0 + shift, 0.08, z - 0.01],
                [0.10 + shift, 0.18, z + 0.01],
                [0.19 + shift, 0.07, z],
            ],
            [0.04, 0.04],
        );
    }
    body.ball(is::BOWEL, [0.0, 0.12, -0.84], [0.10, 0.09, 0.085]);
}

fn heart(body: &mut Body) {
    // The apex points to the patient's left, forward and down.
    let axes = frame([-0.75, 0.45, -0.5], [0.0, 0.0, 1.0]);
    body.tilted(is::HEART, [-0.08, 0.11, 0.20], [0.145, 0.135, 0.195], axes);
    // Blood with contrast: left ventricle and atrium; the right side is washed out, but for the atrium.
    body.tilted(
        is::VESSEL,
        [-0.115, 0.10, 0.18],
        [0.058, 0.055, 0.115],
        axes,
    );
    body.ball(is::VESSEL, [-0.02, 0.0, 0.27], [0.085, 0.05, 0.06]);
    body.ball(is::VESSEL, [0.065, 0.09, 0.22], [0.05, 0.06, 0.08]);
}

/// Trachea and main bronchi: a wall, then air that is exactly 0. Last of all, so that nothing lies in the airway.
pub(super) fn paint_airways(body: &mut Body) {
    let trachea = [
        [0.0, 0.03, 1.0],
        [0.0, 0.02, 0.80],
        [0.0, -0.04, 0.58],
        [0.0, -0.06, 0.44],
    ];
    let right = [
        [0.0, -0.06, 0.44],
        [0.09, -0.06, 0.36],
        [0.17, -0.07, 0.27],
        [0.22, -0.09, 0.15],
    ];
    let left = [
        [0.0, -0.06, 0.44],
        [-0.12, -0.06, 0.36],
        [-0.20, -0.07, 0.28],
        [-0.25, -0.10, 0.14],
    ];
    let upper_right = [[0.08, -0.06, 0.37], [0.16, -0.03, 0.43], [0.21, 0.0, 0.52]];
    let upper_left = [
        [-0.14, -0.06, 0.345],
        [-0.20, -0.01, 0.40],
        [-0.24, 0.03, 0.48],
    ];
    for (material, wall) in [(is::MUSCLE, 0.009), (is::AIR, 0.0)] {
        body.vessel(material, &trachea, [0.03 + wall, 0.03 + wall]);
        for branch in [&right[..], &left] {
            body.vessel(material, branch, [0.024 + wall, 0.012 + wall]);
        }
        for branch in [&upper_right[..], &upper_left] {
            body.vessel(material, branch, [0.014 + wall, 0.008 + wall]);
        }
    }
}
