//! Which format a mesh file is of, by its bytes.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::problem::{Subject, quoted};
use super::{obj, ply, stl};
use crate::clip::{MeshError, TriangleMesh};

impl TriangleMesh {
    /// Reads STL (binary or text), OBJ or PLY (binary or text). Coordinates are taken as world RAS+ mm. All of the file is
    /// held in memory meanwhile, and what is made of it is bounded by its length.
    ///
    /// # Errors
    /// It can't be read, is none of these, is malformed, or as [`Self::new`]; the file is named.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let io = |doing| {
            move |error| MeshError::Io {
                path: path.to_owned(),
                doing,
                error,
            }
        };
        let metadata = fs::metadata(path).map_err(io("open the mesh"))?;
        if !metadata.is_file() {
            // A pipe or a device need not end.
            return Err(Subject(path).malformed("the path", "a file", "something else"));
        }
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(io("open the mesh"))?;
        file.take(metadata.len())
            .read_to_end(&mut bytes)
            .map_err(io("read the mesh"))?;
        parse(path, &bytes).map_err(|e| e.of_file(path))
    }
}

/// The mesh of a file's bytes.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let subject = Subject(path);
    let is_named = |ending: &str| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case(ending))
    };
    if ply::is_ply(bytes) {
        return ply::read(subject, bytes);
    }
    if stl::is_binary(bytes) {
        return stl::binary(subject, bytes);
    }
    // Editors put a mark before text.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if stl::is_text(bytes) {
        return stl::text(subject, bytes);
    }
    if is_named("obj") || obj::is_obj(bytes) {
        return obj::read(subject, bytes);
    }
    if is_named("stl") {
        return stl::binary(subject, bytes);
    }
    Err(MeshError::UnknownFormat {
        path: path.to_owned(),
        found: quoted(bytes),
    })
}
