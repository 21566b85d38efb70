//! Bare voxels: no header, so size, type and place have to be remembered elsewhere.

use std::path::Path;

use super::sink::{Header, Sink};
use super::writer::ExportError;
use crate::outfile::Existing;
use crate::volume::VolumeDesc;

/// Starts a `.raw` file.
pub(super) fn create(
    path: &Path,
    desc: &VolumeDesc,
    existing: Existing,
) -> Result<Sink, ExportError> {
    Sink::create(path, desc, existing, &Header::None)
}
