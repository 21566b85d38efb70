//! What can go wrong with a film.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::export::ExportError;
use crate::outfile::OutFileError;

/// Why there is no film.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum VideoError {
    #[error(transparent)]
    File(#[from] OutFileError),
    #[error(transparent)]
    Picture(#[from] ExportError),
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        path: PathBuf,
        doing: &'static str,
        error: io::Error,
    },
    #[error("{}: the folder around it does not exist; make it first", .0.display())]
    NoFolder(PathBuf),
    #[error("{}: is a file; expected a folder for the frames, or a name that ends in .mp4", .0.display())]
    IsFile(PathBuf),
    #[error(
        "{}: holds frames of another film: {}; choose another folder, or give --force to draw all frames anew",
        folder.display(), differences.join("; ")
    )]
    OtherFilm {
        folder: PathBuf,
        differences: Vec<String>,
    },
    #[error(
        "{}: holds frames, but no {} that says what they are of; choose another folder, or give --force to draw all frames \
         anew",
        folder.display(), super::folder::JOB_FILE
    )]
    UnknownFilm { folder: PathBuf },
    #[error(
        "{}: holds frames of an earlier flight, and one in real time can't be gone on with; choose another folder, or give \
         --force to remove them",
        .0.display()
    )]
    HasFrames(PathBuf),
    #[error(
        "{}: H.264 in 4:2:0 needs an even width and height, and this is {}x{}; give --size {}x{}, or a folder for PNG frames",
        path.display(), size[0], size[1], size[0].next_multiple_of(2), size[1].next_multiple_of(2)
    )]
    OddSize { path: PathBuf, size: [u32; 2] },
    #[error(
        "{}: a film has no transparency; give --background a colour, or a folder for PNG frames",
        .0.display()
    )]
    Transparent(PathBuf),
    #[error(
        "{}: no encoder for MP4: it needs ffmpeg (with libx264) on PATH, or a build with --features h264; or give a folder \
         for PNG frames",
        .0.display()
    )]
    NoEncoder(PathBuf),
    #[error("{}: {encoder} failed{}", path.display(), told(reason))]
    Encoder {
        path: PathBuf,
        encoder: &'static str,
        reason: String,
    },
    #[error("{}: frame {number} has {found} bytes; expected {expected}", path.display())]
    Length {
        path: PathBuf,
        number: u64,
        expected: u64,
        found: u64,
    },
    #[error("the thread that writes frames ended without a result; its panic message says why")]
    Writer,
}

fn told(reason: &str) -> String {
    match reason.trim() {
        "" => String::new(),
        reason => format!(": {reason}"),
    }
}
