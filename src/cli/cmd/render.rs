//! `render`: one picture.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};

use crate::cli::picture::PictureArgs;
use crate::engine::{Engine, Picture};
use crate::export::write_png;
use crate::outfile::{Existing, OutFile, write_whole};
use crate::scene::Background;
use crate::store::Store;

/// Render one picture of a brick store.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope render chest.bsk -o chest.png --mode iso --iso 300 --orbit 30,10\n  \
    brickscope render chest.bsk -o lung.png --tf ct-lung --shading phong --size 800x800\n  \
    brickscope render engine.bsk -o engine.png --mode mip --eye -300,-400,200 --fov 40")]
pub struct Args {
    /// The brick store
    #[arg(value_name = "STORE")]
    store: PathBuf,
    /// The picture to write (.png)
    #[arg(short, long, value_name = "PICTURE.png")]
    output: PathBuf,
    /// Write what the picture took to this file
    #[arg(long, value_name = "FILE.json", help_heading = "Machine")]
    stats: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Renders and writes the picture, then the statistics.
///
/// # Errors
/// The store is refused, the flags make no picture, the device fails, or a file can't be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let extension = args
        .output
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
        .to_lowercase();
    if extension != "png" {
        bail!(
            "{}: pictures are written as .png; other formats are not built yet",
            args.output.display()
        );
    }
    // Before minutes of work: can the files be written at all?
    for path in std::iter::once(&args.output).chain(&args.stats) {
        drop(OutFile::create(path, Existing::Replace)?);
    }
    let store = Arc::new(Store::open(&args.store)?);
    // A picture may need none of a damaged level; the command refuses it all the same.
    store.check_all_levels()?;
    let mut engine = Engine::with_store(store, args.picture.engine_options())?;
    let mut notes = Vec::new();
    notes.extend(
        engine
            .fallback()
            .map(|why| format!("drawing on the CPU: {why}")),
    );
    notes.extend(engine.advice());
    let settings = args.picture.settings(engine.meta(), &mut notes)?;
    let picture = engine.render(&settings)?;
    notes.extend(picture.notes.iter().cloned());
    for note in notes {
        // Standard error is gone: nobody to tell, but the picture is wanted all the same.
        let _ = writeln!(io::stderr(), "brickscope: {note}");
    }
    write_picture(&args.output, &picture, args.picture.background())?;
    if let Some(path) = &args.stats {
        let json =
            serde_json::to_string_pretty(&picture.stats).context("writing the statistics")?;
        write_whole(path, Existing::Replace, format!("{json}\n").as_bytes())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes `picture` over `background` as a PNG.
pub(super) fn write_picture(
    path: &Path,
    picture: &Picture,
    background: Background,
) -> anyhow::Result<()> {
    let image = &picture.image;
    let opaque = background != Background::Transparent;
    write_png(
        path,
        image.width,
        image.height,
        &image.to_rgba8(background),
        opaque,
        Existing::Replace,
    )?;
    Ok(())
}
