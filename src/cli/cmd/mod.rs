//! One file per command.

pub mod presets;
