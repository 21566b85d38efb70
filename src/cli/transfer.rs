//! What was typed about colour and opacity, and the transfer function that it means.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::args;
use crate::classify::{Preset, TransferFunction, grey_ramp, read_transfer_functions, window_range};
use crate::scene::{Mode, default_window};
use crate::store::StoreMeta;

/// From values to colour and opacity, as typed.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TransferArgs {
    /// Transfer function: a name of 'brickscope presets', or a file of ParaView (.json, .xml), 3D Slicer (.vp.json, .vp,
    /// presets .xml) or ImageJ (.lut)
    #[arg(long, value_name = "NAME|FILE", help_heading = "Classification")]
    tf: Option<String>,
    /// Grey ramp, or the range of a relative preset or an ImageJ table, physical
    #[arg(long, value_name = "CENTER,WIDTH", value_parser = args::pair, help_heading = "Classification")]
    window: Option<[f64; 2]>,
    /// Length for which the opacity holds [default: as the file of --tf says, else the smallest spacing]
    #[arg(long, value_name = "MM", value_parser = args::positive, help_heading = "Classification")]
    opacity_unit: Option<f64>,
}

impl TransferArgs {
    /// Length for which the opacity of `transfer` holds, mm.
    pub(super) fn opacity_unit_mm(&self, transfer: &TransferFunction) -> Option<f64> {
        self.opacity_unit.or(transfer.opacity_unit_mm)
    }

    /// The function that is meant, for the volume of `meta` in a mode. Remarks for the user go into `notes`.
    ///
    /// # Errors
    /// A file can't be read, or a name is unknown.
    pub(super) fn function(
        &self,
        mode: Mode,
        meta: &StoreMeta,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<TransferFunction> {
        let range = match self.window {
            Some(window) => window_ends(window)?,
            None => default_window(meta),
        };
        // Mode xray knows but the place in a window: the one that was typed, or else the function's.
        if mode == Mode::Xray && self.window.is_some() {
            return Ok(grey_ramp(range[0], range[1], 1.0)?);
        }
        // cli.md, "Colour": a ramp is half opaque at its end, except where the look-up is a projection's only one.
        let top_opacity = if mode.classifies_whole_range() {
            1.0
        } else {
            0.5
        };
        let Some(name) = &self.tf else {
            return Ok(grey_ramp(range[0], range[1], top_opacity)?);
        };
        let function = match Named::find(name)? {
            Named::Preset(preset) => preset.instantiate(range, top_opacity),
            Named::File(mut functions) => {
                if functions.len() > 1 {
                    notes.push(format!(
                        "{name} holds {} transfer functions; using the first, '{}'",
                        functions.len(),
                        functions[0].name
                    ));
                }
                functions.swap_remove(0).placed(range, top_opacity)
            }
        };
        function.with_context(|| format!("--tf {name}"))
    }
}

// NOT DRAWN YET: gradient opacity. Whoever draws it takes this function and its calls away.
/// A note about what the function has that no picture shows.
pub(super) fn not_drawn(transfer: &TransferFunction) -> Option<String> {
    let what = "has gradient opacity, which is not drawn yet";
    let is_there = transfer.gradient_opacity.is_some();
    is_there.then(|| format!("{} {what}", title(transfer)))
}

/// What to call it in a note.
pub(super) fn title(transfer: &TransferFunction) -> &str {
    match transfer.name.as_str() {
        "" => "the transfer function",
        name => name,
    }
}

/// What `--tf` names.
pub(super) enum Named {
    /// One of those that come with the program.
    Preset(&'static Preset),
    /// The functions of a file, at least one.
    File(Vec<TransferFunction>),
}

impl Named {
    /// The preset of this name, or what the file of this name holds.
    ///
    /// # Errors
    /// There is neither, or the file can't be read.
    pub(super) fn find(name: &str) -> anyhow::Result<Self> {
        if let Some(preset) = Preset::find(name) {
            return Ok(Self::Preset(preset));
        }
        let path = PathBuf::from(name);
        if !is_like_a_file(name) && !path.exists() {
            bail!(
                "--tf {name}: no such preset or file; presets are {}",
                Preset::names()
            );
        }
        Ok(Self::File(read_transfer_functions(&path)?))
    }
}

/// Does it end like a file of transfer functions? Then it is one that is missing, not a misspelt preset.
fn is_like_a_file(name: &str) -> bool {
    let extension = Path::new(name).extension();
    let known = ["json", "xml", "mrml", "vp", "lut"];
    extension.is_some_and(|e| known.iter().any(|k| e.eq_ignore_ascii_case(k)))
}

/// The ends of what was typed as `--window`.
///
/// # Errors
/// Its width is not above 0.
pub(super) fn window_ends([center, width]: [f64; 2]) -> anyhow::Result<[f64; 2]> {
    window_range(center, width).with_context(|| {
        format!("--window {center},{width}: expected a centre and a width above 0")
    })
}
