//! The picture that changes: a whole one soon, refined while bricks come, exact in the end. Each tick does a bounded piece
//! of work and never waits for disk.
//!
//! | phase | what is drawn | ends when |
//! |---|---|---|
//! | Preparing | the picture before | a thread has worked out tables and mesh |
//! | Coarse | the exact picture from coarser levels | it is complete: the first whole picture |
//! | Draft | all levels, coarser bricks standing in for missing ones; again while bricks come | what it asked for is there, or as much as fits |
//! | Exact | the exact picture, tile by tile over the draft | it is complete |
//! | Converged | – | something is changed |
//! | Failed | – | something is changed: a brick can't be read, the draft shows a coarser one |

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use crate::geom::BrickId;
use crate::render::{Feedback, PendingFeedback};
use crate::scene::{Image, PictureSettings, PictureStats, RayCounts};

use super::super::{EngineError, TickBudget, TickEvent, TickReport};
use super::exact::{ExactRun, Progress, Wait};
use super::paged::Traffic;
use super::plan::{PicturePlan, ReadyPictures};
use super::{GpuDevice, ROOM, mesh_bytes};

/// How long a tick that can do nothing but wait for bricks waits for one.
const SHORT_WAIT: Duration = Duration::from_millis(2);

/// While bricks come, a draft is drawn again after so many times of what it took: loading gets the rest.
const DRAFT_PAUSE: u32 = 4;

type Job = Receiver<Result<ReadyPictures, EngineError>>;

/// A picture under way.
#[derive(Debug)]
pub(super) struct Live {
    settings: PictureSettings,
    phase: Phase,
    ready: Option<ReadyPictures>,
    image: Option<Image>,
    begun: Instant,
    before: Traffic,
    first_whole: Option<Duration>,
    converged: Option<Duration>,
    missing: u64,
    rays: u64,
    counts: RayCounts,
    touched: BTreeSet<BrickId>,
    requested: BTreeSet<BrickId>,
}

#[derive(Debug)]
enum Phase {
    /// `None`: the work is not begun yet.
    Preparing(Option<Job>),
    Coarse(ExactRun),
    Draft(Draft),
    Exact(ExactRun),
    Converged,
    Failed,
}

/// A picture with stand-ins.
#[derive(Debug, Default)]
struct Draft {
    /// Reports on their way.
    pending: Vec<PendingFeedback>,
    reports: Vec<Feedback>,
    /// What had been uploaded when it was drawn, when that was begun, and how long it took.
    drawn_at: Option<(u64, Instant, Duration)>,
    /// What the one before missed.
    missing_before: Option<u64>,
    /// Its reports have been answered with requests.
    is_answered: bool,
}

impl Live {
    fn new(settings: PictureSettings, image: Option<Image>, before: Traffic) -> Self {
        Self {
            settings,
            phase: Phase::Preparing(None),
            ready: None,
            image,
            begun: Instant::now(),
            before,
            first_whole: None,
            converged: None,
            missing: 0,
            rays: 0,
            counts: RayCounts::default(),
            touched: BTreeSet::new(),
            requested: BTreeSet::new(),
        }
    }

    /// Everything from the beginning; the last image stays until there is another.
    pub(super) fn restart(&mut self) {
        let image = self.image.take();
        *self = Self::new(self.settings.clone(), image, self.before);
    }

    fn is_converged(&self) -> bool {
        matches!(self.phase, Phase::Converged)
    }

    fn report(&self, device: PictureStats) -> PictureStats {
        let ms = |d: Option<Duration>| d.map(|d| d.as_secs_f64() * 1e3);
        let ready = self.ready.as_ref();
        PictureStats {
            wall_ms: self.begun.elapsed().as_secs_f64() * 1e3,
            first_complete_ms: ms(self.first_whole),
            converged_ms: ms(self.converged),
            converged: self.is_converged(),
            rays: self.rays,
            samples: self.counts.samples,
            samples_skipped: self.counts.skipped,
            samples_contributing: Some(self.counts.contributing),
            bricks_visible: ready.map(|r| r.bricks.visible),
            bricks_requested: Some(self.requested.len() as u64),
            bricks_touched: Some(self.touched.len() as u64),
            mesh_triangles: ready
                .and_then(|r| r.pictures.last())
                .map(|(_, mesh)| mesh.triangle_count() as u64),
            lod: ready.map_or(0, |r| r.final_plan().rays.levels[0].lod.0),
            ..device
        }
    }

