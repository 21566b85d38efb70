//! The shape of the slabs of [`super::Technique::Slab`], and what they need of a device.

use super::{GradientFilter, Mode, PictureSettings, ShadingModel};

/// A work-group's rays, and how many samples of them are in shared memory at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlabShape {
    /// Rays along x: a multiple of 4, at least 8.
    pub width: u32,
    /// Rays along y: a multiple of 2, at least 8.
    pub height: u32,
    /// Samples of a ray, from 1 to [`Self::MOST_SAMPLES`].
    pub depth: u32,
}

impl Default for SlabShape {
    fn default() -> Self {
        // The fastest of those measured (`bench seeds --tables T5`) that fit the 16 KiB which every adapter has, whatever the gradients.
        Self {
            width: 8,
            height: 8,
            depth: 22,
        }
    }
}

/// How far beyond a slab's rays and samples gradients reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlabRim {
    /// Rays on each side, and samples behind.
    pub sides: u32,
    /// Samples in front.
    pub front: u32,
}

impl SlabRim {
    /// What pictures of `settings` need.
    pub fn of(settings: &PictureSettings) -> Self {
        let has_gradients =
            settings.shading.model == ShadingModel::Phong || settings.mode == Mode::Gradient;
        let sides = match settings.shading.gradient {
            _ if !has_gradients || settings.mode.projects() => 0,
            GradientFilter::Central => 1,
            GradientFilter::Filtered => 2,
        };
        // A surface lies between two samples: its gradient is between theirs.
        let is_between = sides > 0 && settings.mode == Mode::Iso;
        Self {
            sides,
            front: sides + u32::from(is_between),
        }
    }
}

impl SlabShape {
    /// Most samples: with those around them, a bit of a word for each.
    pub const MOST_SAMPLES: u32 = 27;

    /// Is it one that can be built at all?
    pub const fn is_sound(self) -> bool {
        self.width >= 8
            && self.width.is_multiple_of(4)
            && self.width <= 1024
            && self.height >= 8
            && self.height.is_multiple_of(2)
            && self.height <= 1024
            && self.depth >= 1
            && self.depth <= Self::MOST_SAMPLES
    }

    /// Rays of a work-group.
    pub const fn rays(self) -> u32 {
        self.width * self.height
    }

    /// Rays with their rim, along x and y.
    pub const fn span(self, rim: SlabRim) -> [u32; 2] {
        [self.width + 2 * rim.sides, self.height + 2 * rim.sides]
    }

    /// Values of a slab, those around it included.
    pub const fn values(self, rim: SlabRim) -> u32 {
        let [wide, high] = self.span(rim);
        wide * high * (rim.front + self.depth + rim.sides)
    }

    /// Bytes of shared memory: the values, which samples each ray takes, and what the group agrees on.
    pub const fn shared_bytes(self, rim: SlabRim) -> u32 {
        (self.values(rim) + self.rays()) * 4 + 64
    }
}

impl std::fmt::Display for SlabShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}×{}×{}", self.width, self.height, self.depth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sound_shape_fits_a_word_per_ray() {
        let shape = SlabShape {
            depth: SlabShape::MOST_SAMPLES,
            ..SlabShape::default()
        };
        // Filtered gradients at surfaces reach farthest.
        let rim = SlabRim { sides: 2, front: 3 };
        assert!(shape.is_sound() && rim.front + shape.depth + rim.sides <= 32);
        assert!(SlabShape::default().shared_bytes(rim) <= 16 << 10);
        for bad in [[4, 8, 4], [10, 8, 4], [8, 9, 4], [8, 8, 0], [8, 8, 28]] {
            let [width, height, depth] = bad;
            let shape = SlabShape {
                width,
                height,
                depth,
            };
            assert!(!shape.is_sound(), "{shape}");
        }
    }
}
