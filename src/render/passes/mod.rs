//! The passes of a frame: bounds, parts, leap, raycast; between several casts of the same rays compact or layers, and report. And one that
//! draws no frame: bare.

mod bare;
mod bounds;
mod compact;
mod layers;
mod leap;
mod parts;
mod pipeline;
mod raycast;
mod report;

pub use bare::{BareCaster, DenseLevel};
pub(super) use bounds::{BoundsPass, BoundsTargets, MeshBuffers};
pub(super) use compact::{CompactPass, CompactTargets};
pub(super) use layers::{LayersPass, LayersTargets};
pub use leap::LeapFault;
pub(super) use leap::{LeapPass, LeapTargets};
pub(super) use parts::PartsPass;
pub(super) use raycast::{CastKind, RaycastPass, RaycastTargets};
pub(super) use report::ReportPass;
