//! What the processor could do at most: every sample of every ray inside the volume is fetched from one dense array,
//! classified and composited. No bricks, no skipping, no early end. What `bench` holds pictures against.

use std::sync::Arc;

use rayon::prelude::*;

use super::field::{VoxelKind, trilinear_at, with_voxel_kind};
use super::picture::{CpuPicture, TILE};
use super::rays::{Packet, Rays, axes};
use super::simd::{GatherBytes, InstructionSet, Kernel, LaneTable, Lanes};
use super::table::Table;
use crate::geom::{Lod, VoxelBox};
use crate::store::{BrickReader, Store, StoreError};
use crate::volume::StoredType;

/// Bytes of an array at most: gathers have offsets of 32 bits.
const MOST_BYTES: u64 = 1 << 30;

/// A level of a store as one array.
#[derive(Debug)]
pub struct DenseArray {
    lod: Lod,
    stored_type: StoredType,
    /// Voxels along each axis.
    dims: [i32; 3],
    voxels: Arc<GatherBytes>,
}

impl DenseArray {
    /// Reads the level; `None` where it has more than a GiB.
    ///
    /// # Errors
    /// A brick can't be read.
    pub fn read(store: &Store, lod: Lod) -> Result<Option<Self>, StoreError> {
        let stored_type = store.stored_type();
        store.check_level(lod)?;
        let size = store.level(lod).grid.voxels;
        let voxel_bytes = stored_type.size() as u64;
        let slice = u128::from(size.x) * u128::from(size.y) * u128::from(voxel_bytes);
        let bytes = slice * u128::from(size.z);
        // Taps behind the last voxel have the weight 0, but are read.
        let beyond = slice + u128::from((size.x + 1) * voxel_bytes);
        if bytes + beyond > u128::from(MOST_BYTES) {
            return Ok(None);
        }
        let mut reader = BrickReader::new().map_err(|error| StoreError::Io {
            path: store.path().to_owned(),
            doing: "start a decoder for it",
            error,
        })?;
        let mut voxels = vec![0; bytes as usize];
        store.read_box(lod, VoxelBox::whole(size), &mut reader, &mut voxels)?;
        let len = voxels.len() + beyond as usize;
        Ok(Some(Self {
            lod,
            stored_type,
            dims: size.as_ivec3().to_array(),
            voxels: Arc::new(GatherBytes::from_vec(voxels, len)),
        }))
    }

    /// Casts what `picture` samples of this level, on all threads of the current rayon pool; the number of samples. Mode
    /// and light of the picture don't matter: all is done as in mode dvr without light.
    pub fn cast(&self, picture: &CpuPicture, instructions: InstructionSet) -> u64 {
        let (frame, tables) = (picture.frame(), picture.tables());
        let of_level = frame.used().iter().position(|l| l.lod == self.lod);
        let Some(number) = of_level else { return 0 };
        let [width, height] = frame.size;
        let across = width.div_ceil(TILE);
        (0..across * height.div_ceil(TILE))
            .into_par_iter()
            .map(|tile| {
                with_voxel_kind!(self.stored_type, K => instructions.run(BareTile {
                    dense: self,
                    picture,
                    table: &tables[number],
                    number,
                    origin: [tile % across * TILE, tile / across * TILE],
                    kind: std::marker::PhantomData::<K>,
                }))
            })
            .sum()
    }
}

/// A tile, packet by packet.
struct BareTile<'a, K> {
    dense: &'a DenseArray,
    picture: &'a CpuPicture,
    table: &'a Table,
    number: usize,
    origin: [u32; 2],
    kind: std::marker::PhantomData<K>,
}

impl<K: VoxelKind> Kernel for BareTile<'_, K> {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> u64 {
        let [across, down] = L::SHAPE;
        let mut samples = 0;
        let mut total = l.f(0.0);
        for y in (0..TILE).step_by(down as usize) {
            for x in (0..TILE).step_by(across as usize) {
                let at = [self.origin[0] + x, self.origin[1] + y];
                let frame = self.picture.frame();
                let packet = Packet::block(l, frame, at, frame.place_in_pixel);
                let (opacity, taken) = self.packet(l, &packet);
                samples += taken;
                total = total + opacity;
            }
        }
        // The picture must be worked out, although nobody looks at it.
        std::hint::black_box(l.store_f(total));
        samples
    }
}

impl<K: VoxelKind> BareTile<'_, K> {
    #[inline(always)]
    fn packet<L: Lanes>(&self, l: L, packet: &Packet<L>) -> (L::F, u64) {
        let frame = self.picture.frame();
        let level = &frame.used()[self.number];
        let rays = Rays::new(l, frame, level, packet);
        let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
        let some = packet.inside & !l.gt_i(rays.first, last);
        let (zero, one, half) = (l.f(0.0), l.f(1.0), l.f(0.5));
        let [nx, ny, _] = self.dense.dims;
        let (row, layer) = (nx as usize * K::BYTES, (nx * ny) as usize * K::BYTES);
        let voxels = LaneTable::new(&self.dense.voxels);
        let mut sum = [zero; 4];
        let mut samples = l.i(0);
        for index in l.least(some, rays.first)..=l.greatest(some, last) {
            let at = l.i(index);
            let here = some & !l.gt_i(rays.first, at) & !l.gt_i(at, last);
            samples = samples + l.pick_i(here, l.i(1), l.i(0));
            let offset = rays.offset(l.f(index as f32));
            let shifted = axes!(n => offset[n] - half);
            let floor = axes!(n => l.floor(shifted[n]));
            let f = axes!(n => shifted[n] - floor[n]);
            let [x, y, z] = axes!(n => l.to_i(floor[n]) + l.i(level.anchor[n]));
            let at = (x + (y + z * l.i(ny)) * l.i(nx)) * l.i(K::BYTES as i32);
            let value = trilinear_at::<L, K>(l, &voxels, at, [row, layer], f);
            let at = self.table.index(l, value);
            let color = self.table.color(l, &at);
            let opacity = l.pick(here, self.table.opacity(l, &at), zero);
            let weight = (one - sum[3]) * opacity;
            for c in 0..3 {
                sum[c] = sum[c] + color[c] * weight;
            }
            sum[3] = sum[3] + weight;
        }
        let taken = l.store_i(samples)[..L::WIDTH]
            .iter()
            .map(|&n| n as u64)
            .sum();
        (sum[0] + sum[1] + sum[2] + sum[3], taken)
    }
}
