//! A rendered picture in memory.

use glam::Vec4;

use super::Background;

/// Display values as they are composited: premultiplied RGBA per pixel, row 0 at the top, before the background.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` pixels, premultiplied by their opacity.
    pub pixels: Vec<Vec4>,
}

impl Image {
    /// A picture of nothing, `size` pixels.
    pub fn clear([width, height]: [u32; 2]) -> Self {
        Self {
            width,
            height,
            pixels: vec![Vec4::ZERO; width as usize * height as usize],
        }
    }

    /// The picture over `background` as straight 8-bit RGBA: round(255 · c), no gamma (cli.md, "Colour").
    pub fn to_rgba8(&self, background: Background) -> Vec<u8> {
        let to_byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        self.pixels
            .iter()
            .flat_map(|p| {
                let [r, g, b, a] = match background {
                    Background::Color(c) => (p.truncate() + (1.0 - p.w) * c).extend(1.0).to_array(),
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
