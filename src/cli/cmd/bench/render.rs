//! `bench render`: what a frame costs.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::bail;

use crate::bench::{RenderJob, RenderRow, WarmUp};
use crate::cli::args;
use crate::cli::config::{ModeArg, PictureArgs};
use crate::engine::Engine;
use crate::store::Store;

/// What a frame costs, over a full turn about the volume
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope bench render chest.bsk --modes dvr,iso,mip --iso 300 --size 512x512 --step 1\n  \
    brickscope bench render chest.bsk --mode mip --frames 12 --json")]
pub struct Args {
    /// The brick stores
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,
    /// Frames of the full turn, all timed
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// One JSON line per configuration instead of a table
    #[arg(long)]
    json: bool,
    /// Several modes, separated by commas
    #[arg(
        long,
        value_enum,
        value_name = "MODE,…",
        value_delimiter = ',',
        conflicts_with = "mode"
    )]
    modes: Vec<ModeArg>,
    /// Several picture sizes, separated by commas
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = args::picture_size, conflicts_with = "size")]
    sizes: Vec<[u32; 2]>,
    /// Several steps, separated by commas
    #[arg(long, value_name = "VOXELS,…", value_delimiter = ',', value_parser = args::positive, conflicts_with = "step")]
    steps: Vec<f64>,
    /// What is drawn before the clock starts
    #[arg(long, value_enum, default_value = "frame")]
    warm_up: WarmUpArg,
    /// Measure the first whole picture, from the start of the process, before anything else
    #[arg(long)]
    whole: bool,
    #[command(flatten)]
    picture: PictureArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum WarmUpArg {
    /// The first frame
    Frame,
    /// The whole turn
    Turn,
}

/// Measures all configurations of all stores.
///
/// # Errors
/// A store is refused, the flags make no picture, the device fails, or a report can't be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(flag) = args.picture.camera_flag() {
        bail!(
            "{flag}: bench render has a camera of its own, a full turn about the volume at perspective 30°; \
             leave the flag out, or use 'brickscope render' for one picture"
        );
    }
    let mut rows: Vec<RenderRow> = Vec::new();
    for path in &args.stores {
        let store = Arc::new(Store::open(path)?);
        store.check_all_levels()?;
        let mut engine = Engine::with_store(store, args.picture.engine_options())?;
        let mut notes: Vec<String> = engine
            .fallback()
            .map(|why| format!("drawing on the CPU: {why}"))
            .into_iter()
            .collect();
        for picture in args.picture.variants(&args.modes, &args.sizes, &args.steps) {
            let job = RenderJob {
                vol: path
                    .file_stem()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned(),
                settings: picture.settings(engine.meta(), &mut notes)?,
                frames: args.frames,
                warm_up: match args.warm_up {
                    WarmUpArg::Frame => WarmUp::Frame,
                    WarmUpArg::Turn => WarmUp::Turn,
                },
                is_first: rows.is_empty(),
                whole: args.whole && rows.is_empty(),
            };
            for note in notes.drain(..) {
                // Standard error is gone: nobody to tell, but the figures are wanted all the same.
                let _ = writeln!(io::stderr(), "brickscope: {note}");
            }
            let row = job.measure(&mut engine)?;
            writeln!(io::stdout(), "{}", serde_json::to_string(&row)?)?;
            rows.push(row);
        }
    }
    Ok(ExitCode::SUCCESS)
}
