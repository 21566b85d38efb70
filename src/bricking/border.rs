//! Cutting bricks with their borders out of plain voxels: what the pipeline writes, and what `verify` compares with.
//!
//! Invariant 3 of the design starts here: a border voxel is the true neighbour voxel of the level; outside the volume the
//! nearest edge voxel is repeated, also where the volume ends inside a brick.

use glam::{U64Vec3, UVec3};

use crate::geom::{BRICK_BORDER, BRICK_EDGE, STORED_EDGE, STORED_VOXELS, VoxelBox};
use crate::store::Voxel;

/// For each of the 34 places along an axis of brick number `brick`, the voxel of the level that belongs there.
pub fn places(brick: u32, voxels: u64) -> [u64; STORED_EDGE as usize] {
    let start = u64::from(brick) * u64::from(BRICK_EDGE);
    std::array::from_fn(|i| {
        (start + i as u64)
            .saturating_sub(u64::from(BRICK_BORDER))
            .min(voxels - 1)
    })
}

/// Where in the 34³ voxels of a brick the voxel `own` (counted from the brick's lowest own one) is.
pub fn place_in_brick(own: U64Vec3) -> usize {
    let edge = u64::from(STORED_EDGE);
    let p = own + u64::from(BRICK_BORDER);
    ((p.z * edge + p.y) * edge + p.x) as usize
}

/// Some voxels of a level: all that the bricks to be cut need.
#[derive(Clone, Copy, Debug)]
pub struct Window<'a, T> {
    /// Voxels of the whole level.
    pub level: U64Vec3,
    /// Which of them are here.
    pub held: VoxelBox,
    /// Their values, x fastest.
    pub voxels: &'a [T],
}

/// Fills `out` with the 34³ voxels of the brick at `xyz`; the window must hold it and its neighbours' edges.
pub fn cut<T: Voxel>(window: &Window<'_, T>, xyz: UVec3, out: &mut [T; STORED_VOXELS]) {
    const EDGE: usize = STORED_EDGE as usize;
    let (held, size) = (window.held, window.held.size());
    let xs = places(xyz.x, window.level.x).map(|x| (x - held.min.x) as usize);
    let ys = places(xyz.y, window.level.y).map(|y| y - held.min.y);
    let zs = places(xyz.z, window.level.z).map(|z| z - held.min.z);
    // Along x: the run of true neighbours is copied as one piece, what lies outside repeats its ends.
    let left = usize::from(xyz.x == 0);
    let run = xs[left]..xs[EDGE - 1] + 1;
    let right = left + run.len();
    for (plane, &z) in out.chunks_exact_mut(EDGE * EDGE).zip(&zs) {
        for (row, &y) in plane.chunks_exact_mut(EDGE).zip(&ys) {
            let start = ((z * size.y + y) * size.x) as usize;
            let from = &window.voxels[start..][run.clone()];
            row[..left].fill(from[0]);
            row[left..right].copy_from_slice(from);
            row[right..].fill(from[from.len() - 1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::slab::Slab;
    use super::*;

    #[test]
    fn borders_are_neighbours_or_repeat_the_edge() {
        for dims in [
            [1u64, 1, 1],
            [33, 2, 1],
            [70, 40, 20],
            [32, 32, 32],
            [64, 31, 33],
        ] {
            let dims = U64Vec3::from(dims);
            let at = |x: u64, y: u64, z: u64| (z * 10_000 + y * 100 + x) as u16;
            let mut slab = Slab::<u16>::new(dims);
            let mut z = 0;
            let mut brick = Box::new([0; STORED_VOXELS]);
            while z < dims.z {
                let room = slab.room();
                for y in 0..dims.y {
                    for x in 0..dims.x {
                        room[(y * dims.x + x) as usize] = at(x, y, z);
                    }
                }
                slab.push();
                z += 1;
                while slab.is_layer_complete() {
                    let layer = slab.layer();
                    for by in 0..dims.y.div_ceil(32) as u32 {
                        for bx in 0..dims.x.div_ceil(32) as u32 {
                            cut(&slab.window(), UVec3::new(bx, by, layer), &mut brick);
                            for (i, &v) in brick.iter().enumerate() {
                                let i = [i % 34, i / 34 % 34, i / 1156];
                                let b = [bx, by, layer];
                                let p: [u64; 3] = std::array::from_fn(|a| {
                                    (i64::from(b[a]) * 32 + i[a] as i64 - 1)
                                        .clamp(0, dims[a] as i64 - 1)
                                        as u64
                                });
                                assert_eq!(
                                    v,
                                    at(p[0], p[1], p[2]),
                                    "{dims} brick {b:?} place {i:?}"
                                );
                            }
                        }
                    }
                    slab.roll();
                }
            }
            assert_eq!(
                u64::from(slab.layer()),
                dims.z.div_ceil(32),
                "every layer came once"
            );
        }
    }
}
