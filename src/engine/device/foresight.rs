//! What cameras to come will need, told from the index alone: which bricks their rays pass in which something may be
//! visible. Cheap (few rays, no sample is taken) and a guess: what hides what is not known, so what lies behind other such
//! bricks is only wanted later.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::camera::Camera;
use crate::classify::SegmentTables;
use crate::geom::{BRICK_EDGE, BrickId, CellWalk};
use crate::pager::{Priority, Request};
use crate::render::Activity;
use crate::scene::{Mode, PictureSettings};
use crate::store::Store;

use super::super::EngineError;
use super::exact::LevelRay;
use super::plan::PicturePlan;

/// Pixels between two rays, at least: a quarter of a brick's width, or less, where its level is chosen by distance.
const LEAST_PITCH: f64 = 4.0;
/// Rays of a view, about: of larger pictures they are farther apart.
const MOST_RAYS: f64 = 16384.0;
/// Where rays end at what they meet, a ray is followed through so many bricks. Not fewer: a ray along the inside of a tube
/// passes many without meeting its wall.
const MOST_DEPTH: u32 = 32;

/// What is foreseen of some cameras.
#[derive(Debug, Default)]
pub(super) struct Foresight {
    /// Of which pictures, the camera apart.
    settings: Option<PictureSettings>,
    views: Vec<View>,
    /// Views looked at so far: each has its rays elsewhere in the pixels.
    count: u32,
}

/// What one camera will need.
#[derive(Debug)]
struct View {
    camera: Camera,
    /// Each brick once, with the least number of others that a ray passes before it.
    bricks: Vec<(BrickId, u32)>,
}

impl Foresight {
    /// Looks at what pictures of `settings` will need from `cameras`, the next one first. Those that were named the last
    /// time are not looked at again.
    ///
    /// # Errors
    /// The settings make no picture from one of the cameras.
    pub(super) fn look(
        &mut self,
        store: &Store,
        tables: &SegmentTables,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<(), EngineError> {
        let nowhere = settings.without_place();
        if self.settings.as_ref() != Some(&nowhere) {
            self.views.clear();
            self.settings = Some(nowhere);
        }
        let mut before = std::mem::take(&mut self.views);
        for &camera in cameras {
            let known = before.iter().position(|v| v.camera == camera);
            let view = match known {
                Some(place) => before.swap_remove(place),
                None => {
                    let settings = PictureSettings {
                        camera,
                        ..settings.clone()
                    };
                    let plan = PicturePlan::new(store, tables, &settings)?;
                    self.count += 1;
                    View {
                        camera,
                        bricks: bricks_in_view(store, &plan, place_of_rays(self.count)),
                    }
                }
            };
            self.views.push(view);
        }
        Ok(())
    }

    /// The bricks of all views as requests, at most `most`: those that are wanted first.
    pub(super) fn requests(&self, most: usize) -> Vec<Request> {
        let mut ahead_of: HashMap<BrickId, u32> = HashMap::new();
        for (number, view) in (0_u32..).zip(&self.views) {
            for &(brick, depth) in &view.bricks {
                // What is behind another brick is wanted as late as what a view later needs.
                let ahead = number + depth;
                least(&mut ahead_of, brick, ahead);
            }
        }
        let mut requests: Vec<Request> = ahead_of
            .into_iter()
            .map(|(brick, ahead)| Request {
                priority: Priority::predicted(ahead, brick.lod),
                brick,
            })
            .collect();
        requests.sort_unstable();
        requests.truncate(most);
        requests
    }
}

/// Where in their squares of pixels the rays of view number `count` pass, 0 to 1: spread evenly over successive views (the
/// R2 sequence of M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
fn place_of_rays(count: u32) -> [f64; 2] {
    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (f64::from(count) * step).fract())
}

/// The bricks with voxels in which something may be visible and that rays of the picture pass.
fn bricks_in_view(store: &Store, plan: &PicturePlan, place: [f64; 2]) -> Vec<(BrickId, u32)> {
    let rays = &plan.rays;
    let most_depth = match plan.settings.mode {
        Mode::Dvr | Mode::Iso | Mode::Gradient => MOST_DEPTH,
        // Rays go on to the volume's end.
        Mode::Mip | Mode::MinIp | Mode::Mean | Mode::Xray => u32::MAX,
    };
    let area = f64::from(rays.size[0]) * f64::from(rays.size[1]);
    let pitch = (area / MOST_RAYS).sqrt().max(LEAST_PITCH);
    let pixels = |axis: usize| {
        let size = f64::from(rays.size[axis]);
        let count = (size / pitch).ceil() as u32;
        (0..count).map(move |i| ((f64::from(i) + place[axis]) * pitch).min(size - 1.0))
    };
    let rows: Vec<f64> = pixels(1).collect();
    let found = rows
        .into_par_iter()
        .fold(HashMap::new, |mut found, y| {
            for x in pixels(0) {
                follow(store, plan, [x, y], most_depth, |brick, depth| {
                    least(&mut found, brick, depth);
                });
            }
            found
        })
        .reduce(HashMap::new, |mut all, part| {
            for (brick, depth) in part {
                least(&mut all, brick, depth);
            }
            all
        });
    found.into_iter().collect()
}

/// Keeps the least number of a brick.
fn least(numbers: &mut HashMap<BrickId, u32>, brick: BrickId, number: u32) {
    numbers
        .entry(brick)
        .and_modify(|least| *least = number.min(*least))
        .or_insert(number);
}

/// Follows the ray of a pixel through `most_depth` bricks in which something may be visible; tells those with voxels, each
/// with the number of others before it.
fn follow(
    store: &Store,
    plan: &PicturePlan,
    pixel: [f64; 2],
    most_depth: u32,
    mut tell: impl FnMut(BrickId, u32),
) {
    let rays = &plan.rays;
    let mut depth = 0;
    for level in rays.used() {
        let Some(seen) = plan.levels.get(&level.lod) else {
            continue;
        };
        let ray = LevelRay::new(rays, level, pixel);
        let last = f64::from(rays.last_index) / f64::from(1_u32 << level.lod.0);
        let ends = [f64::from(level.begin), f64::from(level.end).min(last)];
        let [from, to] = ends.map(|index| ray.place(index) / f64::from(BRICK_EDGE));
        for xyz in CellWalk::new(from, to, store.level(level.lod).grid.bricks) {
            let brick = BrickId::new(level.lod, xyz);
            let entry = store.entry(brick);
            if seen.of_range([entry.min, entry.max]) != Activity::Unknown {
                continue;
            }
            if depth >= most_depth {
                return;
            }
            if !entry.constant {
                tell(brick, depth);
            }
            depth += 1;
        }
    }
}
