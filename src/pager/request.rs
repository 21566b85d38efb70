//! What a picture asks for.

use crate::geom::BrickId;

/// Lower comes first. Ties are broken by [`BrickId`], so that replays are exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Priority(pub u32);

/// One wanted brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Request {
    /// When.
    pub priority: Priority,
    /// Which.
    pub brick: BrickId,
}
