//! What cuts the volume and what is drawn with it: half spaces, boxes and triangle meshes as plain geometry, in world
//! millimetres. No draw calls, no samples.
//!
//! Everything comes down to [`Geometry::spans`]: the parts of a ray in which the volume is sampled, and the layers of meshes
//! between them. The GPU makes the same list per pixel from a raster of the meshes.

mod error;
mod file;
mod geometry;
mod mesh;
mod plane;

pub use error::MeshError;
pub use geometry::{ClipMesh, CutFaces, Geometry, Layer, Side, Span, SurfaceMesh};
pub use mesh::{Crossing, TriangleMesh};
pub use plane::{OrientedBox, Plane};
