//! `presets`: the names that `--tf` knows, and any transfer function as a ParaView preset.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::json;

use crate::classify::{Preset, PresetScale, TransferFunction, beyond_paraview, to_paraview};
use crate::cli::args;
use crate::cli::transfer::{Named, window_ends};
use crate::outfile::{self, Existing};

/// List the built-in transfer functions, or write one, or those of a file, as ParaView JSON.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope presets\n  \
    brickscope presets --json\n  \
    brickscope presets --tf ct-bone -o bone.json\n  \
    brickscope presets --tf viridis --window 40,400 -o viridis.json\n  \
    brickscope presets --tf slicer-presets.xml -o all.json")]
pub struct Args {
    /// Print one JSON object instead of lines
    #[arg(long, conflicts_with = "tf")]
    json: bool,

    /// Write this one to -o: a name of the list, or a file of ParaView (.json, .xml), 3D Slicer (.vp.json, .vp, presets .xml)
    /// or ImageJ (.lut), of which all are written
    #[arg(long, value_name = "NAME|FILE", requires = "output")]
    tf: Option<String>,

    /// The file to write
    #[arg(short, long, value_name = "OUT.json", requires = "tf")]
    output: Option<PathBuf>,

    /// Range over which a relative preset or an ImageJ table is laid, physical [default: 0 to 1]
    #[arg(long, value_name = "CENTER,WIDTH", value_parser = args::pair, requires = "tf")]
    window: Option<[f64; 2]>,

    /// Replace OUT.json if it exists
    #[arg(long, requires = "output")]
    force: bool,
}

/// Prints one preset per line, name first, or all as JSON; or writes a file and says what it holds.
///
/// # Errors
/// Standard output can't be written, `--tf` names nothing that can be read, or the output exists or can't be written.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let mut out = io::stdout().lock();
    if let (Some(name), Some(output)) = (&args.tf, &args.output) {
        let (functions, is_relative) = functions(name, args.window)?;
        let existing = if args.force {
            Existing::Replace
        } else {
            Existing::Refuse
        };
        outfile::write_whole(output, existing, to_paraview(&functions).as_bytes())?;
        let place = output.display();
        if is_relative && args.window.is_none() {
            note(&format!(
                "{place}: x runs from 0 to 1, which ParaView stretches over data; --window lays it over physical values"
            ));
        }
        if let Some(lost) = lost(&functions) {
            note(&format!(
                "{place}: ParaView's JSON has no place for {lost}; left out"
            ));
        }
        let names: Vec<_> = functions.iter().map(|f| f.name.as_str()).collect();
        writeln!(out, "{place}: {}", names.join(", "))?;
    } else if args.json {
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

fn note(text: &str) {
    // Nothing can be done about a closed standard error.
    let _ = writeln!(io::stderr(), "brickscope: {text}");
}

/// What `name` names, over the window; and does the window matter?
fn functions(
    name: &str,
    window: Option<[f64; 2]>,
) -> anyhow::Result<(Vec<TransferFunction>, bool)> {
    let range = window.map_or(Ok([0.0, 1.0]), window_ends)?;
    // Where opacity is a line, it goes up to 1, as that of ParaView's own maps.
    let top = 1.0;
    Ok(match Named::find(name)? {
        Named::Preset(preset) => (
            vec![preset.instantiate(range, top)?],
            preset.scale == PresetScale::Relative,
        ),
        Named::File(functions) => {
            let is_relative = functions.iter().any(|f| f.relative);
            let placed = functions.into_iter().map(|f| f.placed(range, top));
            (placed.collect::<Result<_, _>>()?, is_relative)
        }
    })
}

/// What of the functions is not in ParaView's JSON, and of how many of them.
fn lost(functions: &[TransferFunction]) -> Option<String> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for what in functions.iter().flat_map(beyond_paraview) {
        match counts.iter_mut().find(|(name, _)| *name == what) {
            Some((_, count)) => *count += 1,
            None => counts.push((what, 1)),
        }
    }
    let words: Vec<String> = counts
        .into_iter()
        .map(|(what, count)| match functions.len() {
            1 => what.to_owned(),
            all => format!("{what} ({count} of {all})"),
        })
        .collect();
    (!words.is_empty()).then(|| words.join(", "))
}
