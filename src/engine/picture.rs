//! What rendering returns.

use crate::geom::BrickId;
use crate::scene::{Image, PictureStats};

/// A complete picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// The numbers of `--stats`.
    pub stats: PictureStats,
    /// The bricks with voxels that were sampled, in order: what a working set is. Empty on the CPU.
    pub touched: Vec<BrickId>,
    /// What a user should be told: a coarser level than asked for, less memory than allowed.
    pub notes: Vec<String>,
}
