//! Pictures with stand-ins, drawn at once: where a brick is missing, the nearest coarser one that is resident. Those that
//! ticks draw, and those of [`super::super::Engine::draw_moving`].

use std::collections::BTreeMap;

use crate::geom::BrickId;
use crate::pager::{FrameRequests, Request, RequestClass};
use crate::render::{Cast, Feedback, PendingFeedback, Renderer};
use crate::scene::{AntiAliasing, Image, PictureSettings, RayCounts, RayFrame};

use super::super::{EngineError, Picture, StandIns, TickBudget};
use super::plan::PicturePlan;
use super::{GpuDevice, ROOM};

/// Work-groups of a draft's dispatch: 2¹⁶ rays, on the CPU all of a tile.
const DRAFT_GROUPS: [usize; 2] = [1 << 10, 1 << 14];

/// Points and starts of leaping take at most this part of the memory; pictures that are larger don't leap.
const LEAP_SHARE: u64 = 8;

/// A draft that was drawn.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) image: Image,
    pub(super) counts: RayCounts,
    /// Did rays start where the frame before allowed it?
    pub(super) leapt: bool,
}

/// What a draft asked for.
#[derive(Debug)]
pub(super) struct Asked {
    pub(super) missing: Vec<BrickId>,
    /// Bricks that it was drawn from.
    pub(super) touched: Vec<BrickId>,
    /// What stood in for the missing ones.
    pub(super) stand_ins: StandIns,
    /// Both fit the atlas together.
    pub(super) fits: bool,
}

impl GpuDevice {
    /// Draws one frame of a moving picture.
    pub(in crate::engine) fn draw_moving(
        &mut self,
        settings: &PictureSettings,
    ) -> Result<Picture, EngineError> {
        let settings = self.leaping_if_allowed(PictureSettings {
            anti_aliasing: AntiAliasing::Off,
            ..settings.clone()
        });
        let plan = PicturePlan::new(&self.store, &self.tables, &settings)?;
        self.with_what_memory_there_is(|device| device.draw_moving_within(&plan))
    }

