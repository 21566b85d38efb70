//! Pictures tile by tile, so that `--size` is bounded by no texture and no buffer; each tile by as many dispatches as its
//! rays need.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::ops::Range;

use glam::Vec4;

use super::feedback::{Feedback, PendingFeedback};
use super::frame::{BOUNDS_MARGIN, DispatchParams, FrameBindings, FrameInputs, Tile};
use super::passes::{
    BoundsPass, BoundsTargets, CastKind, LeapFault, LeapPass, LeapTargets, MeshBuffers, PartsPass,
    RaycastPass, RaycastTargets,
};
use super::residency::Residency;
use super::several::{Flow, SeveralPasses, SeveralTargets};
use super::spread::spread;
use super::tiling::PixelList;
use crate::clip::Geometry;
use crate::gpu::layout::{
    FEEDBACK_COMPACTED, FEEDBACK_GROUPS, FEEDBACK_LEVELS, FEEDBACK_LIMIT, FEEDBACK_PIXELS,
    FEEDBACK_QUIET, FEEDBACK_SKIP, MAX_GROUPS, PixelCounts, RayState, SKIP_BLOCKS, SKIP_OUTSIDE,
    SKIP_WITHOUT_MESH,
};
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers};
use crate::proxy::Mesh;
use crate::scene::{
    AntiAliasing, Classified, Image, LayerStats, RayCounts, RayFrame, Technique, add_ray,
};

/// Passes whose times wait to be read.
const TIMED_PASSES: u32 = 256;

/// Which rays a dispatch casts, and how far.
#[derive(Clone, Copy, Debug)]
pub struct Cast<'a> {
    /// Work-groups of the tile, or of the list that it was begun with.
    pub groups: &'a [u32],
    /// Was the tile begun with a list of pixels?
    pub is_listed: bool,
    /// Rays don't stop: coarser bricks stand in for missing ones.
    pub draft: bool,
    /// Samples after which a ray goes on in the next dispatch; drafts have no limit.
    pub sample_limit: u32,
}

/// The passes and the buffers that outlive a picture.
#[derive(Debug)]
pub struct Renderer {
    frame: FrameBindings,
    bounds: BoundsPass,
    raycast: RaycastPass,
    /// Built when first wanted.
    leap: Option<LeapPass>,
    leap_fault: Option<LeapFault>,
    several: SeveralPasses,
    parts: PartsPass,
    targets: Option<Targets>,
    mesh: Option<MeshBuffers>,
    levels: usize,
    timer: PassTimer,
    passes_ms: Option<BTreeMap<String, f64>>,
}

#[derive(Debug)]
struct Targets {
    size: [u32; 2],
    technique: Technique,
    /// Bound to them: with another volume they are made anew.
    feedback: wgpu::Buffer,
    bounds: BoundsTargets,
    raycast: RaycastTargets,
    /// Of drafts that leap, with group 2 of their caster.
    leap: Option<(LeapTargets, wgpu::BindGroup)>,
    /// Group 2 of the caster.
    cast_group: wgpu::BindGroup,
    /// Of a technique that has several passes.
    several: Option<SeveralTargets>,
}

impl Renderer {
    /// The passes that every picture of a volume of `levels` levels needs; the caster's pipelines come with the modes.
    /// `pass_samples`: samples of a ray in a pass of techniques multipass and layers, where they are not their own.
    /// `leap_fault`: for tests.
    ///
    /// # Errors
    /// The device refuses a shader or a pipeline.
    pub fn new(
        gpu: &GpuContext,
        levels: usize,
        pass_samples: Option<NonZeroU32>,
        leap_fault: Option<LeapFault>,
    ) -> Result<Self, GpuError> {
        let frame = FrameBindings::new(gpu, levels);
        let bounds = BoundsPass::new(gpu, &frame)?;
        Ok(Self {
            bounds,
            raycast: RaycastPass::new(gpu),
            leap: None,
            leap_fault,
            frame,
            several: SeveralPasses::new(pass_samples),
            parts: PartsPass::new(gpu),
            targets: None,
            mesh: None,
            levels,
            timer: PassTimer::new(gpu, TIMED_PASSES),
            passes_ms: gpu.caps.timestamps.then(BTreeMap::new),
        })
    }

    /// Bytes of tables and uniforms for volumes of `levels` levels.
    pub fn frame_bytes(levels: usize) -> u64 {
        FrameBindings::bytes_for(levels)
    }

