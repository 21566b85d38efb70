//! What the machine could do at most, measured in the same run as what is held against it: the codec on one core, the
//! disk past the page cache, memory.

mod codec;
mod disk;
mod memory;

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use codec::{CodecRate, codec_rate};
pub use disk::{DiskRate, RandomReads, disk_rate, random_reads, sequential_read};
pub use memory::memcpy_gb_per_s;

use super::error::BenchError;
use super::summary::rounded;
use super::table::figure;
use crate::store::Store;

/// Time for which a rate is measured, at least, ms.
const LEAST_MS: f64 = 200.0;

/// What bounds everything that reads a store. `None`: not measured on this system or on so small a store.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoreCeiling {
    /// zstd level 1 on the store's own bricks, voxels shuffled as stored: MB/s of plain bytes, one core.
    pub zstd_encode_mb_per_s: Option<f64>,
    /// Its decoding: MB/s of plain bytes, one core.
    pub zstd_decode_mb_per_s: Option<f64>,
    /// The store's file from front to back, past the page cache, MB/s.
    pub disk_read_mb_per_s: Option<f64>,
    /// Reads of a record's size at random places of the file, past the page cache, per second.
    pub disk_random_reads_per_s: Option<f64>,
    /// The same in MB/s.
    pub disk_random_mb_per_s: Option<f64>,
    /// Copying memory on one core, GB/s of bytes copied.
    pub memcpy_gb_per_s: f64,
}

impl StoreCeiling {
    /// Measures all of it; takes a second or two.
    ///
    /// # Errors
    /// The store can't be read.
    pub fn measure(store: &Store) -> Result<Self, BenchError> {
        let codec = codec_rate(store)?;
        let random = match codec {
            Some(codec) => random_reads(store.path(), codec.record_bytes)?,
            None => None,
        };
        Ok(Self {
            zstd_encode_mb_per_s: codec.map(|c| rounded(c.encode_mb_per_s)),
            zstd_decode_mb_per_s: codec.map(|c| rounded(c.decode_mb_per_s)),
            disk_read_mb_per_s: sequential_read(store.path())?.map(rounded),
            disk_random_reads_per_s: random.map(|r| rounded(r.per_s)),
            disk_random_mb_per_s: random.map(|r| rounded(r.mb_per_s)),
            memcpy_gb_per_s: rounded(memcpy_gb_per_s()),
        })
    }

    /// In words, for people.
    pub fn remark(&self, vol: &str) -> String {
        format!(
            "{vol}, the machine's ceiling: zstd -1 encode {} and decode {} MB/s per core; disk {} MB/s sequential, {} \
             MB/s in random records ({} a second); memcpy {} GB/s",
            figure(self.zstd_encode_mb_per_s, 0),
            figure(self.zstd_decode_mb_per_s, 0),
            figure(self.disk_read_mb_per_s, 0),
            figure(self.disk_random_mb_per_s, 0),
            figure(self.disk_random_reads_per_s, 0),
            figure(Some(self.memcpy_gb_per_s), 1),
        )
    }
}

/// A volume's name in reports: the file's, without folder and extension.
pub fn vol_name(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
