//! `brick`: a volume in, a brick store out.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use glam::{DVec3, U64Vec3};

use super::progress::Bar;
use crate::bricking::{self, BrickError, BrickOptions, BrickingReport, Progress};
use crate::cli::args::{self, ByteSize};
use crate::input::{self, Endian, OpenOptions, RawParams};
use crate::outfile::Existing;
use crate::volume::{StoredType, VoxelSource, VoxelType};

/// Turn a volume into a brick store
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope brick scan.nii.gz -o scan.bsk\n  \
    brickscope brick scan.raw --dims 512,512,300 --type i16 --spacing 0.7,0.7,1.5 -o scan.bsk\n  \
    brickscope brick ct/ -o ct.bsk --series 1.2.840.113619.2.1.1\n  \
    brickscope brick 'slices/*.tif' -o em.bsk --spacing 0.004,0.004,0.05\n  \
    brickscope brick cells.ome.tif -o cells.bsk --channel 1 --time 0\n  \
    brickscope brick phantom:body:256,256,256:u16 -o body.bsk --memory 256MiB\n  \
    brickscope brick large.nrrd -o large.bsk --resume")]
pub struct Args {
    /// The volume: a file, a folder or a glob of slices, several files (found out by their content), or
    /// phantom:NAME:X,Y,Z[:TYPE]
    #[arg(value_name = "INPUT", required = true)]
    inputs: Vec<String>,

    /// The store to write
    #[arg(short, long, value_name = "OUT.bsk")]
    output: PathBuf,

    /// How many levels of detail: down to a level of one brick, or at most N
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = levels)]
    levels: Levels,

    /// zstd's compression level, 1 to 19
    #[arg(long, value_name = "LEVEL", default_value_t = 1, value_parser = clap::value_parser!(i32).range(1..=19))]
    zstd: i32,

    /// Memory to use, from 128MiB; the process stays below 1.25 times as much
    #[arg(long, value_name = "SIZE", default_value = "1GiB")]
    memory: ByteSize,

    /// Threads that compress [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,

    /// Type of the stored voxels; u8 and u16 are refused when a value does not fit
    #[arg(long, value_name = "auto|u8|u16|f32", default_value = "auto", value_parser = store_type)]
    store_type: StoreType,

    /// Go on with a run of this very command that was killed: same INPUT, same OUT, same options
    ///
    /// While it works, brick keeps what is done and a journal of it in the hidden folder .OUT.brickscope-partial beside
    /// OUT. Being killed (kill -9, out of memory, power) leaves that folder; with --resume the work goes on from the last
    /// finished layer of bricks, and the store is the same to the byte. Another input or other options are refused;
    /// --memory and --threads may differ. With nothing to resume it starts from the beginning and says so. Without
    /// --resume the folder is removed and the work starts from the beginning. Ctrl-C and errors remove it, too.
    #[arg(long)]
    resume: bool,

    /// Replace OUT if it exists
    #[arg(long)]
    force: bool,

    /// Raw input: voxels along each axis
    #[arg(long, value_name = "X,Y,Z", value_parser = args::dims, requires = "voxel_type", help_heading = "Raw input")]
    dims: Option<U64Vec3>,

    /// Raw input: type of a voxel: u8, i8, u16, i16, u32, i32, f32 or f64
    #[arg(
        long = "type",
        value_name = "TYPE",
        requires = "dims",
        help_heading = "Raw input"
    )]
    voxel_type: Option<VoxelType>,

    /// Raw input: byte order, le or be [default: le]
    #[arg(
        long,
        value_name = "le|be",
        requires = "dims",
        help_heading = "Raw input"
    )]
    endian: Option<Endian>,

    /// Distance of voxels in millimetres, of raw input and of what does not say it [default: 1,1,1]
    #[arg(long, value_name = "x,y,z", value_parser = args::vec3, help_heading = "Which volume, and where")]
    spacing: Option<DVec3>,

    /// Which DICOM series, by its UID or the end of it
    #[arg(long, value_name = "UID", help_heading = "Which volume, and where")]
    series: Option<String>,

    /// Which channel of several, from 0
    #[arg(long, value_name = "N", help_heading = "Which volume, and where")]
    channel: Option<u64>,

    /// Which point in time of several, from 0
    #[arg(long, value_name = "N", help_heading = "Which volume, and where")]
    time: Option<u64>,

    /// Which volume of a file or folder that has several, by its name there
    #[arg(long, value_name = "NAME", help_heading = "Which volume, and where")]
    dataset: Option<String>,

    /// DICOM slices at uneven distances: interpolate slices at even ones, instead of refusing them
    #[arg(long, help_heading = "Which volume, and where")]
    resample_gaps: bool,

    /// Keep what DICOM says of patient, study and acquisition in the store (info shows it); without, nothing of it is kept
    #[arg(long, help_heading = "Which volume, and where")]
    keep_tags: bool,

    /// Raw input: bytes before the first voxel [default: 0]
    #[arg(
        long,
        value_name = "BYTES",
        requires = "dims",
        help_heading = "Raw input"
    )]
    offset: Option<u64>,
}

#[derive(Clone, Copy, Debug)]
struct Levels(Option<u32>);

#[derive(Clone, Copy, Debug)]
struct StoreType(Option<StoredType>);

