//! TIFF files made by hand, and what is read from them. They go into a file, as a user would have them.

mod build;
mod damage;
mod forms;
mod metadata;

use std::path::{Path, PathBuf};

use super::*;
use crate::geom::VoxelBox;
use crate::input::raw::Endian;

/// A folder with files of these bytes, and their paths.
fn saved(files: &[Vec<u8>]) -> (tempfile::TempDir, Vec<PathBuf>) {
    let dir = tempfile::tempdir().unwrap();
    let paths = files.iter().enumerate().map(|(n, bytes)| {
        let path = dir.path().join(format!("{n}.tif"));
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let paths = paths.collect();
    (dir, paths)
}

/// A volume that was read.
struct Read {
    dims: [u64; 3],
    voxels: Vec<u8>,
    spacing: [f64; 3],
    notes: String,
    desc: crate::volume::VolumeDesc,
}

fn read_files(files: &[Vec<u8>], options: &OpenOptions) -> Result<Read, SourceError> {
    let (_dir, paths) = saved(files);
    let mut source = open(&paths, &Subject::new(Path::new("named")), options)?;
    let desc = source.desc().clone();
    let mut voxels = vec![0; desc.byte_count().unwrap() as usize];
    source.read_box(VoxelBox::whole(desc.dims), &mut voxels)?;
    Ok(Read {
        dims: desc.dims.to_array(),
        voxels,
        spacing: desc.spacing().to_array(),
        notes: source.notes().join("\n"),
        desc,
    })
}

fn read(bytes: &[u8]) -> Result<Read, SourceError> {
    read_files(&[bytes.to_vec()], &OpenOptions::default())
}

/// Why a file is not read.
fn refused(bytes: &[u8]) -> String {
    refused_with(bytes, &OpenOptions::default())
}

fn refused_with(bytes: &[u8], options: &OpenOptions) -> String {
    match read_files(&[bytes.to_vec()], options) {
        Ok(_) => panic!("it was read"),
        Err(error) => error.to_string(),
    }
}

fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-12 * b)
}

const BOTH: [Endian; 2] = [Endian::Little, Endian::Big];
