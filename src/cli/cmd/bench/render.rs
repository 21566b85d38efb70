//! `bench render`: what a frame costs.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use super::output::{OutputArgs, note};
use super::{note_fallback, refuse_camera};
use crate::bench::{RenderJob, RenderRow, StoreCeiling, WarmUp, vol_name};
use crate::cli::args;
use crate::cli::config::ModeArg;
use crate::cli::picture::PictureArgs;
use crate::engine::Engine;
use crate::store::Store;

/// What a frame costs, over a full turn about the volume
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope bench render chest.bsk --modes dvr,iso,mip --iso 300 --size 512x512 --step 1\n  \
    brickscope bench render chest.bsk --mode mip --frames 12 --json\n  \
    brickscope bench render chest.bsk engine.bsk --out new.json --compare old.json --svg new.svg")]
pub struct Args {
    /// The brick stores
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,
    /// Frames of the full turn, all timed
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
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
    /// Leave out what the machine could do at most: bare kernel, codec, disk, memory
    #[arg(long)]
    no_ceiling: bool,
    #[command(flatten)]
    output: OutputArgs,
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
    refuse_camera(&args.picture, "render")?;
    let old = args.output.open()?;
    let mut rows: Vec<RenderRow> = Vec::new();
    let mut remarks = Vec::new();
    for path in &args.stores {
        let store = Arc::new(Store::open(path)?);
        store.check_all_levels()?;
        let mut engine = Engine::with_store(Arc::clone(&store), args.picture.engine_options())?;
        note_fallback(&engine);
        let mut notes = Vec::new();
        let mut measured = Vec::new();
        for picture in args.picture.variants(&args.modes, &args.sizes, &args.steps) {
            let is_first = rows.is_empty() && measured.is_empty();
            let job = RenderJob {
                vol: vol_name(path),
                settings: picture.settings(engine.meta(), &mut notes)?,
                frames: args.frames,
                warm_up: match args.warm_up {
                    WarmUpArg::Frame => WarmUp::Frame,
                    WarmUpArg::Turn => WarmUp::Turn,
                },
                is_first,
                whole: args.whole && is_first,
            };
            for text in notes.drain(..) {
                note(&text);
            }
            let row = job.measure(&mut engine)?;
            measured.push((job, row));
        }
        // After all pictures of the store: the ceilings take memory and drop what is resident.
        let ceiling = (!args.no_ceiling)
            .then(|| StoreCeiling::measure(&store))
            .transpose()?;
        remarks.extend(ceiling.map(|c| c.remark(&vol_name(path))));
        for (job, mut row) in measured {
            row.ceiling = ceiling;
            if !args.no_ceiling {
                job.hold_against_bare(&mut engine, &mut row)?;
            }
            rows.push(row);
        }
    }
    args.output
        .finish(rows, old.as_ref(), &remarks, "bench render: ms per frame")?;
    Ok(ExitCode::SUCCESS)
}
