//! A brick's record: one zstd frame of block ranges and voxels.
//!
//! ```text
//! offset   bytes         content, after decompression
//!      0    1024         ranges of the 8×8×8 blocks, x fastest: (low, high), u8 each
//!   1024   34³ × size    voxels, x fastest: u8 as they are; u16 and f32 byte-shuffled
//!                        (all lowest bytes, then all second ones, …)
//! ```
//! A block's range is of the 6³ voxels of its 4³ and the voxels around it. It is kept as two steps of 1/255 of the
//! brick's own min … max and rounded outward: [`range_low`] of `low` is never above a voxel of the block, [`range_high`]
//! of `high` never below one. For u8 the range read back is exact.

use std::io;

use super::Voxel;
use crate::geom::{BLOCK_EDGE, BLOCKS_PER_BRICK, BLOCKS_PER_EDGE, STORED_EDGE, STORED_VOXELS};
use crate::volume::StoredType;

/// Bytes of a record's block ranges.
pub const RANGES_LEN: usize = 2 * BLOCKS_PER_BRICK;

const EDGE: usize = STORED_EDGE as usize;
const PLANE: usize = EDGE * EDGE;
const BLOCKS: usize = BLOCKS_PER_EDGE as usize;
const STRIDE: usize = BLOCK_EDGE as usize;
/// Voxels along a block's edge, its surroundings included.
const WINDOW: usize = STRIDE + 2;

/// Bytes of a decompressed record.
pub const fn plain_len(stored_type: StoredType) -> usize {
    RANGES_LEN + STORED_VOXELS * stored_type.size()
}

/// Most bytes that a record can take: what zstd needs for data that it can't compress.
pub fn max_record_len(stored_type: StoredType) -> usize {
    zstd::zstd_safe::compress_bound(plain_len(stored_type))
}

/// The value of step `q` of 255 between `min` and `max`.
fn step_value(min: f32, max: f32, q: u8) -> f64 {
    let (min, max) = (f64::from(min), f64::from(max));
    min + (max - min) * f64::from(q) / 255.0
}

/// The lower end of a block's range: never above the true one.
pub fn range_low(stored_type: StoredType, min: f32, max: f32, q: u8) -> f32 {
    if q == 255 {
        return max;
    }
    let value = step_value(min, max, q);
    if stored_type == StoredType::F32 {
        let rounded = value as f32;
        let down = if f64::from(rounded) > value {
            rounded.next_down()
        } else {
            rounded
        };
        down.max(min)
    } else {
        // Voxels are whole numbers: none lies between the step and the next whole one.
        value.ceil() as f32
    }
}

/// The upper end of a block's range: never below the true one.
pub fn range_high(stored_type: StoredType, min: f32, max: f32, q: u8) -> f32 {
    if q == 255 {
        return max;
    }
    let value = step_value(min, max, q);
    if stored_type == StoredType::F32 {
        let rounded = value as f32;
        let up = if f64::from(rounded) < value {
            rounded.next_up()
        } else {
            rounded
        };
        up.min(max)
    } else {
        value.floor() as f32
    }
}

/// The ranges of a brick's blocks, and of the whole brick.
#[derive(Debug)]
pub struct BlockRanges<T> {
    /// Least voxel of each block, x fastest.
    pub low: Box<[T; BLOCKS_PER_BRICK]>,
    /// Greatest voxel of each block.
    pub high: Box<[T; BLOCKS_PER_BRICK]>,
    plane_low: Box<[T; PLANE]>,
    plane_high: Box<[T; PLANE]>,
}

impl<T: Voxel> Default for BlockRanges<T> {
    fn default() -> Self {
        Self {
            low: Box::new([T::default(); BLOCKS_PER_BRICK]),
            high: Box::new([T::default(); BLOCKS_PER_BRICK]),
            plane_low: Box::new([T::default(); PLANE]),
            plane_high: Box::new([T::default(); PLANE]),
        }
    }
}

impl<T: Voxel> BlockRanges<T> {
    /// Fills the ranges from the 34³ voxels of a brick.
    ///
    /// Along z and y whole planes and rows are combined, which the compiler turns into vector instructions; only the
    /// last step, along x, is by element.
    pub fn measure(&mut self, voxels: &[T; STORED_VOXELS]) {
        for bz in 0..BLOCKS {
            let first = &voxels[bz * STRIDE * PLANE..][..PLANE];
            self.plane_low.copy_from_slice(first);
            self.plane_high.copy_from_slice(first);
            for z in 1..WINDOW {
                let plane = &voxels[(bz * STRIDE + z) * PLANE..][..PLANE];
                widen(&mut self.plane_low[..], &mut self.plane_high[..], plane);
            }
            for by in 0..BLOCKS {
                let row = |y: usize| (by * STRIDE + y) * EDGE..(by * STRIDE + y + 1) * EDGE;
                let mut low = [T::default(); EDGE];
                let mut high = [T::default(); EDGE];
                low.copy_from_slice(&self.plane_low[row(0)]);
                high.copy_from_slice(&self.plane_high[row(0)]);
                for y in 1..WINDOW {
                    narrow_low(&mut low, &self.plane_low[row(y)]);
                    narrow_high(&mut high, &self.plane_high[row(y)]);
                }
                for bx in 0..BLOCKS {
                    let x = bx * STRIDE;
                    let block = (bz * BLOCKS + by) * BLOCKS + bx;
                    let window = x..x + WINDOW;
                    self.low[block] = low[window.clone()].iter().fold(low[x], |a, &b| a.lesser(b));
                    self.high[block] = high[window].iter().fold(high[x], |a, &b| a.greater(b));
                }
            }
        }
    }

