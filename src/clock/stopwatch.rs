//! Two clocks read together, and the start of the process.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// When `main` began, for systems that don't tell when the process did.
static MAIN: OnceLock<Instant> = OnceLock::new();

/// Remembers now as the beginning of `main`. To be called first thing there; later calls are of no effect.
pub fn mark_main() {
    MAIN.get_or_init(Instant::now);
}

/// Time since this process started. On Linux by the kernel's start time of the process, which is in clock ticks (10 ms):
/// at most one tick too long, never too short. Elsewhere since [`mark_main`], which leaves out what loading the program
/// took.
pub fn since_process_start() -> Duration {
    #[cfg(target_os = "linux")]
    if let Some(since) = since_kernel_start() {
        return since;
    }
    MAIN.get_or_init(Instant::now).elapsed()
}

/// Now, less field 22 of `/proc/self/stat`; both count from the boot of the machine.
#[cfg(target_os = "linux")]
fn since_kernel_start() -> Option<Duration> {
    use rustix::time::{ClockId, clock_gettime};

    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // Field 2, the program's name in parentheses, may hold anything; field 3 follows its last parenthesis.
    let (_, fields) = stat.rsplit_once(')')?;
    let start_ticks: u64 = fields.split_whitespace().nth(22 - 3)?.parse().ok()?;
    let now = clock_gettime(ClockId::Boottime);
    let now_secs = now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9;
    let start_secs = start_ticks as f64 / rustix::param::clock_ticks_per_second() as f64;
    Duration::try_from_secs_f64(now_secs - start_secs).ok()
}

/// The CPU clock of this process: user and system time of all its threads, in nanoseconds.
#[derive(Clone, Copy, Debug)]
pub struct CpuClock;

impl CpuClock {
    /// What it shows; `None` where the system has no such clock (other than Unix).
    pub fn now() -> Option<Duration> {
        #[cfg(unix)]
        {
            use rustix::time::{ClockId, clock_gettime};
            let now = clock_gettime(ClockId::ProcessCPUTime);
            Duration::try_from_secs_f64(now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9).ok()
        }
        #[cfg(not(unix))]
        None
    }
}

/// Wall and CPU time of a piece of work.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Elapsed {
    /// Wall time, ms.
    pub wall_ms: f64,
    /// User and system time of all threads, ms; `None` where there is no such clock.
    pub cpu_ms: Option<f64>,
}

/// Both clocks, from when it was started.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    wall: Instant,
    cpu: Option<Duration>,
}

impl Stopwatch {
    /// Starts it.
    pub fn start() -> Self {
        Self {
            cpu: CpuClock::now(),
            wall: Instant::now(),
        }
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Elapsed {
        let wall = self.wall.elapsed();
        let cpu = CpuClock::now()
            .zip(self.cpu)
            .map(|(now, start)| now.saturating_sub(start));
        Elapsed {
            wall_ms: ms(wall),
            cpu_ms: cpu.map(ms),
        }
    }
}

/// A duration in milliseconds.
pub fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn cpu_time_is_of_all_threads_and_not_of_sleep() {
        let asleep = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(30));
        let asleep = asleep.elapsed();
        assert!(asleep.wall_ms >= 30.0, "{asleep:?}");

        // What another thread burns is counted, by that thread's own share of the clock.
        let busy = Stopwatch::start();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let begin = CpuClock::now();
                while CpuClock::now()
                    .zip(begin)
                    .is_some_and(|(now, b)| now - b < Duration::from_millis(20))
                {}
            });
        });
        let cpu_ms = busy.elapsed().cpu_ms.expect("a CPU clock");
        assert!(cpu_ms >= 20.0, "{cpu_ms}");
    }

    #[test]
    fn the_process_started_before_now_and_time_goes_on() {
        mark_main();
        let first = since_process_start();
        std::thread::sleep(Duration::from_millis(20));
        let second = since_process_start();
        assert!(
            second - first >= Duration::from_millis(20),
            "{first:?} {second:?}"
        );
        // A test process is neither hours old nor from the future.
        assert!(second < Duration::from_secs(24 * 3600), "{second:?}");
    }
}