    fn draw_moving_within(&mut self, plan: &PicturePlan) -> Result<Picture, EngineError> {
        let before = self.traffic();
        let ready = self.work_out(vec![plan.clone()])?;
        let ready = self.make_ready(ready, ROOM)?;
        let (plan, mesh) = &ready.pictures[0];
        let inputs = plan.inputs();
        let tile = self.tile(&plan.settings);
        self.renderer.set_mesh(&self.gpu, mesh)?;
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: the picture was made ready")
        };
        self.renderer
            .begin_picture(&self.gpu, &inputs, &volume.residency, tile, true)?;
        volume.advance(&self.gpu, TickBudget::default().upload_bytes)?;
        let moving = Some(PictureSettings {
            leap: false,
            ..plan.settings.without_place()
        });
        let is_first = self.moving != moving;
        self.moving = moving;
        let mut missing_before = usize::MAX;
        let (drawn, asked) = loop {
            let mut pending = Vec::new();
            let drawn = self.draw_draft(plan, &mut pending)?;
            let mut reports = Vec::with_capacity(pending.len());
            for report in pending {
                reports.push(report.wait(&self.gpu)?);
            }
            let predicted = match &self.volume {
                // What the first frame loads it needs.
                Some(volume) if !is_first => self.foresight.requests(volume.capacity()),
                _ => Vec::new(),
            };
            let asked = self.ask(&plan.rays, &reports, &predicted);
            let missing = asked.missing.len();
            let Some(volume) = &mut self.volume else {
                unreachable!("invariant: as above")
            };
            if !is_first || missing == 0 || missing >= missing_before {
                if is_first {
                    let predicted = self.foresight.requests(volume.capacity());
                    self.ask(&plan.rays, &reports, &predicted);
                }
                break (drawn, asked);
            }
            missing_before = missing;
            volume.settle(&self.gpu)?;
        };
        let mut stats = self.stats(before)?;
        stats.converged = asked.missing.is_empty();
        stats.rays = drawn.image.pixels.len() as u64;
        stats.samples = drawn.counts.samples;
        stats.samples_skipped = drawn.counts.skipped;
        stats.samples_contributing = Some(drawn.counts.contributing);
        stats.bricks_requested = Some(asked.missing.len() as u64);
        stats.bricks_touched = Some(asked.touched.len() as u64);
        stats.bricks_visible = Some(ready.bricks.visible);
        stats.mesh_triangles = Some(mesh.triangle_count() as u64);
        stats.lod = plan.rays.levels[0].lod.0;
        stats.leapt = drawn.leapt;
        Ok(Picture {
            image: drawn.image,
            stats,
            touched: asked.touched,
            stand_ins: asked.stand_ins,
            notes: Vec::new(),
        })
    }

    /// The settings, without leaping where its textures would be too large.
    pub(super) fn leaping_if_allowed(&self, settings: PictureSettings) -> PictureSettings {
        let bytes = Renderer::leap_bytes(settings.size, self.tile(&settings));
        let edge = self.gpu.caps.limits.max_texture_dimension_2d;
        let is_allowed =
            bytes <= self.budget_bytes / LEAP_SHARE && settings.size.iter().all(|&s| s <= edge);
        PictureSettings {
            leap: settings.leap && is_allowed,
            ..settings
        }
    }

    /// Draws the whole picture with stand-ins. It must have been begun.
    pub(super) fn draw_draft(
        &mut self,
        plan: &PicturePlan,
        pending: &mut Vec<PendingFeedback>,
    ) -> Result<Drawn, EngineError> {
        let size = plan.settings.size;
        let tile = self.tile(&plan.settings);
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: a draft was begun on a volume")
        };
        let (gpu, renderer) = (&self.gpu, &mut self.renderer);
        let inputs = plan.inputs();
        let bricks = [
            volume.traffic.bricks_uploaded,
            volume.traffic.bricks_evicted,
        ];
        let leapt = plan.settings.leaps() && renderer.begin_leap(gpu, &inputs, bricks);
        let mut image = Image::clear(size);
        let mut counts = RayCounts::default();
        for tile in Renderer::tiles(size, tile) {
            renderer.begin_tile(gpu, &inputs, &volume.residency, &tile, None)?;
            if leapt {
                renderer.find_starts(gpu, &inputs, &tile);
            }
            // Rays of a draft don't stop: fewer of them keep a dispatch short.
            let at_once = DRAFT_GROUPS[usize::from(gpu.caps.is_software)];
            for groups in Renderer::groups(&tile, None, None).chunks(at_once) {
                let cast = Cast {
                    groups,
                    is_listed: false,
                    draft: true,
                    sample_limit: u32::MAX,
                };
                pending.push(renderer.cast(gpu, &inputs, &mut volume.residency, &tile, &cast)?);
            }
            counts += renderer.collect(gpu, &tile, None, [0, 1], &mut image)?;
        }
        if plan.settings.leaps() {
            renderer.end_leap(&inputs, bricks);
        }
        Ok(Drawn {
            image,
            counts,
            leapt,
        })
    }

    /// Asks for what the rays of a draft missed and, behind that, for what is predicted.
    pub(super) fn ask(
        &mut self,
        rays: &RayFrame,
        reports: &[Feedback],
        predicted: &[Request],
    ) -> Asked {
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: a draft was drawn from a volume")
        };
        let mut rays_of: BTreeMap<u32, u32> = BTreeMap::new();
        let mut touched: Vec<BrickId> = Vec::new();
        let mut stand_ins = StandIns::default();
        for report in reports {
            stand_ins.rays += u64::from(report.stopped);
            for missed in &report.missed {
                *rays_of.entry(missed.number).or_insert(0) += missed.rays;
            }
            touched.extend(volume.bricks_in(&report.used_slots));
        }
        touched.sort_unstable();
        touched.dedup();
        let mut requests: Vec<Request> = rays_of
            .into_iter()
            .map(|(number, stopped)| {
                let brick = volume.residency.brick(number);
                volume.request(rays, RequestClass::Missing, brick, stopped)
            })
            .collect();
        let missing: Vec<BrickId> = requests.iter().map(|r| r.brick).collect();
        for &brick in &missing {
            *stand_ins.bricks.entry(volume.stand_in(brick)).or_insert(0) += 1;
        }
        requests.extend(predicted);
        volume.begin_frame(&FrameRequests {
            requests: &requests,
            held: &[],
            touched: &touched,
            keep_touched: true,
        });
        Asked {
            fits: missing.len() + touched.len() <= volume.capacity(),
            missing,
            touched,
            stand_ins,
        }
    }
}
