//! Modes dvr, xray and gradient: samples composited front to back.

use super::cast::{Caster, Sum, add, add_one};
use super::field::VoxelKind;
use super::gradient::world_gradient;
use super::parts::at_face_normal;
use super::rays::{Rays, dot};
use super::simd::{Lanes, PerLane};
use super::span::Span;
use crate::scene::Contribution;

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    #[inline(always)]
    pub(super) fn composite<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let zero = l.f(0.0);
        let mut sum = Sum::new(l);
        let mut alive = self.packet.inside;
        for part in self.parts {
            for (n, level) in scene.levels() {
                let mut rays = Rays::new(l, scene.frame, level, &self.packet);
                let between = rays.cut(l, &self.packet, part, level.step_mm, Contribution::Sample);
                // The sample at a switch is the coarser level's.
                let last = l.min_i(rays.last, l.i(level.end as i32 - 1));
                alive = self.cap::<K>((n, level), (&rays, part, &between), &mut sum, alive);
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
                        let room = field.blocks_around(l, &place, distance);
                        let next = field.behind(l, &rays, &room);
                        span.leap(l, alive, here, next);
                        continue;
                    }
                    add_one(l, &mut self.samples, active);
                    let at = table.index(l, field.value::<K>(l, &place, offset));
                    let mut opacity = table.opacity(l, &at);
                    let mut seen = active & l.gt(opacity, zero);
                    if l.any(seen) {
                        let mut color = table.color(l, &at);
                        if scene.light.is_some() || scene.gradient_scale.is_some() {
                            let filter = scene.gradient_filter;
                            let mut gradient = world_gradient::<L, K>(
                                l, filter, field, level, &place, offset, seen,
                            );
                            if let Some(scale) = scene.gradient_scale {
                                // The table has optical depths.
                                let length = l.sqrt(dot::<L>(gradient, gradient));
                                let strength = l.min(length * l.f(scale), l.f(1.0));
                                let share = between.share(l, span.index);
                                opacity = l.f(1.0) - passing(l, opacity * strength * share, seen);
                                seen = seen & l.gt(opacity, zero);
                            }
                            if scene.geometry.faces.have_normals {
                                let at_face = between.is_at_face(l, span.index);
                                gradient = at_face_normal(l, at_face, part, gradient);
                            }
                            if let Some(light) = &scene.light {
                                color = light.shade(l, color, gradient, rays.direction);
                            }
                        }
                        if scene.gradient_scale.is_none() {
                            opacity = between.opacity(l, span.index, opacity);
                        }
                        add_one(l, &mut self.contributing, seen);
                        sum.add(l, seen, color, opacity);
                        let opaque = sum.opaque(l, seen, scene.opacity_cutoff);
                        self.depths
                            .note(l, level.step_mm, l.f(span.index as f32), seen, opaque);
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
            let before = alive;
            alive = sum.meet(l, part, alive, scene.opacity_cutoff);
            self.note_layers(part, before, alive);
        }
        sum.0
    }
}

/// e^−depth in `lanes`: what passes. Lane by lane with the function that the reference has, for the same bits; beside the
/// six values of a gradient it costs little.
#[inline(always)]
fn passing<L: Lanes>(l: L, depth: L::F, lanes: L::M) -> L::F {
    let mut each = l.store_f(depth);
    negative_exponentials(&mut each, l.bits(lanes));
    l.load_f(&each)
}

/// e^−v of the values in `lanes` (bits).
#[inline(never)]
fn negative_exponentials(values: &mut PerLane<f32>, lanes: u32) {
    for (lane, v) in values.iter_mut().enumerate() {
        if lanes >> lane & 1 == 1 {
            *v = (-*v).exp();
        }
    }
}
