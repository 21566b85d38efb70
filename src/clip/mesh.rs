//! Triangle meshes in world millimetres: their checks, and where a ray crosses them.

use glam::DVec3;
use thiserror::Error;

/// Triangles in world millimetres (RAS+), counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

/// Where a ray crosses a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance from the ray's origin, mm.
    pub at_mm: f64,
    /// Which triangle.
    pub triangle: u32,
    /// Does the ray come from the side that the triangle faces?
    pub enters: bool,
}

/// Why a mesh can't be used.
#[derive(Debug, Error)]
pub enum MeshError {}
