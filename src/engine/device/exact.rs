//! The exact picture under any atlas: tile by tile, each by dispatches between which missing bricks are loaded, until no
//! ray has anything left to do (design.md §2, invariant 2).

use std::collections::{BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use glam::{DVec3, UVec3};

use crate::geom::{BRICK_EDGE, BrickId, morton};
use crate::gpu::GpuContext;
use crate::gpu::layout::{RAY_LEVEL_MASK, RayState};
use crate::pager::{FrameRequests, RequestClass};
use crate::render::{Cast, Feedback, FrameInputs, Renderer, Tile};
use crate::scene::{
    GradientFilter, Image, Jitter, LevelFrame, PictureSettings, PictureStats, RayCounts, RayFrame,
};

use super::super::EngineError;
use super::paged::PagedVolume;

/// How long a dispatch should take at most: on real GPUs watchdogs end long ones. A renderer on the CPU has none, and loses
/// by small pieces.
const DISPATCH_TIME: [Duration; 2] = [Duration::from_millis(100), Duration::from_millis(1000)];
/// Samples of a ray in the first dispatch, and least ever.
const FIRST_LIMIT: [u32; 2] = [128, 1024];
const LEAST_LIMIT: u32 = 32;

/// A picture on its way.
#[derive(Debug)]
pub(super) struct ExactRun {
    tiles: VecDeque<Tile>,
    current: Option<Work>,
    sample_limit: u32,
    /// Bricks were asked for that the next dispatch needs: these.
    is_waiting: bool,
    needed: BTreeSet<BrickId>,
    pub(super) image: Image,
    pub(super) counts: RayCounts,
    /// Bricks with voxels that were sampled.
    pub(super) touched: BTreeSet<BrickId>,
    /// Bricks that rays asked for.
    pub(super) requested: BTreeSet<BrickId>,
}

/// What to do while bricks are on their way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Wait {
    /// Wait for them.
    Block,
    /// Come back later; upload at most so much each time.
    Upload { bytes: u64 },
}

/// How far a picture is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Complete,
    Advanced,
    /// For bricks.
    Waiting,
}

/// What is left to do of a tile.
#[derive(Debug)]
struct Work {
    tile: Tile,
    /// Work-groups that are cast.
    active: Vec<u32>,
    /// Those whose turn comes later: what all of them miss at once does not fit the atlas. Their rays keep their state.
    deferred: Vec<u32>,
    /// How many are cast at once.
    at_once: usize,
    /// The active ones came to this point without missing more than fits.
    had_room: bool,
}

impl Work {
    fn new(tile: Tile) -> Self {
        let active = Renderer::groups(&tile);
        Self {
            tile,
            at_once: active.len(),
            active,
            deferred: Vec::new(),
            had_room: true,
        }
    }

    /// Neighbours in the picture need the same bricks: they take their turns together.
    fn sort_by_place(&self, groups: &mut [u32]) {
        let wide = Renderer::groups_wide(&self.tile);
        groups.sort_unstable_by_key(|&g| morton(UVec3::new(g % wide, g / wide, 0)));
    }

    /// Casts fewer groups at once. False when there is but one.
    fn split(&mut self) -> bool {
        if self.active.len() < 2 {
            return false;
        }
        self.had_room = false;
        self.at_once = self.active.len() / 2;
        let mut active = std::mem::take(&mut self.active);
        self.sort_by_place(&mut active);
        self.deferred.extend(active.drain(self.at_once..));
        self.active = active;
        true
    }

    /// Goes on with the groups whose turn has not come. False when there are none.
    fn next_turn(&mut self) -> bool {
        if self.deferred.is_empty() {
            return false;
        }
        if self.had_room {
            self.at_once *= 2;
        }
        self.had_room = true;
        let mut deferred = std::mem::take(&mut self.deferred);
        self.sort_by_place(&mut deferred);
        let count = self.at_once.min(deferred.len());
        self.deferred = deferred.split_off(count);
        self.active = deferred;
        true
    }
}

/// Slots that one stopped ray of a picture of `settings` may need at once: the bricks that a segment passes, at most.
pub(super) fn segment_bricks(
    rays: &RayFrame,
    settings: &PictureSettings,
    bricks_of: impl Fn(&LevelFrame) -> DVec3,
) -> usize {
    rays.used()
        .iter()
        .map(|level| {
            let reach = step_reach(level) * segment_steps(rays) + 2.0 * segment_slack(settings);
            // A length of up to a brick lies in two, and so on; a level has no more than it has.
            let bricks = (reach / f64::from(BRICK_EDGE)).ceil() + 1.0;
            let bricks = bricks.min(bricks_of(level));
            (bricks.x * bricks.y * bricks.z) as usize
        })
        .max()
        .unwrap_or(1)
}

