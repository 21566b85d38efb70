//! [`VoxelFile`]: the voxels of one file whose header has been understood, as a [`VoxelSource`].
//!
//! Knows no format: a reader gives it the description, the byte order and where the voxels start. Uncompressed voxels are
//! fetched by positional reads in any order; compressed ones once, slice after slice. Memory held is a read buffer.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use glam::U64Vec3;

use super::problem::Subject;
use super::raw::Endian;
use super::stream::{Compression, most_inflated_bytes};
use crate::geom::VoxelBox;
use crate::volume::{ReadOrder, SourceError, VolumeDesc, VoxelSource, check_read};

/// How much may follow the last voxel of a compressed stream and still be read, to reach and check its checksum.
const TAIL_BYTES: u64 = 1 << 20;

/// A volume in a file: header understood, voxels still on disk.
pub struct VoxelFile {
    desc: VolumeDesc,
    path: PathBuf,
    endian: Endian,
    voxels: Voxels,
    notes: Vec<String>,
}

enum Voxels {
    Plain {
        file: File,
        start: u64,
    },
    Stream {
        reader: Box<dyn Read + Send>,
        compression: Compression,
        /// Decompressed bytes that were skipped before the first voxel.
        skipped: u64,
        next_z: u64,
    },
}

/// Bytes of all voxels; a header that asks for more than 2⁶⁴ is refused.
pub(super) fn voxel_bytes(subject: &Subject<'_>, desc: &VolumeDesc) -> Result<u64, SourceError> {
    desc.byte_count().ok_or_else(|| {
        subject.malformed(
            "the sizes of the axes",
            "a volume of less than 2^64 bytes",
            sizes(desc),
        )
    })
}

fn sizes(desc: &VolumeDesc) -> String {
    let d = desc.dims;
    format!("{} × {} × {} voxels of {}", d.x, d.y, d.z, desc.voxel_type)
}

impl VoxelFile {
    /// Voxels that lie uncompressed in `file` from byte `start` on.
    ///
    /// # Errors
    /// The file is too short for them.
    pub(super) fn plain(
        subject: &Subject<'_>,
        desc: VolumeDesc,
        endian: Endian,
        file: File,
        start: u64,
    ) -> Result<Self, SourceError> {
        let len = file
            .metadata()
            .map_err(|e| subject.io("read its length", e))?
            .len();
        let bytes = voxel_bytes(subject, &desc)?;
        if start.checked_add(bytes).is_none_or(|end| end > len) {
            return Err(subject.malformed(
                "the voxels",
                format!("{bytes} bytes from byte {start} on, for {}", sizes(&desc)),
                format!("a file of {len} bytes"),
            ));
        }
        Ok(Self {
            desc,
            path: subject.path.to_owned(),
            endian,
            voxels: Voxels::Plain { file, start },
            notes: Vec::new(),
        })
    }

    /// Voxels that come next out of `reader`, the decompressed bytes of a file of `compressed_bytes`.
    ///
    /// # Errors
    /// No compressed stream of that length can hold them.
    pub(super) fn stream(
        subject: &Subject<'_>,
        desc: VolumeDesc,
        endian: Endian,
        compressed_bytes: u64,
        (reader, compression): (Box<dyn Read + Send>, Compression),
    ) -> Result<Self, SourceError> {
        let bytes = voxel_bytes(subject, &desc)?;
        let most = most_inflated_bytes(compressed_bytes);
        if bytes > most {
            return Err(subject.malformed(
                "the voxels",
                format!("{bytes} bytes, for {}", sizes(&desc)),
                format!(
                    "{compressed_bytes} bytes of {}, which cannot decompress to more than {most}",
                    compression.name()
                ),
            ));
        }
        Ok(Self {
            desc,
            path: subject.path.to_owned(),
            endian,
            voxels: Voxels::Stream {
                reader,
                compression,
                skipped: 0,
                next_z: 0,
            },
            notes: Vec::new(),
        })
    }

    /// A stream of which `bytes` bytes were skipped before it was given: what tells one volume in a file from another.
    pub(super) fn behind(mut self, bytes: u64) -> Self {
        if let Voxels::Stream { skipped, .. } = &mut self.voxels {
            *skipped = bytes;
        }
        self
    }

