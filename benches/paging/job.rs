//! What one process does: an engine on a store, and the pictures it draws.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use brickscope::bench::{drop_from_page_cache, storage_bytes_read};
use brickscope::engine::{
    DeviceChoice, Engine, EngineError, EngineOptions, Picture, TickBudget, TickEvent,
};
use brickscope::geom::{BrickId, Lod};
use brickscope::scene::{Image, PictureStats};
use brickscope::store::Store;
use glam::UVec3;
use serde::{Deserialize, Serialize};

use crate::process::unix_secs;
use crate::scene::View;

/// An engine, and what it does.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Job {
    pub(crate) store: PathBuf,
    /// Part of an adapter's name; `None`: the software adapter, the same everywhere.
    pub(crate) device: Option<String>,
    pub(crate) gpu_memory: u64,
    pub(crate) ram: u64,
    pub(crate) max_slots: Option<u64>,
    /// When the process was started, seconds since 1970.
    pub(crate) spawned_secs: f64,
    pub(crate) task: Task,
}

/// What a process does.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum Task {
    /// One picture by `Engine::render`: a [`Cost`]. Its pixels go to a file.
    Render { view: View, pixels: PathBuf },
    /// One picture by `Engine::tick`: a [`LiveCost`]. With `warm`, the engine has drawn a small picture
    /// before, and dropped all bricks.
    Live {
        view: View,
        warm: bool,
        pixels: PathBuf,
    },
    /// Pictures one after the other, by `Engine::render`: a list of [`Cost`].
    Series { views: Vec<View> },
    /// The same by `Engine::tick`: a list of [`LiveCost`].
    Edits { views: Vec<View>, pixels: PathBuf },
    /// Is the memory enough for this picture? `null`, or the refusal.
    Accepts { view: View },
}

/// What a picture took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Cost {
    pub(crate) device: String,
    pub(crate) wall_ms: f64,
    pub(crate) atlas_bytes: u64,
    pub(crate) atlas_slots: u64,
    pub(crate) gpu_bytes: u64,
    pub(crate) bricks_read: u64,
    pub(crate) bricks_requested: u64,
    pub(crate) bricks_touched: u64,
    pub(crate) bricks_uploaded: u64,
    pub(crate) bytes_read: u64,
    pub(crate) bytes_uploaded: u64,
    pub(crate) samples: u64,
    /// Pinned bricks of the coarsest level: read whatever is seen.
    pub(crate) pinned: u64,
    /// Bricks that were sampled, the coarsest level's left out: level and place. Not told by live pictures.
    pub(crate) touched: Vec<(u8, [u32; 3])>,
}

/// What a picture took from when it was set.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct LiveCost {
    pub(crate) cost: Cost,
    /// From opening the store to setting the picture.
    pub(crate) open_ms: f64,
    /// From the start of the process to setting the picture.
    pub(crate) start_ms: f64,
    /// From here on: since the picture was set. The first picture of any kind.
    pub(crate) first_ms: f64,
    pub(crate) first_event: String,
    /// The picture that is whole, from coarser levels: `None` when its levels are the final ones.
    pub(crate) whole: Option<Whole>,
    /// `None`: given up.
    pub(crate) converged_ms: Option<f64>,
    /// Pictures handed out, the last included.
    pub(crate) pictures: u64,
    /// Bricks that the last picture missed.
    pub(crate) missing: u64,
    pub(crate) longest_tick_ms: f64,
    /// By the whole process.
    pub(crate) storage_bytes: u64,
}

/// What the first whole picture took.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Whole {
    pub(crate) ms: f64,
    pub(crate) bytes_read: u64,
    /// By the whole process.
    pub(crate) storage_bytes: u64,
}

/// A picture that is not exact by then is given up, and said to be so.
const PATIENCE: Duration = Duration::from_secs(60);

/// An engine on an open store.
struct Bench {
    store: Arc<Store>,
    engine: Engine,
    begun: Instant,
    spawned_secs: f64,
}

impl Job {
    /// Does the task; its result.
    pub(crate) fn run(&self) -> anyhow::Result<serde_json::Value> {
        let begun = Instant::now();
        let store = Arc::new(Store::open(&self.store)?);
        let options = EngineOptions {
            device: match &self.device {
                None => DeviceChoice::SoftwareGpu,
                Some(name) => DeviceChoice::Named(name.clone()),
            },
            gpu_memory_bytes: Some(self.gpu_memory),
            ram_bytes: self.ram,
            max_slots: self.max_slots,
            ..EngineOptions::default()
        };
        let mut bench = Bench {
            engine: Engine::with_store(Arc::clone(&store), options)?,
            store,
            begun,
            spawned_secs: self.spawned_secs,
        };
        let result = match &self.task {
            Task::Render { view, pixels } => {
                let picture = bench.engine.render(&view.settings(bench.store.meta())?)?;
                write_pixels(pixels, &picture.image)?;
                serde_json::to_value(bench.cost(&picture.stats, Some(&picture)))?
            }
            Task::Live { view, warm, pixels } => {
                if *warm {
                    bench.warm_up(view)?;
                }
                let cost = bench.converge(view)?;
                write_pixels(pixels, bench.engine.image().context("no picture")?)?;
                serde_json::to_value(cost)?
            }
            Task::Series { views } => {
                let mut costs = Vec::new();
                for view in views {
                    let picture = bench.engine.render(&view.settings(bench.store.meta())?)?;
                    costs.push(bench.cost(&picture.stats, Some(&picture)));
                }
                serde_json::to_value(costs)?
            }
            Task::Edits { views, pixels } => {
                let mut costs = Vec::new();
                for (number, view) in views.iter().enumerate() {
                    costs.push(bench.converge(view)?);
                    let path = pixels.with_extension(number.to_string());
                    write_pixels(&path, bench.engine.image().context("no picture")?)?;
                }
                serde_json::to_value(costs)?
            }
            Task::Accepts { view } => serde_json::to_value(bench.refusal(view)?)?,
        };
        Ok(result)
    }
}

