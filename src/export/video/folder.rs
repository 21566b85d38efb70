//! Frames as PNGs in a folder: `frame-00000.png` and so on, with `fly.json`, which says what they are of.
//!
//! Every file appears only when it is complete, so that a run that was interrupted can be gone on with: what is there
//! stays. It stays only if it is of the same film; otherwise the run is refused by what differs.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::job::differences;
use super::{FrameFormat, FrameSink, VideoError};
use crate::export::write_png;
use crate::outfile::{Existing, write_whole};

/// What says of which film the frames are.
pub(super) const JOB_FILE: &str = "fly.json";
/// A job is a few kilobytes and its path's keys; more than this is some other file.
const MAX_JOB_BYTES: u64 = 64 << 20;

/// What becomes of frames that are in the folder already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EarlierFrames {
    /// They stay, if they are of the same job; else the run is refused.
    Keep,
    /// The run is refused.
    Refuse,
    /// They are removed.
    Remove,
}

/// A folder of frames.
#[derive(Debug)]
pub struct PngFolder {
    folder: PathBuf,
    format: FrameFormat,
}

impl PngFolder {
    /// The frames in `folder`, which is made if it is not there (but not the one around it). `job` says of what they are; it
    /// is written beside them.
    ///
    /// # Errors
    /// The folder can't be made, read or written; or it holds frames that are not to stay.
    pub fn open(
        folder: &Path,
        format: FrameFormat,
        job: &Value,
        earlier: EarlierFrames,
    ) -> Result<Self, VideoError> {
        if folder.exists() && !folder.is_dir() {
            return Err(VideoError::IsFile(folder.to_owned()));
        }
        if !folder.is_dir() {
            fs::create_dir(folder).map_err(|error| match error.kind() {
                io::ErrorKind::NotFound => VideoError::NoFolder(folder.to_owned()),
                _ => failed(folder, "make the folder")(error),
            })?;
        }
        let frames = frames_in(folder)?;
        match earlier {
            EarlierFrames::Remove => {
                for frame in &frames {
                    fs::remove_file(frame).map_err(failed(frame, "remove"))?;
                }
            }
            EarlierFrames::Refuse if !frames.is_empty() => {
                return Err(VideoError::HasFrames(folder.to_owned()));
            }
            EarlierFrames::Keep if !frames.is_empty() => check_job(folder, job)?,
            EarlierFrames::Keep | EarlierFrames::Refuse => (),
        }
        write_whole(
            &folder.join(JOB_FILE),
            Existing::Replace,
            format!("{job:#}\n").as_bytes(),
        )?;
        Ok(Self {
            folder: folder.to_owned(),
            format,
        })
    }

    fn frame(&self, number: u64) -> PathBuf {
        self.folder.join(format!("frame-{number:05}.png"))
    }
}

impl FrameSink for PngFolder {
    fn has(&self, number: u64) -> bool {
        is_complete(&self.frame(number), self.format).unwrap_or(false)
    }

    fn push(&mut self, number: u64, rgba: &[u8]) -> Result<(), VideoError> {
        let FrameFormat {
            size: [width, height],
            opaque,
            ..
        } = self.format;
        let path = self.frame(number);
        write_png(&path, width, height, rgba, opaque, Existing::Replace)?;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        Ok(())
    }
}

fn failed(path: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> VideoError {
    let path = path.to_owned();
    move |error| VideoError::Io { path, doing, error }
}

/// The files of a folder that are named as frames are.
fn frames_in(folder: &Path) -> Result<Vec<PathBuf>, VideoError> {
    let mut frames = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed(folder, "read the folder"))? {
        let entry = entry.map_err(failed(folder, "read the folder"))?;
        if is_frame(&entry.file_name()) {
            frames.push(entry.path());
        }
    }
    Ok(frames)
}

fn is_frame(name: &OsStr) -> bool {
    let number = name
        .to_str()
        .and_then(|n| n.strip_prefix("frame-")?.strip_suffix(".png"));
    number.is_some_and(|n| n.len() >= 5 && n.bytes().all(|b| b.is_ascii_digit()))
}

