//! Where the frames go.

use std::path::Path;

use anyhow::bail;

use super::{Args, Flight, job};
use crate::engine::Engine;
use crate::export::video::{
    EarlierFrames, FrameFormat, FrameQueue, FrameSink, PngFolder, create_mp4, is_of_folder,
};
use crate::outfile::{Existing, OutFile, is_same_place};
use crate::scene::Background;

/// Frames that wait for being written, at most.
const QUEUE: usize = 3;
/// Endings of names that are formats which are not built, and no folders.
const NOT_BUILT: [&str; 16] = [
    "apng", "avi", "exr", "gif", "h264", "jpeg", "jpg", "m4v", "mkv", "mov", "mpeg", "mpg", "ogv",
    "png", "webm", "wmv",
];

/// A film that was begun.
pub(super) struct Film {
    pub(super) queue: FrameQueue,
    /// Per frame: is it there already?
    pub(super) there: Vec<bool>,
    /// What encodes it, if not we.
    pub(super) encoder: Option<&'static str>,
}

/// Can the statistics be written at all, and are they no part of the film? Asked before minutes of work.
///
/// # Errors
/// They can't, or they are.
pub(super) fn check_stats(args: &Args) -> anyhow::Result<()> {
    let Some(stats) = &args.stats else {
        return Ok(());
    };
    let folder = stats.parent().filter(|p| !p.as_os_str().is_empty());
    let is_in_folder = args.output.is_dir()
        && folder.is_some_and(|f| is_same_place(f, &args.output))
        && stats.file_name().is_some_and(is_of_folder);
    if is_in_folder || is_same_place(stats, &args.output) {
        bail!(
            "--stats {}: is a file of the film itself ({}); give another name",
            stats.display(),
            args.output.display()
        );
    }
    drop(OutFile::create(stats, Existing::Replace)?);
    Ok(())
}

/// Begins the film or opens the folder. Nothing has been drawn yet.
///
/// # Errors
/// The output can't be made, can't be of this size, or holds another flight.
pub(super) fn begin(args: &Args, flight: &Flight, engine: &Engine) -> anyhow::Result<Film> {
    let format = FrameFormat {
        size: args.look.size(),
        rate: flight.rate,
        opaque: args.look.background() != Background::Transparent,
    };
    let (sink, encoder): (Box<dyn FrameSink>, _) = if is_mp4(&args.output)? {
        let existing = match args.force {
            true => Existing::Replace,
            false => Existing::Refuse,
        };
        let (sink, encoder) = create_mp4(&args.output, format, existing)?;
        (sink, Some(encoder))
    } else {
        let earlier = match (args.force, args.realtime) {
            (true, _) => EarlierFrames::Remove,
            (false, true) => EarlierFrames::Refuse,
            (false, false) => EarlierFrames::Keep,
        };
        let job = job::describe(args, flight, engine)?;
        (
            Box::new(PngFolder::open(&args.output, format, &job, earlier)?),
            None,
        )
    };
    Ok(Film {
        there: (0..flight.frames).map(|n| sink.has(n)).collect(),
        queue: FrameQueue::new(sink, QUEUE),
        encoder,
    })
}

/// Is the output one file? By its name, unless a folder is there.
fn is_mp4(output: &Path) -> anyhow::Result<bool> {
    if output.is_dir() {
        return Ok(false);
    }
    let extension = output
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
        .to_lowercase();
    if NOT_BUILT.contains(&extension.as_str()) {
        bail!(
            "{}: films are written as .mp4, frames as PNGs into a folder; other formats are not built yet",
            output.display()
        );
    }
    Ok(extension == "mp4")
}
