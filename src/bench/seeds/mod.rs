//! `bench seeds`: the five systems' own comparisons (techniques.md) on any volume, their ratios beside ours.
//!
//! - A comparison is one picture drawn in several ways: same cameras, spread over the full turn of cli.md, from which each frame
//!   is drawn to its end (of [`SeedTable::T2`]'s leaping, at once).
//! - The ways take turns frame by frame, so that what disturbs the machine hits all alike; before each timed frame the same
//!   way draws, untimed, the one a degree before it.
//! - A repeat is the whole turn. Times are medians over the repeats, per frame. A speed-up is the median over the repeats of
//!   the baseline's time ÷ the row's, by the process's CPU clock where the processor draws, else by the device's timestamps,
//!   else by wall time.
//!
//! What a device can't draw has a row with a note and no figure. It says nothing of quality beyond the errors of leaping and
//! super-sampling, and nothing of paging: what a frame needs is resident where the memory holds it.

mod difference;
mod measure;
mod plan;
mod sheet;
mod theirs;

use serde::{Deserialize, Serialize};

use super::report::{NamedTime, Row};
use super::table::figure;
use crate::classify::TransferFunction;
use crate::scene::{LodChoice, default_window};
use crate::store::StoreMeta;

pub use sheet::sheet;
pub use theirs::Reported;

/// A system of techniques.md.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SeedTable {
    /// Bounding mesh and refinement.
    T1,
    /// Leaping and super-sampling.
    T2,
    /// Layers.
    T3,
    /// Early termination and skipping between passes.
    T4,
    /// Slabs.
    T5,
}

impl SeedTable {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::T1, Self::T2, Self::T3, Self::T4, Self::T5];

    /// `T1` to `T5`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::T1 => "T1",
            Self::T2 => "T2",
            Self::T3 => "T3",
            Self::T4 => "T4",
            Self::T5 => "T5",
        }
    }

    /// What it is, and whose.
    const fn title(self) -> &'static str {
        match self {
            Self::T1 => "bounding mesh and refined hit points (Scharsach)",
            Self::T2 => "leaping from frame to frame, super-sampling (Klein et al.)",
            Self::T3 => "layers of samples over a quadtree (VDLS)",
            Self::T4 => {
                "early ray termination (ERT) and empty-space skipping (ESS) in passes (Krüger, Westermann)"
            }
            Self::T5 => "slabs in shared memory (Mensmann et al.)",
        }
    }
}

/// What is seen of a volume.
#[derive(Clone, Debug)]
pub struct SeedPictures {
    /// The transfer function where samples are composited.
    pub composited: TransferFunction,
    /// The same where one value of a ray is classified, and in mode xray.
    pub projected: TransferFunction,
    /// Length for which the opacity holds, mm; `None`: the smallest spacing of level 0.
    pub opacity_unit_mm: Option<f64>,
    /// The value of the surface, physical.
    pub iso: f64,
    /// The upper end of the default window, physical.
    pub window_end: f64,
    /// Which level is drawn. By distance no data would be finer than the screen.
    pub lod: LodChoice,
    /// Width and height of the pictures, pixels; where sizes are compared, they are halves of this.
    pub size: u32,
}

impl SeedPictures {
    /// The value of the surface when none is given: in the middle of the default window.
    pub fn default_iso(meta: &StoreMeta) -> f64 {
        let [low, high] = default_window(meta);
        0.5 * (low + high)
    }

    /// The interval between two surfaces: from the value half of the way to the end of the window, or as far beyond it.
    pub fn interval(&self) -> [f64; 2] {
        let reach = 0.5 * (self.window_end - self.iso).abs();
        // A value at the very end: any interval will do.
        let least = 1e-3 * self.iso.abs().max(1e-3);
        [self.iso, self.iso + reach.max(least)]
    }
}

/// A volume to compare the systems on.
#[derive(Clone, Debug)]
pub struct SeedJob {
    /// What the volume is called in the report.
    pub vol: String,
    /// Which systems; each is measured once, in order.
    pub tables: Vec<SeedTable>,
    /// What is seen.
    pub pictures: SeedPictures,
    /// Timed frames of the turn, from 1 to 360.
    pub frames: u32,
    /// Turns, at least 1.
    pub repeats: u32,
}

