//! `presets`: the names that `--tf` knows.

use std::io::{self, Write};
use std::process::ExitCode;

use serde_json::json;

use crate::classify::{Preset, PresetScale};

/// List the built-in transfer functions.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  brickscope presets\n  brickscope presets --json")]
pub struct Args {
    /// Print one JSON object instead of lines
    #[arg(long)]
    json: bool,
}

/// Prints one preset per line, name first, or all as JSON.
///
/// # Errors
/// Standard output can't be written.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let mut out = io::stdout().lock();
    if args.json {
        let presets: Vec<_> = Preset::ALL
            .iter()
            .map(|p| {
                json!({
                    "name": p.name,
                    "description": p.description,
                    "scale": match p.scale {
                        PresetScale::Hounsfield => "HU",
                        PresetScale::Relative => "relative",
                    },
                    "licence": p.licence,
                })
            })
            .collect();
        writeln!(out, "{}", json!({ "presets": presets }))?;
    } else {
        let width = Preset::ALL.iter().map(|p| p.name.len()).max().unwrap_or(0);
        for preset in Preset::ALL {
            writeln!(out, "{:width$}  {}", preset.name, preset.description)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
