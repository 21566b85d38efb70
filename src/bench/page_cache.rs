//! The kernel's page cache.

use std::path::Path;

use super::error::BenchError;

/// Drops `path` from the page cache; what a process has mapped and touched stays ([`super::storage_bytes_read`] tells). Only
/// on Linux; elsewhere nothing happens.
///
/// # Errors
/// The file can't be opened or synced.
pub fn drop_from_page_cache(path: &Path) -> Result<(), BenchError> {
    #[cfg(target_os = "linux")]
    {
        let failed = || BenchError::io(path, "drop it from the page cache");
        let file = std::fs::File::open(path).map_err(failed())?;
        // Dirty pages are not dropped.
        file.sync_all().map_err(failed())?;
        rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed)
            .map_err(|errno| failed()(errno.into()))?;
    }
    #[cfg(not(target_os = "linux"))]
    let _ = path;
    Ok(())
}
