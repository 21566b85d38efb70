//! `bench classify`: what an edit of the classification costs.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use super::output::{OutputArgs, note};
use super::{note_fallback, refuse_camera};
use crate::bench::{ClassifyJob, ClassifyRow, vol_name};
use crate::cli::args;
use crate::cli::picture::PictureArgs;
use crate::engine::Engine;
use crate::scene::{LodChoice, PictureSettings};
use crate::store::Store;

/// What an edit of the transfer function or of the iso-value costs
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Modes dvr and iso are measured, one after the other; --iso is the value before the edit.\n\n\
    Examples:\n  \
    brickscope bench classify chest.bsk --size 512x512 --step 1\n  \
    brickscope bench classify chest.bsk engine.bsk --lods auto,0,1,2 --edits 4 --json"
)]
pub struct Args {
    /// The brick stores
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,
    /// Edits of each kind that are timed
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    edits: u32,
    /// Several levels of detail, separated by commas: more or fewer blocks
    #[arg(long, value_name = "auto|N,…", value_delimiter = ',', value_parser = args::lod, conflicts_with = "lod")]
    lods: Vec<LodChoice>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Measures edits on every store at every level of detail.
///
/// # Errors
/// A store is refused, the flags make no picture, the device fails, or a report can't be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    refuse_camera(&args.picture, "classify")?;
    let old = args.output.open()?;
    let mut rows: Vec<ClassifyRow> = Vec::new();
    for path in &args.stores {
        let store = Arc::new(Store::open(path)?);
        store.check_all_levels()?;
        let mut engine = Engine::with_store(store, args.picture.engine_options())?;
        let mut notes = Vec::new();
        let settings = args.picture.settings(engine.meta(), &mut notes)?;
        note_fallback(&engine);
        for text in &notes {
            note(text);
        }
        let typed = [settings.lod];
        let lods = if args.lods.is_empty() {
            &typed[..]
        } else {
            &args.lods
        };
        for &lod in lods {
            let job = ClassifyJob {
                vol: vol_name(path),
                settings: PictureSettings {
                    lod,
                    ..settings.clone()
                },
                edits: args.edits,
            };
            rows.extend(job.measure(&mut engine)?);
        }
    }
    args.output
        .finish(rows, old.as_ref(), &[], "bench classify: ms per edit")?;
    Ok(ExitCode::SUCCESS)
}
