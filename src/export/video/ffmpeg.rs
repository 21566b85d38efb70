//! MP4 by a pipe to `ffmpeg`: raw planes in, H.264 by libx264 out. Nothing of it is linked.

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

use super::{FrameFormat, FrameSink, VideoError, Yuv420};
use crate::outfile::OutFile;

/// What `ffmpeg` says is kept up to so many bytes.
const MOST_WORDS: u64 = 4096;

/// A running `ffmpeg` and the file that it writes.
#[derive(Debug)]
pub(super) struct FfmpegPipe {
    out: Option<OutFile>,
    path: PathBuf,
    format: FrameFormat,
    child: Child,
    /// Closed at the end: that ends the film.
    input: Option<ChildStdin>,
    /// Reads what it says, so that it never waits for a reader.
    words: Option<JoinHandle<String>>,
}

impl FfmpegPipe {
    pub(super) const NAME: &'static str = "ffmpeg";

    /// Is there an `ffmpeg` that runs and has libx264?
    pub(super) fn is_there() -> bool {
        Command::new(Self::NAME)
            .args(["-hide_banner", "-encoders"])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .output()
            .is_ok_and(|o| o.status.success() && contains(&o.stdout, b"libx264"))
    }

    /// Starts it.
    ///
    /// # Errors
    /// It can't be started.
    pub(super) fn begin(out: OutFile, format: FrameFormat) -> Result<Self, VideoError> {
        let path = out.dest().to_owned();
        // A prefix, so that no name is taken for an option or a protocol.
        let mut file = std::ffi::OsString::from("file:");
        file.push(out.temp_path());
        let mut child = Command::new(Self::NAME)
            .args(arguments(format))
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| VideoError::Encoder {
                path: path.clone(),
                encoder: Self::NAME,
                reason: error.to_string(),
            })?;
        let words = child.stderr.take().map(|mut stderr| {
            std::thread::spawn(move || {
                let mut words = Vec::new();
                // Words that can't be read are no reason to fail; the rest is read to its end and dropped.
                let _ = stderr.by_ref().take(MOST_WORDS).read_to_end(&mut words);
                let _ = std::io::copy(&mut stderr, &mut std::io::sink());
                String::from_utf8_lossy(&words).into_owned()
            })
        });
        Ok(Self {
            out: Some(out),
            path,
            format,
            input: child.stdin.take(),
            child,
            words,
        })
    }

    /// Waits for its end. The error is what it said, or `otherwise`.
    fn end(&mut self, otherwise: &str) -> Result<(), VideoError> {
        self.input = None;
        let status = self.child.wait();
        let words = self.words.take().and_then(|w| w.join().ok());
        match status {
            Ok(status) if status.success() && otherwise.is_empty() => Ok(()),
            status => {
                let ended = status.map_or_else(|e| e.to_string(), |s| s.to_string());
                let words = words.unwrap_or_default();
                let said = [words.trim(), otherwise, &ended];
                let said: Vec<&str> = said.into_iter().filter(|s| !s.is_empty()).collect();
                Err(VideoError::Encoder {
                    path: self.path.clone(),
                    encoder: Self::NAME,
                    reason: said.join("; "),
                })
            }
        }
    }
}

/// Everything but the file. The number of threads is fixed, since libx264's choices depend on it; metadata that would name
/// versions and times are left out.
fn arguments(format: FrameFormat) -> Vec<String> {
    let [width, height] = format.size;
    let colours = "-color_range tv -colorspace bt709 -color_primaries bt709 -color_trc bt709";
    format!(
        "-hide_banner -loglevel error -y -f rawvideo -pix_fmt yuv420p -video_size {width}x{height} -framerate {rate} \
         {colours} -i pipe:0 -an -c:v libx264 -preset medium -crf 16 -pix_fmt yuv420p -threads 4 {colours} \
         -fflags +bitexact -flags:v +bitexact -map_metadata -1 -movflags +faststart -f mp4",
        rate = format.rate
    )
    .split_whitespace()
    .map(str::to_owned)
    .collect()
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|w| w == word)
}

impl FrameSink for FfmpegPipe {
    fn push(&mut self, number: u64, rgba: &[u8]) -> Result<(), VideoError> {
        self.format.check_length(&self.path, number, rgba)?;
        let planes = Yuv420::from_rgba(rgba, self.format.size);
        let Some(input) = &mut self.input else {
            return self.end("it ended before");
        };
        let written = planes
            .planes()
            .into_iter()
            .try_for_each(|p| input.write_all(p));
        match written {
            Ok(()) => Ok(()),
            Err(error) => self.end(&error.to_string()),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<(), VideoError> {
        self.end("")?;
        match self.out.take() {
            Some(out) => Ok(out.commit()?),
            None => Ok(()),
        }
    }
}

impl Drop for FfmpegPipe {
    fn drop(&mut self) {
        if self.words.is_some() {
            // Nobody waited for it: the film is given up.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_decides_the_bytes_is_said() {
        let words = arguments(FrameFormat {
            size: [64, 48],
            rate: "30000/1001".parse().unwrap(),
            opaque: true,
        })
        .join(" ");
        for part in [
            "-video_size 64x48 -framerate 30000/1001",
            "-c:v libx264",
            "-threads 4",
            "-colorspace bt709",
            "-movflags +faststart",
            "-flags:v +bitexact",
        ] {
            assert!(words.contains(part), "{part} is in {words}");
        }
    }
}
