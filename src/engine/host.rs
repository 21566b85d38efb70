//! The CPU half of the engine: the renderer of one store, kept from picture to picture, and the picture that ticks draw.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use super::bare::{BareRate, BareRates};
use super::{
    DeviceChoice, EngineError, EngineOptions, Picture, StandIns, TickBudget, TickEvent, TickReport,
    prepare,
};
use crate::camera::Camera;
use crate::classify::SegmentTables;
use crate::clock::Stopwatch;
use crate::cpu::{CpuPicture, CpuRenderer, CpuTraffic, DenseArray, InstructionSet};
use crate::geom::Lod;
use crate::reference;
use crate::scene::{Image, PictureSettings, PictureStats, Technique};
use crate::store::Store;

/// Tiles, or other parts, that are in memory beside the picture at most: 16 MiB.
const TILES_AT_ONCE: u32 = 1024;
/// Tiles per thread that a tick draws before it looks at the clock, with one ray per pixel.
const TILES_PER_THREAD: u32 = 4;

/// A store and the renderer that draws it on the CPU.
#[derive(Debug)]
pub(super) struct HostDevice {
    store: Arc<Store>,
    renderer: Renderer,
    tables: SegmentTables,
    ram_bytes: u64,
    live: Option<Live>,
}

#[derive(Debug)]
enum Renderer {
    Fast(Box<CpuRenderer>),
    /// Keeps nothing from picture to picture.
    Reference,
}

/// The picture that was set.
#[derive(Debug)]
struct Live {
    settings: PictureSettings,
    /// What is still to be drawn, the last first; `None` before it is known.
    pending: Option<Vec<CpuPicture>>,
    /// What is drawn, or the picture before.
    image: Option<Image>,
    stats: PictureStats,
    begin: Instant,
    /// What had been read when it was set.
    before: CpuTraffic,
}

impl Live {
    fn is_converged(&self) -> bool {
        self.pending.as_ref().is_some_and(Vec::is_empty)
    }
}

impl HostDevice {
    pub(super) fn new(store: &Arc<Store>, options: &EngineOptions) -> Self {
        let renderer = match options.device {
            DeviceChoice::Reference => Renderer::Reference,
            _ => Renderer::Fast(Box::new(CpuRenderer::new(
                store,
                options.ram_bytes,
                options.instructions.unwrap_or_else(InstructionSet::best),
            ))),
        };
        Self {
            store: Arc::clone(store),
            renderer,
            tables: SegmentTables::default(),
            ram_bytes: options.ram_bytes,
            live: None,
        }
    }

    pub(super) fn name(&self) -> String {
        match &self.renderer {
            Renderer::Fast(renderer) => format!("CPU ({})", renderer.instructions().name()),
            Renderer::Reference => "CPU (reference renderer)".into(),
        }
    }

    /// Another bound of memory; what is decoded is dropped.
    pub(super) fn set_budget(&mut self, ram_bytes: u64) {
        self.ram_bytes = ram_bytes;
        if let Renderer::Fast(renderer) = &mut self.renderer {
            **renderer = CpuRenderer::new(&self.store, ram_bytes, renderer.instructions());
        }
        // The new renderer counts from 0.
        if let Some(live) = &mut self.live {
            live.before = CpuTraffic::default();
        }
    }

    /// Drops what is decoded.
    pub(super) fn forget(&self) {
        if let Renderer::Fast(renderer) = &self.renderer {
            renderer.forget();
        }
    }

    /// Draws a picture.
    pub(super) fn render(&mut self, settings: &PictureSettings) -> Result<Picture, EngineError> {
        let (image, stats) = match &mut self.renderer {
            Renderer::Fast(renderer) => {
                let before = renderer.traffic();
                let mut picture = begin(&self.store, &self.tables, settings)?;
                while !picture.is_done() {
                    renderer.draw(&mut picture, TILES_AT_ONCE)?;
                }
                let stats = stats_of(&picture, before, renderer.traffic());
                (picture.into_image(), stats)
            }
            Renderer::Reference => {
                draw_reference(&self.store, &self.tables, self.ram_bytes, settings)?
            }
        };
        Ok(Picture {
            image,
            stats,
            touched: Vec::new(),
            stand_ins: StandIns::default(),
            notes: technique_note(settings.technique).into_iter().collect(),
        })
    }

