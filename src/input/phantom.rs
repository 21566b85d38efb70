//! Procedural volumes of any size, nothing stored: `phantom:NAME:X,Y,Z[:TYPE]`.
//!
//! The same spec gives the same bytes on every machine: only + − × ÷, square roots and roundings of IEEE numbers, integer
//! hashes, and `libm` where a sine is needed. Shapes are given in fractions of the box, so every size shows the same thing.
//! Not here: any state between boxes; each is computed when it is asked for.

mod body;
mod levels;
mod raster;
mod shapes;
mod signal;
mod vessels;

use std::path::Path;

use glam::{DAffine3, U64Vec3};
use rayon::prelude::*;

pub use self::vessels::{TubeSegment, vessel_tree};

use self::levels::Encoder;
use self::raster::Scene;
use self::signal::{MarschnerLobb, Sponge};
use super::problem::{Subject, quoted};
use crate::geom::VoxelBox;
use crate::volume::{
    ReadOrder, Rescale, SourceError, StoredType, VolumeDesc, VoxelSource, check_read,
};

/// Rows that one task computes of a slice: enough to repay setting the slice up.
const ROWS_PER_TASK: usize = 32;

/// A volume computed on demand.
pub struct Phantom {
    desc: VolumeDesc,
    stored: StoredType,
    content: Content,
}

enum Content {
    Scene(Scene),
    Sponge,
    MarschnerLobb,
}

impl Phantom {
    /// The phantom that `spec` (`phantom:NAME:X,Y,Z[:TYPE]`) names.
    ///
    /// # Errors
    /// The name, the size or the type is not known.
    pub fn from_spec(spec: &str) -> Result<Self, SourceError> {
        let subject = Subject {
            path: Path::new(spec),
            remedy: "write for example phantom:body:256,256,256 or phantom:body:512,512,512:u16",
        };
        let mut parts = spec.split(':').skip(1);
        let name = parts.next().unwrap_or_default();
        let dims = parse_dims(&subject, parts.next().unwrap_or_default())?;
        let stored = match parts.next() {
            None | Some("u8") => StoredType::U8,
            Some("u16") => StoredType::U16,
            Some("f32") => StoredType::F32,
            Some(other) => {
                return Err(subject.malformed("the type", "u8, u16 or f32", quoted(other)));
            }
        };
        if let Some(more) = parts.next() {
            return Err(subject.malformed("the spec", "nothing after the type", quoted(more)));
        }
        let content = match name {
            "body" => Content::Scene(body::scene()),
            "vessels" => Content::Scene(vessels::scene()),
            "sponge" => Content::Sponge,
            "marschner-lobb" => Content::MarschnerLobb,
            other => {
                return Err(subject.malformed(
                    "the name",
                    "body, vessels, sponge or marschner-lobb",
                    quoted(other),
                ));
            }
        };
        let desc = VolumeDesc {
            dims,
            voxel_type: stored.voxel_type(),
            world_from_index: DAffine3::IDENTITY,
            rescale: Rescale::IDENTITY,
            unit: String::new(),
            name: spec.to_owned(),
        };
        super::voxel_file::voxel_bytes(&subject, &desc)?;
        Ok(Self {
            desc,
            stored,
            content,
        })
    }
}

fn parse_dims(subject: &Subject<'_>, text: &str) -> Result<U64Vec3, SourceError> {
    let parsed: Option<Vec<u64>> = text
        .split(',')
        .map(|p| p.parse().ok().filter(|&n| n > 0))
        .collect();
    parsed
        .and_then(|v| <[u64; 3]>::try_from(v).ok())
        .map(U64Vec3::from_array)
        .ok_or_else(|| {
            let expected = "X,Y,Z, three whole numbers of at least 1";
            subject.malformed("the size", expected, quoted(text))
        })
}

impl VoxelSource for Phantom {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        ReadOrder::Random
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let dims = self.desc.dims;
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let encoder = Encoder::new(self.stored);
        match &self.content {
            Content::Scene(scene) => fill_scene(scene, dims, voxels, encoder, out),
            Content::Sponge => fill_rows(&Sponge::new(dims, voxels), voxels, encoder, out),
            Content::MarschnerLobb => {
                fill_rows(&MarschnerLobb::new(dims, voxels), voxels, encoder, out);
            }
        }
        Ok(())
    }
}

/// Fills a box from shapes: some rows of one slice per task.
fn fill_scene(scene: &Scene, dims: U64Vec3, voxels: VoxelBox, encoder: Encoder, out: &mut [u8]) {
    let size = voxels.size();
    let row_voxels = size.x as usize;
    let row_bytes = row_voxels * encoder.voxel_bytes();
    out.par_chunks_mut(row_bytes * size.y as usize)
        .enumerate()
        .flat_map(|(k, slice)| {
            slice
                .par_chunks_mut(row_bytes * ROWS_PER_TASK)
                .enumerate()
                .map(move |(group, rows)| (k, group, rows))
        })
        .for_each(|(k, group, rows)| {
            let z = voxels.min.z + k as u64;
            let slice = scene.slice(dims, z);
            let mut materials = vec![0; row_voxels];
            for (j, row) in rows.chunks_exact_mut(row_bytes).enumerate() {
                let y = voxels.min.y + (group * ROWS_PER_TASK + j) as u64;
                if slice.paint_row(y, voxels.min.x, &mut materials) {
                    encoder.materials(&scene.materials, &materials, [voxels.min.x, y, z], row);
                } else {
                    row.fill(0);
                }
            }
        });
}

/// A field whose rows are cheap once what depends on y alone is known.
trait RowField: Sync {
    /// What all rows of one y share.
    type Shared;
    /// Computes it for row `j` of the box.
    fn shared(&self, j: usize) -> Self::Shared;
    /// The row of slice `k` of the box, in fractions of full scale.
    fn row(&self, shared: &Self::Shared, k: usize, out: &mut [f32]);
}

/// Fills a box from a field: all slices of one y per task.
fn fill_rows<F: RowField>(field: &F, voxels: VoxelBox, encoder: Encoder, out: &mut [u8]) {
    let size = voxels.size();
    let row_bytes = size.x as usize * encoder.voxel_bytes();
    let mut columns: Vec<Vec<&mut [u8]>> = (0..size.y).map(|_| Vec::new()).collect();
    for (row, column) in out
        .chunks_exact_mut(row_bytes)
        .zip((0..size.y as usize).cycle())
    {
        columns[column].push(row);
    }
    columns.into_par_iter().enumerate().for_each(|(j, rows)| {
        let shared = field.shared(j);
        let mut fractions = vec![0.0; size.x as usize];
        for (k, row) in rows.into_iter().enumerate() {
            field.row(&shared, k, &mut fractions);
            encoder.fractions(&fractions, row);
        }
    });
}

#[cfg(test)]
mod tests;
