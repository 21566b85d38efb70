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
    let prefetch = args.prefetch == Switch::On;
    let mut frames = Vec::new();
    let mut totals = RealtimeReport::new(prefetch);
    let mut predict_ms = 0.0;
    if prefetch {
        predict(args, flight, engine, schedule, 0)?;
    }
    let mut picture = engine.draw_moving(&flight.frame(&args.look, 0)?)?;
    for note in &picture.notes {
        bar.note(note);
    }
    let mut shown = 0;
    let mut begun = 0.0;
    let clock = Instant::now();
    let now = || clock.elapsed().as_secs_f64();
    let until = |seconds: f64| Duration::from_secs_f64((seconds - now()).max(0.0));
    loop {
        let done = now();
        let draw_ms = match shown {
            0 => picture.stats.wall_ms,
            _ => (done - begun) * 1e3,
        };
        let rgba = picture.image.to_rgba8(args.look.background());
        film.queue.push(shown, rgba.clone())?;
        let paged = engine.page(until(schedule.end(shown)))?;
        std::thread::sleep(until(schedule.end(shown)));
        let stall_ms = (done - schedule.end(shown)).max(0.0) * 1e3;
        let frame = RealtimeFrame::new(&picture, [predict_ms, stall_ms], paged);
        totals.add(&frame, &picture);
        frames.push(FrameReport {
            number: shown,
            seconds: schedule.begin(shown),
            draw_ms,
            stats: picture.stats,
            realtime: Some(frame),
        });
        begun = now();
        let next = schedule.next(shown, begun);
        // What was due meanwhile was not drawn: the picture before stays on.
        for dropped in shown + 1..next.unwrap_or(flight.frames) {
            film.queue.push(dropped, rgba.clone())?;
            totals.dropped_frames += 1;
        }
        bar.advance(next.unwrap_or(flight.frames) - shown);
        let Some(number) = next else { break };
        if prefetch {
            predict(args, flight, engine, schedule, number)?;
            predict_ms = (now() - begun) * 1e3;
        }
        picture = engine.draw_moving(&flight.frame(&args.look, number)?)?;
        shown = number;
    }
    film.queue.finish()?;
    Ok(Measured {
        wall_s: ms(clock.elapsed()) / 1e3,
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
