//! [`Packing`]: the ways in which the bytes of a chunk are compressed or guarded, and their undoing, bounded in memory.

use std::io::Read;

use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use crate::input::problem::Subject;
use crate::volume::SourceError;

/// Bytes of a Blosc header.
const BLOSC_HEADER_BYTES: usize = 16;

/// One step of compression, or a checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::input) enum Packing {
    Gzip,
    Zlib,
    Zstd,
    Blosc,
    /// CRC-32C of what stands before it, little-endian.
    Crc32c,
}

/// An upper bound of what `bytes` take when they are packed: no codec makes incompressible data much longer.
pub(in crate::input) fn most_packed_bytes(bytes: u64) -> u64 {
    bytes.saturating_add(bytes / 4).saturating_add(64 << 10)
}

impl Packing {
    /// The one that formats call `name`.
    pub(in crate::input) fn of(name: &str) -> Option<Self> {
        Some(match name {
            "gzip" => Self::Gzip,
            "zlib" | "numcodecs.zlib" => Self::Zlib,
            "zstd" | "numcodecs.zstd" => Self::Zstd,
            "blosc" | "numcodecs.blosc" => Self::Blosc,
            "crc32c" => Self::Crc32c,
            _ => return None,
        })
    }

    /// Those that are supported, for messages.
    pub(in crate::input) const SUPPORTED: &'static str =
        "supported are blosc, gzip, zlib, zstd and crc32c; write the array anew with one of these";

    const fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Zstd => "zstd",
            Self::Blosc => "Blosc",
            Self::Crc32c => "CRC-32C",
        }
    }

    /// What `packed` stands for, or what is wrong with it. More than `most_bytes` bytes are refused.
    fn undo(self, mut packed: Vec<u8>, most_bytes: usize) -> Result<Vec<u8>, String> {
        match self {
            Self::Gzip => inflated(MultiGzDecoder::new(packed.as_slice()), most_bytes),
            Self::Zlib => inflated(ZlibDecoder::new(packed.as_slice()), most_bytes),
            Self::Zstd => {
                // The one call decodes any number of frames, and never beyond the bound.
                zstd::bulk::decompress(&packed, most_bytes).map_err(|e| e.to_string())
            }
            Self::Blosc => unblosc(&packed, most_bytes),
            Self::Crc32c => {
                let Some((rest, sum)) = packed.split_last_chunk() else {
                    return Err("fewer bytes than the checksum has".to_owned());
                };
                let (wanted, found) = (u32::from_le_bytes(*sum), crc32c::crc32c(rest));
                if wanted != found {
                    return Err(format!("checksum {found:08x} where {wanted:08x} is stored"));
                }
                packed.truncate(packed.len() - 4);
                Ok(packed)
            }
        }
    }
}

/// Undoes `packings`, given in the order in which they were done, and checks that `bytes` bytes come out.
///
/// # Errors
/// Something else comes out; the error names `subject` and `place`.
pub(in crate::input) fn unpack(
    subject: &Subject<'_>,
    place: &str,
    packings: &[Packing],
    packed: Vec<u8>,
    bytes: usize,
) -> Result<Vec<u8>, SourceError> {
    let mut unpacked = packed;
    for (left, packing) in packings.iter().enumerate().rev() {
        // Between two steps the bytes are packed still, so they may be somewhat more than in the end.
        let most = if left == 0 {
            bytes
        } else {
            most_packed_bytes(bytes as u64) as usize
        };
        unpacked = packing.undo(unpacked, most).map_err(|wrong| {
            subject.malformed(
                place,
                format!("{} data that stand for {bytes} bytes", packing.name()),
                wrong,
            )
        })?;
    }
    if unpacked.len() == bytes {
        return Ok(unpacked);
    }
    let found = format!("{} bytes", unpacked.len());
    Err(subject.malformed(place, format!("{bytes} bytes of voxels"), found))
}

/// All that `stream` holds, which includes its checksum's check; no more than `most_bytes`.
fn inflated(stream: impl Read, most_bytes: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let most = (most_bytes as u64).saturating_add(1);
    stream
        .take(most)
        .read_to_end(&mut out)
        .map_err(|e| e.to_string())?;
    if out.len() > most_bytes {
        return Err(format!("more than {most_bytes} bytes"));
    }
    Ok(out)
}

fn unblosc(packed: &[u8], most_bytes: usize) -> Result<Vec<u8>, String> {
    if packed.len() < BLOSC_HEADER_BYTES {
        return Err(format!(
            "{} bytes, shorter than a Blosc header",
            packed.len()
        ));
    }
    let (bytes, packed_bytes, _) = blusc::blosc2_cbuffer_sizes(packed);
    if bytes > most_bytes || packed_bytes > packed.len() {
        return Err(format!(
            "a header of {bytes} bytes packed in {packed_bytes}, in a buffer of {}",
            packed.len()
        ));
    }
    let mut out = vec![0; bytes];
    let done = blusc::blosc2_decompress(packed, &mut out);
    if usize::try_from(done) == Ok(bytes) {
        Ok(out)
    } else {
        Err("damaged Blosc blocks".to_owned())
    }
}
