//! Modes mip, minip and mean: one value per ray, classified once.

use super::cast::{Caster, add, add_one};
use super::field::VoxelKind;
use super::parts::Backdrop;
use super::rays::Rays;
use super::simd::Lanes;
use super::span::Span;
use crate::scene::Contribution;

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    /// Modes mip and minip: the greatest of the values times a sign. A ray ends when it has the volume's own extreme.
    #[inline(always)]
    pub(super) fn extreme<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let (sign, most) = (l.f(scene.search.sign), l.f(scene.search.end));
        let mut greatest = l.f(scene.search.begin);
        let mut all = self.packet.inside;
        let mut has_samples = l.mask(0);
        let mut backdrop = Backdrop::new(l);
        for part in self.parts {
            let mut alive = all;
            for (n, level) in scene.levels() {
                let mut rays = Rays::new(l, scene.frame, level, &self.packet);
                rays.cut(l, &self.packet, part, level.step_mm, Contribution::Value);
                let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
                let mut span = Span::new(l, rays.first, last, self.interval(n), alive);
                has_samples = has_samples | (all & !l.gt_i(rays.first, last));
                let field = &mut self.fields[n];
                while span.index <= span.end {
                    let here = span.here(l) & alive;
                    let offset = rays.offset(l.f(span.index as f32));
                    let place = field.locate(l, offset, here);
                    let mut active = here;
                    if scene.skips {
                        let [block, brick] = field.bounds(l, &place);
                        active = here & l.gt(block, greatest);
                        if !l.any(active) {
                            let whole = l.gt(brick, greatest);
                            let brick = field.whole_brick(l, &place);
                            let behind_brick = field.behind(l, &rays, &brick);
                            let next = if l.any(here & whole) {
                                let block = field.blocks_around(l, &place, l.i(1));
                                l.pick_i(whole, field.behind(l, &rays, &block), behind_brick)
                            } else {
                                behind_brick
                            };
                            span.leap(l, alive, here, next);
                            continue;
                        }
                        // Of a brick that was not read nothing is known but its extreme: look again when it is.
                        if field.lacks_voxels(l, active) {
                            field.need_voxels(l, active);
                            continue;
                        }
                    }
                    add_one(l, &mut self.samples, active);
                    let value = field.value::<K>(l, &place, offset) * sign;
                    let more = active & l.gt(value, greatest);
                    add_one(l, &mut self.contributing, more);
                    greatest = l.pick(more, value, greatest);
                    let done = more & l.ge(greatest, most);
                    if scene.skips && l.any(done) {
                        alive = alive & !done;
                        span.end_with(l, alive);
                    }
                    span.index += 1;
                }
                let passed = span.count_to(l, last);
                add(l, &mut self.passed, all, passed);
            }
            let before = all;
            all = backdrop.meet(l, part, all, scene.opacity_cutoff);
            self.note_layers(part, before, all);
        }
        let projected = self.classified(greatest * sign, has_samples);
        backdrop.around(l, projected)
    }

    /// Mode mean: every sample, weighted by the base steps that it stands for.
    #[inline(always)]
    pub(super) fn mean<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let zero = l.f(0.0);
        let (mut sum, mut weights) = (zero, zero);
        let mut all = self.packet.inside;
        let mut backdrop = Backdrop::new(l);
        for part in self.parts {
            for (n, level) in scene.levels() {
                let mut rays = Rays::new(l, scene.frame, level, &self.packet);
                rays.cut(l, &self.packet, part, level.step_mm, Contribution::Value);
                let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
                let mut span = Span::new(l, rays.first, last, self.interval(n), all);
                // Levels of a frame follow each other.
                let steps = l.f((1_u32 << n) as f32);
                let field = &mut self.fields[n];
                while span.index <= span.end {
                    let here = span.here(l) & all;
                    let offset = rays.offset(l.f(span.index as f32));
                    let place = field.locate(l, offset, here);
                    let value = field.value::<K>(l, &place, offset);
                    sum = sum + l.pick(here, value * steps, zero);
                    weights = weights + l.pick(here, steps, zero);
                    span.index += 1;
                }
                let count = span.count_to(l, last);
                for of in [&mut self.samples, &mut self.passed, &mut self.contributing] {
                    add(l, of, all, count);
                }
            }
            let before = all;
            all = backdrop.meet(l, part, all, scene.opacity_cutoff);
            self.note_layers(part, before, all);
        }
        let has_samples = l.gt(weights, zero);
        let projected = self.classified(sum / l.pick(has_samples, weights, l.f(1.0)), has_samples);
        backdrop.around(l, projected)
    }

    /// The colours of values; nothing in other lanes than `lanes`.
    #[inline(always)]
    fn classified(&self, value: L::F, lanes: L::M) -> [L::F; 4] {
        let l = self.l;
        // All levels have one table in these modes.
        let table = &self.scene.tables[0];
        let at = table.index(l, value);
        let opacity = l.pick(lanes, table.opacity(l, &at), l.f(0.0));
        let [r, g, b] = table.color(l, &at);
        [r * opacity, g * opacity, b * opacity, opacity]
    }
}
