//! The exact picture under any atlas: tile by tile, each by dispatches between which missing bricks are loaded, until no
//! ray has anything left to do (design.md §2, invariant 2).

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;

use crate::geom::{BRICK_EDGE, BrickId};
use crate::gpu::GpuContext;
use crate::gpu::layout::{RAY_LEVEL_MASK, RayState};
use crate::pager::{FrameRequests, RequestClass};
use crate::render::{Cast, Feedback, FrameInputs, PixelList, Renderer, Tile};
use crate::scene::{
    AntiAliasing, GradientFilter, Image, Jitter, LevelFrame, PictureSettings, PictureStats,
    RayCounts, RayFrame, RaySet, SlabShape,
};

use super::super::EngineError;
use super::paged::PagedVolume;
use super::slab;

/// How long a dispatch should take at most: on real GPUs watchdogs end long ones. A renderer on the CPU has none, and loses
/// by small pieces.
const DISPATCH_TIME: [Duration; 2] = [Duration::from_millis(100), Duration::from_millis(1000)];
/// Samples of a ray in the first dispatch, and least ever.
const FIRST_LIMIT: [u32; 2] = [128, 1024];
const LEAST_LIMIT: u32 = 32;

/// A picture on its way.
#[derive(Debug)]
pub(super) struct ExactRun {
    /// The sample grid, with the place in the pixel of the ray that is cast.
    rays: Arc<RayFrame>,
    /// Where each ray of a pixel passes.
    places: Vec<[f32; 2]>,
    parts: VecDeque<Part>,
    /// What tells the rays that follow these; `None` once they are told.
    anti_aliasing: Option<AntiAliasing>,
    tile_size: [u32; 2],
    current: Option<Work>,
    sample_limit: u32,
    /// Bricks were asked for that the next dispatch needs: these.
    is_waiting: bool,
    needed: BTreeSet<BrickId>,
    pub(super) image: Image,
    pub(super) counts: RayCounts,
    pub(super) rays_cast: u64,
    /// Parts of the picture that are finished, each with all of its rays.
    pub(super) parts_done: u64,
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

/// Pixels of a tile: all, or those that are listed.
#[derive(Debug)]
struct Part {
    tile: Tile,
    /// As [`PixelList`] has them.
    list: Option<Vec<u32>>,
}

impl Part {
    fn list(&self) -> PixelList<'_> {
        self.list.as_deref()
    }

    fn pixel_count(&self) -> u64 {
        match &self.list {
            Some(list) => list.len() as u64,
            None => self.tile.part_size.map(u64::from).iter().product(),
        }
    }
}

/// The parts of a set of rays in tiles of `tile` pixels.
fn parts(set: &RaySet, size: [u32; 2], tile: [u32; 2]) -> VecDeque<Part> {
    let tiles = Renderer::tiles(size, tile);
    let Some(pixels) = &set.pixels else {
        let whole = |tile| Part { tile, list: None };
        return tiles.into_iter().map(whole).collect();
    };
    let across = size[0].div_ceil(tile[0]);
    let mut lists: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for [x, y] in pixels {
        let list = lists.entry(y / tile[1] * across + x / tile[0]).or_default();
        list.push(((y % tile[1]) << 16) | (x % tile[0]));
    }
    let part = |(number, list): (u32, Vec<u32>)| Part {
        tile: tiles[number as usize],
        list: Some(list),
    };
    lists.into_iter().map(part).collect()
}

/// What is left to do of a part with one ray of each pixel.
#[derive(Debug)]
struct Work {
    part: Part,
    /// Number of the ray in its pixel.
    ray: usize,
    /// The slabs in which rays of whole tiles advance; `None` where each walks by itself.
    slab: Option<SlabShape>,
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
    fn new(part: Part, ray: usize, slab: Option<SlabShape>) -> Self {
        let slab = slab.filter(|_| part.list.is_none());
        let active = Renderer::groups(&part.tile, slab, part.list());
        Self {
            part,
            ray,
            slab,
            at_once: active.len(),
            active,
            deferred: Vec::new(),
            had_room: true,
        }
    }

