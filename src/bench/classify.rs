//! `bench classify`: what an edit costs, from the new classification to the next whole picture and to the exact one.
//!
//! The picture is drawn by ticks, as a window does, from the first camera of the turn of `bench render`, with what it needs
//! resident. An edit goes back and forth between two classifications, moved apart by a twentieth of the default window: the
//! transfer function along the value (mode dvr), the value of the surface (mode iso). What each first shows may have to be
//! read once; that happens before the clock starts. Beside them stands *the render itself*: the same picture without an
//! edit, from the first camera again after the second one was drawn.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::error::BenchError;
use super::report::{NamedTime, Row};
use super::summary::{mean, median, percentile, rounded};
use super::table::figure;
use super::turn::{Turn, converge, next_event};
use crate::clock::{CpuClock, ms};
use crate::engine::{Engine, TickBudget};
use crate::geom::BLOCKS_PER_BRICK;
use crate::scene::{
    IsoSurface, Mode, PictureSettings, PictureStats, Shading, ShadingModel, default_window,
};
use crate::store::StoreMeta;

/// By how much an edit moves values, as a part of the default window.
const EDIT: f64 = 0.05;
/// Angle between the two cameras of the render itself: pictures of a full turn.
const TURN_FRAMES: u32 = 36;

/// One picture whose classification is edited.
#[derive(Clone, Debug)]
pub struct ClassifyJob {
    /// What the volume is called in the report.
    pub vol: String,
    /// The picture; its camera, mode and shading are replaced.
    pub settings: PictureSettings,
    /// Edits of each kind that are timed, at least 1.
    pub edits: u32,
}

/// What an edit costs. Fields are null where they can't be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassifyRow {
    /// The store's name, without folder and extension.
    pub vol: String,
    /// `gpu` or `cpu`.
    pub device: String,
    /// `dvr` or `iso`.
    pub mode: String,
    /// `edit` or `render itself`.
    pub what: String,
    /// `WIDTHxHEIGHT`, pixels.
    pub size: String,
    /// Distance of samples in units of the smallest spacing.
    pub step: f64,
    /// The level of the samples nearest to the eye.
    pub level: u8,
    /// Bricks of the levels in use that may be visible.
    pub bricks_visible: Option<u64>,
    /// Their blocks.
    pub blocks: Option<u64>,
    /// Edits that were timed.
    pub edits: u32,
    /// From the edit to the next whole picture, ms: the median.
    pub whole_ms: Option<f64>,
    /// The 90th percentile.
    pub whole_p90_ms: Option<f64>,
    /// From the edit to the exact picture, ms: the median.
    pub converged_ms: Option<f64>,
    /// The 90th percentile.
    pub converged_p90_ms: Option<f64>,
    /// User and system time of the whole process until the picture was exact, per edit, ms.
    pub cpu_ms: Option<f64>,
    /// `whole_ms` less that of the render itself: what the edit costs beside drawing.
    pub over_render_ms: Option<f64>,
    /// Bricks read per edit (mean).
    pub bricks_read: Option<f64>,
    /// The graphics adapter's name; null on the CPU.
    pub adapter: Option<String>,
    /// Of this program.
    pub version: String,
}

impl Row for ClassifyRow {
    const BENCH: &'static str = "classify";
    const COLUMNS: &'static [&'static str] = &[
        "configuration",
        "bricks",
        "blocks",
        "edits",
        "whole ms",
        "p90",
        "over render ms",
        "exact ms",
        "p90",
        "CPU ms",
        "read",
    ];

    fn name(&self) -> String {
        let Self {
            vol,
            mode,
            what,
            size,
            step,
            level,
            device,
            ..
        } = self;
        format!("{vol} {mode} {what} {size} step {step} level {level} {device}")
    }

    fn times(&self) -> Vec<NamedTime> {
        vec![
            ("whole_ms", self.whole_ms),
            ("converged_ms", self.converged_ms),
            ("cpu_ms", self.cpu_ms),
        ]
    }

    fn cells(&self) -> Vec<String> {
        let count = |n: Option<u64>| n.map_or("–".into(), |n| n.to_string());
        vec![
            self.name(),
            count(self.bricks_visible),
            count(self.blocks),
            self.edits.to_string(),
            figure(self.whole_ms, 1),
            figure(self.whole_p90_ms, 1),
            figure(self.over_render_ms, 1),
            figure(self.converged_ms, 1),
            figure(self.converged_p90_ms, 1),
            figure(self.cpu_ms, 1),
            figure(self.bricks_read, 1),
        ]
    }
}

/// Times of all edits of a kind.
#[derive(Debug, Default)]
struct Times {
    whole_ms: Vec<f64>,
    converged_ms: Vec<f64>,
    cpu_ms: Option<f64>,
    stats: Vec<PictureStats>,
}

