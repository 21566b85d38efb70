//! Drawing the configurations of a comparison in turns, and the figures of that.

use super::SeedRow;
use super::difference::Difference;
use super::plan::{Column, Comparison, Drawing, comparisons};
use super::{SeedJob, SeedTable};
use crate::bench::error::BenchError;
use crate::bench::summary::{mean, median, rounded};
use crate::bench::turn::Turn;
use crate::clock::Stopwatch;
use crate::engine::{ActiveShare, Engine, EngineError, Picture};
use crate::scene::{CellSamples, Image, PictureSettings};

/// Cameras of the whole turn, of which some are timed: a degree from one to the next.
const CAMERAS: u32 = 360;

/// Why there are no figures of a frame that was to leap.
const NO_LEAP: &str =
    "nothing was leapt over: the device doesn't leap, or has too little memory for it";

/// What one configuration did.
#[derive(Debug, Default)]
struct Measured {
    /// Time of each repeat's turn, ms per frame.
    wall_ms: Vec<f64>,
    /// By the clock of the process; empty without one.
    cpu_ms: Vec<f64>,
    /// By the device's timestamps; empty without them.
    gpu_ms: Vec<f64>,
    /// Per pixel, frame by frame.
    samples: Vec<f64>,
    /// Those that changed the picture; empty where they aren't counted.
    contributing: Vec<f64>,
    /// Against the exact pictures, frame by frame.
    differences: Vec<Difference>,
    /// Of technique layers, frame by frame: nodes, passes, and means over the cells of their layers and of the most that a ray
    /// took.
    layers: Vec<[f64; 4]>,
    active: Option<ActiveShare>,
    /// Of the samples nearest to the eye.
    level: Option<u8>,
    device: String,
    adapter: Option<String>,
    /// Why there are no figures.
    refused: Option<String>,
}

/// Sums over a turn.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    wall_ms: f64,
    cpu_ms: Option<f64>,
    gpu_ms: Option<f64>,
    frames: u32,
}

/// Which time is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clock {
    Cpu,
    Gpu,
    Wall,
}

impl Clock {
    const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Wall => "wall",
        }
    }

    fn of(self, measured: &Measured) -> &[f64] {
        match self {
            Self::Cpu => &measured.cpu_ms,
            Self::Gpu => &measured.gpu_ms,
            Self::Wall => &measured.wall_ms,
        }
    }
}

/// How many times as fast as another configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SpeedUp {
    median: f64,
    least: f64,
    greatest: f64,
}

impl SpeedUp {
    /// From the times of both, repeat by repeat: what hit one repeat hit both.
    fn of(baseline_ms: &[f64], own_ms: &[f64]) -> Option<Self> {
        if baseline_ms.len() != own_ms.len() || own_ms.iter().any(|&ms| ms <= 0.0) {
            return None;
        }
        let ratios: Vec<f64> = (baseline_ms.iter().zip(own_ms))
            .map(|(baseline, own)| baseline / own)
            .collect();
        Some(Self {
            median: median(&ratios)?,
            least: ratios.iter().copied().fold(f64::INFINITY, f64::min),
            greatest: ratios.iter().copied().fold(0.0, f64::max),
        })
    }
}

impl SeedJob {
    /// Measures all comparisons of the tables.
    ///
    /// A device's refusal of a configuration is no error: its row has a note instead of figures.
    ///
    /// # Errors
    /// A brick can't be read, or the device fails.
    pub fn measure(&self, engine: &mut Engine) -> Result<Vec<SeedRow>, BenchError> {
        let mut tables: Vec<SeedTable> = self.tables.clone();
        tables.sort_unstable();
        tables.dedup();
        let mut rows = Vec::new();
        for table in tables {
            for comparison in comparisons(table, &self.pictures) {
                let measured = self.draw(engine, &comparison)?;
                rows.extend(self.rows(engine.draws_on_processor(), &comparison, &measured));
            }
        }
        name_devices(&mut rows);
        Ok(rows)
    }