    /// Neighbours in the picture need the same bricks: they take their turns together.
    fn sort_by_place(&self, groups: &mut [u32]) {
        let is_listed = self.part.list.is_some();
        Renderer::sort_by_place(&self.part.tile, self.slab, is_listed, groups);
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
pub(super) fn segment_slack(settings: &PictureSettings) -> f64 {
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
pub(super) fn step_reach(level: &LevelFrame) -> DVec3 {
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
        inputs: &FrameInputs<'_>,
        tile: [u32; 2],
        base: Option<Image>,
    ) -> Self {
        let (size, anti_aliasing) = (inputs.rays.size, inputs.settings.anti_aliasing);
        let first = RaySet::first(anti_aliasing);
        Self {
            rays: Arc::new(inputs.rays.clone()),
            parts: parts(&first, size, tile),
            places: first.places,
            anti_aliasing: Some(anti_aliasing),
            tile_size: tile,
            current: None,
            is_waiting: false,
            needed: BTreeSet::new(),
            sample_limit: FIRST_LIMIT[usize::from(gpu.caps.is_software)],
            image: base.unwrap_or_else(|| Image::for_settings(inputs.settings)),
            counts: RayCounts::default(),
            rays_cast: 0,
            parts_done: 0,
            touched: BTreeSet::new(),
            requested: BTreeSet::new(),
        }
    }

    /// What the rays did.
    pub(super) fn report(&self, stats: &mut PictureStats) {
        stats.rays = self.rays_cast;
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
                let Some(part) = self.parts.pop_front() else {
                    return Ok(Progress::Complete);
                };
                self.begin(gpu, renderer, volume, inputs, part, 0)?
            }
        };
        let rays = Arc::clone(&self.rays);
        let inputs = &FrameInputs {
            rays: &rays,
            ..*inputs
        };
        let tile = work.part.tile;
        let cast = Cast {
            groups: &work.active,
            is_listed: work.part.list.is_some(),
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
            let ray = [work.ray, self.places.len()];
            let Work { part, .. } = work;
            self.counts += renderer.collect(gpu, &tile, part.list(), ray, &mut self.image)?;
            self.rays_cast += part.pixel_count();
            if ray[0] + 1 < ray[1] {
                let next = self.begin(gpu, renderer, volume, inputs, part, ray[0] + 1)?;
                self.current = Some(next);
                return Ok(Progress::Advanced);
            }
            self.parts_done += 1;
            return Ok(if self.parts.is_empty() && !self.begin_second_set() {
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
                    gpu, renderer, volume, inputs, &work, &report, &touched, pixel,
                )?;
            }
        } else if !is_turn_over {
            work.active = report.pending_groups;
        }
        self.current = Some(work);
        Ok(Progress::Advanced)
    }

    /// Begins to cast ray number `ray` of the pixels of a part.
    fn begin(
        &mut self,
        gpu: &GpuContext,
        renderer: &mut Renderer,
        volume: &PagedVolume,
        inputs: &FrameInputs<'_>,
        part: Part,
        ray: usize,
    ) -> Result<Work, EngineError> {
        let rays = Arc::make_mut(&mut self.rays);
        rays.place_in_pixel = self.places[ray];
        let inputs = FrameInputs { rays, ..*inputs };
        renderer.begin_tile(gpu, &inputs, &volume.residency, &part.tile, part.list())?;
        Ok(Work::new(part, ray, inputs.slab))
    }

    /// Goes on with the rays that follow the first ones. False when the picture has all of them.
    fn begin_second_set(&mut self) -> bool {
        let set = self
            .anti_aliasing
            .take()
            .and_then(|how| RaySet::second(how, &self.image));
        let Some(set) = set else { return false };
        self.parts = parts(&set, self.rays.size, self.tile_size);
        self.places = set.places;
        true
    }

