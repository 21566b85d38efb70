//! Vectors of rays: the operations that the caster needs, for AVX-512 (16 lanes), AVX2 (8) and any other processor (8, in
//! arrays), chosen at run time.
//!
//! Nothing here multiplies and adds in one rounding: every kind of processor draws the same bits, those of
//! [`crate::reference`]. All `unsafe` of the CPU renderer is in this folder: intrinsics behind tokens that exist only where
//! the processor has the instructions, and gathers from memory that a [`LaneTable`] owns, at offsets that it bounds.
//! (The SIMD crates that were looked at have no gathers; ARCHITECTURE.md, "Decisions".)

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};
use std::sync::Arc;

/// Lanes of the widest vector.
pub(super) const MAX_LANES: usize = 16;

/// One value per lane; lanes that a vector hasn't are not read.
pub(super) type PerLane<T> = [T; MAX_LANES];

/// A kind of vector. A value of the type is the proof that the processor has it.
pub(super) trait Lanes: Copy {
    /// How many rays go side by side.
    const WIDTH: usize;
    /// How many across and down in the picture.
    const SHAPE: [u32; 2];
    /// f32 per lane.
    type F: Copy
        + Add<Output = Self::F>
        + Sub<Output = Self::F>
        + Mul<Output = Self::F>
        + Div<Output = Self::F>;
    /// i32 per lane; arithmetic wraps.
    type I: Copy
        + Add<Output = Self::I>
        + Sub<Output = Self::I>
        + Mul<Output = Self::I>
        + BitAnd<Output = Self::I>
        + BitOr<Output = Self::I>;
    /// An address per lane.
    type Places: Copy;
    /// A truth per lane.
    type M: Copy + BitAnd<Output = Self::M> + BitOr<Output = Self::M> + Not<Output = Self::M>;

    fn f(self, v: f32) -> Self::F;
    fn i(self, v: i32) -> Self::I;
    fn load_f(self, v: &PerLane<f32>) -> Self::F;
    fn store_f(self, v: Self::F) -> PerLane<f32>;
    fn store_i(self, v: Self::I) -> PerLane<i32>;
    /// Lane n is bit n.
    fn mask(self, bits: u32) -> Self::M;
    fn bits(self, m: Self::M) -> u32;

    /// The lesser, the greater; with a NaN the second.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn floor(self, a: Self::F) -> Self::F;
    fn sqrt(self, a: Self::F) -> Self::F;
    /// a ≥ b, a > b; never with a NaN.
    fn ge(self, a: Self::F, b: Self::F) -> Self::M;
    fn gt(self, a: Self::F, b: Self::F) -> Self::M;
    /// `a` where `m`, else `b`.
    fn pick(self, m: Self::M, a: Self::F, b: Self::F) -> Self::F;

    fn min_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// As unsigned numbers.
    fn min_u(self, a: Self::I, b: Self::I) -> Self::I;
    fn eq_i(self, a: Self::I, b: Self::I) -> Self::M;
    fn gt_i(self, a: Self::I, b: Self::I) -> Self::M;
    fn pick_i(self, m: Self::M, a: Self::I, b: Self::I) -> Self::I;
    fn shl<const N: u32>(self, a: Self::I) -> Self::I;
    /// Arithmetic.
    fn shr<const N: u32>(self, a: Self::I) -> Self::I;
    /// Logical.
    fn shr_u<const N: u32>(self, a: Self::I) -> Self::I;

    /// Of whole numbers inside i32.
    fn to_i(self, a: Self::F) -> Self::I;
    fn to_f(self, a: Self::I) -> Self::F;
    /// The same bits.
    fn as_i(self, a: Self::F) -> Self::I;
    fn as_f(self, a: Self::I) -> Self::F;

    /// `table[index]`, the index brought inside as an unsigned number. The table must not be empty.
    fn look_up(self, table: &[f32], index: Self::I) -> Self::F;

