//! `info`: what a store holds.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::{Value, json};

use crate::geom::Lod;
use crate::store::{Percentiles, Store};
use crate::volume::Rescale;

/// Say what a store holds
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  brickscope info scan.bsk\n  brickscope info scan.bsk --json")]
pub struct Args {
    /// The store
    #[arg(value_name = "STORE")]
    store: PathBuf,

    /// Print one JSON object instead of lines
    #[arg(long)]
    json: bool,
}

/// Prints size, place, values, levels and source of the store.
///
/// # Errors
/// The store can't be opened, or an index is damaged.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let store = Store::open(&args.store)?;
    store.check_all_levels()?;
    let counts: Vec<LevelCount> = (0..store.levels()).map(|l| count(&store, l)).collect();
    let mut out = io::stdout().lock();
    if args.json {
        writeln!(out, "{}", to_json(&store, &counts))?;
    } else {
        write_text(&store, &counts, &mut out)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Bricks of a level.
struct LevelCount {
    bricks: u64,
    constant: u64,
    bytes: u64,
}

fn count(store: &Store, level: usize) -> LevelCount {
    let mut count = LevelCount {
        bricks: 0,
        constant: 0,
        bytes: 0,
    };
    for id in store.bricks(Lod(level as u8)) {
        count.bricks += 1;
        match store.entry(id).record {
            Some(record) => count.bytes += u64::from(record.len),
            None => count.constant += 1,
        }
    }
    count
}

/// The percentiles by name.
fn named(p: &Percentiles) -> [(&'static str, f64); 11] {
    [
        ("0.1", p.p0_1),
        ("1", p.p1),
        ("5", p.p5),
        ("25", p.p25),
        ("50", p.p50),
        ("75", p.p75),
        ("95", p.p95),
        ("99", p.p99),
        ("99.9", p.p99_9),
        ("1_above_min", p.p1_above_min),
        ("99.9_above_min", p.p99_9_above_min),
    ]
}

/// Share of bricks of one value among those of level 0: no voxels are stored for them.
fn empty_share(counts: &[LevelCount]) -> f64 {
    counts[0].constant as f64 / counts[0].bricks as f64
}

/// Physical values at both ends of a stored range, the smaller first (a slope may be negative).
fn physical_range(rescale: &Rescale, min: f64, max: f64) -> [f64; 2] {
    let (a, b) = (rescale.physical(min), rescale.physical(max));
    [a.min(b), a.max(b)]
}

fn to_json(store: &Store, counts: &[LevelCount]) -> Value {
    let meta = store.meta();
    let m = meta.world_from_index.matrix3;
    let t = meta.origin();
    let rows: Vec<[f64; 4]> = (0..3)
        .map(|r| [m.x_axis[r], m.y_axis[r], m.z_axis[r], t[r]])
        .collect();
    let levels: Vec<Value> = meta
        .levels
        .iter()
        .zip(counts)
        .map(|(level, count)| {
            json!({
                "dims": level.dims.to_array(),
                "scale": level.scale.to_array(),
                "bricks": count.bricks,
                "constant_bricks": count.constant,
                "compressed_bytes": count.bytes,
            })
        })
        .collect();
    let percentiles = |value: &dyn Fn(f64) -> f64| -> serde_json::Map<String, Value> {
        named(&meta.percentiles)
            .map(|(name, v)| (name.to_owned(), json!(value(v))))
            .into_iter()
            .collect()
    };
    json!({
        "store": store.path().to_string_lossy(),
        "dims": meta.dims.to_array(),
        "voxel_type": meta.stored_type,
        "source_type": meta.source_type,
        "conversion": meta.conversion,
        "rescale": meta.rescale,
        "source_rescale": meta.source_rescale,
        "unit": meta.unit,
        "spacing": meta.spacing().to_array(),
        "origin": t.to_array(),
        "affine": rows,
        "value_range": physical_range(&meta.rescale, meta.value_min, meta.value_max),
        "stored_range": [meta.value_min, meta.value_max],
        "levels": levels,
        "bricks": counts.iter().map(|c| c.bricks).sum::<u64>(),
        "kept_bricks": counts.iter().map(|c| c.bricks - c.constant).sum::<u64>(),
        "empty_share": empty_share(counts),
        "compressed_bytes": counts.iter().map(|c| c.bytes).sum::<u64>(),
        "file_bytes": store.file_len(),
        "percentiles": percentiles(&|v| meta.rescale.physical(v)),
        "stored_percentiles": percentiles(&|v| v),
        "source": meta.source_name,
        "source_hash": format!("{:016x}", meta.source_hash),
        "writer": meta.writer,
        "tags": meta.tags,
    })
}

fn write_text(store: &Store, counts: &[LevelCount], out: &mut impl Write) -> io::Result<()> {
    let meta = store.meta();
    let mut line = |name: &str, value: String| writeln!(out, "{:<17}{value}", format!("{name}:"));
    let (d, s) = (meta.dims, meta.spacing());
    line("store", store.path().display().to_string())?;
    line("source", meta.source_name.clone())?;
    line("source hash", format!("{:016x}", meta.source_hash))?;
    line("written by", meta.writer.clone())?;
    line("dims", format!("{} × {} × {}", d.x, d.y, d.z))?;
    line(
        "voxel type",
        format!("{} (source: {})", meta.stored_type, meta.source_type),
    )?;
    let c = &meta.conversion;
    line(
        "conversion",
        if c.is_exact() {
            format!("exact (stored = source + {})", c.offset)
        } else {
            format!(
                "{} values rounded, {} NaN and {} infinite replaced",
                c.lossy_values, c.nan_values, c.inf_values
            )
        },
    )?;
    line("spacing", format!("{} × {} × {} mm", s.x, s.y, s.z))?;
    let (m, t) = (meta.world_from_index.matrix3, meta.origin());
    let row = |r: usize| format!("{} {} {} {}", m.x_axis[r], m.y_axis[r], m.z_axis[r], t[r]);
    line("affine", format!("{}; {}; {}", row(0), row(1), row(2)))?;
    let unit = if meta.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", meta.unit)
    };
    let [low, high] = physical_range(&meta.rescale, meta.value_min, meta.value_max);
    line(
        "value range",
        format!(
            "{low} to {high}{unit} (= {} · stored + {})",
            meta.rescale.slope, meta.rescale.intercept
        ),
    )?;
    for (i, (level, count)) in meta.levels.iter().zip(counts).enumerate() {
        let v = level.dims;
        line(
            &format!("level {i}"),
            format!(
                "{} × {} × {} voxels, {} bricks, {} of one value, {} bytes",
                v.x, v.y, v.z, count.bricks, count.constant, count.bytes
            ),
        )?;
    }
    line("empty share", format!("{:.4}", empty_share(counts)))?;
    let bytes: u64 = counts.iter().map(|c| c.bytes).sum();
    line(
        "compressed",
        format!(
            "{bytes} bytes of records, {} bytes of file",
            store.file_len()
        ),
    )?;
    for (name, value) in named(&meta.percentiles) {
        line(
            &format!("p{name}"),
            format!("{}{unit}", meta.rescale.physical(value)),
        )?;
    }
    for (name, text) in &meta.tags {
        line("tag", format!("{name} = {text}"))?;
    }
    Ok(())
}
