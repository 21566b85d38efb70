//! The rolling window of slices that a level keeps while the pass goes up z: a layer of bricks and its borders.

use glam::U64Vec3;

use super::border::Window;
use crate::geom::{BRICK_EDGE, STORED_EDGE, VoxelBox};
use crate::store::Voxel;

/// Layers of bricks of a level of `depth` slices that are complete once `slices` of them came.
pub fn complete_layers(depth: u64, slices: u64) -> u32 {
    let edge = u64::from(BRICK_EDGE);
    let layers = if slices == depth {
        depth.div_ceil(edge)
    } else {
        slices.saturating_sub(1) / edge
    };
    layers as u32
}

/// z of the lowest slice that a slab holds when `layer` layers were rolled away of a level of `depth` slices, of which
/// `slices` came.
pub fn first_held(depth: u64, layer: u32, slices: u64) -> u64 {
    let edge = u64::from(BRICK_EDGE);
    if u64::from(layer) == depth.div_ceil(edge) {
        slices
    } else {
        (u64::from(layer) * edge).saturating_sub(1)
    }
}

/// At most 34 neighbouring slices of a level.
pub struct Slab<T> {
    dims: U64Vec3,
    slice_len: usize,
    /// z of the lowest slice held.
    first: u64,
    held: usize,
    /// The layer of bricks that is filled next.
    layer: u32,
    voxels: Vec<T>,
}

impl<T: Voxel> Slab<T> {
    /// An empty slab of a level of `dims` voxels.
    pub fn new(dims: U64Vec3) -> Self {
        let slice_len = (dims.x * dims.y) as usize;
        let slices = dims.z.min(u64::from(STORED_EDGE)) as usize;
        Self {
            dims,
            slice_len,
            first: 0,
            held: 0,
            layer: 0,
            voxels: vec![T::default(); slice_len * slices],
        }
    }

    /// An empty slab goes on after `layer` layers of bricks, as if slices up to `next_z` had come: those that it would
    /// hold are then to be filled in, see [`Self::slice_mut`].
    pub fn go_on(&mut self, layer: u32, next_z: u64) {
        self.layer = layer;
        self.first = first_held(self.dims.z, layer, next_z);
        self.held = (next_z - self.first) as usize;
    }

    /// z of the lowest slice held.
    pub fn first_z(&self) -> u64 {
        self.first
    }

    /// Voxels of the level.
    pub fn dims(&self) -> U64Vec3 {
        self.dims
    }

    /// The layer of bricks that is being filled.
    pub fn layer(&self) -> u32 {
        self.layer
    }

    /// z of the next slice: how many came so far.
    pub fn next_z(&self) -> u64 {
        self.first + self.held as u64
    }

    /// Room for the next slice; [`Self::push`] makes it part of the slab.
    pub fn room(&mut self) -> &mut [T] {
        &mut self.voxels[self.held * self.slice_len..][..self.slice_len]
    }

    /// The slice in [`Self::room`] is filled.
    pub fn push(&mut self) {
        self.held += 1;
    }

    /// Slice `z`, which must be held.
    pub fn slice(&self, z: u64) -> &[T] {
        let at = (z - self.first) as usize;
        assert!(at < self.held, "invariant: slice {z} is in the slab");
        &self.voxels[at * self.slice_len..][..self.slice_len]
    }

    /// Slice `z`, which must be held, to be filled in.
    pub fn slice_mut(&mut self, z: u64) -> &mut [T] {
        let at = (z - self.first) as usize;
        assert!(at < self.held, "invariant: slice {z} is in the slab");
        &mut self.voxels[at * self.slice_len..][..self.slice_len]
    }

    /// All slices held.
    pub fn window(&self) -> Window<'_, T> {
        Window {
            level: self.dims,
            held: VoxelBox::new(
                U64Vec3::new(0, 0, self.first),
                U64Vec3::new(self.dims.x, self.dims.y, self.next_z()),
            ),
            voxels: &self.voxels[..self.held * self.slice_len],
        }
    }

    /// True when all slices of the current layer of bricks and its borders are held. After [`Self::roll`] the next one
    /// may be complete at once: ask until it is not.
    pub fn is_layer_complete(&self) -> bool {
        let end = (u64::from(self.layer) + 1) * u64::from(BRICK_EDGE);
        self.next_z() == self.dims.z.min(end + 1) && self.dims.z > end - u64::from(BRICK_EDGE)
    }

    /// Goes on to the next layer of bricks: keeps the slices that it needs (the last one or two).
    pub fn roll(&mut self) {
        self.layer += 1;
        let keep_from = first_held(self.dims.z, self.layer, self.next_z());
        let drop = (keep_from - self.first) as usize;
        self.voxels
            .copy_within(drop * self.slice_len..self.held * self.slice_len, 0);
        self.first = keep_from;
        self.held -= drop;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn going_on_is_where_a_whole_run_would_be() {
        for depth in [1u64, 2, 31, 32, 33, 34, 64, 65, 97, 200] {
            let mut slab = Slab::<u8>::new(U64Vec3::new(1, 1, depth));
            for slices in 0..=depth {
                let mut other = Slab::<u8>::new(U64Vec3::new(1, 1, depth));
                other.go_on(complete_layers(depth, slices), slices);
                assert_eq!(
                    (other.layer, other.first, other.held),
                    (slab.layer, slab.first, slab.held),
                    "{slices} of {depth} slices"
                );
                if slices < depth {
                    slab.push();
                    while slab.is_layer_complete() {
                        slab.roll();
                    }
                }
            }
        }
    }
}
