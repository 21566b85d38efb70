//! What rendering returns.

use std::collections::BTreeMap;

use crate::geom::{BrickId, Lod};
use crate::scene::{Image, PictureStats};

/// A picture: complete, or a frame of a moving one.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// The numbers of `--stats`.
    pub stats: PictureStats,
    /// The bricks with voxels that were sampled, in order: what a working set is. Empty on the CPU.
    pub touched: Vec<BrickId>,
    /// Where coarser bricks stand in for missing ones; nowhere in a complete picture.
    pub stand_ins: StandIns,
    /// What a user should be told: a coarser level than asked for, less memory than allowed.
    pub notes: Vec<String>,
}

/// What was missing when a frame of a moving picture was drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StandIns {
    /// Rays that met a missing brick.
    pub rays: u64,
    /// The missing bricks, by the level that stood in for them (at their middle); `None`: nothing did.
    pub bricks: BTreeMap<Option<Lod>, u64>,
}

/// What [`super::Engine::page`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageReport {
    /// Bricks read and decoded.
    pub bricks_read: u64,
    /// Bricks copied to the device.
    pub bricks_uploaded: u64,
}