impl Bench {
    /// Builds the pipelines by drawing the picture once, and drops every brick.
    fn warm_up(&mut self, view: &View) -> anyhow::Result<()> {
        let small = View { size: 16, ..*view };
        self.engine.set_picture(small.settings(self.store.meta())?);
        while !self.engine.is_converged() {
            self.engine.tick(&TickBudget::default())?;
        }
        self.engine.forget_bricks();
        Ok(drop_from_page_cache(self.store.path())?)
    }

    /// Draws a picture by ticks until it is exact.
    fn converge(&mut self, view: &View) -> anyhow::Result<LiveCost> {
        let settings = view.settings(self.store.meta())?;
        let open_ms = ms_since(self.begun);
        let start_ms = (unix_secs() - self.spawned_secs) * 1e3;
        let begun = Instant::now();
        self.engine.set_picture(settings);
        let mut first = None;
        let mut whole = None;
        let mut longest_tick_ms: f64 = 0.0;
        let (mut pictures, mut missing) = (0, 0);
        while !self.engine.is_converged() && begun.elapsed() < PATIENCE {
            let tick = Instant::now();
            let report = self.engine.tick(&TickBudget::default())?;
            longest_tick_ms = longest_tick_ms.max(ms_since(tick));
            missing = report.missing_bricks;
            let Some(event) = report.event else {
                continue;
            };
            if event == TickEvent::Failed {
                bail!("{} bricks can't be read", report.failed_bricks);
            }
            pictures += 1;
            first.get_or_insert((ms_since(begun), event));
            if whole.is_none() && event == TickEvent::Whole {
                let stats = self.engine.statistics()?.context("no statistics")?;
                whole = Some(Whole {
                    ms: ms_since(begun),
                    bytes_read: stats.bytes_read.unwrap_or(0),
                    storage_bytes: storage_bytes_read().context("the kernel tells no bytes")?,
                });
            }
        }
        let converged_ms = self.engine.is_converged().then(|| ms_since(begun));
        let (first_ms, first_event) = first.context("no picture")?;
        let stats = self.engine.statistics()?.context("no statistics")?;
        Ok(LiveCost {
            cost: self.cost(&stats, None),
            open_ms,
            start_ms,
            first_ms,
            first_event: format!("{first_event:?}"),
            whole,
            converged_ms,
            pictures,
            missing,
            longest_tick_ms,
            storage_bytes: storage_bytes_read().context("the kernel tells no bytes")?,
        })
    }

    /// Why the engine refuses a picture for want of memory.
    fn refusal(&mut self, view: &View) -> anyhow::Result<Option<String>> {
        self.engine.set_picture(view.settings(self.store.meta())?);
        loop {
            // Memory is refused before anything is drawn.
            match self.engine.tick(&TickBudget::default()) {
                Ok(report) if report.event.is_some() => return Ok(None),
                Ok(_) => {}
                Err(error @ (EngineError::GpuMemory { .. } | EngineError::Atlas { .. })) => {
                    return Ok(Some(error.to_string()));
                }
                Err(other) => return Err(other.into()),
            }
        }
    }

    fn cost(&self, stats: &PictureStats, picture: Option<&Picture>) -> Cost {
        let coarsest = Lod(self.store.levels() as u8 - 1);
        let bricks = picture.map_or(&[][..], |p| &p.touched);
        let coarsest_bricks = self.store.bricks(coarsest);
        Cost {
            device: self.engine.device_name(),
            wall_ms: stats.wall_ms,
            atlas_bytes: stats.atlas_bytes.unwrap_or(0),
            atlas_slots: stats.atlas_slots.unwrap_or(0),
            gpu_bytes: stats.gpu_bytes.unwrap_or(0),
            bricks_read: stats.bricks_read.unwrap_or(0),
            bricks_requested: stats.bricks_requested.unwrap_or(0),
            bricks_touched: stats.bricks_touched.unwrap_or(0),
            bricks_uploaded: stats.bricks_uploaded.unwrap_or(0),
            bytes_read: stats.bytes_read.unwrap_or(0),
            bytes_uploaded: stats.bytes_uploaded.unwrap_or(0),
            samples: stats.samples,
            pinned: coarsest_bricks
                .filter(|&b| !self.store.entry(b).constant)
                .count() as u64,
            touched: bricks
                .iter()
                .filter(|b| b.lod != coarsest)
                .map(|b| (b.lod.0, b.xyz.to_array()))
                .collect(),
        }
    }
}

impl LiveCost {
    /// When it was exact, or how far it came.
    pub(crate) fn converged_secs(&self) -> String {
        match self.converged_ms {
            Some(ms) => format!("{:.2}", ms / 1e3),
            None => format!(
                "**not in {} s, {} missing**",
                PATIENCE.as_secs(),
                self.missing
            ),
        }
    }
}

impl Cost {
    /// The bricks of [`Cost::touched`].
    pub(crate) fn working_set(&self) -> Vec<BrickId> {
        self.touched
            .iter()
            .map(|&(lod, xyz)| BrickId::new(Lod(lod), UVec3::from(xyz)))
            .collect()
    }
}

fn ms_since(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// The pixels as they are: 4 floats each.
fn write_pixels(path: &PathBuf, image: &Image) -> anyhow::Result<()> {
    fs::write(path, bytemuck::cast_slice(&image.pixels))
        .with_context(|| format!("writing {}", path.display()))
}
