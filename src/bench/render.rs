//! `bench render`: what a frame costs, over a full turn about the volume (cli.md).
//!
//! The turn: perspective 30°, the eye at [`turn_distance_mm`] from the centre, up +y, azimuth about +y in equal steps from
//! +z on. A frame is one call of [`Engine::render`], from settings to a finished picture in host memory, each sample
//! exact. What the turn reads of the store beyond the warm-up is part of it, and is counted.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::clock::{Stopwatch, ms, since_process_start};
use super::error::BenchError;
use super::process::peak_rss_bytes;
use super::summary::{mean, median, mib, percentile, rounded};
use crate::camera::Camera;
use crate::engine::{Engine, TickBudget, TickEvent};
use crate::scene::{PictureSettings, PictureStats, volume_bounds};
use crate::store::StoreMeta;

/// What is drawn before the clock starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WarmUp {
    /// The first frame: pipelines are built, and what it needs is resident.
    Frame,
    /// The whole turn: what any frame needs is resident, if the memory holds it.
    Turn,
}

/// One configuration to measure.
#[derive(Clone, Debug)]
pub struct RenderJob {
    /// What the volume is called in the report.
    pub vol: String,
    /// The picture; its camera is replaced by those of the turn.
    pub settings: PictureSettings,
    /// Frames of the full turn, at least 1.
    pub frames: u32,
    /// What is drawn before the clock starts.
    pub warm_up: WarmUp,
    /// Time from the start of the process to the first pictures? Means something for the first picture only.
    pub is_first: bool,
    /// Before anything else, draw by ticks until the picture is whole for the first time.
    pub whole: bool,
}

/// What one configuration costs. The fields up to `gpu_ms` are the contract of cli.md; all are `None` (null) where they
/// can't be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderRow {
    /// The store's name, without folder and extension.
    pub vol: String,
    /// `gpu` or `cpu`.
    pub device: String,
    /// `dvr`, `iso`, `mip`.
    pub mode: String,
    /// `WIDTHxHEIGHT`, pixels.
    pub size: String,
    /// Distance of samples in units of the smallest spacing.
    pub step: f64,
    /// Frames that were timed.
    pub frames: u32,
    /// Wall time per frame, ms: the median.
    pub median_ms: f64,
    /// The least.
    pub min_ms: f64,
    /// The 90th percentile.
    pub p90_ms: f64,
    /// User and system time of the whole process over the timed frames ÷ their number, ms.
    pub cpu_ms: Option<f64>,
    /// From the start of the process to the first converged frame, ms; of the first configuration only. With
    /// `first_whole_ms` it includes what came before that.
    pub first_ms: Option<f64>,
    /// Most resident memory of the process so far, MiB.
    pub rss_peak_mib: Option<f64>,
    /// Samples per frame (mean).
    pub samples: u64,
    /// Samples per frame that changed the picture (mean).
    pub samples_contributing: Option<u64>,
    /// Sum of the passes by the device's timestamps, ms: the median over the frames.
    pub gpu_ms: Option<f64>,
    /// Samples per frame that skipping saved (mean).
    pub samples_skipped: u64,
    /// `cpu_ms` ÷ `samples`, ns; without a CPU clock `median_ms` ÷ `samples`.
    pub ns_per_sample: Option<f64>,
    /// Bricks per frame that the timed frames read from the store (mean): 0 when everything was resident.
    pub bricks_read: Option<f64>,
    /// Each pass by the device's timestamps, ms: the median over the frames.
    pub passes_ms: Option<BTreeMap<String, f64>>,
    /// From the start of the process to the first whole picture (every sample from a level whose voxel is at most four
    /// pixels), ms.
    pub first_whole_ms: Option<f64>,
    /// Most resident memory of the process until then, MiB.
    pub rss_whole_mib: Option<f64>,
    /// The graphics adapter's name; null on the CPU.
    pub adapter: Option<String>,
    /// Of this program.
    pub version: String,
}

impl RenderJob {
    /// Measures the configuration on `engine`.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails or is too small.
    pub fn measure(&self, engine: &mut Engine) -> Result<RenderRow, BenchError> {
        let whole = if self.whole {
            Some(self.first_whole(engine)?)
        } else {
            None
        };
        engine.render(&self.frame(engine, 0))?;
        let first_ms = self.is_first.then(|| ms(since_process_start()));
        if self.warm_up == WarmUp::Turn {
            for frame in 1..self.frames {
                engine.render(&self.frame(engine, frame))?;
            }
        }
        let mut wall_ms = Vec::with_capacity(self.frames as usize);
        let mut stats = Vec::with_capacity(self.frames as usize);
        let turn = Stopwatch::start();
        for frame in 0..self.frames {
            let settings = self.frame(engine, frame);
            let watch = Stopwatch::start();
            let picture = engine.render(&settings)?;
            wall_ms.push(watch.elapsed().wall_ms);
            stats.push(picture.stats);
        }
        let cpu_ms = turn.elapsed().cpu_ms.map(|ms| ms / f64::from(self.frames));
        Ok(self.row(&wall_ms, cpu_ms, first_ms, whole, &stats))
    }