    /// See [`super::Engine::has_technique`].
    pub(super) fn has_technique(technique: Technique) -> bool {
        matches!(technique, Technique::Default | Technique::Basic)
    }

    /// Sets the picture that ticks draw.
    pub(super) fn set_live(&mut self, settings: PictureSettings) {
        if self.live_settings() == Some(&settings) {
            return;
        }
        self.live = Some(Live {
            settings,
            pending: None,
            image: self.live.take().and_then(|l| l.image),
            stats: PictureStats::default(),
            begin: Instant::now(),
            before: self.traffic(),
        });
    }

    pub(super) fn live_settings(&self) -> Option<&PictureSettings> {
        self.live.as_ref().map(|l| &l.settings)
    }

    pub(super) fn live_image(&self) -> Option<&Image> {
        self.live.as_ref().and_then(|l| l.image.as_ref())
    }

    pub(super) fn is_live_converged(&self) -> bool {
        self.live.as_ref().is_some_and(Live::is_converged)
    }

    pub(super) fn live_stats(&self) -> Option<PictureStats> {
        self.live.as_ref().map(|l| l.stats.clone())
    }

    /// A piece of work on the picture that was set: first from coarser levels, then exact. The reference renderer draws it
    /// all at once.
    pub(super) fn tick(&mut self, budget: &TickBudget) -> Result<TickReport, EngineError> {
        let Some(mut live) = self.live.take() else {
            return Ok(TickReport::default());
        };
        let event = if live.is_converged() {
            Ok(None)
        } else {
            self.advance(&mut live, budget)
        };
        if event.is_err() {
            // The next tick begins again: what can't be read may be there by then.
            live.pending = None;
        }
        let converged = live.is_converged();
        self.live = Some(live);
        Ok(TickReport {
            event: event?,
            converged,
            ..TickReport::default()
        })
    }

    fn advance(
        &mut self,
        live: &mut Live,
        budget: &TickBudget,
    ) -> Result<Option<TickEvent>, EngineError> {
        let begun = Instant::now();
        let Renderer::Fast(renderer) = &mut self.renderer else {
            let picture = self.render(&live.settings)?;
            (live.image, live.stats) = (Some(picture.image), picture.stats);
            live.pending = Some(Vec::new());
            mark(live, TickEvent::Converged);
            return Ok(Some(TickEvent::Converged));
        };
        let pending = match &mut live.pending {
            Some(pending) => pending,
            None => live
                .pending
                .insert(plan(&self.store, &self.tables, &live.settings)?),
        };
        let Some(picture) = pending.last_mut() else {
            return Ok(None);
        };
        let threads = rayon::current_num_threads() as u32;
        while !picture.is_done() {
            if begun.elapsed() >= budget.time {
                return Ok(None);
            }
            let tiles = TILES_PER_THREAD.div_ceil(picture.rays_per_pixel() as u32);
            renderer.draw(picture, tiles * threads)?;
        }
        let mut stats = stats_of(picture, live.before, renderer.traffic());
        stats.first_complete_ms = live.stats.first_complete_ms;
        live.stats = stats;
        live.image = pending.pop().map(CpuPicture::into_image);
        let event = if pending.is_empty() {
            TickEvent::Converged
        } else {
            TickEvent::Whole
        };
        mark(live, event);
        Ok(Some(event))
    }

