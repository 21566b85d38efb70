//! What `brickscope bench` measures: clocks, the machine and its ceilings, one measurement per sub-command, and the
//! reports, tables and plots made of them.
//!
//! It stands on the façade like any other user: what it times is what a user would wait for. It draws nothing and bricks
//! nothing by itself, names no graphics device, and knows no argument of the command line. Figures are rounded when they
//! are stored, never when they are computed.

mod clock;
mod error;
mod process;
mod render;
mod summary;

pub use clock::{CpuClock, Elapsed, Stopwatch, mark_main, since_process_start};
pub use error::BenchError;
pub use process::{peak_rss_bytes, storage_bytes_read};
pub use render::{RenderJob, RenderRow, WarmUp, turn_distance_mm};
pub use summary::{median, percentile};
