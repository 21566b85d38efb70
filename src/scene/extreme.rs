//! What modes mip and minip look for, as one search for the greatest: a minimum is the maximum of negated values, and
//! negation is exact.

use super::Mode;
use crate::volume::StoredType;

/// Which end of the values along a ray is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extreme {
    /// Mode mip.
    Greatest,
    /// Mode minip.
    Least,
}

impl Extreme {
    /// What mode mip or minip looks for; of the others it doesn't matter.
    pub const fn of_mode(mode: Mode) -> Self {
        match mode {
            Mode::MinIp => Self::Least,
            _ => Self::Greatest,
        }
    }

    /// Values times this are searched for the greatest.
    pub const fn sign(self) -> f32 {
        match self {
            Self::Greatest => 1.0,
            Self::Least => -1.0,
        }
    }

    /// No sample among voxels of values in `range`, times [`Self::sign`], is greater than this.
    ///
    /// Integers of 16 bits bound what is interpolated between them, roundings included: a + (b − a)·t can't leave [m, M]
    /// for whole m and M. Above, as a + (M − a) is at most half a unit of M's last place off, and ties go to M, which is
    /// even in f32; below, as a − m is exact. Between floats each of the three interpolations may leave the range by some
    /// roundings of its greatest number: a weight can be 1, the fraction of a place just below a voxel's centre.
    pub fn bound(self, stored_type: StoredType, [low, high]: [f32; 2]) -> f32 {
        let end = match self {
            Self::Greatest => high,
            Self::Least => -low,
        };
        match stored_type {
            StoredType::U8 | StoredType::U16 => end,
            StoredType::F32 => end + 8.0 * f32::EPSILON * low.abs().max(high.abs()),
        }
    }

    /// What the search begins with, in a volume of values in `range`.
    pub fn begin(self, [low, high]: [f32; 2]) -> f32 {
        match self {
            Self::Greatest => low,
            Self::Least => -high,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn trilinear(v: [f32; 8], f: [f32; 3]) -> f32 {
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let x = [0, 2, 4, 6].map(|i| lerp(v[i], v[i + 1], f[0]));
        lerp(lerp(x[0], x[1], f[1]), lerp(x[2], x[3], f[1]), f[2])
    }

    fn check(stored_type: StoredType, v: [f32; 8], f: [f32; 3]) -> Result<(), TestCaseError> {
        let range = [f32::min, f32::max].map(|end| v.into_iter().reduce(end).unwrap());
        let sample = trilinear(v, f);
        for extreme in [Extreme::Greatest, Extreme::Least] {
            let bound = extreme.bound(stored_type, range);
            prop_assert!(
                sample * extreme.sign() <= bound,
                "{sample} of {v:?}: {bound}"
            );
        }
        Ok(())
    }

    /// Weights up to 1, where rounding shows.
    fn weight() -> impl Strategy<Value = f32> {
        prop_oneof![
            0.0..1.0_f32,
            Just(1.0),
            (1..40_u32).prop_map(|n| 1.0 - n as f32 * f32::EPSILON / 2.0),
            (0..30).prop_map(|n| 0.5_f32.powi(n)),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn integers_are_never_left(
            v in proptest::array::uniform8(prop_oneof![0..=65535_u16, Just(65535), Just(1), 0..4_u16]),
            f in proptest::array::uniform3(weight()),
        ) {
            check(StoredType::U16, v.map(f32::from), f)?;
        }

        #[test]
        fn floats_stay_below_their_bounds(
            v in proptest::array::uniform8(prop_oneof![-1e6..1e6_f32, Just(0.1_f32), -1.0..1.0_f32, Just(1e6_f32)]),
            f in proptest::array::uniform3(weight()),
        ) {
            check(StoredType::F32, v, f)?;
        }
    }

    #[test]
    fn floats_do_leave_their_range() {
        // The control of the above: without a margin the bound would be wrong.
        let (a, b) = (-1e6_f32, 0.1_f32);
        assert!(a + (b - a) * 1.0 > b, "rounded beyond its end");
    }
}
