//! `bench seeds`: the five systems' own comparisons.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};

use super::note_fallback;
use super::output::{OutputArgs, note};
use crate::bench::{SeedJob, SeedPictures, SeedRow, SeedTable, sheet, vol_name};
use crate::cli::args;
use crate::cli::config::MachineArgs;
use crate::cli::transfer::{TransferArgs, not_drawn};
use crate::engine::Engine;
use crate::geom::Lod;
use crate::scene::{LodChoice, Mode, SceneError, default_window};
use crate::store::{Store, StoreMeta};

/// The comparisons that the five systems of techniques.md made, theirs beside ours
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Each picture is drawn in several ways from the same cameras, the ways in turns frame by frame. Pictures are at \
    step 1 unless the table says otherwise. What the device can't draw has a dash and a note.\n\n\
    T1 bounding mesh, refinement   T2 leaping, super-sampling   T3 layers   T4 early termination, skipping   T5 slabs\n\n\
    Examples:\n  \
    brickscope bench seeds foot.bsk engine.bsk --iso foot=600 --iso engine=120\n  \
    brickscope bench seeds chest.bsk --tables T1,T4 --device cpu --size 256 --frames 2 --out seeds.json --svg seeds.svg"
)]
pub struct Args {
    /// The brick stores
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,
    /// Which systems, separated by commas [default: all]
    #[arg(
        long,
        value_enum,
        ignore_case = true,
        value_name = "T1,…",
        value_delimiter = ','
    )]
    tables: Vec<TableArg>,
    /// Edge of the square pictures, pixels; where sizes are compared: half, once, one and a half times, twice this
    #[arg(long, value_name = "PIXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(2..=8192))]
    size: u32,
    /// Timed frames, spread over a full turn
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=360))]
    frames: u32,
    /// How often the turn is repeated
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Value of the surface, physical, of all stores or of the one of that name; repeatable [default: the middle of the
    /// window of the default grey ramp]
    #[arg(long, value_name = "[STORE=]VALUE", value_parser = iso)]
    iso: Vec<IsoArg>,
    /// Level that is drawn, auto or its number; auto draws no data finer than the screen
    #[arg(long, value_name = "auto|N", default_value = "0", value_parser = args::lod)]
    lod: LodChoice,
    #[command(flatten)]
    transfer: TransferArgs,
    #[command(flatten)]
    machine: MachineArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TableArg {
    #[value(name = "T1")]
    T1,
    #[value(name = "T2")]
    T2,
    #[value(name = "T3")]
    T3,
    #[value(name = "T4")]
    T4,
    #[value(name = "T5")]
    T5,
}

impl TableArg {
    fn table(self) -> SeedTable {
        match self {
            Self::T1 => SeedTable::T1,
            Self::T2 => SeedTable::T2,
            Self::T3 => SeedTable::T3,
            Self::T4 => SeedTable::T4,
            Self::T5 => SeedTable::T5,
        }
    }
}

/// A value, of one store or of all.
#[derive(Clone, Debug, PartialEq)]
struct IsoArg {
    vol: Option<String>,
    value: f64,
}

/// `[STORE=]VALUE`.
fn iso(s: &str) -> Result<IsoArg, String> {
    // A name may have an equals sign, a number has none.
    let (vol, value) = match s.rsplit_once('=') {
        Some((vol, value)) => (Some(vol.to_owned()), value),
        None => (None, s),
    };
    let value = value.parse::<f64>().ok().filter(|v| v.is_finite());
    value.map(|value| IsoArg { vol, value }).ok_or_else(|| {
        format!("'{s}': expected VALUE or STORE=VALUE, the value a finite number in physical units")
    })
}

/// Measures the tables on all stores.
///
/// # Errors
/// A store is refused, a flag names no store, the device fails, or a report can't be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let old = args.output.open()?;
    let vols: Vec<String> = args.stores.iter().map(|path| vol_name(path)).collect();
    for name in args.iso.iter().filter_map(|i| i.vol.as_ref()) {
        if !vols.contains(name) {
            bail!(
                "--iso {name}=…: no such store; those given are {}",
                vols.join(", ")
            );
        }
    }
    let tables: Vec<SeedTable> = match &args.tables[..] {
        [] => SeedTable::ALL.to_vec(),
        some => some.iter().map(|t| t.table()).collect(),
    };
    // What can be refused is refused before anything is measured.
    let mut stores = Vec::new();
    let mut jobs = Vec::new();
    for (path, vol) in args.stores.iter().zip(&vols) {
        if vols.iter().filter(|v| *v == vol).count() > 1 {
            bail!("two of the stores are called {vol}; rename one: rows tell volumes by that name");
        }
        let store = Arc::new(Store::open(path)?);
        store.check_all_levels()?;
        if let LodChoice::Fixed(Lod(level)) = args.lod
            && usize::from(level) >= store.levels()
        {
            let last = store.levels() - 1;
            let error = SceneError::NoSuchLevel { asked: level, last };
            return Err(error).with_context(|| path.display().to_string());
        }
        let mut notes = Vec::new();
        let pictures = args.pictures(vol, store.meta(), &mut notes)?;
        for text in &notes {
            note(text);
        }
        stores.push(store);
        jobs.push(SeedJob {
            vol: vol.clone(),
            tables: tables.clone(),
            pictures,
            frames: args.frames,
            repeats: args.repeats,
        });
    }
    let mut rows: Vec<SeedRow> = Vec::new();
    let mut heads = Vec::new();
    for (store, job) in stores.into_iter().zip(jobs) {
        let mut engine = Engine::with_store(store, args.machine.engine_options())?;
        note_fallback(&engine);
        heads.push(args.head(&job, &engine));
        rows.extend(job.measure(&mut engine)?);
    }
    let print = |rows: &[SeedRow]| format!("{}\n\n{}", heads.join("\n"), sheet(rows));
    args.output
        .finish_with(rows, old.as_ref(), print, "bench seeds: speed-ups")?;
    Ok(ExitCode::SUCCESS)
}

