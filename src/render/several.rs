//! Techniques of which several passes cast the rays of one submission: multipass and layers (techniques.md T4 and T3). Their
//! caster is that of technique default, which takes a few samples a pass; here is what comes between the passes.

use std::num::NonZeroU32;

use super::frame::{FrameBindings, FrameInputs, Tile};
use super::passes::{
    BoundsTargets, CompactPass, CompactTargets, LayersPass, LayersTargets, RaycastPass,
    RaycastTargets, ReportPass,
};
use super::quadtree::{layers_of_cells, nodes, passes};
use crate::gpu::layout::CELL_EDGE;
use crate::gpu::{GpuContext, GpuError, PassTimer};
use crate::scene::{CellSamples, LayerStats, RayFrame, Technique};

/// Samples of a ray in a pass: of technique multipass as published, of layers what a software adapter does well with.
const MULTIPASS_SAMPLES: u32 = 8;
const LAYERS_SAMPLES: u32 = 64;

/// Passes of technique layers until it is measured anew which cells have samples left.
const LAYERS_PASSES: u32 = 4;

/// Who casts the rays of a submission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flow {
    /// One pass.
    Once,
    /// Passes over lists of the rays that go on.
    Multipass,
    /// Passes over the nodes of a quadtree, each node for its own number of layers.
    Layers,
}

impl Flow {
    /// Drafts are cast at once: their rays don't stop.
    pub(super) fn of(technique: Technique, is_draft: bool, is_listed: bool) -> Self {
        match technique {
            Technique::Multipass if !is_draft => Self::Multipass,
            // Pixels of a list have no place in the quadtree.
            Technique::Layers if !is_draft && !is_listed => Self::Layers,
            _ => Self::Once,
        }
    }

    /// Bytes per pixel of a tile that a technique needs besides the caster's.
    pub(super) fn bytes_per_pixel(technique: Technique) -> u64 {
        match Self::of(technique, false, false) {
            Self::Once => 0,
            Self::Multipass => CompactTargets::BYTES_PER_PIXEL,
            Self::Layers => LayersTargets::BYTES_PER_PIXEL,
        }
    }
}

/// The passes beside the caster, made when first needed.
#[derive(Debug, Default)]
pub(super) struct SeveralPasses {
    /// Samples of a ray in a pass, where they are not the technique's own.
    samples: Option<NonZeroU32>,
    report: Option<ReportPass>,
    compact: Option<CompactPass>,
    layers: Option<LayersPass>,
    /// The cells of the tile, as they were first measured; empty before.
    cells: Vec<u32>,
    stats: LayerStats,
}

/// What a tile needs besides the caster's buffers.
#[derive(Debug)]
pub(super) struct SeveralTargets {
    /// The rays, as all of these passes bind them.
    rays: wgpu::BindGroup,
    of: TechniqueTargets,
}

#[derive(Debug)]
enum TechniqueTargets {
    Multipass(CompactTargets),
    Layers(LayersTargets),
}

impl SeveralTargets {
    /// Whose they are.
    pub(super) fn flow(&self) -> Flow {
        match self.of {
            TechniqueTargets::Multipass(_) => Flow::Multipass,
            TechniqueTargets::Layers(_) => Flow::Layers,
        }
    }
}

/// The passes of a submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Passes {
    Once,
    /// So many.
    Multipass(u32),
    /// Each with so many of the first work-groups.
    Layers(Vec<u32>),
}

impl SeveralPasses {
    pub(super) fn new(samples: Option<NonZeroU32>) -> Self {
        Self {
            samples,
            ..Self::default()
        }
    }

    /// Builds the pipelines of `flow`.
    pub(super) fn prepare(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        flow: Flow,
    ) -> Result<(), GpuError> {
        if flow == Flow::Once {
            return Ok(());
        }
        let report = match &mut self.report {
            Some(report) => report,
            none => none.insert(ReportPass::new(gpu, frame)?),
        };
        match (flow, &mut self.compact, &mut self.layers) {
            (Flow::Multipass, none @ None, _) => {
                *none = Some(CompactPass::new(gpu, frame, report)?);
                Ok(())
            }
            (Flow::Layers, _, Some(layers)) => layers.prepare(gpu, inputs, frame, report),
            (Flow::Layers, _, none) => {
                let layers = none.insert(LayersPass::new(gpu)?);
                layers.prepare(gpu, inputs, frame, report)
            }
            _ => Ok(()),
        }
    }

    /// The buffers of `flow`, whose pipelines were prepared.
    pub(super) fn targets(
        &self,
        gpu: &GpuContext,
        flow: Flow,
        raycast: &RaycastPass,
        (bounds, targets): (&BoundsTargets, &RaycastTargets),
        feedback: &wgpu::Buffer,
        tile: [u32; 2],
    ) -> Option<SeveralTargets> {
        let report = self.report.as_ref()?;
        let of = match flow {
            Flow::Once => return None,
            Flow::Multipass => TechniqueTargets::Multipass(CompactTargets::new(
                gpu,
                (self.compact.as_ref()?, report, raycast),
                bounds,
                targets,
                feedback,
                tile.map(u64::from).iter().product(),
            )),
            Flow::Layers => {
                TechniqueTargets::Layers(self.layers.as_ref()?.targets(gpu, bounds, tile))
            }
        };
        Some(SeveralTargets {
            rays: report.host_group(gpu, targets, feedback),
            of,
        })
    }

