//! Where the fields of a NIfTI header are, in both versions and byte orders, and how they are read. ANALYZE 7.5 has
//! version 1's sizes, types, distances and offset at the same places.

use glam::{DVec3, U64Vec3};

use super::super::contents::Contents;
use super::super::problem::Subject;
use super::super::raw::Endian;
use crate::volume::SourceError;

/// A version of the header: where its fields are. Everything else is the same in both.
pub(in crate::input) struct Layout {
    /// Bytes of the header.
    pub(in crate::input) header_bytes: usize,
    /// Fields of 8 and 4 bytes where version 1 has 4 and 2.
    pub(in crate::input) wide: bool,
    pub(in crate::input) magic: usize,
    pub(in crate::input) dim: usize,
    pub(in crate::input) datatype: usize,
    pub(in crate::input) pixdim: usize,
    pub(in crate::input) vox_offset: usize,
    /// `scl_slope`, then `scl_inter`; in ANALYZE `funused1`.
    pub(in crate::input) scl: usize,
    pub(in crate::input) xyzt_units: usize,
    /// `qform_code`, then `sform_code`.
    pub(in crate::input) qform_code: usize,
    /// `quatern_b`, `c`, `d`, then `qoffset_x`, `y`, `z`.
    pub(in crate::input) quatern: usize,
    pub(in crate::input) srow: usize,
}

pub(in crate::input) const NIFTI_1: Layout = Layout {
    header_bytes: 348,
    wide: false,
    magic: 344,
    dim: 40,
    datatype: 70,
    pixdim: 76,
    vox_offset: 108,
    scl: 112,
    xyzt_units: 123,
    qform_code: 252,
    quatern: 256,
    srow: 280,
};

pub(in crate::input) const NIFTI_2: Layout = Layout {
    header_bytes: 540,
    wide: true,
    magic: 4,
    dim: 16,
    datatype: 12,
    pixdim: 104,
    vox_offset: 168,
    scl: 176,
    xyzt_units: 500,
    qform_code: 344,
    quatern: 352,
    srow: 400,
};

/// Which layout and byte order a header of at least 4 bytes has.
fn version(bytes: &[u8]) -> Option<(&'static Layout, Endian)> {
    let &first = bytes.first_chunk::<4>()?;
    for layout in [&NIFTI_1, &NIFTI_2] {
        let size = layout.header_bytes as u32;
        if u32::from_le_bytes(first) == size {
            return Some((layout, Endian::Little));
        }
        if u32::from_be_bytes(first) == size {
            return Some((layout, Endian::Big));
        }
    }
    None
}

/// True when `bytes`, the first ones of a (decompressed) file, can only be NIfTI or ANALYZE.
pub(in crate::input) fn is_header(bytes: &[u8]) -> bool {
    version(bytes).is_some()
}

/// A header's bytes with the layout and order to read them in.
pub(in crate::input) struct Fields<'a> {
    pub(in crate::input) bytes: &'a [u8],
    pub(in crate::input) layout: &'static Layout,
    pub(in crate::input) endian: Endian,
}

