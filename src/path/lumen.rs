//! Which voxels of a store are lumen: those whose physical value is in a range, brick by brick.
//!
//! A brick whose range of values in the index tells all is never decoded.

use std::collections::HashMap;
use std::rc::Rc;

use glam::{U64Vec3, UVec3};

use super::error::CenterlineError;
use super::space::LevelSpace;
use crate::geom::{BRICK_BORDER, BRICK_EDGE, BrickId, Lod, STORED_EDGE};
use crate::store::{BrickData, BrickReader, Store};
use crate::volume::{Rescale, StoredType};

/// Rows of a brick: one `u32` each, bit x.
pub(super) const ROWS: usize = (BRICK_EDGE * BRICK_EDGE) as usize;

/// A bit per voxel of a brick, border not counted: row (z · 32 + y), bit x.
pub(super) type Bits = [u32; ROWS];

/// Bricks that [`Lumen::contains`] keeps.
const KEPT_BRICKS: usize = 256;

/// The lumen of one level.
pub(super) struct Lumen<'a> {
    store: &'a Store,
    pub(super) space: LevelSpace,
    rescale: Rescale,
    low: f64,
    high: f64,
    reader: BrickReader,
    data: BrickData,
    kept: HashMap<u64, Option<Rc<Bits>>>,
}

/// A brick's lumen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Share {
    None,
    All,
    Some,
}

impl<'a> Lumen<'a> {
    /// Voxels of level `lod` with physical values from `low` to `high`.
    ///
    /// # Errors
    /// The level's index is damaged, or zstd has no memory.
    pub(super) fn new(
        store: &'a Store,
        lod: Lod,
        (low, high): (f64, f64),
    ) -> Result<Self, CenterlineError> {
        store.check_level(lod)?;
        Ok(Self {
            store,
            space: LevelSpace::of(store, lod),
            rescale: store.meta().rescale,
            low,
            high,
            reader: BrickReader::new().map_err(CenterlineError::Decompression)?,
            data: BrickData::default(),
            kept: HashMap::new(),
        })
    }

    /// Least and greatest value, physical.
    pub(super) fn range(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    fn holds(&self, stored: f32) -> bool {
        let value = self.rescale.physical(f64::from(stored));
        (self.low..=self.high).contains(&value)
    }

    fn share(&self, xyz: UVec3) -> Share {
        let entry = self.store.entry(BrickId::new(self.space.lod, xyz));
        let (a, b) = (
            self.rescale.physical(f64::from(entry.min)),
            self.rescale.physical(f64::from(entry.max)),
        );
        if a.max(b) < self.low || a.min(b) > self.high {
            Share::None
        } else if self.holds(entry.min) && self.holds(entry.max) {
            Share::All
        } else {
            Share::Some
        }
    }

    /// True when the brick may hold lumen, told by the index alone.
    pub(super) fn may_hold(&self, xyz: UVec3) -> bool {
        self.share(xyz) != Share::None
    }

    /// The brick's lumen, cut to the volume; `None` when it has none.
    ///
    /// # Errors
    /// The brick is damaged.
    pub(super) fn bits(&mut self, xyz: UVec3) -> Result<Option<Box<Bits>>, CenterlineError> {
        let own = self.space.grid.brick_box(xyz).size().as_uvec3();
        let full = u32::MAX >> (BRICK_EDGE - own.x);
        let rows = (0..own.z).flat_map(|z| (0..own.y).map(move |y| (z, y)));
        let mut bits = Box::new([0; ROWS]);
        match self.share(xyz) {
            Share::None => return Ok(None),
            Share::All => {
                for (z, y) in rows {
                    bits[(z * BRICK_EDGE + y) as usize] = full;
                }
            }
            Share::Some => {
                self.decode(xyz)?;
                for (z, y) in rows {
                    let row = &mut bits[(z * BRICK_EDGE + y) as usize];
                    for x in 0..own.x {
                        *row |= u32::from(self.holds(self.stored(UVec3::new(x, y, z)))) << x;
                    }
                }
                if bits.iter().all(|&row| row == 0) {
                    return Ok(None);
                }
            }
        }
        Ok(Some(bits))
    }

    fn decode(&mut self, xyz: UVec3) -> Result<(), CenterlineError> {
        let id = BrickId::new(self.space.lod, xyz);
        self.store
            .read_brick_into(id, &mut self.reader, &mut self.data)?;
        Ok(())
    }

    /// The stored value of a voxel of the brick decoded last.
    fn stored(&self, in_brick: UVec3) -> f32 {
        let p = in_brick + BRICK_BORDER;
        let at = ((p.z * STORED_EDGE + p.y) * STORED_EDGE + p.x) as usize;
        let v = &self.data.voxels;
        match self.store.stored_type() {
            StoredType::U8 => f32::from(v[at]),
            StoredType::U16 => f32::from(u16::from_le_bytes([v[2 * at], v[2 * at + 1]])),
            StoredType::F32 => {
                f32::from_le_bytes([v[4 * at], v[4 * at + 1], v[4 * at + 2], v[4 * at + 3]])
            }
        }
    }

    /// The physical value of a voxel of the level.
    ///
    /// # Errors
    /// The brick is damaged.
    pub(super) fn value(&mut self, voxel: U64Vec3) -> Result<f64, CenterlineError> {
        let (xyz, inside) = split(voxel);
        self.decode(xyz)?;
        Ok(self.rescale.physical(f64::from(self.stored(inside))))
    }

    /// True when a voxel of the level is lumen. Bricks are kept for the next question.
    ///
    /// # Errors
    /// The brick is damaged.
    pub(super) fn contains(&mut self, voxel: U64Vec3) -> Result<bool, CenterlineError> {
        let (xyz, inside) = split(voxel);
        let index = self.space.grid.index(xyz);
        let bits = match self.kept.get(&index) {
            Some(bits) => bits.clone(),
            None => {
                let bits = self.bits(xyz)?.map(|b| Rc::new(*b));
                if self.kept.len() >= KEPT_BRICKS {
                    self.kept.clear();
                }
                self.kept.insert(index, bits.clone());
                bits
            }
        };
        Ok(bits.is_some_and(|b| b[row_of(inside)] >> inside.x & 1 == 1))
    }
}

/// The brick of a voxel, and its place in it.
pub(super) fn split(voxel: U64Vec3) -> (UVec3, UVec3) {
    let edge = u64::from(BRICK_EDGE);
    ((voxel / edge).as_uvec3(), (voxel % edge).as_uvec3())
}

/// The row of a place in a brick.
pub(super) fn row_of(in_brick: UVec3) -> usize {
    (in_brick.z * BRICK_EDGE + in_brick.y) as usize
}
