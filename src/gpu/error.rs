//! What can go wrong with the graphics device.

use thiserror::Error;

/// Why the GPU can't be used, or stopped.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum GpuError {
    #[error(
        "no graphics adapter: found neither a GPU with a Vulkan, Metal or DX12 driver nor a software renderer; install \
         the GPU's driver, or Mesa's software Vulkan (Debian: apt-get install mesa-vulkan-drivers), or render with \
         --device cpu"
    )]
    NoAdapter,
    #[error("no graphics adapter is named like '{asked}'; found: {}", if found.is_empty() { "none".to_owned() } else { found.join("; ") })]
    NoSuchAdapter { asked: String, found: Vec<String> },
    #[error("the adapter {adapter} gives no device: {reason}")]
    NoDevice { adapter: String, reason: String },
    #[error("{doing}: the graphics device has not the memory: {reason}")]
    OutOfMemory { doing: &'static str, reason: String },
    #[error("{doing}: the graphics device reports: {reason}")]
    Device { doing: &'static str, reason: String },
    #[error("{what} needs {needed} bytes, but {limit} is all that {limited_by} allows; {remedy}")]
    TooSmall {
        what: String,
        needed: u64,
        limit: u64,
        limited_by: String,
        remedy: String,
    },
    #[error(
        "{crossings} crossings of rays and meshes in a tile of {pixels} pixels need {needed} bytes, but {limit} is all that \
         there is for them"
    )]
    TooManyCrossings {
        crossings: u64,
        pixels: u64,
        needed: u64,
        limit: u64,
    },
}
