//! Buffers back to the host, blocking: the off-screen path.

use super::{GpuContext, GpuError};

/// A range of each buffer (usage `COPY_SRC`) as (buffer, offset, bytes), after all work submitted so far.
///
/// # Errors
/// The device is lost or refuses to map.
pub fn read_buffers<const N: usize>(
    gpu: &GpuContext,
    sources: [(&wgpu::Buffer, u64, u64); N],
) -> Result<[Vec<u8>; N], GpuError> {
    let failed = |reason: String| GpuError::Device {
        doing: "reading the picture back",
        reason,
    };
    let mut encoder = gpu
        .device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("gpu.readback"),
        });
    let targets = sources.map(|(source, offset, size)| {
        let target = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("gpu.readback"),
            size,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(source, offset, &target, 0, size);
        target
    });
    gpu.queue.submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::channel();
    for target in &targets {
        let sender = sender.clone();
        target.map_async(wgpu::MapMode::Read, .., move |result| {
            // The receiver outlives the wait below.
            let _ = sender.send(result);
        });
    }
    gpu.wait()?;
    for _ in 0..N {
        receiver
            .recv()
            .map_err(|e| failed(e.to_string()))?
            .map_err(|e| failed(e.to_string()))?;
    }
    let mut out = std::array::from_fn(|_| Vec::new());
    for (bytes, target) in out.iter_mut().zip(&targets) {
        *bytes = target
            .get_mapped_range(..)
            .map_err(|e| failed(e.to_string()))?
            .to_vec();
        target.unmap();
    }
    Ok(out)
}