    /// The settings of frame `number` of the turn.
    fn frame(&self, engine: &Engine, number: u32) -> PictureSettings {
        let meta = engine.meta();
        let center = volume_bounds(meta.dims, &meta.world_from_index).center;
        let camera = Camera::turntable(number, self.frames, center, turn_distance_mm(meta));
        PictureSettings {
            camera,
            ..self.settings.clone()
        }
    }

    /// The first whole picture by ticks.
    fn first_whole(&self, engine: &mut Engine) -> Result<Whole, BenchError> {
        engine.set_picture(self.frame(engine, 0));
        loop {
            let report = engine.tick(&TickBudget::default())?;
            match report.event {
                None => {}
                Some(TickEvent::Failed) => {
                    return Err(BenchError::FailedBricks {
                        vol: self.vol.clone(),
                        bricks: report.failed_bricks,
                    });
                }
                // What comes at once is exact at once.
                Some(TickEvent::Whole | TickEvent::Refined | TickEvent::Converged) => {
                    return Ok(Whole {
                        since_start_ms: ms(since_process_start()),
                        peak_rss_bytes: peak_rss_bytes(),
                    });
                }
            }
        }
    }

    fn row(
        &self,
        wall_ms: &[f64],
        cpu_ms: Option<f64>,
        first_ms: Option<f64>,
        whole: Option<Whole>,
        stats: &[PictureStats],
    ) -> RenderRow {
        let of_frames = |figure: fn(&PictureStats) -> f64| -> f64 {
            mean(stats.iter().map(figure)).unwrap_or(0.0)
        };
        let samples = of_frames(|s| s.samples as f64);
        let contributing: Option<Vec<u64>> = stats.iter().map(|s| s.samples_contributing).collect();
        let bricks_read: Option<Vec<u64>> = stats.iter().map(|s| s.bricks_read).collect();
        let mean_of = |counts: Vec<u64>| mean(counts.into_iter().map(|n| n as f64));
        let passes: Option<Vec<&BTreeMap<String, f64>>> =
            stats.iter().map(|s| s.passes_ms.as_ref()).collect();
        let sums = |passes: &Vec<&BTreeMap<String, f64>>| -> Option<f64> {
            let sums: Vec<f64> = passes.iter().map(|p| p.values().sum()).collect();
            median(&sums)
        };
        let median_ms = percentile(wall_ms, 0.5).unwrap_or(0.0);
        let [width, height] = self.settings.size;
        let last = stats.last();
        RenderRow {
            vol: self.vol.clone(),
            device: last.map_or_else(String::new, |s| s.device.clone()),
            mode: self.settings.mode.name().into(),
            size: format!("{width}x{height}"),
            step: self.settings.step,
            frames: self.frames,
            median_ms: rounded(median_ms),
            min_ms: rounded(percentile(wall_ms, 0.0).unwrap_or(0.0)),
            p90_ms: rounded(percentile(wall_ms, 0.9).unwrap_or(0.0)),
            cpu_ms: cpu_ms.map(rounded),
            first_ms: first_ms.map(rounded),
            rss_peak_mib: peak_rss_bytes().map(mib),
            samples: samples.round() as u64,
            samples_contributing: contributing.and_then(mean_of).map(|n| n.round() as u64),
            gpu_ms: passes.as_ref().and_then(sums).map(rounded),
            samples_skipped: of_frames(|s| s.samples_skipped as f64).round() as u64,
            ns_per_sample: (samples > 0.0)
                .then(|| rounded(cpu_ms.unwrap_or(median_ms) * 1e6 / samples)),
            bricks_read: bricks_read.and_then(mean_of).map(rounded),
            passes_ms: passes.as_deref().map(pass_medians),
            first_whole_ms: whole.map(|w| rounded(w.since_start_ms)),
            rss_whole_mib: whole.and_then(|w| w.peak_rss_bytes).map(mib),
            adapter: last.and_then(|s| s.adapter.clone()),
            version: env!("CARGO_PKG_VERSION").into(),
        }
    }
}

/// The first whole picture.
#[derive(Clone, Copy, Debug)]
struct Whole {
    since_start_ms: f64,
    peak_rss_bytes: Option<u64>,
}

/// The median of each pass over the frames that had it.
fn pass_medians(frames: &[&BTreeMap<String, f64>]) -> BTreeMap<String, f64> {
    let mut by_name: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for frame in frames {
        for (name, ms) in *frame {
            by_name.entry(name).or_default().push(*ms);
        }
    }
    by_name
        .into_iter()
        .filter_map(|(name, ms)| Some((name.to_owned(), rounded(median(&ms)?))))
        .collect()
}

/// Distance of the eye from the centre, mm: 1.5 × n·√3 spacings for a cube of n voxels of one spacing, else 1.5 × the
/// diagonal of the rendered box.
pub fn turn_distance_mm(meta: &StoreMeta) -> f64 {
    let (dims, spacing) = (meta.dims, meta.spacing());
    let is_cube = dims.x == dims.y
        && dims.y == dims.z
        && (spacing.max_element() - spacing.min_element()) <= 1e-6 * spacing.max_element();
    1.5 * if is_cube {
        dims.x as f64 * 3f64.sqrt() * spacing.x
    } else {
        2.0 * volume_bounds(dims, &meta.world_from_index).radius
    }
}
