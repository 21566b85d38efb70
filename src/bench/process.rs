//! What the kernel says of this process. On systems other than Linux it says nothing.

/// Most resident memory that the process ever had, anonymous and mapped pages together, bytes.
pub fn peak_rss_bytes() -> Option<u64> {
    // Not getrusage: its figure is inherited from whoever started the process.
    number_of("/proc/self/status", "VmHWM").map(|kib| kib << 10)
}

/// Bytes that the process made the kernel read from storage; what was in the page cache doesn't count.
pub fn storage_bytes_read() -> Option<u64> {
    number_of("/proc/self/io", "read_bytes")
}

/// The number behind `field:` in a file of lines.
fn number_of(path: &str, field: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    text.lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(name, _)| *name == field)
        .and_then(|(_, rest)| rest.split_whitespace().next()?.parse().ok())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_peak_follows_what_is_touched() {
        let before = peak_rss_bytes().expect("Linux tells");
        let touched = vec![1u8; 64 << 20];
        let after = peak_rss_bytes().expect("Linux tells");
        assert!(
            std::hint::black_box(&touched).len() as u64 / 2 <= after,
            "{after}"
        );
        assert!(after >= before, "a peak never falls: {before} {after}");
        assert!(storage_bytes_read().is_some(), "Linux tells");
    }
}
