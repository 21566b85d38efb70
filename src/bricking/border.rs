//! Cutting bricks with their borders out of a slab.
//!
//! Invariant 3 of the design starts here: a border voxel is the true neighbour voxel of the level; outside the volume the
//! nearest edge voxel is repeated, also where the volume ends inside a brick.

use glam::UVec3;

use super::slab::Slab;
use crate::geom::{BRICK_BORDER, BRICK_EDGE, STORED_EDGE, STORED_VOXELS};
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

/// Fills `out` with the 34³ voxels of the brick at `xyz`, whose layer is the slab's.
pub fn cut<T: Voxel>(slab: &Slab<T>, xyz: UVec3, out: &mut [T; STORED_VOXELS]) {
    const EDGE: usize = STORED_EDGE as usize;
    let dims = slab.dims();
    let width = dims.x as usize;
    let xs = places(xyz.x, dims.x).map(|x| x as usize);
    let ys = places(xyz.y, dims.y);
    let zs = places(xyz.z, dims.z);
    // Along x: the run of true neighbours is copied as one piece, what lies outside repeats its ends.
    let left = usize::from(xyz.x == 0);
    let run = xs[left]..xs[EDGE - 1] + 1;
    let right = left + run.len();
    for (plane, &z) in out.chunks_exact_mut(EDGE * EDGE).zip(&zs) {
        let slice = slab.slice(z);
        for (row, &y) in plane.chunks_exact_mut(EDGE).zip(&ys) {
            let from = &slice[y as usize * width..][..width];
            row[left..right].copy_from_slice(&from[run.clone()]);
            if left == 1 {
                row[0] = from[0];
            }
            row[right..].fill(from[width - 1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::U64Vec3;

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
                if !slab.is_layer_complete() {
                    continue;
                }
                let layer = slab.layer();
                for by in 0..dims.y.div_ceil(32) as u32 {
                    for bx in 0..dims.x.div_ceil(32) as u32 {
                        cut(&slab, UVec3::new(bx, by, layer), &mut brick);
                        for (i, &v) in brick.iter().enumerate() {
                            let i = [i % 34, i / 34 % 34, i / 1156];
                            let b = [bx, by, layer];
                            let p: [u64; 3] = std::array::from_fn(|a| {
                                (i64::from(b[a]) * 32 + i[a] as i64 - 1)
                                    .clamp(0, dims[a] as i64 - 1)
                                    as u64
                            });
                            assert_eq!(v, at(p[0], p[1], p[2]), "{dims} brick {b:?} place {i:?}");
                        }
                    }
                }
                slab.roll();
            }
            assert_eq!(
                u64::from(slab.layer()),
                dims.z.div_ceil(32),
                "every layer came once"
            );
        }
    }
}
