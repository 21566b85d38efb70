//! VTK XML image data (`.vti`): one image in one piece, of which one array of points or cells is the volume.
//!
//! Voxels may be appended or inline, bare, in base64 or as numbers, in zlib or LZ4 blocks or not compressed. World is the
//! image's own space, in millimetres: VTK says nothing of patients. Not here: several pieces, arrays of several components,
//! 64-bit integers, LZMA; each is refused by name.

mod arrays;
mod blocks;
mod markup;
mod numbers;
mod regions;

use std::fs::File;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3, I64Vec3, U64Vec3};
use roxmltree::{Document, Node, ParsingOptions};

use self::arrays::{Array, Place};
use self::blocks::{Blocks, Codec, Table};
use self::numbers::Numbers;
use self::regions::{Encoding, Region};
use super::options::OpenOptions;
use super::problem::{Subject, quoted};
use super::raw::Endian;
use super::voxel_file::{VoxelFile, read_exact_at, voxel_bytes};
use super::{affine, choice};
use crate::volume::{Rescale, SourceError, VolumeDesc, VoxelSource};

const SUPPORTED: &str = "supported are VTK XML images (.vti) in one piece, an array (--dataset NAME) of one component of \
                         integers up to 32 bits, Float32 or Float64, not compressed or by vtkZLibDataCompressor or vtkLZ4DataCompressor";

/// Elements and attributes that the XML may have.
const MOST_NODES: u32 = 1 << 16;

/// Words of 4 or 8 bytes before the sizes of compressed blocks: how many, bytes of each, bytes of the last.
const WORDS_BEFORE_SIZES: u64 = 3;

/// Words of a table that are read at once.
const WORDS_AT_ONCE: u64 = 64 << 10;

/// True when `bytes`, the first ones of a file, are VTK XML.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    text.trim_ascii_start().starts_with(b"<") && text.windows(8).any(|w| w == b"<VTKFile")
}

/// Opens a VTK image.
///
/// # Errors
/// The file can't be read, is wrong, holds something that is not built, or several arrays of which `options` choose none.
pub(super) fn open(
    path: &Path,
    options: &OpenOptions,
) -> Result<Box<dyn VoxelSource>, SourceError> {
    let subject = Subject::new(path);
    let (file, len) = subject.open()?;
    let markup = markup::read(&subject, &file)?;
    let parsing = ParsingOptions {
        nodes_limit: MOST_NODES,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(&markup.xml, parsing)
        .map_err(|e| subject.malformed("the VTK XML", "well-formed XML", quoted(&e.to_string())))?;
    let root = document.root_element();
    let image = image(&subject, root)?;
    let piece = piece(&subject, image)?;
    choice::time(&subject, options, 1)?;
    choice::channel(&subject, options, 1)?;

    let mut notes = vec![
        "VTK images say nothing of units and patients: their lengths are taken as millimetres, their axes as those of the \
         world."
            .to_owned(),
    ];
    let array = arrays::choose(&subject, piece, &markup, options, &mut notes)?;
    let (dims, world_from_index) = space(&subject, image, array.is_cells)?;
    let desc = VolumeDesc {
        dims,
        voxel_type: array.voxel_type,
        world_from_index,
        rescale: Rescale::IDENTITY,
        unit: String::new(),
        name: subject.name(),
    };
    let writing = Writing::of(&subject, root)?;
    let Array { place, .. } = array;
    if let Place::Numbers(text) = place {
        return Ok(Box::new(Numbers::open(&subject, desc, file, text, notes)?));
    }
    let data = region(&subject, root, file, len, (&place, markup.appended))?;
    writing.open(&subject, desc, data, notes)
}

/// The element of the image.
fn image<'a, 'x>(subject: &Subject<'_>, root: Node<'a, 'x>) -> Result<Node<'a, 'x>, SourceError> {
    if !root.has_tag_name("VTKFile") {
        let found = quoted(root.tag_name().name());
        return Err(subject.malformed("the VTK XML", "the element VTKFile", found));
    }
    let kind = root.attribute("type").unwrap_or_default();
    if kind != "ImageData" {
        let what = format!("VTK XML of type {}", quoted(kind));
        return Err(subject.unsupported(what, SUPPORTED));
    }
    child(subject, root, "ImageData")
}

/// The only piece, which is the whole image.
fn piece<'a, 'x>(subject: &Subject<'_>, image: Node<'a, 'x>) -> Result<Node<'a, 'x>, SourceError> {
    let pieces = image.children().filter(|n| n.has_tag_name("Piece")).count();
    if pieces > 1 {
        return Err(subject.unsupported(format!("an image in {pieces} pieces"), SUPPORTED));
    }
    let piece = child(subject, image, "Piece")?;
    let (whole, part) = (image.attribute("WholeExtent"), piece.attribute("Extent"));
    if part.is_some() && extent(subject, whole)? != extent(subject, part)? {
        return Err(subject.unsupported(
            format!(
                "a piece {} of an image {}",
                quoted(part.unwrap_or_default()),
                quoted(whole.unwrap_or_default())
            ),
            SUPPORTED,
        ));
    }
    Ok(piece)
}

fn child<'a, 'x>(
    subject: &Subject<'_>,
    parent: Node<'a, 'x>,
    name: &str,
) -> Result<Node<'a, 'x>, SourceError> {
    parent
        .children()
        .find(|n| n.has_tag_name(name))
        .ok_or_else(|| {
            let place = format!("element {}", parent.tag_name().name());
            subject.malformed(place, format!("an element {name} in it"), "none")
        })
}

/// First and last point per axis.
fn extent(subject: &Subject<'_>, value: Option<&str>) -> Result<(I64Vec3, I64Vec3), SourceError> {
    let value = value.unwrap_or_default();
    let numbers: Option<Vec<i64>> = value.split_whitespace().map(|p| p.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x0, x1, y0, y1, z0, z1]) if x0 <= x1 && y0 <= y1 && z0 <= z1 => {
            Ok((I64Vec3::new(x0, y0, z0), I64Vec3::new(x1, y1, z1)))
        }
        _ => {
            let expected = "first and last index of x, y and z, in rising order";
            Err(subject.malformed("WholeExtent", expected, quoted(value)))
        }
    }
}

