//! Compressed byte streams: gzip of any number of members, and zlib. What the bytes mean is not known here.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

use flate2::bufread::{GzDecoder, ZlibDecoder};

/// Bytes read from the file at once.
const BUFFER_BYTES: usize = 256 << 10;

/// The most that one byte of a deflate stream can stand for: a match of 258 bytes takes at least 2 bits.
const MOST_PER_BYTE: u64 = 1032;

/// How the bytes of a stream are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    /// One or more gzip members.
    Gzip,
    /// One zlib stream.
    Zlib,
}

impl Compression {
    /// Its name in messages.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
        }
    }

    /// The decompressed bytes of `file` from byte `start` on.
    pub(super) fn open(self, mut file: File, start: u64) -> io::Result<Box<dyn Read + Send>> {
        file.seek(SeekFrom::Start(start))?;
        let buffered = BufReader::with_capacity(BUFFER_BYTES, file);
        Ok(match self {
            Self::Gzip => Box::new(GzipMembers::new(buffered)),
            Self::Zlib => Box::new(ZlibDecoder::new(buffered)),
        })
    }
}

/// An upper bound of what `compressed_bytes` can decompress to: what lets a lying header be refused before any work.
pub(super) fn most_inflated_bytes(compressed_bytes: u64) -> u64 {
    compressed_bytes.saturating_mul(MOST_PER_BYTE)
}

/// Gzip members one after another, as `gzip -d` reads them: what follows the last member and is none is ignored.
struct GzipMembers<R: BufRead> {
    member: Option<GzDecoder<R>>,
}

impl<R: BufRead> GzipMembers<R> {
    fn new(reader: R) -> Self {
        Self {
            member: Some(GzDecoder::new(reader)),
        }
    }
}

impl<R: BufRead> Read for GzipMembers<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if out.is_empty() {
            return Ok(0);
        }
        while let Some(member) = &mut self.member {
            let n = member.read(out)?;
            if n > 0 {
                return Ok(n);
            }
            let Some(member) = self.member.take() else {
                break;
            };
            let mut rest = member.into_inner();
            // One byte suffices to know that nothing follows; a buffer's end between the two magic bytes is no loss,
            // since a member needs 18 bytes and the decoder says what is wrong with a stump.
            if rest.fill_buf()?.first() == Some(&0x1f) {
                self.member = Some(GzDecoder::new(rest));
            }
        }
        Ok(0)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::write::GzEncoder;

    use super::*;

    fn member(bytes: &[u8]) -> Vec<u8> {
        let mut e = GzEncoder::new(Vec::new(), flate2::Compression::fast());
        e.write_all(bytes).unwrap();
        e.finish().unwrap()
    }

    #[test]
    fn members_are_joined_and_padding_is_ignored() {
        let mut bytes = member(b"ab");
        bytes.extend(member(b""));
        bytes.extend(member(b"cd"));
        bytes.extend([0; 9]);
        let mut out = Vec::new();
        GzipMembers::new(bytes.as_slice())
            .read_to_end(&mut out)
            .unwrap();
        assert_eq!(out, b"abcd", "three members, then zeros");
    }

    #[test]
    fn the_bound_holds_for_zeros() {
        let zeros = vec![0; 1 << 20];
        let packed = member(&zeros);
        assert!(
            most_inflated_bytes(packed.len() as u64) >= zeros.len() as u64,
            "the most compressible stream stays below the bound"
        );
    }
}
