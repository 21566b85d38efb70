//! Element types and fill values as Zarr writes them.

use serde_json::Value;

use crate::input::chunked::json;
use crate::input::problem::{Subject, quoted};
use crate::volume::{SourceError, VoxelType};

/// Types that voxels can have, for messages.
const SUPPORTED: &str = "supported are integers of 8, 16 and 32 bits and floats of 32 and 64; convert the array to one of these";

/// The type that format 3 calls `name`.
pub(in crate::input) fn by_name(
    subject: &Subject<'_>,
    name: &str,
) -> Result<VoxelType, SourceError> {
    Ok(match name {
        "uint8" => VoxelType::U8,
        "int8" => VoxelType::I8,
        "uint16" => VoxelType::U16,
        "int16" => VoxelType::I16,
        "uint32" => VoxelType::U32,
        "int32" => VoxelType::I32,
        "float32" => VoxelType::F32,
        "float64" => VoxelType::F64,
        _ => return Err(unsupported(subject, name)),
    })
}

/// The type and byte order (big-endian or not) of a NumPy type such as `<u2`, as format 2 writes it.
pub(super) fn by_numpy(
    subject: &Subject<'_>,
    dtype: &str,
) -> Result<(VoxelType, bool), SourceError> {
    let (order, name) = match dtype.split_at_checked(1) {
        Some(parts @ ("<" | ">" | "|" | "=", _)) => parts,
        _ => ("|", dtype),
    };
    let voxel_type = match name {
        "u1" => VoxelType::U8,
        "i1" => VoxelType::I8,
        "u2" => VoxelType::U16,
        "i2" => VoxelType::I16,
        "u4" => VoxelType::U32,
        "i4" => VoxelType::I32,
        "f4" => VoxelType::F32,
        "f8" => VoxelType::F64,
        _ => return Err(unsupported(subject, dtype)),
    };
    Ok((voxel_type, order == ">"))
}

/// Voxels of a type that can't be shown.
pub(super) fn unsupported(subject: &Subject<'_>, name: &str) -> SourceError {
    subject.unsupported(format!("an array of type {}", quoted(name)), SUPPORTED)
}

/// The fill value in metadata as an element, little-endian; nothing is 0.
///
/// # Errors
/// It is no value of that type.
pub(super) fn fill(
    subject: &Subject<'_>,
    voxel_type: VoxelType,
    value: &Value,
) -> Result<[u8; 8], SourceError> {
    let mut out = [0; 8];
    let size = voxel_type.size();
    let wrong = || {
        json::wrong(
            subject,
            "fill_value",
            &format!("a value of {voxel_type}"),
            value,
        )
    };
    if value.is_null() {
        return Ok(out);
    }
    let text = value.as_str();
    if let Some(digits) = text.and_then(|t| t.strip_prefix("0x")) {
        let bits = u64::from_str_radix(digits, 16).map_err(|_| wrong())?;
        if size < 8 && bits >> (8 * size) != 0 {
            return Err(wrong());
        }
        out[..size].copy_from_slice(&bits.to_le_bytes()[..size]);
        return Ok(out);
    }
    let number = match text {
        Some("NaN") => f64::NAN,
        Some("Infinity") => f64::INFINITY,
        Some("-Infinity") => f64::NEG_INFINITY,
        Some(_) => return Err(wrong()),
        // Some writers say false for 0.
        None => match value.as_bool() {
            Some(set) => f64::from(u8::from(set)),
            None => value.as_f64().ok_or_else(wrong)?,
        },
    };
    // Every integer of 32 bits is exact as a float of 64: what does not come back is no value of the type.
    macro_rules! integer {
        ($t:ty) => {{
            let whole = number as $t;
            if f64::from(whole) != number {
                return Err(wrong());
            }
            out[..size].copy_from_slice(&whole.to_le_bytes());
        }};
    }
    match voxel_type {
        VoxelType::U8 => integer!(u8),
        VoxelType::I8 => integer!(i8),
        VoxelType::U16 => integer!(u16),
        VoxelType::I16 => integer!(i16),
        VoxelType::U32 => integer!(u32),
        VoxelType::I32 => integer!(i32),
        VoxelType::F32 => out[..4].copy_from_slice(&(number as f32).to_le_bytes()),
        VoxelType::F64 => out.copy_from_slice(&number.to_le_bytes()),
    }
    Ok(out)
}
