//! Why there is no figure.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::bricking::BrickError;
use crate::classify::CurveError;
use crate::engine::EngineError;
use crate::outfile::OutFileError;
use crate::scene::SceneError;
use crate::store::StoreError;
use crate::volume::SourceError;

/// Why a measurement can't be made, written or compared.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum BenchError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Brick(#[from] BrickError),
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    OutFile(#[from] OutFileError),
    #[error(transparent)]
    Curve(#[from] CurveError),
    #[error("{vol}: {bricks} bricks can't be read; 'brickscope verify' tells which")]
    FailedBricks { vol: String, bricks: u64 },
    #[error(
        "{device} has no memory of its own to page bricks into; give a graphics adapter with --device NAME"
    )]
    NoPaging { device: String },
    #[error("{}: is no report that --out has written: {error}; measure again with --out", path.display())]
    NotJson {
        path: PathBuf,
        error: serde_json::Error,
    },
    #[error(
        "{}: {place}: expected {expected}, found {found}; give a report that the same sub-command has written with --out",
        path.display()
    )]
    NotThisReport {
        path: PathBuf,
        place: &'static str,
        expected: String,
        found: String,
    },
    #[error("{}: cannot draw the plot: {reason}", path.display())]
    Plot { path: PathBuf, reason: String },
    #[error("{}: cannot {doing}: {error}", path.display())]
    Io {
        path: PathBuf,
        doing: &'static str,
        error: io::Error,
    },
}

impl BenchError {
    /// A [`BenchError::Io`] maker for `map_err`.
    pub(super) fn io(
        path: &std::path::Path,
        doing: &'static str,
    ) -> impl FnOnce(io::Error) -> Self {
        move |error| Self::Io {
            path: path.to_owned(),
            doing,
            error,
        }
    }
}
