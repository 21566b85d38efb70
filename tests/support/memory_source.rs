//! A volume in memory, for tests of bricking: any voxel type, read in either order.

use std::path::PathBuf;

use brickscope::geom::VoxelBox;
use brickscope::volume::{ReadOrder, Rescale, SourceError, VolumeDesc, VoxelSource, VoxelType};
use glam::{DAffine3, DVec3, U64Vec3};

/// A volume in memory.
pub struct MemorySource {
    /// What it says of itself.
    pub desc: VolumeDesc,
    /// Its voxels, little-endian, x fastest.
    pub bytes: Vec<u8>,
    /// The order in which it may be read; held to it when it is `ForwardZ`.
    pub order: ReadOrder,
    /// Reading this slice fails.
    pub fail_at: Option<u64>,
    next_z: u64,
}

impl MemorySource {
    /// A volume of `dims` voxels, spaced 1 mm.
    pub fn new(dims: [u64; 3], voxel_type: VoxelType, bytes: Vec<u8>) -> Self {
        let dims = U64Vec3::from(dims);
        let desc = VolumeDesc {
            dims,
            voxel_type,
            world_from_index: DAffine3::IDENTITY,
            rescale: Rescale {
                slope: 2.0,
                intercept: -5.0,
            },
            unit: "HU".into(),
            name: "memory".into(),
        };
        assert_eq!(
            desc.byte_count(),
            Some(bytes.len() as u64),
            "as many bytes as voxels"
        );
        Self {
            desc,
            bytes,
            order: ReadOrder::Random,
            fail_at: None,
            next_z: 0,
        }
    }

    /// The same, spaced otherwise.
    pub fn with_spacing(mut self, spacing: [f64; 3]) -> Self {
        self.desc.world_from_index = DAffine3::from_scale(DVec3::from(spacing));
        self
    }

    /// The same, to be read forward only.
    pub fn forward(mut self) -> Self {
        self.order = ReadOrder::ForwardZ;
        self
    }
}

impl VoxelSource for MemorySource {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        self.order
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let (dims, size) = (self.desc.dims, self.desc.voxel_type.size());
        if self.order == ReadOrder::ForwardZ {
            assert_eq!(voxels.min, U64Vec3::new(0, 0, self.next_z), "forward only");
            assert_eq!(
                (voxels.max.x, voxels.max.y),
                (dims.x, dims.y),
                "whole slices"
            );
            self.next_z = voxels.max.z;
        }
        if let Some(z) = self
            .fail_at
            .filter(|z| (voxels.min.z..voxels.max.z).contains(z))
        {
            return Err(SourceError::Malformed {
                path: PathBuf::from("memory"),
                place: format!("slice {z}"),
                expected: "a slice".into(),
                found: "the end".into(),
                remedy: "give more".into(),
            });
        }
        let row = voxels.size().x as usize * size;
        let mut at = 0;
        for z in voxels.min.z..voxels.max.z {
            for y in voxels.min.y..voxels.max.y {
                let from = ((z * dims.y + y) * dims.x + voxels.min.x) as usize * size;
                out[at..at + row].copy_from_slice(&self.bytes[from..from + row]);
                at += row;
            }
        }
        Ok(())
    }
}

/// Reproducible noise: numbers below 2²⁴.
pub fn noise(n: usize, seed: u32) -> impl Iterator<Item = u32> {
    let mut state = seed;
    (0..n).map(move |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    })
}

/// Little-endian voxels of a type: noise where `blank` (0 to 1) leaves it, runs of one value elsewhere.
pub fn voxels(voxel_type: VoxelType, n: usize, seed: u32, blank: f64) -> Vec<u8> {
    let mut out = Vec::with_capacity(n * voxel_type.size());
    for (i, v) in noise(n, seed).enumerate() {
        let in_run = f64::from(((i / 97) as u32).wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
        let v = if in_run < blank { 42 } else { v };
        match voxel_type {
            VoxelType::U8 | VoxelType::I8 => out.push(v as u8),
            VoxelType::U16 | VoxelType::I16 => out.extend((v as u16).to_le_bytes()),
            VoxelType::U32 => out.extend(v.to_le_bytes()),
            VoxelType::I32 => out.extend((v as i32 - 8_000_000).to_le_bytes()),
            VoxelType::F32 => out.extend((v as f32 / 4096.0 - 2000.0).to_le_bytes()),
            VoxelType::F64 => out.extend((f64::from(v) / 4096.0 - 2000.0).to_le_bytes()),
        }
    }
    out
}