    /// Asks for what rays miss; what the first stopped ray needs, together.
    #[expect(clippy::too_many_arguments, reason = "the parts of one dispatch")]
    fn request(
        &mut self,
        gpu: &GpuContext,
        renderer: &Renderer,
        volume: &mut PagedVolume,
        inputs: &FrameInputs<'_>,
        work: &Work,
        report: &Feedback,
        touched: &[BrickId],
        pixel: u32,
    ) -> Result<(), EngineError> {
        let requests = volume.requests(inputs.rays, RequestClass::Missing, &report.missed);
        let held = if requests.len() <= volume.unused_slots() {
            // Nobody has to leave.
            Vec::new()
        } else {
            let tile = &work.part.tile;
            if let Some(shape) = work.slab {
                let pixels = slab::pixels_of_group(tile, shape, pixel);
                let states = renderer.ray_states(gpu, pixels)?;
                slab::bricks(inputs, shape, (tile, pixel), &states, volume)
            } else {
                let states = renderer.ray_states(gpu, pixel..pixel + 1)?;
                segment(inputs, tile, pixel, &states[0], volume)
            }
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

/// A ray in the voxels of a level, exact to what f64 holds.
pub(super) struct LevelRay {
    /// Of sample 0, without what a pixel's jitter adds.
    first: DVec3,
    step: DVec3,
}

impl LevelRay {
    /// That of `pixel` of the picture, which may lie outside it.
    pub(super) fn new(rays: &RayFrame, level: &LevelFrame, pixel: [f64; 2]) -> Self {
        let [u, v] = rays.plane_of(pixel);
        let at = |q: &[glam::Vec3; 3]| q[0].as_dvec3() + q[1].as_dvec3() * u + q[2].as_dvec3() * v;
        let direction = at(&level.level_dir) / at(&rays.world_dir).length();
        let origin = at(&level.level_origin) + level.anchor.as_dvec3();
        Self {
            first: origin + direction * rays.first_mm_exact,
            step: direction * level.step_mm_exact,
        }
    }

    /// Level voxels, at sample `index`.
    pub(super) fn place(&self, index: f64) -> DVec3 {
        self.first + self.step * index
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
    let ray = LevelRay::new(rays, level, [f64::from(x), f64::from(y)]);
    let begin = f64::from(state.next - 1);
    let ends = [ray.place(begin), ray.place(begin + segment_steps(rays))];
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
        let mut work = Work::new(Part { tile, list: None }, 0, None);
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

    #[test]
    fn listed_pixels_go_to_their_tiles_in_their_order() {
        let set = RaySet {
            places: vec![[0.5; 2]],
            pixels: Some(vec![[65, 3], [64, 69], [0, 0], [129, 70], [66, 3]]),
        };
        let parts = parts(&set, [130, 71], [64, 64]);
        let told: Vec<([u32; 2], &[u32])> = parts
            .iter()
            .map(|p| (p.tile.origin, p.list().unwrap()))
            .collect();
        let expected: [([u32; 2], &[u32]); 4] = [
            ([0, 0], &[0]),
            ([64, 0], &[(3 << 16) | 1, (3 << 16) | 2]),
            ([64, 64], &[5 << 16]),
            ([128, 64], &[(6 << 16) | 1]),
        ];
        assert_eq!(told, expected, "tiles without any are left out");
        assert_eq!(parts[1].pixel_count(), 2);
    }

    #[test]
    fn turns_of_a_list_are_parts_of_it() {
        let tile = Tile {
            origin: [0, 0],
            size: [64, 64],
            part_size: [64, 64],
        };
        let list = Some((0..200).collect());
        let mut work = Work::new(Part { tile, list }, 2, None);
        assert_eq!(work.active, [0, 1, 2, 3], "64 pixels each");
        assert!(work.split(), "two halves");
        assert_eq!(work.active, [0, 1], "near in the list, near in the picture");
        assert!(work.next_turn(), "the other half");
        assert_eq!(work.active, [2, 3]);
    }
}
