//! From the source's voxel type to the stored one.
//!
//! | source         | `auto` | asked for u8 or u16                                       | asked for f32    |
//! |----------------|--------|-----------------------------------------------------------|------------------|
//! | u8, u16        | same   | refused at the first value that does not fit              | rounded, counted |
//! | i8, i16        | u8, u16 + 128, 32768 | signed types are offset: by 128 (u8, or from i8), else 32768 | rounded, counted |
//! | u32            | f32    | as u16                                                    | rounded, counted |
//! | i32            | f32    | as i16                                                    | rounded, counted |
//! | f32, f64       | f32    | whole numbers only                                        | rounded, counted |
//!
//! "Counted" values are those that f32 can't hold exactly: every command that makes a store reports them. NaN becomes
//! the least finite value of the volume and ±inf the nearest finite one, so that neither the value range nor the
//! averages of the coarser levels are spoilt; that value must be known when the first of them comes ([`FiniteRange`]).

use crate::geom::VoxelBox;
use crate::store::Voxel;
use crate::volume::{SourceError, StoredType, VoxelSource, VoxelType};

use glam::U64Vec3;

/// Least and greatest finite value of a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiniteRange {
    /// What NaN and −inf become.
    pub min: f64,
    /// What +inf becomes.
    pub max: f64,
}

/// The stored type when none is asked for.
pub fn default_type(source: VoxelType) -> StoredType {
    match source {
        VoxelType::U8 | VoxelType::I8 => StoredType::U8,
        VoxelType::U16 | VoxelType::I16 => StoredType::U16,
        VoxelType::U32 | VoxelType::I32 | VoxelType::F32 | VoxelType::F64 => StoredType::F32,
    }
}

/// What is added to a source value: stored = source + offset.
pub fn offset(source: VoxelType, stored: StoredType) -> u32 {
    match (source, stored) {
        (_, StoredType::F32) => 0,
        (VoxelType::I8, _) | (VoxelType::I16 | VoxelType::I32, StoredType::U8) => 128,
        (VoxelType::I16 | VoxelType::I32, StoredType::U16) => 32768,
        _ => 0,
    }
}

/// What converting a run of voxels found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Finite values that changed.
    pub lossy: u64,
    /// NaN values replaced.
    pub nan: u64,
    /// Infinite values replaced.
    pub inf: u64,
    /// The first value that the stored type can't hold: its place in the run, and the value.
    pub misfit: Option<(u64, f64)>,
}

impl Outcome {
    /// Both runs' findings; `other` came `voxels` later.
    pub fn then(self, other: Self, voxels: u64) -> Self {
        Self {
            lossy: self.lossy + other.lossy,
            nan: self.nan + other.nan,
            inf: self.inf + other.inf,
            misfit: self.misfit.or(other.misfit.map(|(at, v)| (at + voxels, v))),
        }
    }
}

/// A stored type that source bytes can be converted to.
pub trait FromSource: Voxel {
    /// Converts little-endian voxels of type `source`. `range` replaces what is not finite.
    fn convert(source: VoxelType, bytes: &[u8], range: FiniteRange, out: &mut [Self]) -> Outcome;
}

/// Calls `$each!` with the reading of an integer source as `i64`.
macro_rules! whole_numbers {
    ($t:ty, $bytes:expr, $offset:expr, $out:expr) => {
        fit_whole(
            $bytes
                .as_chunks::<{ size_of::<$t>() }>()
                .0
                .iter()
                .map(|b| <$t>::from_le_bytes(*b) as i64),
            $offset.into(),
            $out,
        )
    };
}

macro_rules! integer_target {
    ($stored:ty, $same:ident, $signed:ident) => {
        impl FromSource for $stored {
            fn convert(
                source: VoxelType,
                bytes: &[u8],
                range: FiniteRange,
                out: &mut [Self],
            ) -> Outcome {
                const SIZE: usize = size_of::<$stored>();
                let offset = offset(source, Self::TYPE);
                if source == VoxelType::$same {
                    Self::read_le(bytes, out);
                    return Outcome::default();
                }
                if source == VoxelType::$signed {
                    // Adding half the range is flipping the sign bit.
                    const SIGN: $stored = 1 << (<$stored>::BITS - 1);
                    for (o, b) in out.iter_mut().zip(bytes.as_chunks::<SIZE>().0) {
                        *o = Self::from_le_bytes(*b) ^ SIGN;
                    }
                    return Outcome::default();
                }
                match source {
                    VoxelType::U8 => whole_numbers!(u8, bytes, offset, out),
                    VoxelType::I8 => whole_numbers!(i8, bytes, offset, out),
                    VoxelType::U16 => whole_numbers!(u16, bytes, offset, out),
                    VoxelType::I16 => whole_numbers!(i16, bytes, offset, out),
                    VoxelType::U32 => whole_numbers!(u32, bytes, offset, out),
                    VoxelType::I32 => whole_numbers!(i32, bytes, offset, out),
                    VoxelType::F32 => fit_real(reals_f32(bytes), range, out),
                    VoxelType::F64 => fit_real(reals_f64(bytes), range, out),
                }
            }
        }

        impl FitWhole for $stored {
            const GREATEST: i64 = <$stored>::MAX as i64;

            fn from_whole(v: i64) -> Self {
                v as $stored
            }
        }
    };
}