/// One way of drawing one picture. Fields are null where they can't be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedRow {
    /// `T1` to `T5`.
    pub table: String,
    /// The store's name, without folder and extension.
    pub vol: String,
    /// What is drawn, in words.
    pub picture: String,
    /// How, in words.
    pub configuration: String,
    /// `gpu` or `cpu`; empty where nothing could be drawn.
    pub device: String,
    /// The mode's name on the command line.
    pub mode: String,
    /// The technique's.
    pub technique: String,
    /// `WIDTHxHEIGHT`, pixels.
    pub size: String,
    /// Distance of samples in units of the smallest spacing.
    pub step: f64,
    /// The level of the samples nearest to the eye; null where nothing could be drawn.
    pub level: Option<u8>,
    /// Values of the surfaces, physical.
    pub iso: Vec<f64>,
    /// Timed frames of a turn.
    pub frames: u32,
    /// Turns.
    pub repeats: u32,
    /// Wall time per frame, ms.
    pub wall_ms: Option<f64>,
    /// User and system time of the whole process per frame, ms.
    pub cpu_ms: Option<f64>,
    /// Sum of the passes by the device's timestamps per frame, ms.
    pub gpu_ms: Option<f64>,
    /// Which of the three the speed-up is of: `cpu`, `gpu` or `wall`.
    pub clock: String,
    /// Samples of a pixel (mean).
    pub samples_per_pixel: Option<f64>,
    /// Those that changed the picture.
    pub contributing_per_pixel: Option<f64>,
    /// The configuration that the speed-up is against.
    pub against: Option<String>,
    /// That one's time ÷ this one's: the median of the repeats.
    pub speed_up: Option<f64>,
    /// The least of the repeats.
    pub speed_up_least: Option<f64>,
    /// The greatest.
    pub speed_up_greatest: Option<f64>,
    /// What the system reported of the same comparison.
    pub theirs: Vec<Reported>,
    /// The configuration whose pictures this one's should be.
    pub error_against: Option<String>,
    /// Root mean square of the differences from those, over black, in 255ths: the median of the frames.
    pub error_rms: Option<f64>,
    /// The 99.9th percentile over the pixels, likewise.
    pub error_p99_9: Option<f64>,
    /// Of technique layers, per frame: nodes of the quadtree.
    pub layer_nodes: Option<f64>,
    /// Passes over them.
    pub layer_passes: Option<f64>,
    /// Layers of a cell of 16×16 pixels: the most samples that one of its rays may have to take (mean over the cells).
    pub cell_layers: Option<f64>,
    /// The most samples that one of them took (mean).
    pub cell_most: Option<f64>,
    /// Share of the level's bricks that have an active block.
    pub bricks_active: Option<f64>,
    /// Share of its blocks of 4³ voxels that are active.
    pub blocks_active: Option<f64>,
    /// Why there are no figures.
    pub note: Option<String>,
    /// The graphics adapter's name; null on the CPU.
    pub adapter: Option<String>,
    /// Of this program.
    pub version: String,
}

impl SeedRow {
    /// Columns of words.
    const WORDS: usize = 3;

    /// Volume and picture.
    fn subject(&self) -> String {
        format!("{} {}", self.vol, self.picture)
    }
}

impl Row for SeedRow {
    const BENCH: &'static str = "seeds";
    const BARS_UNIT: &'static str = "times as fast";
    const COLUMNS: &'static [&'static str] = &[
        "picture",
        "drawn by",
        "against",
        "CPU ms",
        "wall ms",
        "GPU ms",
        "samples/pixel",
        "ours ×",
        "repeats ×",
        "theirs ×",
        "RMS /255",
        "99.9 % /255",
    ];

    fn name(&self) -> String {
        let Self {
            table,
            vol,
            picture,
            configuration,
            size,
            step,
            device,
            ..
        } = self;
        let level = self.level.map_or("–".into(), |level| level.to_string());
        let iso: Vec<String> = self.iso.iter().map(f64::to_string).collect();
        let iso = if iso.is_empty() {
            String::new()
        } else {
            format!(" iso {}", iso.join("+"))
        };
        format!(
            "{table} {vol} {picture}: {configuration} {size} step {step} level {level}{iso} {device}"
        )
    }

    fn times(&self) -> Vec<NamedTime> {
        vec![("cpu_ms", self.cpu_ms), ("wall_ms", self.wall_ms)]
    }

    fn bars(&self) -> Vec<NamedTime> {
        let Some(ours) = self.speed_up else {
            return Vec::new();
        };
        let theirs = self.theirs.iter().map(|r| r.ratio);
        vec![
            ("ours", Some(ours)),
            ("theirs, least", theirs.clone().reduce(f64::min)),
            ("theirs, greatest", theirs.reduce(f64::max)),
        ]
    }

    fn cells(&self) -> Vec<String> {
        let span = |least: Option<f64>, greatest: Option<f64>| match (least, greatest) {
            (Some(least), Some(greatest)) if least < greatest => {
                format!("{least:.2}–{greatest:.2}")
            }
            (least, _) => figure(least, 2),
        };
        let theirs = self.theirs.iter().map(|r| r.ratio);
        let least = theirs.clone().reduce(f64::min);
        vec![
            self.subject(),
            self.configuration.clone(),
            self.against.clone().unwrap_or_else(|| "–".into()),
            figure(self.cpu_ms, 1),
            figure(self.wall_ms, 1),
            figure(self.gpu_ms, 2),
            figure(self.samples_per_pixel, 1),
            figure(self.speed_up, 2),
            span(self.speed_up_least, self.speed_up_greatest),
            span(least, theirs.reduce(f64::max)),
            figure(self.error_rms, 2),
            figure(self.error_p99_9, 1),
        ]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::classify::grey_ramp;

    /// A volume with values from 0 to 200.
    pub(in crate::bench) fn pictures() -> SeedPictures {
        let ramp = |top| grey_ramp(0.0, 200.0, top).expect("a window");
        SeedPictures {
            composited: ramp(0.5),
            projected: ramp(1.0),
            opacity_unit_mm: None,
            iso: 100.0,
            window_end: 200.0,
            lod: LodChoice::Auto,
            size: 512,
        }
    }

    #[test]
    fn an_interval_has_two_ends() {
        for (iso, expected) in [(100.0, [100.0, 150.0]), (300.0, [300.0, 350.0])] {
            let pictures = SeedPictures { iso, ..pictures() };
            assert_eq!(pictures.interval(), expected);
        }
        for iso in [200.0, 0.0, -50.0] {
            let window_end = iso;
            let [low, high] = SeedPictures {
                iso,
                window_end,
                ..pictures()
            }
            .interval();
            assert!(low < high, "{low} {high}");
        }
    }
}
