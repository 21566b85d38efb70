//! `bench brick`: what making a store costs, and how near it comes to what the machine could do.
//!
//! Each run bricks a source into a temporary store, synced as `brick` does it, and removes it. The **ceiling** of a run, in MB
//! of source voxels per second, is the least of
//! - *read*: the rate of the disk × source bytes ÷ bytes that the run made the kernel read from storage (what lay in the page
//!   cache was not read; sources that are computed read nothing);
//! - *write*: the rate of the disk × source bytes ÷ bytes of the store;
//! - *encode*: the rate of zstd level 1 on one core, on the store's own records, × threads × source bytes ÷ plain bytes of
//!   all records (borders, levels and block ranges included, constant bricks not).
//!
//! On a machine that others use, too, wall time says little. There the **encode share** tells: the CPU time that zstd level 1
//! alone takes for the records ÷ the CPU time of the run.
//!
//! The **plain ceiling** is min(disk, zstd -1 encode × threads) without these conversions: as if each voxel were read, encoded
//! and written once.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::ceiling::{CodecRate, DiskRate, codec_rate, vol_name};
use super::error::BenchError;
use super::process::{peak_rss_bytes, storage_bytes_read};
use super::report::{NamedTime, Row};
use super::summary::{mib, rounded};
use super::table::figure;
use crate::bricking::{BrickOptions, BrickingReport, NoProgress, brick};
use crate::clock::{Elapsed, Stopwatch};
use crate::input;
use crate::outfile::{Existing, PartialFolder};
use crate::store::Store;

/// One run to measure.
#[derive(Clone, Debug)]
pub struct BrickJob {
    /// What to brick: a file that describes itself, or `phantom:NAME:X,Y,Z[:TYPE]`.
    pub input: String,
    /// zstd's level.
    pub zstd_level: i32,
    /// Threads that encode.
    pub threads: usize,
    /// Memory of the run, bytes.
    pub memory_bytes: u64,
}

/// What limits a run at most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BrickCeiling {
    /// The disk's rates, MB/s: of the file it is read from and of the folder of the store.
    pub disk_read_mb_per_s: Option<f64>,
    /// Synced.
    pub disk_write_mb_per_s: Option<f64>,
    /// zstd level 1 on the store's records, MB/s of plain bytes on one core.
    pub zstd_encode_mb_per_s: Option<f64>,
    /// The least of the three limits, in MB of source voxels per second.
    pub mb_per_s: Option<f64>,
    /// min(disk, zstd -1 encode × threads), MB/s.
    pub plain_mb_per_s: Option<f64>,
    /// CPU time that zstd level 1 takes for the plain bytes of all records, ms.
    pub zstd_encode_ms: Option<f64>,
}

/// What bricking a source costs. Fields are null where they can't be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BrickRow {
    /// The source's name, without folder and extension; a phantom's in full.
    pub source: String,
    /// Type of the source's voxels.
    pub source_type: String,
    /// Type of the stored voxels.
    pub stored_type: String,
    /// Voxels per axis.
    pub dims: [u64; 3],
    /// zstd's level.
    pub zstd: i32,
    /// Threads that encoded.
    pub threads: usize,
    /// Bytes of the source's voxels.
    pub bytes_in: u64,
    /// Bytes of the store.
    pub bytes_out: u64,
    /// Bytes that the run made the kernel read from storage; what lay in the page cache doesn't count.
    pub storage_bytes_read: Option<u64>,
    /// Wall time, syncing included, ms.
    pub wall_ms: f64,
    /// User and system time of the whole process, ms.
    pub cpu_ms: Option<f64>,
    /// MB of source voxels per second.
    pub mb_per_s: f64,
    /// MB of source voxels per second of CPU time.
    pub mb_per_core_s: Option<f64>,
    /// The machine's.
    pub ceiling: Option<BrickCeiling>,
    /// `mb_per_s` ÷ `ceiling.mb_per_s`.
    pub of_ceiling: Option<f64>,
    /// `mb_per_s` ÷ `ceiling.plain_mb_per_s`.
    pub of_plain_ceiling: Option<f64>,
    /// CPU time of zstd level 1 alone on all records ÷ `cpu_ms`: the rest is reading, converting, levels, ranges, writing.
    pub encode_share: Option<f64>,
    /// Most resident memory of the process so far, MiB.
    pub rss_peak_mib: Option<f64>,
    /// Of this program.
    pub version: String,
}

