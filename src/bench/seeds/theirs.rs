//! What the five systems reported (techniques.md), each on hardware of its time: only ratios carry over. All are speeds over
//! speeds: more than 1 is faster.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

/// A ratio as reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reported {
    /// Their data set.
    pub data: Cow<'static, str>,
    /// Speed ÷ speed of what they compared with.
    pub ratio: f64,
}

/// From the frame rates before and after.
const fn fps(data: &'static str, before: f64, after: f64) -> Reported {
    ratio(data, after / before)
}

const fn ratio(data: &'static str, ratio: f64) -> Reported {
    Reported {
        data: Cow::Borrowed(data),
        ratio,
    }
}

/// T1.8: surfaces, the bounding mesh against the bounding box.
pub(super) const T1_MESH: &[Reported] = &[
    fps("256²×128", 14.6, 41.7),
    fps("512²×333", 4.4, 24.3),
    fps("512²×1112", 1.5, 5.1),
];

/// T1.8: the same, with hit points refined and samples five voxels apart.
pub(super) const T1_REFINED: &[Reported] = &[
    fps("256²×128", 14.6, 350.0),
    fps("512²×333", 4.4, 66.4),
    fps("512²×1112", 1.5, 15.1),
];

/// T1.8: lit against unlit volume rendering, both with the mesh.
pub(super) const T1_LIT: &[Reported] = &[
    fps("256²×128", 40.5, 26.7),
    fps("512²×333", 23.9, 11.3),
    fps("512²×1112", 4.4, 1.5),
];

/// T1.8: the share of the bricks of one data set that is active.
pub const T1_BRICKS_ACTIVE: f64 = 0.305;

/// T1.8: the share of its bounding blocks.
pub const T1_BLOCKS_ACTIVE: f64 = 0.072;

/// T2.4: steps of a pixel without and with leaping.
pub(super) const T2_STEPS: [f64; 2] = [177.0, 25.0];

/// T2.4: leaping, surfaces.
pub(super) const T2_LEAP_ISO: &[Reported] = &[
    fps("Engine h0.5", 13.2, 24.2),
    fps("Head", 7.7, 17.1),
    fps("Foot", 6.7, 18.8),
    fps("Abdomen", 3.9, 10.4),
];

/// T2.4: leaping, volume rendering.
pub(super) const T2_LEAP_DVR: &[Reported] = &[
    fps("Foot", 9.7, 13.2),
    fps("Abdomen", 5.6, 6.8),
    fps("Aneurysm", 3.6, 6.2),
    fps("Backpack", 2.6, 3.9),
];

/// T2.4: two rays for each pixel.
pub(super) const T2_TWO: &[Reported] = &[fps("380×340×110", 30.7, 12.6)];

/// T2.4: four rays for each pixel.
pub(super) const T2_FOUR: &[Reported] = &[fps("380×340×110", 30.7, 9.4)];

/// T3.5: the enhanced layers against the basic ones.
pub(super) const T3_ENHANCED: &[Reported] = &[
    fps("32³", 20.9, 26.8),
    fps("64³", 16.3, 20.1),
    fps("128²×64", 15.1, 18.1),
    fps("128³", 10.0, 14.3),
    fps("Bonsai", 4.5, 8.0),
    fps("CT head", 4.0, 7.0),
];

/// T3.5: time in proportion to the pixels, here four times as many.
pub(super) const T3_PIXELS_4: &[Reported] = &[ratio("time ∝ pixels", 1.0 / 4.0)];

/// T3.5: here nine times as many.
pub(super) const T3_PIXELS_9: &[Reported] = &[ratio("time ∝ pixels", 1.0 / 9.0)];

/// T3.5: time in proportion to the rate of samples, here twice.
pub(super) const T3_RATE_2: &[Reported] = &[ratio("time ∝ rate", 1.0 / 2.0)];

/// T3.5: here four times.
pub(super) const T3_RATE_4: &[Reported] = &[ratio("time ∝ rate", 1.0 / 4.0)];

/// T4.4: early ray termination against the plain caster.
pub(super) const T4_ERT: &[Reported] = &[
    fps("Head", 4.8, 14.4),
    fps("Aneurism", 4.8, 8.9),
    fps("Foot", 4.8, 10.2),
    fps("Engine", 6.3, 6.3),
];

/// T4.4: early ray termination and empty-space skipping against the plain caster.
pub(super) const T4_ESS: &[Reported] = &[
    fps("Head", 4.8, 23.4),
    fps("Aneurism", 4.8, 19.6),
    fps("Foot", 4.8, 17.7),
    fps("Engine", 6.3, 13.6),
];

/// T4.4: the passes against none where everything is semi-transparent ("loses about 30 % to the test passes").
pub(super) const T4_SEMI_TRANSPARENT: &[Reported] = &[ratio("semi-transparent", 0.7)];

/// T4.4: least and greatest share of the fragments that contribute to typical images.
pub const T4_CONTRIBUTING: [f64; 2] = [0.002, 0.04];

/// T5.4: slabs against the plain kernel, unshaded ("loses 23–67 %"; of the levels RC and TF).
pub(super) const T5_UNLIT: &[Reported] = &[ratio("at worst", 0.33), ratio("at best", 0.77)];

/// T5.4: the same, shaded, for pictures of 512², 768² and 1024² pixels.
pub(super) const T5_LIT: [&[Reported]; 3] = [
    &[
        ratio("512²×294 in 512²", 1.78),
        ratio("engine in 512²", 0.99),
    ],
    &[
        ratio("512²×294 in 768²", 1.26),
        ratio("engine in 768²", 0.97),
    ],
    &[
        ratio("512²×294 in 1024²", 1.13),
        ratio("engine in 1024²", 0.87),
    ],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Ratios that techniques.md itself prints, rounded as there.
    #[test]
    fn ratios_are_those_of_the_source() {
        let tenths = |list: &[Reported]| -> Vec<i64> {
            let tenths = list.iter().map(|r| (r.ratio * 10.0).round() as i64);
            tenths.collect()
        };
        // Foot is 2.806, printed there as 2.7.
        assert_eq!(tenths(T2_LEAP_ISO), [18, 22, 28, 27]);
        assert_eq!(tenths(T2_LEAP_DVR), [14, 12, 17, 15]);
        assert!(
            T1_REFINED
                .iter()
                .zip(T1_MESH)
                .all(|(r, m)| r.ratio > m.ratio),
            "refinement adds to the mesh"
        );
        assert_ne!(tenths(T4_ESS), tenths(T4_ERT), "two lists");
    }
}