integer_target!(u8, U8, I8);
integer_target!(u16, U16, I16);

trait FitWhole: Copy {
    const GREATEST: i64;
    fn from_whole(v: i64) -> Self;
}

fn fit_whole<T: FitWhole>(
    values: impl Iterator<Item = i64>,
    offset: i64,
    out: &mut [T],
) -> Outcome {
    let mut outcome = Outcome::default();
    for (i, (o, v)) in out.iter_mut().zip(values).enumerate() {
        let stored = v + offset;
        if !(0..=T::GREATEST).contains(&stored) {
            outcome.misfit = Some((i as u64, v as f64));
            break;
        }
        *o = T::from_whole(stored);
    }
    outcome
}

fn fit_real<T: FitWhole>(
    values: impl Iterator<Item = f64>,
    range: FiniteRange,
    out: &mut [T],
) -> Outcome {
    let mut outcome = Outcome::default();
    for (i, (o, v)) in out.iter_mut().zip(values).enumerate() {
        let v = finite(v, range, &mut outcome);
        if v.fract() != 0.0 || !(0.0..=T::GREATEST as f64).contains(&v) {
            outcome.misfit = Some((i as u64, v));
            break;
        }
        *o = T::from_whole(v as i64);
    }
    outcome
}

impl FromSource for f32 {
    fn convert(source: VoxelType, bytes: &[u8], range: FiniteRange, out: &mut [Self]) -> Outcome {
        fn round(values: impl Iterator<Item = f64>, out: &mut [f32]) -> Outcome {
            let mut lossy = 0;
            for (o, v) in out.iter_mut().zip(values) {
                *o = v as f32;
                lossy += u64::from(f64::from(*o) != v);
            }
            Outcome {
                lossy,
                ..Outcome::default()
            }
        }
        match source {
            VoxelType::U8 => round(bytes.iter().map(|&b| b.into()), out),
            VoxelType::I8 => round(bytes.iter().map(|&b| (b as i8).into()), out),
            VoxelType::U16 => {
                let values = bytes.as_chunks::<2>().0.iter();
                round(values.map(|b| u16::from_le_bytes(*b).into()), out)
            }
            VoxelType::I16 => {
                let values = bytes.as_chunks::<2>().0.iter();
                round(values.map(|b| i16::from_le_bytes(*b).into()), out)
            }
            VoxelType::U32 => {
                let values = bytes.as_chunks::<4>().0.iter();
                round(values.map(|b| u32::from_le_bytes(*b).into()), out)
            }
            VoxelType::I32 => {
                let values = bytes.as_chunks::<4>().0.iter();
                round(values.map(|b| i32::from_le_bytes(*b).into()), out)
            }
            VoxelType::F32 => {
                Self::read_le(bytes, out);
                let mut outcome = Outcome::default();
                if !all_finite_f32(bytes) {
                    for v in out.iter_mut().filter(|v| !v.is_finite()) {
                        *v = finite(f64::from(*v), range, &mut outcome) as Self;
                    }
                }
                outcome
            }
            VoxelType::F64 => {
                let mut outcome = Outcome::default();
                for (o, v) in out.iter_mut().zip(reals_f64(bytes)) {
                    let v = finite(v, range, &mut outcome);
                    // Beyond f32 is not infinite: the nearest value that it has.
                    *o = (v as Self).clamp(Self::MIN, Self::MAX);
                    outcome.lossy += u64::from(f64::from(*o) != v);
                }
                outcome
            }
        }
    }
}

/// `v`, or what replaces it when it is not finite.
#[inline]
fn finite(v: f64, range: FiniteRange, outcome: &mut Outcome) -> f64 {
    if v.is_finite() {
        v
    } else if v.is_nan() {
        outcome.nan += 1;
        range.min
    } else {
        outcome.inf += 1;
        if v > 0.0 { range.max } else { range.min }
    }
}

fn reals_f32(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    let values = bytes.as_chunks::<4>().0.iter();
    values.map(|b| f64::from(f32::from_le_bytes(*b)))
}

fn reals_f64(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    let values = bytes.as_chunks::<8>().0.iter();
    values.map(|b| f64::from_le_bytes(*b))
}

fn all_finite_f32(bytes: &[u8]) -> bool {
    // All exponent bits set means NaN or infinite. No early exit: this loop becomes vector instructions.
    !bytes.as_chunks::<4>().0.iter().fold(false, |bad, b| {
        bad | (u32::from_le_bytes(*b) & 0x7f80_0000 == 0x7f80_0000)
    })
}

/// True when no voxel is NaN or infinite.
pub fn all_finite(source: VoxelType, bytes: &[u8]) -> bool {
    match source {
        VoxelType::F32 => all_finite_f32(bytes),
        VoxelType::F64 => !reals_f64(bytes).fold(false, |bad, v| bad | !v.is_finite()),
        _ => true,
    }
}

