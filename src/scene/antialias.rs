//! Several rays per pixel (techniques.md T2.3): which are cast, which pixels get them, how they become one colour.
//!
//! The only home of marking and averaging. All devices cast the sets of rays that are told here and add them in one order,
//! so that a pixel which two pictures super-sample is equal to the bit in both.

use glam::{UVec3, Vec4};
use rayon::prelude::*;

use super::{AntiAliasing, Image, SamplePattern};
use crate::geom::morton;

/// Rays that are cast as one piece of work: the same ones of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct RaySet {
    /// Where the rays of a pixel pass, from its upper left corner, in pixels; in the order in which they are added.
    pub places: Vec<[f32; 2]>,
    /// The pixels, column and row; what is near in the list is near in the picture. `None`: all.
    pub pixels: Option<Vec<[u32; 2]>>,
}

impl RaySet {
    /// The rays that a picture begins with.
    pub fn first(anti_aliasing: AntiAliasing) -> Self {
        let pattern = match anti_aliasing {
            AntiAliasing::Off | AntiAliasing::Selective { .. } => SamplePattern::One,
            AntiAliasing::Full(pattern) => pattern,
        };
        Self {
            places: pattern.places(),
            pixels: None,
        }
    }

    /// The rays that are cast after those of [`Self::first`] have made `image`: their mean replaces the colour of each of
    /// their pixels. `None` where the picture is complete.
    pub fn second(anti_aliasing: AntiAliasing, image: &Image) -> Option<Self> {
        let AntiAliasing::Selective { pattern, threshold } = anti_aliasing else {
            return None;
        };
        let pixels = differing_pixels(image, threshold);
        (!pixels.is_empty()).then(|| Self {
            places: pattern.places(),
            pixels: Some(pixels),
        })
    }

    /// How many pixels of a picture of `size` get these rays.
    pub fn pixel_count(&self, size: [u32; 2]) -> u64 {
        match &self.pixels {
            Some(list) => list.len() as u64,
            None => u64::from(size[0]) * u64::from(size[1]),
        }
    }
}

/// Adds the colour of ray number `number` of `rays` (at least 1) to its pixel; the last makes that the mean. Rays are added
/// in the order of their numbers: another may round otherwise.
#[inline]
pub fn add_ray(pixel: &mut Vec4, color: Vec4, number: usize, rays: usize) {
    *pixel = if number == 0 { color } else { *pixel + color };
    if number + 1 == rays {
        *pixel *= 1.0 / rays as f32;
    }
}

/// The pixels that differ from one of their four neighbours by more than `threshold` in a channel of the premultiplied
/// colour, opacity included; in Morton order.
pub fn differing_pixels(image: &Image, threshold: f32) -> Vec<[u32; 2]> {
    let [width, height] = [image.width as usize, image.height as usize];
    let row = |y: usize| &image.pixels[y * width..(y + 1) * width];
    let differ = |a: Vec4, b: Vec4| (a - b).abs().max_element() > threshold;
    let mut pixels: Vec<[u32; 2]> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let here = row(y);
            let above = (y > 0).then(|| row(y - 1));
            let below = (y + 1 < height).then(|| row(y + 1));
            (0..width).filter_map(move |x| {
                let pixel = here[x];
                let differs = (x > 0 && differ(pixel, here[x - 1]))
                    || (x + 1 < width && differ(pixel, here[x + 1]))
                    || above.is_some_and(|row| differ(pixel, row[x]))
                    || below.is_some_and(|row| differ(pixel, row[x]));
                differs.then_some([x as u32, y as u32])
            })
        })
        .collect();
    pixels.par_sort_unstable_by_key(|&[x, y]| morton(UVec3::new(x, y, 0)));
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing but one pixel.
    fn dot(size: [u32; 2], at: [u32; 2], color: Vec4) -> Image {
        let mut image = Image::clear(size);
        image.pixels[(at[1] * size[0] + at[0]) as usize] = color;
        image
    }

    #[test]
    fn a_dot_and_its_four_neighbours_are_marked() {
        let image = dot([5, 4], [2, 1], Vec4::new(0.0, 0.25, 0.0, 0.5));
        let mut marked = differing_pixels(&image, 0.4);
        let in_order = marked.clone();
        marked.sort_unstable();
        assert_eq!(marked, [[1, 1], [2, 0], [2, 1], [2, 2], [3, 1]]);
        assert_eq!(
            in_order,
            [[1, 1], [2, 0], [2, 1], [3, 1], [2, 2]],
            "near ones together"
        );
        assert!(
            differing_pixels(&image, 0.5).is_empty(),
            "by no more than that"
        );
        let corner = dot([5, 4], [4, 3], Vec4::new(0.3, 0.0, 0.0, 0.3));
        assert_eq!(differing_pixels(&corner, 0.0).len(), 3, "two neighbours");
    }

    #[test]
    fn only_selective_pictures_have_a_second_set() {
        let image = dot([5, 4], [2, 1], Vec4::ONE);
        let pattern = SamplePattern::FourRotated;
        let selective = AntiAliasing::Selective {
            pattern,
            threshold: 0.1,
        };
        assert_eq!(RaySet::first(selective), RaySet::first(AntiAliasing::Off));
        let full = RaySet::first(AntiAliasing::Full(pattern));
        assert_eq!((full.places.len(), full.pixel_count([5, 4])), (4, 20));
        let second = RaySet::second(selective, &image).unwrap();
        assert_eq!(second.places, full.places);
        assert_eq!(second.pixel_count([5, 4]), 5);
        for whole in [AntiAliasing::Off, AntiAliasing::Full(pattern)] {
            assert_eq!(RaySet::second(whole, &image), None);
        }
        assert_eq!(
            RaySet::second(selective, &Image::clear([5, 4])),
            None,
            "nothing differs"
        );
    }

    #[test]
    fn the_last_ray_makes_the_mean() {
        let mut pixel = Vec4::splat(9.0);
        for (number, value) in [0.25, 0.5, 0.75, 0.5].into_iter().enumerate() {
            add_ray(&mut pixel, Vec4::splat(value), number, 4);
        }
        assert_eq!(pixel, Vec4::splat(0.5), "what was there before is gone");
        add_ray(&mut pixel, Vec4::splat(0.3), 0, 1);
        assert_eq!(
            pixel,
            Vec4::splat(0.3),
            "one ray is its own mean, to the bit"
        );
    }
}
