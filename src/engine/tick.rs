//! Work in small pieces: what a window or a server does between two frames.

use std::time::Duration;

use super::{Device, Engine, EngineError};
use crate::camera::Camera;
use crate::scene::{Classification, Image, PictureSettings, PictureStats};

/// How much a tick may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickBudget {
    /// Time after which no new piece of work is begun. A piece is a dispatch, a draft, or a batch of uploads.
    pub time: Duration,
    /// Bytes of bricks that a piece of work uploads.
    pub upload_bytes: u64,
}

impl Default for TickBudget {
    /// A sixtieth of a second, 4 MiB.
    fn default() -> Self {
        Self {
            time: Duration::from_micros(16_667),
            upload_bytes: 4 << 20,
        }
    }
}

/// What happened to the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickEvent {
    /// It is whole for the first time since it was set: no voxel is wider than four pixels, unless level 0 has none
    /// finer.
    Whole,
    /// It got finer.
    Refined,
    /// It is exact: every sample is from the level that was asked for.
    Converged,
    /// It can't become exact: a brick can't be read. Coarser ones stand in.
    Failed,
}

/// The state of the picture after a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickReport {
    /// The last thing that happened in the tick.
    pub event: Option<TickEvent>,
    /// The picture is exact.
    pub converged: bool,
    /// Bricks for which coarser ones stand in, as far as is known.
    pub missing_bricks: u64,
    /// Bricks that could not be read.
    pub failed_bricks: u64,
}

impl Engine {
    /// Sets the picture that [`Self::tick`] draws: camera, classification and everything else. What is equal to before
    /// costs nothing; a new classification uploads no voxel.
    pub fn set_picture(&mut self, settings: PictureSettings) {
        match &mut self.device {
            Device::Cpu(cpu) => cpu.set_live(settings),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.set_live(settings),
        }
    }

    /// As [`Self::set_picture`], with another camera. Without a picture set before: of no effect.
    pub fn set_camera(&mut self, camera: Camera) {
        if let Some(settings) = self.picture_settings().cloned() {
            self.set_picture(PictureSettings { camera, ..settings });
        }
    }

    /// As [`Self::set_picture`], with another classification. Without a picture set before: of no effect.
    pub fn set_classification(&mut self, classification: Classification) {
        if let Some(settings) = self.picture_settings().cloned() {
            self.set_picture(PictureSettings {
                classification,
                ..settings
            });
        }
    }

    /// What [`Self::tick`] draws.
    pub fn picture_settings(&self) -> Option<&PictureSettings> {
        match &self.device {
            Device::Cpu(cpu) => cpu.live_settings(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.live_settings(),
        }
    }

    /// Does a bounded piece of work on the picture that was set. It is whole soon and exact in the end, under any memory.
    /// On the GPU it is refined while bricks come, and nothing waits for disk; the CPU reads the bricks that it meets.
    ///
    /// # Errors
    /// The settings make no picture, or the device fails or is too small. A brick that can't be read is no error on the
    /// GPU: [`TickEvent::Failed`].
    pub fn tick(&mut self, budget: &TickBudget) -> Result<TickReport, EngineError> {
        match &mut self.device {
            Device::Cpu(cpu) => cpu.tick(budget),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.tick(budget),
        }
    }

    /// Is the picture that was set exact?
    pub fn is_converged(&self) -> bool {
        match &self.device {
            Device::Cpu(cpu) => cpu.is_live_converged(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.is_live_converged(),
        }
    }

    /// The picture that was set, as far as it is drawn: always whole, or `None` before the first. After a change it is
    /// the one before until the new one is whole.
    pub fn image(&self) -> Option<&Image> {
        match &self.device {
            Device::Cpu(cpu) => cpu.live_image(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.live_image(),
        }
    }

    /// The numbers of the picture that was set, counted since then; `None` where none was.
    ///
    /// # Errors
    /// The device is lost.
    pub fn statistics(&mut self) -> Result<Option<PictureStats>, EngineError> {
        let stats = match &mut self.device {
            Device::Cpu(cpu) => cpu.live_stats(),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.live_stats()?,
        };
        Ok(stats.map(|stats| PictureStats {
            version: env!("CARGO_PKG_VERSION").into(),
            ..stats
        }))
    }
}
