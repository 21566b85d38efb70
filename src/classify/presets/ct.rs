//! Presets for CT, in Hounsfield units.
//!
//! Values follow what tissues measure: air −1000, lung −900 to −500, fat −120 to −60, water 0, muscle 35 to 70, an enhanced
//! liver 90 to 120, blood with contrast 150 to 500, spongy bone 150 to 400, dense bone from 500 on.

use super::{BLACK, BLOOD, Preset, WHITE, ct};

const BONE_COLOR: [f64; 3] = [1.0, 0.94, 0.83];
const MARROW: [f64; 3] = [0.88, 0.60, 0.45];
const MUSCLE: [f64; 3] = [0.72, 0.25, 0.20];
const FAT: [f64; 3] = [0.90, 0.78, 0.50];
const LUNG_COLOR: [f64; 3] = [0.75, 0.45, 0.40];

pub(super) const BONE: Preset = ct(
    "ct-bone",
    "CT: bone, soft tissue invisible",
    &[(150.0, MARROW), (400.0, BONE_COLOR), (1500.0, WHITE)],
    &[(150.0, 0.0), (300.0, 0.15), (700.0, 0.60), (1500.0, 0.85)],
);

pub(super) const SOFT_TISSUE: Preset = ct(
    "ct-soft-tissue",
    "CT: skin and organs, translucent, with bone",
    &[
        (-120.0, FAT),
        (0.0, MUSCLE),
        (100.0, [0.85, 0.45, 0.35]),
        (300.0, BONE_COLOR),
        (1500.0, WHITE),
    ],
    &[
        (-160.0, 0.0),
        (-60.0, 0.01),
        (20.0, 0.06),
        (80.0, 0.20),
        (300.0, 0.45),
        (1500.0, 0.80),
    ],
);

pub(super) const LUNG: Preset = ct(
    "ct-lung",
    "CT: lung tissue and its vessels; muscle and bone faint",
    &[
        (-950.0, [0.30, 0.45, 0.60]),
        (-700.0, LUNG_COLOR),
        (-400.0, BLOOD),
        (100.0, MARROW),
        (1000.0, WHITE),
    ],
    &[
        (-960.0, 0.0),
        (-850.0, 0.02),
        (-600.0, 0.04),
        (-450.0, 0.20),
        (-250.0, 0.02),
        (-100.0, 0.0),
        (150.0, 0.0),
        (1000.0, 0.05),
    ],
);

pub(super) const ANGIO: Preset = ct(
    "ct-angio",
    "CT with contrast: vessels red, bone pale",
    &[
        (120.0, [0.45, 0.05, 0.05]),
        (300.0, BLOOD),
        (480.0, [0.95, 0.60, 0.40]),
        (700.0, BONE_COLOR),
        (1500.0, WHITE),
    ],
    &[
        (130.0, 0.0),
        (200.0, 0.08),
        (320.0, 0.45),
        (600.0, 0.65),
        (1500.0, 0.85),
    ],
);

pub(super) const MUSCLE_BONE: Preset = ct(
    "ct-muscle-bone",
    "CT: muscle and bone, fat removed",
    &[
        (-20.0, [0.45, 0.12, 0.10]),
        (60.0, MUSCLE),
        (160.0, MARROW),
        (350.0, BONE_COLOR),
        (1500.0, WHITE),
    ],
    &[
        (-10.0, 0.0),
        (30.0, 0.05),
        (80.0, 0.25),
        (200.0, 0.30),
        (500.0, 0.65),
        (1500.0, 0.90),
    ],
);

pub(super) const AIRWAYS: Preset = ct(
    "ct-airways",
    "CT: the surface between air and tissue: airways, gut, skin",
    &[
        (-950.0, [0.35, 0.60, 0.75]),
        (-600.0, [0.85, 0.75, 0.65]),
        (-350.0, LUNG_COLOR),
    ],
    &[
        (-950.0, 0.0),
        (-750.0, 0.05),
        (-600.0, 0.25),
        (-450.0, 0.05),
        (-350.0, 0.0),
    ],
);

