//! `bench`: repeatable figures. Arguments and calls; what is measured lives in `crate::bench`.

mod output;
mod render;

use std::process::ExitCode;

use clap::Subcommand;

/// Measure what pictures cost
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope bench render chest.bsk --modes dvr,iso,mip --iso 300 --size 512x512 --step 1\n  \
    brickscope bench render chest.bsk --mode mip --frames 12 --json")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Render(Box<render::Args>),
}

/// Measures, and prints a table or JSON lines.
///
/// # Errors
/// An input is refused, a flag makes no sense here, or a report can't be read or written.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    match args.what {
        What::Render(args) => render::run(&args),
    }
}
