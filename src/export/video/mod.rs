//! Films: frames of one size, one after the other, as a folder of PNGs or as one MP4 file.
//!
//! All of them are a [`FrameSink`]. A folder can be gone on with after an interruption; an MP4 file appears only when it is
//! complete. The same frames give the same bytes. No rendering here, and no clock: when a frame is shown is its number
//! divided by the [`FrameRate`].

mod bt709;
mod error;
mod ffmpeg;
mod folder;
mod format;
#[cfg(feature = "h264")]
mod h264;
mod job;
mod mp4;
mod queue;
mod rate;

pub use bt709::Yuv420;
pub use error::VideoError;
pub use folder::{EarlierFrames, PngFolder, is_of_folder};
pub use format::FrameFormat;
pub use job::differences;
pub use mp4::create_mp4;
pub use queue::FrameQueue;
pub use rate::FrameRate;

/// Takes the frames of a film, in their order.
pub trait FrameSink: Send {
    /// Is this frame there already, from an earlier run? Then it need not be drawn or pushed.
    fn has(&self, number: u64) -> bool {
        let _ = number;
        false
    }

    /// Takes frame `number`: `rgba` in rows, row 0 at the top, straight alpha.
    ///
    /// # Errors
    /// It can't be encoded or written.
    fn push(&mut self, number: u64, rgba: &[u8]) -> Result<(), VideoError>;

    /// All frames are there: makes the film complete. Without it, nothing is left of a film that is one file.
    ///
    /// # Errors
    /// It can't be written.
    fn finish(self: Box<Self>) -> Result<(), VideoError>;
}
