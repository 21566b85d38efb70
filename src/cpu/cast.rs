//! The casters: one loop per kind of mode over the sample grid of the frame, level by level, a packet of rays in step. The
//! twins of [`crate::reference`], which take every sample; these skip blocks in which nothing can be seen.
//!
//! A packet goes from sample to sample together. Where no lane is in an active block, it goes on to the first sample at
//! which one may be (invariant 4 of design.md: what is in between contributes nothing, and in mode iso is in one zone).

use super::field::{Field, VoxelKind};
use super::intervals::{Interval, Intervals};
use super::light::Light;
use super::parts::{PacketPart, packet_parts};
use super::rays::{Packet, Vec3};
use super::simd::{Lanes, PerLane};
use super::surfaces::SurfaceTable;
use super::table::{SegmentTable, Table};
use crate::clip::Geometry;
use crate::scene::{GradientFilter, Interpolation, LevelFrame, Mode, RayCounts, RayFrame, Shading};

/// What all packets of a picture share.
#[derive(Debug)]
pub(super) struct Scene<'a> {
    pub(super) frame: &'a RayFrame,
    pub(super) mode: Mode,
    /// One per level that is sampled.
    pub(super) tables: &'a [Table],
    /// The same of a pre-integrated picture; empty otherwise.
    pub(super) segments: Vec<SegmentTable<'a>>,
    pub(super) intervals: &'a [Intervals],
    /// Is something skipped?
    pub(super) skips: bool,
    /// Is it told how far rays went?
    pub(super) depths: bool,
    pub(super) geometry: &'a Geometry,
    /// What the meshes of the geometry are lit by, the volume or not.
    pub(super) shading: &'a Shading,
    pub(super) light: Option<Light>,
    pub(super) gradient_filter: GradientFilter,
    /// In mode gradient: by what a gradient's length is multiplied.
    pub(super) gradient_scale: Option<f32>,
    pub(super) interpolation: Interpolation,
    pub(super) surfaces: SurfaceTable,
    /// Are surfaces found to a part of a step?
    pub(super) refine: bool,
    pub(super) opacity_cutoff: f32,
    pub(super) search: Search,
}

/// How modes mip and minip look for their extreme; values are times `sign`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    pub(super) sign: f32,
    /// No sample is below.
    pub(super) begin: f32,
    /// None is above.
    pub(super) end: f32,
}

impl<'a> Scene<'a> {
    pub(super) fn levels(&self) -> impl Iterator<Item = (usize, &'a LevelFrame)> {
        self.frame.used().iter().enumerate()
    }
}

/// Premultiplied colour and opacity, per lane.
pub(super) type Colors = [PerLane<f32>; 4];

/// Draws a packet: its colours, and where they are told its depths. `fields`: one per level that is sampled.
#[inline(always)]
pub(super) fn cast<L: Lanes, K: VoxelKind>(
    l: L,
    scene: &Scene<'_>,
    fields: &mut [Field<'_, '_, L>],
    packet: Packet<L>,
    counts: &mut RayCounts,
) -> (Colors, [PerLane<f32>; 2]) {
    let cut;
    let parts: &[PacketPart] = if scene.geometry.is_empty() {
        &[PacketPart::WHOLE]
    } else {
        cut = packet_parts(scene, packet.planes(l));
        &cut
    };
    let mut caster = Caster {
        l,
        scene,
        parts,
        packet,
        fields,
        samples: l.i(0),
        passed: l.i(0),
        contributing: l.i(0),
        depths: Depths {
            is_told: scene.depths,
            first_mm: packet.first_mm,
            first: l.f(f32::INFINITY),
            end: l.f(f32::INFINITY),
        },
    };
    let color = match scene.mode {
        Mode::Iso => caster.surfaces::<K>(),
        Mode::Mip | Mode::MinIp => caster.extreme::<K>(),
        Mode::Mean => caster.mean::<K>(),
        Mode::Dvr if !scene.segments.is_empty() => caster.segments::<K>(),
        Mode::Dvr | Mode::Xray | Mode::Gradient => caster.composite::<K>(),
    };
    let taken = sum(l, caster.samples);
    *counts += RayCounts {
        samples: taken,
        skipped: sum(l, caster.passed) - taken,
        contributing: sum(l, caster.contributing),
    };
    let [r, g, b, a] = color;
    let Depths { first, end, .. } = caster.depths;
    let colors = [l.store_f(r), l.store_f(g), l.store_f(b), l.store_f(a)];
    (colors, [l.store_f(first), l.store_f(end)])
}

