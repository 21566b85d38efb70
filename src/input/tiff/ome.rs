//! OME-XML, which OME-TIFF keeps in the description of the first page: sizes, which page is which plane, distances.

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use crate::input::options::OpenOptions;
use crate::input::problem::{Subject, quoted};
use crate::input::spacing::unit_mm;
use crate::volume::SourceError;

use super::layout::choose;

/// Elements that a document has at most, text included.
const MOST_NODES: u32 = 8 << 20;

/// Planes that an image has at most, as a file has pages.
const MOST_PLANES: u64 = 1 << 20;

/// One channel and point in time of an image.
#[derive(Debug)]
pub(super) struct Ome {
    pub(super) width: u64,
    pub(super) height: u64,
    /// The page of each slice.
    pub(super) pages: Vec<usize>,
    /// Distance of voxels along x, y and z in millimetres, as far as it is said.
    pub(super) spacing: [Option<f64>; 3],
    /// What was chosen among several volumes in the file, in words.
    pub(super) choice: String,
}

/// Understands OME-XML of a file that is the whole volume, and makes the choices of `options`.
///
/// # Errors
/// The XML is damaged, a plane is in no page or in another file, or there is a choice that was not made.
pub(super) fn parse(
    subject: &Subject<'_>,
    text: &str,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Ome, SourceError> {
    let document = document(subject, text)?;
    let image = Image::choose(subject, &document, options, notes)?;
    let [channels, slices, times] = [
        image.size("SizeC")?,
        image.size("SizeZ")?,
        image.size("SizeT")?,
    ];
    let channel = choose(subject, "channel", channels, options.channel, notes)?;
    let time = choose(subject, "time", times, options.time, notes)?;
    let planes = slices
        .checked_mul(channels)
        .and_then(|n| n.checked_mul(times))
        .filter(|&n| n <= MOST_PLANES);
    let Some(planes) = planes else {
        let found = format!("{slices} slices, {channels} channels, {times} points in time");
        return Err(image.malformed(
            "the sizes",
            &format!("at most {MOST_PLANES} planes"),
            &found,
        ));
    };
    let order = image.order()?;
    let sizes = order.map(|axis| match axis {
        'Z' => slices,
        'C' => channels,
        _ => times,
    });
    let wanted = |plane: u64| {
        let mut rest = plane;
        let [mut z, mut c, mut t] = [0; 3];
        for (axis, size) in order.into_iter().zip(sizes) {
            let index = rest % size;
            rest /= size;
            match axis {
                'Z' => z = index,
                'C' => c = index,
                _ => t = index,
            }
        }
        (c == channel && t == time).then_some(z as usize)
    };
    let mut pages = vec![Place::Nowhere; slices as usize];
    for (plane, place) in image.planes(planes, order, sizes)? {
        if let Some(z) = wanted(plane) {
            pages[z] = place;
        }
    }
    let pages = pages.into_iter().enumerate().map(|(z, place)| match place {
        Place::Page(page) => Ok(page),
        Place::Elsewhere(file) => Err(subject.unsupported(
            format!(
                "an OME-TIFF set of several files (slice {z} is in {})",
                quoted(&file)
            ),
            "supported are OME-TIFF files that hold all of a volume",
        )),
        Place::Nowhere => {
            let place = format!("slice {z}");
            Err(image.malformed(&place, "a TiffData element that tells its page", "none"))
        }
    });
    Ok(Ome {
        width: image.size("SizeX")?,
        height: image.size("SizeY")?,
        pages: pages.collect::<Result<_, _>>()?,
        spacing: image.spacing()?,
        choice: format!(", image {}, channel {channel}, time {time}", image.number),
    })
}

/// What OME-XML of a slice in a file of its own says of the distance of voxels.
///
/// # Errors
/// The XML is damaged, or the file is one of several with more than slices in them, `files` in number.
pub(super) fn of_slice(
    subject: &Subject<'_>,
    text: &str,
    files: usize,
) -> Result<[Option<f64>; 3], SourceError> {
    let document = document(subject, text)?;
    let image = Image::choose(subject, &document, &OpenOptions::default(), &mut Vec::new())?;
    let (channels, times) = (image.size("SizeC")?, image.size("SizeT")?);
    if (channels > 1 || times > 1) && image.size("SizeZ")? != files as u64 {
        return Err(subject.unsupported(
            format!(
                "an OME-TIFF set of {channels} channels and {times} points in time in {files} files"
            ),
            "name the files of one channel and one point in time by a glob",
        ));
    }
    image.spacing()
}

fn document<'a>(subject: &Subject<'_>, text: &'a str) -> Result<Document<'a>, SourceError> {
    let options = ParsingOptions {
        allow_dtd: false,
        nodes_limit: MOST_NODES,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options)
        .map_err(|e| subject.malformed("the OME-XML description", "sound XML", e.to_string()))
}

/// Where a plane is.
#[derive(Clone)]
enum Place {
    Page(usize),
    Elsewhere(String),
    Nowhere,
}

/// The image that is read.
struct Image<'a, 'b> {
    subject: &'b Subject<'b>,
    /// Its number in the document, from 0.
    number: usize,
    /// Name of the file and what the document calls it.
    file: String,
    uuid: &'b str,
    pixels: Node<'b, 'a>,
}

impl<'a, 'b> Image<'a, 'b> {
    fn choose(
        subject: &'b Subject<'b>,
        document: &'b Document<'a>,
        options: &OpenOptions,
        notes: &mut Vec<String>,
    ) -> Result<Self, SourceError> {
        let root = document.root_element();
        if let Some(node) = child(root, "BinaryOnly") {
            let file = node.attribute("MetadataFile").unwrap_or("unnamed");
            return Err(subject.unsupported(
                format!(
                    "an OME-TIFF set whose description is in another file ({})",
                    quoted(file)
                ),
                "open that file",
            ));
        }
        let images: Vec<Node<'b, 'a>> = children(root, "Image").collect();
        let id = |n: usize| {
            images[n]
                .attribute("ID")
                .map_or_else(|| format!("Image:{n}"), str::to_owned)
        };
        let ids = || {
            (0..images.len().min(8))
                .map(id)
                .collect::<Vec<_>>()
                .join(", ")
        };
        let chosen = match (&options.dataset, images.len()) {
            (_, 0) => {
                return Err(subject.malformed(
                    "the OME-XML description",
                    "an Image element",
                    "none",
                ));
            }
            (None, 1) => 0,
            (None, n) => {
                return Err(subject.unsupported(
                    format!("an OME-TIFF file of {n} images"),
                    format!("choose one with --dataset ID, of {}", ids()),
                ));
            }
            (Some(wanted), n) => {
                let found = (0..n).find(|&n| id(n) == *wanted);
                let Some(found) = found else {
                    return Err(subject.malformed(
                        "--dataset",
                        format!("one of {}", ids()),
                        quoted(wanted),
                    ));
                };
                notes.push(format!("Image {} of {n} is read.", quoted(wanted)));
                found
            }
        };
        let Some(pixels) = child(images[chosen], "Pixels") else {
            return Err(subject.malformed("the OME-XML description", "a Pixels element", "none"));
        };
        Ok(Self {
            subject,
            number: chosen,
            file: file_name(subject.path),
            uuid: root.attribute("UUID").unwrap_or_default(),
            pixels,
        })
    }

    fn malformed(&self, place: &str, expected: &str, found: &str) -> SourceError {
        let place = format!("the OME-XML description, {place}");
        self.subject.malformed(place, expected, found)
    }

    /// A number of voxels or planes.
    fn size(&self, name: &str) -> Result<u64, SourceError> {
        match number(self.pixels, name) {
            Ok(Some(n)) if n > 0 => Ok(n),
            Ok(None) if matches!(name, "SizeC" | "SizeT" | "SizeZ") => Ok(1),
            _ => {
                let found = self.pixels.attribute(name).unwrap_or("no such attribute");
                Err(self.malformed(name, "a number of at least 1", &quoted(found)))
            }
        }
    }

    /// The axes beside x and y, the fastest first.
    fn order(&self) -> Result<[char; 3], SourceError> {
        let order = self.pixels.attribute("DimensionOrder").unwrap_or("XYZCT");
        Ok(match order {
            "XYZCT" => ['Z', 'C', 'T'],
            "XYZTC" => ['Z', 'T', 'C'],
            "XYCZT" => ['C', 'Z', 'T'],
            "XYCTZ" => ['C', 'T', 'Z'],
            "XYTZC" => ['T', 'Z', 'C'],
            "XYTCZ" => ['T', 'C', 'Z'],
            other => {
                return Err(self.malformed(
                    "DimensionOrder",
                    "X, Y, then Z, C and T in any order",
                    &quoted(other),
                ));
            }
        })
    }

    fn spacing(&self) -> Result<[Option<f64>; 3], SourceError> {
        let mut spacing = [None; 3];
        for (axis, spacing) in ["X", "Y", "Z"].into_iter().zip(&mut spacing) {
            let name = format!("PhysicalSize{axis}");
            let Some(text) = self.pixels.attribute(name.as_str()) else {
                continue;
            };
            let Ok(value) = text.trim().parse::<f64>() else {
                return Err(self.malformed(&name, "a number", &quoted(text)));
            };
            let unit = self.pixels.attribute(format!("{name}Unit").as_str());
            *spacing = unit_mm(unit.unwrap_or("\u{b5}m")).map(|mm| mm * value);
        }
        Ok(spacing)
    }

    /// Planes and where they are, later ones overriding earlier ones.
    fn planes(
        &self,
        planes: u64,
        order: [char; 3],
        sizes: [u64; 3],
    ) -> Result<Vec<(u64, Place)>, SourceError> {
        let blocks: Vec<Node<'b, 'a>> = children(self.pixels, "TiffData").collect();
        if blocks.is_empty() {
            return Ok((0..planes).map(|n| (n, Place::Page(n as usize))).collect());
        }
        let is_renamed = self.is_renamed(&blocks);
        let mut places = Vec::new();
        for block in blocks {
            let value = |name: &str| {
                number(block, name).map_err(|text| {
                    let place = format!("TiffData, {name}");
                    self.malformed(&place, "a number", &quoted(text))
                })
            };
            let page = value("IFD")?;
            let count = match value("PlaneCount")?.or(value("NumPlanes")?) {
                Some(n) => n,
                None if page.is_some() => 1,
                None => planes,
            };
            let (mut first, mut stride) = (0, 1);
            for (axis, size) in order.into_iter().zip(sizes) {
                let index = value(&format!("First{axis}"))?.unwrap_or(0);
                if index >= size {
                    let place = format!("TiffData, First{axis}");
                    return Err(self.malformed(
                        &place,
                        &format!("below {size}"),
                        &index.to_string(),
                    ));
                }
                first += index * stride;
                stride *= size;
            }
            let elsewhere = child(block, "UUID")
                .filter(|uuid| !is_renamed && !self.is_here(*uuid))
                .map(|uuid| uuid.attribute("FileName").unwrap_or("unnamed").to_owned());
            // Blocks may not make more of a file than it holds, however often they tell of it.
            let count = count.min(planes - first);
            if places.len() as u64 + count > 2 * MOST_PLANES {
                return Err(self.malformed("TiffData", "every plane once", "far more planes"));
            }
            for n in 0..count {
                let page = page.unwrap_or(0).saturating_add(n);
                let place = match &elsewhere {
                    Some(file) => Place::Elsewhere(file.clone()),
                    None => Place::Page(usize::try_from(page).unwrap_or(usize::MAX)),
                };
                places.push((first + n, place));
            }
        }
        Ok(places)
    }

    /// True for what the document says of the file that it is in.
    fn is_here(&self, uuid: Node<'_, '_>) -> bool {
        let same_id = !self.uuid.is_empty() && uuid.text().map(str::trim) == Some(self.uuid);
        match uuid.attribute("FileName") {
            None => same_id || uuid.text().is_none_or(|t| t.trim().is_empty()),
            Some(name) => same_id || name == self.file,
        }
    }

    /// True when all planes are in one file of another name: this one, which was renamed.
    fn is_renamed(&self, blocks: &[Node<'_, '_>]) -> bool {
        let names = || {
            blocks
                .iter()
                .map(|b| child(*b, "UUID").and_then(|u| u.attribute("FileName")))
        };
        let first = names().next().flatten();
        first.is_some() && names().all(|name| name == first)
    }
}

fn children<'a, 'b>(node: Node<'b, 'a>, name: &'static str) -> impl Iterator<Item = Node<'b, 'a>> {
    node.children().filter(move |n| n.tag_name().name() == name)
}

fn child<'a, 'b>(node: Node<'b, 'a>, name: &'static str) -> Option<Node<'b, 'a>> {
    children(node, name).next()
}

/// A number in an attribute, or its text where it is none.
fn number<'b>(node: Node<'b, '_>, name: &str) -> Result<Option<u64>, &'b str> {
    match node.attribute(name) {
        None => Ok(None),
        Some(text) => text.trim().parse().map(Some).map_err(|_| text),
    }
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
