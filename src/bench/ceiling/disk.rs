//! The disk past the page cache (O_DIRECT): on Linux only, and where the file system allows it.

use std::path::Path;

use crate::bench::error::BenchError;

/// Reading and writing from front to back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskRate {
    /// MB/s, synced.
    pub write_mb_per_s: f64,
    /// MB/s.
    pub read_mb_per_s: f64,
}

/// Reads at random places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomReads {
    /// Reads a second.
    pub per_s: f64,
    /// MB/s.
    pub mb_per_s: f64,
}

/// Writes a file of 256 MiB into `folder`, syncs it, reads it back, and removes it. `None` where the page cache can't be
/// passed by.
///
/// # Errors
/// The file can't be written or read.
pub fn disk_rate(folder: &Path) -> Result<Option<DiskRate>, BenchError> {
    direct::disk_rate(folder).map_err(BenchError::io(folder, "measure the disk"))
}

/// Reads a file from front to back, at most 1 GiB of it, several requests at a time: MB/s. `None` where the page cache
/// can't be passed by, and for files too short to tell.
///
/// # Errors
/// The file can't be read.
pub fn sequential_read(file: &Path) -> Result<Option<f64>, BenchError> {
    direct::sequential_read(file).map_err(BenchError::io(file, "measure the disk"))
}

/// Reads of `record_bytes` at random places of a file, several at a time. `None` as for [`sequential_read`].
///
/// # Errors
/// The file can't be read.
pub fn random_reads(file: &Path, record_bytes: usize) -> Result<Option<RandomReads>, BenchError> {
    direct::random_reads(file, record_bytes).map_err(BenchError::io(file, "measure the disk"))
}

#[cfg(target_os = "linux")]
mod direct {
    use std::fs::{File, OpenOptions};
    use std::io;
    use std::os::unix::fs::{FileExt, OpenOptionsExt};
    use std::path::Path;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::{Duration, Instant};

    use memmap2::MmapMut;
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};

    use super::{DiskRate, RandomReads};
    use crate::outfile::{Existing, OutFile};

    /// Bytes of a sequential request.
    const CHUNK: u64 = 4 << 20;
    /// Bytes of the file that is written.
    const WRITTEN: u64 = 256 << 20;
    /// Most bytes that are read sequentially.
    const MOST_READ: u64 = 1 << 30;
    /// Shorter files tell nothing.
    const LEAST_FILE: u64 = 8 << 20;
    /// What places and lengths must be multiples of.
    const ALIGNMENT: u64 = 4096;
    /// Requests at a time.
    const DEPTH: u64 = 8;
    /// Time for random reads.
    const RANDOM_TIME: Duration = Duration::from_millis(500);

    /// Opens past the page cache; `None` where the file system refuses.
    fn open(path: &Path) -> io::Result<Option<File>> {
        let flags = OFlags::DIRECT.bits() as i32;
        match OpenOptions::new().read(true).custom_flags(flags).open(path) {
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => Ok(None),
            other => other.map(Some),
        }
    }

    pub(super) fn disk_rate(folder: &Path) -> io::Result<Option<DiskRate>> {
        let name = folder.join("brickscope-bench-disk");
        let mut out = OutFile::create(&name, Existing::Replace).map_err(io::Error::other)?;
        let file = out.file();
        let flags = fcntl_getfl(&*file)?;
        match fcntl_setfl(&*file, flags | OFlags::DIRECT) {
            Err(error) if error == rustix::io::Errno::INVAL => return Ok(None),
            other => other?,
        }
        let mut chunk = MmapMut::map_anon(CHUNK as usize)?;
        fill(&mut chunk);
        let chunk = &chunk[..];
        let begin = Instant::now();
        in_parallel(
            WRITTEN / CHUNK,
            || (),
            |(), number| file.write_all_at(chunk, number * CHUNK),
        )?;
        file.sync_data()?;
        let write_mb_per_s = WRITTEN as f64 / 1e6 / begin.elapsed().as_secs_f64();
        let read_mb_per_s = read_all(file, WRITTEN)?;
        // Dropped unfinished, it is gone.
        Ok(Some(DiskRate {
            write_mb_per_s,
            read_mb_per_s,
        }))
    }

    pub(super) fn sequential_read(path: &Path) -> io::Result<Option<f64>> {
        let Some(file) = open(path)? else {
            return Ok(None);
        };
        let bytes = file.metadata()?.len().min(MOST_READ);
        if bytes < LEAST_FILE {
            return Ok(None);
        }
        read_all(&file, bytes).map(Some)
    }

    /// MB/s of the first `bytes` of the file, whole chunks.
    fn read_all(file: &File, bytes: u64) -> io::Result<f64> {
        let chunks = bytes / CHUNK;
        let begin = Instant::now();
        in_parallel(
            chunks,
            || MmapMut::map_anon(CHUNK as usize),
            |buffer, number| {
                let buffer = buffer.as_mut().map_err(|e| io::Error::from(e.kind()))?;
                file.read_exact_at(buffer, number * CHUNK)
            },
        )?;
        Ok((chunks * CHUNK) as f64 / 1e6 / begin.elapsed().as_secs_f64())
    }

    pub(super) fn random_reads(
        path: &Path,
        record_bytes: usize,
    ) -> io::Result<Option<RandomReads>> {
        let Some(file) = open(path)? else {
            return Ok(None);
        };
        let bytes = (record_bytes as u64).next_multiple_of(ALIGNMENT);
        let places = (file.metadata()?.len() / ALIGNMENT).saturating_sub(bytes / ALIGNMENT);
        if places * ALIGNMENT < LEAST_FILE {
            return Ok(None);
        }
        let done = AtomicU64::new(0);
        let begin = Instant::now();
        in_parallel(
            DEPTH,
            || MmapMut::map_anon(bytes as usize),
            |buffer, thread| {
                let buffer = buffer.as_mut().map_err(|e| io::Error::from(e.kind()))?;
                let mut state = 0x9e37_79b9_7f4a_7c15 ^ (thread + 1);
                while begin.elapsed() < RANDOM_TIME {
                    let place = xorshift(&mut state) % places;
                    file.read_exact_at(buffer, place * ALIGNMENT)?;
                    done.fetch_add(1, Ordering::Relaxed);
                }
                Ok(())
            },
        )?;
        let per_s = done.into_inner() as f64 / begin.elapsed().as_secs_f64();
        Ok(Some(RandomReads {
            per_s,
            mb_per_s: per_s * bytes as f64 / 1e6,
        }))
    }

    /// Does pieces 0 … `count` − 1 on as many threads as there are requests at a time, each with a buffer of its own. They
    /// wait for the disk, so that there may be more of them than cores.
    fn in_parallel<B>(
        count: u64,
        buffer: impl Fn() -> B + Sync,
        piece: impl Fn(&mut B, u64) -> io::Result<()> + Sync,
    ) -> io::Result<()> {
        let next = AtomicU64::new(0);
        let work = || -> io::Result<()> {
            let mut buffer = buffer();
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= count {
                    return Ok(());
                }
                piece(&mut buffer, number)?;
            }
        };
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..DEPTH.min(count)).map(|_| scope.spawn(work)).collect();
            threads.into_iter().try_for_each(|thread| {
                thread
                    .join()
                    .unwrap_or_else(|_| Err(io::Error::other("a thread panicked")))
            })
        })
    }

    /// Bytes that don't compress: some disks would be faster with zeros.
    fn fill(bytes: &mut [u8]) {
        let mut state = 0x9e37_79b9_7f4a_7c15;
        for word in bytes.chunks_exact_mut(8) {
            word.copy_from_slice(&xorshift(&mut state).to_le_bytes());
        }
    }

    fn xorshift(state: &mut u64) -> u64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state
    }
}

