//! Where voxel bytes go: an [`OutFile`] behind a buffer, compressed or not, that counts what it gets.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::writer::{ExportError, VolumeWriter};
use crate::outfile::{Existing, OutFile};
use crate::volume::VolumeDesc;

/// Half of zlib's effort: two thirds of the time for a hundredth of the size.
const GZIP_LEVEL: u32 = 4;

/// An [`OutFile`] as a writer.
struct Target(OutFile);

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.file().flush()
    }
}

enum Stream {
    Plain(BufWriter<Target>),
    Gzip(Box<GzEncoder<BufWriter<Target>>>),
}

impl Stream {
    fn writer(&mut self) -> &mut dyn Write {
        match self {
            Self::Plain(w) => w,
            Self::Gzip(w) => w,
        }
    }
}

/// What is written of the header, and before which step of compression.
pub(super) enum Header<'a> {
    /// No header, no compression.
    None,
    /// Inside the gzip stream.
    Inside(&'a [u8]),
    /// Before the gzip stream.
    Before(&'a [u8]),
}

/// The rest of a volume's file after its header: voxels, counted.
pub(super) struct Sink {
    path: PathBuf,
    stream: Stream,
    voxel_bytes: usize,
    expected: u64,
    written: u64,
}

impl Sink {
    /// Starts the file and writes its header.
    pub(super) fn create(
        path: &Path,
        desc: &VolumeDesc,
        existing: Existing,
        header: &Header<'_>,
    ) -> Result<Self, ExportError> {
        let failed = |error| ExportError::Write {
            path: path.to_owned(),
            error,
        };
        let target = Target(OutFile::create(path, existing)?);
        let mut file = BufWriter::with_capacity(1 << 20, target);
        let stream = match *header {
            Header::None => Stream::Plain(file),
            Header::Inside(bytes) => {
                let mut gzip = GzEncoder::new(file, Compression::new(GZIP_LEVEL));
                gzip.write_all(bytes).map_err(failed)?;
                Stream::Gzip(Box::new(gzip))
            }
            Header::Before(bytes) => {
                file.write_all(bytes).map_err(failed)?;
                Stream::Gzip(Box::new(GzEncoder::new(file, Compression::new(GZIP_LEVEL))))
            }
        };
        Ok(Self {
            path: path.to_owned(),
            stream,
            voxel_bytes: desc.voxel_type.size(),
            expected: desc.byte_count().unwrap_or(u64::MAX),
            written: 0,
        })
    }

    /// Takes `bytes_le` as voxels and writes what `convert` makes of them.
    pub(super) fn write_with(
        &mut self,
        bytes_le: &[u8],
        convert: impl FnOnce(&[u8], &mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        if !bytes_le.len().is_multiple_of(self.voxel_bytes) {
            let message = format!(
                "{} bytes are not whole voxels of {} bytes",
                bytes_le.len(),
                self.voxel_bytes
            );
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        self.written += bytes_le.len() as u64;
        convert(bytes_le, self.stream.writer())
    }
}

impl VolumeWriter for Sink {
    fn write(&mut self, bytes_le: &[u8]) -> io::Result<()> {
        self.write_with(bytes_le, |bytes, out| out.write_all(bytes))
    }

    fn finish(self: Box<Self>) -> Result<(), ExportError> {
        let Self {
            path,
            stream,
            expected,
            written,
            ..
        } = *self;
        if written != expected {
            return Err(ExportError::Length {
                path,
                expected,
                found: written,
            });
        }
        let file = match stream {
            Stream::Plain(file) => Ok(file),
            Stream::Gzip(gzip) => gzip.finish(),
        };
        let target = file.and_then(|f| f.into_inner().map_err(io::IntoInnerError::into_error));
        match target {
            Ok(Target(file)) => Ok(file.commit()?),
            Err(error) => Err(ExportError::Write { path, error }),
        }
    }
}