impl<'a> Fields<'a> {
    /// The fields of a header of a known version, whole.
    pub(in crate::input) fn of(bytes: &'a [u8]) -> Option<Self> {
        let (layout, endian) = version(bytes)?;
        (bytes.len() >= layout.header_bytes).then_some(Self {
            bytes,
            layout,
            endian,
        })
    }

    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut out = [0; N];
        out.copy_from_slice(&self.bytes[at..at + N]);
        if self.endian == Endian::Big {
            out.reverse();
        }
        out
    }

    /// The 16-bit integer at `at`.
    pub(in crate::input) fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.array(at))
    }

    /// The 32-bit integer at `at`.
    pub(in crate::input) fn i32(&self, at: usize) -> i64 {
        i64::from(i32::from_le_bytes(self.array(at)))
    }

    /// Element `i` of the integers at `at`: i16 in version 1, i64 in version 2.
    pub(in crate::input) fn int(&self, at: usize, i: usize) -> i64 {
        if self.layout.wide {
            i64::from_le_bytes(self.array(at + 8 * i))
        } else {
            i64::from(self.i16(at + 2 * i))
        }
    }

    /// Element `i` of the codes at `at`: i16 in version 1, i32 in version 2.
    pub(in crate::input) fn code(&self, at: usize, i: usize) -> i64 {
        if self.layout.wide {
            self.i32(at + 4 * i)
        } else {
            i64::from(self.i16(at + 2 * i))
        }
    }

    /// Element `i` of the numbers at `at`: f32 in version 1, f64 in version 2.
    pub(in crate::input) fn real(&self, at: usize, i: usize) -> f64 {
        if self.layout.wide {
            f64::from_le_bytes(self.array(at + 8 * i))
        } else {
            f64::from(f32::from_le_bytes(self.array(at + 4 * i)))
        }
    }

    /// The three numbers at `at`.
    pub(in crate::input) fn reals(&self, at: usize) -> DVec3 {
        DVec3::new(self.real(at, 0), self.real(at, 1), self.real(at, 2))
    }
}

/// How many voxels, points in time and channels a file has; each at least 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::input) struct Sizes {
    /// Voxels per axis of one volume.
    pub(in crate::input) dims: U64Vec3,
    /// Volumes in time (axis 4).
    pub(in crate::input) times: u64,
    /// Values per voxel (axis 5), each a volume in time by itself.
    pub(in crate::input) channels: u64,
}

impl Sizes {
    /// Where the volume of a channel and a point in time starts behind the first one's start, which is at byte `start`;
    /// `None` beyond `u64`.
    pub(in crate::input) fn volume_start(
        &self,
        start: u64,
        (time, channel): (u64, u64),
        volume_bytes: u64,
    ) -> Option<u64> {
        channel
            .checked_mul(self.times)?
            .checked_add(time)?
            .checked_mul(volume_bytes)?
            .checked_add(start)
    }
}

/// The sizes in `dim`. `supported` says what is, when there are more than five axes.
pub(in crate::input) fn sizes(
    subject: &Subject<'_>,
    f: &Fields<'_>,
    supported: &str,
) -> Result<Sizes, SourceError> {
    let at = f.layout.dim;
    let count = f.int(at, 0);
    if !(1..=7).contains(&count) {
        return Err(subject.malformed("dim[0]", "1 to 7 dimensions", count.to_string()));
    }
    let mut dims = [1u64; 8];
    for (i, dim) in dims.iter_mut().enumerate().skip(1).take(count as usize) {
        let n = f.int(at, i);
        *dim = u64::try_from(n).ok().filter(|&n| n > 0).ok_or_else(|| {
            subject.malformed(format!("dim[{i}]"), "a size of at least 1", n.to_string())
        })?;
    }
    if let Some(i) = (6..8).find(|&i| dims[i] > 1) {
        let what = format!("{i}-D data (dim[{i}] = {})", dims[i]);
        return Err(subject.unsupported(what, supported));
    }
    Ok(Sizes {
        dims: U64Vec3::new(dims[1], dims[2], dims[3]),
        times: dims[4],
        channels: dims[5],
    })
}

/// Reads the header's bytes; their number is that of a known version.
pub(in crate::input) fn read(
    subject: &Subject<'_>,
    contents: &mut Contents<'_>,
) -> Result<Vec<u8>, SourceError> {
    let mut header = Vec::with_capacity(NIFTI_2.header_bytes);
    contents.extend(&mut header, 4)?;
    let Some((layout, _)) = version(&header) else {
        return Err(subject.malformed(
            "sizeof_hdr",
            "348 (NIfTI-1) or 540 (NIfTI-2)",
            format!("bytes {header:?}"),
        ));
    };
    contents.extend(&mut header, layout.header_bytes)?;
    Ok(header)
}