/// Is a file of that name one that a [`PngFolder`] writes?
pub fn is_of_folder(name: &OsStr) -> bool {
    name == JOB_FILE || is_frame(name)
}

/// Refuses a folder whose frames are not of `job`.
fn check_job(folder: &Path, job: &Value) -> Result<(), VideoError> {
    let Some(before) = read_job(&folder.join(JOB_FILE))? else {
        return Err(VideoError::UnknownFilm {
            folder: folder.to_owned(),
        });
    };
    let differences = differences(&before, job);
    if differences.is_empty() {
        return Ok(());
    }
    Err(VideoError::OtherFilm {
        folder: folder.to_owned(),
        differences,
    })
}

/// The job in `path`; `None` where there is none that can be read as one.
fn read_job(path: &Path) -> Result<Option<Value>, VideoError> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(failed(path, "read")(error)),
    };
    let mut text = Vec::new();
    file.take(MAX_JOB_BYTES)
        .read_to_end(&mut text)
        .map_err(failed(path, "read"))?;
    Ok(serde_json::from_slice(&text).ok())
}

/// Does the file begin and end as a PNG of this format does? Files cut off, or of another size, are drawn anew.
fn is_complete(path: &Path, format: FrameFormat) -> io::Result<bool> {
    const END: [u8; 12] = *b"\0\0\0\0IEND\xaeB`\x82";
    let mut file = File::open(path)?;
    let mut head = [0; 26];
    file.read_exact(&mut head)?;
    let mut tail = [0; END.len()];
    file.seek(SeekFrom::End(-(END.len() as i64)))?;
    file.read_exact(&mut tail)?;
    let [width, height] = format.size.map(u32::to_be_bytes);
    let color = if format.opaque { 2 } else { 6 };
    Ok(head.starts_with(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")
        && head[16..20] == width
        && head[20..24] == height
        && head[24..] == [8, color]
        && tail == END)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const FORMAT: FrameFormat = FrameFormat {
        size: [4, 3],
        rate: super::super::rate::TEN,
        opaque: true,
    };

    #[test]
    fn a_folder_is_gone_on_with() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("film");
        let job = json!({"size": [4, 3], "store": {"hash": "1"}});
        let open = |job: &Value, earlier| PngFolder::open(&folder, FORMAT, job, earlier);
        let mut film = open(&job, EarlierFrames::Keep).unwrap();
        for number in 0..3 {
            film.push(number, &[number as u8; 48]).unwrap();
        }
        let whole = fs::read(folder.join("frame-00001.png")).unwrap();
        // One is cut off, one is gone.
        fs::write(folder.join("frame-00001.png"), &whole[..whole.len() - 1]).unwrap();
        fs::remove_file(folder.join("frame-00002.png")).unwrap();
        let film = open(&job, EarlierFrames::Keep).unwrap();
        assert_eq!([0, 1, 2].map(|n| film.has(n)), [true, false, false]);
        let wider = PngFolder {
            format: FrameFormat {
                size: [8, 3],
                ..FORMAT
            },
            ..film
        };
        assert!(!wider.has(0), "a frame of another size");

        let other = json!({"size": [4, 3], "store": {"hash": "2"}});
        let refused = open(&other, EarlierFrames::Keep).unwrap_err().to_string();
        assert!(refused.contains("store.hash"), "{refused}");
        assert!(
            matches!(
                open(&job, EarlierFrames::Refuse),
                Err(VideoError::HasFrames(_))
            ),
            "no frames may be there"
        );
        fs::write(folder.join(JOB_FILE), "[").unwrap();
        assert!(
            matches!(
                open(&job, EarlierFrames::Keep),
                Err(VideoError::UnknownFilm { .. })
            ),
            "a job is needed"
        );
        fs::write(folder.join("frame-1.png"), "mine").unwrap();
        let film = open(&other, EarlierFrames::Remove).unwrap();
        assert!(!film.has(0), "all frames anew");
        assert!(folder.join("frame-1.png").exists(), "not a name of ours");
    }
}
