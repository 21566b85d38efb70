//! Pictures in memory, tile by tile, so that `--size` is bounded by no texture and no buffer.

use std::collections::BTreeMap;

use glam::Vec4;

use super::frame::{BOUNDS_MARGIN, FrameBindings, FrameInputs, Tile};
use super::passes::{BoundsPass, BoundsTargets, MeshBuffers, RaycastPass, RaycastTargets};
use super::residency::Residency;
use crate::classify::LUT_ENTRIES;
use crate::gpu::{GpuContext, GpuError, PassTimer, read_buffers};
use crate::proxy::Mesh;
use crate::scene::{Image, RayCounts};

/// Greatest width and height of a tile, pixels: 2²⁰ rays.
pub const TILE_EDGE: u32 = 1024;

/// Bytes per pixel of a tile: picture and counts, their read-back copies, three depths.
const BYTES_PER_PIXEL: u64 = (16 + 8) * 2 + 3 * 4;

/// A picture and what it took on the device.
#[derive(Debug)]
pub struct OffscreenPicture {
    /// Premultiplied, before the background.
    pub image: Image,
    /// Samples, summed over rays.
    pub counts: RayCounts,
    /// Milliseconds per pass, where the device has timestamps.
    pub passes_ms: Option<BTreeMap<String, f64>>,
    /// Bytes on the device for the frame: tiles, mesh, table.
    pub frame_bytes: u64,
}

/// The passes and the buffers that outlive a picture.
#[derive(Debug)]
pub struct Renderer {
    frame: FrameBindings,
    bounds: BoundsPass,
    raycast: RaycastPass,
    targets: Option<([u32; 2], BoundsTargets, RaycastTargets)>,
    timer: PassTimer,
}

impl Renderer {
    /// The passes that every picture needs; the caster's pipelines come with the modes.
    ///
    /// # Errors
    /// The device refuses a shader or a pipeline.
    pub fn new(gpu: &GpuContext) -> Result<Self, GpuError> {
        let frame = FrameBindings::new(gpu, LUT_ENTRIES);
        let bounds = BoundsPass::new(gpu, &frame)?;
        Ok(Self {
            bounds,
            raycast: RaycastPass::new(gpu),
            frame,
            targets: None,
            timer: PassTimer::new(gpu, 4),
        })
    }

    /// The tile that pictures of `size` are cut into when per-pixel buffers may take `budget_bytes`.
    pub fn tile_size(size: [u32; 2], budget_bytes: u64) -> [u32; 2] {
        let mut tile = size.map(|s| s.min(TILE_EDGE));
        while u64::from(tile[0]) * u64::from(tile[1]) * BYTES_PER_PIXEL > budget_bytes
            && tile != [64, 64]
        {
            let longer = usize::from(tile[1] > tile[0]);
            tile[longer] = (tile[longer] / 2).max(64);
            if tile.iter().all(|&t| t <= 64) {
                break;
            }
        }
        tile
    }

    /// Bytes of the per-pixel buffers of a tile.
    pub fn tile_bytes(tile: [u32; 2]) -> u64 {
        u64::from(tile[0] + 2) * u64::from(tile[1] + 2) * BYTES_PER_PIXEL
    }

