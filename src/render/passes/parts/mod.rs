//! Rays cut to parts by the geometry of a picture, on the device.

mod geometry;
mod pass;
mod targets;

pub(in crate::render) use pass::PartsPass;