/// `N` numbers of an attribute, or `default` when it is not there.
fn reals<const N: usize>(
    subject: &Subject<'_>,
    node: Node<'_, '_>,
    name: &str,
    default: [f64; N],
) -> Result<[f64; N], SourceError> {
    let Some(value) = node.attribute(name) else {
        return Ok(default);
    };
    let numbers: Option<Vec<f64>> = value.split_whitespace().map(|p| p.parse().ok()).collect();
    numbers
        .and_then(|v| v.try_into().ok())
        .ok_or_else(|| subject.malformed(name, format!("{N} numbers"), quoted(value)))
}

/// Sizes and place of the image's points, or of its cells: one less per axis, and half a point further.
fn space(
    subject: &Subject<'_>,
    image: Node<'_, '_>,
    is_cells: bool,
) -> Result<(U64Vec3, DAffine3), SourceError> {
    let (first, last) = extent(subject, image.attribute("WholeExtent"))?;
    let origin = DVec3::from_array(reals(subject, image, "Origin", [0.0; 3])?);
    let spacing = DVec3::from_array(reals(subject, image, "Spacing", [1.0; 3])?);
    let rows = reals(
        subject,
        image,
        "Direction",
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    )?;
    let mut dims = U64Vec3::ONE;
    let mut at = first.as_dvec3();
    for i in 0..3 {
        let steps = last[i].abs_diff(first[i]);
        dims[i] = if is_cells {
            // An image of one slice has one layer of cells, in the slice.
            steps.max(1)
        } else {
            steps.saturating_add(1)
        };
        if is_cells && steps > 0 {
            at[i] += 0.5;
        }
    }
    let matrix = DMat3::from_cols_array(&rows).transpose() * DMat3::from_diagonal(spacing);
    let affine = DAffine3::from_mat3_translation(matrix, origin + matrix * at);
    let affine = affine::checked(subject, "Origin, Spacing and Direction", affine)?;
    Ok((dims, affine))
}

