//! What frames are.

use std::path::Path;

use super::{FrameRate, VideoError};

/// What every frame of a film has in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFormat {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Frames per second.
    pub rate: FrameRate,
    /// Is the alpha left out?
    pub opaque: bool,
}

impl FrameFormat {
    /// Refuses a frame that is not of this size.
    pub(super) fn check_length(
        self,
        path: &Path,
        number: u64,
        rgba: &[u8],
    ) -> Result<(), VideoError> {
        let [width, height] = self.size.map(u64::from);
        let (expected, found) = (width * height * 4, rgba.len() as u64);
        if found == expected {
            return Ok(());
        }
        Err(VideoError::Length {
            path: path.to_owned(),
            number,
            expected,
            found,
        })
    }
}
