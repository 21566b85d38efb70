//! The types a voxel can have in a source file, and the three that a store keeps.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Type of a voxel in a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum VoxelType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl VoxelType {
    /// Every type, in the order in which messages list them.
    pub const ALL: [Self; 8] = [
        Self::U8,
        Self::I8,
        Self::U16,
        Self::I16,
        Self::U32,
        Self::I32,
        Self::F32,
        Self::F64,
    ];

    /// Bytes per voxel.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Has it fractions?
    pub const fn is_real(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Has it whole numbers below 0?
    pub const fn is_signed_integer(self) -> bool {
        matches!(self, Self::I8 | Self::I16 | Self::I32)
    }

    /// The number in the little-endian bytes of one voxel.
    pub fn value(self, bytes: &[u8]) -> f64 {
        /// The first bytes as an array; missing ones (never, for whole voxels) are 0.
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            bytes.first_chunk().copied().unwrap_or([0; N])
        }
        match self {
            Self::U8 => f64::from(u8::from_le_bytes(first(bytes))),
            Self::I8 => f64::from(i8::from_le_bytes(first(bytes))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes))),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes))),
            Self::U32 => f64::from(u32::from_le_bytes(first(bytes))),
            Self::I32 => f64::from(i32::from_le_bytes(first(bytes))),
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes))),
            Self::F64 => f64::from_le_bytes(first(bytes)),
        }
    }

    /// Puts a number into the bytes of one voxel, little-endian; whole ones are rounded and kept to what the type can hold.
    pub fn put(self, value: f64, out: &mut [u8]) {
        let whole = value.round();
        match self {
            Self::U8 => out.copy_from_slice(&(whole as u8).to_le_bytes()),
            Self::I8 => out.copy_from_slice(&(whole as i8).to_le_bytes()),
            Self::U16 => out.copy_from_slice(&(whole as u16).to_le_bytes()),
            Self::I16 => out.copy_from_slice(&(whole as i16).to_le_bytes()),
            Self::U32 => out.copy_from_slice(&(whole as u32).to_le_bytes()),
            Self::I32 => out.copy_from_slice(&(whole as i32).to_le_bytes()),
            Self::F32 => out.copy_from_slice(&(value as f32).to_le_bytes()),
            Self::F64 => out.copy_from_slice(&value.to_le_bytes()),
        }
    }

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }
}

impl fmt::Display for VoxelType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for VoxelType {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|t| t.name() == s)
            .ok_or_else(|| {
                let names = Self::ALL.map(Self::name).join(", ");
                format!("unknown voxel type '{s}'; expected one of {names}")
            })
    }
}

/// Type of a voxel in a store, in the RAM cache and in the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum StoredType {
    U8,
    U16,
    F32,
}

impl StoredType {
    /// Bytes per voxel.
    pub const fn size(self) -> usize {
        self.voxel_type().size()
    }

    /// The same type among [`VoxelType`]s.
    pub const fn voxel_type(self) -> VoxelType {
        match self {
            Self::U8 => VoxelType::U8,
            Self::U16 => VoxelType::U16,
            Self::F32 => VoxelType::F32,
        }
    }
}

impl fmt::Display for StoredType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.voxel_type().name())
    }
}