pub(super) const BONE_CUT: Preset = ct(
    "ct-bone-cut",
    "CT: bone and the flesh about it, dense enough to be cut open",
    &[
        (-80.0, FAT),
        (30.0, MUSCLE),
        (120.0, [0.80, 0.42, 0.34]),
        (250.0, MARROW),
        (600.0, BONE_COLOR),
        (1600.0, WHITE),
    ],
    &[
        (-140.0, 0.0),
        (-90.0, 0.10),
        (20.0, 0.45),
        (250.0, 0.70),
        (600.0, 0.95),
    ],
);

pub(super) const AORTA: Preset = ct(
    "ct-aorta",
    "CT with contrast: aorta and large arteries, lime and bone pale",
    &[
        (130.0, [0.40, 0.08, 0.05]),
        (220.0, [0.75, 0.20, 0.10]),
        (380.0, [0.92, 0.48, 0.30]),
        (520.0, BONE_COLOR),
        (1400.0, WHITE),
    ],
    &[
        (140.0, 0.0),
        (180.0, 0.30),
        (260.0, 0.60),
        (450.0, 0.75),
        (1400.0, 0.80),
    ],
);

pub(super) const CARDIAC: Preset = ct(
    "ct-cardiac",
    "CT with contrast: heart muscle translucent, chambers and vessels red",
    &[
        (-60.0, FAT),
        (60.0, [0.62, 0.22, 0.18]),
        (160.0, MUSCLE),
        (260.0, BLOOD),
        (420.0, [0.96, 0.72, 0.52]),
        (800.0, BONE_COLOR),
    ],
    &[
        (20.0, 0.0),
        (90.0, 0.04),
        (150.0, 0.15),
        (240.0, 0.50),
        (420.0, 0.70),
        (800.0, 0.85),
    ],
);

pub(super) const CORONARY: Preset = ct(
    "ct-coronary",
    "CT with contrast: coronary arteries over a faint heart",
    &[
        (90.0, [0.45, 0.20, 0.15]),
        (200.0, [0.85, 0.38, 0.15]),
        (320.0, [0.98, 0.75, 0.45]),
        (500.0, [1.0, 0.95, 0.88]),
        (900.0, WHITE),
    ],
    &[
        (110.0, 0.0),
        (170.0, 0.04),
        (230.0, 0.40),
        (330.0, 0.70),
        (900.0, 0.90),
    ],
);

pub(super) const CHEST_CONTRAST: Preset = ct(
    "ct-chest-contrast",
    "CT with contrast: chest with muscle, vessels and ribs",
    &[
        (-150.0, FAT),
        (40.0, MUSCLE),
        (140.0, [0.80, 0.30, 0.24]),
        (240.0, BLOOD),
        (420.0, MARROW),
        (900.0, BONE_COLOR),
    ],
    &[
        (-50.0, 0.0),
        (30.0, 0.08),
        (110.0, 0.22),
        (230.0, 0.55),
        (500.0, 0.70),
        (1200.0, 0.85),
    ],
);

pub(super) const CHEST_VESSELS: Preset = ct(
    "ct-chest-vessels",
    "CT with contrast: vessels of the chest, the lungs' included; flesh faint",
    &[
        (-600.0, [0.50, 0.20, 0.22]),
        (-200.0, [0.70, 0.16, 0.14]),
        (50.0, [0.74, 0.30, 0.24]),
        (200.0, BLOOD),
        (450.0, [0.95, 0.80, 0.65]),
        (1200.0, WHITE),
    ],
    &[
        (-650.0, 0.0),
        (-450.0, 0.10),
        (-250.0, 0.05),
        (-120.0, 0.0),
        (100.0, 0.02),
        (190.0, 0.35),
        (400.0, 0.65),
        (1200.0, 0.80),
    ],
);

