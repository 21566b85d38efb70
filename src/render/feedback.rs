//! What rays report: which bricks they miss, which slots they used, which work-groups are not finished. The buffer's
//! layout is in `gpu::layout` (FEEDBACK_*); the shader's half is `shaders/lib/feedback.wgsl`.

use std::sync::mpsc::{Receiver, channel};

use crate::gpu::layout::{
    FEEDBACK_FIRST_STOPPED, FEEDBACK_GROUPS, FEEDBACK_HEAD, FEEDBACK_LIST, FEEDBACK_LIST_MAX,
    FEEDBACK_LISTED, FEEDBACK_PENDING, FEEDBACK_RAYS, FEEDBACK_RAYS_BITS, FEEDBACK_STOPPED,
    MAX_GROUPS,
};
use crate::gpu::{GpuContext, GpuError};
use crate::pager::SlotId;

/// A brick that rays miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissedBrick {
    /// Its number among the bricks of all levels ([`super::Residency::brick`]).
    pub number: u32,
    /// How many rays stopped at it, or at one of the same hash.
    pub rays: u32,
}

/// The report of one dispatch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Feedback {
    /// The lowest pixel of the tile (by its place in the tile's buffers) that stopped.
    pub first_stopped: Option<u32>,
    /// Rays that stopped at a missing brick; in a draft, those that missed one.
    pub stopped: u32,
    /// Rays that are not finished.
    pub unfinished: u32,
    /// Work-groups with unfinished rays, rising.
    pub pending_groups: Vec<u32>,
    /// Missing bricks by number, rising. Those that didn't fit the list are reported again by the next dispatch.
    pub missed: Vec<MissedBrick>,
    /// Slots that were sampled, rising.
    pub used_slots: Vec<SlotId>,
}

/// Places in the feedback buffer that depend on the volume, in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FeedbackPlaces {
    /// What the host orders for a dispatch.
    pub(super) orders: u32,
    /// Per slot, the last dispatch that used it.
    pub(super) stamps: u32,
    /// A bit per brick: asked for.
    pub(super) bits: u32,
    pub(super) end: u32,
}

impl FeedbackPlaces {
    pub(super) fn new(slots: u32, bricks: u32) -> Self {
        let orders = FEEDBACK_HEAD;
        let stamps = orders + FEEDBACK_GROUPS + MAX_GROUPS;
        let bits = stamps + slots;
        Self {
            orders,
            stamps,
            bits,
            end: bits + bricks.div_ceil(32),
        }
    }

    /// Bytes of the buffer.
    pub(super) fn bytes(self) -> u64 {
        u64::from(self.end) * 4
    }

    /// Bytes that are read back after a dispatch: everything but the bits.
    pub(super) fn report_bytes(self) -> u64 {
        u64::from(self.bits) * 4
    }

    /// Makes the buffer ready for a dispatch. Stamps stay: they are compared with the dispatch's number.
    pub(super) fn clear(self, encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer) {
        encoder.clear_buffer(buffer, 0, Some(u64::from(FEEDBACK_HEAD) * 4));
        encoder.clear_buffer(buffer, u64::from(self.bits) * 4, None);
    }
}

impl Feedback {
    /// Reads the report of dispatch number `dispatch` from the buffer's words.
    fn parse(words: &[u32], places: FeedbackPlaces, dispatch: u32) -> Self {
        let word = |at: u32| words[at as usize];
        let range = |from: u32, count: u32| &words[from as usize..(from + count) as usize];
        let first = word(FEEDBACK_FIRST_STOPPED);
        let listed = word(FEEDBACK_LISTED).min(FEEDBACK_LIST_MAX);
        let mut missed: Vec<MissedBrick> = range(FEEDBACK_LIST, listed)
            .iter()
            .map(|&number| MissedBrick {
                number,
                rays: word(
                    FEEDBACK_RAYS + (number.wrapping_mul(0x9e37_79b9) >> (32 - FEEDBACK_RAYS_BITS)),
                ),
            })
            .collect();
        missed.sort_unstable_by_key(|m| m.number);
        let places_of = |values: &[u32], is: &dyn Fn(u32) -> bool| -> Vec<u32> {
            (0..)
                .zip(values)
                .filter(|(_, v)| is(**v))
                .map(|(i, _)| i)
                .collect()
        };
        let slots = places.bits - places.stamps;
        Self {
            first_stopped: (first > 0).then(|| u32::MAX - first),
            stopped: word(FEEDBACK_STOPPED),
            unfinished: range(FEEDBACK_PENDING, MAX_GROUPS).iter().sum(),
            pending_groups: places_of(range(FEEDBACK_PENDING, MAX_GROUPS), &|n| n > 0),
            missed,
            used_slots: places_of(range(places.stamps, slots), &|s| s == dispatch)
                .into_iter()
                .map(SlotId)
                .collect(),
        }
    }
}

