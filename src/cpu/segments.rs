//! Mode dvr, pre-integrated: the segments between samples composited front to back, by the values at both ends.
//!
//! A segment between two samples in blocks that can't be seen may pass through one that can, or from values below those
//! that can be seen to values above. It is skipped where it lies in the rooms of inactive blocks around both ends, of which
//! the ray enters one before it leaves the other: their ranges of values, chained, are one that can't be seen (invariant 4 of
//! design.md). Where it isn't, both ends are fetched, whatever is in their blocks.

use super::cast::{Caster, Sum, add, add_one};
use super::field::VoxelKind;
use super::gradient::world_gradient;
use super::parts::at_face_normal;
use super::rays::{Rays, axes};
use super::simd::Lanes;
use super::span::Span;
use crate::scene::Contribution;

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    #[inline(always)]
    pub(super) fn segments<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let (zero, one) = (l.f(0.0), l.f(1.0));
        let mut sum = Sum::new(l);
        let mut alive = self.packet.inside;
        for part in self.parts {
            for (n, level) in scene.levels() {
                let mut rays = Rays::new(l, scene.frame, level, &self.packet);
                let between = rays.cut(l, &self.packet, part, level.step_mm, Contribution::Segment);
                // A segment has the level of its first sample, and both ends are sampled there (design.md §3).
                alive = self.cap::<K>((n, level), (&rays, part, &between), &mut sum, alive);
                let mut span = Span::new(l, rays.first, rays.last, self.interval(n), alive);
                let field = &mut self.fields[n];
                let table = &scene.segments[n];
                // The sample taken last and its value, and to where nothing can be seen from the sample before on. Up to where
                // the packet begins there is nothing.
                let (mut taken, mut value_before) = (l.i(-2), zero);
                let mut clear_to = l.f(f32::INFINITY);
                while span.index <= span.end {
                    let here = span.here(l) & alive;
                    let offset = rays.offset(l.f(span.index as f32));
                    let mut place = field.locate(l, offset, here);
                    let distance = field.skip_byte(l, &place);
                    let active = here & l.eq_i(distance, l.i(0));
                    let room = field.blocks_around(l, &place, distance);
                    let is_clear = !active & l.ge(clear_to, field.begin(l, &rays, &room));
                    let end = field.end(l, &rays, &room);
                    clear_to = l.pick(active, l.f(f32::NEG_INFINITY), end);
                    let counts = here & span.has_before(l) & !is_clear;
                    let wanted = counts | active;
                    if l.any(wanted) {
                        let index = l.i(span.index);
                        let before = index - l.i(1);
                        let lacks_front = counts & !l.eq_i(taken, before);
                        if l.any(lacks_front) {
                            add_one(l, &mut self.samples, lacks_front);
                            let front = rays.offset(l.to_f(before));
                            let front_place = field.locate(l, front, lacks_front);
                            field.need_voxels(l, lacks_front);
                            let value = field.value::<K>(l, &front_place, front);
                            value_before = l.pick(lacks_front, value, value_before);
                            place = field.locate(l, offset, lacks_front);
                        }
                        field.need_voxels(l, wanted);
                        add_one(l, &mut self.samples, wanted);
                        let value = field.value::<K>(l, &place, offset);
                        let at = table.index(l, value_before, value);
                        let opacity = table.channel(l, &at, 3);
                        let seen = counts & l.gt(opacity, zero);
                        if l.any(seen) {
                            add_one(l, &mut self.contributing, seen);
                            let divisor = l.pick(seen, opacity, one);
                            let mut color = axes!(c => table.channel(l, &at, c) / divisor);
                            if let Some(light) = &scene.light {
                                let filter = scene.gradient_filter;
                                let mut gradient = world_gradient::<L, K>(
                                    l, filter, field, level, &place, offset, seen,
                                );
                                if scene.geometry.faces.have_normals {
                                    let at_face = between.is_at_face(l, span.index - 1);
                                    gradient = at_face_normal(l, at_face, part, gradient);
                                }
                                color = light.shade(l, color, gradient, rays.direction);
                            }
                            let opacity = between.opacity(l, span.index - 1, opacity);
                            sum.add(l, seen, color, opacity);
                            let opaque = sum.opaque(l, seen, scene.opacity_cutoff);
                            self.depths.note(
                                l,
                                level.step_mm,
                                l.f(span.index as f32),
                                seen,
                                opaque,
                            );
                            if l.any(opaque) {
                                let passed = span.count_to(l, index);
                                add(l, &mut self.passed, opaque, passed);
                                alive = alive & !opaque;
                                span.end_with(l, alive);
                            }
                        }
                        taken = l.pick_i(wanted, index, taken);
                        value_before = l.pick(wanted, value, value_before);
                    }
                    if l.any(active) {
                        span.index += 1;
                    } else {
                        let next = field.behind(l, &rays, &room);
                        span.leap(l, alive, here & alive, next);
                    }
                }
                let passed = span.count_to(l, rays.last);
                add(l, &mut self.passed, alive, passed);
            }
            let before = alive;
            alive = sum.meet(l, part, alive, scene.opacity_cutoff);
            self.note_layers(part, before, alive);
        }
        sum.0
    }
}