pub(super) const PULMONARY: Preset = ct(
    "ct-pulmonary",
    "CT with contrast: the lungs' arteries and veins, nothing else dense",
    &[
        (-750.0, [0.25, 0.35, 0.55]),
        (-500.0, [0.45, 0.45, 0.70]),
        (-300.0, [0.75, 0.25, 0.25]),
        (100.0, BLOOD),
        (350.0, [0.98, 0.66, 0.50]),
    ],
    &[
        (-700.0, 0.0),
        (-550.0, 0.03),
        (-400.0, 0.25),
        (-200.0, 0.30),
        (-110.0, 0.0),
        (130.0, 0.0),
        (200.0, 0.40),
        (400.0, 0.60),
        (600.0, 0.10),
    ],
);

pub(super) const LIVER_VESSELS: Preset = ct(
    "ct-liver-vessels",
    "CT with contrast, venous phase: vessels within a translucent liver",
    &[
        (60.0, [0.45, 0.22, 0.16]),
        (110.0, [0.58, 0.28, 0.20]),
        (150.0, [0.25, 0.35, 0.75]),
        (210.0, [0.50, 0.60, 0.92]),
        (350.0, BONE_COLOR),
    ],
    &[
        (70.0, 0.0),
        (100.0, 0.02),
        (130.0, 0.05),
        (155.0, 0.40),
        (220.0, 0.65),
        (350.0, 0.75),
    ],
);

pub(super) const FAT_LAYER: Preset = ct(
    "ct-fat",
    "CT: fat, with bone faint behind it",
    &[
        (-130.0, [0.95, 0.86, 0.60]),
        (-70.0, FAT),
        (-20.0, [0.80, 0.60, 0.40]),
        (300.0, BONE_COLOR),
    ],
    &[
        (-150.0, 0.0),
        (-115.0, 0.25),
        (-75.0, 0.25),
        (-35.0, 0.0),
        (250.0, 0.0),
        (700.0, 0.05),
    ],
);

pub(super) const MUSCLE_LAYER: Preset = ct(
    "ct-muscle",
    "CT: muscle, without fat; bone pale",
    &[
        (-10.0, [0.50, 0.14, 0.12]),
        (40.0, MUSCLE),
        (90.0, [0.82, 0.38, 0.30]),
        (220.0, MARROW),
        (700.0, BONE_COLOR),
    ],
    &[
        (-15.0, 0.0),
        (15.0, 0.20),
        (65.0, 0.40),
        (110.0, 0.25),
        (250.0, 0.30),
        (700.0, 0.50),
    ],
);

pub(super) const SKIN: Preset = ct(
    "ct-skin",
    "CT: the skin, opaque",
    &[
        (-400.0, [0.78, 0.54, 0.42]),
        (-150.0, [0.88, 0.66, 0.54]),
        (50.0, [0.94, 0.76, 0.64]),
    ],
    &[(-450.0, 0.0), (-300.0, 0.20), (-150.0, 0.80), (0.0, 0.95)],
);

pub(super) const AIR: Preset = ct(
    "ct-air",
    "CT: air itself, in airways and gut and around the patient; cut the latter away",
    &[
        (-1000.0, [0.40, 0.70, 0.90]),
        (-900.0, [0.60, 0.80, 0.90]),
        (-800.0, [0.80, 0.85, 0.85]),
    ],
    &[
        (-1100.0, 0.0),
        (-1020.0, 0.20),
        (-960.0, 0.20),
        (-880.0, 0.05),
        (-820.0, 0.0),
    ],
);

pub(super) const MIP: Preset = ct(
    "ct-mip",
    "CT: greys for --mode mip, from water to dense bone",
    &[(0.0, BLACK), (900.0, WHITE)],
    &[(0.0, 0.0), (900.0, 1.0)],
);

pub(super) const XRAY: Preset = ct(
    "ct-xray",
    "CT: like a radiograph, everything translucent in greys",
    &[
        (-900.0, [0.35, 0.35, 0.40]),
        (0.0, [0.65, 0.65, 0.68]),
        (400.0, [0.90, 0.90, 0.90]),
        (1500.0, WHITE),
    ],
    &[
        (-850.0, 0.0),
        (-150.0, 0.002),
        (60.0, 0.008),
        (300.0, 0.04),
        (1500.0, 0.15),
    ],
);
