//! The flight of which every frame is complete, however long it takes.

use std::collections::BTreeSet;
use std::time::Instant;

use super::film::Film;
use super::report::{FrameReport, Measured};
use super::{Args, Flight};
use crate::bricking::Progress;
use crate::cli::cmd::progress::Bar;
use crate::clock::ms;
use crate::engine::Engine;

/// Draws the frames that are not there yet.
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
    let begin = Instant::now();
    let mut notes = BTreeSet::new();
    let mut frames = Vec::new();
    for number in 0..flight.frames {
        if !film.there[number as usize] {
            let picture = engine.render(&flight.frame(&args.look, number)?)?;
            for note in picture.notes {
                // Once, not with every frame.
                if notes.insert(note.clone()) {
                    bar.note(&note);
                }
            }
            let rgba = picture.image.to_rgba8(args.look.background());
            film.queue.push(number, rgba)?;
            frames.push(FrameReport {
                number,
                seconds: flight.rate.seconds_of(number),
                draw_ms: picture.stats.wall_ms,
                stats: picture.stats,
                realtime: None,
            });
        }
        bar.advance(1);
    }
    film.queue.finish()?;
    Ok(Measured {
        wall_s: ms(begin.elapsed()) / 1e3,
        frames,
        realtime: None,
    })
}