impl Args {
    /// The value that was given for a store: its own before that of all.
    fn iso(&self, vol: &str) -> Option<f64> {
        let of = |wanted: Option<&str>| {
            let mut given = self.iso.iter().rev();
            given.find(|i| i.vol.as_deref() == wanted).map(|i| i.value)
        };
        of(Some(vol)).or_else(|| of(None))
    }

    fn pictures(
        &self,
        vol: &str,
        meta: &StoreMeta,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<SeedPictures> {
        let composited = self.transfer.function(Mode::Dvr, meta, notes)?;
        // What there was to say has been said.
        let projected = self.transfer.function(Mode::Mip, meta, &mut Vec::new())?;
        notes.extend(not_drawn(&composited));
        Ok(SeedPictures {
            opacity_unit_mm: self.transfer.opacity_unit_mm(&composited),
            composited,
            projected,
            iso: self
                .iso(vol)
                .unwrap_or_else(|| SeedPictures::default_iso(meta)),
            window_end: default_window(meta)[1],
            lod: self.lod,
            size: self.size,
        })
    }

    /// What was measured, in words.
    fn head(&self, job: &SeedJob, engine: &Engine) -> String {
        let meta = engine.meta();
        let [x, y, z] = meta.dims.to_array();
        let SeedPictures { iso, size, .. } = job.pictures;
        let whose = match self.iso(&job.vol) {
            Some(_) => "",
            None => " (the middle of the default window)",
        };
        let [_, high] = job.pictures.interval();
        let level = match self.lod {
            LodChoice::Fixed(Lod(level)) => format!("level {level}"),
            LodChoice::Auto => "level by distance".into(),
        };
        let turns = match self.repeats {
            1 => "1 repeat".into(),
            n => format!("{n} repeats"),
        };
        format!(
            "{}: {x}×{y}×{z} {}, iso {iso}{whose}, interval to {high}; {size}² pixels, {level}; {} frames of a turn, \
             {turns}; on {}",
            job.vol,
            meta.stored_type,
            self.frames,
            engine.device_name()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_of_a_store_or_of_all() {
        let of = |vol: Option<&str>, value| IsoArg {
            vol: vol.map(Into::into),
            value,
        };
        assert_eq!(iso("-300"), Ok(of(None, -300.0)));
        assert_eq!(iso("foot=6e2"), Ok(of(Some("foot"), 600.0)));
        assert_eq!(iso("a=b=1"), Ok(of(Some("a=b"), 1.0)));
        for bad in ["", "foot", "foot=", "nan", "foot=inf"] {
            assert!(iso(bad).is_err(), "{bad:?} is no value");
        }
    }
}
