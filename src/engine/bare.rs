//! What the device could do at most: the ceiling that `bench` holds pictures against.

use super::{Device, Engine, EngineError};
use crate::camera::Camera;
use crate::scene::PictureSettings;

/// What pictures without bricks and without skipping took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BareRate {
    /// Samples of all pictures.
    pub samples: u64,
    /// Wall time, ms.
    pub wall_ms: f64,
    /// User and system time of all threads, ms; `None` where there is no such clock.
    pub cpu_ms: Option<f64>,
    /// Time of the passes by the device's timestamps, ms; `None` without.
    pub gpu_ms: Option<f64>,
}

#[cfg(feature = "gpu")]
impl BareRate {
    /// All together.
    pub(super) fn sum(parts: &[Self]) -> Self {
        Self {
            samples: parts.iter().map(|p| p.samples).sum(),
            wall_ms: parts.iter().map(|p| p.wall_ms).sum(),
            cpu_ms: parts.iter().map(|p| p.cpu_ms).sum(),
            gpu_ms: parts.iter().map(|p| p.gpu_ms).sum(),
        }
    }
}

/// The rates of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BareRates {
    /// Interpolated by hand in f32, as the caster does by default.
    pub exact: BareRate,
    /// By the hardware's linear filter; `None` where the device can't filter this type.
    pub filtered: Option<BareRate>,
    /// The device is the processor, so that its time is CPU time.
    pub on_processor: bool,
}

impl Engine {
    /// Measures the device's own ceiling for mode dvr without light: at every sample position of the pictures of
    /// `settings` from `cameras` (those inside the volume, to the end of the ray) one fetch from a dense texture of the
    /// level, one look-up of the classification, one step of compositing. No bricks, no skipping, no early end. Each level
    /// that is sampled is a texture and a dispatch of its own. One picture is cast before the clock starts.
    ///
    /// What is resident is dropped. `None` where a level doesn't fit the device's textures or the bound of its memory, and
    /// on the CPU, where nothing is measured.
    ///
    /// # Errors
    /// The settings make no picture, a brick can't be read, or the device fails.
    #[cfg_attr(
        not(feature = "gpu"),
        expect(unused_variables, reason = "only a GPU is measured")
    )]
    pub fn measure_bare(
        &mut self,
        settings: &PictureSettings,
        cameras: &[Camera],
    ) -> Result<Option<BareRates>, EngineError> {
        match &mut self.device {
            Device::Cpu(_) => Ok(None),
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => gpu.measure_bare(settings, cameras),
        }
    }
}
