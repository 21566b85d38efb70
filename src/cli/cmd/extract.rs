//! `extract`: exact voxels back out of a store.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use super::progress::Bar;
use crate::bricking::Progress;
use crate::cli::args;
use crate::export;
use crate::geom::{Lod, VoxelBox};
use crate::outfile::Existing;
use crate::store::Store;

/// Write a store's voxels to a file again, as they came in
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    brickscope extract scan.bsk -o scan.nii.gz\n  \
    brickscope extract scan.bsk -o corner.nrrd --box 0,0,0,64,64,32\n  \
    brickscope extract scan.bsk -o coarse.raw --level 2\n  \
    brickscope extract scan.bsk -o scan.zarr")]
pub struct Args {
    /// The store
    #[arg(value_name = "STORE")]
    store: PathBuf,

    /// The file to write, or the folder of an OME-Zarr, with all coarser levels; an existing one is replaced
    #[arg(short, long, value_name = "FILE.(nii.gz|nrrd|raw|zarr)")]
    output: PathBuf,

    /// Level of detail: 0 is the finest
    #[arg(long, value_name = "N", default_value_t = 0)]
    level: u8,

    /// Only the voxels from x0,y0,z0 up to, but without, x1,y1,z1, in voxels of the level
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", value_parser = args::voxel_box)]
    voxels: Option<VoxelBox>,
}

/// Extracts and says what the file holds.
///
/// # Errors
/// The store is refused or damaged, it has no such level or box, or the file can't be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let path = &args.output;
    let store = Store::open(&args.store)?;
    let lod = Lod(args.level);
    let voxels = args.voxels.unwrap_or_else(|| {
        // A level that is not there is refused by `extracted`, whatever the box.
        let level = usize::from(args.level).min(store.levels() - 1);
        VoxelBox::whole(store.meta().levels[level].dims)
    });
    let desc = export::extracted(&store, lod, voxels)?;
    let bar = Bar::default();
    let conversion = &store.meta().conversion;
    if !conversion.is_exact() {
        bar.note(&format!(
            "warning: when {} was made, {} values were rounded, {} NaN and {} infinite ones replaced; they come out so",
            store.path().display(),
            conversion.lossy_values,
            conversion.nan_values,
            conversion.inf_values
        ));
    }
    if let Some(caveat) = export::caveat(path, &desc) {
        bar.note(&format!("note: {}: {caveat}", path.display()));
    }
    bar.begin(
        "extracting",
        voxels.voxel_count().unwrap_or(0) * store.stored_type().size() as u64,
    );
    let written = export::extract(
        &store,
        (lod, voxels),
        path,
        Existing::Replace,
        &mut |bytes| bar.advance(bytes),
    );
    bar.end();
    written?;
    let (d, s) = (desc.dims, desc.spacing());
    writeln!(
        io::stdout(),
        "{}: {},{},{} voxels of {}, spacing {},{},{} mm, level {}",
        path.display(),
        d.x,
        d.y,
        d.z,
        desc.voxel_type,
        s.x,
        s.y,
        s.z,
        args.level
    )?;
    Ok(ExitCode::SUCCESS)
}