impl ClassifyJob {
    /// Measures the render itself and an edit, in modes dvr and iso.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails or is too small.
    pub fn measure(&self, engine: &mut Engine) -> Result<Vec<ClassifyRow>, BenchError> {
        let mut rows = Vec::new();
        for mode in [Mode::Dvr, Mode::Iso] {
            let pictures = Pictures::new(&self.settings, mode, engine.meta())?;
            let render = self.alternate(engine, [&pictures.from_aside, &pictures.original])?;
            let edit = self.alternate(engine, [&pictures.edited, &pictures.original])?;
            let itself = median(&render.whole_ms);
            rows.push(self.row(mode, "render itself", &render, None));
            rows.push(self.row(mode, "edit", &edit, itself));
        }
        Ok(rows)
    }

    /// Draws two pictures in turns. Both were drawn before the clock starts. Of the render itself only the way back is of the
    /// same picture, but both cost alike.
    fn alternate(
        &self,
        engine: &mut Engine,
        pictures: [&PictureSettings; 2],
    ) -> Result<Times, BenchError> {
        let budget = TickBudget::default();
        for picture in pictures {
            converge(engine, picture, &self.vol, &budget)?;
        }
        let mut times = Times::default();
        let cpu_before = CpuClock::now();
        for picture in pictures.into_iter().cycle().take(self.edits as usize) {
            let begun = Instant::now();
            engine.set_picture(picture.clone());
            // What comes first is whole.
            next_event(engine, &self.vol, &budget)?;
            times.whole_ms.push(ms(begun.elapsed()));
            while !engine.is_converged() {
                next_event(engine, &self.vol, &budget)?;
            }
            times.converged_ms.push(ms(begun.elapsed()));
            times.stats.extend(engine.statistics()?);
        }
        times.cpu_ms = CpuClock::now()
            .zip(cpu_before)
            .map(|(now, before)| ms(now.saturating_sub(before)) / f64::from(self.edits));
        Ok(times)
    }

    fn row(&self, mode: Mode, what: &str, times: &Times, itself: Option<f64>) -> ClassifyRow {
        let last = times.stats.last();
        let bricks_visible = last.and_then(|s| s.bricks_visible);
        let reads: Option<Vec<u64>> = times.stats.iter().map(|s| s.bricks_read).collect();
        let whole_ms = median(&times.whole_ms);
        let [width, height] = self.settings.size;
        ClassifyRow {
            vol: self.vol.clone(),
            device: last.map_or_else(String::new, |s| s.device.clone()),
            mode: mode.name().into(),
            what: what.into(),
            size: format!("{width}x{height}"),
            step: self.settings.step,
            level: last.map_or(0, |s| s.lod),
            bricks_visible,
            blocks: bricks_visible.map(|n| n * BLOCKS_PER_BRICK as u64),
            edits: self.edits,
            whole_ms: whole_ms.map(rounded),
            whole_p90_ms: percentile(&times.whole_ms, 0.9).map(rounded),
            converged_ms: median(&times.converged_ms).map(rounded),
            converged_p90_ms: percentile(&times.converged_ms, 0.9).map(rounded),
            cpu_ms: times.cpu_ms.map(rounded),
            over_render_ms: whole_ms
                .zip(itself)
                .map(|(edit, render)| rounded(edit - render)),
            bricks_read: reads
                .and_then(|reads| mean(reads.into_iter().map(|n| n as f64)))
                .map(rounded),
            adapter: last.and_then(|s| s.adapter.clone()),
            version: env!("CARGO_PKG_VERSION").into(),
        }
    }
}

/// What is drawn.
#[derive(Debug)]
struct Pictures {
    original: PictureSettings,
    /// With another classification.
    edited: PictureSettings,
    /// From another camera.
    from_aside: PictureSettings,
}

impl Pictures {
    fn new(settings: &PictureSettings, mode: Mode, meta: &StoreMeta) -> Result<Self, BenchError> {
        let [low, high] = default_window(meta);
        let by = EDIT * (high - low);
        let mut settings = PictureSettings {
            mode,
            shading: Shading {
                model: match mode {
                    Mode::Iso => ShadingModel::Phong,
                    _ => ShadingModel::None,
                },
                ..settings.shading
            },
            // The first whole picture is of the same step.
            moving_step: settings.step,
            ..settings.clone()
        };
        if settings.classification.iso.is_empty() {
            let middle = IsoSurface::opaque(0.5 * (low + high));
            settings.classification.iso.push(middle);
        }
        let turn = Turn::new(&settings, meta, TURN_FRAMES);
        let original = turn.frame(0);
        let mut edited = original.clone();
        let moved = &mut edited.classification;
        match mode {
            Mode::Iso => {
                for surface in &mut moved.iso {
                    surface.value += by;
                }
            }
            // x lies at x + by.
            _ => moved.transfer = moved.transfer.stretched([by, 1.0 + by])?,
        }
        Ok(Self {
            from_aside: turn.frame(1),
            original,
            edited,
        })
    }
}
