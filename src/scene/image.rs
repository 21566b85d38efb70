//! A rendered picture in memory.

use glam::Vec4;

use super::{Background, PictureSettings};

/// Display values as they are composited: premultiplied RGBA per pixel, row 0 at the top, before the background.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` pixels, premultiplied by their opacity.
    pub pixels: Vec<Vec4>,
    /// Per pixel, where its settings ask for them, how far from the eye the first thing lies that its ray met, and what ended
    /// it, mm along the ray (orthographic: from the eye plane); infinite where there is none. Of several rays the nearest.
    pub depths: Option<Vec<[f32; 2]>>,
}

/// The depths of a ray that met nothing.
pub const NO_DEPTHS: [f32; 2] = [f32::INFINITY; 2];

impl Image {
    /// A picture of nothing, `size` pixels.
    pub fn clear([width, height]: [u32; 2]) -> Self {
        Self {
            width,
            height,
            pixels: vec![Vec4::ZERO; width as usize * height as usize],
            depths: None,
        }
    }

    /// The same with depths, if `settings` ask for them.
    pub fn for_settings(settings: &PictureSettings) -> Self {
        let image = Self::clear(settings.size);
        let depths = settings.depths.then(|| vec![NO_DEPTHS; image.pixels.len()]);
        Self { depths, ..image }
    }

    /// Notes the depths of a ray of pixel number `at`.
    pub fn note_depths(&mut self, at: usize, depths: [f32; 2]) {
        if let Some(all) = &mut self.depths {
            for (kept, new) in all[at].iter_mut().zip(depths) {
                *kept = kept.min(new);
            }
        }
    }

    /// The picture over `background`, premultiplied.
    pub fn over(&self, background: Background) -> Vec<Vec4> {
        let over = |p: &Vec4| match background {
            Background::Color(c) => (p.truncate() + (1.0 - p.w) * c).extend(1.0),
            Background::Transparent => *p,
        };
        self.pixels.iter().map(over).collect()
    }

    /// The picture over `background` as straight 8-bit RGBA: round(255 · c), no gamma (cli.md, "Colour").
    pub fn to_rgba8(&self, background: Background) -> Vec<u8> {
        let to_byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.over(background)
            .into_iter()
            .flat_map(|p| {
                let [r, g, b, a] = match background {
                    Background::Color(_) => p.to_array(),
                    Background::Transparent if p.w > 0.0 => {
                        (p.truncate() / p.w).extend(p.w).to_array()
                    }
                    Background::Transparent => [0.0; 4],
                };
                [to_byte(r), to_byte(g), to_byte(b), to_byte(a)]
            })
            .collect()
    }
}