#[cfg(not(target_os = "linux"))]
mod direct {
    use std::io;
    use std::path::Path;

    use super::{DiskRate, RandomReads};

    pub(super) fn disk_rate(_folder: &Path) -> io::Result<Option<DiskRate>> {
        Ok(None)
    }

    pub(super) fn sequential_read(_path: &Path) -> io::Result<Option<f64>> {
        Ok(None)
    }

    pub(super) fn random_reads(
        _path: &Path,
        _record_bytes: usize,
    ) -> io::Result<Option<RandomReads>> {
        Ok(None)
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_file_is_gone_afterwards_and_short_files_tell_nothing() {
        let folder = tempfile::tempdir().unwrap();
        if let Some(rate) = disk_rate(folder.path()).unwrap() {
            assert!(
                rate.write_mb_per_s > 0.0 && rate.read_mb_per_s > 0.0,
                "{rate:?}"
            );
        }
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 0, "nothing is left behind");

        let short = folder.path().join("short");
        std::fs::write(&short, [0; 8192]).unwrap();
        assert_eq!(sequential_read(&short).unwrap(), None);
        assert_eq!(random_reads(&short, 4096).unwrap(), None);
        assert!(sequential_read(&folder.path().join("none")).is_err());
    }

    #[test]
    fn a_long_file_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long");
        std::fs::write(&path, vec![7; 9 << 20]).unwrap();
        let rates = (
            sequential_read(&path).unwrap(),
            random_reads(&path, 5000).unwrap(),
        );
        // Some file systems refuse both.
        match rates {
            (Some(rate), Some(random)) => {
                assert!(rate > 0.0, "{rate}");
                // 5000 bytes are read as two pages.
                let bytes = random.mb_per_s * 1e6 / random.per_s;
                assert!((bytes - 8192.0).abs() < 1.0, "{random:?}");
            }
            other => assert_eq!(other, (None, None)),
        }
    }
}
