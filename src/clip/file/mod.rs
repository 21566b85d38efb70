//! Readers of mesh files: STL, OBJ and PLY into a [`TriangleMesh`](super::TriangleMesh). World space is RAS+ mm, and
//! coordinates are taken as they are; colours, textures, materials and groups are passed over.
//!
//! The readers are own code, since the crates there are fall short of what untrusted files need. `stl_io` 0.11 takes any
//! file that begins with "solid " for text (many binary ones do) and names no place in its errors. `tobj` 4.0 names no line
//! either, refuses comments that are not UTF-8, and panics at some indices (in debug builds, where sums overflow). `ply-rs-bw`
//! 4.0 never ends at a binary element without properties and a great count. What these formats need of one is short.

mod obj;
mod ply;
mod problem;
mod read;
mod stl;
mod text;

#[cfg(test)]
mod tests;
