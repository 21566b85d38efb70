//! Volumes in folders and behind URLs that may hold several resolutions: which format it is, and how a level is opened.

use std::path::Path;

use glam::U64Vec3;

use super::OpenOptions;
use super::chunked::Store;
use super::problem::Subject;
use super::{n5, precomputed, zarr};
use crate::volume::{SourceError, VoxelSource};

/// A format whose volumes are made of many objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Zarr,
    N5,
    Precomputed,
}

impl Kind {
    /// What lies at `location`, a folder or a URL, or at the dataset of `options` below it; `None` where there are no
    /// metadata of any.
    ///
    /// # Errors
    /// It is a URL that can't be fetched.
    pub(super) fn of(location: &str, options: &OpenOptions) -> Result<Option<Self>, SourceError> {
        let root = Store::open(location)?;
        match (Self::at(&root)?, &options.dataset) {
            (None, Some(path)) => Self::at(&root.below(path)?),
            (found, _) => Ok(found),
        }
    }

    fn at(store: &Store) -> Result<Option<Self>, SourceError> {
        for mark in zarr::MARKS {
            if store.metadata(mark)?.is_some() {
                return Ok(Some(Self::Zarr));
            }
        }
        // The levels of a group of N5 may be all that has metadata.
        for place in [store, &store.below("s0")?] {
            if place.metadata(n5::ATTRIBUTES)?.is_some() {
                return Ok(Some(Self::N5));
            }
        }
        let info = store.metadata(precomputed::INFO);
        // On disk anything may be called so, a folder too.
        let info = if store.is_remote() {
            info?
        } else {
            info.ok().flatten()
        };
        Ok(info
            .is_some_and(|bytes| precomputed::is_info(&bytes))
            .then_some(Self::Precomputed))
    }

    /// Opens level `level` of what lies at `location`.
    ///
    /// # Errors
    /// It can't be fetched, is damaged, or of a kind that is not supported; or there is no such level.
    pub(super) fn open(
        self,
        location: &str,
        options: &OpenOptions,
        level: usize,
    ) -> Result<Box<dyn VoxelSource>, SourceError> {
        match self {
            Self::Zarr => zarr::open_level(location, options, level),
            Self::N5 => n5::open_level(location, options, level),
            Self::Precomputed => precomputed::open_level(location, options, level),
        }
    }
}

/// The sizes of the levels that the input `spec` holds already, the finest first; empty for a format without levels.
///
/// # Errors
/// As [`open_level`].
pub fn levels(spec: &str, options: &OpenOptions) -> Result<Vec<U64Vec3>, SourceError> {
    match kind(spec, options)? {
        Some(Kind::Zarr) => zarr::levels(spec, options),
        Some(Kind::N5) => n5::levels(spec, options),
        Some(Kind::Precomputed) => precomputed::levels(spec, options),
        None => Ok(Vec::new()),
    }
}

/// Opens level `level` of the input `spec`, 0 the finest; see [`levels`].
///
/// # Errors
/// It can't be fetched, is damaged, or of a kind that is not supported or has no levels; or there is no such one.
pub fn open_level(
    spec: &str,
    options: &OpenOptions,
    level: usize,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    match kind(spec, options)? {
        Some(kind) => kind.open(spec, options, level),
        None => Err(Subject::new(Path::new(spec)).unsupported(
            "an input without levels of its own",
            "levels are read from OME-Zarr, N5 and Neuroglancer precomputed",
        )),
    }
}

/// The format of `spec` where it is one of these; only folders and URLs are.
fn kind(spec: &str, options: &OpenOptions) -> Result<Option<Kind>, SourceError> {
    if is_url(spec) || Path::new(spec).is_dir() {
        Kind::of(spec, options)
    } else {
        Ok(None)
    }
}

/// Whether `spec` is the URL of a volume.
pub(super) fn is_url(spec: &str) -> bool {
    let scheme = spec.split_once("://").map_or("", |(scheme, _)| scheme);
    !scheme.is_empty()
        && scheme
            .bytes()
            .all(|c| c.is_ascii_alphanumeric() || c == b'+')
}
