//! The one way of bytes into textures: a staging belt, in bursts of bounded size.
//!
//! `queue.write_texture` in a burst allocates without bound (gfx-rs/wgpu#828); the belt reuses its chunks.

use wgpu::util::StagingBelt;

use super::{GpuContext, GpuError};

/// A belt of mapped chunks and the encoder of the current burst.
#[derive(Debug)]
pub struct Staging {
    belt: StagingBelt,
    encoder: Option<wgpu::CommandEncoder>,
    burst_bytes: u64,
    in_burst: u64,
    chunk_bytes: u64,
}

impl Staging {
    /// A belt whose bursts stay below `burst_bytes` (at least one chunk), in chunks of `chunk_bytes`.
    pub fn new(gpu: &GpuContext, chunk_bytes: u64, burst_bytes: u64) -> Self {
        Self {
            belt: StagingBelt::new(gpu.device.clone(), chunk_bytes),
            encoder: None,
            burst_bytes: burst_bytes.max(chunk_bytes),
            in_burst: 0,
            chunk_bytes,
        }
    }

    /// The most memory the belt holds.
    pub fn bytes(&self) -> u64 {
        self.burst_bytes.div_ceil(self.chunk_bytes) * self.chunk_bytes
    }

    /// Stages `bytes` (a multiple of 4) and hands the encoder, the buffer and the offset to `copy`, which records the
    /// copies out of it. Submits the burst first when these bytes no longer fit it.
    ///
    /// # Errors
    /// The device is lost, or the bytes can't be mapped.
    pub fn stage(
        &mut self,
        gpu: &GpuContext,
        bytes: &[u8],
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer, u64),
    ) -> Result<(), GpuError> {
        let size = bytes.len() as u64;
        if self.in_burst + size > self.burst_bytes {
            self.flush(gpu)?;
        }
        self.in_burst += size;
        let Some(nonzero) = wgpu::BufferSize::new(size) else {
            return Ok(());
        };
        let alignment = const { wgpu::BufferSize::new(256).expect("invariant: 256 is not 0") };
        let slice = self.belt.allocate(nonzero, alignment);
        slice
            .get_mapped_range_mut()
            .map_err(|e| GpuError::Device {
                doing: "staging an upload",
                reason: e.to_string(),
            })?
            .copy_from_slice(bytes);
        let encoder = self.encoder.get_or_insert_with(|| {
            gpu.device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                    label: Some("gpu.staging"),
                })
        });
        copy(encoder, slice.buffer(), slice.offset());
        Ok(())
    }

    /// Submits what is staged without waiting for it; waits only when half a burst is under way.
    ///
    /// # Errors
    /// The device is lost.
    pub fn submit(&mut self, gpu: &GpuContext) -> Result<(), GpuError> {
        if let Some(encoder) = self.encoder.take() {
            self.belt.finish();
            gpu.queue.submit([encoder.finish()]);
            self.belt.recall();
        }
        if self.in_burst > self.burst_bytes / 2 {
            self.in_burst = 0;
            gpu.wait()?;
        }
        Ok(())
    }

    /// Submits what is staged, waits for it, and takes the chunks back.
    ///
    /// # Errors
    /// The device is lost.
    pub fn flush(&mut self, gpu: &GpuContext) -> Result<(), GpuError> {
        self.in_burst = self.burst_bytes;
        self.submit(gpu)
    }
}
