//! The casters: one loop per mode over the sample grid of the frame, level by level, a packet of rays in step. The twins
//! of [`crate::reference`], which take every sample; these skip blocks in which nothing can be seen.
//!
//! A packet goes from sample to sample together. Where no lane is in an active block, it goes on to the first sample at
//! which one may be (invariant 4 of design.md: samples in between contribute nothing, and in mode iso are on one side).

use super::field::{Field, Place, VoxelKind};
use super::intervals::{Interval, Intervals};
use super::light::Light;
use super::rays::{Packet, Rays, Vec3, axes};
use super::simd::{Lanes, PerLane};
use super::skip::ABOVE;
use super::table::Table;
use crate::scene::{
    Interpolation, LevelFrame, Mode, PictureSettings, RayCounts, RayFrame, ShadingModel,
};

/// What all packets of a picture share.
#[derive(Debug)]
pub(super) struct Scene<'a> {
    pub(super) frame: &'a RayFrame,
    /// One per level that is sampled.
    pub(super) tables: &'a [Table],
    pub(super) intervals: &'a [Intervals],
    pub(super) light: Option<Light>,
    pub(super) mode: Mode,
    pub(super) interpolation: Interpolation,
    pub(super) iso_stored: f32,
    pub(super) iso_color: [f32; 3],
    pub(super) refine: bool,
    pub(super) opacity_cutoff: f32,
    /// In mode mip, no sample is below this.
    pub(super) floor: f32,
    /// Are samples in blocks skipped that can't raise the maximum?
    pub(super) culls: bool,
}

impl<'a> Scene<'a> {
    pub(super) fn light_of(settings: &PictureSettings) -> Option<Light> {
        match settings.shading.model {
            ShadingModel::None => None,
            ShadingModel::Phong => Some(Light::new(&settings.shading)),
        }
    }

    fn levels(&self) -> impl Iterator<Item = (usize, &'a LevelFrame)> {
        self.frame.used().iter().enumerate()
    }
}

/// Premultiplied colour and opacity, per lane.
pub(super) type Colors = [PerLane<f32>; 4];

/// Draws a packet. `fields`: one per level that is sampled.
#[inline(always)]
pub(super) fn cast<L: Lanes, K: VoxelKind>(
    l: L,
    scene: &Scene<'_>,
    fields: &mut [Field<'_, '_, L>],
    packet: Packet<L>,
    counts: &mut RayCounts,
) -> Colors {
    let mut caster = Caster {
        l,
        scene,
        packet,
        fields,
        samples: l.i(0),
        passed: l.i(0),
        contributing: l.i(0),
    };
    let color = match scene.mode {
        Mode::Iso => caster.iso::<K>(),
        Mode::Mip => caster.mip::<K>(),
        _ => caster.dvr::<K>(),
    };
    let taken = sum(l, caster.samples);
    *counts += RayCounts {
        samples: taken,
        skipped: sum(l, caster.passed) - taken,
        contributing: sum(l, caster.contributing),
    };
    let [r, g, b, a] = color;
    [l.store_f(r), l.store_f(g), l.store_f(b), l.store_f(a)]
}

struct Caster<'s, 'f, 'n, 'a, L: Lanes> {
    l: L,
    scene: &'s Scene<'f>,
    packet: Packet<L>,
    fields: &'s mut [Field<'n, 'a, L>],
    /// Per lane: samples taken, samples of the parts that are done, samples that counted.
    samples: L::I,
    passed: L::I,
    contributing: L::I,
}

/// The samples of a packet at one level: those of each lane, and the one that the packet is at.
#[derive(Clone, Copy)]
struct Span<L: Lanes> {
    first: L::I,
    last: L::I,
    /// Behind this there is nothing for any of them.
    limit: i32,
    index: i32,
    end: i32,
}

impl<L: Lanes> Span<L> {
    /// Of the lanes `alive`.
    #[inline(always)]
    fn new(l: L, first: L::I, last: L::I, [begin, limit]: Interval, alive: L::M) -> Self {
        let mut span = Self {
            first,
            last,
            limit,
            index: l.least(alive & !l.gt_i(first, last), first).max(begin),
            end: 0,
        };
        span.end_with(l, alive);
        span
    }

    /// Only the lanes `alive` go on.
    #[inline(always)]
    fn end_with(&mut self, l: L, alive: L::M) {
        let some = alive & !l.gt_i(self.first, self.last);
        self.end = l.greatest(some, self.last).min(self.limit);
    }

    /// Lanes that have a sample here.
    #[inline(always)]
    fn here(&self, l: L) -> L::M {
        let index = l.i(self.index);
        !l.gt_i(self.first, index) & !l.gt_i(index, self.last)
    }

    /// Goes on to the least of `next`, the samples at which the lanes `here` may meet something, or to the first sample of
    /// another lane of `alive`.
    #[inline(always)]
    fn leap(&mut self, l: L, alive: L::M, here: L::M, next: L::I) {
        let later = alive & l.gt_i(self.first, l.i(self.index));
        let least = l.least(here, next).min(l.least(later, self.first));
        self.index = least.max(self.index + 1);
    }