/// Reads all of `source` for its least and greatest finite value; 0 and 0 when there is none. A source that can be read
/// only once is used up by this.
///
/// # Errors
/// The source can't be read.
pub fn finite_range(
    source: &mut dyn VoxelSource,
    chunk_slices: u64,
) -> Result<FiniteRange, SourceError> {
    let (dims, voxel_type) = (source.desc().dims, source.desc().voxel_type);
    let mut range = FiniteRange {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
    };
    let mut buffer = Vec::new();
    let mut z = 0;
    while z < dims.z {
        let end = dims.z.min(z + chunk_slices.max(1));
        let bytes = dims.x * dims.y * (end - z) * voxel_type.size() as u64;
        buffer.resize(bytes as usize, 0);
        let slices = VoxelBox::new(U64Vec3::new(0, 0, z), U64Vec3::new(dims.x, dims.y, end));
        source.read_box(slices, &mut buffer)?;
        let widen = |range: &mut FiniteRange, v: f64| {
            if v.is_finite() {
                range.min = range.min.min(v);
                range.max = range.max.max(v);
            }
        };
        match voxel_type {
            VoxelType::F32 => reals_f32(&buffer).for_each(|v| widen(&mut range, v)),
            VoxelType::F64 => reals_f64(&buffer).for_each(|v| widen(&mut range, v)),
            // Integers are finite: nobody asks.
            _ => {}
        }
        z = end;
    }
    if range.min > range.max {
        range = FiniteRange { min: 0.0, max: 0.0 };
    }
    Ok(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: FiniteRange = FiniteRange {
        min: -7.0,
        max: 9.0,
    };

    fn run<T: FromSource>(source: VoxelType, bytes: &[u8], n: usize) -> (Vec<T>, Outcome) {
        let mut out = vec![T::default(); n];
        let outcome = T::convert(source, bytes, RANGE, &mut out);
        (out, outcome)
    }

    fn bytes<const N: usize, T, const S: usize>(v: [T; N], le: fn(T) -> [u8; S]) -> Vec<u8> {
        v.into_iter().flat_map(le).collect()
    }

    #[test]
    fn signed_types_are_offset() {
        let b = bytes([i16::MIN, -1, 0, i16::MAX], i16::to_le_bytes);
        let (v, o) = run::<u16>(VoxelType::I16, &b, 4);
        assert_eq!(v, [0, 32767, 32768, 65535], "i16 + 32768");
        assert_eq!(o, Outcome::default(), "exact");
        let (v, _) = run::<u8>(VoxelType::I8, &[0x80, 0xff, 0, 0x7f], 4);
        assert_eq!(v, [0, 127, 128, 255], "i8 + 128");
    }

    #[test]
    fn misfits_are_named() {
        let b = bytes([5u16, 255, 256, 300], u16::to_le_bytes);
        let (_, o) = run::<u8>(VoxelType::U16, &b, 4);
        assert_eq!(o.misfit, Some((2, 256.0)), "256 is no u8");
        let b = bytes([1.0f32, 2.5], f32::to_le_bytes);
        let (_, o) = run::<u16>(VoxelType::F32, &b, 2);
        assert_eq!(o.misfit, Some((1, 2.5)), "2.5 is not whole");
        let b = bytes([-32768i32, 32767, 32768], i32::to_le_bytes);
        let (v, o) = run::<u16>(VoxelType::I32, &b, 3);
        assert_eq!((v[0], v[1]), (0, 65535), "i32 is offset too");
        assert_eq!(o.misfit, Some((2, 32768.0)), "beyond");
    }

    #[test]
    fn what_f32_cannot_hold_is_counted() {
        let b = bytes([16_777_216u32, 16_777_217, u32::MAX], u32::to_le_bytes);
        let (_, o) = run::<f32>(VoxelType::U32, &b, 3);
        assert_eq!(o.lossy, 2, "2²⁴ + 1 and 2³² − 1");
        let b = bytes([0.5, 0.1, 1e300], f64::to_le_bytes);
        let (v, o) = run::<f32>(VoxelType::F64, &b, 3);
        assert_eq!((v[2], o.lossy), (f32::MAX, 2), "0.1, and 1e300 is clamped");
    }

    #[test]
    fn not_finite_values_are_replaced_and_counted() {
        let special = [1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        let b = bytes(special, f32::to_le_bytes);
        let (v, o) = run::<f32>(VoxelType::F32, &b, 4);
        assert_eq!(v, [1.0, -7.0, 9.0, -7.0], "nearest finite values");
        assert_eq!((o.nan, o.inf, o.lossy), (1, 2, 0), "counted");
        assert!(!all_finite(VoxelType::F32, &b), "seen beforehand");
        let b = bytes(special.map(f64::from), f64::to_le_bytes);
        assert_eq!(run::<f32>(VoxelType::F64, &b, 4), (v, o), "f64 alike");
    }
}
