//! One file per command.

pub mod brick;
pub mod info;
mod progress;
pub mod verify;
