//! `render`: one picture.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};

use crate::cli::picture::PictureArgs;
use crate::engine::{Engine, Picture};
use crate::export::{write_depth_png, write_exr, write_png};
use crate::outfile::{Existing, OutFile, find_same, write_whole};
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
    /// The picture to write (.png, or .exr: the composited values as 32-bit floats)
    #[arg(short, long, value_name = "PICTURE.(png|exr)")]
    output: PathBuf,
    /// Write how far the first thing lies that each ray meets: .exr (channel Z, mm along the ray) or 16-bit .png
    #[arg(long, value_name = "FILE.(exr|png)", help_heading = "Picture")]
    depth: Option<PathBuf>,
    /// The same of what ends the ray: an opaque mesh, surface or cut face, or where its opacity reaches --opacity-cutoff
    #[arg(long, value_name = "FILE.(exr|png)", help_heading = "Picture")]
    depth_opaque: Option<PathBuf>,
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
    let depths = [&args.depth, &args.depth_opaque];
    for path in std::iter::once(&args.output).chain(depths.into_iter().flatten()) {
        format_of(path)?;
    }
    let others = depths.into_iter().chain([&args.stats]).flatten();
    let files = std::iter::once(&args.output).chain(others);
    let files: Vec<&Path> = files.map(PathBuf::as_path).collect();
    if let Some([a, b]) = find_same(&files) {
        bail!(
            "{} and {} are one file, and two things would be written to it; give each its own name",
            a.display(),
            b.display()
        );
    }
    // Before minutes of work: can the files be written at all?
    for path in files {
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
    let mut settings = args.picture.settings(engine.meta(), &mut notes)?;
    settings.depths = depths.iter().any(|d| d.is_some());
    let picture = engine.render(&settings)?;
    notes.extend(picture.notes.iter().cloned());
    for note in notes {
        // Standard error is gone: nobody to tell, but the picture is wanted all the same.
        let _ = writeln!(io::stderr(), "brickscope: {note}");
    }
    write_picture(&args.output, &picture, args.picture.background())?;
    for (which, path) in depths.into_iter().enumerate() {
        if let Some(path) = path {
            write_depths(path, &picture, which)?;
        }
    }
    if let Some(path) = &args.stats {
        let json =
            serde_json::to_string_pretty(&picture.stats).context("writing the statistics")?;
        write_whole(path, Existing::Replace, format!("{json}\n").as_bytes())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// A format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Png,
    Exr,
}

/// What the name of a file says.
fn format_of(path: &Path) -> anyhow::Result<Format> {
    let extension = path.extension().and_then(|e| e.to_str());
    match extension.unwrap_or_default().to_lowercase().as_str() {
        "png" => Ok(Format::Png),
        "exr" => Ok(Format::Exr),
        _ => bail!(
            "{}: pictures are written as .png or .exr; give one of these endings",
            path.display()
        ),
    }
}

/// Writes the depths of number `which` (first met, ended).
fn write_depths(path: &Path, picture: &Picture, which: usize) -> anyhow::Result<()> {
    let image = &picture.image;
    let depths = image.depths.iter().flatten().map(|d| d[which]);
    let depths: Vec<f32> = depths.collect();
    let size = [image.width, image.height];
    match format_of(path)? {
        Format::Png => write_depth_png(path, size, &depths, Existing::Replace)?,
        Format::Exr => write_exr(path, size, vec![("Z", depths)], Existing::Replace)?,
    }
    Ok(())
}

/// Writes `picture` over `background`.
pub(super) fn write_picture(
    path: &Path,
    picture: &Picture,
    background: Background,
) -> anyhow::Result<()> {
    let image = &picture.image;
    if format_of(path)? == Format::Exr {
        let over = image.over(background);
        let channel = |n: usize| over.iter().map(|p| p[n]).collect::<Vec<f32>>();
        let names = ["R", "G", "B", "A"];
        let has_alpha = background == Background::Transparent;
        let channels = names[..if has_alpha { 4 } else { 3 }].iter();
        let channels = channels.enumerate().map(|(n, &name)| (name, channel(n)));
        let size = [image.width, image.height];
        write_exr(path, size, channels.collect(), Existing::Replace)?;
        return Ok(());
    }
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