    /// Number of the samples of each lane up to `index`, which none has passed.
    #[inline(always)]
    fn count_to(&self, l: L, index: L::I) -> L::I {
        l.max_i(l.min_i(index, self.last) - self.first + l.i(1), l.i(0))
    }
}

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    /// The samples of level number `n` that the packet's rays may have to take.
    fn interval(&self, n: usize) -> Interval {
        self.scene.intervals[n].around(self.packet.cells())
    }

    #[inline(always)]
    fn dvr<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let (zero, one) = (l.f(0.0), l.f(1.0));
        let cutoff = l.f(scene.opacity_cutoff);
        let mut sum = [zero; 4];
        let mut alive = self.packet.inside;
        for (n, level) in scene.levels() {
            let rays = Rays::new(l, scene.frame, level, &self.packet);
            // The sample at a switch is the coarser level's.
            let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
            let mut span = Span::new(l, rays.first, last, self.interval(n), alive);
            let field = &mut self.fields[n];
            let table = &scene.tables[n];
            while span.index <= span.end {
                let here = span.here(l) & alive;
                let offset = rays.offset(l.f(span.index as f32));
                let place = field.locate(l, offset, here);
                let distance = field.skip_byte(l, &place);
                let active = here & l.eq_i(distance, l.i(0));
                if !l.any(active) {
                    let next = field.behind_blocks(l, &rays, &place, distance);
                    span.leap(l, alive, here, next);
                    continue;
                }
                add_one(l, &mut self.samples, active);
                let at = table.index(l, field.value::<K>(l, &place, offset));
                let opacity = table.opacity(l, &at);
                let seen = active & l.gt(opacity, zero);
                if l.any(seen) {
                    add_one(l, &mut self.contributing, seen);
                    let mut color = table.color(l, &at);
                    if let Some(light) = &scene.light {
                        let gradient = world_gradient::<L, K>(l, field, level, &place, offset);
                        color = light.shade(l, color, gradient, rays.direction);
                    }
                    let weight = (one - sum[3]) * l.pick(seen, opacity, zero);
                    for c in 0..3 {
                        sum[c] = sum[c] + color[c] * weight;
                    }
                    sum[3] = sum[3] + weight;
                    let opaque = seen & l.ge(sum[3], cutoff);
                    if l.any(opaque) {
                        let passed = span.count_to(l, l.i(span.index));
                        add(l, &mut self.passed, opaque, passed);
                        alive = alive & !opaque;
                        span.end_with(l, alive);
                    }
                }
                span.index += 1;
            }
            let passed = span.count_to(l, last);
            add(l, &mut self.passed, alive, passed);
        }
        sum
    }

    #[inline(always)]
    fn mip<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let mut greatest = l.f(scene.floor);
        let alive = self.packet.inside;
        let mut inside = l.mask(0);
        for (n, level) in scene.levels() {
            let rays = Rays::new(l, scene.frame, level, &self.packet);
            let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
            let mut span = Span::new(l, rays.first, last, self.interval(n), alive);
            inside = inside | (alive & !l.gt_i(rays.first, last));
            let field = &mut self.fields[n];
            while span.index <= span.end {
                let here = span.here(l) & alive;
                let offset = rays.offset(l.f(span.index as f32));
                let place = field.locate(l, offset, here);
                let mut active = here;
                if scene.culls {
                    let [block, brick] = field.highest(l, &place);
                    active = here & l.gt(block, greatest);
                    if !l.any(active) {
                        let whole = l.gt(brick, greatest);
                        let behind_brick = field.behind_brick(l, &rays, &place);
                        let next = if l.any(here & whole) {
                            let behind = field.behind_blocks(l, &rays, &place, l.i(1));
                            l.pick_i(whole, behind, behind_brick)
                        } else {
                            behind_brick
                        };
                        span.leap(l, alive, here, next);
                        continue;
                    }
                    // Of a brick that was not read nothing is known but its greatest value: look again when it is.
                    if field.lacks_voxels(l, active) {
                        field.need_voxels(l, active);
                        continue;
                    }
                }
                add_one(l, &mut self.samples, active);
                let value = field.value::<K>(l, &place, offset);
                let more = active & l.gt(value, greatest);
                add_one(l, &mut self.contributing, more);
                greatest = l.pick(more, value, greatest);
                span.index += 1;
            }
            let passed = span.count_to(l, last);
            add(l, &mut self.passed, alive, passed);
        }
        // All levels have one table in this mode.
        let table = &scene.tables[0];
        let at = table.index(l, greatest);
        let opacity = l.pick(inside, table.opacity(l, &at), l.f(0.0));
        let [r, g, b] = table.color(l, &at);
        [r * opacity, g * opacity, b * opacity, opacity]
    }

    #[inline(always)]
    fn iso<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let (zero, one) = (l.f(0.0), l.f(1.0));
        let iso = l.f(scene.iso_stored);
        let mut color = [zero; 4];
        let mut alive = self.packet.inside;
        for (n, level) in scene.levels() {
            let rays = Rays::new(l, scene.frame, level, &self.packet);
            let last = rays.last;
            let mut span = Span::new(l, rays.first, last, self.interval(n), alive);
            let field = &mut self.fields[n];
            // A segment has the level of its first sample, and both ends are sampled there (design.md §3).
            let (mut above_before, mut has_before) = (l.mask(0), l.mask(0));
            while span.index <= span.end {
                let here = span.here(l) & alive;
                let offset = rays.offset(l.f(span.index as f32));
                let place = field.locate(l, offset, here);
                let byte = field.skip_byte(l, &place);
                let distance = byte & l.i(i32::from(!ABOVE));
                let active = here & l.eq_i(distance, l.i(0));
                let mut above = l.gt_i(byte, distance);
                if l.any(active) {
                    let value = field.value::<K>(l, &place, offset);
                    above = (l.ge(value, iso) & active) | (above & !active);
                    add_one(l, &mut self.samples, active);
                }
                let changed = (above & !above_before) | (above_before & !above);
                let hit = here & has_before & changed;
                above_before = (above & here) | (above_before & !here);
                has_before = has_before | here;
                if l.any(hit) {
                    add_one(l, &mut self.contributing, hit);
                    let passed = span.count_to(l, l.i(span.index));
                    add(l, &mut self.passed, hit, passed);
                    let lit = surface::<L, K>(
                        l,
                        scene,
                        field,
                        level,
                        &rays,
                        Hit {
                            index: span.index,
                            above,
                            lanes: hit,
                        },
                    );
                    for c in 0..3 {
                        color[c] = l.pick(hit, lit[c], color[c]);
                    }
                    color[3] = l.pick(hit, one, color[3]);
                    alive = alive & !hit;
                    span.end_with(l, alive);
                }
                if l.any(active) {
                    span.index += 1;
                } else {
                    let next = field.behind_blocks(l, &rays, &place, distance);
                    span.leap(l, alive, here & alive, next);
                }
            }
            let passed = span.count_to(l, last);
            add(l, &mut self.passed, alive, passed);
        }
        color
    }
}