    /// Least and greatest voxel of the brick: the blocks cover all of it.
    pub fn whole(&self) -> (T, T) {
        let low = self.low.iter().fold(self.low[0], |a, &b| a.lesser(b));
        let high = self.high.iter().fold(self.high[0], |a, &b| a.greater(b));
        (low, high)
    }

    /// Writes the ranges as steps of the brick's own range, outward.
    pub fn quantise(&self, out: &mut [u8]) {
        let (min, max) = self.whole();
        let (min, max) = (min.to_f32(), max.to_f32());
        let scale = 255.0 / (f64::from(max) - f64::from(min));
        for ((pair, &low), &high) in out
            .as_chunks_mut::<2>()
            .0
            .iter_mut()
            .zip(&self.low[..])
            .zip(&self.high[..])
        {
            // A brick of one value has no steps (0 · ∞): step 0 is the value.
            let at = |v: f32| (f64::from(v) - f64::from(min)) * scale;
            let (low, high) = (low.to_f32(), high.to_f32());
            // `as u8` saturates, and turns NaN into 0. The division may round either way: the loops settle it.
            let mut q_low = at(low).floor() as u8;
            while range_low(T::TYPE, min, max, q_low) > low {
                q_low -= 1;
            }
            let mut q_high = at(high).ceil() as u8;
            while range_high(T::TYPE, min, max, q_high) < high {
                q_high += 1;
            }
            *pair = [q_low, q_high];
        }
    }
}

fn widen<T: Voxel>(low: &mut [T], high: &mut [T], values: &[T]) {
    narrow_low(low, values);
    narrow_high(high, values);
}

fn narrow_low<T: Voxel>(low: &mut [T], values: &[T]) {
    for (a, &b) in low.iter_mut().zip(values) {
        *a = a.lesser(b);
    }
}

fn narrow_high<T: Voxel>(high: &mut [T], values: &[T]) {
    for (a, &b) in high.iter_mut().zip(values) {
        *a = a.greater(b);
    }
}

/// A brick ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedBrick {
    /// Least stored value.
    pub min: f32,
    /// Greatest stored value.
    pub max: f32,
    /// The record; `None` when all voxels are equal.
    pub record: Option<Vec<u8>>,
    /// CRC32C of the record, 0 without one.
    pub crc: u32,
}

/// Makes records: a zstd context and buffers, one per thread.
pub struct BrickEncoder<T> {
    compressor: zstd::bulk::Compressor<'static>,
    ranges: BlockRanges<T>,
    plain: Vec<u8>,
    packed: Vec<u8>,
}

impl<T: Voxel> BrickEncoder<T> {
    /// An encoder at zstd `level`.
    ///
    /// # Errors
    /// zstd has no memory or refuses the level.
    pub fn new(level: i32) -> io::Result<Self> {
        Ok(Self {
            compressor: zstd::bulk::Compressor::new(level)?,
            ranges: BlockRanges::default(),
            plain: vec![0; plain_len(T::TYPE)],
            packed: Vec::with_capacity(max_record_len(T::TYPE)),
        })
    }

    /// Encodes the 34³ voxels of a brick.
    ///
    /// # Errors
    /// zstd has no memory.
    pub fn encode(&mut self, voxels: &[T; STORED_VOXELS]) -> io::Result<EncodedBrick> {
        // Asked first: in most volumes most bricks are, and all else costs several times as much.
        if is_constant(voxels) {
            let value = voxels[0].to_f32();
            return Ok(EncodedBrick {
                min: value,
                max: value,
                record: None,
                crc: 0,
            });
        }
        self.ranges.measure(voxels);
        let (low, high) = self.ranges.whole();
        let (min, max) = (low.to_f32(), high.to_f32());
        let (ranges, planes) = self.plain.split_at_mut(RANGES_LEN);
        self.ranges.quantise(ranges);
        T::shuffle(voxels, planes);
        self.packed.clear();
        self.compressor
            .compress_to_buffer(&self.plain[..], &mut self.packed)?;
        Ok(EncodedBrick {
            min,
            max,
            crc: crc32c::crc32c(&self.packed),
            record: Some(self.packed.clone()),
        })
    }
}

