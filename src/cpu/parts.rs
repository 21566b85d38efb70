//! Rays of a packet cut to parts by the picture's geometry ([`crate::scene::RayPart`]), part by part in all lanes together.

use super::cast::{Caster, Scene, Sum, add_one};
use super::field::VoxelKind;
use super::rays::{Packet, Rays, Vec3, axes};
use super::simd::{Lanes, MAX_LANES, PerLane};
use crate::scene::{Contribution, LevelFrame, Mode, RayPart, ray_parts};

/// Part number p of each lane's ray.
#[derive(Clone)]
pub(super) struct PacketPart {
    begin_mm: PerLane<f32>,
    end_mm: PerLane<f32>,
    since_mm: PerLane<f32>,
    /// Lanes (bits) whose ray has such a part, which goes on behind a layer, which ends at one.
    exists: u32,
    continues: u32,
    has_layer: u32,
    /// Lanes whose part begins at a cut face, and the faces' normals.
    pub(super) is_cut: u32,
    normals: [PerLane<f32>; 3],
    /// Premultiplied colour and opacity of the layers.
    layers: [PerLane<f32>; 4],
}

impl PacketPart {
    /// All of every ray.
    pub(super) const WHOLE: Self = Self {
        begin_mm: [f32::NEG_INFINITY; MAX_LANES],
        end_mm: [f32::INFINITY; MAX_LANES],
        since_mm: [f32::NEG_INFINITY; MAX_LANES],
        exists: u32::MAX,
        continues: 0,
        has_layer: 0,
        is_cut: 0,
        normals: [[0.0; MAX_LANES]; 3],
        layers: [[0.0; MAX_LANES]; 4],
    };

    /// Normals of the cut faces.
    #[inline(always)]
    pub(super) fn normal<L: Lanes>(&self, l: L) -> Vec3<L> {
        axes!(n => l.load_f(&self.normals[n]))
    }

    fn set(&mut self, lane: usize, part: &RayPart) {
        let bit = 1 << lane;
        self.begin_mm[lane] = part.begin_mm;
        self.end_mm[lane] = part.end_mm;
        self.since_mm[lane] = part.since_mm;
        self.exists |= bit;
        if part.continues {
            self.continues |= bit;
        }
        if let Some(normal) = part.cut {
            self.is_cut |= bit;
            for (values, value) in self.normals.iter_mut().zip(normal.to_array()) {
                values[lane] = value;
            }
        }
        if let Some(layer) = part.layer {
            self.has_layer |= bit;
            for (values, value) in self.layers.iter_mut().zip(layer.to_array()) {
                values[lane] = value;
            }
        }
    }
}

/// The parts of a packet's rays, in order.
#[inline(never)]
pub(super) fn packet_parts(scene: &Scene<'_>, planes: Vec<[f32; 2]>) -> Vec<PacketPart> {
    let mut parts: Vec<PacketPart> = Vec::new();
    for (lane, plane) in planes.into_iter().enumerate() {
        let of_ray = ray_parts(scene.frame, scene.geometry, scene.shading, plane);
        for (number, part) in of_ray.iter().enumerate() {
            if number == parts.len() {
                parts.push(PacketPart {
                    exists: 0,
                    ..PacketPart::WHOLE
                });
            }
            parts[number].set(lane, part);
        }
    }
    parts
}

/// A part in the samples of a level.
#[derive(Clone, Copy)]
pub(super) struct Between<L: Lanes> {
    /// Lanes that have it, with volume in it.
    has_some: L::M,
    /// Where it begins, between samples.
    begin: L::F,
    /// The layers at its ends; far away where there is none.
    layers: [L::F; 2],
    /// Lanes in which what is near the beginning is lit by the normal of the cut face there.
    faces: L::M,
}

impl<L: Lanes> Between<L> {
    /// How much of the segment behind sample `index` lies between the layers, 0 to 1.
    #[inline(always)]
    pub(super) fn share(&self, l: L, index: i32) -> L::F {
        let [begin, end] = self.layers;
        l.min(l.f(index as f32 + 1.0), end) - l.max(l.f(index as f32), begin)
    }

    /// Lanes in which sample `index`, or the segment behind it, is lit by the normal of a cut face.
    #[inline(always)]
    pub(super) fn is_at_face(&self, l: L, index: i32) -> L::M {
        self.faces & l.gt(self.begin + l.f(1.0), l.f(index as f32))
    }