    /// Draws all configurations of a comparison, frame by frame in turns.
    fn draw(
        &self,
        engine: &mut Engine,
        comparison: &Comparison,
    ) -> Result<Vec<Measured>, BenchError> {
        let columns = &comparison.columns;
        let mut measured: Vec<Measured> = Vec::new();
        for column in columns {
            measured.push(Measured::begin(engine, column)?);
        }
        let is_exact = |number: usize| columns.iter().any(|c| c.exact == Some(number));
        for repeat in 0..self.repeats {
            let mut sums = vec![Sums::default(); columns.len()];
            for frame in 0..self.frames {
                let mut images: Vec<Option<Image>> = vec![None; columns.len()];
                // Each is once the first.
                let first = (repeat + frame) as usize;
                for number in (0..columns.len()).map(|n| (n + first) % columns.len()) {
                    if measured[number].refused.is_some() {
                        continue;
                    }
                    let sums = &mut sums[number];
                    match self.frame(engine, &columns[number], frame, repeat == 0, sums) {
                        Ok(picture) if !drew_so(&columns[number], &picture) => {
                            measured[number].refused = Some(NO_LEAP.into());
                        }
                        Ok(picture) if repeat == 0 => {
                            measured[number].count(&picture);
                            if columns[number].exact.is_some() || is_exact(number) {
                                images[number] = Some(picture.image);
                            }
                        }
                        Ok(_) => {}
                        Err(error) => measured[number].refused = Some(refusal(error)?),
                    }
                }
                for (number, column) in columns.iter().enumerate() {
                    let exact = column.exact.and_then(|n| images[n].as_ref());
                    let pair = images[number].as_ref().zip(exact);
                    let difference = pair.and_then(|(own, exact)| Difference::of(own, exact));
                    measured[number].differences.extend(difference);
                }
            }
            for (measured, sums) in measured.iter_mut().zip(sums) {
                measured.end_turn(&sums);
            }
        }
        Ok(measured)
    }

    /// Draws one frame, and before it the one from a degree before, as a moving camera does: so nothing of what another
    /// configuration left is counted, and what leaps has something to leap from.
    fn frame(
        &self,
        engine: &mut Engine,
        column: &Column,
        number: u32,
        is_first: bool,
        sums: &mut Sums,
    ) -> Result<Picture, EngineError> {
        engine.set_slab(column.slab);
        let turn = Turn::new(&column.settings, engine.meta(), CAMERAS);
        let camera = number * CAMERAS / self.frames;
        let draw = |engine: &mut Engine, settings: &PictureSettings| match column.drawing {
            Drawing::Whole => engine.render(settings),
            Drawing::Moving => engine.draw_moving(settings),
        };
        let settings = turn.frame(camera);
        if is_first && column.drawing == Drawing::Moving {
            // What a moving frame draws must be resident.
            engine.render(&settings)?;
        }
        draw(engine, &turn.frame((camera + CAMERAS - 1) % CAMERAS))?;
        let watch = Stopwatch::start();
        let picture = draw(engine, &settings)?;
        let elapsed = watch.elapsed();
        let gpu_ms = picture.stats.passes_ms.as_ref().map(|p| p.values().sum());
        let plus = |sum: Option<f64>, ms: Option<f64>| match sums.frames {
            0 => ms,
            _ => sum.zip(ms).map(|(sum, ms)| sum + ms),
        };
        *sums = Sums {
            wall_ms: sums.wall_ms + elapsed.wall_ms,
            cpu_ms: plus(sums.cpu_ms, elapsed.cpu_ms),
            gpu_ms: plus(sums.gpu_ms, gpu_ms),
            frames: sums.frames + 1,
        };
        Ok(picture)
    }

    /// The rows of a comparison.
    fn rows(
        &self,
        on_processor: bool,
        comparison: &Comparison,
        measured: &[Measured],
    ) -> Vec<SeedRow> {
        let has = |clock: Clock| {
            let mut drawn = measured.iter().filter(|m| m.refused.is_none());
            drawn.all(|m| clock.of(m).len() == m.wall_ms.len())
        };
        let clock = match on_processor {
            true if has(Clock::Cpu) => Clock::Cpu,
            false if has(Clock::Gpu) => Clock::Gpu,
            _ => Clock::Wall,
        };
        let rows = comparison.columns.iter().zip(measured);
        rows.map(|(column, own)| {
            let speed_up = column.against.and_then(|(baseline, _)| {
                SpeedUp::of(clock.of(&measured[baseline]), clock.of(own))
            });
            let difference = Difference::medians(&own.differences);
            let [width, height] = column.settings.size;
            let of_active = |part: fn(&ActiveShare) -> [u64; 2]| {
                let [part, all] = part(own.active.as_ref()?);
                (all > 0).then(|| rounded_share(part as f64 / all as f64))
            };
            let time = |times: &[f64]| median(times).map(rounded);
            let of_layers = |n: usize| mean(own.layers.iter().map(|l| l[n])).map(rounded);
            SeedRow {
                table: comparison.table.name().into(),
                vol: self.vol.clone(),
                picture: comparison.picture.clone(),
                configuration: column.name.clone(),
                device: own.device.clone(),
                mode: column.settings.mode.name().into(),
                technique: column.settings.technique.name().into(),
                size: format!("{width}x{height}"),
                step: column.settings.step,
                level: own.level,
                iso: column
                    .settings
                    .classification
                    .iso
                    .iter()
                    .map(|s| s.value)
                    .collect(),
                frames: self.frames,
                repeats: self.repeats,
                wall_ms: time(&own.wall_ms),
                cpu_ms: time(&own.cpu_ms),
                gpu_ms: time(&own.gpu_ms),
                clock: clock.name().into(),
                samples_per_pixel: mean(own.samples.iter().copied()).map(rounded),
                contributing_per_pixel: mean(own.contributing.iter().copied()).map(rounded),
                against: column
                    .against
                    .map(|(baseline, _)| comparison.columns[baseline].name.clone()),
                speed_up: speed_up.map(|s| rounded(s.median)),
                speed_up_least: speed_up.map(|s| rounded(s.least)),
                speed_up_greatest: speed_up.map(|s| rounded(s.greatest)),
                theirs: column
                    .against
                    .map_or_else(Vec::new, |(_, theirs)| theirs.to_vec()),
                error_against: column.exact.map(|n| comparison.columns[n].name.clone()),
                error_rms: difference.map(|d| rounded(d.rms)),
                error_p99_9: difference.map(|d| rounded(d.p99_9)),
                layer_nodes: of_layers(0),
                layer_passes: of_layers(1),
                cell_layers: of_layers(2),
                cell_most: of_layers(3),
                bricks_active: of_active(|a| [a.bricks_active, a.bricks]),
                blocks_active: of_active(|a| [a.blocks_active, a.blocks]),
                note: own.refused.clone(),
                adapter: own.adapter.clone(),
                version: env!("CARGO_PKG_VERSION").into(),
            }
        })
        .collect()
    }
}

