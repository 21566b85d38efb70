//! Which of a VTK image's arrays is its volume, and what the XML says of it. Where the numbers are is known here, not what
//! they are.

use std::ops::Range;

use roxmltree::Node;

use super::super::options::OpenOptions;
use super::super::problem::{Subject, quoted};
use super::SUPPORTED;
use super::markup::Markup;
use crate::volume::{SourceError, VoxelType};

/// The array to read.
pub(super) struct Array {
    pub(super) voxel_type: VoxelType,
    pub(super) place: Place,
    /// Its values belong to the cells between the points.
    pub(super) is_cells: bool,
}

/// Where an array's values are.
pub(super) enum Place {
    /// As text, in these bytes of the file.
    Numbers(Range<u64>),
    /// As base64, in these bytes of the file.
    Inline(Range<u64>),
    /// This far behind the start of the appended data.
    Appended(u64),
}

/// The array of `piece` that the user or the file names, or the only one.
///
/// # Errors
/// There is none, or several of which none is named, or it is none that can be a volume.
pub(super) fn choose(
    subject: &Subject<'_>,
    piece: Node<'_, '_>,
    markup: &Markup,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Array, SourceError> {
    let subject = &Subject {
        remedy: "choose an array with --dataset NAME",
        ..*subject
    };
    let points = Group::of(piece, "PointData");
    let cells = Group::of(piece, "CellData");
    let named = |name: &str| {
        let found = points.named(name).map(|a| (a, false));
        found.or_else(|| cells.named(name).map(|a| (a, true)))
    };
    let names = || {
        let all: Vec<_> = points.arrays.iter().chain(&cells.arrays).collect();
        all.iter()
            .map(|a| quoted(name_of(a)))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let (array, is_cells) = match &options.dataset {
        Some(name) => named(name).ok_or_else(|| {
            let expected = format!("one of the arrays {}", names());
            subject.malformed("--dataset", expected, quoted(name))
        })?,
        None => {
            // Values at cells are the second choice: they lie half a voxel beside the image's own places.
            let is_cells = points.arrays.is_empty();
            let group = if is_cells { &cells } else { &points };
            match (group.active(), group.arrays.as_slice()) {
                (_, []) => {
                    return Err(subject.malformed(
                        "PointData",
                        "an array of voxels",
                        "none there nor in CellData",
                    ));
                }
                (_, [only]) => (*only, is_cells),
                (Some(active), _) => {
                    notes.push(format!(
                        "Of the arrays {} the active one, {}, is read; --dataset NAME chooses another.",
                        names(),
                        quoted(name_of(&active))
                    ));
                    (active, is_cells)
                }
                (None, _) => {
                    let expected =
                        "the name of the array to read, since none is marked as the active one";
                    return Err(subject.malformed("PointData", expected, names()));
                }
            }
        }
    };
    if is_cells {
        notes.push(
            "The values belong to cells: each is taken as a voxel in the middle of its cell."
                .to_owned(),
        );
    }
    Ok(Array {
        voxel_type: voxel_type(subject, array)?,
        place: place(subject, array, markup)?,
        is_cells,
    })
}

/// The arrays of the points or of the cells.
struct Group<'a, 'x> {
    arrays: Vec<Node<'a, 'x>>,
    scalars: Option<&'a str>,
}

impl<'a, 'x> Group<'a, 'x> {
    fn of(piece: Node<'a, 'x>, tag: &str) -> Self {
        let group = piece.children().find(|n| n.has_tag_name(tag));
        Self {
            arrays: group
                .into_iter()
                .flat_map(|g| g.children())
                .filter(|n| n.has_tag_name("DataArray"))
                .collect(),
            scalars: group.and_then(|g| g.attribute("Scalars")),
        }
    }

    fn named(&self, name: &str) -> Option<Node<'a, 'x>> {
        self.arrays.iter().copied().find(|a| name_of(a) == name)
    }

    fn active(&self) -> Option<Node<'a, 'x>> {
        self.named(self.scalars?)
    }
}

fn name_of<'a>(array: &Node<'a, '_>) -> &'a str {
    array.attribute("Name").unwrap_or_default()
}

fn voxel_type(subject: &Subject<'_>, array: Node<'_, '_>) -> Result<VoxelType, SourceError> {
    let name = name_of(&array);
    let components = array.attribute("NumberOfComponents").unwrap_or("1");
    match components.trim().parse::<u64>() {
        Ok(0 | 1) => {}
        Ok(n) => {
            let what = format!("array {} of {n} components per voxel", quoted(name));
            return Err(subject.unsupported(what, SUPPORTED));
        }
        Err(_) => {
            return Err(subject.malformed(
                "NumberOfComponents",
                "a whole number",
                quoted(components),
            ));
        }
    }
    let code = array.attribute("type").unwrap_or_default();
    Ok(match code {
        "Int8" => VoxelType::I8,
        "UInt8" => VoxelType::U8,
        "Int16" => VoxelType::I16,
        "UInt16" => VoxelType::U16,
        "Int32" => VoxelType::I32,
        "UInt32" => VoxelType::U32,
        "Float32" => VoxelType::F32,
        "Float64" => VoxelType::F64,
        "Int64" | "UInt64" | "String" | "Bit" => {
            let what = format!("array {} of type {code}", quoted(name));
            return Err(subject.unsupported(what, SUPPORTED));
        }
        _ => {
            let place = format!("the type of array {}", quoted(name));
            return Err(subject.malformed(
                place,
                "Int8 to UInt32, Float32 or Float64",
                quoted(code),
            ));
        }
    })
}

fn place(
    subject: &Subject<'_>,
    array: Node<'_, '_>,
    markup: &Markup,
) -> Result<Place, SourceError> {
    let format = array.attribute("format").unwrap_or("ascii");
    match format {
        "ascii" => Ok(Place::Numbers(text_of(array, markup))),
        "binary" => Ok(Place::Inline(text_of(array, markup))),
        "appended" => {
            let offset = array.attribute("offset").unwrap_or_default();
            let parsed = offset.trim().parse().map_err(|_| {
                let place = format!("the offset of array {}", quoted(name_of(&array)));
                subject.malformed(place, "a whole number of bytes", quoted(offset))
            })?;
            Ok(Place::Appended(parsed))
        }
        _ => {
            let place = format!("the format of array {}", quoted(name_of(&array)));
            Err(subject.malformed(place, "ascii, binary or appended", quoted(format)))
        }
    }
}

/// The array's own text, not that of elements in it: the longest one, since others are white space.
fn text_of(array: Node<'_, '_>, markup: &Markup) -> Range<u64> {
    let inner: Vec<_> = array
        .children()
        .filter(|n| n.is_element())
        .map(|n| n.range())
        .collect();
    markup
        .texts_in(array.range())
        .filter(|(at, _)| !inner.iter().any(|r| r.start < *at && *at < r.end))
        .map(|(_, text)| text)
        .max_by_key(|text| text.end - text.start)
        .unwrap_or(0..0)
}
