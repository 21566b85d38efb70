//! Plain voxels back out of bricks: any box of a level, one brick decoded at a time.

use super::StoreError;
use super::reader::{BrickData, BrickReader, Store};
use crate::geom::{BRICK_BORDER, BRICK_EDGE, BrickId, Lod, STORED_EDGE, VoxelBox};

use glam::UVec3;

impl Store {
    /// Fills `out` with the stored voxels of `voxels` at `lod`, x fastest, little-endian.
    ///
    /// Every brick that the box meets is decoded once. For a whole level at bounded memory, ask for boxes of whole
    /// brick layers (32 slices from a multiple of 32), or tiles of them.
    ///
    /// `out` must hold exactly the box, and the box must lie inside the level; anything else is a bug of the caller and
    /// panics.
    ///
    /// # Errors
    /// A record is damaged.
    pub fn read_box(
        &self,
        lod: Lod,
        voxels: VoxelBox,
        reader: &mut BrickReader,
        out: &mut [u8],
    ) -> Result<(), StoreError> {
        let size = self.stored_type().size();
        let grid = self.level(lod).grid;
        let whole = VoxelBox::whole(grid.voxels);
        assert!(
            whole.contains_box(&voxels)
                && voxels
                    .voxel_count()
                    .and_then(|n| n.checked_mul(size as u64))
                    == Some(out.len() as u64),
            "invariant: the box lies inside {lod} and `out` holds it"
        );
        if voxels.is_empty() {
            return Ok(());
        }
        let edge = u64::from(BRICK_EDGE);
        let first = voxels.min / edge;
        let last = (voxels.max - 1) / edge;
        let mut data = BrickData::default();
        for bz in first.z..=last.z {
            for by in first.y..=last.y {
                for bx in first.x..=last.x {
                    let xyz = UVec3::new(bx as u32, by as u32, bz as u32);
                    self.read_brick_into(BrickId::new(lod, xyz), reader, &mut data)?;
                    let part = grid.brick_box(xyz).intersection(&voxels);
                    copy_part(&data.voxels, xyz, &part, &voxels, size, out);
                }
            }
        }
        Ok(())
    }
}

/// Copies `part` of the brick at `xyz` (34³ voxels of `size` bytes) to its place in `out`, which holds `whole`.
fn copy_part(
    brick: &[u8],
    xyz: UVec3,
    part: &VoxelBox,
    whole: &VoxelBox,
    size: usize,
    out: &mut [u8],
) {
    let origin = xyz.as_u64vec3() * u64::from(BRICK_EDGE);
    let stored = u64::from(STORED_EDGE);
    let border = u64::from(BRICK_BORDER);
    let dims = whole.size();
    let row = part.size().x as usize * size;
    for z in part.min.z..part.max.z {
        for y in part.min.y..part.max.y {
            let from = ((z - origin.z + border) * stored + (y - origin.y + border)) * stored
                + (part.min.x - origin.x + border);
            let to = ((z - whole.min.z) * dims.y + (y - whole.min.y)) * dims.x
                + (part.min.x - whole.min.x);
            let (from, to) = (from as usize * size, to as usize * size);
            out[to..to + row].copy_from_slice(&brick[from..from + row]);
        }
    }
}
