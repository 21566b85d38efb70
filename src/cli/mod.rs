//! The command line of cli.md: what is typed becomes a resolved configuration, and each command calls one part of the
//! library. No algorithms here.
//!
//! Results go to standard output, diagnostics to standard error. Exit codes: 0 done, 1 a check said no, 2 bad usage,
//! bad input or I/O. A broken pipe exits 0.

pub mod args;
mod cmd;
mod config;
mod geometry;
mod picture;
mod transfer;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// A renderer for volumes larger than GPU memory.
#[derive(Debug, Parser)]
#[command(
    name = "brickscope",
    version,
    about,
    max_term_width = 110,
    disable_help_subcommand = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Brick(cmd::brick::Args),
    Info(cmd::info::Args),
    Verify(cmd::verify::Args),
    Extract(cmd::extract::Args),
    Path(cmd::path::Args),
    Presets(cmd::presets::Args),
    Render(Box<cmd::render::Args>),
    Fly(Box<cmd::fly::Args>),
    Demo(cmd::demo::Args),
    Bench(cmd::bench::Args),
}

/// Parses `argv` (with the program's name), runs the command, reports errors, and returns the exit code.
pub fn main<I: IntoIterator<Item = OsString>>(argv: I) -> ExitCode {
    crate::clock::mark_main();
    tracing_subscriber::fmt()
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("BRICKSCOPE_LOG").unwrap_or_else(|_| {
                tracing_subscriber::EnvFilter::new("error,wgpu_hal::vulkan::instance=off")
            }),
        )
        .with_writer(io::stderr)
        .init();
    // Failing to install the handler only means that Ctrl-C leaves a temporary file behind.
    let _ = ctrlc::set_handler(|| {
        crate::outfile::remove_unfinished();
        std::process::exit(130);
    });
    let cli = match parse(argv) {
        Ok(cli) => cli,
        Err(error) => {
            // Clap prints help to stdout (exit 0) and usage errors to stderr (exit 2).
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    let result: anyhow::Result<ExitCode> = match cli.command {
        Command::Brick(args) => cmd::brick::run(args),
        Command::Info(args) => cmd::info::run(args),
        Command::Verify(args) => cmd::verify::run(args),
        Command::Extract(args) => cmd::extract::run(&args),
        Command::Path(args) => cmd::path::run(&args),
        Command::Presets(args) => cmd::presets::run(args),
        Command::Render(args) => cmd::render::run(&args),
        Command::Fly(args) => cmd::fly::run(&args),
        Command::Demo(args) => cmd::demo::run(&args),
        Command::Bench(args) => cmd::bench::run(args),
    };
    match result.and_then(|code| io::stdout().flush().map(|()| code).map_err(Into::into)) {
        Ok(code) => code,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "brickscope: error: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// What was typed. Values that begin with a minus are values (cli.md).
fn parse<I: IntoIterator<Item = OsString>>(argv: I) -> Result<Cli, clap::Error> {
    let mut command = with_minus_values(Cli::command());
    let matches = command.try_get_matches_from_mut(argv)?;
    Cli::from_arg_matches(&matches).map_err(|e| e.format(&mut command))
}

fn with_minus_values(command: clap::Command) -> clap::Command {
    command
        .mut_args(|arg| {
            // Not where no flag stands before it: a misspelt flag would be taken for a store.
            let is_flag = arg.get_long().is_some() && arg.get_action().takes_values();
            arg.allow_hyphen_values(is_flag)
        })
        .mut_subcommands(with_minus_values)
}

/// True when the reader of our standard output went away: not an error (cli.md).
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|e| {
        e.downcast_ref::<io::Error>()
            .is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
    })
}