    /// With remarks for the user, as [`VoxelSource::notes`].
    pub(super) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }
}

impl VoxelSource for VoxelFile {
    fn desc(&self) -> &VolumeDesc {
        &self.desc
    }

    fn order(&self) -> ReadOrder {
        match self.voxels {
            Voxels::Plain { .. } => ReadOrder::Random,
            Voxels::Stream { .. } => ReadOrder::ForwardZ,
        }
    }

    fn read_box(&mut self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let dims = self.desc.dims;
        let size = self.desc.voxel_type.size();
        check_read(&self.desc, voxels, out);
        if out.is_empty() {
            return Ok(());
        }
        let subject = Subject::new(&self.path);
        match &mut self.voxels {
            Voxels::Plain { file, start } => {
                read_plain(&subject, (file, *start), &self.desc, voxels, out)?;
            }
            Voxels::Stream {
                reader,
                compression,
                next_z,
                ..
            } => {
                let whole_slices = voxels.min.truncate() == glam::U64Vec2::ZERO
                    && voxels.max.truncate() == dims.truncate();
                assert!(
                    whole_slices && voxels.min.z == *next_z,
                    "a compressed stream is read in whole slices, each once, in order"
                );
                let slice_bytes = out.len() as u64 / (voxels.max.z - voxels.min.z);
                let before = *next_z * slice_bytes;
                let fail = Failing {
                    subject,
                    compression: *compression,
                    slice_bytes,
                    dims,
                };
                fill(reader, out).map_err(|(n, e)| fail.at(before + n, e))?;
                *next_z = voxels.max.z;
                if *next_z == dims.z {
                    // The checksum stands behind the last byte: without this a damaged file would pass.
                    io::copy(&mut reader.by_ref().take(TAIL_BYTES), &mut io::sink())
                        .map_err(|e| fail.at(before + out.len() as u64, e))?;
                }
            }
        }
        if self.endian == Endian::Big {
            swap_bytes(out, size);
        }
        Ok(())
    }

    fn stamp(&self) -> String {
        let place = match &self.voxels {
            Voxels::Plain { start, .. } => format!("from byte {start} on"),
            Voxels::Stream {
                compression,
                skipped,
                ..
            } => format!("{} from byte {skipped} on", compression.name()),
        };
        let endian = self.endian;
        format!("{}, {place}, {endian:?}", file_stamp(&self.path))
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}

/// Length and time of the last change of a file, in words, as [`VoxelSource::stamp`] is to tell them.
pub(super) fn file_stamp(path: &Path) -> String {
    let Ok(info) = std::fs::metadata(path) else {
        return "gone".to_owned();
    };
    let changed = info
        .modified()
        .ok()
        .and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok())
        .unwrap_or_default();
    format!(
        "{} bytes, changed at {}.{:09} (Unix time)",
        info.len(),
        changed.as_secs(),
        changed.subsec_nanos(),
    )
}

/// Reads the rows of `voxels`, as few and long reads as the box allows.
fn read_plain(
    subject: &Subject<'_>,
    (file, start): (&File, u64),
    desc: &VolumeDesc,
    voxels: VoxelBox,
    out: &mut [u8],
) -> Result<(), SourceError> {
    let dims = desc.dims;
    let box_size = voxels.size();
    let size = desc.voxel_type.size() as u64;
    let full_rows = box_size.x == dims.x;
    // Voxels that lie one after another in the file: a run of x, of whole rows, or of whole slices.
    let run = if full_rows && box_size.y == dims.y {
        box_size
    } else if full_rows {
        U64Vec3::new(box_size.x, box_size.y, 1)
    } else {
        U64Vec3::new(box_size.x, 1, 1)
    };
    let run_bytes = out.len() / (box_size.y / run.y * (box_size.z / run.z)) as usize;
    let mut runs = out.chunks_exact_mut(run_bytes);
    for z in (voxels.min.z..voxels.max.z).step_by(run.z as usize) {
        for y in (voxels.min.y..voxels.max.y).step_by(run.y as usize) {
            let Some(bytes) = runs.next() else { break };
            // The whole volume's bytes fit u64 and the file (checked when it was opened), so this cannot overflow.
            let at = start + ((z * dims.y + y) * dims.x + voxels.min.x) * size;
            read_exact_at(file, bytes, at).map_err(|e| {
                if e.kind() == io::ErrorKind::UnexpectedEof {
                    subject.malformed(
                        format!("slice {z}, byte {at}"),
                        format!("{run_bytes} more bytes of voxels"),
                        "the end of the file, which has become shorter since it was opened",
                    )
                } else {
                    subject.io(format!("read at byte {at}"), e)
                }
            })?;
        }
    }
    if full_rows && box_size.y == dims.y {
        // Whoever reads whole slices goes on with the next ones: the disk is not to wait until then.
        read_ahead(
            file,
            start + voxels.max.z * dims.y * dims.x * size,
            out.len(),
        );
    }
    Ok(())
}

