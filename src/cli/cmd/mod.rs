//! One file per command.

pub mod presets;
pub mod demo;
pub mod render;
