//! Presets for MR, ultrasound and PET, whose values have no common unit: from 0 to 1 over a range.

use super::{BLACK, BLOOD, Preset, WHITE, relative};

pub(super) const HEAD: Preset = relative(
    "mr-head",
    "MR: head with skin, translucent towards the brain",
    &[
        (0.10, [0.35, 0.20, 0.15]),
        (0.35, [0.80, 0.55, 0.45]),
        (0.60, [0.92, 0.85, 0.75]),
        (1.00, WHITE),
    ],
    &[
        (0.12, 0.0),
        (0.25, 0.03),
        (0.50, 0.15),
        (0.75, 0.45),
        (1.0, 0.70),
    ],
);

pub(super) const ANGIO: Preset = relative(
    "mr-angio",
    "MR angiography: bright vessels only",
    &[
        (0.30, [0.40, 0.02, 0.02]),
        (0.60, BLOOD),
        (1.00, [1.0, 0.90, 0.75]),
    ],
    &[(0.35, 0.0), (0.50, 0.15), (0.75, 0.60), (1.0, 0.90)],
);

pub(super) const SOFT: Preset = relative(
    "mr-default",
    "MR: everything that gives signal, from dark red to pale, translucent",
    &[
        (0.05, [0.20, 0.05, 0.04]),
        (0.25, [0.55, 0.28, 0.20]),
        (0.50, [0.80, 0.62, 0.46]),
        (0.80, [0.90, 0.86, 0.78]),
        (1.00, WHITE),
    ],
    &[
        (0.08, 0.0),
        (0.20, 0.05),
        (0.45, 0.20),
        (0.80, 0.40),
        (1.0, 0.55),
    ],
);

pub(super) const MIP: Preset = relative(
    "mr-mip",
    "MR: greys for --mode mip, the darkest tenth left out",
    &[(0.10, BLACK), (1.00, WHITE)],
    &[(0.10, 0.0), (1.0, 1.0)],
);

pub(super) const T2_BRAIN: Preset = relative(
    "mr-t2-brain",
    "MR, T2: fluid bright blue, brain translucent grey",
    &[
        (0.15, [0.25, 0.22, 0.22]),
        (0.40, [0.60, 0.55, 0.52]),
        (0.60, [0.80, 0.76, 0.72]),
        (0.80, [0.50, 0.70, 0.95]),
        (1.00, [0.85, 0.94, 1.0]),
    ],
    &[
        (0.20, 0.0),
        (0.35, 0.05),
        (0.55, 0.15),
        (0.75, 0.45),
        (1.0, 0.75),
    ],
);

pub(super) const FA_BRAIN: Preset = relative(
    "dti-fa",
    "fractional anisotropy: fibre bundles, from blue to yellow",
    &[
        (0.20, [0.10, 0.15, 0.45]),
        (0.40, [0.10, 0.55, 0.60]),
        (0.60, [0.40, 0.80, 0.35]),
        (0.85, [0.98, 0.88, 0.30]),
        (1.00, [1.0, 0.97, 0.80]),
    ],
    &[
        (0.25, 0.0),
        (0.40, 0.06),
        (0.60, 0.30),
        (0.85, 0.65),
        (1.0, 0.80),
    ],
);

pub(super) const FETUS: Preset = relative(
    "us-fetus",
    "ultrasound: surfaces in skin tones, speckle left out",
    &[
        (0.15, [0.35, 0.20, 0.12]),
        (0.35, [0.72, 0.48, 0.34]),
        (0.60, [0.90, 0.70, 0.55]),
        (1.00, [1.0, 0.92, 0.84]),
    ],
    &[
        (0.18, 0.0),
        (0.28, 0.08),
        (0.45, 0.45),
        (0.70, 0.75),
        (1.0, 0.85),
    ],
);

pub(super) const UPTAKE: Preset = relative(
    "pet",
    "PET: uptake glowing from dark red to white, background faint",
    &[
        (0.05, BLACK),
        (0.30, [0.55, 0.05, 0.02]),
        (0.60, [0.98, 0.50, 0.05]),
        (0.85, [1.0, 0.90, 0.35]),
        (1.00, WHITE),
    ],
    &[
        (0.05, 0.0),
        (0.20, 0.01),
        (0.40, 0.08),
        (0.70, 0.45),
        (1.0, 0.80),
    ],
);
