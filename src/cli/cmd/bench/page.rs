//! `bench page`: how bricks come.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use super::output::{OutputArgs, note};
use super::{note_fallback, refuse_camera};
use crate::bench::{PageJob, StoreCeiling, vol_name};
use crate::cli::picture::PictureArgs;
use crate::engine::{Engine, EngineOptions};
use crate::store::Store;

/// How bricks come on a graphics device: latency, rate, hits over a full turn
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope bench page chest.bsk --size 512x512 --step 1 --gpu-memory 64MiB --ram 64MiB\n  \
    brickscope bench page chest.bsk --mode iso --iso 300 --frames 12 --json")]
pub struct Args {
    /// The brick store
    #[arg(value_name = "STORE")]
    store: PathBuf,
    /// Pictures of the full turn
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Leave out what the machine could do at most: codec, disk, memory
    #[arg(long)]
    no_ceiling: bool,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Measures paging of one store.
///
/// # Errors
/// The store is refused, the flags make no picture, there is no graphics device, or a report can't be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    refuse_camera(&args.picture, "page")?;
    let old = args.output.open()?;
    let store = Arc::new(Store::open(&args.store)?);
    store.check_all_levels()?;
    let options = EngineOptions {
        keep_waits: true,
        ..args.picture.engine_options()
    };
    let mut engine = Engine::with_store(Arc::clone(&store), options)?;
    let mut notes = Vec::new();
    let vol = vol_name(&args.store);
    let job = PageJob {
        vol: vol.clone(),
        settings: args.picture.settings(engine.meta(), &mut notes)?,
        frames: args.frames,
    };
    note_fallback(&engine);
    for text in &notes {
        note(text);
    }
    let mut rows = job.measure(&mut engine, &args.store)?;
    let ceiling = (!args.no_ceiling)
        .then(|| StoreCeiling::measure(&store))
        .transpose()?;
    for row in &mut rows {
        row.ceiling = ceiling;
    }
    let remarks: Vec<String> = ceiling.map(|c| c.remark(&vol)).into_iter().collect();
    args.output
        .finish(rows, old.as_ref(), &remarks, "bench page: ms")?;
    Ok(ExitCode::SUCCESS)
}
