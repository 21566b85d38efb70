//! Readers of mesh files: STL, OBJ and PLY into a [`TriangleMesh`](super::TriangleMesh). World space is RAS+ mm, and
//! coordinates are taken as they are; colours, textures, materials and groups are passed over.
//!
//! The readers are own code: the crates there are fall short of what files of unknown origin need, and little is needed of
//! each format. `stl_io` 0.11 takes a binary file whose header begins with "solid " for text, as many do, and its errors name
//! no place. `tobj` 4.0 names no line either and refuses a comment that is not UTF-8. `ply-rs-bw` 4.0 makes as many elements
//! as the header says where they have no properties: a file of 100 bytes took 21 GB.

mod obj;
mod ply;
mod problem;
mod read;
mod stl;
mod text;

#[cfg(test)]
mod tests;