    /// `addresses[lane] + offset[lane]`, the offset as an unsigned number.
    fn places(self, addresses: &Addresses, offset: Self::I) -> Self::Places;

    /// The four bytes `at` bytes behind each place, little-endian.
    ///
    /// # Safety
    /// They can be read.
    unsafe fn read(self, places: Self::Places, at: usize) -> Self::I;

    /// Any lane?
    #[inline(always)]
    fn any(self, m: Self::M) -> bool {
        self.bits(m) != 0
    }

    /// The least of the lanes of `m`; `i32::MAX` of none.
    #[inline(always)]
    fn least(self, m: Self::M, a: Self::I) -> i32 {
        let all = self.store_i(self.pick_i(m, a, self.i(i32::MAX)));
        all[..Self::WIDTH].iter().fold(i32::MAX, |s, &v| s.min(v))
    }

    /// The greatest of the lanes of `m`; `i32::MIN` of none.
    #[inline(always)]
    fn greatest(self, m: Self::M, a: Self::I) -> i32 {
        let all = self.store_i(self.pick_i(m, a, self.i(i32::MIN)));
        all[..Self::WIDTH].iter().fold(i32::MIN, |s, &v| s.max(v))
    }
}

/// One address per lane.
#[repr(align(64))]
#[derive(Clone, Copy, Debug)]
pub(super) struct Addresses([u64; MAX_LANES]);

/// Bytes that gathers may read: `len` of them, and a margin of four behind.
#[derive(Debug)]
pub(super) struct GatherBytes {
    bytes: Box<[u8]>,
}

impl GatherBytes {
    /// Bytes that a gather of four may read beyond the last one it is after.
    const MARGIN: usize = 4;

    /// A copy of `bytes`, zeros behind it up to `len`.
    pub(super) fn new(bytes: &[u8], len: usize) -> Self {
        let mut copy = Vec::with_capacity(len + Self::MARGIN);
        copy.extend_from_slice(&bytes[..bytes.len().min(len)]);
        copy.resize(len + Self::MARGIN, 0);
        Self {
            bytes: copy.into_boxed_slice(),
        }
    }

    /// `bytes`, zeros behind them up to `len`.
    pub(super) fn from_vec(mut bytes: Vec<u8>, len: usize) -> Self {
        bytes.resize(len + Self::MARGIN, 0);
        Self {
            bytes: bytes.into_boxed_slice(),
        }
    }

    /// The bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len()]
    }

    /// How many there are, without the margin.
    pub(super) fn len(&self) -> usize {
        self.bytes.len() - Self::MARGIN
    }
}

/// Each lane's place in memory to gather from, and the shared ownership that keeps it there.
#[derive(Debug)]
pub(super) struct LaneTable {
    addresses: Addresses,
    /// Whatever a lane points into, by address, and some that no lane does any more.
    held: Vec<(u64, Arc<GatherBytes>)>,
    /// Bytes of every piece of memory that is set.
    len: usize,
}

impl LaneTable {
    /// So many owners are kept before those that no lane needs are let go: more than lanes, so that it is done rarely.
    const MOST_HELD: usize = 4 * MAX_LANES;

    /// All lanes at `bytes`.
    pub(super) fn new(bytes: &Arc<GatherBytes>) -> Self {
        Self {
            addresses: Addresses([address(bytes); MAX_LANES]),
            held: vec![(address(bytes), Arc::clone(bytes))],
            len: bytes.len(),
        }
    }

