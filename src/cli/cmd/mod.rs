//! One file per command.

pub mod bench;
pub mod brick;
pub mod demo;
pub mod extract;
pub mod fly;
pub mod info;
pub mod path;
pub mod presets;
mod progress;
pub mod render;
pub mod verify;
