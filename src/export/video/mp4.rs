//! One MP4 file: by `ffmpeg` where it is on PATH, else by the encoder that was built in (feature `h264`).

use std::path::Path;

use super::ffmpeg::FfmpegPipe;
use super::{FrameFormat, FrameSink, VideoError};
use crate::outfile::{Existing, OutFile};

/// Begins the MP4 file that will become `path`: H.264, BT.709. Returns what encodes it, in words, too.
///
/// # Errors
/// A size is odd, the frames are transparent, there is no encoder, or the file can't be made.
pub fn create_mp4(
    path: &Path,
    format: FrameFormat,
    existing: Existing,
) -> Result<(Box<dyn FrameSink>, &'static str), VideoError> {
    if format.size.iter().any(|s| s % 2 == 1) {
        return Err(VideoError::OddSize {
            path: path.to_owned(),
            size: format.size,
        });
    }
    if !format.opaque {
        return Err(VideoError::Transparent(path.to_owned()));
    }
    let out = OutFile::create(path, existing)?;
    if FfmpegPipe::is_there() {
        let pipe = FfmpegPipe::begin(out, format)?;
        return Ok((Box::new(pipe), FfmpegPipe::NAME));
    }
    begin_built_in(out, format)
}

#[cfg(feature = "h264")]
fn begin_built_in(
    out: OutFile,
    format: FrameFormat,
) -> Result<(Box<dyn FrameSink>, &'static str), VideoError> {
    let film = super::h264::BuiltIn::begin(out, format)?;
    Ok((Box::new(film), super::h264::BuiltIn::NAME))
}

#[cfg(not(feature = "h264"))]
fn begin_built_in(
    out: OutFile,
    _format: FrameFormat,
) -> Result<(Box<dyn FrameSink>, &'static str), VideoError> {
    Err(VideoError::NoEncoder(out.dest().to_owned()))
}