fn levels(s: &str) -> Result<Levels, String> {
    if s == "auto" {
        return Ok(Levels(None));
    }
    match s.parse() {
        Ok(n @ 1..=32) => Ok(Levels(Some(n))),
        _ => Err(format!("'{s}': expected auto, or a number from 1 to 32")),
    }
}

fn store_type(s: &str) -> Result<StoreType, String> {
    match s {
        "auto" => Ok(StoreType(None)),
        "u8" => Ok(StoreType(Some(StoredType::U8))),
        "u16" => Ok(StoreType(Some(StoredType::U16))),
        "f32" => Ok(StoreType(Some(StoredType::F32))),
        _ => Err(format!("'{s}': expected auto, u8, u16 or f32")),
    }
}

/// Bricks the input and prints what was done.
///
/// # Errors
/// The input can't be read, the store can't be written, or the options don't fit the volume.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let raw = raw_params(&args)?;
    let threads = args.threads.map(usize::from);
    if let Some(threads) = threads {
        limit_source_threads(threads);
    }
    let options = BrickOptions {
        levels: args.levels.0,
        zstd_level: args.zstd,
        memory_bytes: args.memory.0,
        threads,
        store_type: args.store_type.0,
        existing: if args.force {
            Existing::Replace
        } else {
            Existing::Refuse
        },
        resume: args.resume,
        ..BrickOptions::default()
    };
    let open_options = OpenOptions {
        raw,
        spacing: args.spacing,
        series: args.series.clone(),
        channel: args.channel,
        time: args.time,
        dataset: args.dataset.clone(),
        resample_gaps: args.resample_gaps,
        keep_tags: args.keep_tags,
    };
    let open = || match args.inputs.as_slice() {
        [one] => input::open(one, &open_options),
        several => input::open_files(several.iter().map(PathBuf::from).collect(), &open_options),
    };
    let bar = Bar::default();
    let mut source = open()?;
    for note in source.notes() {
        bar.note(&note);
    }
    let mut result = bricking::brick(&mut *source, &args.output, &options, &bar);
    if let Err(BrickError::FiniteRangeNeeded { .. }) = &result {
        bar.note(
            "NaN or infinite values found in a stream: reading it once more for its finite range",
        );
        let finite_range = Some(bricking::finite_range(&mut *open()?, 1)?);
        source = open()?;
        let options = BrickOptions {
            finite_range,
            // What the attempt before had written is gone.
            resume: false,
            ..options
        };
        result = bricking::brick(&mut *source, &args.output, &options, &bar);
    }
    let report = result?;
    print(&report, &*source, &bar)?;
    Ok(ExitCode::SUCCESS)
}

/// Sources that compute their voxels use at most this many threads.
pub(super) fn limit_source_threads(threads: usize) {
    // They do it in this pool. It can only have been built before in a test.
    let _ = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global();
}

fn raw_params(args: &Args) -> anyhow::Result<Option<RawParams>> {
    if let Some(spacing) = args.spacing {
        anyhow::ensure!(
            spacing.min_element() > 0.0,
            "--spacing {},{},{}: expected three numbers above 0",
            spacing.x,
            spacing.y,
            spacing.z
        );
    }
    let (Some(dims), Some(voxel_type)) = (args.dims, args.voxel_type) else {
        return Ok(None);
    };
    let spacing = args.spacing.unwrap_or(DVec3::ONE);
    Ok(Some(RawParams {
        dims,
        voxel_type,
        endian: args.endian.unwrap_or_default(),
        spacing,
        offset: args.offset.unwrap_or(0),
    }))
}

fn print(report: &BrickingReport, source: &dyn VoxelSource, bar: &Bar) -> anyhow::Result<()> {
    let conversion = &report.conversion;
    let mut losses = Vec::new();
    for (count, what) in [
        (conversion.lossy_values, "values rounded to f32"),
        (
            conversion.nan_values,
            "NaN values replaced by the least finite value",
        ),
        (
            conversion.inf_values,
            "infinite values replaced by the nearest finite value",
        ),
    ] {
        if count > 0 {
            losses.push(format!("{count} {what}"));
        }
    }
    for loss in &losses {
        bar.note(&format!("warning: {loss}"));
    }
    let loss = if losses.is_empty() {
        "none".to_owned()
    } else {
        losses.join("; ")
    };
    let source_type = source.desc().voxel_type;
    let stored = match conversion.offset {
        0 => format!("{} (from {source_type})", report.stored_type),
        offset => format!(
            "{} (from {source_type}; stored = source + {offset})",
            report.stored_type
        ),
    };
    let seconds = report.seconds.max(1e-9);
    let rate = (report.bytes_in - report.bytes_resumed) as f64 / 1e6 / seconds;
    let mut out = io::stdout().lock();
    let lines = [
        ("voxels", report.voxels.to_string()),
        ("stored type", stored),
        ("loss", loss),
        ("levels", report.levels.to_string()),
        ("bricks", report.bricks.to_string()),
        ("kept bricks", report.kept_bricks.to_string()),
        ("bytes in", report.bytes_in.to_string()),
        ("bytes out", report.bytes_out.to_string()),
        ("seconds", format!("{seconds:.3}")),
        ("MB/s", format!("{rate:.1}")),
    ];
    for (name, value) in lines {
        writeln!(out, "{:<13}{value}", format!("{name}:")).context("standard output")?;
    }
    Ok(())
}
