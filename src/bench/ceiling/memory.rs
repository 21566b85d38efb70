//! Copying memory.

use std::hint::black_box;

use super::LEAST_MS;
use crate::clock::Stopwatch;

/// Bytes that are copied at once: larger than caches.
const BUFFER: usize = 64 << 20;

/// GB/s of bytes copied on one core, from memory to memory.
pub fn memcpy_gb_per_s() -> f64 {
    let from = vec![1u8; BUFFER];
    let mut to = vec![0u8; BUFFER];
    // The pages come with the first copy.
    to.copy_from_slice(&from);
    let watch = Stopwatch::start();
    let mut copied = 0.0;
    loop {
        black_box(&mut to[..]).copy_from_slice(black_box(&from));
        copied += BUFFER as f64;
        let wall_ms = watch.elapsed().wall_ms;
        if wall_ms >= LEAST_MS {
            return copied / 1e6 / wall_ms;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_faster_than_a_disk_and_slower_than_light() {
        let rate = memcpy_gb_per_s();
        assert!((0.1..10_000.0).contains(&rate), "{rate} GB/s");
    }
}
