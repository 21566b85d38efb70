//! `path`: the centre-line through a hollow organ, as a camera path.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

use glam::DVec3;
use serde_json::{Value, json};

use super::progress::Bar;
use crate::bricking::Progress;
use crate::camera::{CameraPath, FLIGHT_FOV_Y_DEGREES, FLIGHT_SECONDS, Flight};
use crate::cli::args::{self, ByteSize};
use crate::geom::Lod;
use crate::outfile::{Existing, OutFile, write_whole};
use crate::path::{Centerline, CenterlineRequest, Destination, centerline};
use crate::store::Store;

/// Find the way through a hollow organ and write it as a camera path
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope path chest.bsk --from 13.5,-118.5,-411.8 --to -26.2,-190.4,-549.8 --lumen -1024,-900 -o airway.json\n  \
    brickscope path colon.bsk --from 10,-60,-300 --to farthest --lumen -1024,-800 -o colon.json --speed 20")]
pub struct Args {
    /// The store
    #[arg(value_name = "STORE")]
    store: PathBuf,

    /// A point of the lumen where the way begins, world millimetres (RAS+)
    #[arg(long, value_name = "x,y,z", value_parser = args::vec3)]
    from: DVec3,

    /// Where it leads: a point of the lumen, or the farthest one
    #[arg(long, value_name = "x,y,z|farthest")]
    to: To,

    /// Physical values of the lumen, both included
    #[arg(long, value_name = "LOW,HIGH", value_parser = args::pair)]
    lumen: [f64; 2],

    /// The path to write (.json); an existing one is replaced
    #[arg(short, long, value_name = "PATH.json")]
    output: PathBuf,

    /// Bound of the working memory; what does not fit is looked for on a coarser level first
    #[arg(long, value_name = "SIZE", default_value = "1GiB")]
    memory: ByteSize,

    /// How long the flight takes [default: 10]
    #[arg(long, value_name = "S", value_parser = args::positive, conflicts_with = "speed")]
    seconds: Option<f64>,

    /// Its speed, instead
    #[arg(long, value_name = "MM_PER_S", value_parser = args::positive)]
    speed: Option<f64>,

    /// Vertical field of view of the camera, degrees
    #[arg(long, value_name = "DEGREES", value_parser = args::positive, default_value_t = FLIGHT_FOV_Y_DEGREES)]
    fov: f64,

    /// Print one JSON object instead of lines
    #[arg(long)]
    json: bool,
}

/// `x,y,z` or `farthest`.
#[derive(Clone, Copy, Debug)]
struct To(Destination);

impl FromStr for To {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        if s == "farthest" {
            return Ok(Self(Destination::Farthest));
        }
        args::vec3(s)
            .map(|at| Self(Destination::At(at)))
            .map_err(|e| format!("{e}, or farthest"))
    }
}

/// Finds the way, writes the path, and says how long and wide it is.
///
/// # Errors
/// The store is refused, there is no such way, or the file can't be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    // Before the work: can the file be written at all?
    drop(OutFile::create(&args.output, Existing::Replace)?);
    let store = Store::open(&args.store)?;
    let [low, high] = args.lumen;
    let request = CenterlineRequest {
        from: args.from,
        to: args.to.0,
        low,
        high,
        memory_bytes: args.memory.0,
    };
    let bar = Bar::default();
    bar.begin_unmeasured("finding the way");
    let line = centerline(&store, &request);
    bar.end();
    let line = line?;
    let seconds = match args.speed {
        Some(speed) => line.length_mm() / speed,
        None => args.seconds.unwrap_or(FLIGHT_SECONDS),
    };
    let path = line.flight(&Flight {
        seconds,
        fov_y_degrees: args.fov,
    })?;
    for note in notes(&line) {
        // Standard error is gone: nobody to tell, but the path is wanted all the same.
        let _ = writeln!(io::stderr(), "brickscope: {note}");
    }
    write_whole(&args.output, Existing::Replace, path.to_json().as_bytes())?;
    report(args, &line, &path)?;
    Ok(ExitCode::SUCCESS)
}

fn notes(line: &Centerline) -> Vec<String> {
    let mut notes = Vec::new();
    if line.first_lod > Lod(0) {
        notes.push(format!(
            "the whole lumen does not fit --memory: looked for on {}, followed on {}",
            line.first_lod, line.lod
        ));
    }
    if line.inside_share < 1.0 {
        notes.push(format!(
            "warning: {:.2} % of the way lies beside the lumen, which is hardly wider than a voxel there",
            (1.0 - line.inside_share) * 100.0
        ));
    }
    notes
}

fn report(args: &Args, line: &Centerline, path: &CameraPath) -> anyhow::Result<()> {
    let radii = || line.points.iter().map(|p| p.radius_mm);
    let mean = radii().sum::<f64>() / line.points.len() as f64;
    let end = |key: usize| path.keys()[key].eye.to_array();
    let last = path.keys().len() - 1;
    let figures: [(&str, Value); 13] = [
        ("path", json!(args.output.to_string_lossy())),
        ("length_mm", json!(path.length_mm())),
        ("points", json!(path.keys().len())),
        ("from", json!(end(0))),
        ("to", json!(end(last))),
        ("mean_radius_mm", json!(mean)),
        (
            "min_radius_mm",
            json!(radii().fold(f64::INFINITY, f64::min)),
        ),
        ("max_radius_mm", json!(radii().fold(0.0, f64::max))),
        ("inside_share", json!(line.inside_share)),
        ("level", json!(line.lod.0)),
        ("lumen_voxels", json!(line.lumen_voxels)),
        ("seconds", json!(path.duration())),
        ("mm_per_s", json!(path.length_mm() / path.duration())),
    ];
    let mut out = io::stdout().lock();
    if args.json {
        let object: serde_json::Map<String, Value> = figures
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value))
            .collect();
        writeln!(out, "{}", Value::Object(object))?;
        return Ok(());
    }
    for (name, value) in figures {
        let value = match value {
            Value::String(text) => text,
            value => value.to_string(),
        };
        writeln!(out, "{:<16}{value}", format!("{name}:"))?;
    }
    Ok(())
}