/// The part of the file where an array's bytes are, from its first one to where they must end at the latest.
fn region(
    subject: &Subject<'_>,
    root: Node<'_, '_>,
    file: File,
    len: u64,
    (place, appended): (&Place, Option<u64>),
) -> Result<Region, SourceError> {
    let (encoding, start, end) = match place {
        Place::Numbers(text) | Place::Inline(text) => {
            let start = skip_space(subject, &file, text.clone())?;
            (Encoding::Base64, start, text.end)
        }
        Place::Appended(offset) => {
            let element = child(subject, root, "AppendedData")?;
            let encoding = match element.attribute("encoding") {
                Some("raw") => Encoding::Raw,
                None | Some("base64") => Encoding::Base64,
                Some(other) => {
                    let expected = "the encoding raw or base64";
                    return Err(subject.malformed("AppendedData", expected, quoted(other)));
                }
            };
            let start = appended.and_then(|a| a.checked_add(*offset));
            let start = start.filter(|&s| s < len).ok_or_else(|| {
                let found = format!("a file of {len} bytes");
                let expected = format!("data {offset} bytes behind its '_'");
                subject.malformed("AppendedData", expected, found)
            })?;
            (encoding, start, len)
        }
    };
    Ok(Region {
        file,
        encoding,
        start,
        end,
    })
}

/// The first byte of `text` that is no white space.
fn skip_space(
    subject: &Subject<'_>,
    file: &File,
    text: std::ops::Range<u64>,
) -> Result<u64, SourceError> {
    let mut at = text.start;
    let mut bytes = [0; 256];
    while at < text.end {
        let n = (text.end - at).min(bytes.len() as u64) as usize;
        read_exact_at(file, &mut bytes[..n], at)
            .map_err(|e| subject.io(format!("read at byte {at}"), e))?;
        match bytes[..n].iter().position(|b| !b.is_ascii_whitespace()) {
            Some(i) => return Ok(at + i as u64),
            None => at += n as u64,
        }
    }
    Ok(text.end)
}

/// How the file's arrays are written.
struct Writing {
    endian: Endian,
    /// Bytes of the numbers before an array.
    word: u64,
    codec: Codec,
}

impl Writing {
    fn of(subject: &Subject<'_>, root: Node<'_, '_>) -> Result<Self, SourceError> {
        let endian = match root.attribute("byte_order") {
            Some("LittleEndian") | None => Endian::Little,
            Some("BigEndian") => Endian::Big,
            Some(other) => {
                let expected = "LittleEndian or BigEndian";
                return Err(subject.malformed("byte_order", expected, quoted(other)));
            }
        };
        let word = match root.attribute("header_type") {
            Some("UInt32") | None => 4,
            Some("UInt64") => 8,
            Some(other) => {
                return Err(subject.malformed("header_type", "UInt32 or UInt64", quoted(other)));
            }
        };
        let codec = match root.attribute("compressor") {
            None | Some("") => Codec::None,
            Some("vtkZLibDataCompressor") => Codec::Zlib,
            Some("vtkLZ4DataCompressor") => Codec::Lz4,
            Some(other) => {
                let what = format!("the compressor {}", quoted(other));
                return Err(subject.unsupported(what, SUPPORTED));
            }
        };
        Ok(Self {
            endian,
            word,
            codec,
        })
    }

    /// The voxels of `desc` in `data`.
    fn open(
        &self,
        subject: &Subject<'_>,
        desc: VolumeDesc,
        data: Region,
        notes: Vec<String>,
    ) -> Result<Box<dyn VoxelSource>, SourceError> {
        let bytes = voxel_bytes(subject, &desc)?;
        let (data, table) = if self.codec == Codec::None {
            let (data, first) = self.plain(subject, data, bytes)?;
            if data.encoding == Encoding::Raw {
                let start = data.start + first;
                let file = VoxelFile::plain(subject, desc, self.endian, data.file, start)?;
                return Ok(Box::new(file.with_notes(notes)));
            }
            (data, Table::plain(first, bytes))
        } else {
            self.compressed(subject, data, bytes)?
        };
        if !table.end().is_some_and(|end| data.holds(end)) {
            let found = format!(
                "data that lie between bytes {} and {}",
                data.start, data.end
            );
            return Err(subject.malformed("the voxels", format!("{bytes} bytes"), found));
        }
        let kind = (desc, self.endian);
        Ok(Box::new(Blocks::new(subject, kind, data, table, notes)))
    }

