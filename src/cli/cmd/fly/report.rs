//! What a flight took, for people and for machines.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use super::{Args, Flight};
use crate::engine::{Engine, PageReport, Picture};
use crate::scene::PictureStats;

/// What was measured while flying.
pub(super) struct Measured {
    pub(super) wall_s: f64,
    pub(super) frames: Vec<FrameReport>,
    pub(super) realtime: Option<RealtimeReport>,
}

/// The JSON object of `--json` and, with `per_frame`, of `--stats`.
#[derive(Serialize)]
pub(super) struct Report {
    /// Frames of the flight, and those of them that were drawn now.
    frames: u64,
    drawn: u64,
    /// Of the flight.
    seconds: f64,
    fps: f64,
    size: [u32; 2],
    wall_s: f64,
    /// Drawing alone, per frame drawn.
    mean_ms: Option<f64>,
    /// "gpu" or "cpu", as in the statistics of pictures, and its name.
    device: &'static str,
    adapter: String,
    output: String,
    /// What encoded the film; null for a folder.
    encoder: Option<&'static str>,
    /// Null where every frame is complete.
    realtime: Option<RealtimeReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    per_frame: Option<Vec<FrameReport>>,
}

/// One frame that was drawn.
#[derive(Serialize)]
pub(super) struct FrameReport {
    #[serde(rename = "frame")]
    pub(super) number: u64,
    /// Of the flight.
    pub(super) seconds: f64,
    pub(super) draw_ms: f64,
    /// As `render --stats` has them.
    pub(super) stats: PictureStats,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub(super) realtime: Option<RealtimeFrame>,
}

/// One frame of a flight in real time.
#[derive(Serialize)]
pub(super) struct RealtimeFrame {
    /// The finest level that the frame asks for.
    lod: u8,
    /// Bricks that were missing, and the share of the rays that met one.
    missing_bricks: u64,
    missed_ray_share: f64,
    /// The missing bricks by the level that stood in for them; "none" where there was none.
    stand_ins: BTreeMap<String, u64>,
    /// What looking ahead took, of what was left of its slot.
    predict_ms: f64,
    /// By how much it came after the end of its slot.
    stall_ms: f64,
    /// How long the flight stood still, since frames were not written as fast.
    write_wait_ms: f64,
    /// Loaded in what was left of its slot.
    bricks_read: u64,
    bricks_uploaded: u64,
}

impl RealtimeFrame {
    /// A picture, by how much it was late, how long it waited for being written, what predicting took after it, and what was
    /// loaded.
    pub(super) fn new(
        picture: &Picture,
        [stall_ms, write_wait_ms, predict_ms]: [f64; 3],
        paged: PageReport,
    ) -> Self {
        let level = |lod: &Option<crate::geom::Lod>| match lod {
            Some(lod) => lod.0.to_string(),
            None => "none".into(),
        };
        let bricks = &picture.stand_ins.bricks;
        Self {
            lod: picture.stats.lod,
            missing_bricks: bricks.values().sum(),
            missed_ray_share: picture.stand_ins.rays as f64 / picture.stats.rays.max(1) as f64,
            stand_ins: bricks.iter().map(|(lod, &n)| (level(lod), n)).collect(),
            predict_ms,
            stall_ms,
            write_wait_ms,
            bricks_read: paged.bricks_read,
            bricks_uploaded: paged.bricks_uploaded,
        }
    }
}

/// All frames of a flight in real time.
#[derive(Default, Serialize)]
pub(super) struct RealtimeReport {
    prefetch: bool,
    /// Frames drawn with a missing brick, and their share of those drawn.
    missing_frames: u64,
    missing_frame_share: f64,
    /// The mean over all frames drawn.
    missed_ray_share: f64,
    /// Frames that were done after the end of their slot, and by how much in all.
    late_frames: u64,
    stall_ms: f64,
    /// How long the flight stood still in all, since frames were not written as fast as they came.
    write_wait_ms: f64,
    /// Frames drawn by the finest level that they ask for.
    lods: BTreeMap<u8, u64>,
    /// Frames that were not drawn, since the one before was late.
    pub(super) dropped_frames: u64,
    bricks_read: u64,
    bricks_uploaded: u64,
    #[serde(skip)]
    drawn: u64,
}

impl RealtimeReport {
    /// Of no frame yet.
    pub(super) fn new(prefetch: bool) -> Self {
        Self {
            prefetch,
            ..Self::default()
        }
    }

    /// Adds a frame.
    pub(super) fn add(&mut self, frame: &RealtimeFrame, picture: &Picture) {
        let drawn = self.drawn as f64;
        self.drawn += 1;
        self.missing_frames += u64::from(frame.missing_bricks > 0);
        self.missing_frame_share = self.missing_frames as f64 / self.drawn as f64;
        self.missed_ray_share =
            (self.missed_ray_share * drawn + frame.missed_ray_share) / self.drawn as f64;
        self.late_frames += u64::from(frame.stall_ms > 0.0);
        self.stall_ms += frame.stall_ms;
        self.write_wait_ms += frame.write_wait_ms;
        *self.lods.entry(frame.lod).or_default() += 1;
        self.bricks_read += frame.bricks_read + picture.stats.bricks_read.unwrap_or(0);
        self.bricks_uploaded += frame.bricks_uploaded + picture.stats.bricks_uploaded.unwrap_or(0);
    }
}

impl Measured {
    /// The report of the flight.
    pub(super) fn of(
        self,
        args: &Args,
        flight: &Flight,
        engine: &Engine,
        encoder: Option<&'static str>,
    ) -> Report {
        let drawn = self.frames.len() as u64;
        let sum: f64 = self.frames.iter().map(|f| f.draw_ms).sum();
        Report {
            frames: flight.frames,
            drawn,
            seconds: flight.rate.seconds_of(flight.frames),
            fps: flight.rate.per_second(),
            size: args.look.size(),
            wall_s: self.wall_s,
            mean_ms: (drawn > 0).then(|| sum / drawn as f64),
            device: engine.device_kind(),
            adapter: engine.device_name(),
            output: args.output.display().to_string(),
            encoder,
            realtime: self.realtime,
            per_frame: Some(self.frames),
        }
    }
}

impl Report {
    /// The numbers of the whole flight alone.
    pub(super) fn without_frames(self) -> Self {
        Self {
            per_frame: None,
            ..self
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            frames,
            drawn,
            wall_s,
            output,
            ..
        } = self;
        write!(
            f,
            "{output}: {frames} frames, {drawn} drawn in {wall_s:.1} s"
        )?;
        if let Some(mean) = self.mean_ms {
            write!(f, ", {mean:.1} ms each")?;
        }
        if let Some(r) = &self.realtime {
            write!(
                f,
                "; {} with missing bricks ({:.1} %), {} late, {} dropped, {:.0} ms stalled",
                r.missing_frames,
                r.missing_frame_share * 100.0,
                r.late_frames,
                r.dropped_frames,
                r.stall_ms
            )?;
            if r.write_wait_ms >= 1.0 {
                write!(f, ", {:.0} ms waited for the writer", r.write_wait_ms)?;
            }
            let lods = r.lods.iter().map(|(lod, n)| format!("{n} on level {lod}"));
            write!(f, "; {}", lods.collect::<Vec<_>>().join(", "))?;
        }
        Ok(())
    }
}
