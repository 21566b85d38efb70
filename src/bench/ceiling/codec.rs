//! zstd alone, on the plain bytes of a store's own records: block ranges and shuffled voxels.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use super::LEAST_MS;
use crate::bench::error::BenchError;
use crate::clock::{Elapsed, Stopwatch};
use crate::geom::Lod;
use crate::store::codec::{max_record_len, plain_len};
use crate::store::{ByteRange, Store};

/// Bricks that are measured, spread evenly over the level.
const SAMPLED: usize = 256;
/// The level of compression that stores are written with.
const ZSTD_LEVEL: i32 = 1;

/// What one core does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodecRate {
    /// MB of plain bytes a second, compressed at level 1.
    pub encode_mb_per_s: f64,
    /// MB of plain bytes a second, decompressed.
    pub decode_mb_per_s: f64,
    /// Bytes of a record before compression.
    pub plain_bytes: usize,
    /// Bytes of a record in the store, the mean.
    pub record_bytes: usize,
}

/// Measures the codec on level 0 of `store`, on this thread, by its CPU time where there is such a clock. `None` for a store
/// without records.
///
/// # Errors
/// The store can't be read, or a record is damaged.
pub fn codec_rate(store: &Store) -> Result<Option<CodecRate>, BenchError> {
    let level = Lod(0);
    store.check_level(level)?;
    let records: Vec<ByteRange> = store
        .bricks(level)
        .filter_map(|id| store.entry(id).record)
        .collect();
    if records.is_empty() {
        return Ok(None);
    }
    let stride = records.len().div_ceil(SAMPLED);
    let sampled: Vec<ByteRange> = records.into_iter().step_by(stride).collect();
    let failed = BenchError::io(store.path(), "read and decode a record");
    measure(store, &sampled).map(Some).map_err(failed)
}

fn measure(store: &Store, sampled: &[ByteRange]) -> io::Result<CodecRate> {
    let mut file = File::open(store.path())?;
    let mut records = Vec::with_capacity(sampled.len());
    for range in sampled {
        let mut record = vec![0; range.len as usize];
        file.seek(SeekFrom::Start(range.offset))?;
        file.read_exact(&mut record)?;
        records.push(record);
    }
    let plain_bytes = plain_len(store.stored_type());
    let mut decompressor = zstd::bulk::Decompressor::new()?;
    let mut plains = Vec::with_capacity(records.len());
    for record in &records {
        plains.push(decompressor.decompress(record, plain_bytes)?);
    }
    // A plain record fits: zstd's bound is above it.
    let mut out = vec![0; max_record_len(store.stored_type())];
    let decode = passes(|| {
        for record in &records {
            decompressor.decompress_to_buffer(record, &mut out)?;
        }
        Ok(())
    })?;
    let mut compressor = zstd::bulk::Compressor::new(ZSTD_LEVEL)?;
    let encode = passes(|| {
        for plain in &plains {
            compressor.compress_to_buffer(plain, &mut out)?;
        }
        Ok(())
    })?;
    let megabytes = (plain_bytes * plains.len()) as f64 / 1e6;
    Ok(CodecRate {
        encode_mb_per_s: megabytes / encode,
        decode_mb_per_s: megabytes / decode,
        plain_bytes,
        record_bytes: records.iter().map(Vec::len).sum::<usize>() / records.len(),
    })
}

/// Seconds per call of `work`, of as many as take long enough to be measured.
fn passes(mut work: impl FnMut() -> io::Result<()>) -> io::Result<f64> {
    // Tables and pages come with the first.
    work()?;
    let watch = Stopwatch::start();
    let mut count = 0.0;
    loop {
        work()?;
        count += 1.0;
        let Elapsed { wall_ms, cpu_ms } = watch.elapsed();
        if wall_ms >= LEAST_MS {
            return Ok(cpu_ms.unwrap_or(wall_ms) / 1e3 / count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bricking::{BrickOptions, NoProgress, brick};
    use crate::input;

    #[test]
    fn the_rate_is_of_the_stores_own_records() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.bsk");
        let rate = |spec: &str| {
            let mut source = input::open(spec, &Default::default()).unwrap();
            let options = BrickOptions {
                existing: crate::outfile::Existing::Replace,
                ..BrickOptions::default()
            };
            brick(&mut *source, &path, &options, &NoProgress).unwrap();
            codec_rate(&Store::open(&path).unwrap()).unwrap()
        };
        let rate16 = rate("phantom:sponge:64,64,64:u16").expect("there are records");
        assert_eq!(rate16.plain_bytes, 1024 + 2 * 34 * 34 * 34);
        assert!(rate16.record_bytes > 0 && rate16.record_bytes < rate16.plain_bytes);
        assert!(rate16.encode_mb_per_s > 0.0 && rate16.decode_mb_per_s > 0.0);
        // All air: no brick has a record.
        assert_eq!(rate("phantom:vessels:2,2,2"), None);
    }
}
