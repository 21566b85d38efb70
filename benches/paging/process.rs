//! Measurements in processes of their own, and what the kernel says of a process.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::job::Job;

/// The word that says: a task follows.
pub(crate) const CHILD: &str = "--child";

/// A result, and what the process that made it took.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Measured<T> {
    pub(crate) result: T,
    /// Most resident memory ever: anonymous and mapped pages together.
    pub(crate) peak_rss_bytes: u64,
}

/// The environment of a child.
#[derive(Clone, Debug, Default)]
pub(crate) struct Conditions {
    /// Where Mesa keeps compiled shaders; `None`: where it always does.
    pub(crate) shader_cache: Option<PathBuf>,
    /// The store leaves the page cache first.
    pub(crate) drops_store: bool,
}

/// Runs `job` in a process of its own.
pub(crate) fn measure<T: DeserializeOwned>(
    job: &Job,
    conditions: &Conditions,
) -> anyhow::Result<Measured<T>> {
    if conditions.drops_store {
        drop_from_page_cache(&job.store)?;
    }
    let mut command = Command::new(std::env::current_exe().context("this program's own path")?);
    if let Some(folder) = &conditions.shader_cache {
        command.env("MESA_SHADER_CACHE_DIR", folder);
    }
    let job = Job {
        spawned_secs: unix_secs(),
        ..job.clone()
    };
    let output = command
        .args([CHILD, &serde_json::to_string(&job)?])
        .stderr(Stdio::inherit())
        .output()
        .context("starting a process")?;
    if !output.status.success() {
        bail!("the process of {:?} failed: {}", job.task, output.status);
    }
    serde_json::from_slice(&output.stdout).context("the result of a process")
}

/// The child's side of [`measure`].
pub(crate) fn run_child(job: &str) -> anyhow::Result<()> {
    let job: Job = serde_json::from_str(job).context("a task")?;
    let measured = Measured {
        result: job.run()?,
        peak_rss_bytes: status_bytes("VmHWM")?,
    };
    println!("{}", serde_json::to_string(&measured)?);
    Ok(())
}

/// Seconds since 1970.
pub(crate) fn unix_secs() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0.0, |d| d.as_secs_f64())
}

/// A field of `/proc/self/status` that is in kB.
fn status_bytes(field: &str) -> anyhow::Result<u64> {
    Ok(number_of("/proc/self/status", field)? << 10)
}

/// Bytes that this process made the kernel read from storage.
pub(crate) fn storage_bytes_read() -> anyhow::Result<u64> {
    number_of("/proc/self/io", "read_bytes")
}

/// The number behind `field:` in a file of lines.
fn number_of(path: &str, field: &str) -> anyhow::Result<u64> {
    let text = fs::read_to_string(path).with_context(|| format!("reading {path}"))?;
    text.lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(name, _)| *name == field)
        .and_then(|(_, rest)| rest.split_whitespace().next()?.parse().ok())
        .with_context(|| format!("{path} has no {field}"))
}

/// Drops `path` from the page cache; what another process has mapped stays (the bytes read from storage tell).
pub(crate) fn drop_from_page_cache(path: &Path) -> anyhow::Result<()> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    // Dirty pages are not dropped.
    file.sync_all()?;
    rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed)?;
    Ok(())
}

/// Are two files of pixels equal to the bit? Tells the first difference.
pub(crate) fn difference(one: &Path, other: &Path) -> anyhow::Result<Option<u64>> {
    let read = |path: &Path| fs::read(path).with_context(|| format!("reading {}", path.display()));
    let (one, other) = (read(one)?, read(other)?);
    ensure!(one.len() == other.len(), "pictures of two sizes");
    let pixels = one.chunks_exact(16).zip(other.chunks_exact(16));
    let differing = pixels.filter(|(a, b)| a != b).count() as u64;
    Ok((differing > 0).then_some(differing))
}