    /// Draws a picture. `tile` is from [`Self::tile_size`].
    ///
    /// # Errors
    /// The device is lost or has not the memory.
    pub fn draw(
        &mut self,
        gpu: &GpuContext,
        inputs: &FrameInputs<'_>,
        volume: &Residency,
        mesh: &Mesh,
        tile: [u32; 2],
    ) -> Result<OffscreenPicture, GpuError> {
        let settings = inputs.settings;
        self.raycast.prepare(gpu, settings, &self.frame, volume)?;
        if self.targets.as_ref().is_none_or(|(size, ..)| *size != tile) {
            self.targets = Some(gpu.checked("allocating the picture's buffers", || {
                let bounds = BoundsTargets::new(gpu, tile.map(|t| t + 2 * BOUNDS_MARGIN));
                let pixels = u64::from(tile[0]) * u64::from(tile[1]);
                let raycast = self.raycast.targets(gpu, &bounds, pixels);
                Ok((tile, bounds, raycast))
            })?);
        }
        let mesh_buffers = MeshBuffers::new(gpu, mesh)?;
        let mirrored = inputs.rays.world_from_level.matrix3.determinant() < 0.0;
        self.frame.write_lut(gpu, inputs.classified);

        let [width, height] = inputs.rays.size;
        let mut picture = OffscreenPicture {
            image: Image {
                width,
                height,
                pixels: vec![Vec4::ZERO; width as usize * height as usize],
            },
            counts: RayCounts::default(),
            passes_ms: gpu.caps.timestamps.then(BTreeMap::new),
            frame_bytes: self.frame.bytes() + mesh_buffers.bytes() + Self::tile_bytes(tile),
        };
        for y in (0..height).step_by(tile[1] as usize) {
            for x in (0..width).step_by(tile[0] as usize) {
                let part = Tile {
                    origin: [x, y],
                    size: [tile[0].min(width - x), tile[1].min(height - y)],
                };
                // The depth buffers keep their size; a cut tile is drawn as a whole one whose rest nobody reads.
                self.frame.write(
                    gpu,
                    inputs,
                    volume,
                    Tile {
                        origin: part.origin,
                        size: tile,
                    },
                    RaycastPass::group_count(part.size).element_product(),
                );
                let Some((_, bounds_targets, raycast_targets)) = &self.targets else {
                    unreachable!("invariant: the targets were just made")
                };
                let mut encoder =
                    gpu.device
                        .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                            label: Some("offscreen.tile"),
                        });
                let timer = &mut self.timer;
                if inputs.skip {
                    self.bounds.record(
                        &mut encoder,
                        &self.frame,
                        &mesh_buffers,
                        bounds_targets,
                        mirrored,
                        timer,
                    );
                }
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                        label: Some("raycast"),
                        timestamp_writes: timer.compute("raycast"),
                    });
                    self.raycast.record(
                        &mut pass,
                        settings,
                        &self.frame,
                        volume,
                        raycast_targets,
                        part.size,
                    );
                }
                timer.resolve(&mut encoder);
                gpu.queue.submit([encoder.finish()]);
                self.collect(gpu, part, tile, &mut picture)?;
            }
        }
        Ok(picture)
    }

    /// Reads a finished tile back into the picture.
    fn collect(
        &mut self,
        gpu: &GpuContext,
        part: Tile,
        tile: [u32; 2],
        picture: &mut OffscreenPicture,
    ) -> Result<(), GpuError> {
        let Some((_, _, targets)) = &self.targets else {
            return Ok(());
        };
        let rows = u64::from(tile[0]) * u64::from(part.size[1]);
        let [colors, counts] = read_buffers(
            gpu,
            [(&targets.picture, rows * 16), (&targets.counts, rows * 8)],
        )?;
        let colors: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&colors);
        let counts: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&counts);
        let (stride, kept) = (tile[0] as usize, part.size[0] as usize);
        for row in 0..part.size[1] as usize {
            let from = row * stride;
            let to = (part.origin[1] as usize + row) * picture.image.width as usize
                + part.origin[0] as usize;
            for (pixel, color) in picture.image.pixels[to..to + kept]
                .iter_mut()
                .zip(&colors[from..])
            {
                *pixel = Vec4::from_array(*color);
            }
            for [samples, skipped] in &counts[from..from + kept] {
                picture.counts.samples += u64::from(*samples);
                picture.counts.skipped += u64::from(*skipped);
            }
        }
        if let (Some(sums), Some(times)) = (&mut picture.passes_ms, self.timer.read(gpu)?) {
            for (name, ms) in times {
                *sums.entry(name).or_insert(0.0) += ms;
            }
        }
        Ok(())
    }
}
