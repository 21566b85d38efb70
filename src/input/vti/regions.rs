//! [`Region`]: the bytes of a part of a file, as they are or written in base64, read from any place.

use std::fs::File;
use std::io;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::super::problem::Subject;
use super::super::voxel_file::read_exact_at;
use crate::volume::SourceError;

/// Base64 as any writer puts it: with padding or without.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Groups of 4 characters, each of 3 bytes, that are decoded at once.
const GROUPS: u64 = 16 << 10;

/// How bytes are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Base64,
}

impl Encoding {
    /// Bytes of the file that `bytes` bytes take, padding counted; `None` beyond `u64`.
    pub(super) fn length_of(self, bytes: u64) -> Option<u64> {
        match self {
            Self::Raw => Some(bytes),
            Self::Base64 => bytes.div_ceil(3).checked_mul(4),
        }
    }
}

/// A part of a file.
pub(super) struct Region {
    pub(super) file: File,
    pub(super) encoding: Encoding,
    /// Its first byte in the file.
    pub(super) start: u64,
    /// The byte behind its last one, or later.
    pub(super) end: u64,
}

impl Region {
    /// True when it can hold `bytes` bytes.
    pub(super) fn holds(&self, bytes: u64) -> bool {
        let length = self.encoding.length_of(bytes);
        // The last group may lack its padding.
        length.is_some_and(|n| n.saturating_sub(2) <= self.end.saturating_sub(self.start))
    }

    /// Fills `out` with the (decoded) bytes from `at` on.
    ///
    /// # Errors
    /// The region ends before, it can't be read, or is no base64.
    pub(super) fn read(
        &self,
        subject: &Subject<'_>,
        at: u64,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let end = at.checked_add(out.len() as u64);
        if !end.is_some_and(|end| self.holds(end)) {
            let expected = format!("{} bytes from byte {at} of the data on", out.len());
            let found = format!(
                "data that lie between bytes {} and {}",
                self.start, self.end
            );
            return Err(subject.malformed("the data", expected, found));
        }
        match self.encoding {
            Encoding::Raw => self.fetch(subject, self.start + at, out),
            Encoding::Base64 => self.decode(subject, at, out),
        }
    }

    fn decode(&self, subject: &Subject<'_>, at: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let most = (GROUPS as usize).min(out.len() / 3 + 2);
        let mut text = vec![0; 4 * most];
        let mut bytes = vec![0; 3 * most];
        let (mut at, mut out) = (at, out);
        while !out.is_empty() {
            let skip = (at % 3) as usize;
            let groups = (skip + out.len()).div_ceil(3).min(most);
            let place = self.start + at / 3 * 4;
            let text = &mut text[..(4 * groups).min((self.end - place) as usize)];
            self.fetch(subject, place, text)?;
            let malformed = |found: String| {
                let where_ = format!("the base64 text from byte {place} on");
                let expected = format!("{} characters without line breaks", text.len());
                subject.malformed(where_, expected, found)
            };
            let n = BASE64
                .decode_slice(&*text, &mut bytes)
                .map_err(|e| malformed(e.to_string()))?;
            let take = (3 * groups - skip).min(out.len());
            if n < skip + take {
                return Err(malformed(format!("only {n} bytes in them")));
            }
            let (done, rest) = out.split_at_mut(take);
            done.copy_from_slice(&bytes[skip..skip + take]);
            (at, out) = (at + take as u64, rest);
        }
        Ok(())
    }

    fn fetch(&self, subject: &Subject<'_>, at: u64, out: &mut [u8]) -> Result<(), SourceError> {
        read_exact_at(&self.file, out, at).map_err(|e| {
            if e.kind() == io::ErrorKind::UnexpectedEof {
                subject.malformed(
                    format!("byte {at}"),
                    format!("{} more bytes of data", out.len()),
                    "the end of the file, which has become shorter since it was opened",
                )
            } else {
                subject.io(format!("read at byte {at}"), e)
            }
        })
    }
}
