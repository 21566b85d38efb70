//! What a user says of an input beside its name.

use glam::DVec3;

use super::raw::RawParams;

/// How an input is to be read where it leaves a choice. What is not said is found out, or refused with what there is to
/// choose from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// What a headerless file holds.
    pub raw: Option<RawParams>,
    /// Distance of voxel centres, mm, of an input that does not say it; each finite and above 0.
    pub spacing: Option<DVec3>,
    /// Which of several series, by its UID or the end of it.
    pub series: Option<String>,
    /// Which of several channels, from 0.
    pub channel: Option<u64>,
    /// Which of several points in time, from 0.
    pub time: Option<u64>,
    /// Which of several volumes in a container, by its path there.
    pub dataset: Option<String>,
    /// Slices at uneven distances are resampled to even ones.
    pub resample_gaps: bool,
    /// What the input says of patient and acquisition is kept.
    pub keep_tags: bool,
}

impl OpenOptions {
    /// Those for a headerless file.
    pub fn of_raw(raw: RawParams) -> Self {
        Self {
            raw: Some(raw),
            ..Self::default()
        }
    }
}
