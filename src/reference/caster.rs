//! The raycaster: one loop per mode over the sample grid of the frame, level by level, no skipping.

use std::sync::atomic::Ordering;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::field::{FieldReader, VoxelField};
use super::shade::phong;
use crate::classify::Lut;
use crate::scene::{
    Classified, Image, Interpolation, LevelFrame, Mode, PictureSettings, RayCounts, RayFrame,
    ShadingModel,
};
use crate::store::StoreError;

/// A picture and what it took.
#[derive(Debug)]
pub struct ReferencePicture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// Samples, summed over rays.
    pub counts: RayCounts,
    /// Bricks decoded.
    pub bricks_read: u64,
}

/// Draws the picture of `frame` on all threads of the current rayon pool. `fields` are of the levels that it samples,
/// finest first.
///
/// # Errors
/// A brick can't be read.
pub fn render(
    fields: &[VoxelField<'_>],
    frame: &RayFrame,
    classified: &Classified,
    settings: &PictureSettings,
) -> Result<ReferencePicture, StoreError> {
    let [width, height] = frame.size;
    let rows: Result<Vec<(Vec<Vec4>, RayCounts)>, StoreError> = (0..height)
        .into_par_iter()
        .map_init(
            || fields.iter().map(VoxelField::reader).collect::<Vec<_>>(),
            |readers, y| {
                let mut row = Vec::with_capacity(width as usize);
                let mut counts = RayCounts::default();
                for x in 0..width {
                    let spans = frame
                        .used()
                        .iter()
                        .zip(&classified.levels)
                        .map(|(level, table)| (Ray::new(frame, level, x, y), level, &table.lut));
                    let mut caster = Caster {
                        readers,
                        settings,
                        iso: classified.iso_stored,
                        value_floor: classified.value_floor,
                        counts: RayCounts::default(),
                    };
                    row.push(match settings.mode {
                        Mode::Dvr => caster.dvr(spans),
                        Mode::Iso => caster.iso(spans),
                        Mode::Mip => caster.mip(spans),
                    });
                    counts += caster.counts;
                }
                match readers.iter_mut().find_map(|r| r.error.take()) {
                    Some(error) => Err(error),
                    None => Ok((row, counts)),
                }
            },
        )
        .collect();
    let mut image = Image {
        width,
        height,
        pixels: Vec::with_capacity(width as usize * height as usize),
    };
    let mut counts = RayCounts::default();
    for (row, row_counts) in rows? {
        image.pixels.extend(row);
        counts += row_counts;
    }
    Ok(ReferencePicture {
        image,
        counts,
        bricks_read: fields
            .iter()
            .map(|f| f.bricks_read.load(Ordering::Relaxed))
            .sum(),
    })
}

/// A ray at one level as the shader has it: offsets in level voxels from the level's anchor, by sample of that level.
#[derive(Clone, Copy, Debug)]
struct Ray {
    /// Unit direction, world.
    direction: Vec3,
    /// Offset of sample 0.
    base: Vec3,
    /// From a sample to the next.
    step: Vec3,
    /// First and last sample inside the volume and the level's part of the ray; empty when first > last.
    first: i32,
    last: i32,
}

impl Ray {
    fn new(frame: &RayFrame, level: &LevelFrame, x: u32, y: u32) -> Self {
        let u = (x as f32 + 0.5) * (2.0 / frame.size[0] as f32) - 1.0;
        let v = 1.0 - (y as f32 + 0.5) * (2.0 / frame.size[1] as f32);
        let at = |q: &[Vec3; 3]| q[0] + q[1] * u + q[2] * v;
        let world = at(&frame.world_dir);
        let length = world.dot(world).sqrt();
        let inverse = 1.0 / length;
        let direction = at(&level.level_dir);
        let base = at(&level.level_origin) + direction * (inverse * frame.first_mm);
        let mut step = direction * (inverse * level.step_mm);
        // No axis may stand still: the slab test divides by it.
        for axis in 0..3 {
            if step[axis].abs() < 1e-20 {
                step[axis] = 1e-20;
            }
        }
        let to_min = (level.box_min - base) / step;
        let to_max = (level.box_max - base) / step;
        let near = to_min.min(to_max).max_element();
        let far = to_min.max(to_max).min_element();
        let near_plane = (frame.near_mm * length - frame.first_mm) / level.step_mm;
        let first = near.max(near_plane).max(level.begin as f32).ceil();
        let last = far.min((frame.last_index >> level.lod.0) as f32).floor();
        // An empty ray may have any numbers; keep them inside i32.
        Self {
            direction: world * inverse,
            base,
            step,
            first: first.min(2e9) as i32,
            last: last.min(level.end as f32).clamp(-1.0, 2e9) as i32,
        }
    }

    fn offset(&self, index: f32) -> Vec3 {
        self.base + index * self.step
    }
}

/// A ray's part at each level, the level, and its table.
type Span<'a> = (Ray, &'a LevelFrame, &'a Lut);

struct Caster<'r, 'f, 'a> {
    /// One per level.
    readers: &'r mut [FieldReader<'f>],
    settings: &'a PictureSettings,
    iso: f32,
    value_floor: f32,
    counts: RayCounts,
}

