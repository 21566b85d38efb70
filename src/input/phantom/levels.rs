//! From materials and fractions of full scale to voxels of a type, with the noise inside tissue.

use crate::volume::StoredType;

/// What a shape is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    /// Thousandths of full scale.
    pub(super) level: u32,
    /// Whether noise is added.
    pub(super) noisy: bool,
}

/// Half the width of the noise, in thousandths of full scale.
const NOISE: u32 = 20;

/// Writes voxels of one type.
#[derive(Clone, Copy)]
pub(super) struct Encoder {
    stored: StoredType,
    full_scale: u32,
}

impl Encoder {
    pub(super) const fn new(stored: StoredType) -> Self {
        let full_scale = match stored {
            StoredType::U8 => 255,
            StoredType::U16 => 4095,
            StoredType::F32 => 1,
        };
        Self { stored, full_scale }
    }

    pub(super) const fn voxel_bytes(self) -> usize {
        self.stored.size()
    }

    /// A row of fractions of full scale, each from 0 to 1.
    pub(super) fn fractions(self, fractions: &[f32], out: &mut [u8]) {
        let scale = self.full_scale as f32;
        match self.stored {
            StoredType::U8 => {
                for (o, f) in out.iter_mut().zip(fractions) {
                    *o = (f * scale + 0.5) as u8;
                }
            }
            StoredType::U16 => {
                for (o, f) in out.as_chunks_mut::<2>().0.iter_mut().zip(fractions) {
                    *o = ((f * scale + 0.5) as u16).to_le_bytes();
                }
            }
            StoredType::F32 => {
                for (o, f) in out.as_chunks_mut::<4>().0.iter_mut().zip(fractions) {
                    *o = f.to_le_bytes();
                }
            }
        }
    }

    /// A row of material numbers whose first voxel is `at`; number 0 is air.
    pub(super) fn materials(self, palette: &[Material], row: &[u8], at: [u64; 3], out: &mut [u8]) {
        let seed = row_seed(at[1], at[2]);
        let mut first = 0;
        for run in row.chunk_by(|a, b| a == b) {
            let bytes = &mut out[first * self.voxel_bytes()..][..run.len() * self.voxel_bytes()];
            let x = at[0] as u32;
            self.run(
                palette[usize::from(run[0])],
                (x.wrapping_add(first as u32), seed),
                bytes,
            );
            first += run.len();
        }
    }

    /// Voxels of one material, from column `x` on.
    fn run(self, material: Material, (x, seed): (u32, u32), out: &mut [u8]) {
        let noise = if material.noisy { NOISE } else { 0 };
        // The voxel values within the noise's reach: integer arithmetic, so that none lies outside by a rounding.
        let (least, most) = if material.noisy {
            let scaled = |thousandths: u32| thousandths * self.full_scale;
            (
                scaled(material.level - noise).div_ceil(1000),
                scaled(material.level + noise) / 1000,
            )
        } else {
            let value = (material.level * self.full_scale + 500) / 1000;
            (value, value)
        };
        let count = most.wrapping_sub(least).wrapping_add(1);
        let pick = |i: usize| {
            let h = mix(x.wrapping_add(i as u32), seed);
            least + (((h >> 16) * count) >> 16)
        };
        match (self.stored, material.noisy) {
            (StoredType::U8, false) => out.fill(least as u8),
            (StoredType::U8, true) => {
                for (i, o) in out.iter_mut().enumerate() {
                    *o = pick(i) as u8;
                }
            }
            (StoredType::U16, false) => {
                out.as_chunks_mut().0.fill((least as u16).to_le_bytes());
            }
            (StoredType::U16, true) => {
                for (i, o) in out.as_chunks_mut::<2>().0.iter_mut().enumerate() {
                    *o = (pick(i) as u16).to_le_bytes();
                }
            }
            (StoredType::F32, noisy) => {
                let level = material.level as f32 / 1000.0;
                // A little less than NOISE, so that no rounding leads outside.
                let reach = if noisy { 0.019_999 } else { 0.0 };
                for (i, o) in out.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                    let h = mix(x.wrapping_add(i as u32), seed) >> 8;
                    let signed = h as f32 * (1.0 / 8_388_608.0) - 1.0;
                    *o = (level + signed * reach).to_le_bytes();
                }
            }
        }
    }
}

/// Hash of a row's place.
fn row_seed(y: u64, z: u64) -> u32 {
    let mut h = y.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ z.wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    h ^= h >> 29;
    h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (h >> 32) as u32
}

/// Hash of a column in a row: 32 bits that look independent.
#[inline]
fn mix(x: u32, seed: u32) -> u32 {
    let mut h = x.wrapping_mul(0x9e37_79b1) ^ seed;
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}