impl Row for BrickRow {
    const BENCH: &'static str = "brick";
    const COLUMNS: &'static [&'static str] = &[
        "source",
        "MB",
        "seconds",
        "CPU s",
        "MB/s",
        "MB/core-s",
        "ceiling MB/s",
        "÷ ceiling",
        "÷ plain ceiling",
        "zstd ÷ CPU",
        "from disk MB",
        "store MB",
        "peak MiB",
    ];

    fn name(&self) -> String {
        let Self {
            source,
            source_type,
            zstd,
            threads,
            ..
        } = self;
        format!("{source} {source_type} zstd {zstd} threads {threads}")
    }

    fn times(&self) -> Vec<NamedTime> {
        vec![("cpu_ms", self.cpu_ms), ("wall_ms", Some(self.wall_ms))]
    }

    fn cells(&self) -> Vec<String> {
        let megabytes = |bytes: u64| bytes as f64 / 1e6;
        vec![
            self.name(),
            figure(Some(megabytes(self.bytes_in)), 0),
            figure(Some(self.wall_ms / 1e3), 2),
            figure(self.cpu_ms.map(|ms| ms / 1e3), 2),
            figure(Some(self.mb_per_s), 0),
            figure(self.mb_per_core_s, 0),
            figure(self.ceiling.and_then(|c| c.mb_per_s), 0),
            figure(self.of_ceiling, 2),
            figure(self.of_plain_ceiling, 2),
            figure(self.encode_share, 2),
            figure(self.storage_bytes_read.map(megabytes), 0),
            figure(Some(megabytes(self.bytes_out)), 0),
            figure(self.rss_peak_mib, 0),
        ]
    }
}

impl BrickJob {
    /// Bricks the source into a temporary store in `folder`, and holds it against the machine's ceiling if that of the disk
    /// was measured.
    ///
    /// # Errors
    /// The source can't be read, or the store can't be written.
    pub fn measure(
        &self,
        folder: &Path,
        ceiling: Option<Option<DiskRate>>,
    ) -> Result<BrickRow, BenchError> {
        let name = format!("brickscope-bench-{}", std::process::id());
        // Goes when it is dropped, and when the process is interrupted.
        let scratch = PartialFolder::create(&folder.join(name), Existing::Refuse)?;
        let path = scratch.path().join("bench.bsk");
        let options = BrickOptions {
            zstd_level: self.zstd_level,
            threads: Some(self.threads),
            memory_bytes: self.memory_bytes,
            ..BrickOptions::default()
        };
        let storage_before = storage_bytes_read();
        let watch = Stopwatch::start();
        let mut source = input::open(&self.input, &Default::default())?;
        let report = brick(&mut *source, &path, &options, &NoProgress)?;
        let elapsed = watch.elapsed();
        let storage_bytes_read = storage_bytes_read()
            .zip(storage_before)
            .map(|(after, before)| after - before);
        let peak = peak_rss_bytes();
        let ceiling = match ceiling {
            Some(disk) => {
                let store = Store::open(&path)?;
                Some(limits(&store, &report, storage_bytes_read, disk)?)
            }
            None => None,
        };
        let desc = source.desc();
        let Elapsed { wall_ms, cpu_ms } = elapsed;
        let mb_per = |ms: f64| report.bytes_in as f64 / 1e3 / ms.max(1e-6);
        let mb_per_s = mb_per(wall_ms);
        let share = |limit: Option<f64>| limit.map(|limit| rounded(mb_per_s / limit));
        Ok(BrickRow {
            source: source_name(&self.input),
            source_type: desc.voxel_type.to_string(),
            stored_type: report.stored_type.to_string(),
            dims: desc.dims.to_array(),
            zstd: self.zstd_level,
            threads: report.workers,
            bytes_in: report.bytes_in,
            bytes_out: report.bytes_out,
            storage_bytes_read,
            wall_ms: rounded(wall_ms),
            cpu_ms: cpu_ms.map(rounded),
            mb_per_s: rounded(mb_per_s),
            mb_per_core_s: cpu_ms.map(|ms| rounded(mb_per(ms))),
            of_ceiling: share(ceiling.and_then(|c| c.mb_per_s)),
            of_plain_ceiling: share(ceiling.and_then(|c| c.plain_mb_per_s)),
            encode_share: ceiling
                .and_then(|c| c.zstd_encode_ms)
                .zip(cpu_ms.filter(|&ms| ms > 0.0))
                .map(|(zstd, all)| rounded(zstd / all)),
            ceiling,
            rss_peak_mib: peak.map(mib),
            version: env!("CARGO_PKG_VERSION").into(),
        })
    }
}

/// A phantom's whole name; a file's without folder and extension.
fn source_name(input: &str) -> String {
    if input.starts_with("phantom:") {
        return input.to_owned();
    }
    vol_name(Path::new(input))
}