    /// Samples that a ray takes in a pass, where `most` are allowed in the submission.
    pub(super) fn pass_samples(&self, flow: Flow, most: u32) -> u32 {
        let own = match flow {
            Flow::Once => return most,
            Flow::Multipass => MULTIPASS_SAMPLES,
            Flow::Layers => LAYERS_SAMPLES,
        };
        self.samples.map_or(own, NonZeroU32::get).min(most)
    }

    /// The passes of a submission in which a ray takes at most about `most` samples. `groups` are sorted as they need them.
    /// With layers it waits until they are measured; the feedback buffer must list the groups.
    ///
    /// # Errors
    /// The device is lost.
    pub(super) fn plan(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        frame: &FrameBindings,
        targets: Option<&SeveralTargets>,
        (tile, most): (&Tile, u32),
        (groups, timer): (&mut Vec<u32>, &mut PassTimer),
    ) -> Result<Passes, GpuError> {
        let Some(targets) = targets else {
            return Ok(Passes::Once);
        };
        let samples = self.pass_samples(targets.flow(), most);
        match &targets.of {
            TechniqueTargets::Multipass(_) => {
                // One more: a ray that has taken its last sample finds in the next pass that nothing is left.
                Ok(Passes::Multipass(
                    most.min(most_samples(inputs.rays)) / samples + 1,
                ))
            }
            TechniqueTargets::Layers(cells) => {
                let layers = self
                    .layers
                    .as_ref()
                    .expect("invariant: prepared with its targets");
                let counts = layers.measure(
                    gpu,
                    inputs,
                    frame,
                    (&targets.rays, cells),
                    groups.len() as u32,
                    timer,
                )?;
                let [wide, _] = LayersTargets::cells(tile.size);
                let nodes = nodes(&counts, wide, samples);
                let layers = layers_of_cells(&nodes, wide, counts.len());
                let layers_of = |group| {
                    let [x, y] = RaycastPass::group_pixel(tile.size, group);
                    layers[(y / CELL_EDGE * wide + x / CELL_EDGE) as usize]
                };
                let (sorted, mut sizes) = passes(groups, samples, layers_of);
                *groups = sorted;
                sizes.truncate((most / samples).clamp(1, LAYERS_PASSES) as usize);
                self.stats.nodes += nodes.len() as u64;
                self.stats.passes += sizes.len() as u64;
                if self.cells.is_empty() {
                    self.cells = counts;
                }
                Ok(Passes::Layers(sizes))
            }
        }
    }

    /// Casts by `plan` what the feedback buffer lists, `groups` work-groups. `bind` makes a pass ready to cast, with a
    /// group 2.
    pub(super) fn record<'p>(
        &self,
        pass: &mut wgpu::ComputePass<'p>,
        frame: &FrameBindings,
        (targets, cast_group): (Option<&SeveralTargets>, &wgpu::BindGroup),
        (plan, groups): (&Passes, u32),
        bind: impl Fn(&mut wgpu::ComputePass<'p>, &wgpu::BindGroup),
    ) {
        let Some(targets) = targets else {
            bind(pass, cast_group);
            pass.dispatch_workgroups(groups, 1, 1);
            return;
        };
        match (&targets.of, plan) {
            (TechniqueTargets::Multipass(lists), Passes::Multipass(rounds)) => {
                let compact = self.compact.as_ref();
                let compact = compact.expect("invariant: prepared with its targets");
                compact.record(pass, frame, &targets.rays, lists, (groups, *rounds), bind);
            }
            (TechniqueTargets::Layers(_), Passes::Layers(sizes)) => {
                bind(pass, cast_group);
                for &size in sizes {
                    pass.dispatch_workgroups(size, 1, 1);
                }
            }
            (of, plan) => unreachable!("invariant: {plan:?} is not of {of:?}"),
        }
        let report = self.report.as_ref();
        let report = report.expect("invariant: prepared with its targets");
        report.record(pass, frame, &targets.rays, groups);
    }

    /// Counts what the pixels of a tile took, once it is finished: `samples` by pixel.
    pub(super) fn count(&mut self, tile: &Tile, samples: impl Fn([u32; 2]) -> u32) {
        let cells = std::mem::take(&mut self.cells);
        let [wide, _] = LayersTargets::cells(tile.size);
        for (cell, layers) in (0..).zip(cells) {
            let begin = [cell % wide, cell / wide].map(|c| c * CELL_EDGE);
            let end = [0, 1].map(|axis| (begin[axis] + CELL_EDGE).min(tile.part_size[axis]));
            let pixels = (begin[1]..end[1]).flat_map(|y| (begin[0]..end[0]).map(move |x| [x, y]));
            let taken: Vec<u32> = pixels.map(&samples).collect();
            if let Some(&most) = taken.iter().max() {
                self.stats.cells.push(CellSamples {
                    origin: [0, 1].map(|axis| tile.origin[axis] + begin[axis]),
                    layers,
                    most,
                    samples: taken.iter().copied().map(u64::from).sum(),
                });
            }
        }
    }

    /// What technique layers did since the last call; `None` where it did nothing.
    pub(super) fn take_stats(&mut self) -> Option<LayerStats> {
        let stats = std::mem::take(&mut self.stats);
        (stats.passes > 0).then_some(stats)
    }

    /// Another tile begins.
    pub(super) fn begin_tile(&mut self) {
        self.cells.clear();
    }
}

/// No ray takes more samples.
fn most_samples(rays: &RayFrame) -> u32 {
    (rays.last_index >> rays.levels[0].lod.0) + 2
}