    /// Bytes that geometry needs in tiles of `tile` pixels: of itself, and at least of what rays are cut to.
    pub fn geometry_bytes(geometry: &Geometry, rays: &RayFrame, tile: [u32; 2]) -> [u64; 2] {
        PartsPass::bytes_for(geometry, rays, tile)
    }

    /// Bytes that what rays cross, and the parts that they are cut to, may take; `None`: nothing is cut, and what is there of
    /// the last picture's geometry goes.
    pub fn set_most_parts_bytes(&mut self, bytes: Option<u64>) {
        self.parts.most_bytes = bytes.unwrap_or(0);
        if bytes.is_none() {
            self.parts.drop_targets();
        }
    }

    /// Bytes of the tables of integrals of a pre-integrated picture.
    pub fn integrals_bytes(classified: &Classified) -> u64 {
        FrameBindings::integrals_bytes_for(classified)
    }

    /// Bytes of what leaping needs for pictures of `size` pixels in tiles of `tile`.
    pub fn leap_bytes(size: [u32; 2], tile: [u32; 2]) -> u64 {
        LeapTargets::bytes(size, tile)
    }

    /// The size of the pictures for which there is what leaping needs.
    pub fn leap_size(&self) -> Option<[u32; 2]> {
        let leap = self.targets.as_ref()?.leap.as_ref()?;
        Some(leap.0.size())
    }

    /// Bytes on the device: tables, tile, mesh.
    pub fn bytes(&self) -> u64 {
        Self::frame_bytes(self.levels)
            + self.frame.integrals_bytes()
            + self.targets.as_ref().map_or(0, |t| {
                let leap = t.leap.as_ref();
                Self::tile_bytes(t.size, t.technique)
                    + leap.map_or(0, |(l, _)| LeapTargets::bytes(l.size(), t.size))
            })
            + self.mesh.as_ref().map_or(0, MeshBuffers::bytes)
            + self.parts.bytes()
    }

    /// Sends the tables and builds the pipelines for a picture in tiles of `tile` pixels.
    ///
    /// # Errors
    /// The device is lost or has not the memory.
    pub fn begin_picture(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &Residency,
        tile: [u32; 2],
        draft: bool,
    ) -> Result<(), GpuError> {
        let technique = inputs.settings.technique;
        let flow = Flow::of(technique, draft, false);
        let how = if draft {
            CastKind::Draft
        } else {
            CastKind::Tile
        };
        self.raycast
            .prepare(gpu, inputs, &self.frame, volume, &self.parts.layout, how)?;
        let has_list = matches!(
            inputs.settings.anti_aliasing,
            AntiAliasing::Selective { .. }
        );
        if has_list && !draft {
            self.raycast.prepare(
                gpu,
                inputs,
                &self.frame,
                volume,
                &self.parts.layout,
                CastKind::List,
            )?;
        }
        self.several.prepare(gpu, inputs, &self.frame, flow)?;
        let settings = inputs.settings;
        self.parts
            .prepare(gpu, &self.frame, &settings.geometry, inputs.rays, tile)?;
        if self.targets.as_ref().is_none_or(|t| {
            t.size != tile || t.technique != technique || t.feedback != volume.feedback
        }) {
            self.targets = None;
            self.targets = Some(gpu.checked("allocating the picture's buffers", || {
                let bounds = BoundsTargets::new(gpu, tile.map(|t| t + 2 * BOUNDS_MARGIN));
                let pixels = u64::from(tile[0]) * u64::from(tile[1]);
                let raycast = RaycastPass::targets(gpu, pixels);
                let feedback = volume.feedback.clone();
                Ok(Targets {
                    size: tile,
                    technique,
                    cast_group: self.raycast.host_group(gpu, &bounds, &raycast, &feedback),
                    feedback,
                    bounds,
                    raycast,
                    several: None,
                    leap: None,
                })
            })?);
        }
        let targets = self.targets.as_mut().filter(|t| t.several.is_none());
        if let Some(targets) = targets {
            let of = (&targets.bounds, &targets.raycast);
            targets.several = gpu.checked("allocating the technique's buffers", || {
                let (raycast, feedback) = (&self.raycast, &targets.feedback);
                Ok(self.several.targets(gpu, flow, raycast, of, feedback, tile))
            })?;
        }
        if draft && inputs.settings.leaps() {
            self.prepare_leap(gpu, inputs.rays.size)?;
        }
        self.frame.write_tables(gpu, inputs.classified)
    }