    /// Words `from..from + count` of `data`.
    fn words(
        &self,
        subject: &Subject<'_>,
        data: &Region,
        (from, count): (u64, u64),
    ) -> Result<Vec<u64>, SourceError> {
        let mut bytes = vec![0; (count * self.word) as usize];
        data.read(subject, from * self.word, &mut bytes)?;
        let words = bytes.chunks_exact(self.word as usize).map(|word| {
            let join = |n, b: &u8| n << 8 | u64::from(*b);
            match self.endian {
                Endian::Little => word.iter().rev().fold(0, join),
                Endian::Big => word.iter().fold(0, join),
            }
        });
        Ok(words.collect())
    }

    /// Data that are not compressed, and where in them the voxels start. One word before them says their length.
    fn plain(
        &self,
        subject: &Subject<'_>,
        mut data: Region,
        bytes: u64,
    ) -> Result<(Region, u64), SourceError> {
        let stated = self.words(subject, &data, (0, 1))?;
        if stated != [bytes] {
            let expected = format!("{bytes} bytes, for the image's size");
            let found = format!("{} bytes", stated.first().copied().unwrap_or(0));
            return Err(subject.malformed("the length before the voxels", expected, found));
        }
        if data.encoding == Encoding::Raw {
            return Ok((data, self.word));
        }
        // VTK writes the word and the voxels as one text. Others end the word's own with padding.
        let word_text = self.word.div_ceil(3) * 4;
        let padding = (3 - self.word % 3) as usize;
        let mut end = [0; 2];
        read_exact_at(
            &data.file,
            &mut end[..padding],
            data.start + word_text - padding as u64,
        )
        .map_err(|e| subject.io(format!("read at byte {}", data.start), e))?;
        if end[..padding].iter().all(|&b| b == b'=') {
            data.start += word_text;
            return Ok((data, 0));
        }
        Ok((data, self.word))
    }

    /// Data that are compressed, and the table of their blocks, which is before them.
    fn compressed(
        &self,
        subject: &Subject<'_>,
        mut data: Region,
        bytes: u64,
    ) -> Result<(Region, Table), SourceError> {
        let head = self.words(subject, &data, (0, WORDS_BEFORE_SIZES))?;
        let (count, block_bytes, last_bytes) = (head[0], head[1], head[2]);
        let total = match last_bytes {
            0 => count.checked_mul(block_bytes),
            _ => count
                .checked_sub(1)
                .and_then(|n| n.checked_mul(block_bytes)?.checked_add(last_bytes)),
        };
        if total != Some(bytes) || block_bytes == 0 || last_bytes > block_bytes {
            return Err(subject.malformed(
                "the sizes of the compressed blocks",
                format!("{bytes} bytes together, for the image's size"),
                format!("{count} blocks of {block_bytes} bytes, the last one of {last_bytes}"),
            ));
        }
        let words = count.checked_add(WORDS_BEFORE_SIZES);
        let table_bytes = words.and_then(|n| n.checked_mul(self.word));
        let Some(table_bytes) = table_bytes.filter(|&n| data.holds(n)) else {
            return Err(subject.malformed(
                "the number of compressed blocks",
                format!("a table within the {} bytes of data", data.end - data.start),
                format!("{count} blocks"),
            ));
        };
        let mut sizes = Vec::new();
        while (sizes.len() as u64) < count {
            let from = sizes.len() as u64;
            let n = (count - from).min(WORDS_AT_ONCE);
            sizes.extend(self.words(subject, &data, (WORDS_BEFORE_SIZES + from, n))?);
        }
        let table =
            Table::compressed(subject, self.codec, (block_bytes, bytes), sizes.into_iter())?;
        // In base64 the table is a text of its own.
        data.start += data.encoding.length_of(table_bytes).unwrap_or(0);
        Ok((data, table))
    }
}

#[cfg(test)]
mod tests;