/// Over all lanes.
#[inline(always)]
fn sum<L: Lanes>(l: L, v: L::I) -> u64 {
    l.store_i(v)[..L::WIDTH].iter().map(|&n| n as u64).sum()
}

/// Adds `n` in the lanes of `m`.
#[inline(always)]
fn add<L: Lanes>(l: L, sum: &mut L::I, m: L::M, n: L::I) {
    *sum = *sum + l.pick_i(m, n, l.i(0));
}

/// Adds 1 in the lanes of `m`.
#[inline(always)]
fn add_one<L: Lanes>(l: L, sum: &mut L::I, m: L::M) {
    add(l, sum, m, l.i(1));
}

/// Lanes that have met the surface between sample `index` − 1 and `index`, which is `above` it or not.
struct Hit<L: Lanes> {
    index: i32,
    above: L::M,
    lanes: L::M,
}

/// The colour of the surface where `hit` lanes have met it.
#[inline(always)]
fn surface<L: Lanes, K: VoxelKind>(
    l: L,
    scene: &Scene<'_>,
    field: &mut Field<'_, '_, L>,
    level: &LevelFrame,
    rays: &Rays<L>,
    hit: Hit<L>,
) -> Vec3<L> {
    let index = l.f(hit.index as f32);
    let mut at = index;
    if scene.refine {
        // Six bisection steps (techniques.md T1.3).
        at = index - l.f(0.5);
        let mut half = 0.25;
        for _ in 0..6 {
            let offset = rays.offset(at);
            let place = field.locate(l, offset, hit.lanes);
            let byte = field.skip_byte(l, &place);
            let distance = byte & l.i(i32::from(!ABOVE));
            let inactive = !l.eq_i(distance, l.i(0));
            let value = field.value::<K>(l, &place, offset);
            let above = (l.gt_i(byte, distance) & inactive)
                | (l.ge(value, l.f(scene.iso_stored)) & !inactive);
            let differs = (above & !hit.above) | (hit.above & !above);
            at = at + l.pick(differs, l.f(half), l.f(-half));
            half *= 0.5;
        }
    }
    let color = axes!(n => l.f(scene.iso_color[n]));
    match &scene.light {
        None => color,
        Some(light) => {
            let offset = rays.offset(at);
            let place = field.locate(l, offset, hit.lanes);
            field.need_voxels(l, hit.lanes);
            let gradient = world_gradient::<L, K>(l, field, level, &place, offset);
            light.shade(l, color, gradient, rays.direction)
        }
    }
}

/// The gradient in world units, to the surface's normal.
#[inline(always)]
fn world_gradient<L: Lanes, K: VoxelKind>(
    l: L,
    field: &Field<'_, '_, L>,
    level: &LevelFrame,
    place: &Place<L>,
    offset: Vec3<L>,
) -> Vec3<L> {
    let g = field.gradient::<K>(l, place, offset);
    let columns = level.normal_from_gradient.to_cols_array_2d();
    axes!(n => {
        l.f(columns[0][n]) * g[0] + l.f(columns[1][n]) * g[1] + l.f(columns[2][n]) * g[2]
    })
}
