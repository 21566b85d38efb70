//! Which page of a file is which slice: what ImageJ, OME-XML and tifffile say of it, and the user's choice among channels
//! and points in time.

use super::description::{Description, Resolution};
use super::directory::{Directory, Tiff};
use super::imagej::ImageJ;
use super::page::{self, Page};
use super::{SUPPORTED, ome};
use crate::input::options::OpenOptions;
use crate::input::problem::Subject;
use crate::volume::{Rescale, SourceError};

/// The one of `count` that is read: the only one, or the one that the user chose.
///
/// # Errors
/// There are several and none was chosen, or there is none of that number.
pub(super) fn choose(
    subject: &Subject<'_>,
    what: &str,
    count: u64,
    chosen: Option<u64>,
    notes: &mut Vec<String>,
) -> Result<u64, SourceError> {
    let (one, many) = match what {
        "time" => ("Point in time", "points in time"),
        _ => ("Channel", "channels"),
    };
    let choices = format!("from 0 to {}", count - 1);
    match chosen {
        None if count == 1 => Ok(0),
        None => Err(subject.unsupported(
            format!("a volume of {count} {many} without --{what}"),
            format!("choose one with --{what} N, {choices}"),
        )),
        Some(n) if n < count => {
            if count > 1 {
                notes.push(format!("{one} {n} is read, of {count} {many}."));
            }
            Ok(n)
        }
        Some(n) => {
            let subject = Subject {
                remedy: "choose one that is there, or leave the option out where there is only one",
                ..*subject
            };
            Err(subject.malformed(format!("--{what}"), choices, n.to_string()))
        }
    }
}

/// The pages of a file, as its chain of directories names them.
pub(super) struct Chain {
    pub(super) first: Directory,
    pub(super) pages: Vec<PagePlace>,
}

#[derive(Clone, Copy)]
pub(super) struct PagePlace {
    pub(super) number: usize,
    /// Byte of the file where the directory begins.
    pub(super) at: u64,
    /// It is a reduced copy or a mask.
    pub(super) is_side: bool,
}

impl Chain {
    /// Walks the chain of directories.
    ///
    /// # Errors
    /// It is damaged, or has no page of full resolution.
    pub(super) fn walk(tiff: &Tiff) -> Result<Self, SourceError> {
        let mut first = None;
        let mut pages = Vec::new();
        for directory in tiff.directories() {
            let directory = directory?;
            pages.push(PagePlace {
                number: directory.number,
                at: directory.at,
                is_side: page::is_side_page(tiff, &directory)?,
            });
            first.get_or_insert(directory);
        }
        let subject = tiff.subject();
        let Some(first) = first else {
            return Err(subject.malformed("the header", "the place of a page", "none"));
        };
        if pages.iter().all(|p| p.is_side) {
            return Err(subject.malformed(
                "the pages",
                "one of full resolution",
                "only reduced copies and masks",
            ));
        }
        Ok(Self { first, pages })
    }

    /// The pages that are no copies or masks.
    pub(super) fn main_pages(&self) -> Vec<PagePlace> {
        self.pages.iter().filter(|p| !p.is_side).copied().collect()
    }
}

/// Where the slices are.
pub(super) enum Planes {
    /// Each in a page.
    Pages(Vec<PagePlace>),
    /// All behind the voxels of the first page: from byte `start` on, the next one `stride` bytes further.
    Behind { start: u64, stride: u64, count: u64 },
}

impl Planes {
    /// How many slices there are.
    pub(super) fn count(&self) -> u64 {
        match self {
            Self::Pages(pages) => pages.len() as u64,
            Self::Behind { count, .. } => *count,
        }
    }

    /// Those from number `first` on, one of each `step`, `count` of them.
    fn part(self, first: u64, step: u64, count: u64) -> Self {
        match self {
            Self::Pages(pages) => {
                let planes = (0..count).map(|n| pages[(first + n * step) as usize]);
                Self::Pages(planes.collect())
            }
            Self::Behind { start, stride, .. } => Self::Behind {
                start: start + first * stride,
                stride: step * stride,
                count,
            },
        }
    }
}

/// What the descriptions make of the pages.
pub(super) struct Layout {
    pub(super) planes: Planes,
    pub(super) spacing: [Option<f64>; 3],
    pub(super) rescale: Rescale,
    pub(super) unit: String,
    /// Columns and rows, where the description tells them.
    pub(super) stated_size: Option<(u64, u64)>,
    /// What was chosen among several volumes in the file, in words.
    pub(super) choice: String,
}

impl Layout {
    /// What the description of the first page makes of the file.
    ///
    /// # Errors
    /// It contradicts the pages, is of a kind that is not built, or leaves a choice that `options` do not make.
    pub(super) fn read(
        tiff: &Tiff,
        chain: &Chain,
        options: &OpenOptions,
        notes: &mut Vec<String>,
    ) -> Result<Self, SourceError> {
        let shape = match Description::read(tiff, &chain.first)? {
            Description::Ome(text) => return of_ome(tiff, chain, &text, options, notes),
            Description::ImageJ(imagej) => return of_imagej(tiff, chain, &imagej, options, notes),
            Description::Shape(shape) => shape,
            Description::Other => Vec::new(),
        };
        let mut layout = of_shape(tiff, chain, &shape, options, notes)?;
        layout.spacing = Resolution::read(tiff, &chain.first)?.spacing();
        Ok(layout)
    }

