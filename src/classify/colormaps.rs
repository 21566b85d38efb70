//! Colour maps as control points: place (0 to 255) and colour (0xRRGGBB), joined linearly in RGB.
//!
//! Each stays within 1/255 of the published 256-entry table everywhere (tested at every 17th entry). Viridis, magma,
//! inferno and plasma are by Stéfan van der Walt, Nathaniel Smith and Eric Firing, released under CC0. Turbo is by Anton
//! Mikhailov, © 2019 Google LLC, Apache License 2.0.

/// Place (0 to 255) and colour (0xRRGGBB).
pub(super) type Stop = (u8, u32);

pub(super) const VIRIDIS: [Stop; 17] = [
    (0, 0x440154),
    (18, 0x481b6d),
    (35, 0x46307e),
    (55, 0x3f4889),
    (87, 0x306a8e),
    (127, 0x21908d),
    (141, 0x1e9d89),
    (154, 0x23a983),
    (166, 0x2fb47c),
    (181, 0x48c16e),
    (197, 0x69cd5b),
    (218, 0x9dd93b),
    (236, 0xcde11d),
    (243, 0xdfe318),
    (248, 0xece51b),
    (254, 0xfbe723),
    (255, 0xfde725),
];

pub(super) const MAGMA: [Stop; 17] = [
    (0, 0x000004),
    (6, 0x02020d),
    (20, 0x0e0b2b),
    (34, 0x20114b),
    (46, 0x331067),
    (55, 0x420f75),
    (68, 0x57157e),
    (94, 0x802582),
    (120, 0xaa337d),
    (143, 0xcf4070),
    (159, 0xe55064),
    (171, 0xf2625d),
    (182, 0xf8765c),
    (195, 0xfc8e64),
    (210, 0xfeaa74),
    (235, 0xfed89a),
    (255, 0xfcfdbf),
];

pub(super) const INFERNO: [Stop; 22] = [
    (0, 0x000004),
    (4, 0x02010a),
    (12, 0x07051b),
    (25, 0x160b39),
    (35, 0x260c51),
    (44, 0x360961),
    (56, 0x4a0c6b),
    (71, 0x62146e),
    (91, 0x82206c),
    (114, 0xa62d60),
    (136, 0xc73e4c),
    (158, 0xe25734),
    (178, 0xf3761b),
    (194, 0xfa9207),
    (199, 0xfb9b06),
    (204, 0xfca50a),
    (213, 0xfbb61a),
    (226, 0xf8cf3a),
    (235, 0xf4e156),
    (244, 0xf1f179),
    (251, 0xf6fa96),
    (255, 0xfcffa4),
];

pub(super) const PLASMA: [Stop; 15] = [
    (0, 0x0d0887),
    (7, 0x20068f),
    (26, 0x43039e),
    (49, 0x6700a8),
    (64, 0x7e03a8),
    (76, 0x8f0da4),
    (98, 0xac2694),
    (128, 0xcc4778),
    (167, 0xeb7556),
    (196, 0xfa9b3d),
    (221, 0xfec029),
    (236, 0xfad824),
    (251, 0xf2f227),
    (254, 0xf0f724),
    (255, 0xf0f921),
];

