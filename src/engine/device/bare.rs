//! The bare rates of a GPU: whole levels into dense textures, and the bare caster over them.

use std::collections::BTreeSet;

use crate::camera::Camera;
use crate::clock::Stopwatch;
use crate::geom::{BRICK_EDGE, Lod, VoxelBox};
use crate::gpu::GpuError;
use crate::render::{BareCaster, DenseLevel, SampleFilter};
use crate::scene::PictureSettings;
use crate::store::{BrickReader, StoreError};

use super::super::EngineError;
use super::super::bare::{BareRate, BareRates};
use super::GpuDevice;
use super::plan::PicturePlan;

impl GpuDevice {
    /// See [`super::super::Engine::measure_bare`].
    pub(in crate::engine) fn measure_bare(
        &mut self,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<Option<BareRates>, EngineError> {
        self.forget();
        let plans: Vec<PicturePlan> = cameras
            .iter()
            .map(|&camera| {
                let settings = PictureSettings {
                    camera,
                    ..settings.clone()
                };
                PicturePlan::new(&self.store, &self.tables, &settings)
            })
            .collect::<Result<_, _>>()?;
        let levels: BTreeSet<Lod> = plans
            .iter()
            .flat_map(|plan| plan.rays.used().iter().map(|level| level.lod))
            .collect();
        let mut exact = Vec::new();
        let mut filtered = Some(Vec::new());
        for lod in levels {
            let of_level = |filter| match self.dense(lod, filter, settings.size) {
                Ok(Some(dense)) => self.cast_bare(&dense, lod, &plans).map(Some),
                Ok(None) | Err(EngineError::Gpu(GpuError::OutOfMemory { .. })) => Ok(None),
                Err(error) => Err(error),
            };
            let Some(more) = of_level(SampleFilter::Exact)? else {
                return Ok(None);
            };
            exact.extend(more);
            filtered = match (filtered, of_level(SampleFilter::Hardware)?) {
                (Some(mut all), Some(more)) => {
                    all.extend(more);
                    Some(all)
                }
                _ => None,
            };
        }
        Ok(Some(BareRates {
            exact: BareRate::sum(&exact),
            filtered: filtered.as_deref().map(BareRate::sum),
            on_processor: self.is_software(),
        }))
    }

    /// The level in one texture; `None` where an axis or the bytes are too many, or the device has no such filter.
    fn dense(
        &self,
        lod: Lod,
        filter: SampleFilter,
        size: [u32; 2],
    ) -> Result<Option<DenseLevel>, EngineError> {
        let stored = self.store.stored_type();
        let voxels = self.grids[usize::from(lod.0)].voxels;
        let slice_bytes = voxels.x * voxels.y * stored.size() as u64;
        let bytes = u128::from(slice_bytes) * u128::from(voxels.z);
        if bytes + u128::from(BareCaster::bytes(size)) > u128::from(self.budget_bytes) {
            return Ok(None);
        }
        let Some(dense) = DenseLevel::new(&self.gpu, stored, filter, voxels.as_uvec3())? else {
            return Ok(None);
        };
        let mut reader = BrickReader::new().map_err(|error| StoreError::Io {
            path: self.store.path().to_owned(),
            doing: "start a decoder",
            error,
        })?;
        let mut slices = Vec::new();
        for first in (0..voxels.z).step_by(BRICK_EDGE as usize) {
            let mut part = VoxelBox::whole(voxels);
            part.min.z = first;
            part.max.z = (first + u64::from(BRICK_EDGE)).min(voxels.z);
            slices.resize((slice_bytes * (part.max.z - first)) as usize, 0);
            self.store.read_box(lod, part, &mut reader, &mut slices)?;
            dense.write_slices(&self.gpu, first as u32, &slices)?;
        }
        Ok(Some(dense))
    }

    /// Casts what `plans` sample of the level, one after the other.
    fn cast_bare(
        &self,
        dense: &DenseLevel,
        lod: Lod,
        plans: &[PicturePlan],
    ) -> Result<Vec<BareRate>, EngineError> {
        let mut rates = Vec::with_capacity(plans.len());
        // The level's number differs where pictures begin at different levels, and the pipeline with it.
        let mut warm: Option<(usize, BareCaster)> = None;
        for plan in plans {
            let used = plan.rays.used();
            let Some(number) = used.iter().position(|level| level.lod == lod) else {
                continue;
            };
            let inputs = plan.inputs();
            let caster = match &mut warm {
                Some((of, caster)) if *of == number => caster,
                cold => {
                    let size = plan.settings.size;
                    let mut caster = BareCaster::new(&self.gpu, dense, number, size)?;
                    caster.cast(&self.gpu, &inputs)?;
                    caster.take_gpu_ms(&self.gpu)?;
                    &mut cold.insert((number, caster)).1
                }
            };
            let watch = Stopwatch::start();
            caster.cast(&self.gpu, &inputs)?;
            let elapsed = watch.elapsed();
            rates.push(BareRate {
                samples: caster.samples(&self.gpu)?,
                wall_ms: elapsed.wall_ms,
                cpu_ms: elapsed.cpu_ms,
                gpu_ms: caster.take_gpu_ms(&self.gpu)?,
            });
        }
        Ok(rates)
    }
}
