//! NRRD with attached header and gzip encoding, in the space that 3D Slicer writes: LPS.
//!
//! NRRD has no slope and intercept. Where a volume has them, its physical values are written, as double: exact, if large.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use glam::DVec3;

use super::sink::{Header, Sink};
use super::writer::{ExportError, VolumeWriter};
use crate::outfile::Existing;
use crate::volume::{Rescale, VolumeDesc, VoxelType};

/// Voxels converted at once.
const CHUNK_VOXELS: usize = 4096;

/// Starts a `.nrrd` file.
pub(super) fn create(
    path: &Path,
    desc: &VolumeDesc,
    existing: Existing,
) -> Result<Writer, ExportError> {
    let physical = (desc.rescale != Rescale::IDENTITY).then_some(desc.rescale);
    let header = header(desc, physical.is_some());
    let header = Header::Before(header.as_bytes());
    Ok(Writer {
        sink: Sink::create(path, desc, existing, &header)?,
        voxel_type: desc.voxel_type,
        physical,
    })
}

/// A `.nrrd` file being written.
pub(super) struct Writer {
    sink: Sink,
    voxel_type: VoxelType,
    /// Set when physical values are written.
    physical: Option<Rescale>,
}

impl VolumeWriter for Writer {
    fn write(&mut self, bytes_le: &[u8]) -> io::Result<()> {
        let Some(rescale) = self.physical else {
            return self.sink.write(bytes_le);
        };
        let voxel_type = self.voxel_type;
        self.sink.write_with(bytes_le, |bytes, out| {
            for chunk in bytes.chunks(CHUNK_VOXELS * voxel_type.size()) {
                let converted: Vec<u8> = chunk
                    .chunks_exact(voxel_type.size())
                    .flat_map(|v| rescale.physical(voxel_type.value(v)).to_le_bytes())
                    .collect();
                out.write_all(&converted)?;
            }
            Ok(())
        })
    }

    fn finish(self: Box<Self>) -> Result<(), ExportError> {
        Box::new(self.sink).finish()
    }
}

const fn type_name(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "uint8",
        VoxelType::I8 => "int8",
        VoxelType::U16 => "uint16",
        VoxelType::I16 => "int16",
        VoxelType::U32 => "uint32",
        VoxelType::I32 => "int32",
        VoxelType::F32 => "float",
        VoxelType::F64 => "double",
    }
}

fn header(desc: &VolumeDesc, as_double: bool) -> String {
    // `+ 0.0` makes −0 a plain 0. Rust prints the shortest text that reads back as the same number.
    let vector = |v: DVec3| format!("({},{},{})", -v.x + 0.0, -v.y + 0.0, v.z + 0.0);
    let voxel_type = if as_double {
        VoxelType::F64
    } else {
        desc.voxel_type
    };
    let affine = desc.world_from_index;
    let m = affine.matrix3;
    let mut text = format!(
        "NRRD0004\n\
         # Complete NRRD file format specification at:\n\
         # http://teem.sourceforge.net/nrrd/format.html\n\
         type: {}\n\
         dimension: 3\n\
         space: left-posterior-superior\n\
         sizes: {} {} {}\n\
         space directions: {} {} {}\n\
         kinds: domain domain domain\n\
         endian: little\n\
         encoding: gzip\n\
         space origin: {}\n",
        type_name(voxel_type),
        desc.dims.x,
        desc.dims.y,
        desc.dims.z,
        vector(m.x_axis),
        vector(m.y_axis),
        vector(m.z_axis),
        vector(affine.translation),
    );
    let plain = |c: char| !c.is_control() && c != '"';
    if !desc.unit.is_empty() && desc.unit.chars().all(plain) {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "sample units: \"{}\"", desc.unit);
    }
    text.push('\n');
    text
}
