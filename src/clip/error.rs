//! Why a mesh can't be read or used.

use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;
use thiserror::Error;

/// Why a mesh can't be read or used.
#[derive(Debug, Error)]
pub enum MeshError {
    /// The operating system refused.
    #[error("{}: can't {doing}: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// Its answer.
        error: io::Error,
    },
    /// The bytes are none of the formats.
    #[error("{}: expected a mesh as STL, OBJ or PLY, found {found}; export it as one of these", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// What it begins with.
        found: String,
    },
    /// The bytes are not what the format demands.
    #[error("{}: {place}: expected {expected}, found {found}; export the mesh anew", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line or byte offset.
        place: String,
        /// What the format demands.
        expected: String,
        /// What is there.
        found: String,
    },
    /// What is wrong with the mesh of a file.
    #[error("{}: {error}", path.display())]
    OfFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: Box<MeshError>,
    },
    /// No triangle is left.
    #[error(
        "the mesh has no triangles with three different corners ({degenerate} have fewer); export it as triangles"
    )]
    Empty {
        /// Triangles that were dropped.
        degenerate: usize,
    },
    /// More than can be numbered.
    #[error("the mesh has {triangles} triangles, at most {most} can be used; decimate it")]
    TooLarge {
        /// Its triangles.
        triangles: usize,
        /// The most that can be used.
        most: usize,
    },
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle}: expected vertices 0 to {}, found {index}; export the mesh anew", *vertices as i64 - 1)]
    Index {
        /// Which triangle, from 0.
        triangle: usize,
        /// What it names.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A coordinate that is no place.
    #[error(
        "vertex {vertex}: expected coordinates within ±{most} mm, found {at}; export the mesh anew, in millimetres"
    )]
    Coordinates {
        /// Which vertex, from 0.
        vertex: usize,
        /// Its coordinates.
        at: DVec3,
        /// The greatest that can be used, mm.
        most: f64,
    },
    /// Normals and vertices differ in number.
    #[error("expected one normal per vertex, found {normals} normals and {vertices} vertices")]
    NormalCount {
        /// How many normals there are.
        normals: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A mesh that has no inside.
    #[error(
        "the mesh is not closed: {edges} of its edges belong to an odd number of triangles, one of them from {from} to {to} mm; \
         close its holes, or draw it without cutting with it"
    )]
    Open {
        /// How many edges are open.
        edges: usize,
        /// Where one of them begins, world mm.
        from: DVec3,
        /// Where that one ends.
        to: DVec3,
    },
    /// A mesh whose inside and outside can't be told apart.
    #[error(
        "the triangles at {edges} edges of the mesh do not agree on which side is outside, at one from {from} to {to} mm; \
         orient its faces consistently, or draw it without cutting with it"
    )]
    Orientation {
        /// At how many edges.
        edges: usize,
        /// Where one of them begins, world mm.
        from: DVec3,
        /// Where that one ends.
        to: DVec3,
    },
}

impl MeshError {
    /// The same with the file named, where it is not yet.
    pub fn of_file(self, path: &Path) -> Self {
        match self {
            Self::Io { .. }
            | Self::UnknownFormat { .. }
            | Self::Malformed { .. }
            | Self::OfFile { .. } => self,
            error => Self::OfFile {
                path: path.to_owned(),
                error: Box::new(error),
            },
        }
    }
}
