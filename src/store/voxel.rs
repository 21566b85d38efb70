//! The three voxel types that a store keeps, as Rust types: what the codec and the bricking loops are generic over.

use std::fmt::{Debug, Display};

use bytemuck::Pod;

use crate::volume::StoredType;

/// A voxel as it is stored: `u8`, `u16` or `f32` (always finite).
pub trait Voxel: Pod + PartialOrd + Default + Send + Sync + Debug + Display {
    /// The type's name in the store.
    const TYPE: StoredType;

    /// The value; exact for all three types.
    fn to_f32(self) -> f32;

    /// The voxel of this value, which must be one that [`Self::to_f32`] gives.
    fn from_f32(value: f32) -> Self;

    /// The smaller of two.
    #[inline]
    fn lesser(self, other: Self) -> Self {
        if other < self { other } else { self }
    }

    /// The greater of two.
    #[inline]
    fn greater(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    /// Same bits: 0 and −0 differ.
    fn same_bits(self, other: Self) -> bool;

    /// Writes all first (lowest) bytes, then all second ones, and so on. `out` has `size_of::<Self>()` bytes per voxel.
    fn shuffle(voxels: &[Self], out: &mut [u8]);

    /// Undoes [`Self::shuffle`].
    fn unshuffle(planes: &[u8], out: &mut [Self]);

    /// Voxels as little-endian bytes, `size_of::<Self>()` each.
    fn write_le(voxels: &[Self], out: &mut [u8]);

    /// Voxels from little-endian bytes.
    fn read_le(bytes: &[u8], out: &mut [Self]);
}

impl Voxel for u8 {
    const TYPE: StoredType = StoredType::U8;

    #[inline]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }

    fn from_f32(value: f32) -> Self {
        value as Self
    }

    #[inline]
    fn same_bits(self, other: Self) -> bool {
        self == other
    }

    fn shuffle(voxels: &[Self], out: &mut [u8]) {
        out.copy_from_slice(voxels);
    }

    fn unshuffle(planes: &[u8], out: &mut [Self]) {
        out.copy_from_slice(planes);
    }

    fn write_le(voxels: &[Self], out: &mut [u8]) {
        out.copy_from_slice(voxels);
    }

    fn read_le(bytes: &[u8], out: &mut [Self]) {
        out.copy_from_slice(bytes);
    }
}

impl Voxel for u16 {
    const TYPE: StoredType = StoredType::U16;

    #[inline]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }

    fn from_f32(value: f32) -> Self {
        value as Self
    }

    #[inline]
    fn same_bits(self, other: Self) -> bool {
        self == other
    }

    fn shuffle(voxels: &[Self], out: &mut [u8]) {
        let (low, high) = out.split_at_mut(voxels.len());
        for ((&v, low), high) in voxels.iter().zip(low).zip(high) {
            [*low, *high] = v.to_le_bytes();
        }
    }

    fn unshuffle(planes: &[u8], out: &mut [Self]) {
        let (low, high) = planes.split_at(out.len());
        for ((v, &low), &high) in out.iter_mut().zip(low).zip(high) {
            *v = Self::from_le_bytes([low, high]);
        }
    }

    fn write_le(voxels: &[Self], out: &mut [u8]) {
        for (v, b) in voxels.iter().zip(out.as_chunks_mut::<2>().0) {
            *b = v.to_le_bytes();
        }
    }

    fn read_le(bytes: &[u8], out: &mut [Self]) {
        for (v, b) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
            *v = Self::from_le_bytes(*b);
        }
    }
}

impl Voxel for f32 {
    const TYPE: StoredType = StoredType::F32;

    #[inline]
    fn to_f32(self) -> f32 {
        self
    }

    fn from_f32(value: f32) -> Self {
        value
    }

    #[inline]
    fn same_bits(self, other: Self) -> bool {
        self.to_bits() == other.to_bits()
    }

    fn shuffle(voxels: &[Self], out: &mut [u8]) {
        let n = voxels.len();
        for (byte, plane) in out.chunks_exact_mut(n).enumerate() {
            for (&v, b) in voxels.iter().zip(plane) {
                *b = v.to_le_bytes()[byte];
            }
        }
    }

    fn unshuffle(planes: &[u8], out: &mut [Self]) {
        let n = out.len();
        let (a, rest) = planes.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, d) = rest.split_at(n);
        for ((((v, &a), &b), &c), &d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *v = Self::from_le_bytes([a, b, c, d]);
        }
    }

    fn write_le(voxels: &[Self], out: &mut [u8]) {
        for (v, b) in voxels.iter().zip(out.as_chunks_mut::<4>().0) {
            *b = v.to_le_bytes();
        }
    }

    fn read_le(bytes: &[u8], out: &mut [Self]) {
        for (v, b) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *v = Self::from_le_bytes(*b);
        }
    }
}
