//! `bench render`: what a frame costs, over a full turn about the volume (cli.md).
//!
//! A frame of the turn ([`Turn`]) is one call of [`Engine::render`], from settings to a finished picture in host memory, each sample
//! exact. What the turn reads of the store beyond the warm-up is part of it, and is counted.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::ceiling::StoreCeiling;
use super::error::BenchError;
use super::process::peak_rss_bytes;
use super::report::{NamedTime, Row};
use super::summary::{mean, median, mib, percentile, rounded};
use super::table::{figure, millions};
use super::turn::{Turn, next_event};
use crate::camera::Camera;
use crate::clock::{Stopwatch, ms, since_process_start};
use crate::engine::{BareRate, Engine, TickBudget};
use crate::scene::{Mode, PictureSettings, PictureStats, ShadingModel};

/// Frames of the turn on which the device's own ceiling is measured, at most.
const BARE_FRAMES: u32 = 4;

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
    /// The mode's name on the command line.
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
    /// Samples per second of a bare kernel that interpolates as this configuration does and composites at the same
    /// positions, without bricks, skipping and early end ([`Engine::measure_bare`]), in millions: by `bare_clock`, over up
    /// to four frames of the turn. Mode dvr, post-classified, without light only.
    pub bare_msamples_per_s: Option<f64>,
    /// The same with the hardware's linear filter.
    pub bare_filtered_msamples_per_s: Option<f64>,
    /// Which time the rates count: `cpu` (of the process, on software adapters), `gpu` (timestamps) or `wall`.
    pub bare_clock: Option<String>,
    /// This configuration's samples per second, by the same clock, ÷ `bare_msamples_per_s`.
    pub efficiency: Option<f64>,
    /// The same ÷ `bare_filtered_msamples_per_s`.
    pub efficiency_filtered: Option<f64>,
    /// What bounds reading the store on this machine.
    pub ceiling: Option<StoreCeiling>,
    /// The graphics adapter's name; null on the CPU.
    pub adapter: Option<String>,
    /// Of this program.
    pub version: String,
}

impl Row for RenderRow {
    const BENCH: &'static str = "render";
    const COLUMNS: &'static [&'static str] = &[
        "configuration",
        "median ms",
        "min",
        "p90",
        "CPU ms",
        "GPU ms",
        "first ms",
        "whole ms",
        "peak MiB",
        "Msamples",
        "changing",
        "skipped",
        "ns/sample",
        "÷ bare",
    ];

    fn name(&self) -> String {
        let Self {
            vol,
            mode,
            size,
            step,
            device,
            ..
        } = self;
        format!("{vol} {mode} {size} step {step} {device}")
    }

    fn times(&self) -> Vec<NamedTime> {
        vec![("cpu_ms", self.cpu_ms), ("median_ms", Some(self.median_ms))]
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.name(),
            figure(Some(self.median_ms), 1),
            figure(Some(self.min_ms), 1),
            figure(Some(self.p90_ms), 1),
            figure(self.cpu_ms, 1),
            figure(self.gpu_ms, 1),
            figure(self.first_ms, 0),
            figure(self.first_whole_ms, 0),
            figure(self.rss_peak_mib, 0),
            millions(self.samples),
            self.samples_contributing.map_or("–".into(), millions),
            millions(self.samples_skipped),
            figure(self.ns_per_sample, 1),
            figure(self.efficiency, 2),
        ]
    }
}

