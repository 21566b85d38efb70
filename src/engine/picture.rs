//! What rendering returns.

use crate::scene::{Image, PictureStats};

/// A complete picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// The numbers of `--stats`.
    pub stats: PictureStats,
    /// What a user should be told: a coarser level than asked for, less memory than allowed.
    pub notes: Vec<String>,
}