pub(super) const TURBO: [Stop; 30] = [
    (0, 0x30123b),
    (7, 0x38276d),
    (14, 0x3f3b97),
    (22, 0x4451bf),
    (30, 0x4666dd),
    (36, 0x4776ee),
    (43, 0x4687fb),
    (49, 0x4196ff),
    (56, 0x37a8fa),
    (63, 0x2ab9ee),
    (74, 0x1ad2d2),
    (81, 0x18dec0),
    (85, 0x1ae4b6),
    (92, 0x27eea4),
    (100, 0x3ff68a),
    (113, 0x71fe5f),
    (123, 0x96fe44),
    (131, 0xacfb38),
    (139, 0xc1f334),
    (153, 0xe1dd37),
    (164, 0xf4c73a),
    (172, 0xfbb637),
    (181, 0xfe9e2f),
    (192, 0xfb7e21),
    (205, 0xef5811),
    (214, 0xe2430a),
    (227, 0xca2a04),
    (241, 0xa71401),
    (254, 0x7e0502),
    (255, 0x7a0403),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Every 17th entry of the published tables.
    type Published = [[f64; 3]; 16];

    fn check(name: &str, stops: &[Stop], published: &Published) {
        for (i, expected) in (0..16_u8).map(|i| 17 * i).zip(published) {
            let next = stops.iter().position(|s| s.0 >= i).unwrap();
            let (a, b) = (stops[next.saturating_sub(1)], stops[next]);
            let t = if a.0 == b.0 {
                0.0
            } else {
                f64::from(i - a.0) / f64::from(b.0 - a.0)
            };
            for (c, &expected) in expected.iter().enumerate() {
                let channel = |s: Stop| f64::from(s.1 >> (16 - 8 * c) & 0xff);
                let got = channel(a) + (channel(b) - channel(a)) * t;
                assert!(
                    (got - 255.0 * expected).abs() <= 1.0,
                    "{name}, entry {i}, channel {c}: {got}, published {}",
                    255.0 * expected
                );
            }
        }
    }

    #[test]
    fn maps_are_within_one_level_of_the_published_tables() {
        check("viridis", &VIRIDIS, &VIRIDIS_PUBLISHED);
        check("magma", &MAGMA, &MAGMA_PUBLISHED);
        check("inferno", &INFERNO, &INFERNO_PUBLISHED);
        check("plasma", &PLASMA, &PLASMA_PUBLISHED);
        check("turbo", &TURBO, &TURBO_PUBLISHED);
    }

    const VIRIDIS_PUBLISHED: Published = [
        [0.2670, 0.0049, 0.3294],
        [0.2827, 0.1002, 0.4222],
        [0.2771, 0.1852, 0.4899],
        [0.2539, 0.2653, 0.5300],
        [0.2220, 0.3392, 0.5488],
        [0.1906, 0.4071, 0.5561],
        [0.1636, 0.4711, 0.5581],
        [0.1391, 0.5338, 0.5553],
        [0.1206, 0.5964, 0.5436],
        [0.1347, 0.6586, 0.5176],
        [0.2080, 0.7187, 0.4729],
        [0.3278, 0.7740, 0.4066],
        [0.4775, 0.8214, 0.3182],
        [0.6473, 0.8584, 0.2099],
        [0.8249, 0.8847, 0.1062],
        [0.9932, 0.9062, 0.1439],
    ];
    const MAGMA_PUBLISHED: Published = [
        [0.0015, 0.0005, 0.0139],
        [0.0438, 0.0338, 0.1419],
        [0.1238, 0.0673, 0.2959],
        [0.2321, 0.0599, 0.4377],
        [0.3415, 0.0806, 0.4926],
        [0.4452, 0.1227, 0.5069],
        [0.5503, 0.1612, 0.5057],
        [0.6585, 0.1960, 0.4903],
        [0.7674, 0.2337, 0.4578],
        [0.8688, 0.2877, 0.4093],
        [0.9440, 0.3776, 0.3651],
        [0.9810, 0.4984, 0.3697],
        [0.9947, 0.6243, 0.4274],
        [0.9972, 0.7480, 0.5169],
        [0.9932, 0.8700, 0.6262],
        [0.9871, 0.9914, 0.7495],
    ];
    const INFERNO_PUBLISHED: Published = [
        [0.0015, 0.0005, 0.0139],
        [0.0469, 0.0303, 0.1502],
        [0.1424, 0.0462, 0.3086],
        [0.2582, 0.0386, 0.4065],
        [0.3665, 0.0716, 0.4320],
        [0.4723, 0.1105, 0.4283],
        [0.5783, 0.1480, 0.4044],
        [0.6827, 0.1895, 0.3608],
        [0.7805, 0.2433, 0.2995],
        [0.8650, 0.3168, 0.2261],
        [0.9296, 0.4115, 0.1454],
        [0.9709, 0.5229, 0.0584],
        [0.9876, 0.6453, 0.0399],
        [0.9788, 0.7745, 0.1760],
        [0.9500, 0.9034, 0.3803],
        [0.9884, 0.9984, 0.6449],
    ];
    const PLASMA_PUBLISHED: Published = [
        [0.0504, 0.0298, 0.5280],
        [0.2004, 0.0179, 0.5934],
        [0.3125, 0.0082, 0.6357],
        [0.4176, 0.0006, 0.6584],
        [0.5179, 0.0216, 0.6541],
        [0.6107, 0.0902, 0.6200],
        [0.6928, 0.1651, 0.5645],
        [0.7642, 0.2404, 0.5021],
        [0.8266, 0.3157, 0.4413],
        [0.8814, 0.3925, 0.3832],
        [0.9283, 0.4730, 0.3261],
        [0.9650, 0.5591, 0.2685],
        [0.9883, 0.6523, 0.2114],
        [0.9941, 0.7531, 0.1614],
        [0.9780, 0.8614, 0.1428],
        [0.9400, 0.9752, 0.1313],
    ];
    const TURBO_PUBLISHED: Published = [
        [0.1900, 0.0718, 0.2322],
        [0.2537, 0.2633, 0.6541],
        [0.2769, 0.4415, 0.9133],
        [0.2443, 0.6094, 0.9970],
        [0.1328, 0.7716, 0.8858],
        [0.1034, 0.8960, 0.7150],
        [0.2760, 0.9709, 0.5165],
        [0.5325, 0.9992, 0.3058],
        [0.7260, 0.9647, 0.2064],
        [0.8833, 0.8655, 0.2172],
        [0.9800, 0.7300, 0.2216],
        [0.9930, 0.5521, 0.1542],
        [0.9408, 0.3557, 0.0703],
        [0.8393, 0.2065, 0.0231],
        [0.6860, 0.0954, 0.0048],
        [0.4796, 0.0158, 0.0106],
    ];
}