/// Steps in which the segment of a stopped ray lies: samples that are moved lie in the next one.
fn segment_steps(rays: &RayFrame) -> f64 {
    match rays.jitter {
        Jitter::None => 1.0,
        Jitter::Interleaved => 2.0,
    }
}

/// How far from the segment voxels are needed, level voxels: what a position may be off by rounding, and the points of
/// filtered gradients.
fn segment_slack(settings: &PictureSettings) -> f64 {
    const ROUNDING: f64 = 0.01;
    match settings.shading.gradient {
        GradientFilter::Central => ROUNDING,
        GradientFilter::Filtered => 0.5 + ROUNDING,
    }
}

/// How many missing bricks all rays in turn may have at once. What lies behind them needs slots, too; where there are few,
/// turns would become too short for it.
fn room(slots: usize) -> usize {
    const FEW: usize = 64;
    if slots < FEW { slots } else { slots / 2 }
}

/// The longest reach of a step along each axis of a level, in its voxels.
fn step_reach(level: &LevelFrame) -> DVec3 {
    let level_from_world = level.world_from_level.matrix3.inverse().transpose();
    // A row's length is the most that a step of 1 mm in any direction moves along that axis.
    DVec3::new(
        level_from_world.x_axis.length(),
        level_from_world.y_axis.length(),
        level_from_world.z_axis.length(),
    ) * level.step_mm_exact
}

impl ExactRun {
    /// A picture in tiles of `tile` pixels; finished tiles replace those of `base`.
    pub(super) fn new(
        gpu: &GpuContext,
        size: [u32; 2],
        tile: [u32; 2],
        base: Option<Image>,
    ) -> Self {
        Self {
            tiles: Renderer::tiles(size, tile).into(),
            current: None,
            is_waiting: false,
            needed: BTreeSet::new(),
            sample_limit: FIRST_LIMIT[usize::from(gpu.caps.is_software)],
            image: base.unwrap_or_else(|| Image::clear(size)),
            counts: RayCounts::default(),
            touched: BTreeSet::new(),
            requested: BTreeSet::new(),
        }
    }

    /// Tiles that are not finished.
    pub(super) fn tiles_left(&self) -> usize {
        self.tiles.len() + usize::from(self.current.is_some())
    }

    /// What the rays did.
    pub(super) fn report(&self, stats: &mut PictureStats) {
        stats.samples = self.counts.samples;
        stats.samples_skipped = self.counts.skipped;
        stats.samples_contributing = Some(self.counts.contributing);
        stats.bricks_requested = Some(self.requested.len() as u64);
        stats.bricks_touched = Some(self.touched.len() as u64);
    }

    /// One dispatch, once the bricks that it needs are there.
    ///
    /// # Errors
    /// A brick can't be read, or the device is lost.
    pub(super) fn advance(
        &mut self,
        gpu: &GpuContext,
        renderer: &mut Renderer,
        volume: &mut PagedVolume,
        inputs: &FrameInputs<'_>,
        wait: Wait,
    ) -> Result<Progress, EngineError> {
        if self.is_waiting {
            match wait {
                Wait::Block => volume.settle(gpu)?,
                Wait::Upload { bytes } => volume.advance(gpu, bytes)?,
            }
            if !volume.is_placed() {
                return match wait {
                    // Nothing is under way that could be waited for.
                    Wait::Block => Err(EngineError::Worker),
                    Wait::Upload { .. } => Ok(Progress::Waiting),
                };
            }
            self.is_waiting = false;
            if let Some(error) = volume.take_failure(&self.needed) {
                return Err(error);
            }
        }
        let mut work = match self.current.take() {
            Some(work) => work,
            None => {
                let Some(tile) = self.tiles.pop_front() else {
                    return Ok(Progress::Complete);
                };
                renderer.begin_tile(gpu, inputs, &volume.residency, &tile)?;
                Work::new(tile)
            }
        };
        let tile = work.tile;
        let cast = Cast {
            groups: &work.active,
            draft: false,
            sample_limit: self.sample_limit,
        };
        let begin = Instant::now();
        let report = renderer.cast_and_wait(gpu, inputs, &mut volume.residency, &tile, &cast)?;
        self.adapt(gpu, begin.elapsed(), &report);
        let touched = volume.bricks_in(&report.used_slots);
        self.touched.extend(&touched);
        let is_turn_over = report.pending_groups.is_empty();
        if is_turn_over && !work.next_turn() {
            self.counts += renderer.collect(gpu, &tile, &mut self.image)?;
            return Ok(if self.tiles.is_empty() {
                Progress::Complete
            } else {
                Progress::Advanced
            });
        }
        if let Some(pixel) = report.first_stopped {
            work.active.clone_from(&report.pending_groups);
            // More than fits at once would only push each other out.
            let is_split = report.missed.len() > room(volume.free_capacity()) && work.split();
            if !is_split {
                self.request(
                    gpu, renderer, volume, inputs, &tile, &report, &touched, pixel,
                )?;
            }
        } else if !is_turn_over {
            work.active = report.pending_groups;
        }
        self.current = Some(work);
        Ok(Progress::Advanced)
    }

