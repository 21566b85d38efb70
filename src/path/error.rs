//! Why there is no centre-line.

use std::io;

use glam::{DVec3, U64Vec3};
use thiserror::Error;

use crate::camera::CameraPathError;
use crate::store::StoreError;

/// Why there is no centre-line. Positions are world millimetres (RAS+), values physical.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum CenterlineError {
    #[error("lumen: expected LOW not above HIGH, both finite, found {low} and {high}")]
    Range { low: f64, high: f64 },
    #[error(
        "{seed} {at}: expected a point of the volume, found one outside (voxel {voxel:.1} of {dims}); positions are world millimetres, RAS+"
    )]
    Outside {
        seed: &'static str,
        at: DVec3,
        voxel: DVec3,
        dims: U64Vec3,
    },
    #[error(
        "{seed} {at}: expected a value of the lumen, {low} to {high}, found {value}; {}",
        nearest_text(.nearest)
    )]
    NotLumen {
        seed: &'static str,
        at: DVec3,
        value: f64,
        low: f64,
        high: f64,
        /// The nearest voxel of the lumen.
        nearest: Option<NearestLumen>,
    },
    #[error(
        "{seed} {at}: there is no lumen near it on level {level}, the finest that fits --memory; {}", enough_text(*.enough_bytes)
    )]
    Lost {
        seed: &'static str,
        at: DVec3,
        level: u8,
        enough_bytes: u64,
    },
    #[error(
        "the lumen at --from ({from_voxels} voxels of level {level}) and the one at --to ({}) are not connected: the first comes no nearer to --to than {gap_mm:.1} mm, at {nearest}; widen --lumen{}",
        count_text(.to_voxels),
        or_enough_text(*.enough_bytes)
    )]
    NotConnected {
        from_voxels: u64,
        /// `None` when they are more than fit the memory.
        to_voxels: Option<u64>,
        level: u8,
        /// The voxel of the first that is nearest to the destination.
        nearest: DVec3,
        gap_mm: f64,
        /// What surely is enough memory for level 0, where this is not that level.
        enough_bytes: Option<u64>,
    },
    #[error(
        "the way found on level {coarse} is not open on level {level}, near {near}: there it leads through a wall thinner than a voxel; {}", enough_text(*.enough_bytes)
    )]
    Closed {
        coarse: u8,
        level: u8,
        near: DVec3,
        enough_bytes: u64,
    },
    #[error(
        "the lumen leaks out of the volume: of {}; narrow --lumen, or set the seeds inside the organ",
        faces_text(.faces)
    )]
    Leak {
        /// Faces that the lumen lies on, and the share of their voxels.
        faces: Vec<(&'static str, f64)>,
    },
    #[error(
        "the lumen has no wall: every voxel of level {level} around {at} is in {low} to {high}"
    )]
    NoWall {
        level: u8,
        at: DVec3,
        low: f64,
        high: f64,
    },
    #[error("the way is shorter than a voxel: {0} and the point to fly to are the same place")]
    NoWay(DVec3),
    #[error(
        "--memory: this lumen does not fit {found_bytes} bytes on any level; {}",
        enough_text(*.enough_bytes)
    )]
    Memory { found_bytes: u64, enough_bytes: u64 },
    #[error("cannot prepare decompression: {0}")]
    Decompression(io::Error),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Path(#[from] CameraPathError),
}

impl CenterlineError {
    /// Where to write how much memory is enough for level 0, in errors that coarse voxels are to blame for.
    pub(super) fn enough_bytes_mut(&mut self) -> Option<&mut u64> {
        match self {
            Self::Lost { enough_bytes, .. }
            | Self::Closed { enough_bytes, .. }
            | Self::Memory { enough_bytes, .. } => Some(enough_bytes),
            Self::NotConnected { enough_bytes, .. } => enough_bytes.as_mut(),
            _ => None,
        }
    }
}

/// A voxel of the lumen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestLumen {
    /// Its centre, mm.
    pub at: DVec3,
    /// Its value, physical.
    pub value: f64,
    /// How far it is, mm.
    pub distance_mm: f64,
}

fn nearest_text(nearest: &Option<NearestLumen>) -> String {
    match nearest {
        None => "no voxel of the lumen is near; look at the values with `info` or `extract`".into(),
        Some(n) => format!(
            "the nearest voxel of the lumen is at {},{},{} (value {}), {:.1} mm away",
            n.at.x, n.at.y, n.at.z, n.value, n.distance_mm
        ),
    }
}

fn count_text(voxels: &Option<u64>) -> String {
    match voxels {
        Some(n) => format!("{n} voxels"),
        None => "more than fits the memory".into(),
    }
}

/// What helps where coarse voxels don't.
fn enough_text(bytes: u64) -> String {
    let mib = bytes.div_ceil(1 << 20);
    format!("give more --memory: {mib}MiB is enough for all of level 0")
}

fn or_enough_text(bytes: Option<u64>) -> String {
    bytes.map_or_else(String::new, |b| format!(", or {}", enough_text(b)))
}

fn faces_text(faces: &[(&'static str, f64)]) -> String {
    let parts: Vec<String> = faces
        .iter()
        .map(|(name, share)| format!("the {name} face {:.0} % of the voxels", share * 100.0))
        .collect();
    parts.join(", of ")
}