/// A packet on its way.
pub(super) struct Caster<'s, 'f, 'n, 'a, L: Lanes> {
    pub(super) l: L,
    pub(super) scene: &'s Scene<'f>,
    pub(super) packet: Packet<L>,
    /// In order; of each all lanes' together.
    pub(super) parts: &'s [PacketPart],
    pub(super) fields: &'s mut [Field<'n, 'a, L>],
    /// Per lane: samples taken, samples of the parts that are done, samples that counted.
    pub(super) samples: L::I,
    pub(super) passed: L::I,
    pub(super) contributing: L::I,
    pub(super) depths: Depths<L>,
}

impl<L: Lanes> Caster<'_, '_, '_, '_, L> {
    /// The samples of level number `n` that the packet's rays may have to take.
    pub(super) fn interval(&self, n: usize) -> Interval {
        self.scene.intervals[n].around(self.packet.cells())
    }
}

/// How far rays went.
#[derive(Clone, Copy)]
pub(super) struct Depths<L: Lanes> {
    /// Does anyone ask?
    pub(super) is_told: bool,
    /// Distances of samples 0, mm.
    first_mm: L::F,
    /// Distances of what they met first and of what ended them, mm; infinite where nothing did.
    first: L::F,
    end: L::F,
}

impl<L: Lanes> Depths<L> {
    /// The lanes `met` meet something at sample `index` of a level, which ends those of `ended`.
    #[inline(always)]
    pub(super) fn note(&mut self, l: L, step_mm: f32, index: L::F, met: L::M, ended: L::M) {
        if self.is_told {
            self.note_mm(l, self.first_mm + index * l.f(step_mm), met, ended);
        }
    }

    /// The same at a distance.
    #[inline(always)]
    pub(super) fn note_mm(&mut self, l: L, at_mm: L::F, met: L::M, ended: L::M) {
        self.first = l.pick(met, l.min(self.first, at_mm), self.first);
        self.end = l.pick(met & ended, at_mm, self.end);
    }
}

/// Premultiplied colour and opacity that rays have gathered.
#[derive(Clone, Copy)]
pub(super) struct Sum<L: Lanes>(pub(super) [L::F; 4]);

impl<L: Lanes> Sum<L> {
    #[inline(always)]
    pub(super) fn new(l: L) -> Self {
        Self([l.f(0.0); 4])
    }

    /// Composites behind what is there, in `lanes`; colours must be finite in all.
    #[inline(always)]
    pub(super) fn add(&mut self, l: L, lanes: L::M, color: Vec3<L>, opacity: L::F) {
        let sum = &mut self.0;
        let weight = (l.f(1.0) - sum[3]) * l.pick(lanes, opacity, l.f(0.0));
        for c in 0..3 {
            sum[c] = sum[c] + color[c] * weight;
        }
        sum[3] = sum[3] + weight;
    }

    /// Those of `lanes` that are as opaque as is asked for.
    #[inline(always)]
    pub(super) fn opaque(&self, l: L, lanes: L::M, cutoff: f32) -> L::M {
        lanes & l.ge(self.0[3], l.f(cutoff))
    }
}

/// Over all lanes.
#[inline(always)]
fn sum<L: Lanes>(l: L, v: L::I) -> u64 {
    l.store_i(v)[..L::WIDTH].iter().map(|&n| n as u64).sum()
}

/// Adds `n` in the lanes of `m`.
#[inline(always)]
pub(super) fn add<L: Lanes>(l: L, sum: &mut L::I, m: L::M, n: L::I) {
    *sum = *sum + l.pick_i(m, n, l.i(0));
}

/// Adds 1 in the lanes of `m`.
#[inline(always)]
pub(super) fn add_one<L: Lanes>(l: L, sum: &mut L::I, m: L::M) {
    add(l, sum, m, l.i(1));
}
