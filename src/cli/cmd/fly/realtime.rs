//! The flight that keeps its frame rate: what is not there is stood in for, loaded between the frames, and counted.

use std::time::{Duration, Instant};

use super::film::Film;
use super::report::{FrameReport, Measured, RealtimeFrame, RealtimeReport};
use super::schedule::Schedule;
use super::{Args, Flight};
use crate::bricking::Progress;
use crate::camera::Camera;
use crate::cli::cmd::progress::Bar;
use crate::cli::config::Switch;
use crate::clock::ms;
use crate::engine::Engine;
use crate::scene::AntiAliasing;

/// What is otherwise than was asked for.
pub(super) fn notes(args: &Args, flight: &Flight, engine: &Engine) -> Vec<String> {
    let mut notes = Vec::new();
    if flight.settings.anti_aliasing != AntiAliasing::Off {
        notes.push("--realtime draws one ray of a pixel, whatever --samples and --aa say".into());
    }
    if !engine.loads_ahead() {
        let prefetch = match args.prefetch {
            Switch::On => "; nothing is loaded ahead",
            Switch::Off => "",
        };
        notes.push(format!(
            "--realtime on the CPU: every frame is complete, and late rather than coarser{prefetch}"
        ));
    }
    notes
}

/// The clock of a flight: it stands while frames wait for being written.
struct FlightClock {
    begin: Instant,
    stood: Duration,
}

impl FlightClock {
    fn start() -> Self {
        Self {
            begin: Instant::now(),
            stood: Duration::ZERO,
        }
    }

    fn now(&self) -> f64 {
        self.begin
            .elapsed()
            .saturating_sub(self.stood)
            .as_secs_f64()
    }

    fn until(&self, seconds: f64) -> Duration {
        Duration::from_secs_f64((seconds - self.now()).max(0.0))
    }

    /// Does some work while the clock stands.
    fn standing<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let done = work();
        self.stood += begin.elapsed();
        done
    }
}

/// Flies. The clock starts when the first frame is there: the flight begins at rest.
///
/// # Errors
/// A frame can't be drawn or written.
pub(super) fn fly(
    args: &Args,
    flight: &Flight,
    engine: &mut Engine,
    mut film: Film,
    bar: &Bar,
) -> anyhow::Result<Measured> {
    let schedule = Schedule {
        rate: flight.rate,
        frames: flight.frames,
    };
    let prefetch = args.prefetch == Switch::On && engine.loads_ahead();
    let mut frames = Vec::new();
    let mut totals = RealtimeReport::new(prefetch);
    let mut picture = engine.draw_moving(&flight.frame(&args.look, 0)?)?;
    for note in &picture.notes {
        bar.note(note);
    }
    let mut shown = 0;
    let mut begun = 0.0;
    let mut clock = FlightClock::start();
    loop {
        let done = clock.now();
        let draw_ms = match shown {
            0 => picture.stats.wall_ms,
            _ => (done - begun) * 1e3,
        };
        let stall_ms = (done - schedule.end(shown)).max(0.0) * 1e3;
        let stood = clock.stood;
        let rgba = picture.image.to_rgba8(args.look.background());
        clock.standing(|| film.queue.push(shown, rgba.clone()))?;
        let looked = clock.now();
        // Behind the frame, so that it waits for nothing that is but a guess.
        if prefetch {
            predict(args, flight, engine, schedule, shown)?;
        }
        let predict_ms = (clock.now() - looked) * 1e3;
        let paged = engine.page(clock.until(schedule.end(shown)))?;
        std::thread::sleep(clock.until(schedule.end(shown)));
        begun = clock.now();
        let next = schedule.next(shown, begun);
        // What was due meanwhile was not drawn: the picture before stays on.
        for dropped in shown + 1..next.unwrap_or(flight.frames) {
            clock.standing(|| film.queue.push(dropped, rgba.clone()))?;
            totals.dropped_frames += 1;
        }
        let write_wait_ms = ms(clock.stood - stood);
        let frame = RealtimeFrame::new(&picture, [stall_ms, write_wait_ms, predict_ms], paged);
        totals.add(&frame, &picture);
        frames.push(FrameReport {
            number: shown,
            seconds: schedule.begin(shown),
            draw_ms,
            stats: picture.stats,
            realtime: Some(frame),
        });
        bar.advance(next.unwrap_or(flight.frames) - shown);
        let Some(number) = next else { break };
        picture = engine.draw_moving(&flight.frame(&args.look, number)?)?;
        shown = number;
    }
    film.queue.finish()?;
    Ok(Measured {
        wall_s: ms(clock.begin.elapsed()) / 1e3,
        frames,
        realtime: Some(totals),
    })
}

/// Says where the flight goes from frame `number` on.
fn predict(
    args: &Args,
    flight: &Flight,
    engine: &mut Engine,
    schedule: Schedule,
    number: u64,
) -> anyhow::Result<()> {
    let cameras: Vec<Camera> = schedule
        .ahead(number)
        .map(|n| flight.frame(&args.look, n).map(|s| s.camera))
        .collect::<anyhow::Result<_>>()?;
    Ok(engine.predict(&flight.settings, &cameras)?)
}
