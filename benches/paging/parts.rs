//! The parts: which processes each runs, and its table.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use brickscope::cli::args::ByteSize;
use brickscope::export::write_png;
use brickscope::geom::BrickId;
use brickscope::outfile::Existing;
use brickscope::pager::replay::{replay_belady, replay_lru, replay_policy};
use brickscope::scene::{Background, Image};
use brickscope::store::Store;
use clap::{Parser, ValueEnum};
use glam::{Vec3, Vec4};

use crate::job::{Cost, Job, LiveCost, Task};
use crate::process::{Conditions, Measured, difference, measure};
use crate::scene::{Look, View};

/// Bytes that hold what any picture samples.
const AMPLE: u64 = 4 << 30;
/// Views of an orbit.
const ORBIT: u32 = 36;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    Equality,
    First,
    Overfetch,
    Orbit,
    Edit,
    Least,
}

/// What paging costs.
#[derive(Debug, Parser)]
struct Args {
    /// The brick store
    store: PathBuf,
    /// Value of the iso-surface, physical [default: the middle of the default window]
    #[arg(long, allow_hyphen_values = true)]
    iso: Option<f64>,
    /// These parts, separated by commas [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    only: Vec<Part>,
    /// The small budget of `equality`, and the only one of `first` and `edit`
    #[arg(long, default_value = "256MiB")]
    gpu_memory: ByteSize,
    /// Decoded bricks kept in host memory
    #[arg(long, default_value = "512MiB")]
    ram: ByteSize,
    /// Pixels along each edge in `equality` and `least`
    #[arg(long, default_value_t = 1024)]
    size: u32,
    /// The same in the other parts
    #[arg(long, default_value_t = 512)]
    view_size: u32,
    /// Zoom of `orbit`: above 1, a view shows a part of the volume, from finer levels
    #[arg(long, default_value_t = 1.0)]
    zoom: f64,
    /// Distance of samples
    #[arg(long, default_value_t = 0.5)]
    step: f64,
    /// Pictures are kept here
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// Part of an adapter's name [default: the software adapter]
    #[arg(long)]
    device: Option<String>,
    /// What cargo passes
    #[arg(long, hide = true)]
    bench: bool,
}

/// Measures a part, and prints its table.
type Show = fn(&Run) -> anyhow::Result<()>;

/// The bench under way.
struct Run {
    args: Args,
    scratch: tempfile::TempDir,
    store_bytes: u64,
    name: String,
}

/// All parts that are asked for.
pub(crate) fn run() -> anyhow::Result<()> {
    let args = Args::parse();
    let store = Store::open(&args.store)?;
    let [x, y, z] = store.meta().dims.to_array();
    let file = args.store.file_stem().unwrap_or_default().to_string_lossy();
    let run = Run {
        store_bytes: store.file_len(),
        name: format!("{file} {x}×{y}×{z} {:?}", store.stored_type()).to_lowercase(),
        scratch: tempfile::tempdir().context("a temporary folder")?,
        args,
    };
    println!(
        "{}, store {}; step {}, RAM {}",
        run.name,
        mib(run.store_bytes),
        run.args.step,
        mib(run.args.ram.0)
    );
    let parts: [(Part, Show); 6] = [
        (Part::Equality, Run::equality),
        (Part::First, Run::first),
        (Part::Overfetch, Run::overfetch),
        (Part::Orbit, Run::orbit),
        (Part::Edit, Run::edit),
        (Part::Least, Run::least),
    ];
    for (part, show) in parts {
        if run.args.only.is_empty() || run.args.only.contains(&part) {
            show(&run)?;
        }
    }
    Ok(())
}

impl Run {
    fn view(&self, look: Look, size: u32) -> View {
        View {
            look,
            size,
            step: self.args.step,
            iso: self.args.iso,
            azimuth: 0.0,
            elevation: 0.0,
            zoom: 1.0,
        }
    }

    fn job(&self, gpu_memory: u64, task: Task) -> Job {
        Job {
            store: self.args.store.clone(),
            device: self.args.device.clone(),
            gpu_memory,
            ram: self.args.ram.0,
            max_slots: None,
            spawned_secs: 0.0,
            task,
        }
    }

