//! What the index of a level tells under a classification, before any record is read: which bricks can be seen, which are
//! constant. One pass over 32 bytes per brick, nothing is kept (invariant 6 of design.md).

use crate::classify::Visibility;
use crate::geom::{BrickId, Lod};
use crate::store::Store;

/// A brick as the index has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScannedBrick {
    /// Which.
    pub id: BrickId,
    /// Its linear index in the level.
    pub index: u64,
    /// Least and greatest stored value.
    pub range: [f32; 2],
    /// All voxels equal: no record, no slot.
    pub constant: bool,
    /// Something in it may be visible.
    pub visible: bool,
}

/// All bricks of a level whose index was checked, in its order.
pub fn scan<'a>(
    store: &'a Store,
    lod: Lod,
    visibility: &'a Visibility,
) -> impl Iterator<Item = ScannedBrick> + 'a {
    (0..).zip(store.bricks(lod)).map(move |(index, id)| {
        let entry = store.entry(id);
        ScannedBrick {
            id,
            index,
            range: [entry.min, entry.max],
            constant: entry.constant,
            visible: visibility.is_visible(entry.min, entry.max),
        }
    })
}