    /// What drafts of `size` that leap need: pass, points, starts.
    fn prepare_leap(&mut self, gpu: &GpuContext, size: [u32; 2]) -> Result<(), GpuError> {
        let targets = self
            .targets
            .as_mut()
            .expect("invariant: called for a picture that is begun");
        if targets.leap.as_ref().is_some_and(|(l, _)| l.size() == size) {
            return Ok(());
        }
        let pass = match self.leap.take() {
            Some(pass) => pass,
            None => LeapPass::new(gpu, &self.frame)?,
        };
        let pass = self.leap.insert(pass);
        targets.leap = None;
        targets.leap = Some(gpu.checked("allocating points and starts", || {
            let leap = pass.targets(gpu, size, targets.size);
            let (bounds, raycast) = (&targets.bounds, &targets.raycast);
            let group = self
                .raycast
                .leap_group(gpu, bounds, raycast, &targets.feedback, &leap);
            Ok((leap, group))
        })?);
        Ok(())
    }

    /// Begins a draft that leaps: true where its rays start as the one before allows, false where they start at the volume.
    /// `bricks`: those that came and those that went so far.
    pub fn begin_leap(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        bricks: [u64; 2],
    ) -> bool {
        let leap = self.targets.as_mut().and_then(|t| t.leap.as_mut());
        leap.is_some_and(|(leap, _)| leap.begin(gpu, inputs, bricks, self.leap_fault))
    }

    /// Finds where the rays of a tile that was begun start, in a draft for which [`Self::begin_leap`] said so.
    pub fn find_starts(&mut self, gpu: &GpuContext, inputs: &FrameInputs<'_>, tile: &Tile) {
        let leap = self.targets.as_ref().and_then(|t| t.leap.as_ref());
        if let (Some(pass), Some((targets, _))) = (&self.leap, leap) {
            let mut encoder = encoder(gpu, "renderer.leap");
            let of = (inputs.rays.projection, tile);
            pass.record(&mut encoder, &self.frame, targets, of, &mut self.timer);
            gpu.queue.submit([encoder.finish()]);
        }
    }

    /// The draft is drawn: the next one may start from its points.
    pub fn end_leap(&mut self, inputs: &FrameInputs<'_>, bricks: [u64; 2]) {
        if let Some((leap, _)) = self.targets.as_mut().and_then(|t| t.leap.as_mut()) {
            leap.end(inputs, bricks);
        }
    }

    /// Drops the picture's buffers, which are bound to a volume's: there is none any more.
    pub fn drop_targets(&mut self) {
        self.targets = None;
        self.parts.drop_targets();
    }

    /// Sends the bounding mesh that the next tiles are bounded by.
    ///
    /// # Errors
    /// The device has not the memory.
    pub fn set_mesh(&mut self, gpu: &GpuContext, mesh: &Mesh) -> Result<(), GpuError> {
        self.mesh = None;
        self.mesh = Some(MeshBuffers::new(gpu, mesh)?);
        Ok(())
    }

    /// Puts every ray of a tile at its beginning, and draws the mesh that bounds them. With a list, only its pixels may be
    /// cast.
    ///
    /// # Errors
    /// The device is lost.
    pub fn begin_tile(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &Residency,
        tile: &Tile,
        pixels: PixelList<'_>,
    ) -> Result<(), GpuError> {
        self.read_times(gpu, 16)?;
        self.several.begin_tile();
        let targets = self
            .targets
            .as_ref()
            .expect("invariant: the picture was begun");
        let params = DispatchParams {
            tile: *tile,
            dispatch: 0,
        };
        self.frame.write(gpu, inputs, volume, &params);
        if let Some(list) = pixels {
            targets.raycast.write_list(gpu, list);
        }
        let mut encoder = encoder(gpu, "renderer.tile");
        targets.raycast.clear(&mut encoder);
        let is_bounded = inputs.skip && !inputs.rays.projection.is_panoramic();
        if let Some(mesh) = self.mesh.as_ref().filter(|_| is_bounded) {
            let mesh_level = inputs.rays.coarsest_used();
            let mirrored = mesh_level.world_from_level.matrix3.determinant() < 0.0;
            self.bounds.record(
                &mut encoder,
                &self.frame,
                mesh,
                &targets.bounds,
                mirrored,
                &mut self.timer,
            );
        }
        gpu.queue.submit([encoder.finish()]);
        self.parts
            .cut(gpu, &self.frame, inputs.rays, tile, &mut self.timer)
    }