    /// The lanes of `lanes` (bits) at `bytes`, which must be as long as those before.
    #[inline]
    pub(super) fn set(&mut self, lanes: u32, bytes: &Arc<GatherBytes>) {
        assert_eq!(
            bytes.len(),
            self.len,
            "invariant: pieces of a table are of one length"
        );
        let place = address(bytes);
        if !self.held.iter().any(|&(a, _)| a == place) {
            if self.held.len() >= Self::MOST_HELD {
                // The lanes that are about to move no longer count; those that stay do.
                let stays = |a: u64| {
                    (0..MAX_LANES).any(|l| lanes >> l & 1 == 0 && self.addresses.0[l] == a)
                };
                self.held.retain(|&(a, _)| stays(a));
            }
            self.held.push((place, Arc::clone(bytes)));
        }
        for (lane, a) in self.addresses.0.iter_mut().enumerate() {
            if lanes >> lane & 1 == 1 {
                *a = place;
            }
        }
    }

    /// Four bytes from `offset`, little-endian; an offset out of bounds reads the last.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(&self, l: L, offset: L::I) -> L::I {
        let offset = l.min_u(offset, l.i(self.len as i32 - 1));
        // SAFETY: every address is the beginning of memory that `held` owns, `len` bytes and a margin of four; the
        // offset is below `len`.
        unsafe { l.read(l.places(&self.addresses, offset), 0) }
    }

    /// As [`Self::gather`], from `offset` and three further places: `offset` + `at`. Offsets are bounded so that the
    /// greatest of `at` stays inside.
    #[inline(always)]
    pub(super) fn gather4<L: Lanes>(&self, l: L, offset: L::I, at: [usize; 4]) -> [L::I; 4] {
        let reach = at[0].max(at[1]).max(at[2]).max(at[3]);
        assert!(reach < self.len, "invariant: displacements stay inside");
        let offset = l.min_u(offset, l.i((self.len - 1 - reach) as i32));
        // SAFETY: as in `gather`; offset + the greatest displacement is below `len`.
        unsafe {
            let places = l.places(&self.addresses, offset);
            [
                l.read(places, at[0]),
                l.read(places, at[1]),
                l.read(places, at[2]),
                l.read(places, at[3]),
            ]
        }
    }
}

fn address(bytes: &Arc<GatherBytes>) -> u64 {
    bytes.bytes.as_ptr() as u64
}

/// Work for any kind of vector.
pub(super) trait Kernel {
    /// What it gives.
    type Output;
    /// Does it. Must be `#[inline(always)]`, and so all that it calls with vectors: only then it is compiled for the
    /// processor's instructions.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// The kinds of vectors that this processor has, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// 16 lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// 8 lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 8 lanes in arrays.
    Portable,
}

impl InstructionSet {
    /// All that this processor has, best first.
    pub fn available() -> Vec<Self> {
        let mut all = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if has_avx512() {
                all.push(Self::Avx512);
            }
            if std::is_x86_feature_detected!("avx2") {
                all.push(Self::Avx2);
            }
        }
        all.push(Self::Portable);
        all
    }

    /// The best that this processor has.
    pub fn best() -> Self {
        Self::available()[0]
    }

    /// Its name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            Self::Portable => "portable",
        }
    }

    /// Runs `kernel` with these vectors, or with the portable ones where the processor hasn't these.
    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the features were just found.
            Self::Avx512 if has_avx512() => unsafe { run_avx512(kernel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the feature was just found.
            Self::Avx2 if std::is_x86_feature_detected!("avx2") => unsafe { run_avx2(kernel) },
            _ => kernel.run(portable::Portable),
        }
    }

    /// As [`Self::run`], for a kernel that takes minutes to build for all vectors. The library's own tests, which draw a few
    /// small pictures, are built for one kind only; those in tests/ have all.
    #[cfg(not(test))]
    pub(super) fn run_large<K: Kernel>(self, kernel: K) -> K::Output {
        self.run(kernel)
    }

    #[cfg(test)]
    pub(super) fn run_large<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(portable::Portable)
    }
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    std::is_x86_feature_detected!("avx512f")
        && std::is_x86_feature_detected!("avx512dq")
        && std::is_x86_feature_detected!("avx512vl")
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(avx512::Avx512::here())
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(avx2::Avx2::here())
}

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
