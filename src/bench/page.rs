//! `bench page`: how bricks come, on a graphics device under a budget of memory.
//!
//! Pictures are drawn by ticks, as a window does, each until it is exact: the first one with nothing resident and the store
//! out of the page cache (`cold first`); the same with the store in the page cache (`warm first`); then the rest of the turn
//! of `bench render`, each picture with what those before it have left in the atlas and in host memory (`warm turn`).
//! Pipelines are built before. A brick's latency is the time from its first request to the record of its copy into a slot;
//! bricks that were in host memory count, too.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::ceiling::StoreCeiling;
use super::error::BenchError;
use super::page_cache::drop_from_page_cache;
use super::process::storage_bytes_read;
use super::report::{NamedTime, Row};
use super::summary::{median, percentile, rounded};
use super::table::figure;
use super::turn::{Turn, converge};
use crate::camera::Camera;
use crate::clock::{Elapsed, Stopwatch};
use crate::engine::{Engine, TickBudget};
use crate::scene::{PictureSettings, PictureStats};

/// The phase that reuses what is resident.
const TURN: &str = "warm turn";

/// One configuration to measure.
#[derive(Clone, Debug)]
pub struct PageJob {
    /// What the volume is called in the report.
    pub vol: String,
    /// The picture; its camera is replaced by those of the turn.
    pub settings: PictureSettings,
    /// Pictures of the turn, at least 1.
    pub frames: u32,
}

/// What paging costs. Fields are null where they can't be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PageRow {
    /// The store's name, without folder and extension.
    pub vol: String,
    /// `cold first`, `warm first` or `warm turn`.
    pub phase: String,
    /// `dvr`, `iso`, `mip`.
    pub mode: String,
    /// `WIDTHxHEIGHT`, pixels.
    pub size: String,
    /// Distance of samples in units of the smallest spacing.
    pub step: f64,
    /// Pictures.
    pub frames: u32,
    /// Slots of the atlas.
    pub atlas_slots: Option<u64>,
    /// All memory on the device, bytes.
    pub gpu_bytes: Option<u64>,
    /// Wall time of all pictures, each until it is exact, ms.
    pub wall_ms: f64,
    /// User and system time of the whole process, ms.
    pub cpu_ms: Option<f64>,
    /// Waits that ended.
    pub waits: usize,
    /// From the first request of a brick to its slot, ms: the median.
    pub latency_median_ms: Option<f64>,
    /// The 99th percentile.
    pub latency_p99_ms: Option<f64>,
    /// Bricks that rays asked for.
    pub bricks_requested: u64,
    /// Bricks read from the store and decoded.
    pub bricks_read: u64,
    /// Bricks copied into slots.
    pub bricks_uploaded: u64,
    /// Bricks that lost their slot.
    pub bricks_evicted: u64,
    /// Bricks that were sampled, summed over the pictures.
    pub bricks_touched: u64,
    /// Bytes of records read.
    pub bytes_read: u64,
    /// Bytes that the kernel read from storage meanwhile.
    pub storage_bytes_read: Option<u64>,
    /// Bricks copied into slots per second of wall time.
    pub bricks_per_s: f64,
    /// Decoded MB per second of wall time.
    pub mb_per_s: f64,
    /// 1 − uploaded ÷ touched, of the turn: the share of sampled bricks that were in their slots already. Null for a first
    /// picture, of which none were.
    pub hit_rate: Option<f64>,
    /// What bounds reading the store on this machine.
    pub ceiling: Option<StoreCeiling>,
    /// The graphics adapter's name.
    pub adapter: Option<String>,
    /// Of this program.
    pub version: String,
}

impl Row for PageRow {
    const BENCH: &'static str = "page";
    const COLUMNS: &'static [&'static str] = &[
        "configuration",
        "frames",
        "slots",
        "wall ms",
        "CPU ms",
        "latency ms",
        "p99",
        "requested",
        "read",
        "uploaded",
        "touched",
        "evicted",
        "bricks/s",
        "MB/s",
        "hit rate",
    ];

    fn name(&self) -> String {
        let Self {
            vol,
            phase,
            mode,
            size,
            step,
            ..
        } = self;
        format!("{vol} {phase} {mode} {size} step {step}")
    }

    fn times(&self) -> Vec<NamedTime> {
        vec![
            ("latency_median_ms", self.latency_median_ms),
            ("latency_p99_ms", self.latency_p99_ms),
            ("cpu_ms", self.cpu_ms),
            ("wall_ms", Some(self.wall_ms)),
        ]
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.name(),
            self.frames.to_string(),
            self.atlas_slots
                .map_or("–".into(), |slots| slots.to_string()),
            figure(Some(self.wall_ms), 0),
            figure(self.cpu_ms, 0),
            figure(self.latency_median_ms, 2),
            figure(self.latency_p99_ms, 2),
            self.bricks_requested.to_string(),
            self.bricks_read.to_string(),
            self.bricks_uploaded.to_string(),
            self.bricks_touched.to_string(),
            self.bricks_evicted.to_string(),
            figure(Some(self.bricks_per_s), 0),
            figure(Some(self.mb_per_s), 0),
            figure(self.hit_rate, 3),
        ]
    }
}