    /// Adds what a run did.
    fn add(&mut self, run: &ExactRun) {
        self.rays = run.rays_cast;
        self.counts = run.counts;
        self.touched.extend(&run.touched);
        self.requested.extend(&run.requested);
    }
}

impl GpuDevice {
    /// Sets what [`Self::tick`] draws.
    pub(in crate::engine) fn set_live(&mut self, settings: PictureSettings) {
        if self.live.as_ref().is_some_and(|l| l.settings == settings) {
            return;
        }
        let image = self.live.take().and_then(|l| l.image);
        if let Some(volume) = &mut self.volume {
            volume.retry_failed();
        }
        self.live = Some(Live::new(settings, image, self.traffic()));
    }

    pub(in crate::engine) fn live_settings(&self) -> Option<&PictureSettings> {
        self.live.as_ref().map(|l| &l.settings)
    }

    pub(in crate::engine) fn live_image(&self) -> Option<&Image> {
        self.live.as_ref().and_then(|l| l.image.as_ref())
    }

    pub(in crate::engine) fn is_live_converged(&self) -> bool {
        self.live.as_ref().is_some_and(Live::is_converged)
    }

    pub(in crate::engine) fn live_stats(&mut self) -> Result<Option<PictureStats>, EngineError> {
        let Some(live) = self.live.take() else {
            return Ok(None);
        };
        let stats = self.stats(live.before).map(|stats| live.report(stats));
        self.live = Some(live);
        stats.map(Some)
    }

    /// A piece of work on the picture that was set.
    pub(in crate::engine) fn tick(
        &mut self,
        budget: &TickBudget,
    ) -> Result<TickReport, EngineError> {
        let Some(mut live) = self.live.take() else {
            return Ok(TickReport::default());
        };
        let result = match self.tick_on(&mut live, budget) {
            // With less memory the same again.
            Err(error) => match self.with_less(error) {
                Ok(note) => {
                    tracing::warn!("{note}");
                    live.phase = Phase::Preparing(None);
                    Ok(None)
                }
                Err(error) => {
                    live.phase = Phase::Failed;
                    Err(error)
                }
            },
            done => done,
        };
        let failed_bricks = self.volume.as_ref().map_or(0, |v| v.failed_count());
        let report = TickReport {
            event: None,
            converged: live.is_converged(),
            missing_bricks: live.missing,
            failed_bricks,
        };
        self.live = Some(live);
        Ok(TickReport {
            event: result?,
            ..report
        })
    }

    fn tick_on(
        &mut self,
        live: &mut Live,
        budget: &TickBudget,
    ) -> Result<Option<TickEvent>, EngineError> {
        let deadline = Instant::now() + budget.time;
        let mut event = None;
        loop {
            let (step, is_stuck) = self.step_live(live, budget, deadline)?;
            event = step.or(event);
            if is_stuck || Instant::now() >= deadline {
                return Ok(event);
            }
        }
    }

