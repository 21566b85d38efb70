//! [`HalfFloats`]: voxels of 16-bit floats, read as f32, which holds every one of them exactly.

use half::f16;

use super::super::voxel_file::VoxelFile;
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, SourceError, VolumeDesc, VoxelSource, VoxelType, check_read};

/// A source of f32 over a file whose u16 are the bits of f16.
pub(super) struct HalfFloats {
    bits: VoxelFile,
    desc: VolumeDesc,
}

impl HalfFloats {
    /// The floats whose bits are the u16 of `bits`.
    pub(super) fn new(bits: VoxelFile) -> Self {
        let desc = VolumeDesc {
            voxel_type: VoxelType::F32,
            ..bits.desc().clone()
        };
        Self { bits, desc }
    }
}

impl VoxelSource for HalfFloats {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        self.bits.order()
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        check_read(&self.desc, voxels, out);
        // The bits come into the back half of `out`; from the front on, each f32 is written where bits have been read.
        let middle = out.len() / 2;
        self.bits.read_box(voxels, &mut out[middle..])?;
        for i in 0..middle / 2 {
            let at = middle + 2 * i;
            let value = f16::from_le_bytes([out[at], out[at + 1]]).to_f32();
            out[4 * i..4 * i + 4].copy_from_slice(&value.to_le_bytes());
        }
        Ok(())
    }

    fn stamp(&self) -> String {
        self.bits.stamp()
    }

    fn held_bytes(&self) -> u64 {
        self.bits.held_bytes()
    }

    fn notes(&self) -> Vec<String> {
        self.bits.notes()
    }
}
