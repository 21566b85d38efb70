//! Least and greatest values of bricks, and of groups of their blocks, as bytes: what modes mip and minip skip them by.

use super::activity::GroupBounds;
use crate::geom::{BLOCKS_PER_BRICK, BLOCKS_PER_EDGE};

/// Codes of the least and the greatest values of bricks, rounded outward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtremeCodes {
    maxima: BoundCodes,
    /// Of negated values.
    minima: BoundCodes,
}

impl ExtremeCodes {
    /// Codes for a volume whose stored values lie in `range`.
    pub fn new(range: [f32; 2]) -> Self {
        Self {
            maxima: BoundCodes::new(range),
            minima: BoundCodes::new([-range[1], -range[0]]),
        }
    }

    /// The codes of a brick whose voxels lie in `range`: of its greatest value, and of its least.
    pub fn of(&self, [low, high]: [f32; 2]) -> [u8; 2] {
        [self.maxima.code(high), self.minima.code(-low)]
    }

    /// The codes of the greatest values of a resident brick's groups of blocks, or of the least, from the ranges of its
    /// blocks.
    pub fn of_groups(&self, ranges: &[[f32; 2]; BLOCKS_PER_BRICK], of_least: bool) -> GroupBounds {
        let mut codes = [0; BLOCKS_PER_BRICK / 8];
        let edge = BLOCKS_PER_EDGE as usize;
        for (block, &range) in ranges.iter().enumerate() {
            let [x, y, z] = [block % edge, block / edge % edge, block / (edge * edge)];
            let group = (z / 2 * (edge / 2) + y / 2) * (edge / 2) + x / 2;
            let code = self.of(range)[usize::from(of_least)];
            codes[group] = codes[group].max(code);
        }
        codes
    }

    /// From a code to the next, in stored values.
    pub fn scale(&self) -> f32 {
        self.maxima.scale
    }
}

/// Greatest values of bricks in eight bits, rounded up: floor + code · scale. For least values, of the negated ones.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BoundCodes {
    floor: f32,
    scale: f32,
}

impl BoundCodes {
    /// Stands for any value.
    const ANY: u8 = 255;

    /// Codes for a volume whose stored values lie in `range`.
    fn new(range: [f32; 2]) -> Self {
        // The greatest value itself has the last code but one.
        let scale = (range[1] - range[0]) / f32::from(Self::ANY - 1) * (1.0 + 1e-5);
        Self {
            floor: range[0],
            // Without a scale every code is ANY.
            scale: if scale.is_finite() { scale } else { 0.0 },
        }
    }

    /// The code of a brick in which no voxel is greater than `maximum`: interpolation may round above it.
    fn code(&self, maximum: f32) -> u8 {
        let bound = maximum + 16.0 * f32::EPSILON * maximum.abs().max(self.floor.abs());
        let code = ((bound - self.floor) / self.scale).ceil();
        // Written so that what is no number is any value.
        if code >= 0.0 && code < f32::from(Self::ANY) {
            let code = code as u8;
            if self.floor + f32::from(code) * self.scale >= bound {
                return code;
            }
            return code + 1;
        }
        Self::ANY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_maxima_are_never_below_them() {
        for range in [[0.0, 240.0], [-1000.5, 3000.25], [16.0, 16.5], [1e-3, 1e30]] {
            let codes = BoundCodes::new(range);
            let mut culled = 0;
            for i in 0..=1000 {
                let maximum = range[0] + (range[1] - range[0]) * (i as f32 / 1000.0);
                let code = codes.code(maximum);
                let bound = codes.floor + f32::from(code) * codes.scale;
                assert!(
                    code == BoundCodes::ANY || bound >= maximum,
                    "{maximum} of {range:?}: {bound}"
                );
                culled += u32::from(bound - maximum <= (range[1] - range[0]) / 200.0);
            }
            assert!(culled > 900, "{range:?}: {culled} of 1001 codes are close");
        }
    }

    #[test]
    fn a_group_has_the_bound_of_its_blocks() {
        let codes = ExtremeCodes::new([0.0, 254.0]);
        let mut ranges = [[100.0, 110.0]; BLOCKS_PER_BRICK];
        // x 3, y 4, z 7: of group 1, 2, 3.
        ranges[3 + 8 * 4 + 64 * 7] = [20.0, 230.0];
        let group = 1 + 4 * 2 + 16 * 3;
        for (of_least, bounds) in [(false, [110.0, 230.0]), (true, [-100.0, -20.0])] {
            for (n, &code) in codes.of_groups(&ranges, of_least).iter().enumerate() {
                let least = if of_least { -254.0 } else { 0.0 };
                let bound = least + f32::from(code) * codes.scale();
                let wanted = bounds[usize::from(n == group)];
                assert!(bound >= wanted && bound < wanted + 2.0, "{n}: {bound}");
            }
        }
    }

    #[test]
    fn without_a_range_any_value_may_come() {
        for range in [[7.0, 7.0], [f32::MIN, f32::MAX]] {
            let codes = BoundCodes::new(range);
            assert_eq!(codes.code(range[1]), BoundCodes::ANY, "{range:?}");
            assert!(codes.scale.is_finite(), "{range:?}");
        }
    }
}