    /// The opacity of a part of the segment behind sample `index`.
    #[inline(always)]
    pub(super) fn opacity(&self, l: L, index: i32, opacity: L::F) -> L::F {
        let share = self.share(l, index);
        let parts = l.gt(l.f(1.0), share);
        if !l.any(parts) {
            return opacity;
        }
        let mut each = l.store_f(opacity);
        opacities_of_shares(&mut each, &l.store_f(share), l.bits(parts));
        l.load_f(&each)
    }

    /// Lanes in which the place `at` lies between the layers.
    #[inline(always)]
    pub(super) fn contains(&self, l: L, at: L::F) -> L::M {
        let [begin, end] = self.layers;
        l.ge(at, begin) & l.gt(end, at)
    }
}

/// The gradient, or in `lanes` the normal of the cut face.
#[inline(always)]
pub(super) fn at_face_normal<L: Lanes>(
    l: L,
    lanes: L::M,
    part: &PacketPart,
    gradient: Vec3<L>,
) -> Vec3<L> {
    let normal = part.normal(l);
    axes!(n => l.pick(lanes, normal[n], gradient[n]))
}

/// Lane by lane with the function that the reference has, for the same bits.
#[inline(never)]
fn opacities_of_shares(opacities: &mut PerLane<f32>, shares: &PerLane<f32>, lanes: u32) {
    for (lane, opacity) in opacities.iter_mut().enumerate() {
        if lanes >> lane & 1 == 1 {
            *opacity = 1.0 - (1.0 - *opacity).powf(shares[lane]);
        }
    }
}

impl<L: Lanes> Rays<L> {
    /// Leaves of the samples those of `part`.
    #[inline(always)]
    pub(super) fn cut(
        &mut self,
        l: L,
        packet: &Packet<L>,
        part: &PacketPart,
        step_mm: f32,
        of: Contribution,
    ) -> Between<L> {
        let (zero, one) = (l.f(0.0), l.f(1.0));
        let splits = of != Contribution::Value;
        let continues = l.mask(if splits { part.continues } else { 0 });
        let has_layer = l.mask(if splits { part.has_layer } else { 0 });
        let exists = l.mask(part.exists);
        let at = |mm: &PerLane<f32>| (l.load_f(mm) - packet.first_mm) / l.f(step_mm);
        let (begin, end) = (at(&part.begin_mm), at(&part.end_mm));
        let ceil = zero - l.floor(zero - begin);
        // The sample in front of a layer is taken on both sides of it, if it is kept.
        let before = l.floor(begin);
        let is_kept = l.ge(before, at(&part.since_mm));
        let first = l.pick(continues & is_kept, before, ceil);
        // With segments the sample behind a layer is taken, too.
        let is_far_end_needed = l.mask(match of {
            Contribution::Segment => part.has_layer,
            Contribution::Sample | Contribution::Value => 0,
        });
        let last = zero - l.floor(zero - end) - l.pick(is_far_end_needed, zero, one);
        let bounded = |v| l.to_i(l.max(l.min(v, l.f(2e9)), l.f(-2e9)));
        let has_some = exists & l.gt(end, begin);
        self.first = l.max_i(self.first, bounded(first));
        self.last = l.pick_i(has_some, l.min_i(self.last, bounded(last)), l.i(-1));
        Between {
            has_some,
            begin,
            layers: [
                l.pick(continues, begin, l.f(-1e30)),
                l.pick(has_layer, end, l.f(1e30)),
            ],
            faces: l.mask(part.is_cut),
        }
    }
}

impl<L: Lanes> Sum<L> {
    /// Composites the layers behind `part` in `alive` lanes; what is left of these.
    #[inline(always)]
    pub(super) fn meet(&mut self, l: L, part: &PacketPart, alive: L::M, cutoff: f32) -> L::M {
        if part.has_layer == 0 {
            return alive;
        }
        let has_layer = alive & l.mask(part.has_layer);
        self.add_layers(l, part, has_layer);
        alive
            & !(has_layer & l.ge(l.load_f(&part.layers[3]), l.f(1.0)))
            & !self.opaque(l, has_layer, cutoff)
    }

