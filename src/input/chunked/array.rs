//! [`Array`]: size, chunks and element type of an array of any number of axes, and how a chunk's bytes become voxels.

use glam::U64Vec3;

use super::Axes;
use crate::input::problem::Subject;
use crate::volume::{SourceError, VoxelType};

/// The largest chunk that is decoded: every one is held whole.
const MOST_CHUNK_BYTES: u64 = 2 << 30;

/// An array in chunks of one size, those at the far ends reaching beyond it.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::input) struct Array {
    /// Elements per axis.
    pub(in crate::input) shape: Vec<u64>,
    /// Elements of a chunk per axis.
    pub(in crate::input) chunk: Vec<u64>,
    /// The axes as they lie in a chunk's bytes, the slowest first.
    pub(in crate::input) order: Vec<usize>,
    /// Type of the elements.
    pub(in crate::input) voxel_type: VoxelType,
    /// Whether the elements' bytes come most significant first.
    pub(in crate::input) is_big_endian: bool,
    /// The element that stands where nothing is stored, little-endian, as many bytes as the type has.
    pub(in crate::input) fill: [u8; 8],
}

/// A decoded chunk, or a part of one.
pub(in crate::input) struct Block {
    /// Its elements, in the array's order of axes.
    pub(in crate::input) bytes: Vec<u8>,
    /// Elements per axis; their product and the element's size make the bytes.
    pub(in crate::input) extent: Vec<u64>,
}

/// What knows where the chunks of an array lie: each can be read any number of times, several at once.
pub(in crate::input) trait Chunks: Send + Sync {
    /// The chunk at `index` of the grid of chunks, or `None` where none is stored.
    ///
    /// # Errors
    /// It can't be fetched or is damaged.
    fn read(&self, index: &[u64]) -> Result<Option<Block>, SourceError>;

    /// Most bytes held between reads.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// As [`VoxelSource::stamp`](crate::volume::VoxelSource::stamp).
    fn stamp(&self) -> String;
}

impl Array {
    /// Checks that all sizes go together; `subject` is the metadata.
    ///
    /// # Errors
    /// Chunks have other axes than the array, or are too large to be decoded.
    pub(in crate::input) fn check(&self, subject: &Subject<'_>) -> Result<(), SourceError> {
        if self.chunk.len() != self.shape.len() {
            return Err(subject.malformed(
                "the sizes of chunks",
                format!("{} numbers, as the array has axes", self.shape.len()),
                format!("{:?}", self.chunk),
            ));
        }
        match bytes_of(&self.chunk, self.voxel_type) {
            Some(bytes) if bytes <= MOST_CHUNK_BYTES => Ok(()),
            _ => Err(subject.unsupported(
                format!(
                    "a chunk of {:?} elements of {}",
                    self.chunk, self.voxel_type
                ),
                format!("a chunk may hold at most {MOST_CHUNK_BYTES} bytes"),
            )),
        }
    }

    /// Bytes of a whole decoded chunk; what [`Self::check`] has passed fits.
    pub(in crate::input) fn chunk_bytes(&self) -> u64 {
        bytes_of(&self.chunk, self.voxel_type)
            .expect("invariant: checked when the array was opened")
    }

    /// The one element that stands for what is not stored.
    pub(in crate::input) fn fill(&self) -> &[u8] {
        &self.fill[..self.voxel_type.size()]
    }

    /// The voxels of `block`: `size` of them from its first on, x fastest, little-endian, of the chosen channel and time.
    /// What the block does not hold has the fill value.
    pub(super) fn voxels(&self, axes: &Axes, block: Block, size: U64Vec3) -> Vec<u8> {
        let Block { mut bytes, extent } = block;
        let element = self.voxel_type.size();
        let mut strides = vec![0; extent.len()];
        let mut stride = 1;
        for &axis in self.order.iter().rev() {
            strides[axis] = stride;
            stride *= extent[axis];
        }
        let of = |axis: Option<usize>, of: &[u64], none| axis.map_or(none, |a| of[a]);
        let step = axes.xyz.map(|a| of(a, &strides, 0));
        let held = U64Vec3::from_array(axes.xyz.map(|a| of(a, &extent, 1))).min(size);
        let mut first = 0;
        let mut is_held = held.min_element() > 0;
        for &(axis, index) in &axes.fixed {
            let index = index % self.chunk[axis];
            is_held &= index < extent[axis];
            first += index * strides[axis];
        }
        let in_place = [1, size.x, size.x * size.y];
        let is_in_place = (0..3).all(|d| size[d] == 1 || step[d] == in_place[d]);
        let count = (size.x * size.y * size.z) as usize;
        let mut out = if is_held && held == size && is_in_place && count * element == bytes.len() {
            std::mem::take(&mut bytes)
        } else {
            let mut out = self.fill().repeat(count);
            // The fill value is little-endian already: what is swapped below is swapped here first.
            if self.is_big_endian {
                swap_elements(&mut out, element);
            }
            if is_held {
                let part = Part {
                    first,
                    step,
                    held,
                    size,
                };
                match element {
                    1 => part.gather::<1>(&bytes, &mut out),
                    2 => part.gather::<2>(&bytes, &mut out),
                    4 => part.gather::<4>(&bytes, &mut out),
                    _ => part.gather::<8>(&bytes, &mut out),
                }
            }
            out
        };
        if self.is_big_endian {
            swap_elements(&mut out, element);
        }
        out
    }
}

/// Bytes of an array of that shape, or `None` beyond `u64`.
pub(super) fn bytes_of(shape: &[u64], voxel_type: VoxelType) -> Option<u64> {
    shape
        .iter()
        .try_fold(voxel_type.size() as u64, |n, &s| n.checked_mul(s))
}

/// Which elements of a block are voxels: `held` of them from element `first` on, `step` apart; they go to the beginning of
/// a box of `size`.
struct Part {
    first: u64,
    step: [u64; 3],
    held: U64Vec3,
    size: U64Vec3,
}

impl Part {
    fn gather<const N: usize>(&self, bytes: &[u8], out: &mut [u8]) {
        let (elements, _) = bytes.as_chunks::<N>();
        let (out, _) = out.as_chunks_mut::<N>();
        let [step_x, step_y, step_z] = self.step;
        let row = self.held.x as usize;
        for z in 0..self.held.z {
            for y in 0..self.held.y {
                let from = (self.first + z * step_z + y * step_y) as usize;
                let to = ((z * self.size.y + y) * self.size.x) as usize;
                let out = &mut out[to..to + row];
                if step_x == 1 {
                    out.copy_from_slice(&elements[from..from + row]);
                } else {
                    let step = (step_x as usize).max(1);
                    for (out, element) in out.iter_mut().zip(elements[from..].iter().step_by(step))
                    {
                        *out = *element;
                    }
                }
            }
        }
    }
}

/// Reverses the bytes of every element of `size` bytes.
fn swap_elements(bytes: &mut [u8], size: usize) {
    fn swap<const N: usize>(bytes: &mut [u8]) {
        bytes
            .as_chunks_mut::<N>()
            .0
            .iter_mut()
            .for_each(|v| v.reverse());
    }
    match size {
        2 => swap::<2>(bytes),
        4 => swap::<4>(bytes),
        8 => swap::<8>(bytes),
        _ => {}
    }
}