impl Caster<'_, '_, '_> {
    /// The value of level number `l` of the frame.
    fn value(&mut self, l: usize, level: &LevelFrame, offset: Vec3) -> f32 {
        match self.settings.interpolation {
            Interpolation::Linear => self.readers[l].trilinear(level.anchor, offset),
            Interpolation::Nearest => self.readers[l].nearest(level.anchor, offset),
        }
    }

    /// Central differences at ±½ voxel of the level (design.md §3), in world units.
    fn gradient(&mut self, l: usize, level: &LevelFrame, offset: Vec3) -> Vec3 {
        let mut along = |axis: Vec3| {
            self.value(l, level, offset + axis * 0.5) - self.value(l, level, offset - axis * 0.5)
        };
        let difference = Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z));
        level.normal_from_gradient * difference
    }

    fn lit(&mut self, color: Vec3, l: usize, (ray, level, _): Span<'_>, offset: Vec3) -> Vec3 {
        match self.settings.shading.model {
            ShadingModel::None => color,
            ShadingModel::Phong => {
                let gradient = self.gradient(l, level, offset);
                phong(color, gradient, ray.direction, &self.settings.shading)
            }
        }
    }

    fn dvr<'a>(&mut self, spans: impl Iterator<Item = Span<'a>>) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for (l, span) in spans.enumerate() {
            let (ray, level, lut) = span;
            // The sample at a switch is the coarser level's.
            for i in ray.first..=ray.last.min(level.end as i32 - 1) {
                let offset = ray.offset(i as f32);
                self.counts.samples += 1;
                let value = self.value(l, level, offset);
                let [r, g, b, a] = lut.sample(value);
                if a > 0.0 {
                    self.counts.contributing += 1;
                    let color = self.lit(Vec3::new(r, g, b), l, span, offset);
                    let weight = (1.0 - sum.w) * a;
                    sum += color.extend(1.0) * weight;
                    if sum.w >= self.settings.opacity_cutoff {
                        return sum;
                    }
                }
            }
        }
        sum
    }

    fn mip<'a>(&mut self, spans: impl Iterator<Item = Span<'a>>) -> Vec4 {
        let mut greatest = None;
        for (l, (ray, level, lut)) in spans.enumerate() {
            for i in ray.first..=ray.last.min(level.end as i32 - 1) {
                self.counts.samples += 1;
                let value = self.value(l, level, ray.offset(i as f32));
                if greatest.is_none_or(|(g, _): (f32, _)| value > g) {
                    // The volume's minimum is where a maximum begins.
                    self.counts.contributing += u64::from(value > self.value_floor);
                    greatest = Some((value, lut));
                }
            }
        }
        let Some((greatest, lut)) = greatest else {
            return Vec4::ZERO;
        };
        let [r, g, b, a] = lut.sample(greatest);
        Vec4::new(r * a, g * a, b * a, a)
    }

    fn iso<'a>(&mut self, spans: impl Iterator<Item = Span<'a>>) -> Vec4 {
        for (l, span) in spans.enumerate() {
            let (ray, level, _) = span;
            // A segment has the level of its first sample, and both ends are sampled there (design.md §3).
            let mut previous = None;
            for i in ray.first..=ray.last {
                self.counts.samples += 1;
                let above = self.value(l, level, ray.offset(i as f32)) >= self.iso;
                if previous.is_some_and(|p: bool| p != above) {
                    self.counts.contributing += 1;
                    let offset = ray.offset(self.refine(l, &ray, level, i as f32, above));
                    let surface = self.settings.classification.iso;
                    let color = surface.map_or(Vec3::ONE, |s| s.color);
                    return self.lit(color, l, span, offset).extend(1.0);
                }
                previous = Some(above);
            }
        }
        Vec4::ZERO
    }

    /// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3).
    fn refine(&mut self, l: usize, ray: &Ray, level: &LevelFrame, index: f32, above: bool) -> f32 {
        if !self.settings.refine {
            return index;
        }
        let mut at = index - 0.5;
        let mut half = 0.25;
        for _ in 0..6 {
            let beyond = (self.value(l, level, ray.offset(at)) >= self.iso) == above;
            at += if beyond { -half } else { half };
            half *= 0.5;
        }
        at
    }
}