    #[inline(always)]
    fn add_layers(&mut self, l: L, part: &PacketPart, lanes: L::M) {
        let rest = l.pick(lanes, l.f(1.0) - self.0[3], l.f(0.0));
        for (sum, layer) in self.0.iter_mut().zip(&part.layers) {
            *sum = *sum + l.load_f(layer) * rest;
        }
    }
}

/// In modes that project: translucent layers are in front of the projection, wherever they lie; an opaque one is behind it.
#[derive(Clone, Copy)]
pub(super) struct Backdrop<L: Lanes> {
    front: Sum<L>,
    back: Sum<L>,
}

impl<L: Lanes> Backdrop<L> {
    #[inline(always)]
    pub(super) fn new(l: L) -> Self {
        Self {
            front: Sum::new(l),
            back: Sum::new(l),
        }
    }

    /// Adds the layers behind `part` in `alive` lanes; what is left of these.
    #[inline(always)]
    pub(super) fn meet(&mut self, l: L, part: &PacketPart, alive: L::M, cutoff: f32) -> L::M {
        if part.has_layer == 0 {
            return alive;
        }
        let has_layer = alive & l.mask(part.has_layer);
        let walls = has_layer & l.ge(l.load_f(&part.layers[3]), l.f(1.0));
        self.back.add_layers(l, part, walls);
        self.front.add_layers(l, part, has_layer & !walls);
        alive & !walls & !self.front.opaque(l, has_layer, cutoff)
    }

    /// With what was projected between them.
    #[inline(always)]
    pub(super) fn around(&self, l: L, projected: [L::F; 4]) -> [L::F; 4] {
        let mut all = self.front.0;
        let rest_of_projected = l.f(1.0) - projected[3];
        let rest = l.f(1.0) - all[3];
        for c in 0..4 {
            all[c] = all[c] + (projected[c] + self.back.0[c] * rest_of_projected) * rest;
        }
        all
    }
}

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    /// Shows the data where the parts of `alive` lanes begin, at level number `n`, at capped cut faces. The lanes that go on.
    #[inline(always)]
    pub(super) fn cap<K: VoxelKind>(
        &mut self,
        (n, level): (usize, &LevelFrame),
        (rays, part, between): (&Rays<L>, &PacketPart, &Between<L>),
        sum: &mut Sum<L>,
        alive: L::M,
    ) -> L::M {
        let (l, scene) = (self.l, self.scene);
        if !scene.geometry.faces.are_capped || part.is_cut == 0 {
            return alive;
        }
        // Elsewhere the part may begin nowhere.
        let begin = l.pick(between.has_some, between.begin, l.f(-1.0));
        let at = rays.offset(begin);
        let mut here = alive & between.has_some & l.mask(part.is_cut);
        here = here & l.ge(begin, l.f(level.begin as f32));
        if n + 1 < scene.frame.used_levels {
            here = here & l.gt(l.f(level.end as f32), begin);
        }
        for (axis, &at) in at.iter().enumerate() {
            here = here & l.ge(at, l.f(level.box_min[axis]));
            here = here & l.ge(l.f(level.box_max[axis]), at);
        }
        if !l.any(here) {
            return alive;
        }
        let field = &mut self.fields[n];
        let place = field.locate(l, at, here);
        field.need_voxels(l, here);
        let value = field.value::<K>(l, &place, at);
        let table = &scene.tables[n];
        let index = table.index(l, value);
        let shows = here
            & match scene.mode {
                Mode::Iso => l.gt_i(scene.surfaces.zone(l, value), l.i(0)),
                _ => l.gt(table.opacity(l, &index), l.f(0.0)),
            };
        let mut color = table.color(l, &index);
        if let Some(light) = &scene.light {
            color = light.shade(l, color, part.normal(l), rays.direction);
        }
        add_one(l, &mut self.contributing, shows);
        sum.add(l, shows, color, l.f(1.0));
        self.depths.note(l, level.step_mm, begin, shows, shows);
        alive & !shows
    }
}

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    /// The layers behind `part` are met by the lanes `before`, of which `after` go on.
    #[inline(always)]
    pub(super) fn note_layers(&mut self, part: &PacketPart, before: L::M, after: L::M) {
        let l = self.l;
        if self.depths.is_told && part.has_layer != 0 {
            let met = before & l.mask(part.has_layer);
            self.depths.note_mm(l, l.load_f(&part.end_mm), met, !after);
        }
    }
}