    /// One step: what happened, and whether nothing more can be done now.
    fn step_live(
        &mut self,
        live: &mut Live,
        budget: &TickBudget,
        deadline: Instant,
    ) -> Result<(Option<TickEvent>, bool), EngineError> {
        let wait = Wait::Upload {
            bytes: budget.upload_bytes,
        };
        match &mut live.phase {
            Phase::Converged | Phase::Failed => Ok((None, true)),
            Phase::Preparing(job) => {
                let job = match job {
                    Some(job) => job,
                    None => job.insert(self.begin_job(&live.settings)),
                };
                let left = deadline.saturating_duration_since(Instant::now());
                let ready = match job.try_recv() {
                    Ok(ready) => ready?,
                    Err(TryRecvError::Empty) => match job.recv_timeout(left) {
                        Ok(ready) => ready?,
                        Err(_) => return Ok((None, true)),
                    },
                    Err(TryRecvError::Disconnected) => return Err(EngineError::Worker),
                };
                let ready = self.make_ready(ready, ROOM)?;
                let begins_coarse = ready.pictures.len() > 1;
                live.ready = Some(ready);
                live.phase = if begins_coarse {
                    Phase::Coarse(self.begin_run(live, 0)?)
                } else {
                    self.begin_draft(live)?
                };
                Ok((None, false))
            }
            Phase::Coarse(run) => {
                let (progress, _) = self.advance_run(run, live.ready.as_ref(), 0, wait)?;
                match progress {
                    Ok(Progress::Complete) => {
                        let run = std::mem::replace(&mut live.phase, Phase::Failed);
                        if let Phase::Coarse(run) = run {
                            live.add(&run);
                            live.image = Some(run.image);
                        }
                        live.first_whole.get_or_insert(live.begun.elapsed());
                        live.phase = self.begin_draft(live)?;
                        Ok((Some(TickEvent::Whole), false))
                    }
                    Ok(Progress::Advanced) => Ok((None, false)),
                    Ok(Progress::Waiting) => Ok((None, self.wait_for_brick(deadline))),
                    // A draft has stand-ins for what can't be read.
                    Err(_) => {
                        live.phase = self.begin_draft(live)?;
                        Ok((None, false))
                    }
                }
            }
            Phase::Draft(_) => self.step_draft(live, budget, deadline),
            Phase::Exact(run) => {
                let last = live.ready.as_ref().map_or(0, |r| r.pictures.len() - 1);
                let (progress, tile_done) =
                    self.advance_run(run, live.ready.as_ref(), last, wait)?;
                match progress {
                    Ok(Progress::Complete) => {
                        let run = std::mem::replace(&mut live.phase, Phase::Converged);
                        if let Phase::Exact(run) = run {
                            live.add(&run);
                            live.image = Some(run.image);
                        }
                        live.missing = 0;
                        live.first_whole.get_or_insert(live.begun.elapsed());
                        live.converged = Some(live.begun.elapsed());
                        Ok((Some(TickEvent::Converged), true))
                    }
                    Ok(Progress::Advanced) if tile_done => {
                        live.image = Some(run.image.clone());
                        Ok((Some(TickEvent::Refined), false))
                    }
                    Ok(Progress::Advanced) => Ok((None, false)),
                    Ok(Progress::Waiting) => Ok((None, self.wait_for_brick(deadline))),
                    Err(error) => {
                        tracing::warn!("the picture stays incomplete: {error}");
                        live.phase = Phase::Failed;
                        Ok((Some(TickEvent::Failed), true))
                    }
                }
            }
        }
    }

    /// Works out tables and mesh on a thread of their own.
    fn begin_job(&self, settings: &PictureSettings) -> Job {
        let (sender, job) = channel();
        let (store, tables) = (Arc::clone(&self.store), self.tables.clone());
        let settings = self.leaping_if_allowed(settings.clone());
        let (known, seen) = match &self.volume {
            Some(volume) => {
                let (known, seen) = volume.known();
                (known.clone(), seen.clone())
            }
            None => Default::default(),
        };
        let mesh_bytes = mesh_bytes(self.budget_bytes);
        std::thread::spawn(move || {
            let work = || {
                let plan = PicturePlan::new(&store, &tables, &settings)?;
                let mut plans = Vec::new();
                plans.extend(plan.first_whole(&store, &tables)?);
                plans.push(plan);
                ReadyPictures::new(&store, plans, (&known, &seen), mesh_bytes)
            };
            // A picture that nobody waits for any more is dropped.
            let _ = sender.send(work());
        });
        job
    }