impl RenderJob {
    /// Measures the configuration on `engine`.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails or is too small.
    pub fn measure(&self, engine: &mut Engine) -> Result<RenderRow, BenchError> {
        let turn = self.turn(engine);
        let whole = if self.whole {
            Some(self.first_whole(engine, &turn)?)
        } else {
            None
        };
        engine.render(&turn.frame(0))?;
        let first_ms = self.is_first.then(|| ms(since_process_start()));
        if self.warm_up == WarmUp::Turn {
            for frame in 1..self.frames {
                engine.render(&turn.frame(frame))?;
            }
        }
        let mut wall_ms = Vec::with_capacity(self.frames as usize);
        let mut stats = Vec::with_capacity(self.frames as usize);
        let all = Stopwatch::start();
        for frame in 0..self.frames {
            let settings = turn.frame(frame);
            let watch = Stopwatch::start();
            let picture = engine.render(&settings)?;
            wall_ms.push(watch.elapsed().wall_ms);
            stats.push(picture.stats);
        }
        let cpu_ms = all.elapsed().cpu_ms.map(|ms| ms / f64::from(self.frames));
        Ok(self.row(&wall_ms, cpu_ms, first_ms, whole, &stats))
    }

    /// Measures the device's own ceiling and holds `row` against it. What was resident on `engine` is dropped.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails.
    pub fn hold_against_bare(
        &self,
        engine: &mut Engine,
        row: &mut RenderRow,
    ) -> Result<(), BenchError> {
        let settings = &self.settings;
        // The bare kernel classifies samples, and lights none.
        let is_like_it = settings.mode == Mode::Dvr && !settings.is_preintegrated();
        if !is_like_it || settings.shading.model != ShadingModel::None {
            return Ok(());
        }
        let stride = self.frames.div_ceil(BARE_FRAMES) as usize;
        let turn = self.turn(engine);
        let cameras: Vec<Camera> = (0..self.frames)
            .step_by(stride)
            .map(|number| turn.camera(number))
            .collect();
        let Some(rates) = engine.measure_bare(settings, &cameras)? else {
            return Ok(());
        };
        let bare_ms: fn(&BareRate) -> Option<f64>;
        let (clock, own_ms);
        if rates.on_processor && row.cpu_ms.is_some() {
            (clock, own_ms) = ("cpu", row.cpu_ms);
            bare_ms = |rate| rate.cpu_ms;
        } else if row.gpu_ms.is_some() {
            (clock, own_ms) = ("gpu", row.gpu_ms);
            bare_ms = |rate| rate.gpu_ms;
        } else {
            (clock, own_ms) = ("wall", Some(row.median_ms));
            bare_ms = |rate| Some(rate.wall_ms);
        }
        // Samples per ms ÷ 1000 are millions of samples per second.
        let rate = |samples: u64, ms: Option<f64>| -> Option<f64> {
            ms.filter(|&ms| ms > 0.0 && samples > 0)
                .map(|ms| samples as f64 / ms / 1e3)
        };
        let own = rate(row.samples, own_ms);
        let of = |bare: &BareRate| rate(bare.samples, bare_ms(bare));
        let efficiency = |bare: Option<f64>| own.zip(bare).map(|(own, bare)| rounded(own / bare));
        let (exact, filtered) = (of(&rates.exact), rates.filtered.as_ref().and_then(of));
        row.bare_clock = Some(clock.into());
        row.bare_msamples_per_s = exact.map(rounded);
        row.bare_filtered_msamples_per_s = filtered.map(rounded);
        row.efficiency = efficiency(exact);
        row.efficiency_filtered = efficiency(filtered);
        Ok(())
    }

    /// The pictures.
    fn turn(&self, engine: &Engine) -> Turn {
        Turn::new(&self.settings, engine.meta(), self.frames)
    }

    /// The first whole picture by ticks.
    fn first_whole(&self, engine: &mut Engine, turn: &Turn) -> Result<Whole, BenchError> {
        let mut settings = turn.frame(0);
        // At its own step, so that it may be held against pictures of that step.
        settings.moving_step = settings.step;
        engine.set_picture(settings);
        // What comes first is whole; what comes at once is exact at once.
        next_event(engine, &self.vol, &TickBudget::default())?;
        Ok(Whole {
            since_start_ms: ms(since_process_start()),
            peak_rss_bytes: peak_rss_bytes(),
        })
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
            bare_msamples_per_s: None,
            bare_filtered_msamples_per_s: None,
            bare_clock: None,
            efficiency: None,
            efficiency_filtered: None,
            ceiling: None,
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
