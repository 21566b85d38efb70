//! 8 lanes in arrays, for any processor: as far as the compiler makes vectors of them.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{Addresses, Lanes, MAX_LANES, PerLane};

const N: usize = 8;

/// Needs no proof.
#[derive(Clone, Copy)]
pub(super) struct Portable;

#[derive(Clone, Copy)]
pub(super) struct F([f32; N]);
#[derive(Clone, Copy)]
pub(super) struct I([i32; N]);
#[derive(Clone, Copy)]
pub(super) struct M([bool; N]);

/// An operator lane by lane.
macro_rules! operator {
    ($type:ident, $operator:ident, $method:ident, $each:expr) => {
        impl $operator for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|n| $each(self.0[n], other.0[n])))
            }
        }
    };
}

operator!(F, Add, add, |a: f32, b: f32| a + b);
operator!(F, Sub, sub, |a: f32, b: f32| a - b);
operator!(F, Mul, mul, |a: f32, b: f32| a * b);
operator!(F, Div, div, |a: f32, b: f32| a / b);
operator!(I, Add, add, i32::wrapping_add);
operator!(I, Sub, sub, i32::wrapping_sub);
operator!(I, Mul, mul, i32::wrapping_mul);
operator!(I, BitAnd, bitand, |a: i32, b: i32| a & b);
operator!(I, BitOr, bitor, |a: i32, b: i32| a | b);
operator!(M, BitAnd, bitand, |a: bool, b: bool| a & b);
operator!(M, BitOr, bitor, |a: bool, b: bool| a | b);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.map(|a| !a))
    }
}

#[inline(always)]
fn each<A: Copy, R>(a: [A; N], f: impl Fn(A) -> R) -> [R; N] {
    a.map(f)
}

#[inline(always)]
fn both<A: Copy, B: Copy, R>(a: [A; N], b: [B; N], f: impl Fn(A, B) -> R) -> [R; N] {
    std::array::from_fn(|n| f(a[n], b[n]))
}

#[inline(always)]
fn widen<T: Copy + Default>(a: [T; N]) -> PerLane<T> {
    let mut out = [T::default(); MAX_LANES];
    out[..N].copy_from_slice(&a);
    out
}

/// Methods that are one expression.
macro_rules! methods {
    ($(fn $name:ident($($arg:ident: $type:ty),*) -> $result:ty = $body:expr;)+) => {$(
        #[inline(always)]
        fn $name(self, $($arg: $type),*) -> $result {
            $body
        }
    )+};
}

impl Lanes for Portable {
    const WIDTH: usize = N;
    const SHAPE: [u32; 2] = [4, 2];
    type F = F;
    type I = I;
    type Places = [usize; N];
    type M = M;

    methods! {
        fn f(v: f32) -> F = F([v; N]);
        fn i(v: i32) -> I = I([v; N]);
        fn load_f(v: &PerLane<f32>) -> F = F(std::array::from_fn(|n| v[n]));
        fn store_f(v: F) -> PerLane<f32> = widen(v.0);
        fn store_i(v: I) -> PerLane<i32> = widen(v.0);
        fn mask(bits: u32) -> M = M(std::array::from_fn(|n| bits >> n & 1 == 1));
        fn bits(m: M) -> u32 = (0..N).fold(0, |s, n| s | u32::from(m.0[n]) << n);
        fn min(a: F, b: F) -> F = F(both(a.0, b.0, |a, b| if a < b { a } else { b }));
        fn max(a: F, b: F) -> F = F(both(a.0, b.0, |a, b| if a > b { a } else { b }));
        fn floor(a: F) -> F = F(each(a.0, f32::floor));
        fn sqrt(a: F) -> F = F(each(a.0, f32::sqrt));
        fn ge(a: F, b: F) -> M = M(both(a.0, b.0, |a, b| a >= b));
        fn gt(a: F, b: F) -> M = M(both(a.0, b.0, |a, b| a > b));
        fn pick(m: M, a: F, b: F) -> F =
            F(std::array::from_fn(|n| if m.0[n] { a.0[n] } else { b.0[n] }));
        fn min_i(a: I, b: I) -> I = I(both(a.0, b.0, i32::min));
        fn max_i(a: I, b: I) -> I = I(both(a.0, b.0, i32::max));
        fn min_u(a: I, b: I) -> I = I(both(a.0, b.0, |a, b| (a as u32).min(b as u32) as i32));
        fn eq_i(a: I, b: I) -> M = M(both(a.0, b.0, |a, b| a == b));
        fn gt_i(a: I, b: I) -> M = M(both(a.0, b.0, |a, b| a > b));
        fn pick_i(m: M, a: I, b: I) -> I =
            I(std::array::from_fn(|n| if m.0[n] { a.0[n] } else { b.0[n] }));
        fn to_i(a: F) -> I = I(each(a.0, |v| v as i32));
        fn to_f(a: I) -> F = F(each(a.0, |v| v as f32));
        fn as_i(a: F) -> I = I(each(a.0, |v| v.to_bits() as i32));
        fn as_f(a: I) -> F = F(each(a.0, |v| f32::from_bits(v as u32)));
        fn look_up(table: &[f32], index: I) -> F =
            F(each(index.0, |i| table[(i as u32 as usize).min(table.len() - 1)]));
    }

    #[inline(always)]
    fn shl<const S: u32>(self, a: I) -> I {
        I(each(a.0, |v| v << S))
    }

    #[inline(always)]
    fn shr<const S: u32>(self, a: I) -> I {
        I(each(a.0, |v| v >> S))
    }

    #[inline(always)]
    fn shr_u<const S: u32>(self, a: I) -> I {
        I(each(a.0, |v| (v as u32 >> S) as i32))
    }

    #[inline(always)]
    fn places(self, addresses: &Addresses, offset: I) -> Self::Places {
        std::array::from_fn(|n| addresses.0[n] as usize + offset.0[n] as u32 as usize)
    }

    #[inline(always)]
    unsafe fn read(self, places: Self::Places, at: usize) -> I {
        // SAFETY: the caller's promise.
        I(places.map(|place| unsafe { read(place + at) }))
    }
}

/// Four bytes, little-endian.
///
/// # Safety
/// They can be read.
#[inline(always)]
unsafe fn read(place: usize) -> i32 {
    let pointer = std::ptr::with_exposed_provenance::<i32>(place);
    // SAFETY: the caller's promise.
    i32::from_le(unsafe { pointer.read_unaligned() })
}