    fn new(planes: Planes) -> Self {
        Self {
            planes,
            spacing: [None; 3],
            rescale: Rescale::IDENTITY,
            unit: String::new(),
            stated_size: None,
            choice: String::new(),
        }
    }
}

fn of_ome(
    tiff: &Tiff,
    chain: &Chain,
    text: &str,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Layout, SourceError> {
    let subject = tiff.subject();
    let ome = ome::parse(&subject, text, options, notes)?;
    let mut pages = Vec::with_capacity(ome.pages.len());
    for (z, &number) in ome.pages.iter().enumerate() {
        match chain.pages.get(number) {
            Some(page) if !page.is_side => pages.push(*page),
            other => {
                let found = match other {
                    Some(_) => "a reduced copy or a mask".to_owned(),
                    None => format!("{} pages", chain.pages.len()),
                };
                let place = format!("slice {z} of the OME-XML description");
                return Err(subject.malformed(place, format!("page {number}"), found));
            }
        }
    }
    let mut layout = Layout::new(Planes::Pages(pages));
    layout.spacing = ome.spacing;
    layout.stated_size = Some((ome.width, ome.height));
    layout.choice = ome.choice;
    Ok(layout)
}

fn of_imagej(
    tiff: &Tiff,
    chain: &Chain,
    imagej: &ImageJ,
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Layout, SourceError> {
    let subject = tiff.subject();
    let channel = choose(&subject, "channel", imagej.channels, options.channel, notes)?;
    let time = choose(&subject, "time", imagej.frames, options.time, notes)?;
    let main = chain.main_pages();
    // The channels of a slice come first, then the slices of a point in time.
    let first = time * imagej.slices * imagej.channels + channel;
    let planes = if main.len() as u64 == imagej.images {
        Planes::Pages(main)
    } else if let [only] = main[..] {
        behind(tiff, only, imagej.images)?
    } else {
        return Err(subject.malformed(
            "the ImageJ description, images",
            format!(
                "one page for each of {} planes, or one page for all",
                imagej.images
            ),
            format!("{} pages", main.len()),
        ));
    };
    if imagej.is_curved {
        notes.push(
            "ImageJ's calibration of the values is no straight line and is left out.".to_owned(),
        );
    }
    let mut layout = Layout::new(planes.part(first, imagej.channels, imagej.slices));
    let (spacing, note) = imagej.spacing(&Resolution::read(tiff, &chain.first)?, false);
    if options.spacing.is_none() {
        notes.extend(note);
    }
    layout.spacing = spacing;
    layout.rescale = imagej.rescale;
    layout.unit.clone_from(&imagej.value_unit);
    layout.choice = format!(", channel {channel}, time {time}");
    Ok(layout)
}

/// Pages that are slices, and an array of `shape` in them as far as it is told.
fn of_shape(
    tiff: &Tiff,
    chain: &Chain,
    shape: &[u64],
    options: &OpenOptions,
    notes: &mut Vec<String>,
) -> Result<Layout, SourceError> {
    let subject = tiff.subject();
    choose(&subject, "channel", 1, options.channel, notes)?;
    choose(&subject, "time", 1, options.time, notes)?;
    let leading = &shape[..shape.len().saturating_sub(2)];
    let planes = leading.iter().try_fold(1, |n: u64, &m| n.checked_mul(m));
    let main = chain.main_pages();
    let layout = match (&main[..], planes) {
        ([only], Some(planes)) if planes > 1 => Layout::new(behind(tiff, *only, planes)?),
        _ => Layout::new(Planes::Pages(main)),
    };
    if leading.iter().filter(|&&n| n > 1).count() > 1 {
        notes.push(format!(
            "The file holds an array of {} axes ({shape:?}); all planes are read as slices one after another.",
            shape.len()
        ));
    }
    Ok(layout)
}

/// The planes of a stack that has one page for all: how ImageJ writes what is larger than 4 GiB.
fn behind(tiff: &Tiff, only: PagePlace, planes: u64) -> Result<Planes, SourceError> {
    let page = Page::parse(tiff, &tiff.directory(only.number, only.at)?)?;
    let Some(start) = page.contiguous_start() else {
        return Err(tiff.subject().unsupported(
            format!("one page for {planes} planes in another form than one uncompressed block"),
            SUPPORTED,
        ));
    };
    let plane_bytes = page.format.row_bytes() as u64 * page.format.height;
    let bytes = plane_bytes.checked_mul(planes);
    let what = format!("the voxels of the {planes} planes of the description");
    tiff.check_range(&what, start, bytes.unwrap_or(u64::MAX))?;
    Ok(Planes::Behind {
        start,
        stride: plane_bytes,
        count: planes,
    })
}
