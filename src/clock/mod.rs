//! The clocks of this process: wall time, CPU time of all its threads, time since it started. Measures nothing by itself.

mod stopwatch;

pub use stopwatch::{CpuClock, Elapsed, Stopwatch, mark_main, ms, since_process_start};
