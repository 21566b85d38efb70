//! `fly`: pictures along a path, as a folder of PNGs or a film.

mod film;
mod job;
mod realtime;
mod report;
mod schedule;
mod whole;

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context;

use super::progress::Bar;
use crate::bricking::Progress;
use crate::camera::{Camera, CameraPath};
use crate::cli::args;
use crate::cli::config::{LookArgs, Switch};
use crate::engine::Engine;
use crate::export::video::FrameRate;
use crate::outfile::{Existing, write_whole};
use crate::scene::PictureSettings;
use crate::store::Store;

/// Fly along a path and write the pictures.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Every frame is complete, unless --realtime is given. A folder of frames that was begun and is given again is gone \
    on with. MP4 needs ffmpeg on PATH, or a build with --features h264; it can't be gone on with: for long films draw a folder first.\n\n\
    Examples:\n  \
    brickscope fly colon.bsk --path colon.json -o frames --mode iso --iso=-700 --size 1280x720\n  \
    brickscope fly colon.bsk --path colon.json -o colon.mp4 --seconds 20 --tf ct-lung\n  \
    brickscope fly huge.bsk --path tour.json -o tour --realtime --fps 15 --gpu-memory 512MiB --json"
)]
pub struct Args {
    /// The brick store
    #[arg(value_name = "STORE")]
    store: PathBuf,
    /// The path: key frames {t, eye, target, up, fov}
    #[arg(long, value_name = "PATH.json")]
    path: PathBuf,
    /// The film (.mp4), or the folder for frame-00000.png and so on, which is made if it is not there
    #[arg(short, long, value_name = "OUT.mp4|FOLDER")]
    output: PathBuf,
    /// Frames per second
    #[arg(long, value_name = "N", default_value = "30")]
    fps: FrameRate,
    /// How long the flight takes [default: as long as the path]
    #[arg(long, value_name = "S", value_parser = args::positive)]
    seconds: Option<f64>,
    /// Keep the frame rate instead of waiting for complete frames: coarser bricks stand in for missing ones, frames that come
    /// too late are left out (the one before is written again), and both are counted
    #[arg(long)]
    realtime: bool,
    /// With --realtime: load ahead what the path will need
    #[arg(long, value_enum, default_value = "on", requires = "realtime")]
    prefetch: Switch,
    /// Replace a film, or frames of another flight
    #[arg(long)]
    force: bool,
    /// Print one JSON object instead of a line
    #[arg(long)]
    json: bool,
    /// Write what the flight and each of its frames took to this file
    #[arg(long, value_name = "FILE.json", help_heading = "Machine")]
    stats: Option<PathBuf>,
    #[command(flatten)]
    look: LookArgs,
}

/// What is flown: all that both ways of drawing need.
struct Flight {
    path: CameraPath,
    settings: PictureSettings,
    rate: FrameRate,
    frames: u64,
}

impl Flight {
    /// The picture at `seconds` of the flight.
    fn at(&self, look: &LookArgs, seconds: f64) -> anyhow::Result<PictureSettings> {
        let camera = look.aimed(self.path.camera_at(self.path.start() + seconds))?;
        Ok(PictureSettings {
            camera,
            ..self.settings.clone()
        })
    }

    /// The picture of frame `number`.
    fn frame(&self, look: &LookArgs, number: u64) -> anyhow::Result<PictureSettings> {
        self.at(look, self.rate.seconds_of(number))
    }
}

/// Draws and writes all frames, then the statistics.
///
/// # Errors
/// Store or path are refused, the flags make no picture, the output holds another flight, the device fails, or a file can't
/// be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    film::check_stats(args)?;
    let path = CameraPath::read(&args.path)?;
    let path = match args.seconds {
        Some(seconds) => path
            .with_duration(seconds)
            .with_context(|| format!("{} with --seconds {seconds}", args.path.display()))?,
        None => path,
    };
    // A path of one key takes no time of its own.
    let seconds = args.seconds.unwrap_or_else(|| path.duration());
    let frames = job::frame_count(args.fps, seconds)?;
    let store = Arc::new(Store::open(&args.store)?);
    // As `render`: a flight may need none of a damaged level; it is refused all the same.
    store.check_all_levels()?;
    let mut engine = Engine::with_store(store, args.look.engine_options())?;
    let mut notes = Vec::new();
    notes.extend(
        engine
            .fallback()
            .map(|why| format!("drawing on the CPU: {why}")),
    );
    notes.extend(engine.advice());
    let settings = args
        .look
        .settings(engine.meta(), path.camera_at(path.start()), &mut notes)?;
    let flight = Flight {
        path,
        settings,
        rate: args.fps,
        frames,
    };
    // What makes no picture is told before the first one is drawn, and before earlier ones are removed.
    let cameras: Vec<Camera> = (0..frames)
        .map(|number| flight.frame(&args.look, number).map(|s| s.camera))
        .collect::<anyhow::Result<_>>()?;
    engine.check(&flight.settings, cameras)?;
    if args.realtime {
        notes.extend(realtime::notes(args, &flight, &engine));
    }
    let film = film::begin(args, &flight, &engine)?;
    for note in &notes {
        tell(note);
    }
    let bar = Bar::default();
    bar.begin_frames("fly", frames);
    let encoder = film.encoder;
    let report = if args.realtime {
        realtime::fly(args, &flight, &mut engine, film, &bar)
    } else {
        whole::fly(args, &flight, &mut engine, film, &bar)
    };
    bar.end();
    let report = report?.of(args, &flight, &engine, encoder);
    if let Some(path) = &args.stats {
        let json = serde_json::to_string_pretty(&report)?;
        write_whole(path, Existing::Replace, format!("{json}\n").as_bytes())?;
    }
    let mut out = io::stdout().lock();
    if args.json {
        writeln!(out, "{}", serde_json::to_string(&report.without_frames())?)?;
    } else {
        writeln!(out, "{report}")?;
    }
    Ok(ExitCode::SUCCESS)
}

/// A remark for the user.
fn tell(note: &str) {
    // Standard error is gone: nobody to tell, but the frames are wanted all the same.
    let _ = writeln!(io::stderr(), "brickscope: {note}");
}
