//! What a frame asks of the pager.

use std::cmp::Reverse;

use crate::geom::{BrickId, Lod};

/// Why a brick is wanted; the first comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RequestClass {
    /// Always resident: the coarsest level.
    Pinned,
    /// Needed together by the coming pass.
    Held,
    /// A ray stopped for it.
    Missing,
    /// May be wanted soon.
    Predicted,
}

/// When a brick is loaded: lower comes first. Ties are broken by [`BrickId`], so that replays are exact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Priority {
    /// Why it is wanted.
    pub class: RequestClass,
    /// Of predicted bricks: in how many frames it is wanted, sooner comes first. 0 for what is needed now.
    pub ahead: u32,
    /// Rays that stopped for it: more come first.
    pub stopped_rays: Reverse<u32>,
    /// Its level: coarser comes first.
    pub coarseness: Reverse<Lod>,
    /// Distance from the eye, in any unit that all requests of a frame share: nearer comes first.
    pub distance: u32,
}

impl Priority {
    /// A priority from its plain parts.
    pub const fn new(class: RequestClass, stopped_rays: u32, lod: Lod, distance: u32) -> Self {
        Self {
            class,
            ahead: 0,
            stopped_rays: Reverse(stopped_rays),
            coarseness: Reverse(lod),
            distance,
        }
    }

    /// Of a brick that is predicted to be wanted in `ahead` frames.
    pub const fn predicted(ahead: u32, lod: Lod) -> Self {
        Self {
            ahead,
            ..Self::new(RequestClass::Predicted, 0, lod, 0)
        }
    }
}

/// One wanted brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Request {
    /// When.
    pub priority: Priority,
    /// Which.
    pub brick: BrickId,
}

/// What a pass learnt, and what the next one needs. Constant bricks have no place here: they are never loaded.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameRequests<'a> {
    /// Everything that the last pass missed, in any order; a brick that is named twice counts with its first priority
    /// in the order of [`Priority`]. Replaces earlier requests: what is in it no longer is cancelled.
    pub requests: &'a [Request],
    /// Bricks that the coming pass needs together: placed before anything else but pinned ones, and not evicted until
    /// the next frame. Together with the pinned bricks they must fit the slots.
    pub held: &'a [BrickId],
    /// Bricks that the last pass sampled: all equally recent. Bricks without a slot are passed over.
    pub touched: &'a [BrickId],
    /// Interactive: what the last pass touched is not evicted for this frame's requests (for its held bricks it is, so
    /// that progress is certain).
    pub keep_touched: bool,
}