/// Tells the system that `len` bytes from `at` on will be read soon. Best effort: no answer, no error.
fn read_ahead(file: &File, at: u64, len: usize) {
    #[cfg(target_os = "linux")]
    {
        let len = std::num::NonZeroU64::new(len as u64);
        // A refused hint costs only time.
        let _ = rustix::fs::fadvise(file, at, len, rustix::fs::Advice::WillNeed);
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (file, at, len);
}

/// Fills `out` from byte `at` on, without a place in the file that threads would have to share.
#[cfg(unix)]
pub(super) fn read_exact_at(file: &File, out: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, out, at)
}

/// Fills `out` from byte `at` on, without a place in the file that threads would have to share.
#[cfg(windows)]
pub(super) fn read_exact_at(file: &File, mut out: &mut [u8], mut at: u64) -> io::Result<()> {
    while !out.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, out, at) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                out = &mut out[n..];
                at += n as u64;
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Fills `out`; on failure tells how many bytes had come before.
fn fill(reader: &mut dyn Read, out: &mut [u8]) -> Result<(), (u64, io::Error)> {
    let mut done = 0;
    while done < out.len() {
        match reader.read(&mut out[done..]) {
            Ok(0) => return Err((done as u64, io::ErrorKind::UnexpectedEof.into())),
            Ok(n) => done += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err((done as u64, e)),
        }
    }
    Ok(())
}

/// What is needed to say where a compressed stream failed.
struct Failing<'a> {
    subject: Subject<'a>,
    compression: Compression,
    slice_bytes: u64,
    dims: U64Vec3,
}

impl Failing<'_> {
    /// The error for a stream that failed after `byte` bytes of voxels.
    fn at(&self, byte: u64, error: io::Error) -> SourceError {
        let Self {
            subject,
            compression,
            slice_bytes,
            dims,
        } = self;
        let name = compression.name();
        let place = if byte == slice_bytes * dims.z {
            "the end of the compressed voxels".to_owned()
        } else {
            let z = byte / slice_bytes;
            format!(
                "slice {z} of {}, byte {byte} of the decompressed voxels",
                dims.z
            )
        };
        match error.kind() {
            io::ErrorKind::UnexpectedEof => subject.malformed(
                place,
                format!(
                    "a complete {name} stream of {} bytes of voxels",
                    slice_bytes * dims.z
                ),
                "the end of the stream",
            ),
            io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => {
                subject.malformed(place, format!("a sound {name} stream"), error.to_string())
            }
            _ => subject.io(format!("read {place}"), error),
        }
    }
}

/// Reverses the bytes of every voxel of `size` bytes.
pub(super) fn swap_bytes(bytes: &mut [u8], size: usize) {
    match size {
        2 => bytes
            .as_chunks_mut()
            .0
            .iter_mut()
            .for_each(|v: &mut [u8; 2]| v.reverse()),
        4 => bytes
            .as_chunks_mut()
            .0
            .iter_mut()
            .for_each(|v: &mut [u8; 4]| v.reverse()),
        8 => bytes
            .as_chunks_mut()
            .0
            .iter_mut()
            .for_each(|v: &mut [u8; 8]| v.reverse()),
        _ => {}
    }
}
