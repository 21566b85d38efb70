//! Mode iso: surfaces of up to eight values, opaque and translucent.
//!
//! The values tell zones: a sample's zone is the number of surfaces on whose upper sides it lies. Where two successive
//! samples differ in theirs, the ray meets the surfaces in between, in order.

use super::cast::{Caster, Scene, Sum, add, add_one};
use super::field::{Field, VoxelKind};
use super::gradient::world_gradient;
use super::rays::{Rays, Vec3, axes};
use super::simd::Lanes;
use super::skip::{DISTANCE, ZONE_SHIFT};
use super::span::Span;
use crate::scene::{ClassifiedSurface, Contribution, LevelFrame};

/// The surfaces by rising value, as lanes look them up.
#[derive(Debug)]
pub(super) struct SurfaceTable {
    values: Vec<f32>,
    opacities: Vec<f32>,
    colors: [Vec<f32>; 3],
}

impl SurfaceTable {
    pub(super) fn new(surfaces: &[ClassifiedSurface]) -> Self {
        Self {
            values: surfaces.iter().map(|s| s.value).collect(),
            opacities: surfaces.iter().map(|s| s.opacity).collect(),
            colors: [0, 1, 2].map(|c| surfaces.iter().map(|s| s.color[c]).collect()),
        }
    }

    /// Numbers of the zones that values are in.
    #[inline(always)]
    pub(super) fn zone<L: Lanes>(&self, l: L, value: L::F) -> L::I {
        let (zero, one) = (l.i(0), l.i(1));
        let mut zone = zero;
        for &surface in &self.values {
            zone = zone + l.pick_i(l.ge(value, l.f(surface)), one, zero);
        }
        zone
    }
}

/// Lanes that have met surface number `number` between sample `index` − 1 and `index`, which lies above it or not.
struct Hit<L: Lanes> {
    index: i32,
    number: L::I,
    above: L::M,
    lanes: L::M,
}

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    #[inline(always)]
    pub(super) fn surfaces<K: VoxelKind>(&mut self) -> [L::F; 4] {
        let (l, scene) = (self.l, self.scene);
        let surfaces = &scene.surfaces;
        let mut sum = Sum::new(l);
        let mut alive = self.packet.inside;
        for part in self.parts {
            for (n, level) in scene.levels() {
                let mut rays = Rays::new(l, scene.frame, level, &self.packet);
                let between = rays.cut(l, &self.packet, part, level.step_mm, Contribution::Segment);
                let last = rays.last;
                alive = self.cap::<K>((n, level), (&rays, part, &between), &mut sum, alive);
                let mut span = Span::new(l, rays.first, last, self.interval(n), alive);
                let field = &mut self.fields[n];
                // A segment has the level of its first sample, and both ends are sampled there (design.md §3).
                let (mut zone_before, mut has_before) = (l.i(0), l.mask(0));
                while span.index <= span.end {
                    let here = span.here(l) & alive;
                    let offset = rays.offset(l.f(span.index as f32));
                    let place = field.locate(l, offset, here);
                    let byte = field.skip_byte(l, &place);
                    let distance = byte & l.i(i32::from(DISTANCE));
                    let active = here & l.eq_i(distance, l.i(0));
                    let mut zone = l.shr_u::<ZONE_SHIFT>(byte);
                    if l.any(active) {
                        let value = field.value::<K>(l, &place, offset);
                        zone = l.pick_i(active, surfaces.zone(l, value), zone);
                        add_one(l, &mut self.samples, active);
                    }
                    let mut met = here & has_before & !l.eq_i(zone, zone_before);
                    while l.any(met) {
                        let above = l.gt_i(zone, zone_before);
                        // Upwards the next surface is the one at the end of the zone, downwards the one at its beginning.
                        let step = l.pick_i(above, l.i(1), l.i(-1));
                        let hit = Hit {
                            index: span.index,
                            number: zone_before + l.pick_i(above, l.i(0), l.i(-1)),
                            above,
                            lanes: met,
                        };
                        let opacity = l.look_up(&surfaces.opacities, hit.number);
                        let (at, color) = surface::<L, K>(l, scene, field, level, &rays, hit);
                        // On the other side of a layer it belongs to another part.
                        let shows = met & between.contains(l, at);
                        add_one(l, &mut self.contributing, shows);
                        sum.add(l, shows, color, opacity);
                        let opaque = sum.opaque(l, shows, scene.opacity_cutoff);
                        self.depths.note(l, level.step_mm, at, shows, opaque);
                        if l.any(opaque) {
                            let passed = span.count_to(l, l.i(span.index));
                            add(l, &mut self.passed, opaque, passed);
                            alive = alive & !opaque;
                            span.end_with(l, alive);
                        }
                        zone_before = zone_before + l.pick_i(met, step, l.i(0));
                        met = met & !opaque & !l.eq_i(zone, zone_before);
                    }
                    zone_before = l.pick_i(here, zone, zone_before);
                    has_before = has_before | here;
                    if l.any(active) {
                        span.index += 1;
                    } else {
                        let room = field.blocks_around(l, &place, distance);
                        let next = field.behind(l, &rays, &room);
                        span.leap(l, alive, here & alive, next);
                    }
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

/// Where, in samples, `hit` lanes have met their surfaces, and the colours there.
#[inline(always)]
fn surface<L: Lanes, K: VoxelKind>(
    l: L,
    scene: &Scene<'_>,
    field: &mut Field<'_, '_, L>,
    level: &LevelFrame,
    rays: &Rays<L>,
    hit: Hit<L>,
) -> (L::F, Vec3<L>) {
    let index = l.f(hit.index as f32);
    let mut at = index;
    if scene.refine {
        let iso = l.look_up(&scene.surfaces.values, hit.number);
        // Six bisection steps (techniques.md T1.3).
        at = index - l.f(0.5);
        let mut half = 0.25;
        for _ in 0..6 {
            let offset = rays.offset(at);
            let place = field.locate(l, offset, hit.lanes);
            let byte = field.skip_byte(l, &place);
            let inactive = !l.eq_i(byte & l.i(i32::from(DISTANCE)), l.i(0));
            let value = field.value::<K>(l, &place, offset);
            let above = (l.gt_i(l.shr_u::<ZONE_SHIFT>(byte), hit.number) & inactive)
                | (l.ge(value, iso) & !inactive);
            let differs = (above & !hit.above) | (hit.above & !above);
            at = at + l.pick(differs, l.f(half), l.f(-half));
            half *= 0.5;
        }
    }
    let color = axes!(n => l.look_up(&scene.surfaces.colors[n], hit.number));
    let color = match &scene.light {
        None => color,
        Some(light) => {
            let offset = rays.offset(at);
            let place = field.locate(l, offset, hit.lanes);
            field.need_voxels(l, hit.lanes);
            let filter = scene.gradient_filter;
            let gradient =
                world_gradient::<L, K>(l, filter, field, level, &place, offset, hit.lanes);
            light.shade(l, color, gradient, rays.direction)
        }
    };
    (at, color)
}
