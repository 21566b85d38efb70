//! What a sample does to its ray, mode by mode (cli.md, "Colour").

use glam::{Vec3, Vec4};

use super::caster::Ray;
use super::field::FieldReader;
use crate::classify::PreintegratedTable;
use crate::scene::{
    Classified, ClassifiedLevel, ClassifiedSurface, GradientFilter, Interpolation, LevelFrame,
    Mode, NO_DEPTHS, PartSamples, PictureSettings, RayCounts, RayPart, ShadingModel, phong,
};

/// One ray, and what its samples have come to.
pub(super) struct Caster<'r, 'f, 'a> {
    /// One per level.
    readers: &'r mut [FieldReader<'f>],
    settings: &'a PictureSettings,
    classified: &'a Classified,
    /// The level that is sampled.
    place: Option<Place<'a>>,
    /// Premultiplied colour and opacity; in modes that project, of the layers in front.
    sum: Vec4,
    /// In modes that project: what ended the ray.
    back: Vec4,
    /// The sample before, at the same level.
    before: Option<f32>,
    /// Modes mip and minip: the extreme so far.
    extreme: Option<f32>,
    /// Mode mean: samples, each times the base steps that it stands for, and those steps.
    mean: [f32; 2],
    pub(super) counts: RayCounts,
    /// Distances of what it met first and of what ended it, mm.
    pub(super) depths: [f32; 2],
}

/// Where a ray is.
#[derive(Clone, Copy)]
struct Place<'a> {
    /// Number of the level in the frame.
    number: usize,
    level: &'a LevelFrame,
    /// Distance of its sample 0, mm.
    first_mm: f32,
    ray: Ray,
    tables: &'a ClassifiedLevel,
    /// The part of the ray, and the normal of the cut face at which it begins.
    samples: PartSamples,
    cut: Option<Vec3>,
}