/// True when all voxels have the same bits.
pub fn is_constant<T: Voxel>(voxels: &[T; STORED_VOXELS]) -> bool {
    // No exit inside a plane: that loop becomes vector instructions.
    let first = voxels[0];
    let is_plane = |plane: &[T]| plane.iter().fold(true, |all, v| all & v.same_bits(first));
    voxels.chunks_exact(PLANE).all(is_plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, mut seed: u32) -> Vec<u32> {
        (0..n)
            .map(|_| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                seed >> 8
            })
            .collect()
    }

    /// Ranges by the definition, without any trick.
    fn naive<T: Voxel>(voxels: &[T]) -> Vec<(T, T)> {
        let mut out = Vec::new();
        for b in 0..512 {
            let (bx, by, bz) = (b % 8 * 4, b / 8 % 8 * 4, b / 64 * 4);
            let mut range = (
                voxels[(bz * 34 + by) * 34 + bx],
                voxels[(bz * 34 + by) * 34 + bx],
            );
            for z in bz..bz + 6 {
                for y in by..by + 6 {
                    for x in bx..bx + 6 {
                        let v = voxels[(z * 34 + y) * 34 + x];
                        range = (range.0.lesser(v), range.1.greater(v));
                    }
                }
            }
            out.push(range);
        }
        out
    }

    fn check<T: Voxel>(voxels: Vec<T>, slack_steps: f64) {
        let truth = naive(&voxels);
        let voxels: Box<[T; STORED_VOXELS]> = voxels.try_into().ok().unwrap();
        let mut ranges = BlockRanges::default();
        ranges.measure(&voxels);
        let mut q = [0; RANGES_LEN];
        ranges.quantise(&mut q);
        let (min, max) = ranges.whole();
        let (min, max) = (min.to_f32(), max.to_f32());
        let slack = slack_steps * (f64::from(max) - f64::from(min)) / 255.0;
        for (b, &(low, high)) in truth.iter().enumerate() {
            assert_eq!(
                (ranges.low[b], ranges.high[b]),
                (low, high),
                "block {b} by definition"
            );
            let got_low = range_low(T::TYPE, min, max, q[2 * b]);
            let got_high = range_high(T::TYPE, min, max, q[2 * b + 1]);
            assert!(
                got_low <= low.to_f32() && got_high >= high.to_f32(),
                "block {b} is outward"
            );
            assert!(
                f64::from(low.to_f32()) - f64::from(got_low) <= slack
                    && f64::from(got_high) - f64::from(high.to_f32()) <= slack,
                "block {b} is tight: {got_low} … {got_high} for {low} … {high}"
            );
        }
    }

    #[test]
    fn block_ranges_are_outward_and_tight() {
        for spread in [2, 3, 17, 200, 255, 256] {
            let v: Vec<u8> = noise(STORED_VOXELS, spread)
                .iter()
                .map(|v| (v % spread) as u8)
                .collect();
            check(v, 0.0);
            let v: Vec<u16> = noise(STORED_VOXELS, spread)
                .iter()
                .map(|v| (v % (spread * 251)) as u16)
                .collect();
            check(v, 1.001);
        }
        for (scale, base) in [(1.0, 0.0), (1e30, -1e35), (1e-40, 0.0), (1e-3, 1e4)] {
            let v = noise(STORED_VOXELS, 9)
                .iter()
                .map(|v| (f64::from(*v) * scale + base) as f32)
                .collect();
            check::<f32>(v, 1.001);
        }
        let mut v = vec![f32::MAX; STORED_VOXELS];
        v[0] = f32::MIN;
        v[20_000] = 0.0;
        check(v, 1.001);
    }

    #[test]
    fn constant_means_same_bits() {
        let mut encoder = BrickEncoder::<f32>::new(1).unwrap();
        let mut voxels = Box::new([0.0f32; STORED_VOXELS]);
        assert!(
            encoder.encode(&voxels).unwrap().record.is_none(),
            "all zero is Constant"
        );
        voxels[77] = -0.0;
        assert!(
            encoder.encode(&voxels).unwrap().record.is_some(),
            "0 and −0 are two values"
        );
    }

    #[test]
    fn shuffle_round_trip() {
        let v: Vec<f32> = noise(100, 1).iter().map(|&v| v as f32 * 0.37).collect();
        let (mut planes, mut back) = (vec![0; 400], vec![0.0; 100]);
        f32::shuffle(&v, &mut planes);
        assert_eq!(
            planes[200],
            v[0].to_le_bytes()[2],
            "third plane holds third bytes"
        );
        f32::unshuffle(&planes, &mut back);
        assert_eq!(v, back, "f32");
        let v: Vec<u16> = noise(100, 2).iter().map(|&v| v as u16).collect();
        let (mut planes, mut back) = (vec![0; 200], vec![0; 100]);
        u16::shuffle(&v, &mut planes);
        u16::unshuffle(&planes, &mut back);
        assert_eq!(v, back, "u16");
    }
}