/// See the module's description.
fn limits(
    store: &Store,
    report: &BrickingReport,
    storage_bytes_read: Option<u64>,
    disk: Option<DiskRate>,
) -> Result<BrickCeiling, BenchError> {
    let codec = codec_rate(store)?;
    let threads = report.workers as f64;
    // MB of source voxels per second, when `bytes` are handled at `rate`; no limit where nothing is handled.
    let limit =
        |rate: f64, bytes: f64| (bytes > 0.0).then(|| rate * report.bytes_in as f64 / bytes);
    let plain_bytes = |codec: CodecRate| report.kept_bricks as f64 * codec.plain_bytes as f64;
    let read = disk.zip(storage_bytes_read);
    let limits = [
        read.and_then(|(disk, bytes)| limit(disk.read_mb_per_s, bytes as f64)),
        disk.and_then(|disk| limit(disk.write_mb_per_s, report.bytes_out as f64)),
        codec.and_then(|codec| limit(codec.encode_mb_per_s * threads, plain_bytes(codec))),
    ];
    let plain = [
        disk.map(|disk| disk.read_mb_per_s.min(disk.write_mb_per_s)),
        codec.map(|codec| codec.encode_mb_per_s * threads),
    ];
    let least = |limits: &[Option<f64>]| {
        let least = limits
            .iter()
            .flatten()
            .copied()
            .fold(f64::INFINITY, f64::min);
        least.is_finite().then(|| rounded(least))
    };
    Ok(BrickCeiling {
        disk_read_mb_per_s: disk.map(|disk| rounded(disk.read_mb_per_s)),
        disk_write_mb_per_s: disk.map(|disk| rounded(disk.write_mb_per_s)),
        zstd_encode_mb_per_s: codec.map(|codec| rounded(codec.encode_mb_per_s)),
        mb_per_s: least(&limits),
        plain_mb_per_s: least(&plain),
        zstd_encode_ms: codec
            .map(|codec| rounded(plain_bytes(codec) / 1e3 / codec.encode_mb_per_s)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A job that takes no time worth mentioning.
    fn job(input: &str) -> BrickJob {
        BrickJob {
            input: input.into(),
            zstd_level: 1,
            threads: 1,
            memory_bytes: 128 << 20,
        }
    }

    #[test]
    fn a_run_leaves_nothing_and_counts_what_it_did() {
        let folder = tempfile::tempdir().unwrap();
        let row = job("phantom:sponge:64,64,64:u16")
            .measure(folder.path(), None)
            .unwrap();
        assert_eq!((row.bytes_in, row.threads), (2 * 64 * 64 * 64, 1));
        assert_eq!(
            row.name(),
            "phantom:sponge:64,64,64:u16 u16 zstd 1 threads 1"
        );
        assert!(
            row.bytes_out > 0 && row.wall_ms > 0.0 && row.mb_per_s > 0.0,
            "{row:?}"
        );
        assert_eq!((row.ceiling, row.of_ceiling), (None, None), "not asked for");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(
            job("phantom:none:1,1,1")
                .measure(folder.path(), None)
                .is_err()
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    /// The formulas of the module's description, with round numbers.
    #[test]
    fn the_ceiling_is_the_least_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.bsk");
        let mut source = input::open("phantom:sponge:64,64,64:u16", &Default::default()).unwrap();
        let report = brick(&mut *source, &path, &BrickOptions::default(), &NoProgress).unwrap();
        let store = Store::open(&path).unwrap();
        let disk = |read, write| {
            Some(DiskRate {
                read_mb_per_s: read,
                write_mb_per_s: write,
            })
        };
        let with = |disk, storage| limits(&store, &report, storage, disk).unwrap();
        // So slow a disk that the codec is no matter: half of the source came from it.
        let by_read = with(disk(1e-3, 1e3), Some(report.bytes_in / 2));
        assert_eq!(by_read.mb_per_s, Some(0.002), "{by_read:?}");
        assert_eq!(by_read.plain_mb_per_s, Some(0.001), "{by_read:?}");
        // Nothing was read from it: writing decides.
        let by_write = with(disk(1e-3, 1.0), Some(0));
        let expected = report.bytes_in as f64 / report.bytes_out as f64;
        assert!(
            (by_write.mb_per_s.unwrap() - expected).abs() < 1e-3,
            "{by_write:?}, {expected}"
        );
        // Without a disk the codec alone.
        let by_codec = with(None, None);
        let rate = by_codec.zstd_encode_mb_per_s.unwrap() * report.workers as f64;
        let plain = report.kept_bricks as f64 * (1024.0 + 2.0 * 34f64.powi(3));
        let expected = rate * report.bytes_in as f64 / plain;
        assert!(
            (by_codec.mb_per_s.unwrap() / expected - 1.0).abs() < 1e-3,
            "{by_codec:?}, {expected}"
        );
    }
}
