//! What `brickscope bench` measures: the machine and its ceilings, one measurement per sub-command, and the
//! reports, tables and plots made of them.
//!
//! It stands on the façade like any other user: what it times is what a user would wait for. It draws nothing and bricks
//! nothing by itself, names no graphics device, and knows no argument of the command line. Figures are rounded when they
//! are stored, never when they are computed.

mod brick;
mod ceiling;
mod classify;
mod compare;
mod error;
mod machine;
mod page;
mod page_cache;
mod plot;
mod process;
mod render;
mod report;
mod seeds;
mod summary;
mod table;
mod turn;

pub use brick::{BrickCeiling, BrickJob, BrickRow};
pub use ceiling::{
    CodecRate, DiskRate, RandomReads, StoreCeiling, codec_rate, disk_rate, memcpy_gb_per_s,
    random_reads, sequential_read, vol_name,
};
pub use classify::{ClassifyJob, ClassifyRow};
pub use compare::{Comparison, Ratios};
pub use error::BenchError;
pub use machine::Machine;
pub use page::{PageJob, PageRow};
pub use page_cache::drop_from_page_cache;
pub use plot::write_plot;
pub use process::{peak_rss_bytes, storage_bytes_read};
pub use render::{RenderJob, RenderRow, WarmUp};
pub use report::{NamedTime, Report, Row};
pub use seeds::{Reported, SeedJob, SeedPictures, SeedRow, SeedTable, sheet};
pub use summary::{median, percentile};
pub use table::{aligned, table};
pub use turn::{Turn, turn_distance_mm};