impl Measured {
    /// Nothing yet, but what can be told before anything is drawn.
    ///
    /// # Errors
    /// The device fails, or a brick can't be read.
    fn begin(engine: &Engine, column: &Column) -> Result<Self, BenchError> {
        let mut own = Self::default();
        if !engine.has_technique(column.settings.technique) {
            own.refused = Some("the device draws it by technique default".into());
        } else if column.counts_active {
            match engine.active_share(&column.settings) {
                Ok(active) => own.active = Some(active),
                Err(error) => own.refused = Some(refusal(error)?),
            }
        }
        Ok(own)
    }

    /// Takes the counts of a frame.
    fn count(&mut self, picture: &Picture) {
        let stats = &picture.stats;
        let pixels = picture.image.pixels.len().max(1) as f64;
        self.samples.push(stats.samples as f64 / pixels);
        let contributing = stats.samples_contributing;
        self.contributing
            .extend(contributing.map(|n| n as f64 / pixels));
        self.layers.extend(stats.layers.as_ref().map(|layers| {
            let of_cells = |part: fn(&CellSamples) -> u32| {
                mean(layers.cells.iter().map(|c| f64::from(part(c)))).unwrap_or(0.0)
            };
            [
                layers.nodes as f64,
                layers.passes as f64,
                of_cells(|c| c.layers),
                of_cells(|c| c.most),
            ]
        }));
        self.level = Some(stats.lod);
        self.device.clone_from(&stats.device);
        self.adapter.clone_from(&stats.adapter);
    }

    /// Takes the times of a turn; those of one that was refused on its way count for nothing.
    fn end_turn(&mut self, sums: &Sums) {
        if self.refused.is_some() {
            *self = Self {
                refused: self.refused.take(),
                active: self.active,
                ..Self::default()
            };
            return;
        }
        let per_frame = |ms: f64| ms / f64::from(sums.frames.max(1));
        self.wall_ms.push(per_frame(sums.wall_ms));
        self.cpu_ms.extend(sums.cpu_ms.map(per_frame));
        self.gpu_ms.extend(sums.gpu_ms.map(per_frame));
    }
}

/// Did the frame come about as the column says?
fn drew_so(column: &Column, picture: &Picture) -> bool {
    !column.settings.leap || picture.stats.leapt
}

/// Pictures tell what drew them; what was refused would have been drawn by the same.
fn name_devices(rows: &mut [SeedRow]) {
    let drawn = rows.iter().find(|r| !r.device.is_empty());
    let Some((device, adapter)) = drawn.map(|r| (r.device.clone(), r.adapter.clone())) else {
        return;
    };
    for row in rows.iter_mut().filter(|r| r.device.is_empty()) {
        row.device.clone_from(&device);
        row.adapter.clone_from(&adapter);
    }
}

/// Four decimals: shares may be small.
fn rounded_share(share: f64) -> f64 {
    (share * 1e4).round() / 1e4
}

