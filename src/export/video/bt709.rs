//! RGB to Y′CbCr 4:2:0 as films have it: BT.709, limited range (ITU-R BT.709-6, tables 3 and 4).
//!
//! Display values are taken as they are: no linear light. Chroma is where H.264 has it by default, at the even columns and
//! between two rows: ¼, ½, ¼ across, the mean of both rows.

/// A picture as three planes of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Yuv420 {
    /// Width and height in pixels, both even.
    pub size: [u32; 2],
    /// Luma, a byte per pixel, 16 (black) to 235 (white).
    pub y: Vec<u8>,
    /// Cb, a byte for 2×2 pixels, 16 to 240; 128 is grey.
    pub cb: Vec<u8>,
    /// Cr, as Cb.
    pub cr: Vec<u8>,
}

/// Weights of red and blue in luma.
const KR: f32 = 0.2126;
const KB: f32 = 0.0722;

impl Yuv420 {
    /// The planes of `rgba`, rows of straight RGBA whose alpha has no meaning.
    ///
    /// # Panics
    /// A size is odd, or `rgba` is not `4 · width · height` bytes.
    pub fn from_rgba(rgba: &[u8], size: [u32; 2]) -> Self {
        let [width, height] = size.map(|s| s as usize);
        assert!(width % 2 == 0 && height % 2 == 0, "sizes are even");
        let (pixels, _) = rgba.as_chunks::<4>();
        assert_eq!(pixels.len(), width * height, "four bytes per pixel");
        let mut planes = Self {
            size,
            y: Vec::with_capacity(width * height),
            cb: Vec::with_capacity(width * height / 4),
            cr: Vec::with_capacity(width * height / 4),
        };
        planes
            .y
            .extend(pixels.iter().map(|&p| byte(16.0 + 219.0 * luma(p))));
        // Means of two rows; the picture's edges are repeated.
        let mut rows = vec![[0.0_f32; 2]; width];
        for pair in pixels.chunks_exact(2 * width) {
            let (upper, lower) = pair.split_at(width);
            for ((mean, &a), &b) in rows.iter_mut().zip(upper).zip(lower) {
                let (a, b) = (chroma(a), chroma(b));
                *mean = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
            }
            for x in (0..width).step_by(2) {
                let (left, right) = (rows[x.saturating_sub(1)], rows[x + 1]);
                let of = |c: usize| 0.25 * (left[c] + right[c]) + 0.5 * rows[x][c];
                planes.cb.push(byte(128.0 + 224.0 * of(0)));
                planes.cr.push(byte(128.0 + 224.0 * of(1)));
            }
        }
        planes
    }

    /// The three planes one after the other.
    pub fn planes(&self) -> [&[u8]; 3] {
        [&self.y, &self.cb, &self.cr]
    }
}

fn byte(value: f32) -> u8 {
    value.round() as u8
}

/// 0 to 1.
fn luma([r, g, b, _]: [u8; 4]) -> f32 {
    (KR * f32::from(r) + (1.0 - KR - KB) * f32::from(g) + KB * f32::from(b)) / 255.0
}

/// Cb and Cr, −½ to ½.
fn chroma(pixel: [u8; 4]) -> [f32; 2] {
    let y = luma(pixel);
    let [r, _, b, _] = pixel.map(|c| f32::from(c) / 255.0);
    [(b - y) / (2.0 * (1.0 - KB)), (r - y) / (2.0 * (1.0 - KR))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_standard() {
        // BT.709 limited range, by pencil: 16 + 219·Y′, 128 + 224·Cb, 128 + 224·Cr.
        for (rgb, ycc) in [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
        ] {
            let [r, g, b] = rgb;
            let planes = Yuv420::from_rgba(&[r, g, b, 7].repeat(4 * 2), [4, 2]);
            assert_eq!(planes.y, [ycc[0]; 8], "{rgb:?}: Y");
            assert_eq!(planes.cb, [ycc[1]; 2], "{rgb:?}: Cb");
            assert_eq!(planes.cr, [ycc[2]; 2], "{rgb:?}: Cr");
        }
    }

    #[test]
    fn chroma_lies_at_the_even_columns() {
        // Red in column 2 alone: half of it in the second chroma sample, nothing in the first.
        let mut rgba = vec![0; 4 * 4 * 2];
        for row in 0..2 {
            rgba[(row * 4 + 2) * 4] = 255;
        }
        assert_eq!(Yuv420::from_rgba(&rgba, [4, 2]).cr, [128, 184]);
        // In column 1: a quarter of it in either.
        rgba.rotate_right(12);
        rgba.fill(0);
        for row in 0..2 {
            rgba[(row * 4 + 1) * 4] = 255;
        }
        assert_eq!(Yuv420::from_rgba(&rgba, [4, 2]).cr, [156, 156]);
    }
}