    /// See [`super::Engine::measure_bare`].
    pub(super) fn measure_bare(
        &mut self,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<Option<BareRates>, EngineError> {
        let Renderer::Fast(renderer) = &self.renderer else {
            return Ok(None);
        };
        renderer.forget();
        let pictures: Vec<CpuPicture> = cameras
            .iter()
            .map(|&camera| {
                let settings = PictureSettings {
                    camera,
                    ..settings.clone()
                };
                begin(&self.store, &self.tables, &settings)
            })
            .collect::<Result<_, _>>()?;
        let levels: BTreeSet<Lod> = pictures
            .iter()
            .flat_map(|p| p.frame().used().iter().map(|level| level.lod))
            .collect();
        let mut rates = Vec::new();
        for lod in levels {
            let Some(dense) = DenseArray::read(&self.store, lod)? else {
                return Ok(None);
            };
            let sampling = |p: &&CpuPicture| p.frame().used().iter().any(|l| l.lod == lod);
            for (n, picture) in pictures.iter().filter(sampling).enumerate() {
                if n == 0 {
                    dense.cast(picture, renderer.instructions());
                }
                let watch = Stopwatch::start();
                let samples = dense.cast(picture, renderer.instructions());
                let elapsed = watch.elapsed();
                rates.push(BareRate {
                    samples,
                    wall_ms: elapsed.wall_ms,
                    cpu_ms: elapsed.cpu_ms,
                    gpu_ms: None,
                });
            }
        }
        Ok(Some(BareRates {
            exact: BareRate::sum(&rates),
            filtered: None,
            on_processor: true,
        }))
    }

    fn traffic(&self) -> CpuTraffic {
        match &self.renderer {
            Renderer::Fast(renderer) => renderer.traffic(),
            Renderer::Reference => CpuTraffic::default(),
        }
    }
}

/// Notes when a picture came.
fn mark(live: &mut Live, event: TickEvent) {
    let now_ms = live.begin.elapsed().as_secs_f64() * 1e3;
    live.stats.first_complete_ms.get_or_insert(now_ms);
    live.stats.wall_ms = now_ms;
    if event == TickEvent::Converged {
        live.stats.converged = true;
        live.stats.converged_ms = Some(now_ms);
    }
}

/// That another technique draws than the one asked for.
fn technique_note(technique: Technique) -> Option<String> {
    (!HostDevice::has_technique(technique)).then(|| {
        format!(
            "technique {} is one of graphics adapters; on the CPU technique default draws the same picture",
            technique.name()
        )
    })
}

/// A picture made ready to be drawn.
fn begin(
    store: &Store,
    tables: &SegmentTables,
    settings: &PictureSettings,
) -> Result<CpuPicture, EngineError> {
    let (frame, classified) = prepare(store, tables, settings)?;
    for level in frame.used() {
        let bricks = store.level(level.lod).grid.len();
        if bricks > CpuRenderer::MAX_BRICKS {
            return Err(EngineError::TooManyBricks {
                lod: level.lod.0,
                bricks,
                most: CpuRenderer::MAX_BRICKS,
            });
        }
    }
    Ok(CpuPicture::new(frame, classified, settings.clone()))
}

/// What leads to the exact picture, the last first.
fn plan(
    store: &Store,
    tables: &SegmentTables,
    settings: &PictureSettings,
) -> Result<Vec<CpuPicture>, EngineError> {
    let exact = begin(store, tables, settings)?;
    let coarse = match settings.first_whole() {
        Some(settings) => Some(begin(store, tables, &settings)?),
        None => None,
    };
    let is_coarser = |p: &CpuPicture| p.frame().used() != exact.frame().used();
    let coarse = coarse.filter(is_coarser);
    Ok(std::iter::once(exact).chain(coarse).collect())
}

fn stats_of(picture: &CpuPicture, before: CpuTraffic, after: CpuTraffic) -> PictureStats {
    let counts = picture.counts();
    PictureStats {
        device: "cpu".into(),
        rays: picture.rays(),
        samples: counts.samples,
        samples_skipped: counts.skipped,
        samples_contributing: Some(counts.contributing),
        bricks_read: Some(after.bricks_read - before.bricks_read),
        bytes_read: Some(after.bytes_read - before.bytes_read),
        bytes_decompressed: Some(after.bytes_decompressed - before.bytes_decompressed),
        bricks_visible: Some(picture.visible()),
        lod: picture.frame().levels[0].lod.0,
        ..PictureStats::default()
    }
}

fn draw_reference(
    store: &Store,
    tables: &SegmentTables,
    ram_bytes: u64,
    settings: &PictureSettings,
) -> Result<(Image, PictureStats), EngineError> {
    let (rays, classified) = prepare(store, tables, settings)?;
    let share = ram_bytes / rays.used_levels as u64;
    let mut fields = Vec::with_capacity(rays.used_levels);
    for level in rays.used() {
        store.check_level(level.lod)?;
        fields.push(reference::VoxelField::new(store, level.lod, share));
    }
    let drawn = reference::render(&fields, &rays, &classified, settings)?;
    let stats = PictureStats {
        device: "cpu".into(),
        rays: drawn.rays,
        samples: drawn.counts.samples,
        samples_skipped: drawn.counts.skipped,
        samples_contributing: Some(drawn.counts.contributing),
        bricks_read: Some(drawn.bricks_read),
        lod: rays.levels[0].lod.0,
        ..PictureStats::default()
    };
    Ok((drawn.image, stats))
}
