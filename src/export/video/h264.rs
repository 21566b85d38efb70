//! MP4 by the encoder that is built in: OpenH264, from its sources, and the container by `muxide`. For builds with feature
//! `h264`; OpenH264 built from source is not covered by Cisco's patent licence (README).

use std::fs::File;
use std::io::{BufWriter, Write};

use muxide::api::{Muxer, MuxerBuilder, MuxerError, VideoCodec};
use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameType, IntraFramePeriod, QpRange, RateControlMode,
    UsageType, VuiConfig,
};
use openh264::formats::YUVSlices;

use super::{FrameFormat, FrameSink, VideoError, Yuv420};
use crate::outfile::OutFile;

/// Largest picture of OpenH264: its longer and its shorter side.
const MOST: [u32; 2] = [3840, 2160];
/// The quantiser of all pictures: differences are hard to see.
const QUANTISER: u8 = 20;
/// Bits per second that are announced, per pixel. Nothing is kept to it.
const BITS_PER_PIXEL: f64 = 1.0;

/// A film that is being encoded.
pub(super) struct BuiltIn {
    out: OutFile,
    format: FrameFormat,
    encoder: Encoder,
    muxer: Muxer<BufWriter<File>>,
}

impl BuiltIn {
    pub(super) const NAME: &'static str = "OpenH264 (built in)";

    /// Begins the film.
    ///
    /// # Errors
    /// Frames are too large, or the encoder can't be made.
    pub(super) fn begin(mut out: OutFile, format: FrameFormat) -> Result<Self, VideoError> {
        let path = out.dest().to_owned();
        let failed = |reason: String| VideoError::Encoder {
            path: path.clone(),
            encoder: Self::NAME,
            reason,
        };
        let [width, height] = format.size;
        if width.max(height) > MOST[0] || width.min(height) > MOST[1] {
            let [long, short] = MOST;
            return Err(failed(format!(
                "frames are at most {long}x{short} or {short}x{long}, and these are {width}x{height}; give a smaller --size, or \
                 a folder for PNG frames"
            )));
        }
        let rate = format.rate.per_second();
        let bits = f64::from(width) * f64::from(height) * rate * BITS_PER_PIXEL;
        let config = EncoderConfig::new()
            .usage_type(UsageType::CameraVideoRealTime)
            .max_frame_rate(openh264::encoder::FrameRate::from_hz(rate as f32))
            .bitrate(BitRate::from_bps(bits.clamp(1e6, 5e8) as u32))
            // A constant quantiser; what controls a rate would skip frames, or complain that it may not.
            .rate_control_mode(RateControlMode::Off)
            .qp(QpRange::new(QUANTISER, QUANTISER))
            .skip_frames(false)
            // A key frame every four seconds, for who seeks.
            .intra_frame_period(IntraFramePeriod::from_num_frames((4.0 * rate).ceil() as u32))
            // The bytes don't depend on the machine.
            .num_threads(1)
            .vui(VuiConfig::bt709());
        let encoder = Encoder::with_api_config(OpenH264API::from_source(), config)
            .map_err(|e| failed(e.to_string()))?;
        let file = out.file().try_clone().map_err(|e| failed(e.to_string()))?;
        let muxer = MuxerBuilder::new(BufWriter::new(file))
            .video(VideoCodec::H264, width, height, rate)
            .build()
            .map_err(|e| failed(e.to_string()))?;
        Ok(Self {
            out,
            format,
            encoder,
            muxer,
        })
    }
}

impl FrameSink for BuiltIn {
    fn push(&mut self, number: u64, rgba: &[u8]) -> Result<(), VideoError> {
        self.format.check_length(self.out.dest(), number, rgba)?;
        let planes = Yuv420::from_rgba(rgba, self.format.size);
        let [width, height] = self.format.size.map(|s| s as usize);
        let source = YUVSlices::new(
            (&planes.y, &planes.cb, &planes.cr),
            (width, height),
            (width, width / 2, width / 2),
        );
        let failed = |reason: String| VideoError::Encoder {
            path: self.out.dest().to_owned(),
            encoder: Self::NAME,
            reason,
        };
        let encoded = self
            .encoder
            .encode(&source)
            .map_err(|e| failed(e.to_string()))?;
        let is_key = encoded.frame_type() == FrameType::IDR;
        let seconds = self.format.rate.seconds_of(number);
        self.muxer
            .write_video(seconds, &encoded.to_vec(), is_key)
            .map_err(|e: MuxerError| failed(e.to_string()))
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        let Self { out, mut muxer, .. } = *self;
        let failed = |reason: String| VideoError::Encoder {
            path: out.dest().to_owned(),
            encoder: Self::NAME,
            reason,
        };
        muxer.finish_in_place().map_err(|e| failed(e.to_string()))?;
        // Dropped, the writer would keep the error of a full disk for itself.
        let mut writer = muxer.into_writer();
        writer.flush().map_err(|e| failed(e.to_string()))?;
        Ok(out.commit()?)
    }
}