    /// Casts rays of a tile that was begun. Technique layers waits until its layers are measured.
    ///
    /// # Errors
    /// The device is lost.
    pub fn cast(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &mut Residency,
        tile: &Tile,
        cast: &Cast<'_>,
    ) -> Result<PendingFeedback, GpuError> {
        self.read_times(gpu, 2)?;
        let targets = self
            .targets
            .as_ref()
            .expect("invariant: the picture was begun");
        let dispatch = volume.next_dispatch();
        let params = DispatchParams {
            tile: *tile,
            dispatch,
        };
        self.frame.write(gpu, inputs, volume, &params);
        let places = volume.feedback_places();
        let how = match (cast.draft, cast.is_listed) {
            (true, _) => CastKind::Draft,
            (false, true) => CastKind::List,
            (false, false) => CastKind::Tile,
        };
        let mut groups = cast.groups.to_vec();
        if gpu.caps.is_software {
            Self::sort_by_place(tile, how.slab(inputs), cast.is_listed, &mut groups);
            groups = spread(&groups);
        }
        let flow = Flow::of(inputs.settings.technique, cast.draft, cast.is_listed);
        let several = targets.several.as_ref().filter(|t| t.flow() == flow);
        let limit = self.several.pass_samples(flow, cast.sample_limit);
        write_orders(gpu, inputs, volume, cast, (flow, limit), &groups);
        let cells = (tile, cast.sample_limit);
        let plan = self.several.plan(
            gpu,
            inputs,
            &self.frame,
            several,
            cells,
            (&mut groups, &mut self.timer),
        )?;
        if flow == Flow::Layers {
            // In the order of their layers.
            write_orders(gpu, inputs, volume, cast, (flow, limit), &groups);
        }
        let cast_group = match &targets.leap {
            Some((_, group)) if cast.draft && inputs.settings.leaps() => group,
            _ => &targets.cast_group,
        };
        let mut encoder = encoder(gpu, "renderer.cast");
        places.clear(&mut encoder, &volume.feedback);
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("raycast"),
                timestamp_writes: self.timer.compute("raycast"),
            });
            self.several.record(
                &mut pass,
                &self.frame,
                (several, cast_group),
                (&plan, groups.len() as u32),
                |pass, group| {
                    self.raycast.bind(
                        pass,
                        inputs,
                        &self.frame,
                        volume,
                        [group, self.parts.group()],
                        how,
                    );
                },
            );
        }
        let copy = PendingFeedback::record(gpu, &mut encoder, &volume.feedback, places, dispatch);
        gpu.queue.submit([encoder.finish()]);
        Ok(PendingFeedback::map(copy))
    }

    /// As [`Self::cast`], and waits for the report.
    ///
    /// # Errors
    /// The device is lost.
    pub fn cast_and_wait(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &mut Residency,
        tile: &Tile,
        cast: &Cast<'_>,
    ) -> Result<Feedback, GpuError> {
        self.cast(gpu, inputs, volume, tile, cast)?.wait(gpu)
    }

    /// Where the rays of pixels number `pixels` of the tile's buffers stand.
    ///
    /// # Errors
    /// The device is lost.
    pub fn ray_states(
        &self,
        gpu: &GpuContext,
        pixels: Range<u32>,
    ) -> Result<Vec<RayState>, GpuError> {
        let targets = self
            .targets
            .as_ref()
            .expect("invariant: the picture was begun");
        let size = size_of::<RayState>() as u64;
        let [bytes] = read_buffers(
            gpu,
            [(
                targets.raycast.rays(),
                u64::from(pixels.start) * size,
                pixels.len() as u64 * size,
            )],
        )?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// Reads the pixels of a tile that were cast back into the picture, as ray number `ray[0]` of the `ray[1]` of each.
    ///
    /// # Errors
    /// The device is lost.
    pub fn collect(
        &mut self,
        gpu: &GpuContext,
        tile: &Tile,
        pixels: PixelList<'_>,
        ray: [usize; 2],
        image: &mut Image,
    ) -> Result<RayCounts, GpuError> {
        let targets = self
            .targets
            .as_ref()
            .expect("invariant: the picture was begun");
        let in_rows = u64::from(tile.size[0]) * u64::from(tile.part_size[1]);
        let [colors, counts] = read_buffers(
            gpu,
            [
                (&targets.raycast.picture, 0, in_rows * 16),
                (
                    &targets.raycast.counts,
                    0,
                    in_rows * size_of::<PixelCounts>() as u64,
                ),
            ],
        )?;
        let colors: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&colors);
        let counts: Vec<PixelCounts> = bytemuck::pod_collect_to_vec(&counts);
        let [left, top] = tile.origin.map(|o| o as usize);
        let (stride, width) = (tile.size[0] as usize, image.width as usize);
        let mut sums = RayCounts::default();
        let mut take = |x: usize, y: usize| {
            let from = y * stride + x;
            let to = (top + y) * width + left + x;
            add_ray(
                &mut image.pixels[to],
                Vec4::from_array(colors[from]),
                ray[0],
                ray[1],
            );
            let counts = &counts[from];
            let met = |mm: f32| if mm > 0.0 { mm } else { f32::INFINITY };
            image.note_depths(to, [met(counts.first_mm), met(counts.end_mm)]);
            sums += RayCounts {
                samples: counts.samples.into(),
                skipped: counts.skipped.into(),
                contributing: counts.contributing.into(),
            };
        };
        match pixels {
            Some(list) => {
                for &pixel in list {
                    take((pixel & 0xffff) as usize, (pixel >> 16) as usize);
                }
            }
            None => {
                for y in 0..tile.part_size[1] as usize {
                    for x in 0..tile.part_size[0] as usize {
                        take(x, y);
                    }
                }
            }
        }
        let stride = tile.size[0];
        self.several
            .count(tile, |[x, y]| counts[(y * stride + x) as usize].samples);
        Ok(sums)
    }

    /// What technique layers did since the last call; `None` where it did nothing.
    pub fn take_layer_stats(&mut self) -> Option<LayerStats> {
        self.several.take_stats()
    }

    /// Milliseconds per pass since the last call, where the device has timestamps.
    ///
    /// # Errors
    /// The device is lost.
    pub fn take_passes_ms(
        &mut self,
        gpu: &GpuContext,
    ) -> Result<Option<BTreeMap<String, f64>>, GpuError> {
        self.read_times(gpu, TIMED_PASSES)?;
        Ok(self.passes_ms.as_mut().map(std::mem::take))
    }

    /// Reads the times of passes when there is no place for `passes` more.
    fn read_times(&mut self, gpu: &GpuContext, passes: u32) -> Result<(), GpuError> {
        if self.timer.is_full_for(passes)
            && let (Some(sums), Some(times)) = (&mut self.passes_ms, self.timer.read(gpu)?)
        {
            for (name, ms) in times {
                *sums.entry(name).or_insert(0.0) += ms;
            }
        }
        Ok(())
    }
}