    /// Asks for what rays miss; what the first stopped ray needs, together.
    #[expect(clippy::too_many_arguments, reason = "the parts of one dispatch")]
    fn request(
        &mut self,
        gpu: &GpuContext,
        renderer: &Renderer,
        volume: &mut PagedVolume,
        inputs: &FrameInputs<'_>,
        tile: &Tile,
        report: &Feedback,
        touched: &[BrickId],
        pixel: u32,
    ) -> Result<(), EngineError> {
        let requests = volume.requests(inputs.rays, RequestClass::Missing, &report.missed);
        let held = if requests.len() <= volume.unused_slots() {
            // Nobody has to leave.
            Vec::new()
        } else {
            let state = renderer.ray_state(gpu, pixel)?;
            segment(inputs, tile, pixel, &state, volume)
        };
        volume.begin_frame(&FrameRequests {
            requests: &requests,
            held: &held,
            touched,
            keep_touched: false,
        });
        self.needed = requests.iter().map(|r| r.brick).chain(held).collect();
        self.requested.extend(requests.iter().map(|r| r.brick));
        self.is_waiting = true;
        Ok(())
    }

    /// Keeps dispatches near the time that they may take.
    fn adapt(&mut self, gpu: &GpuContext, took: Duration, report: &Feedback) {
        let allowed = DISPATCH_TIME[usize::from(gpu.caps.is_software)];
        if took > allowed {
            let share = allowed.as_secs_f64() / took.as_secs_f64();
            self.sample_limit = ((f64::from(self.sample_limit) * share) as u32).max(LEAST_LIMIT);
        } else if took < allowed / 2 && report.unfinished > report.stopped {
            self.sample_limit = self.sample_limit.saturating_mul(2);
        }
    }
}

/// The bricks that the next segment of a stopped ray may need.
fn segment(
    inputs: &FrameInputs<'_>,
    tile: &Tile,
    pixel: u32,
    state: &RayState,
    volume: &PagedVolume,
) -> Vec<BrickId> {
    let rays = inputs.rays;
    let level = &rays.levels[(state.flags & RAY_LEVEL_MASK) as usize];
    let x = tile.origin[0] + pixel % tile.size[0];
    let y = tile.origin[1] + pixel / tile.size[0];
    let [u, v] = rays.plane_of_pixel(x, y).map(f64::from);
    let at = |q: &[glam::Vec3; 3]| q[0].as_dvec3() + q[1].as_dvec3() * u + q[2].as_dvec3() * v;
    let inverse = 1.0 / at(&rays.world_dir).length();
    let direction = at(&level.level_dir) * inverse;
    let origin = at(&level.level_origin) + level.anchor.as_dvec3();
    let place =
        |index: f64| origin + direction * (rays.first_mm_exact + index * level.step_mm_exact);
    let begin = f64::from(state.next - 1);
    let ends = [place(begin), place(begin + segment_steps(rays))];
    volume.bricks_of_segment(level.lod, ends, segment_slack(inputs.settings))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_split_by_place_and_nothing_is_lost() {
        let tile = Tile {
            origin: [0, 0],
            size: [128, 128],
            part_size: [128, 120],
        };
        let mut work = Work::new(tile);
        let all = work.active.clone();
        assert_eq!(all.len(), 16 * 15, "8×8 pixels each");
        assert!(
            work.split() && work.split(),
            "two halves, then two quarters"
        );
        assert_eq!(work.active.len(), 60);
        let (x, y): (Vec<u32>, Vec<u32>) = work.active.iter().map(|g| (g % 16, g / 16)).unzip();
        assert!(
            x.iter().max() <= Some(&7) && y.iter().max() <= Some(&7),
            "a corner of the tile: {:?}",
            work.active
        );
        let mut met = std::mem::take(&mut work.active);
        let mut turns = 1;
        while work.next_turn() {
            met.append(&mut work.active);
            turns += 1;
        }
        met.sort_unstable();
        assert_eq!(met, all, "each once");
        assert!(turns <= 4, "with room again they get larger: {turns} turns");
        work.active = vec![3];
        assert!(!work.split(), "one work-group can't be split");
    }
}
