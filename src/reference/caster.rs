//! The raycaster: every sample of the frame's grid, level by level, no skipping. What a sample does to its ray is told mode
//! by mode in [`super::modes`].

use std::sync::atomic::Ordering;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::field::VoxelField;
use super::modes::Caster;
use crate::scene::{
    Classified, Contribution, Image, LevelFrame, NO_DEPTHS, PartSamples, PictureSettings,
    RayCounts, RayFrame, RaySet, add_ray, ray_parts,
};
use crate::store::StoreError;

/// A picture and what it took.
#[derive(Debug)]
pub struct ReferencePicture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// Rays cast.
    pub rays: u64,
    /// Samples, summed over rays.
    pub counts: RayCounts,
    /// Bricks decoded.
    pub bricks_read: u64,
}

/// Pixels that a thread draws at once.
const AT_ONCE: usize = 256;

/// Draws the picture of `frame`, with as many rays per pixel as `settings` ask for, on all threads of the current rayon
/// pool. `fields` are of the levels that it samples, finest first.
///
/// # Errors
/// A brick can't be read.
pub fn render(
    fields: &[VoxelField<'_>],
    frame: &RayFrame,
    classified: &Classified,
    settings: &PictureSettings,
) -> Result<ReferencePicture, StoreError> {
    let mut picture = ReferencePicture {
        image: Image::for_settings(settings),
        rays: 0,
        counts: RayCounts::default(),
        bricks_read: 0,
    };
    let first = RaySet::first(settings.anti_aliasing);
    add_rays(&mut picture, &first, fields, frame, classified, settings)?;
    if let Some(second) = RaySet::second(settings.anti_aliasing, &picture.image) {
        add_rays(&mut picture, &second, fields, frame, classified, settings)?;
    }
    picture.bricks_read = fields
        .iter()
        .map(|f| f.bricks_read.load(Ordering::Relaxed))
        .sum();
    Ok(picture)
}

/// Colours and depths of pixels, and what their rays did.
type Drawn = (Vec<(Vec4, [f32; 2])>, RayCounts);

/// Draws the pixels of a set of rays.
fn add_rays(
    picture: &mut ReferencePicture,
    set: &RaySet,
    fields: &[VoxelField<'_>],
    frame: &RayFrame,
    classified: &Classified,
    settings: &PictureSettings,
) -> Result<(), StoreError> {
    let width = frame.size[0] as usize;
    let pixel = |n: usize| match &set.pixels {
        Some(list) => list[n],
        None => [(n % width) as u32, (n / width) as u32],
    };
    let frames: Vec<RayFrame> = set
        .places
        .iter()
        .map(|&place_in_pixel| RayFrame {
            place_in_pixel,
            ..frame.clone()
        })
        .collect();
    let count = set.pixel_count(frame.size) as usize;
    let parts: Result<Vec<Drawn>, StoreError> = (0..count.div_ceil(AT_ONCE))
        .into_par_iter()
        .map_init(
            || fields.iter().map(VoxelField::reader).collect::<Vec<_>>(),
            |readers, part| {
                let numbers = part * AT_ONCE..count.min((part + 1) * AT_ONCE);
                let mut colors = Vec::with_capacity(numbers.len());
                let mut counts = RayCounts::default();
                for [x, y] in numbers.map(pixel) {
                    let mut color = Vec4::ZERO;
                    let mut depths = NO_DEPTHS;
                    for (number, frame) in frames.iter().enumerate() {
                        let mut caster = Caster::new(readers, settings, classified);
                        cast(&mut caster, frame, settings, x, y);
                        add_ray(&mut color, caster.finish(), number, frames.len());
                        depths = [0, 1].map(|n| caster.depths[n].min(depths[n]));
                        counts += caster.counts;
                    }
                    colors.push((color, depths));
                }
                match readers.iter_mut().find_map(|r| r.error.take()) {
                    Some(error) => Err(error),
                    None => Ok((colors, counts)),
                }
            },
        )
        .collect();
    let mut numbers = 0..count;
    for (colors, counts) in parts? {
        picture.counts += counts;
        for ((color, depths), [x, y]) in colors.into_iter().zip(numbers.by_ref().map(pixel)) {
            let at = y as usize * width + x as usize;
            picture.image.pixels[at] = color;
            picture.image.note_depths(at, depths);
        }
    }
    picture.rays += count as u64 * set.places.len() as u64;
    Ok(())
}

/// Takes the samples of the ray of pixel (x, y), as many as its mode wants.
fn cast<'a>(
    caster: &mut Caster<'_, '_, 'a>,
    frame: &'a RayFrame,
    settings: &PictureSettings,
    x: u32,
    y: u32,
) {
    let contribution = Contribution::of(settings);
    let first_mm = frame.first_mm_of_pixel(x, y);
    let plane = frame.plane_of_pixel(x, y);
    for part in ray_parts(frame, &settings.geometry, &settings.shading, plane) {
        for (l, level) in frame.used().iter().enumerate() {
            let ray = Ray::new(frame, level, x, y);
            // The sample at a switch is the coarser level's; but a segment has the level of its first sample, and both
            // ends are sampled there (design.md §3).
            let end = level.end as i32 - i32::from(!settings.is_by_segment());
            let samples = part.samples(first_mm, level.step_mm, contribution);
            caster.begin_level((l, level), first_mm, &ray, &part, samples);
            if ray.cuts_at(frame, level, &samples) && caster.cap(samples.begin) {
                return;
            }
            for i in ray.first.max(samples.first)..=ray.last.min(end).min(samples.last) {
                if caster.take(i) {
                    return;
                }
            }
        }
        if part
            .layer
            .is_some_and(|layer| caster.meet(layer, part.end_mm))
        {
            return;
        }
    }
}

/// A ray at one level as the shader has it: offsets in level voxels from the level's anchor, by sample of that level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    /// Unit direction, world.
    pub(super) direction: Vec3,
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
        let plane = frame.plane_of_pixel(x, y);
        let [u, v] = plane;
        let [ahead, aside, above] = frame.fan(plane);
        let first_mm = frame.first_mm_of_pixel(x, y);
        let at = |q: &[Vec3; 3]| q[0] + q[1] * u + q[2] * v;
        let towards = |q: &[Vec3; 3]| q[0] * ahead + q[1] * aside + q[2] * above;
        let world = towards(&frame.world_dir);
        let length = world.dot(world).sqrt();
        let inverse = 1.0 / length;
        let direction = towards(&level.level_dir);
        let base = at(&level.level_origin) + direction * (inverse * first_mm);
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
        let near_plane = (frame.near_mm * length - first_mm) / level.step_mm;
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

    /// Does a part of the ray begin in the volume, at this level?
    fn cuts_at(&self, frame: &RayFrame, level: &LevelFrame, samples: &PartSamples) -> bool {
        let at = self.offset(samples.begin);
        let is_last = level.lod == frame.coarsest_used().lod;
        let is_inside = at.cmpge(level.box_min).all() && at.cmple(level.box_max).all();
        let is_of_level =
            samples.begin >= level.begin as f32 && (is_last || samples.begin < level.end as f32);
        is_inside && is_of_level && samples.has_volume()
    }

    /// Offset of sample `index`; fractions are between samples.
    pub(super) fn offset(&self, index: f32) -> Vec3 {
        self.base + index * self.step
    }
}