/// Why a device won't draw a configuration, in words.
///
/// # Errors
/// It is no refusal but a failure.
fn refusal(error: EngineError) -> Result<String, BenchError> {
    match error {
        EngineError::TooManyBricks { .. }
        | EngineError::SlabLimit { .. }
        | EngineError::GpuMemory { .. }
        | EngineError::Atlas { .. }
        | EngineError::Mesh(_) => Ok(error.to_string()),
        error => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bench::seeds::tests::pictures;
    use crate::bench::seeds::{SeedPictures, SeedTable};
    use crate::bricking::{BrickOptions, NoProgress, brick};
    use crate::engine::{DeviceChoice, EngineOptions};
    use crate::input;
    use crate::store::Store;

    /// The reference renderer draws every mode and setting, but has two techniques and doesn't leap.
    #[test]
    fn what_can_be_drawn_has_figures_and_errors_fall_with_more_rays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.bsk");
        let mut source = input::open("phantom:body:32,32,32", &Default::default()).unwrap();
        brick(&mut *source, &path, &BrickOptions::default(), &NoProgress).unwrap();
        let options = EngineOptions {
            device: DeviceChoice::Reference,
            ..EngineOptions::default()
        };
        let store = Arc::new(Store::open(&path).unwrap());
        let mut engine = Engine::with_store(store, options).unwrap();
        let job = SeedJob {
            vol: "s".into(),
            tables: SeedTable::ALL.to_vec(),
            pictures: SeedPictures {
                size: 16,
                iso: 60.0,
                ..pictures()
            },
            frames: 2,
            repeats: 1,
        };
        let rows = job.measure(&mut engine).unwrap();
        for row in &rows {
            let is_drawn = row.note.is_none();
            let has_it = ["basic", "default"].contains(&&*row.technique)
                && !row.configuration.ends_with("leaping");
            assert_eq!(is_drawn, has_it, "{row:?}");
            assert_eq!(row.wall_ms.is_some_and(|ms| ms > 0.0), is_drawn, "{row:?}");
            let baseline = row.against.as_ref().and_then(|name| {
                let same = |r: &&SeedRow| r.picture == row.picture && r.configuration == *name;
                rows.iter().filter(|r| r.table == row.table).find(same)
            });
            assert_eq!(
                row.speed_up.is_some(),
                is_drawn && baseline.is_some_and(|b| b.note.is_none()),
                "{row:?}"
            );
        }
        let rms = |configuration: &str| {
            let row = rows.iter().find(|r| r.configuration == configuration);
            row.and_then(|r| r.error_rms).expect(configuration)
        };
        let falling = ["1×", "4r× from 0.15 on", "4r× from 0.02 on"].map(rms);
        assert!(
            falling.is_sorted_by(|a, b| a >= b) && falling[0] > falling[2],
            "{falling:?}"
        );
        assert!(
            rms("1×") > rms("2×") && rms("2×") > rms("8×"),
            "{:?}",
            rms("8×")
        );
        assert!(rms("8×") > 0.0, "held against other pictures than its own");
    }

    #[track_caller]
    fn check(baseline: &[f64], own: &[f64], expected: [f64; 3]) {
        let found = SpeedUp::of(baseline, own).expect("times");
        let found = [found.least, found.median, found.greatest];
        assert_eq!(found, expected, "of {baseline:?} and {own:?}");
    }

    #[test]
    fn speed_up_is_the_median_of_the_repeats_ratios() {
        // 2, 4 and 3 times as fast; the ratio of the medians would be 20 ÷ 5.
        check(&[20.0, 20.0, 60.0], &[10.0, 5.0, 20.0], [2.0, 3.0, 4.0]);
        // Twice as slow a machine in the second repeat changes nothing.
        check(&[10.0, 20.0], &[5.0, 10.0], [2.0; 3]);
        assert_eq!(SpeedUp::of(&[], &[]), None, "never measured");
        assert_eq!(SpeedUp::of(&[1.0], &[]), None, "refused");
        assert_eq!(SpeedUp::of(&[1.0], &[0.0]), None, "too fast for the clock");
    }

    /// The test above sees the ratio upside down.
    #[test]
    #[should_panic(expected = "of [5.0]")]
    fn an_inverted_ratio_is_seen() {
        check(&[5.0], &[10.0], [2.0; 3]);
    }

    #[test]
    fn refusals_are_told_from_failures() {
        let little = EngineError::GpuMemory { given: 1, least: 2 };
        let note = refusal(little).unwrap();
        assert!(note.contains("too little"), "{note}");
        assert!(refusal(EngineError::Worker).is_err(), "a failure");
    }

    #[test]
    fn a_turn_that_was_refused_on_its_way_leaves_no_figures() {
        let sums = Sums {
            wall_ms: 30.0,
            cpu_ms: Some(60.0),
            gpu_ms: None,
            frames: 3,
        };
        let mut measured = Measured::default();
        measured.end_turn(&sums);
        assert_eq!(
            (&measured.wall_ms[..], &measured.cpu_ms[..]),
            (&[10.0][..], &[20.0][..])
        );
        assert!(measured.gpu_ms.is_empty(), "no timestamps");
        measured.refused = Some("too large".into());
        measured.end_turn(&sums);
        assert!(measured.wall_ms.is_empty() && measured.refused.is_some());
    }
}
