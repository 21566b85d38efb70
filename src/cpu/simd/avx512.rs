//! 16 lanes: AVX-512 F, DQ and VL.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{Addresses, Lanes, PerLane};

/// Proof that the processor has AVX-512 F, DQ and VL.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

impl Avx512 {
    /// The proof, where the code is compiled for it.
    #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2")]
    pub(super) fn here() -> Self {
        Self(())
    }
}

#[derive(Clone, Copy)]
pub(super) struct F(__m512);
#[derive(Clone, Copy)]
pub(super) struct I(__m512i);
#[derive(Clone, Copy)]
pub(super) struct M(__mmask16);

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

operator!(F, Add, add, _mm512_add_ps);
operator!(F, Sub, sub, _mm512_sub_ps);
operator!(F, Mul, mul, _mm512_mul_ps);
operator!(F, Div, div, _mm512_div_ps);
operator!(I, Add, add, _mm512_add_epi32);
operator!(I, Sub, sub, _mm512_sub_epi32);
operator!(I, Mul, mul, _mm512_mullo_epi32);
operator!(I, BitAnd, bitand, _mm512_and_si512);
operator!(I, BitOr, bitor, _mm512_or_si512);

impl BitAnd for M {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for M {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
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

impl Lanes for Avx512 {
    const WIDTH: usize = 16;
    const SHAPE: [u32; 2] = [4, 4];
    type F = F;
    type I = I;
    type Places = [__m512i; 2];
    type M = M;

    methods! {
        fn f(v: f32) -> F = F(_mm512_set1_ps(v));
        fn i(v: i32) -> I = I(_mm512_set1_epi32(v));
        fn load_f(v: &PerLane<f32>) -> F = F(_mm512_loadu_ps(v.as_ptr()));
        fn min(a: F, b: F) -> F = F(_mm512_min_ps(a.0, b.0));
        fn max(a: F, b: F) -> F = F(_mm512_max_ps(a.0, b.0));
        fn floor(a: F) -> F =
            F(_mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a.0));
        fn sqrt(a: F) -> F = F(_mm512_sqrt_ps(a.0));
        fn ge(a: F, b: F) -> M = M(_mm512_cmp_ps_mask::<_CMP_GE_OQ>(a.0, b.0));
        fn gt(a: F, b: F) -> M = M(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(a.0, b.0));
        fn pick(m: M, a: F, b: F) -> F = F(_mm512_mask_blend_ps(m.0, b.0, a.0));
        fn min_i(a: I, b: I) -> I = I(_mm512_min_epi32(a.0, b.0));
        fn max_i(a: I, b: I) -> I = I(_mm512_max_epi32(a.0, b.0));
        fn min_u(a: I, b: I) -> I = I(_mm512_min_epu32(a.0, b.0));
        fn eq_i(a: I, b: I) -> M = M(_mm512_cmpeq_epi32_mask(a.0, b.0));
        fn gt_i(a: I, b: I) -> M = M(_mm512_cmpgt_epi32_mask(a.0, b.0));
        fn pick_i(m: M, a: I, b: I) -> I = I(_mm512_mask_blend_epi32(m.0, b.0, a.0));
        fn to_i(a: F) -> I = I(_mm512_cvttps_epi32(a.0));
        fn to_f(a: I) -> F = F(_mm512_cvtepi32_ps(a.0));
        fn as_i(a: F) -> I = I(_mm512_castps_si512(a.0));
        fn as_f(a: I) -> F = F(_mm512_castsi512_ps(a.0));
        fn least(m: M, a: I) -> i32 = _mm512_mask_reduce_min_epi32(m.0, a.0);
        fn greatest(m: M, a: I) -> i32 = _mm512_mask_reduce_max_epi32(m.0, a.0);
    }

    #[inline(always)]
    fn store_f(self, v: F) -> PerLane<f32> {
        let mut out = [0.0; 16];
        // SAFETY: as above; the array is as long as the vector.
        unsafe { _mm512_storeu_ps(out.as_mut_ptr(), v.0) };
        out
    }

    #[inline(always)]
    fn store_i(self, v: I) -> PerLane<i32> {
        let mut out = [0; 16];
        // SAFETY: as above; the array is as long as the vector.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), v.0) };
        out
    }

    #[inline(always)]
    fn mask(self, bits: u32) -> M {
        M(bits as u16)
    }

    #[inline(always)]
    fn bits(self, m: M) -> u32 {
        u32::from(m.0)
    }

    #[inline(always)]
    fn shl<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm512_slli_epi32::<N>(a.0) })
    }

    #[inline(always)]
    fn shr<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm512_srai_epi32::<N>(a.0) })
    }

    #[inline(always)]
    fn shr_u<const N: u32>(self, a: I) -> I {
        // SAFETY: as above.
        I(unsafe { _mm512_srli_epi32::<N>(a.0) })
    }

    #[inline(always)]
    fn look_up(self, table: &[f32], index: I) -> F {
        let last = table.len().min(i32::MAX as usize).strict_sub(1) as i32;
        let index = self.min_u(index, self.i(last));
        // SAFETY: as above; the indices are inside the table.
        F(unsafe { _mm512_i32gather_ps::<4>(index.0, table.as_ptr()) })
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

/// addresses + offset of lanes 0–7 and 8–15.
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2")]
#[inline]
fn places(addresses: &Addresses, offset: I) -> [__m512i; 2] {
    let low = _mm512_cvtepu32_epi64(_mm512_castsi512_si256(offset.0));
    let high = _mm512_cvtepu32_epi64(_mm512_extracti64x4_epi64::<1>(offset.0));
    // SAFETY: the array is as long as two vectors.
    let (first, second) = unsafe {
        let p = addresses.0.as_ptr();
        (
            _mm512_loadu_si512(p.cast()),
            _mm512_loadu_si512(p.add(8).cast()),
        )
    };
    [_mm512_add_epi64(first, low), _mm512_add_epi64(second, high)]
}

/// The four bytes `at` bytes behind each of the places.
///
/// # Safety
/// They can be read.
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2")]
#[inline]
unsafe fn read([low, high]: [__m512i; 2], at: usize) -> I {
    let base = std::ptr::without_provenance::<i32>(at);
    // SAFETY: the caller's promise.
    let (low, high) = unsafe {
        (
            _mm512_i64gather_epi32::<1>(low, base),
            _mm512_i64gather_epi32::<1>(high, base),
        )
    };
    I(_mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high))
}
