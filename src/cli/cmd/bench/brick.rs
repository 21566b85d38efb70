//! `bench brick`: what making a store costs.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;

use super::output::OutputArgs;
use crate::bench::{BrickJob, BrickRow, disk_rate};
use crate::cli::args::ByteSize;
use crate::cli::cmd::brick::limit_source_threads;

/// What making a store costs, against what disk and codec could do
#[derive(Debug, clap::Args)]
#[command(
    after_help = "The ceiling is the least of: the disk's read rate (for what was not in the page cache), its write rate (for \
    the store's bytes), and zstd -1 on the store's own records, one core × threads.\n\n\
    Examples:\n  \
    brickscope bench brick ct1024.nhdr --dir /data\n  \
    brickscope bench brick scan.nii.gz phantom:body:512,512,512:u16 --zstd 1,3,9 --threads 2 --json"
)]
pub struct Args {
    /// The volumes: files that describe themselves, or phantom:NAME:X,Y,Z[:TYPE]
    #[arg(value_name = "INPUT", required = true)]
    inputs: Vec<String>,
    /// zstd's compression levels, 1 to 19, separated by commas
    #[arg(long, value_name = "LEVEL,…", value_delimiter = ',', default_value = "1", value_parser = clap::value_parser!(i32).range(1..=19))]
    zstd: Vec<i32>,
    /// Threads that compress [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory of each run, from 128MiB
    #[arg(long, value_name = "SIZE", default_value = "1GiB")]
    memory: ByteSize,
    /// Folder of the temporary stores; each is removed after its run [default: the system's temporary folder]
    #[arg(long, value_name = "FOLDER")]
    dir: Option<PathBuf>,
    /// Leave out what the machine could do at most: disk and codec
    #[arg(long)]
    no_ceiling: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// Bricks every input at every level of compression.
///
/// # Errors
/// An input is refused, the folder can't be written, or a report can't be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let old = args.output.open()?;
    let folder = args.dir.clone().unwrap_or_else(std::env::temp_dir);
    if !folder.is_dir() {
        bail!(
            "{}: expected a folder for the temporary stores; make it first, or give another with --dir",
            folder.display()
        );
    }
    let threads = match args.threads {
        Some(threads) => {
            limit_source_threads(usize::from(threads));
            usize::from(threads)
        }
        None => std::thread::available_parallelism()?.get(),
    };
    let ceiling = match args.no_ceiling {
        true => None,
        false => Some(disk_rate(&folder)?),
    };
    let mut rows: Vec<BrickRow> = Vec::new();
    for input in &args.inputs {
        for &zstd_level in &args.zstd {
            let job = BrickJob {
                input: input.clone(),
                zstd_level,
                threads,
                memory_bytes: args.memory.0,
            };
            rows.push(job.measure(&folder, ceiling)?);
        }
    }
    let remarks: Vec<String> = ceiling
        .flatten()
        .map(|disk| {
            format!(
                "The disk: {:.0} MB/s written and synced, {:.0} MB/s read, past the page cache",
                disk.write_mb_per_s, disk.read_mb_per_s
            )
        })
        .into_iter()
        .collect();
    args.output
        .finish(rows, old.as_ref(), &remarks, "bench brick: ms")?;
    Ok(ExitCode::SUCCESS)
}