    /// Sends what the picture number `number` of those that are ready is drawn from; returns that and the size of its tiles.
    fn begin_picture<'l>(
        &mut self,
        live: &'l Live,
        number: usize,
        draft: bool,
    ) -> Result<(&'l PicturePlan, [u32; 2]), EngineError> {
        let (Some(ready), Some(volume)) = (&live.ready, &self.volume) else {
            unreachable!("invariant: a picture begins when it is ready")
        };
        let (plan, mesh) = &ready.pictures[number];
        let tile = self.tile(&plan.settings);
        let inputs = plan.inputs();
        self.renderer.set_mesh(&self.gpu, mesh)?;
        self.renderer
            .begin_picture(&self.gpu, &inputs, &volume.residency, tile, draft)?;
        Ok((plan, tile))
    }

    fn begin_run(&mut self, live: &Live, number: usize) -> Result<ExactRun, EngineError> {
        let (plan, tile) = self.begin_picture(live, number, false)?;
        let base = live
            .image
            .as_ref()
            .filter(|i| [i.width, i.height] == plan.settings.size)
            .cloned();
        Ok(ExactRun::new(&self.gpu, &plan.inputs(), tile, base))
    }

    fn begin_draft(&mut self, live: &Live) -> Result<Phase, EngineError> {
        let last = live.ready.as_ref().map_or(0, |r| r.pictures.len() - 1);
        self.begin_picture(live, last, true)?;
        Ok(Phase::Draft(Draft::default()))
    }

    /// One step of a run. The outer error is the device's, the inner a brick's. Also: was a part finished?
    fn advance_run(
        &mut self,
        run: &mut ExactRun,
        ready: Option<&ReadyPictures>,
        number: usize,
        wait: Wait,
    ) -> Result<(Result<Progress, EngineError>, bool), EngineError> {
        let (Some(ready), Some(volume)) = (ready, &mut self.volume) else {
            unreachable!("invariant: a run was begun on a volume")
        };
        let inputs = ready.pictures[number].0.inputs();
        let before = run.parts_done;
        match run.advance(&self.gpu, &mut self.renderer, volume, &inputs, wait) {
            Err(error @ (EngineError::Store(_) | EngineError::FailedBrick { .. })) => {
                Ok((Err(error), false))
            }
            Err(other) => Err(other),
            Ok(progress) => Ok((Ok(progress), run.parts_done > before)),
        }
    }

    /// Waits a moment for a brick; true when the tick's time is over.
    fn wait_for_brick(&mut self, deadline: Instant) -> bool {
        let left = deadline.saturating_duration_since(Instant::now());
        if let Some(volume) = &mut self.volume {
            volume.wait_for_one(left.min(SHORT_WAIT));
        }
        Instant::now() >= deadline
    }

    fn step_draft(
        &mut self,
        live: &mut Live,
        budget: &TickBudget,
        deadline: Instant,
    ) -> Result<(Option<TickEvent>, bool), EngineError> {
        let Phase::Draft(mut draft) = std::mem::replace(&mut live.phase, Phase::Failed) else {
            unreachable!("invariant: called in this phase only")
        };
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: a draft was begun on a volume")
        };
        volume.advance(&self.gpu, budget.upload_bytes)?;
        let mut waiting = Vec::new();
        for mut pending in draft.pending.drain(..) {
            match pending.try_take(&self.gpu)? {
                Some(report) => draft.reports.push(report),
                None => waiting.push(pending),
            }
        }
        draft.pending = waiting;
        if draft.drawn_at.is_some() && draft.pending.is_empty() && !draft.is_answered {
            draft.is_answered = true;
            let Some(ready) = &live.ready else {
                unreachable!("invariant: a draft was begun when it was ready")
            };
            let asked = self.ask(&ready.final_plan().rays, &draft.reports, &[]);
            live.missing = asked.missing.len() as u64;
            live.requested.extend(asked.missing);
            live.touched.extend(asked.touched);
            if live.missing == 0 || !asked.fits {
                // Nothing is missing; or it can't all be there at once, and rays must take turns.
                live.phase = self.begin_exact(live)?;
                return Ok((None, false));
            }
        }
        let Some(volume) = &mut self.volume else {
            unreachable!("invariant: as above")
        };
        let uploaded = volume.traffic.bricks_uploaded;
        // Again while bricks come: not all the time, and only while drafts miss less and less. Under a small atlas
        // they can take bricks from each other without end.
        let is_due = match draft.drawn_at {
            None => true,
            Some((at, begun, took)) => {
                draft.is_answered
                    && uploaded > at
                    && (volume.is_placed() || begun.elapsed() >= took * DRAFT_PAUSE)
                    && draft
                        .missing_before
                        .is_none_or(|before| live.missing < before)
            }
        };
        if is_due {
            let missing_before = draft.drawn_at.map(|_| live.missing);
            draft = Draft::default();
            let begun = Instant::now();
            let Some(ready) = &live.ready else {
                unreachable!("invariant: as above")
            };
            let drawn = self.draw_draft(ready.final_plan(), &mut draft.pending)?;
            draft.drawn_at = Some((uploaded, begun, begun.elapsed()));
            draft.missing_before = missing_before;
            live.image = Some(drawn.image);
            live.phase = Phase::Draft(draft);
            return Ok((Some(TickEvent::Refined), false));
        }
        if draft.is_answered && volume.is_placed() {
            // All that fits is there: what else rays need, they ask for as they go.
            live.phase = self.begin_exact(live)?;
            return Ok((None, false));
        }
        live.phase = Phase::Draft(draft);
        Ok((None, self.wait_for_brick(deadline)))
    }

    fn begin_exact(&mut self, live: &Live) -> Result<Phase, EngineError> {
        let last = live.ready.as_ref().map_or(0, |r| r.pictures.len() - 1);
        Ok(Phase::Exact(self.begin_run(live, last)?))
    }
}