impl PageJob {
    /// Measures the three phases on `engine`, which must keep waits ([`crate::engine::EngineOptions::keep_waits`]) and
    /// draw the store at `path`.
    ///
    /// # Errors
    /// The engine draws on the CPU, which has no paging; the settings make no picture, a brick can't be read, or the device
    /// fails or is too small.
    pub fn measure(&self, engine: &mut Engine, path: &Path) -> Result<Vec<PageRow>, BenchError> {
        let turn = Turn::new(&self.settings, engine.meta(), self.frames);
        let (first, away) = (turn.frame(0), looking_away(turn.frame(0)));
        let budget = TickBudget::default();
        // The same pipelines and no brick: pages of the store that this process has touched would stay in the page cache.
        let warm_up = converge(engine, &away, &self.vol, &budget)?;
        if warm_up.atlas_slots.is_none() {
            return Err(BenchError::NoPaging {
                device: engine.device_name(),
            });
        }
        engine.forget_bricks();
        drop_from_page_cache(path)?;
        let first = std::slice::from_ref(&first);
        let mut rows = vec![self.phase("cold first", engine, first)?];
        // What the first picture reads is in the page cache now. It is counted anew when another was set meanwhile.
        converge(engine, &away, &self.vol, &budget)?;
        engine.forget_bricks();
        rows.push(self.phase("warm first", engine, first)?);
        let rest: Vec<PictureSettings> = (1..self.frames).map(|k| turn.frame(k)).collect();
        if !rest.is_empty() {
            rows.push(self.phase(TURN, engine, &rest)?);
        }
        Ok(rows)
    }

    /// Draws `pictures` one after the other, each until it is exact.
    fn phase(
        &self,
        name: &str,
        engine: &mut Engine,
        pictures: &[PictureSettings],
    ) -> Result<PageRow, BenchError> {
        engine.take_waits_ms();
        let storage_before = storage_bytes_read();
        let mut stats = Vec::with_capacity(pictures.len());
        let watch = Stopwatch::start();
        for picture in pictures {
            stats.push(converge(
                engine,
                picture,
                &self.vol,
                &TickBudget::default(),
            )?);
        }
        let Elapsed { wall_ms, cpu_ms } = watch.elapsed();
        let waits = engine.take_waits_ms();
        let sum = |count: fn(&PictureStats) -> Option<u64>| -> u64 {
            stats.iter().filter_map(count).sum()
        };
        let (uploaded, touched) = (sum(|s| s.bricks_uploaded), sum(|s| s.bricks_touched));
        let per_s = |count: f64| rounded(count / (wall_ms / 1e3).max(1e-9));
        let last = stats.last();
        let [width, height] = self.settings.size;
        Ok(PageRow {
            vol: self.vol.clone(),
            phase: name.into(),
            mode: self.settings.mode.name().into(),
            size: format!("{width}x{height}"),
            step: self.settings.step,
            frames: pictures.len() as u32,
            atlas_slots: last.and_then(|s| s.atlas_slots),
            gpu_bytes: last.and_then(|s| s.gpu_bytes),
            wall_ms: rounded(wall_ms),
            cpu_ms: cpu_ms.map(rounded),
            waits: waits.len(),
            latency_median_ms: median(&waits).map(rounded),
            latency_p99_ms: percentile(&waits, 0.99).map(rounded),
            bricks_requested: sum(|s| s.bricks_requested),
            bricks_read: sum(|s| s.bricks_read),
            bricks_uploaded: uploaded,
            bricks_evicted: sum(|s| s.bricks_evicted),
            bricks_touched: touched,
            bytes_read: sum(|s| s.bytes_read),
            storage_bytes_read: storage_bytes_read()
                .zip(storage_before)
                .map(|(after, before)| after - before),
            bricks_per_s: per_s(uploaded as f64),
            mb_per_s: per_s(sum(|s| s.bytes_decompressed) as f64 / 1e6),
            hit_rate: (name == TURN && touched > 0)
                .then(|| rounded(1.0 - uploaded as f64 / touched as f64)),
            ceiling: None,
            adapter: last.and_then(|s| s.adapter.clone()),
            version: env!("CARGO_PKG_VERSION").into(),
        })
    }
}

/// The same picture from the same place, turned away from the volume.
fn looking_away(picture: PictureSettings) -> PictureSettings {
    let camera = picture.camera;
    PictureSettings {
        camera: Camera {
            target: camera.eye * 2.0 - camera.target,
            ..camera
        },
        ..picture
    }
}