impl<'r, 'f, 'a> Caster<'r, 'f, 'a> {
    pub(super) fn new(
        readers: &'r mut [FieldReader<'f>],
        settings: &'a PictureSettings,
        classified: &'a Classified,
    ) -> Self {
        Self {
            readers,
            settings,
            classified,
            place: None,
            sum: Vec4::ZERO,
            back: Vec4::ZERO,
            before: None,
            extreme: None,
            mean: [0.0; 2],
            counts: RayCounts::default(),
            depths: NO_DEPTHS,
        }
    }

    /// The next samples are of this level, and follow none.
    pub(super) fn begin_level(
        &mut self,
        (number, level): (usize, &'a LevelFrame),
        first_mm: f32,
        ray: &Ray,
        part: &RayPart,
        samples: PartSamples,
    ) {
        self.place = Some(Place {
            number,
            level,
            first_mm,
            ray: *ray,
            tables: &self.classified.levels[number],
            samples,
            cut: part.cut,
        });
        self.before = None;
    }

    /// Takes sample `i` of the level. True when nothing more can change the ray.
    pub(super) fn take(&mut self, i: i32) -> bool {
        let Some(place) = self.place else {
            unreachable!("invariant: a level was begun")
        };
        self.counts.samples += 1;
        let offset = place.ray.offset(i as f32);
        let value = self.value(&place, offset);
        match (self.settings.mode, &place.tables.preintegrated) {
            (Mode::Dvr, Some(table)) => self.take_segment(&place, table, i, value),
            (Mode::Dvr | Mode::Xray, _) => self.take_sample(&place, i, value),
            (Mode::Gradient, _) => self.take_gradient(&place, i, value),
            (Mode::Iso, _) => self.take_surfaces(&place, i, value),
            (Mode::Mip, _) => self.take_extreme(value, |new, old| new > old),
            (Mode::MinIp, _) => self.take_extreme(value, |new, old| new < old),
            (Mode::Mean, _) => self.take_mean(&place, value),
        }
        self.before = Some(value);
        self.sum.w >= self.settings.opacity_cutoff
    }

    /// Meets the cut face at which the part begins, if it is one and capped. True when it ends the ray.
    pub(super) fn cap(&mut self, index: f32) -> bool {
        let (Some(place), faces) = (self.place, self.settings.geometry.faces) else {
            return false;
        };
        let Some(normal) = place.cut.filter(|_| faces.are_capped) else {
            return false;
        };
        let value = self.value(&place, place.ray.offset(index));
        let [r, g, b, a] = place.tables.lut.sample(value);
        let shows = match self.settings.mode {
            Mode::Iso => self.classified.zone(value) > 0,
            mode => a > 0.0 && !mode.projects(),
        };
        if shows {
            let color = self.shaded(Vec3::new(r, g, b), normal, &place);
            self.add(&place, index, color, 1.0);
        }
        shows
    }

    /// Meets a layer behind the samples so far: lit colour, premultiplied, and opacity. True when nothing more can change
    /// the ray. In modes that project translucent layers are in front of the projection, wherever they lie.
    pub(super) fn meet(&mut self, layer: Vec4, at_mm: f32) -> bool {
        let ends = layer.w >= 1.0;
        if ends && self.settings.mode.projects() {
            self.back = layer;
        } else {
            self.sum += layer * (1.0 - self.sum.w);
        }
        let ends = ends || self.sum.w >= self.settings.opacity_cutoff;
        self.note(at_mm, ends);
        ends
    }

    /// Something is met, which may end the ray.
    fn note(&mut self, at_mm: f32, ends: bool) {
        let [first, end] = &mut self.depths;
        *first = first.min(at_mm);
        if ends {
            *end = at_mm;
        }
    }

    /// Premultiplied colour and opacity of the ray.
    pub(super) fn finish(&self) -> Vec4 {
        let value = match self.settings.mode {
            Mode::Mip | Mode::MinIp => self.extreme,
            Mode::Mean => (self.mean[1] > 0.0).then(|| self.mean[0] / self.mean[1]),
            _ => return self.sum,
        };
        // In these modes the tables of all levels are equal.
        let projected = value.map_or(Vec4::ZERO, |value| {
            let [r, g, b, a] = self.classified.levels[0].lut.sample(value);
            Vec4::new(r * a, g * a, b * a, a)
        });
        let behind = projected + self.back * (1.0 - projected.w);
        self.sum + behind * (1.0 - self.sum.w)
    }

    /// Composites what lies at sample `index` behind what is there.
    fn add(&mut self, place: &Place<'_>, index: f32, color: Vec3, opacity: f32) {
        self.counts.contributing += 1;
        self.sum += color.extend(1.0) * ((1.0 - self.sum.w) * opacity);
        let at_mm = place.first_mm + index * place.level.step_mm;
        self.note(at_mm, self.sum.w >= self.settings.opacity_cutoff);
    }

    fn take_sample(&mut self, place: &Place<'_>, i: i32, value: f32) {
        let [r, g, b, a] = place.tables.lut.sample(value);
        if a > 0.0 {
            let color = self.lit(Vec3::new(r, g, b), place, i, i);
            let opacity = opacity_of_share(a, place.samples.share(i));
            self.add(place, i as f32, color, opacity);
        }
    }

    /// The segment from the sample before, lit by the gradient at its far end.
    fn take_segment(&mut self, place: &Place<'_>, table: &PreintegratedTable, i: i32, value: f32) {
        let Some(before) = self.before else {
            return;
        };
        let [r, g, b, a] = table.sample(before, value);
        if a > 0.0 {
            let color = self.lit(Vec3::new(r, g, b) / a, place, i, i - 1);
            let opacity = opacity_of_share(a, place.samples.share(i - 1));
            self.add(place, i as f32, color, opacity);
        }
    }

    fn take_gradient(&mut self, place: &Place<'_>, i: i32, value: f32) {
        let [r, g, b, depth] = place.tables.lut.sample(value);
        if depth <= 0.0 {
            return;
        }
        let gradient = self.gradient(place, place.ray.offset(i as f32));
        let strength = (gradient.length() * self.classified.gradient_scale).min(1.0);
        let opacity = 1.0 - (-(depth * strength * place.samples.share(i))).exp();
        if opacity > 0.0 {
            let normal = self.face(place, i).unwrap_or(gradient);
            let color = self.shaded(Vec3::new(r, g, b), normal, place);
            self.add(place, i as f32, color, opacity);
        }
    }

    fn take_extreme(&mut self, value: f32, is_better: fn(f32, f32) -> bool) {
        if self.extreme.is_none_or(|extreme| is_better(value, extreme)) {
            // The volume's own extreme is where a search begins.
            let [floor, ceiling] = self.classified.value_range;
            let begin = if self.settings.mode == Mode::Mip {
                floor
            } else {
                ceiling
            };
            self.counts.contributing += u64::from(is_better(value, begin));
            self.extreme = Some(value);
        }
    }

    fn take_mean(&mut self, place: &Place<'_>, value: f32) {
        // Levels of a frame follow each other.
        let steps = (1_u32 << place.number) as f32;
        self.counts.contributing += 1;
        self.mean[0] += value * steps;
        self.mean[1] += steps;
    }

    /// Every surface whose value lies between the sample before and this one, in the order in which the ray meets them.
    fn take_surfaces(&mut self, place: &Place<'_>, i: i32, value: f32) {
        let Some(before) = self.before else {
            return;
        };
        let (from, to) = (self.classified.zone(before), self.classified.zone(value));
        let crossed: Vec<usize> = if from < to {
            (from..to).collect()
        } else {
            (to..from).rev().collect()
        };
        for k in crossed {
            let surface = self.classified.surfaces[k];
            let at = self.refine(place, &surface, i as f32, from < to);
            let [begin, end] = place.samples.between;
            if !(begin..end).contains(&at) {
                continue;
            }
            let color = self.lit_at(surface.color, place, place.ray.offset(at));
            self.add(place, at, color, surface.opacity);
            if self.sum.w >= self.settings.opacity_cutoff {
                return;
            }
        }
    }

    /// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3).
    fn refine(
        &mut self,
        place: &Place<'_>,
        surface: &ClassifiedSurface,
        index: f32,
        above: bool,
    ) -> f32 {
        if !self.settings.refine {
            return index;
        }
        let mut at = index - 0.5;
        let mut half = 0.25;
        for _ in 0..6 {
            let value = self.value(place, place.ray.offset(at));
            let beyond = (value >= surface.value) == above;
            at += if beyond { -half } else { half };
            half *= 0.5;
        }
        at
    }

    fn value(&mut self, place: &Place<'_>, offset: Vec3) -> f32 {
        let reader = &mut self.readers[place.number];
        match self.settings.interpolation {
            Interpolation::Linear => reader.trilinear(place.level.anchor, offset),
            Interpolation::Nearest => reader.nearest(place.level.anchor, offset),
        }
    }

    /// Central differences at ±½ voxel of the level, or their mean over seven points (design.md §3), in world units.
    fn gradient(&mut self, place: &Place<'_>, offset: Vec3) -> Vec3 {
        let difference = match self.settings.shading.gradient {
            GradientFilter::Central => self.central_difference(place, offset),
            GradientFilter::Filtered => {
                let mut sum = self.central_difference(place, offset);
                for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                    sum += self.central_difference(place, offset + axis * 0.5);
                    sum += self.central_difference(place, offset - axis * 0.5);
                }
                sum / 7.0
            }
        };
        place.level.normal_from_gradient * difference
    }

    fn central_difference(&mut self, place: &Place<'_>, offset: Vec3) -> Vec3 {
        let mut along = |axis: Vec3| {
            self.value(place, offset + axis * 0.5) - self.value(place, offset - axis * 0.5)
        };
        Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z))
    }

    /// The normal of the cut face that sample `i`, or the segment behind it, is lit by.
    fn face(&self, place: &Place<'_>, i: i32) -> Option<Vec3> {
        let is_lit_by_faces = self.settings.geometry.faces.have_normals;
        let cut = place.cut.filter(|_| is_lit_by_faces);
        cut.filter(|_| place.samples.is_at_face(i))
    }

    /// Lit by the gradient at sample `i`; by the normal of a cut face, where the segment behind sample `of` lies at one.
    fn lit(&mut self, color: Vec3, place: &Place<'_>, i: i32, of: i32) -> Vec3 {
        match self.face(place, of) {
            Some(normal) => self.shaded(color, normal, place),
            None => self.lit_at(color, place, place.ray.offset(i as f32)),
        }
    }

    fn lit_at(&mut self, color: Vec3, place: &Place<'_>, offset: Vec3) -> Vec3 {
        match self.settings.shading.model {
            ShadingModel::None => color,
            ShadingModel::Phong => {
                let gradient = self.gradient(place, offset);
                self.shaded(color, gradient, place)
            }
        }
    }

    fn shaded(&self, color: Vec3, gradient: Vec3, place: &Place<'_>) -> Vec3 {
        match self.settings.shading.model {
            ShadingModel::None => color,
            ShadingModel::Phong => {
                phong(color, gradient, place.ray.direction, &self.settings.shading)
            }
        }
    }
}

/// The opacity of a part of a segment whose opacity is `opacity`: as long as `share` of it.
fn opacity_of_share(opacity: f32, share: f32) -> f32 {
    if share < 1.0 {
        1.0 - (1.0 - opacity).powf(share)
    } else {
        opacity
    }
}