/// A report on its way back: asked for, and there some time later. Reading it never blocks the device.
#[derive(Debug)]
pub struct PendingFeedback {
    buffer: wgpu::Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    places: FeedbackPlaces,
    dispatch: u32,
}

impl PendingFeedback {
    /// Records the copy out of `source`; call [`Self::map`] after the submission.
    pub(super) fn record(
        gpu: &GpuContext,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::Buffer,
        places: FeedbackPlaces,
        dispatch: u32,
    ) -> (wgpu::Buffer, FeedbackPlaces, u32) {
        let bytes = places.report_bytes();
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("feedback.readback"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes);
        (buffer, places, dispatch)
    }

    /// Asks for the copy's bytes.
    pub(super) fn map((buffer, places, dispatch): (wgpu::Buffer, FeedbackPlaces, u32)) -> Self {
        let (sender, mapped) = channel();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            // A report that nobody waits for any more is dropped.
            let _ = sender.send(result);
        });
        Self {
            buffer,
            mapped,
            places,
            dispatch,
        }
    }

    /// The report, if it is there by now.
    ///
    /// # Errors
    /// The device is lost.
    pub fn try_take(&mut self, gpu: &GpuContext) -> Result<Option<Feedback>, GpuError> {
        gpu.poll()?;
        match self.mapped.try_recv() {
            Ok(result) => self.read(result).map(Some),
            Err(std::sync::mpsc::TryRecvError::Empty) => Ok(None),
            Err(e) => Err(failed(e.to_string())),
        }
    }

    /// The report; waits for it.
    ///
    /// # Errors
    /// The device is lost.
    pub fn wait(self, gpu: &GpuContext) -> Result<Feedback, GpuError> {
        gpu.wait()?;
        let result = self.mapped.recv().map_err(|e| failed(e.to_string()))?;
        self.read(result)
    }

    fn read(&self, result: Result<(), wgpu::BufferAsyncError>) -> Result<Feedback, GpuError> {
        result.map_err(|e| failed(e.to_string()))?;
        let bytes = self
            .buffer
            .get_mapped_range(..)
            .map_err(|e| failed(e.to_string()))?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(Feedback::parse(&words, self.places, self.dispatch))
    }
}

fn failed(reason: String) -> GpuError {
    GpuError::Device {
        doing: "reading the rays' requests back",
        reason,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_read_as_the_shader_writes_it() {
        let places = FeedbackPlaces::new(5, 100);
        assert_eq!(
            places.bytes(),
            u64::from(FEEDBACK_HEAD + FEEDBACK_GROUPS + MAX_GROUPS + 5 + 4) * 4
        );
        let mut words = vec![0; places.end as usize];
        assert_eq!(
            Feedback::parse(&words, places, 7),
            Feedback::default(),
            "nothing happened"
        );
        words[FEEDBACK_FIRST_STOPPED as usize] = u32::MAX - 12;
        words[FEEDBACK_STOPPED as usize] = 3;
        words[FEEDBACK_LISTED as usize] = 2;
        words[FEEDBACK_LIST as usize..][..2].copy_from_slice(&[40, 9]);
        words[FEEDBACK_PENDING as usize + 6] = 3;
        let hash = 9_u32.wrapping_mul(0x9e37_79b9) >> (32 - FEEDBACK_RAYS_BITS);
        words[(FEEDBACK_RAYS + hash) as usize] = 2;
        words[places.stamps as usize..][..5].copy_from_slice(&[7, 6, 0, 7, 8]);
        let report = Feedback::parse(&words, places, 7);
        assert_eq!(report.first_stopped, Some(12));
        assert_eq!(report.pending_groups, [6]);
        assert_eq!(report.missed[0], MissedBrick { number: 9, rays: 2 });
        assert_eq!(
            report.missed[1],
            MissedBrick {
                number: 40,
                rays: 0
            }
        );
        assert_eq!(
            report.used_slots,
            [SlotId(0), SlotId(3)],
            "stamped by this dispatch"
        );
    }
}
