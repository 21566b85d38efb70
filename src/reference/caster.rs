//! The raycaster: one loop per mode over the sample grid of the frame, no skipping.

use std::sync::atomic::Ordering;

use glam::{IVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::field::{FieldReader, VoxelField};
use super::shade::phong;
use crate::scene::{
    Classified, Image, Interpolation, Mode, PictureSettings, RayCounts, RayFrame, ShadingModel,
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

/// Draws the picture of `frame` on all threads of the current rayon pool.
///
/// # Errors
/// A brick can't be read.
pub fn render(
    field: &VoxelField<'_>,
    frame: &RayFrame,
    classified: &Classified,
    settings: &PictureSettings,
) -> Result<ReferencePicture, StoreError> {
    let [width, height] = frame.size;
    let rows: Result<Vec<(Vec<Vec4>, RayCounts)>, StoreError> = (0..height)
        .into_par_iter()
        .map_init(
            || field.reader(),
            |reader, y| {
                let mut row = Vec::with_capacity(width as usize);
                let mut counts = RayCounts::default();
                for x in 0..width {
                    let ray = Ray::new(frame, x, y);
                    let mut caster = Caster {
                        reader,
                        frame,
                        classified,
                        settings,
                        ray,
                        samples: 0,
                    };
                    row.push(match settings.mode {
                        Mode::Dvr => caster.dvr(),
                        Mode::Iso => caster.iso(),
                        Mode::Mip => caster.mip(),
                    });
                    counts.samples += caster.samples;
                }
                match reader.error.take() {
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
        counts.samples += row_counts.samples;
    }
    Ok(ReferencePicture {
        image,
        counts,
        bricks_read: field.bricks_read.load(Ordering::Relaxed),
    })
}

/// A ray as the shader has it: offsets in level voxels from the frame's anchor, by sample index.
#[derive(Clone, Copy, Debug)]
struct Ray {
    /// Unit direction, world.
    direction: Vec3,
    /// Offset of sample 0.
    base: Vec3,
    /// From a sample to the next.
    step: Vec3,
    /// First and last sample inside the volume; empty when first > last.
    first: i32,
    last: i32,
}

impl Ray {
    fn new(frame: &RayFrame, x: u32, y: u32) -> Self {
        let u = (x as f32 + 0.5) * (2.0 / frame.size[0] as f32) - 1.0;
        let v = 1.0 - (y as f32 + 0.5) * (2.0 / frame.size[1] as f32);
        let at = |q: &[Vec3; 3]| q[0] + q[1] * u + q[2] * v;
        let world = at(&frame.world_dir);
        let length = world.dot(world).sqrt();
        let inverse = 1.0 / length;
        let level = at(&frame.level_dir);
        let base = at(&frame.level_origin) + level * (inverse * frame.first_mm);
        let mut step = level * (inverse * frame.step_mm);
        // No axis may stand still: the slab test divides by it.
        for axis in 0..3 {
            if step[axis].abs() < 1e-20 {
                step[axis] = 1e-20;
            }
        }
        let to_min = (frame.box_min - base) / step;
        let to_max = (frame.box_max - base) / step;
        let near = to_min.min(to_max).max_element();
        let far = to_min.max(to_max).min_element();
        let near_plane = (frame.near_mm * length - frame.first_mm) / frame.step_mm;
        let first = near.max(near_plane).max(0.0).ceil();
        let last = far.min(frame.last_index as f32).floor();
        // An empty ray may have any numbers; keep them inside i32.
        Self {
            direction: world * inverse,
            base,
            step,
            first: first.min(2e9) as i32,
            last: last.clamp(-1.0, 2e9) as i32,
        }
    }

    fn offset(&self, index: f32) -> Vec3 {
        self.base + index * self.step
    }
}

struct Caster<'r, 'f, 'a> {
    reader: &'r mut FieldReader<'f>,
    frame: &'a RayFrame,
    classified: &'a Classified,
    settings: &'a PictureSettings,
    ray: Ray,
    samples: u64,
}

impl Caster<'_, '_, '_> {
    fn value(&mut self, offset: Vec3) -> f32 {
        let anchor: IVec3 = self.frame.anchor;
        match self.settings.interpolation {
            Interpolation::Linear => self.reader.trilinear(anchor, offset),
            Interpolation::Nearest => self.reader.nearest(anchor, offset),
        }
    }

    /// Central differences at ±½ voxel of the level (design.md §3), in world units.
    fn gradient(&mut self, offset: Vec3) -> Vec3 {
        let mut along =
            |axis: Vec3| self.value(offset + axis * 0.5) - self.value(offset - axis * 0.5);
        let level = Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z));
        self.frame.normal_from_gradient * level
    }

    fn lit(&mut self, color: Vec3, offset: Vec3) -> Vec3 {
        match self.settings.shading.model {
            ShadingModel::None => color,
            ShadingModel::Phong => {
                let gradient = self.gradient(offset);
                phong(color, gradient, self.ray.direction, &self.settings.shading)
            }
        }
    }

    fn dvr(&mut self) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for i in self.ray.first..=self.ray.last {
            let offset = self.ray.offset(i as f32);
            self.samples += 1;
            let value = self.value(offset);
            let [r, g, b, a] = self.classified.lut.sample(value);
            if a > 0.0 {
                let color = self.lit(Vec3::new(r, g, b), offset);
                let weight = (1.0 - sum.w) * a;
                sum += color.extend(1.0) * weight;
                if sum.w >= self.settings.opacity_cutoff {
                    break;
                }
            }
        }
        sum
    }

    fn mip(&mut self) -> Vec4 {
        let mut greatest = f32::MIN;
        for i in self.ray.first..=self.ray.last {
            self.samples += 1;
            greatest = greatest.max(self.value(self.ray.offset(i as f32)));
        }
        if self.ray.first > self.ray.last {
            return Vec4::ZERO;
        }
        let [r, g, b, a] = self.classified.lut.sample(greatest);
        Vec4::new(r * a, g * a, b * a, a)
    }

    fn iso(&mut self) -> Vec4 {
        let iso = self.classified.iso_stored;
        let mut previous = None;
        for i in self.ray.first..=self.ray.last {
            self.samples += 1;
            let above = self.value(self.ray.offset(i as f32)) >= iso;
            if previous.is_some_and(|p: bool| p != above) {
                let at = self.refine(i as f32, above);
                let offset = self.ray.offset(at);
                let color = self
                    .settings
                    .classification
                    .iso
                    .map_or(Vec3::ONE, |s| s.color);
                return self.lit(color, offset).extend(1.0);
            }
            previous = Some(above);
        }
        Vec4::ZERO
    }

    /// Six bisection steps between sample `index`, on the new side, and the one before (techniques.md T1.3).
    fn refine(&mut self, index: f32, above: bool) -> f32 {
        if !self.settings.refine {
            return index;
        }
        let mut at = index - 0.5;
        let mut half = 0.25;
        for _ in 0..6 {
            let beyond = (self.value(self.ray.offset(at)) >= self.classified.iso_stored) == above;
            at += if beyond { -half } else { half };
            half *= 0.5;
        }
        at
    }
}
