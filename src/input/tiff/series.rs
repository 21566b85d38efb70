//! A volume in several TIFF files of one page each, the slices in the order of the files.

use std::path::{Path, PathBuf};

use glam::U64Vec3;
use rayon::prelude::*;

use super::description::{Description, Resolution};
use super::directory::Tiff;
use super::layout::choose;
use super::ome;
use super::one_file::{Remarks, check_same};
use super::page::{Format, Page, is_side_page};
use crate::input::options::OpenOptions;
use crate::input::problem::Subject;
use crate::input::stack::{Slices, Stack};
use crate::input::voxel_file::voxel_bytes;
use crate::input::{spacing, stamp};
use crate::volume::{Rescale, SourceError, VolumeDesc};

/// Opens files that are slices. `named` is what the user typed for them.
///
/// # Errors
/// As [`super::open`].
pub(super) fn open(
    files: &[PathBuf],
    named: &Subject<'_>,
    options: &OpenOptions,
) -> Result<Stack, SourceError> {
    let Some(first) = files.first() else {
        return Err(named.malformed("the path", "TIFF files", "none"));
    };
    let mut notes = Vec::new();
    choose(named, "channel", 1, options.channel, &mut notes)?;
    choose(named, "time", 1, options.time, &mut notes)?;
    let head = Head::read(first, files.len())?;
    let pages: Vec<Result<(Remarks, u64), SourceError>> = files
        .par_iter()
        .map(|file| {
            let (tiff, page) = only_page(file)?;
            check_same(&tiff, &page, head.format)?;
            Ok((Remarks::of(&page), page.working_bytes()))
        })
        .collect();
    let mut remarks = Remarks::default();
    let mut working_bytes = 0;
    for page in pages {
        let (remark, bytes) = page?;
        remarks.add(&remark);
        working_bytes = working_bytes.max(bytes);
    }
    remarks.tell(&mut notes);
    if options.spacing.is_none() {
        notes.extend(head.note);
    }
    let dims = U64Vec3::new(head.format.width, head.format.height, files.len() as u64);
    let desc = VolumeDesc {
        dims,
        voxel_type: head.format.voxel_type,
        world_from_index: spacing::world(named, head.spacing, dims, options, &mut notes)?,
        rescale: head.rescale,
        unit: head.unit,
        name: named.name(),
    };
    voxel_bytes(named, &desc)?;
    let slices = Series {
        files: files.to_vec(),
        format: head.format,
        working_bytes,
    };
    Ok(Stack::new(desc, Box::new(slices)).with_notes(notes))
}

/// What the first file says of all.
struct Head {
    format: Format,
    spacing: [Option<f64>; 3],
    note: Option<String>,
    rescale: Rescale,
    unit: String,
}

impl Head {
    fn read(path: &Path, files: usize) -> Result<Self, SourceError> {
        let (tiff, page) = only_page(path)?;
        let directory = tiff.directory(page.number, page.at)?;
        let resolution = Resolution::read(&tiff, &directory)?;
        let mut head = Self {
            format: page.format,
            spacing: resolution.spacing(),
            note: None,
            rescale: Rescale::IDENTITY,
            unit: String::new(),
        };
        match Description::read(&tiff, &directory)? {
            Description::Ome(text) => head.spacing = ome::of_slice(&tiff.subject(), &text, files)?,
            Description::ImageJ(imagej) => {
                (head.spacing, head.note) = imagej.spacing(&resolution, true);
                head.rescale = imagej.rescale;
                head.unit = imagej.value_unit;
            }
            Description::Shape(_) | Description::Other => {}
        }
        Ok(head)
    }
}

/// The page of a file that has one.
fn only_page(path: &Path) -> Result<(Tiff, Page), SourceError> {
    let tiff = Tiff::open(path)?;
    let mut only = None;
    for directory in tiff.directories() {
        let directory = directory?;
        if is_side_page(&tiff, &directory)? {
            continue;
        }
        if only.replace(directory).is_some() {
            return Err(tiff.subject().unsupported(
                "a series of files of several pages each",
                "supported are files of one page each, or one file of all pages; name that one",
            ));
        }
    }
    let Some(directory) = only else {
        return Err(tiff
            .subject()
            .malformed("the header", "the place of a page", "none"));
    };
    let page = Page::parse(&tiff, &directory)?;
    Ok((tiff, page))
}

/// The slices of several files, opened anew for each.
struct Series {
    files: Vec<PathBuf>,
    format: Format,
    working_bytes: u64,
}

impl Slices for Series {
    fn read(&self, z: u64, out: &mut [u8]) -> Result<(), SourceError> {
        let (tiff, page) = only_page(&self.files[z as usize])?;
        check_same(&tiff, &page, self.format)?;
        page.read(&tiff, out)
    }

    fn working_bytes(&self) -> u64 {
        self.working_bytes
    }

    fn stamp(&self) -> String {
        stamp::of_files(&self.files)
    }
}