/// Sends what the host orders for a submission that casts `groups`, `limit` samples of a ray in a pass.
fn write_orders(
    gpu: &GpuContext,
    inputs: &FrameInputs<'_>,
    volume: &Residency,
    cast: &Cast<'_>,
    (flow, limit): (Flow, u32),
    groups: &[u32],
) {
    assert!(
        groups.len() <= MAX_GROUPS as usize,
        "invariant: a tile has at most {MAX_GROUPS} work-groups"
    );
    let is_panoramic = inputs.rays.projection.is_panoramic();
    let mut orders = vec![0; FEEDBACK_GROUPS as usize];
    let mut order = |word: u32, value| orders[word as usize] = value;
    order(FEEDBACK_LIMIT, if cast.draft { u32::MAX } else { limit });
    order(
        FEEDBACK_SKIP,
        match (inputs.skip, flow) {
            (false, _) => 0,
            (true, Flow::Layers) if is_panoramic => 0,
            (true, _) if is_panoramic => SKIP_WITHOUT_MESH,
            (true, Flow::Layers) => SKIP_OUTSIDE,
            (true, _) => SKIP_BLOCKS,
        },
    );
    order(FEEDBACK_PIXELS, u32::from(cast.is_listed));
    order(FEEDBACK_COMPACTED, u32::from(flow == Flow::Multipass));
    order(FEEDBACK_QUIET, u32::from(flow != Flow::Once));
    order(FEEDBACK_LEVELS, inputs.rays.levels.len() as u32);
    orders.extend(groups);
    let place = volume.feedback_places().orders;
    gpu.queue.write_buffer(
        &volume.feedback,
        u64::from(place) * 4,
        bytemuck::cast_slice(&orders),
    );
}

fn encoder(gpu: &GpuContext, label: &str) -> wgpu::CommandEncoder {
    gpu.device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
}
