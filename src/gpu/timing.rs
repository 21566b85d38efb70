//! Time that passes take on the device, by timestamps at their begin and end.

use std::collections::BTreeMap;

use super::{GpuContext, GpuError, read_buffers};

/// Times up to a fixed number of passes; does nothing where the device has no timestamps.
#[derive(Debug)]
pub struct PassTimer {
    queries: Option<Queries>,
    names: Vec<&'static str>,
}

#[derive(Debug)]
struct Queries {
    set: wgpu::QuerySet,
    buffer: wgpu::Buffer,
    capacity: u32,
}

impl PassTimer {
    /// A timer for at most `passes` passes between two calls of [`Self::read`].
    pub fn new(gpu: &GpuContext, passes: u32) -> Self {
        let queries = gpu.caps.timestamps.then(|| Queries {
            set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("gpu.timing"),
                ty: wgpu::QueryType::Timestamp,
                count: passes * 2,
            }),
            buffer: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("gpu.timing"),
                size: u64::from(passes) * 16,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            capacity: passes,
        });
        Self {
            queries,
            names: Vec::new(),
        }
    }

    /// The two queries of the next pass, named `name`; `None` when there are no timestamps or no place is left.
    fn next(&mut self, name: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let queries = self
            .queries
            .as_ref()
            .filter(|q| (self.names.len() as u32) < q.capacity)?;
        let first = self.names.len() as u32 * 2;
        self.names.push(name);
        Some((&queries.set, first))
    }

    /// Timestamps for a render pass.
    pub fn render(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.next(name)
            .map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            })
    }

    /// Timestamps for a compute pass.
    pub fn compute(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.next(name)
            .map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            })
    }

    /// True when there is no place for `passes` more: time to [`Self::read`].
    pub fn is_full_for(&self, passes: u32) -> bool {
        self.queries
            .as_ref()
            .is_some_and(|q| self.names.len() as u32 + passes > q.capacity)
    }

    /// Milliseconds by name, summed over passes of one name, and a fresh start; `None` without timestamps. Blocks.
    ///
    /// # Errors
    /// The device is lost.
    pub fn read(&mut self, gpu: &GpuContext) -> Result<Option<BTreeMap<String, f64>>, GpuError> {
        let Some(q) = &self.queries else {
            return Ok(None);
        };
        let names = std::mem::take(&mut self.names);
        if names.is_empty() {
            return Ok(Some(BTreeMap::new()));
        }
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("gpu.timing"),
            });
        encoder.resolve_query_set(&q.set, 0..names.len() as u32 * 2, &q.buffer, 0);
        gpu.queue.submit([encoder.finish()]);
        let [bytes] = read_buffers(gpu, [(&q.buffer, 0, names.len() as u64 * 16)])?;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
        let period_ns = f64::from(gpu.queue.get_timestamp_period());
        let mut sums = BTreeMap::new();
        for (name, pair) in names.iter().zip(ticks.chunks_exact(2)) {
            *sums.entry((*name).to_owned()).or_insert(0.0) +=
                pair[1].saturating_sub(pair[0]) as f64 * period_ns / 1e6;
        }
        Ok(Some(sums))
    }
}
