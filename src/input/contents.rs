//! [`Contents`]: a file's bytes from the first one on, decompressed where they lie in gzip; the header comes out first, then
//! what is left becomes a [`VoxelFile`]. What the bytes mean is not known here.

use std::fs::File;
use std::io::{self, Read};

use super::problem::Subject;
use super::raw::Endian;
use super::stream::{Compression, most_inflated_bytes};
use super::voxel_file::{VoxelFile, voxel_bytes};
use crate::volume::{SourceError, VolumeDesc};

/// A file of which the header is being read.
pub(super) struct Contents<'a> {
    subject: Subject<'a>,
    file: File,
    /// Of the file, compressed or not.
    len: u64,
    stream: Option<Box<dyn Read + Send>>,
    /// Bytes that have come out so far.
    read: u64,
}

impl<'a> Contents<'a> {
    /// Opens the file; `compressed` when it is gzip.
    pub(super) fn open(subject: &Subject<'a>, compressed: bool) -> Result<Self, SourceError> {
        let (file, len) = subject.open()?;
        let stream = if compressed {
            let file = file.try_clone().map_err(|e| subject.io("open", e))?;
            let stream = Compression::Gzip.open(file, 0);
            Some(stream.map_err(|e| subject.io("read", e))?)
        } else {
            None
        };
        Ok(Self {
            subject: *subject,
            file,
            len,
            stream,
            read: 0,
        })
    }

    /// Reads on until `header` has `bytes` bytes.
    ///
    /// # Errors
    /// The file ends before, or its compressed stream is damaged.
    pub(super) fn extend(&mut self, header: &mut Vec<u8>, bytes: usize) -> Result<(), SourceError> {
        let missing = bytes.saturating_sub(header.len()) as u64;
        let reader: &mut dyn Read = match &mut self.stream {
            Some(stream) => stream,
            None => &mut self.file,
        };
        let result = reader.take(missing).read_to_end(header);
        let subject = &self.subject;
        self.read += result.map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof
            | io::ErrorKind::InvalidInput
            | io::ErrorKind::InvalidData => subject.malformed(
                format!("byte {} of the header", header.len()),
                "a sound gzip stream",
                e.to_string(),
            ),
            _ => subject.io("read the header", e),
        })? as u64;
        if header.len() < bytes {
            return Err(subject.malformed(
                "the header",
                format!("{bytes} bytes"),
                format!("the end of the file after {}", header.len()),
            ));
        }
        Ok(())
    }

    /// The voxels, which start at byte `start` (of the decompressed bytes). Of a compressed file, all before them is read
    /// and dropped now.
    ///
    /// # Errors
    /// The file can't hold them, or its compressed stream is damaged before them.
    pub(super) fn voxels(
        self,
        desc: VolumeDesc,
        endian: Endian,
        start: u64,
    ) -> Result<VoxelFile, SourceError> {
        let subject = self.subject;
        let Some(mut reader) = self.stream else {
            return VoxelFile::plain(&subject, desc, endian, self.file, start);
        };
        let most = most_inflated_bytes(self.len);
        let bytes = voxel_bytes(&subject, &desc)?;
        let needless = start.checked_sub(self.read);
        let end = start.checked_add(bytes).filter(|&end| end <= most);
        let (Some(gap), Some(_)) = (needless, end) else {
            return Err(subject.malformed(
                "the voxels",
                format!("{bytes} bytes from byte {start} on, behind the header"),
                format!(
                    "{} bytes of gzip, which cannot decompress to more than {most}",
                    self.len
                ),
            ));
        };
        let skipped = io::copy(&mut reader.by_ref().take(gap), &mut io::sink()).map_err(|e| {
            subject.malformed(
                "what is before the voxels",
                "a sound gzip stream",
                e.to_string(),
            )
        })?;
        if skipped != gap {
            return Err(subject.malformed(
                "the voxels",
                format!("{bytes} bytes from byte {start} on"),
                format!("a stream of {} bytes", self.read + skipped),
            ));
        }
        let stream = (reader, Compression::Gzip);
        let voxels = VoxelFile::stream(&subject, desc, endian, self.len, stream)?;
        Ok(voxels.behind(start))
    }
}
