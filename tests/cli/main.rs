//! The command line through the real binary: what cli.md promises to users and scripts.

mod bad_inputs;
mod bench;
mod commands;
mod contract;
mod cutting;
#[path = "../support/data.rs"]
mod data;
mod extract;
mod fly;
#[cfg(unix)]
mod interrupted;
mod pictures;
#[cfg(unix)]
mod resumed;
mod run;
mod seeds;
