//! `bench`: repeatable figures. Arguments and calls; what is measured lives in `crate::bench`.

mod brick;
mod classify;
mod output;
mod page;
mod render;
mod seeds;

use std::process::ExitCode;

use anyhow::bail;
use clap::Subcommand;

use crate::cli::picture::PictureArgs;
use crate::engine::Engine;

/// Measure what pictures, stores, paging and edits cost
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope bench render chest.bsk --modes dvr,iso,mip --iso 300 --size 512x512 --step 1\n  \
    brickscope bench brick phantom:body:512,512,512:u16 --zstd 1,3\n  \
    brickscope bench page chest.bsk --gpu-memory 64MiB\n  \
    brickscope bench classify chest.bsk --size 512x512\n  \
    brickscope bench seeds foot.bsk engine.bsk --iso foot=600")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Render(Box<render::Args>),
    Brick(brick::Args),
    Page(Box<page::Args>),
    Classify(Box<classify::Args>),
    Seeds(Box<seeds::Args>),
}

/// Measures, and prints a table or JSON lines.
///
/// # Errors
/// An input is refused, a flag makes no sense here, or a report can't be read or written.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    match args.what {
        What::Render(args) => render::run(&args),
        What::Brick(args) => brick::run(&args),
        What::Page(args) => page::run(&args),
        What::Classify(args) => classify::run(&args),
        What::Seeds(args) => seeds::run(&args),
    }
}

/// The turn has cameras of its own.
fn refuse_camera(picture: &PictureArgs, what: &str) -> anyhow::Result<()> {
    if let Some(flag) = picture.camera_flag() {
        bail!(
            "{flag}: bench {what} has cameras of its own, a full turn about the volume at perspective 30°; leave the \
             flag out, or use 'brickscope render' for one picture"
        );
    }
    Ok(())
}

/// Tells why the CPU draws, if it does and nobody asked for it.
fn note_fallback(engine: &Engine) {
    if let Some(why) = engine.fallback() {
        output::note(&format!("drawing on the CPU: {why}"));
    }
}
