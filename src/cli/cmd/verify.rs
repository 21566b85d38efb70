//! `verify`: is a store what its writer meant?

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use super::progress::Bar;
use crate::bricking;
use crate::store::Store;

/// Most faults that are printed.
const LIMIT: usize = 100;

/// Check every byte of a store: checksums, index, value ranges, borders, levels
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  brickscope verify scan.bsk && echo sound\n\n\
    Exit code: 0 sound, 1 something is wrong in it, 2 it can't be read at all (no store, another version or length,\n\
    a damaged header)."
)]
pub struct Args {
    /// The store
    #[arg(value_name = "STORE")]
    store: PathBuf,
}

/// Checks the store and prints what is wrong, one line each.
///
/// # Errors
/// The file is no store, or not a whole one.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let mut out = io::stdout().lock();
    let checked = Store::open(&args.store).and_then(|store| {
        store.check_all_levels()?;
        Ok(store)
    });
    let store = match checked {
        Ok(store) => store,
        Err(error) if error.is_damage_inside() => {
            writeln!(out, "{error}")?;
            return Ok(ExitCode::from(1));
        }
        Err(error) => return Err(error.into()),
    };
    let report = bricking::verify(&store, LIMIT, &Bar::default())?;
    let path = store.path().display();
    for fault in &report.faults {
        writeln!(out, "{path}: {fault}")?;
    }
    let hidden = report.fault_count - report.faults.len() as u64;
    if hidden > 0 {
        writeln!(out, "{path}: … and {hidden} more")?;
    }
    if report.fault_count > 0 {
        writeln!(
            out,
            "{path}: {} problems; restore the file from a copy or brick the source again",
            report.fault_count
        )?;
        return Ok(ExitCode::from(1));
    }
    writeln!(
        out,
        "{path}: sound: {} bricks of {} levels, {} bytes",
        report.bricks,
        store.levels(),
        store.file_len()
    )?;
    Ok(ExitCode::SUCCESS)
}
