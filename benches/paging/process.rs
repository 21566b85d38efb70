//! Measurements in processes of their own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail, ensure};
use brickscope::bench::{drop_from_page_cache, peak_rss_bytes};
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
        peak_rss_bytes: peak_rss_bytes().context("the kernel tells no peak of memory")?,
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

/// Are two files of pixels equal to the bit? Tells the first difference.
pub(crate) fn difference(one: &Path, other: &Path) -> anyhow::Result<Option<u64>> {
    let read = |path: &Path| fs::read(path).with_context(|| format!("reading {}", path.display()));
    let (one, other) = (read(one)?, read(other)?);
    ensure!(one.len() == other.len(), "pictures of two sizes");
    let pixels = one.chunks_exact(16).zip(other.chunks_exact(16));
    let differing = pixels.filter(|(a, b)| a != b).count() as u64;
    Ok((differing > 0).then_some(differing))
}