    fn pixels(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    /// Keeps a picture for people to look at.
    fn keep(&self, pixels: &Path, size: u32, name: &str) -> anyhow::Result<()> {
        let Some(folder) = &self.args.pictures else {
            return Ok(());
        };
        let bytes = fs::read(pixels)?;
        let image = Image {
            width: size,
            height: size,
            pixels: bytemuck::pod_collect_to_vec::<u8, Vec4>(&bytes),
            depths: None,
        };
        let rgba = image.to_rgba8(Background::Color(Vec3::ZERO));
        let path = folder.join(name).with_extension("png");
        write_png(&path, size, size, &rgba, true, Existing::Replace)?;
        Ok(())
    }

    fn equality(&self) -> anyhow::Result<()> {
        let Args { size, .. } = self.args;
        heading(
            &format!("Equality and cost, {size}²"),
            &[
                "mode",
                "budget",
                "drawn by",
                "atlas",
                "slots",
                "GPU bytes",
                "first picture s",
                "converged s",
                "bricks read",
                "touched",
                "read ÷ touched",
                "uploaded",
                "bytes read",
                "peak RSS",
                "pixels",
            ],
        );
        for look in Look::MODES {
            let view = self.view(look, size);
            let ample = self.pixels("ample");
            let row = |budget: u64,
                       by: &str,
                       cost: &Cost,
                       times: [String; 2],
                       rss,
                       pixels: &str| {
                println!(
                    "| {look} | {} | {by} | {} | {} | {} | {} | {} | {} | {} | {:.2} | {} | {} | {} | {pixels} |",
                    mib(budget),
                    mib(cost.atlas_bytes),
                    cost.atlas_slots,
                    mib(cost.gpu_bytes),
                    times[0],
                    times[1],
                    cost.bricks_read,
                    cost.bricks_touched,
                    ratio(cost.bricks_read, cost.bricks_touched),
                    cost.bricks_uploaded,
                    mib(cost.bytes_read),
                    mib(rss)
                );
            };
            let small = self.args.gpu_memory.0;
            for (budget, path) in [(AMPLE, ample.clone()), (small, self.pixels("small"))] {
                let pixels = path.clone();
                let task = Task::Render { view, pixels };
                let cost: Measured<Cost> =
                    measure(&self.job(budget, task), &Conditions::default())?;
                let same = if path == ample {
                    "–".to_owned()
                } else {
                    told(difference(&ample, &path)?)
                };
                let Measured {
                    result,
                    peak_rss_bytes,
                } = cost;
                let times = [(); 2].map(|()| format!("{:.2}", result.wall_ms / 1e3));
                row(budget, "render", &result, times, peak_rss_bytes, &same);
                self.keep(&path, size, &format!("{look}-render-{}", budget >> 20))?;
            }
            let pixels = self.pixels("live");
            let task = Task::Live {
                view,
                warm: false,
                pixels: pixels.clone(),
            };
            let live: Measured<LiveCost> = measure(&self.job(small, task), &Conditions::default())?;
            let same = told(difference(&ample, &pixels)?);
            let LiveCost { cost, first_ms, .. } = &live.result;
            let times = [
                format!("{:.2}", first_ms / 1e3),
                live.result.converged_secs(),
            ];
            row(small, "tick", cost, times, live.peak_rss_bytes, &same);
            self.keep(&pixels, size, &format!("{look}-tick-{}", small >> 20))?;
        }
        Ok(())
    }

    fn first(&self) -> anyhow::Result<()> {
        let Args { view_size, .. } = self.args;
        heading(
            &format!(
                "First whole picture, {view_size}², {} of GPU memory, store dropped from the page cache",
                mib(self.args.gpu_memory.0)
            ),
            &[
                "mode",
                "pipelines",
                "open ms",
                "process start to picture set ms",
                "set to first picture ms",
                "event",
                "set to whole ms",
                "store bytes read by then",
                "storage bytes by then",
                "converged s",
                "pictures",
                "store bytes read",
                "longest tick ms",
            ],
        );
        for look in Look::MODES {
            let shaders = tempfile::tempdir().context("a temporary folder")?;
            for (pipelines, warm) in [
                ("compiled", false),
                ("from Mesa's cache on disk", false),
                ("built", true),
            ] {
                let task = Task::Live {
                    view: self.view(look, view_size),
                    warm,
                    pixels: self.pixels("first"),
                };
                let conditions = Conditions {
                    shader_cache: Some(shaders.path().to_owned()),
                    drops_store: true,
                };
                let job = self.job(self.args.gpu_memory.0, task);
                let live: LiveCost = measure(&job, &conditions)?.result;
                let [whole_ms, bytes, storage] = match live.whole {
                    Some(w) => [
                        format!("{:.0}", w.ms),
                        mib(w.bytes_read),
                        mib(w.storage_bytes),
                    ],
                    None => [(); 3].map(|()| "–".to_owned()),
                };
                println!(
                    "| {look} | {pipelines} | {:.0} | {:.0} | {:.0} | {} | {whole_ms} | {bytes} | {storage} | {} | {} | {} | {:.0} |",
                    live.open_ms,
                    live.start_ms,
                    live.first_ms,
                    live.first_event,
                    live.converged_secs(),
                    live.pictures,
                    mib(live.cost.bytes_read),
                    live.longest_tick_ms
                );
            }
        }
        Ok(())
    }

    fn overfetch(&self) -> anyhow::Result<()> {
        let Args { view_size, .. } = self.args;
        heading(
            &format!("Over-fetch, {view_size}², an atlas that holds everything"),
            &[
                "mode",
                "azimuth, elevation",
                "bricks read",
                "touched",
                "read ÷ touched",
                "requested",
                "converged s",
            ],
        );
        for look in [Look::Iso, Look::Dvr] {
            for (azimuth, elevation) in [(0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (45.0, 30.0)] {
                let view = View {
                    azimuth,
                    elevation,
                    ..self.view(look, view_size)
                };
                let pixels = self.pixels("overfetch");
                let task = Task::Render {
                    view,
                    pixels: pixels.clone(),
                };
                let cost: Cost = measure(&self.job(AMPLE, task), &Conditions::default())?.result;
                self.keep(&pixels, view_size, &format!("{look}-{azimuth}-{elevation}"))?;
                let read = cost.bricks_read - cost.pinned;
                let touched = cost.touched.len() as u64;
                println!(
                    "| {look} | {azimuth}, {elevation} | {read} | {touched} | {:.3} | {} | {:.2} |",
                    ratio(read, touched),
                    cost.bricks_requested,
                    cost.wall_ms / 1e3
                );
            }
        }
        Ok(())
    }

    fn orbit(&self) -> anyhow::Result<()> {
        let Args { view_size, .. } = self.args;
        heading(
            &format!(
                "Orbit of {ORBIT} views, {view_size}², zoom {}",
                self.args.zoom
            ),
            &[
                "mode",
                "slots",
                "of what",
                "touched",
                "uploaded",
                "engine",
                "policy replayed",
                "LRU replayed",
                "Bélády",
                "engine ÷ Bélády",
                "policy ÷ Bélády",
                "bricks read",
                "s per view",
            ],
        );
        for look in [Look::Iso, Look::Dvr] {
            let views: Vec<View> = (0..ORBIT)
                .map(|k| View {
                    azimuth: f64::from(k) * 360.0 / f64::from(ORBIT),
                    elevation: 15.0,
                    zoom: self.args.zoom,
                    ..self.view(look, view_size)
                })
                .collect();
            let drawn = |max_slots| -> anyhow::Result<Vec<Cost>> {
                let task = Task::Series {
                    views: views.clone(),
                };
                let job = Job {
                    max_slots,
                    ..self.job(AMPLE, task)
                };
                Ok(measure(&job, &Conditions::default())?.result)
            };
            let trace_of = |costs: &[Cost]| -> Vec<Vec<BrickId>> {
                costs.iter().map(Cost::working_set).collect()
            };
            let ample = drawn(None)?;
            let trace = trace_of(&ample);
            let pinned = ample[0].pinned;
            let union: BTreeSet<BrickId> = trace.iter().flatten().copied().collect();
            let largest = trace.iter().map(Vec::len).max().unwrap_or(0);
            let slots_of = [
                (union.len(), "all views"),
                (largest * 5 / 4, "1.25 × the largest view"),
                (union.len() / 4, "a quarter of all views"),
            ];
            for (number, (slots, what)) in slots_of.into_iter().enumerate() {
                let costs = match number {
                    0 => ample.clone(),
                    _ => drawn(Some(slots as u64 + pinned))?,
                };
                // Its own trace: where the blocks of an absent brick are not known, more is sampled.
                let trace = trace_of(&costs);
                let touched: usize = trace.iter().map(Vec::len).sum();
                // Pinned bricks come once, and are not of the trace.
                let uploaded = costs.iter().map(|c| c.bricks_uploaded).sum::<u64>() - pinned;
                let engine = 1.0 - uploaded as f64 / touched as f64;
                let [policy, lru, belady] =
                    [replay_policy, replay_lru, replay_belady].map(|f| f(&trace, slots).hit_rate());
                println!(
                    "| {look} | {slots} | {what} | {touched} | {uploaded} | {engine:.3} | {policy:.3} | {lru:.3} | {belady:.3} | {:.3} | {:.3} | {} | {:.2} |",
                    engine / belady,
                    policy / belady,
                    costs.iter().map(|c| c.bricks_read).sum::<u64>(),
                    costs.iter().map(|c| c.wall_ms).sum::<f64>() / 1e3 / f64::from(ORBIT)
                );
            }
        }
        Ok(())
    }

    fn edit(&self) -> anyhow::Result<()> {
        let Args { view_size, .. } = self.args;
        heading(
            &format!(
                "Edits of a converged picture, {view_size}², {} of GPU memory",
                mib(self.args.gpu_memory.0)
            ),
            &[
                "edit",
                "slots",
                "next picture ms",
                "event",
                "converged s",
                "pictures",
                "longest tick ms",
                "bricks read",
                "uploaded",
                "bytes uploaded",
            ],
        );
        let (warm, cold) = ([1.0, 0.9, 0.7], [0.5, 0.8, 1.0]);
        let bone = |from, color| Look::Dense { from, color };
        let edits = [
            ("dvr, from nothing", bone(1.0, warm)),
            ("dvr, colours only", bone(1.0, cold)),
            ("dvr, opacity from 0.85 × the value on", bone(0.85, cold)),
            ("dvr, opacity back", bone(1.0, cold)),
            ("iso, from dvr", Look::IsoAt { part: 1.0 }),
            ("iso, to 0.875 × the value", Look::IsoAt { part: 0.875 }),
            ("iso, back", Look::IsoAt { part: 1.0 }),
        ];
        let pixels = self.pixels("edit");
        let task = Task::Edits {
            views: edits.map(|(_, look)| self.view(look, view_size)).into(),
            pixels: pixels.clone(),
        };
        let job = self.job(self.args.gpu_memory.0, task);
        let costs: Measured<Vec<LiveCost>> = measure(&job, &Conditions::default())?;
        for (number, ((name, _), live)) in edits.iter().zip(&costs.result).enumerate() {
            println!(
                "| {name} | {} | {:.0} | {} | {} | {} | {:.0} | {} | {} | {} |",
                live.cost.atlas_slots,
                live.first_ms,
                live.first_event,
                live.converged_secs(),
                live.pictures,
                live.longest_tick_ms,
                live.cost.bricks_read,
                live.cost.bricks_uploaded,
                live.cost.bytes_uploaded
            );
            let path = pixels.with_extension(number.to_string());
            self.keep(&path, view_size, &format!("edit-{number}"))?;
        }
        Ok(())
    }

    fn least(&self) -> anyhow::Result<()> {
        heading(
            "The least GPU memory",
            &[
                "mode",
                "size",
                "MiB",
                "refusal of 1 MiB less",
                "bricks uploaded",
                "touched",
                "s",
                "pixels",
            ],
        );
        for size in [self.args.size / 2, self.args.size] {
            for look in Look::MODES {
                let view = self.view(look, size);
                let refusal = |mebibytes: u64| -> anyhow::Result<Option<String>> {
                    let job = self.job(mebibytes << 20, Task::Accepts { view });
                    Ok(measure(&job, &Conditions::default())?.result)
                };
                let (mut refused, mut enough) = (0, AMPLE >> 20);
                let mut why = String::new();
                while enough - refused > 1 {
                    // Near the low end, where the answer is.
                    let middle = (refused + (enough - refused) / 4).max(refused + 1);
                    match refusal(middle)? {
                        Some(text) => (refused, why) = (middle, text),
                        None => enough = middle,
                    }
                }
                let mut costs = Vec::new();
                let names = ["ample", "least"].map(|name| self.pixels(name));
                for (budget, pixels) in [AMPLE, enough << 20].into_iter().zip(names.clone()) {
                    let task = Task::Render { view, pixels };
                    let cost: Measured<Cost> =
                        measure(&self.job(budget, task), &Conditions::default())?;
                    costs.push(cost.result);
                }
                self.keep(&names[1], size, &format!("{look}-{size}-least"))?;
                println!(
                    "| {look} | {size}² | {enough} | {why} | {} | {} | {:.1} | {} |",
                    costs[1].bricks_uploaded,
                    costs[1].bricks_touched,
                    costs[1].wall_ms / 1e3,
                    told(difference(&names[0], &names[1])?)
                );
            }
        }
        Ok(())
    }
}

/// A table's title and head.
fn heading(title: &str, columns: &[&str]) {
    println!("\n### {title}\n\n| {} |", columns.join(" | "));
    println!("|{}", "---|".repeat(columns.len()));
}

fn told(difference: Option<u64>) -> String {
    difference.map_or("equal".into(), |n| format!("**{n} differ**"))
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Of two counts; 1 where both are 0.
fn ratio(a: u64, b: u64) -> f64 {
    if a == b { 1.0 } else { a as f64 / b as f64 }
}
