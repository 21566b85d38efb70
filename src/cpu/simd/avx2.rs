//! 8 lanes: AVX2.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{Addresses, Lanes, PerLane};

/// Proof that the processor has AVX2.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    /// The proof, where the code is compiled for it.
    #[target_feature(enable = "avx2")]
    pub(super) fn here() -> Self {
        Self(())
    }
}

#[derive(Clone, Copy)]
pub(super) struct F(__m256);
#[derive(Clone, Copy)]
pub(super) struct I(__m256i);
/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub(super) struct M(__m256i);

/// An operator by one intrinsic.
macro_rules! operator {
    ($type:ident, $operator:ident, $method:ident, $intrinsic:ident) => {
        impl $operator for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: vectors are made through the token alone, which proves that the processor has the instruction.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(F, Add, add, _mm256_add_ps);
operator!(F, Sub, sub, _mm256_sub_ps);
operator!(F, Mul, mul, _mm256_mul_ps);
operator!(F, Div, div, _mm256_div_ps);
operator!(I, Add, add, _mm256_add_epi32);
operator!(I, Sub, sub, _mm256_sub_epi32);
operator!(I, Mul, mul, _mm256_mullo_epi32);
operator!(I, BitAnd, bitand, _mm256_and_si256);
operator!(I, BitOr, bitor, _mm256_or_si256);
operator!(M, BitAnd, bitand, _mm256_and_si256);
operator!(M, BitOr, bitor, _mm256_or_si256);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_xor_si256(self.0, _mm256_set1_epi32(-1)) })
    }
}

/// Methods that are one expression of intrinsics.
macro_rules! methods {
    ($(fn $name:ident($($arg:ident: $type:ty),*) -> $result:ty = $body:expr;)+) => {$(
        #[inline(always)]
        fn $name(self, $($arg: $type),*) -> $result {
            // SAFETY: the token proves that the processor has the instructions; arrays are as long as vectors.
            unsafe { $body }
        }
    )+};
}

impl Lanes for Avx2 {
    const WIDTH: usize = 8;
    const SHAPE: [u32; 2] = [4, 2];
    type F = F;
    type I = I;
    type Places = [__m256i; 2];
    type M = M;

    methods! {
        fn f(v: f32) -> F = F(_mm256_set1_ps(v));
        fn i(v: i32) -> I = I(_mm256_set1_epi32(v));
        fn load_f(v: &PerLane<f32>) -> F = F(_mm256_loadu_ps(v.as_ptr()));
        fn bits(m: M) -> u32 = _mm256_movemask_ps(_mm256_castsi256_ps(m.0)) as u32;
        fn min(a: F, b: F) -> F = F(_mm256_min_ps(a.0, b.0));
        fn max(a: F, b: F) -> F = F(_mm256_max_ps(a.0, b.0));
        fn floor(a: F) -> F = F(_mm256_floor_ps(a.0));
        fn sqrt(a: F) -> F = F(_mm256_sqrt_ps(a.0));
        fn ge(a: F, b: F) -> M = M(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_GE_OQ>(a.0, b.0)));
        fn gt(a: F, b: F) -> M = M(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_GT_OQ>(a.0, b.0)));
        fn pick(m: M, a: F, b: F) -> F = F(_mm256_blendv_ps(b.0, a.0, _mm256_castsi256_ps(m.0)));
        fn min_i(a: I, b: I) -> I = I(_mm256_min_epi32(a.0, b.0));
        fn max_i(a: I, b: I) -> I = I(_mm256_max_epi32(a.0, b.0));
        fn min_u(a: I, b: I) -> I = I(_mm256_min_epu32(a.0, b.0));
        fn eq_i(a: I, b: I) -> M = M(_mm256_cmpeq_epi32(a.0, b.0));
        fn gt_i(a: I, b: I) -> M = M(_mm256_cmpgt_epi32(a.0, b.0));
        fn pick_i(m: M, a: I, b: I) -> I = I(_mm256_blendv_epi8(b.0, a.0, m.0));
        fn to_i(a: F) -> I = I(_mm256_cvttps_epi32(a.0));
        fn to_f(a: I) -> F = F(_mm256_cvtepi32_ps(a.0));
        fn as_i(a: F) -> I = I(_mm256_castps_si256(a.0));
        fn as_f(a: I) -> F = F(_mm256_castsi256_ps(a.0));
    }

    #[inline(always)]
    fn store_f(self, v: F) -> PerLane<f32> {
        let mut out = [0.0; 16];
        // SAFETY: as above; the array is longer than the vector.
        unsafe { _mm256_storeu_ps(out.as_mut_ptr(), v.0) };
        out
    }

    #[inline(always)]
    fn store_i(self, v: I) -> PerLane<i32> {
        let mut out = [0; 16];
        // SAFETY: as above; the array is longer than the vector.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), v.0) };
        out
    }

    #[inline(always)]
    fn mask(self, bits: u32) -> M {
        // SAFETY: as above.
        unsafe {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let own = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
            M(_mm256_cmpeq_epi32(own, lane))
        }
    }

    #[inline(always)]
    fn shl<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm256_sll_epi32(a.0, _mm_cvtsi32_si128(N as i32)) })
    }

    #[inline(always)]
    fn shr<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm256_sra_epi32(a.0, _mm_cvtsi32_si128(N as i32)) })
    }

    #[inline(always)]
    fn shr_u<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm256_srl_epi32(a.0, _mm_cvtsi32_si128(N as i32)) })
    }

    #[inline(always)]
    fn look_up(self, table: &[f32], index: I) -> F {
        let last = table.len().min(i32::MAX as usize).strict_sub(1) as i32;
        let index = self.min_u(index, self.i(last));
        // SAFETY: as above; the indices are inside the table.
        F(unsafe { _mm256_i32gather_ps::<4>(table.as_ptr(), index.0) })
    }

    #[inline(always)]
    fn places(self, addresses: &Addresses, offset: I) -> Self::Places {
        // SAFETY: as above.
        unsafe { places(addresses, offset) }
    }

    #[inline(always)]
    unsafe fn read(self, places: Self::Places, at: usize) -> I {
        // SAFETY: as above; that the bytes can be read is the caller's promise.
        unsafe { read(places, at) }
    }
}

/// addresses + offset of lanes 0–3 and 4–7.
#[target_feature(enable = "avx2")]
#[inline]
fn places(addresses: &Addresses, offset: I) -> [__m256i; 2] {
    let low = _mm256_cvtepu32_epi64(_mm256_castsi256_si128(offset.0));
    let high = _mm256_cvtepu32_epi64(_mm256_extracti128_si256::<1>(offset.0));
    // SAFETY: the array is longer than two vectors.
    let (first, second) = unsafe {
        let p = addresses.0.as_ptr();
        (
            _mm256_loadu_si256(p.cast()),
            _mm256_loadu_si256(p.add(4).cast()),
        )
    };
    [_mm256_add_epi64(first, low), _mm256_add_epi64(second, high)]
}

/// The four bytes `at` bytes behind each of the places.
///
/// # Safety
/// They can be read.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn read([low, high]: [__m256i; 2], at: usize) -> I {
    let base = std::ptr::without_provenance::<i32>(at);
    // SAFETY: the caller's promise.
    let (low, high) = unsafe {
        (
            _mm256_i64gather_epi32::<1>(base, low),
            _mm256_i64gather_epi32::<1>(base, high),
        )
    };
    I(_mm256_set_m128i(high, low))
}
